"""Choosing a level: which error model do the data support."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal import parallel
from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import IdentificationError, RobotError
from irbcal.identification.choices import LEVELS, Level
from irbcal.identification.fit import identify
from irbcal.measurement.places import places
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.sessions import into_one_frame
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import levels_of
from irbcal.options import checked
from irbcal.summary import Speaks, Table, Told
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

FOLDS = 5
"""Parts of the cross-validation."""
FIT_S = 1e-5
"""Seconds that a point takes in a fit."""


@dataclass(frozen=True)
class Candidate:
    """Cross-validated error of one level.

    Attributes
    ----------
    level : str
    mean_mm : float
        Mean over the poses of the mean distance of a pose that the fit did not see.
    gain_mm, gain_std_mm : float or None
        By how much it is better than the level chosen before it, pose by pose, with standard error; None for
        the first.
    chosen : bool
        Whether it was better by more than the standard error, and so replaced the level before it.
    refused : str
        Why it could not be fitted, else empty.
    """

    level: Level
    mean_mm: float | None
    gain_mm: float | None
    gain_std_mm: float | None
    chosen: bool
    refused: str = ""


@dataclass(frozen=True, repr=False)
class Choice(Speaks):
    """A chosen level with the comparison that led to it.

    Attributes
    ----------
    level : str
    table : tuple of Candidate
        In the order of growing size.
    explanation : str
        Two sentences.
    """

    level: Level
    table: tuple[Candidate, ...]
    explanation: str

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """Which level and why; the levels compared; why some could not be."""
        rows = tuple((row.level, row.mean_mm, row.gain_mm, row.gain_std_mm) for row in self.table)
        columns = ("model", "mean (mm)", "gain (mm)", "±")
        bold = frozenset(k for k, row in enumerate(self.table) if row.level == self.level)
        title = "Cross-validated errors; gain over the smaller model chosen before"
        refused = [f"  model {row.level}: {row.refused}" for row in self.table if row.refused]
        return (self.explanation, Table(title, columns, rows, bold=bold), *refused)

    def to_frame(self) -> pd.DataFrame:
        """The levels compared, a row each, with the columns of `Candidate`."""
        import pandas as pd

        return pd.DataFrame([vars(row) for row in self.table])


def pose_errors(
    arm: Arm,
    points: PointSet,
    level: Level,
    folds: IntArray,
    known_targets: Mapping[str, ArrayLike] | None = None,
) -> FloatArray:
    """Mean distance of each pose under a model fitted to the other folds, shape (n,), metres."""
    errors = np.full(points.poses, np.nan)

    def leave_out(fold: int) -> None:
        out = folds == fold
        found = identify(arm, points.select(~out), level, known_targets)
        seen = into_one_frame(points.select(out), found.robot.T_world_base, found.other_bases)
        distance = distances(found.robot, seen)
        count = np.bincount(seen.pose, minlength=seen.poses)
        errors[out] = np.bincount(seen.pose, distance, minlength=seen.poses) / np.maximum(count, 1)

    for _ in parallel.threads(leave_out, range(folds.max() + 1), FIT_S * len(points) * (folds.max() + 1)):
        pass
    return errors


def choose_level(
    arm: Arm,
    points: PointSet,
    seed: int = 0,
    levels: Sequence[Level] | None = None,
    progress: Callable[[str], object] | None = None,
    known_targets: Mapping[str, ArrayLike] | None = None,
) -> Choice:
    """Compare levels by cross-validation over poses and choose one.

    Going from small to large, a level replaces the one chosen so far only if it is better, pose by pose, by more
    than the standard error of that difference. Repeats of one place are one pose here.

    Parameters
    ----------
    arm : Arm
    points : PointSet
        Poses of the fit; held-out poses take no part.
    seed : int
        Of the division into five folds.
    levels : sequence of str, optional
        From small to large; all that the arm has unless given.
    progress : callable, optional
        Called with a text for each level.
    known_targets : dict of str to array_like, shape (3,), optional
        See `irbcal.identification.fit.identify`.

    Returns
    -------
    Choice

    Raises
    ------
    IdentificationError
        If not even the smallest level can be fitted.
    OptionError
        If there is no such level.
    """
    place = places(points)
    count = np.bincount(place)
    folds = np.random.default_rng(seed).permutation(np.arange(len(count)) % FOLDS)[place]
    compared = [checked("levels", level, LEVELS) for level in (levels_of(arm) if levels is None else levels)]
    table: list[Candidate] = []
    chosen, best = compared[0], np.zeros(0)
    for level in compared:
        if progress:
            progress(f"cross-validating model {level}")
        try:
            errors = np.bincount(place, pose_errors(arm, points, level, folds, known_targets)) / count
        except (IdentificationError, RobotError) as error:
            if not table:
                raise
            table.append(Candidate(level, None, None, None, False, str(error)))
            continue
        mean = float(errors.mean() / MM)
        better, gain, deviation = True, None, None
        if table:
            difference = (best - errors) / MM
            gain = float(difference.mean())
            deviation = float(difference.std(ddof=1) / np.sqrt(len(difference)))
            better = gain > deviation
        if better:
            chosen, best = level, errors
        table.append(Candidate(level, mean, gain, deviation, better))
    return Choice(chosen, tuple(table), _explain(chosen, table, len(count)))


def _explain(chosen: Level, table: Sequence[Candidate], poses: int) -> str:
    """Two sentences on the choice."""
    row = next(item for item in table if item.level == chosen)
    first = f"Model {chosen} has a cross-validated mean error of {row.mean_mm:.3f} mm over {poses} poses"
    if row.gain_mm is not None:
        first += f", {row.gain_mm:.3f} ± {row.gain_std_mm:.3f} mm better than the smaller model before it"
    larger = [item for item in table[table.index(row) + 1 :] if not item.refused]
    if larger:
        second = f"{_listed(larger)} not better by more than the standard error of the difference."
    else:
        second = "No larger model could be compared."
    return f"{first}. {second}"


def _listed(items: Sequence[Candidate]) -> str:
    """Levels as the subject of a sentence."""
    names = " and ".join(item.level for item in items)
    return f"The larger model {names} is" if len(items) == 1 else f"The larger models {names} are"
