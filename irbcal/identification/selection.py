"""Choosing a level: which error model do the data support."""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError, RobotError
from irbcal.identification.fit import identify
from irbcal.measurement.points import distances
from irbcal.modeling.parameters import levels_of
from irbcal.units import MM

FOLDS = 5


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

    level: str
    mean_mm: float | None
    gain_mm: float | None
    gain_std_mm: float | None
    chosen: bool
    refused: str = ""


@dataclass(frozen=True)
class Choice:
    """A chosen level with the comparison that led to it.

    Attributes
    ----------
    level : str
    table : list of Candidate
        In the order of growing size.
    explanation : str
        Two sentences.
    """

    level: str
    table: list
    explanation: str


def pose_errors(arm, points, level, folds, **options):
    """Mean distance of each pose under a model fitted to the other folds, shape (n,), metres."""
    errors = np.full(points.poses, np.nan)
    for fold in range(folds.max() + 1):
        out = folds == fold
        robot = identify(arm, points.select(~out), level, **options).robot
        seen = points.select(out)
        distance = distances(robot, seen)
        count = np.bincount(seen.pose, minlength=seen.poses)
        errors[out] = np.bincount(seen.pose, distance, minlength=seen.poses) / np.maximum(count, 1)
    return errors


def choose_level(arm, points, seed=0, levels=None, progress=None, **options):
    """Compare levels by cross-validation over poses and choose one.

    Going from small to large, a level replaces the one chosen so far only if it is better, pose by pose, by more
    than the standard error of that difference.

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
    **options
        See `irbcal.identification.fit.identify`.

    Returns
    -------
    Choice

    Raises
    ------
    IdentificationError
        If not even the smallest level can be fitted.
    """
    folds = np.random.default_rng(seed).permutation(np.arange(points.poses) % FOLDS)
    table, chosen, best = [], None, None
    for level in levels_of(arm) if levels is None else levels:
        if progress:
            progress(f"cross-validating model {level}")
        try:
            errors = pose_errors(arm, points, level, folds, **options)
        except (IdentificationError, RobotError) as error:
            if chosen is None:
                raise
            table.append(Candidate(level, None, None, None, False, str(error)))
            continue
        mean = float(errors.mean() / MM)
        if chosen is None:
            better, gain, deviation = True, None, None
        else:
            difference = (best - errors) / MM
            gain = float(difference.mean())
            deviation = float(difference.std(ddof=1) / np.sqrt(len(difference)))
            better = gain > deviation
        if better:
            chosen, best = level, errors
        table.append(Candidate(level, mean, gain, deviation, better))
    return Choice(chosen, table, _explain(chosen, table, points.poses))


def _explain(chosen, table, poses):
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


def _listed(items):
    names = " and ".join(item.level for item in items)
    return f"The larger model {names} is" if len(items) == 1 else f"The larger models {names} are"
