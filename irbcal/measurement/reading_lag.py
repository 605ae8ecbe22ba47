"""Joint readings beside programmed joints: how far they differ, and whether the arm still moved when they were taken.

A controller that reads its joints as a motion ends, before the arm stands still, reports all of them behind by one and
the same share of the last move: reading minus command = -s D with one s for each pose, D the last programmed move of
all joints. A calibration that takes such readings for the joints errs by s D; programs run at the programmed joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, NameArray
from irbcal.distributions import NORMAL_95
from irbcal.measurement.column_names import joint_units
from irbcal.summary import Paragraph, Result, Table

FEWEST_POSES = 10
"""Poses with a known last move from which on the readings are judged."""

LEAST_EXPLAINED = 0.8
"""Share of the differences' variance that the other joints must foretell. Noise leaves it at or below zero,
readings that are off by a constant or by a share of the joint itself (a gear ratio) below 0.6."""

LEAST_MOVE_SHARE = 0.1
"""A pose counts for a joint if the others, which tell the factor, moved by this share of its own move or more."""

VERDICT = "the readings were taken before the arm stood still"


@dataclass(frozen=True, eq=False, repr=False)
class ReadingLag(Result):
    """What the last move says about joint readings that are not what was programmed.

    The factor s of a pose is the least-squares one of all its joints. It is fitted to what it explains, so one joint
    alone would always be explained. Therefore each joint is also foretold: by the factor of the other joints of the
    pose, times its own last move; poses in which the others hardly moved do not count (`LEAST_MOVE_SHARE`).
    """

    columns: tuple[str, ...]
    """Those of the programmed joints."""
    difference: FloatArray
    """Shape (n, joints). Reading minus command of each pose, radians (metres for prismatic joints)."""
    factor: FloatArray
    """Shape (n,). s: the share of the last move that the readings lag behind; NaN where the last move is unknown or
    none.
    """
    explained: FloatArray
    """Shape (joints,). Share of each joint's variance (about zero) that the last move times the pose's factor explains;
    NaN: unknown.
    """
    explained_by_move: float
    """The same of all joints."""
    foretold: FloatArray
    """Shape (joints,). Share of each joint's variance that the factor of the other joints foretells; NaN: unknown."""
    foretold_by_others: float
    """The same of all joints."""
    slope: FloatArray
    slope_interval: FloatArray
    """Shape (joints,). Regression of each joint's difference on what the others foretell, 1 if it lags like them, and
    the half-width of its 95 % interval; NaN: unknown.
    """

    @property
    def before_standstill(self) -> bool:
        """Whether the data show that the readings were taken before the arm stood still.

        The rule: at least `FEWEST_POSES` poses with a factor, half of them or more with readings behind the command
        (none ahead), and the other joints predict at least the share `LEAST_EXPLAINED` of the variance.
        """
        finite = self.factor[np.isfinite(self.factor)]
        return (
            len(finite) >= FEWEST_POSES
            and float(np.median(finite)) > 0.0
            and self.foretold_by_others >= LEAST_EXPLAINED
        )

    def notes(self, source: str) -> list[str]:
        """What the user of a file should know, in sentences.

        Parameters
        ----------
        source : str
            The file.
        """
        takes = f"The model takes the programmed joints ({self.columns[0]} …) of {Path(source).name}"
        if not self.difference.any():
            return [f"{takes}; its joint readings are equal to them."]
        size = self.size
        sizes = []
        for unit, ending in (("degrees", "_deg"), ("mm", "_mm")):
            columns = [name.endswith(ending) for name in self.columns]
            if any(columns):
                sizes.append(f"{size[:, columns].max():.2g} {unit} (median {np.median(size[:, columns]):.2g})")
        notes = [f"{takes}; its joint readings differ by up to {' and '.join(sizes)}."]
        if np.isfinite(self.foretold_by_others):
            shares = ", ".join("–" if np.isnan(share) else f"{100 * share:.0f}" for share in self.explained)
            verdict = VERDICT if self.before_standstill else f"it is not shown that {VERDICT}"
            notes.append(
                f"One factor for each pose (median {_median(self.factor):.2g}) times the last move explains "
                f"{100 * self.explained_by_move:.0f} % of the variance of reading minus command, joint by joint "
                f"{shares} %; the factor of a pose's other joints predicts "
                f"{100 * self.foretold_by_others:.0f} %: {verdict}."
            )
        return notes

    @property
    def size(self) -> FloatArray:
        """Sizes of the differences, shape (n, joints), degrees and millimetres."""
        return np.abs(self.difference) / joint_units(self.columns)

    CONTENT = (
        "columns explained explained_by_move foretold foretold_by_others slope slope_interval before_standstill median "
        "largest median_factor"
    )
    COLUMNS = "factor *by_joint"

    @property
    def median(self) -> FloatArray:
        """Of the sizes of each joint's differences, shape (joints,)."""
        return np.asarray(np.median(self.size, axis=0))

    @property
    def largest(self) -> FloatArray:
        """The same of the largest."""
        return np.asarray(self.size.max(axis=0))

    @property
    def median_factor(self) -> float:
        """Of all poses."""
        return _median(self.factor)

    def by_joint(self) -> dict[str, FloatArray]:
        """Reading minus command of each joint, degrees (millimetres)."""
        names = [f"q{name[1:]}_minus_command" for name in self.columns]
        return dict(zip(names, (self.difference / joint_units(self.columns)).T, strict=True))

    def report(self) -> Sequence[Paragraph]:
        """A table joint by joint, and the verdict."""
        size = self.size
        rows = tuple(
            (
                name,
                float(np.median(size[:, j])),
                float(size[:, j].max()),
                self.explained[j],
                self.foretold[j],
                self.slope[j],
                self.slope_interval[j],
            )
            for j, name in enumerate(self.columns)
        )
        heads = ("joint", "median", "largest", "share by last move", "share by other joints", "slope", "±")
        verdict = VERDICT if self.before_standstill else f"It is not shown that {VERDICT}"
        return [
            Table("Joint readings minus programmed joints, degrees or mm", heads, rows, digits=4),
            f"{verdict[0].upper()}{verdict[1:]}.",
        ]


def reading_lag(
    readings: ArrayLike, programmed: ArrayLike, columns: Sequence[str], groups: NameArray | None = None
) -> ReadingLag:
    """Compare joint readings with programmed joints.

    Parameters
    ----------
    readings, programmed : array_like, shape (n, joints)
        Of each pose in the order in which the robot visited them, radians (metres for prismatic joints).
    columns : sequence of str
        Columns of the programmed joints: they tell the unit in which joints that turn and slide are weighed.
    groups : ndarray of str, shape (n,), optional
        The move to the first pose of a group is not known.
    """
    commands = np.asarray(programmed, dtype=float)
    difference = np.asarray(readings, dtype=float) - commands
    units = joint_units(columns)
    fresh = np.r_[True, np.zeros(len(commands) - 1, dtype=bool) if groups is None else groups[1:] != groups[:-1]]
    D = np.diff(commands, axis=0, prepend=commands[:1]) / units
    e = difference / units
    lagging = ~fresh & D.any(axis=1)
    factor = np.full(len(e), np.nan)
    e, D = e[lagging], D[lagging]
    squares, product = D**2, e * D
    factor[lagging] = -product.sum(axis=1) / squares.sum(axis=1)
    residual = e + factor[lagging][:, None] * D
    rest_squares = squares.sum(axis=1, keepdims=True) - squares
    counts: BoolArray = (rest_squares > 0.0) & (rest_squares >= LEAST_MOVE_SHARE**2 * squares)
    foretold = (product.sum(axis=1, keepdims=True) - product) / np.where(counts, rest_squares, 1.0) * D
    slope, interval = _slopes(e, foretold, counts)
    return ReadingLag(
        tuple(columns),
        difference,
        factor,
        np.array([_share(e[:, j], residual[:, j]) for j in range(e.shape[1])]),
        _share(e, residual),
        np.array([_share(e[m, j], (e - foretold)[m, j]) for j, m in enumerate(counts.T)]),
        _share(e[counts], (e - foretold)[counts]),
        slope,
        interval,
    )


def mixed_use(made_from_programmed: bool, programmed: bool, source: str) -> list[str]:
    """A note where a calibration and the measurements that it meets do not take the same joints.

    Parameters
    ----------
    made_from_programmed : bool
        Whether the calibration was made from programmed joints.
    programmed : bool
        Whether the measurements have them.
    source : str
        The measurements' file.
    """
    name = Path(source).name
    if made_from_programmed and not programmed:
        return [
            f"{name} has joint readings only, while the calibration was made from programmed joints: if its readings "
            "were taken before the arm stood still, the errors are larger here than in programs."
        ]
    if programmed and not made_from_programmed:
        return [
            f"{name} has programmed joints, while the calibration was made from joint readings: if these were taken "
            "before the arm stood still, a calibration from programmed joints is better."
        ]
    return []


def _share(values: FloatArray, residual: FloatArray) -> float:
    """Share of the values' variance about zero that is not left; NaN without any."""
    total = float((values**2).sum())
    return 1.0 - float((residual**2).sum()) / total if total > 0.0 else float("nan")


def _slopes(e: FloatArray, foretold: FloatArray, counts: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Slope through zero of each joint's difference on what is foretold, and half its 95 % interval.

    The interval allows for residuals of any size from pose to pose (White's standard errors).
    """
    x = np.where(counts, foretold, 0.0)
    squares = (x**2).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(squares > 0.0, (x * e).sum(axis=0) / squares, np.nan)
        error = np.sqrt((x**2 * (e - x * slope) ** 2).sum(axis=0)) / squares
    return slope, NORMAL_95 * error


def _median(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")
