"""Whether a calibrated robot keeps a tolerance: one figure by one rule, its interval, and what stands against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import IntArray, lock
from irbcal.errors import OptionError
from irbcal.options import checked, length
from irbcal.summary import Speaks, Told
from irbcal.units import MM
from irbcal.validation import bootstrap
from irbcal.validation.verdict import MOST_LEFT_OUT, Verdict

Rule: TypeAlias = Literal["mean3sigma", "max", "percentile"]
RULES: tuple[Rule, ...] = get_args(Rule)
Outcome: TypeAlias = Literal["pass", "fail", "not proven"]

FIGURES: Mapping[Rule, tuple[str, str]] = {
    "mean3sigma": ("mean + 3 sigma of the position errors", "mean_plus_3sigma_mm"),
    "max": ("largest position error", "max_mm"),
    "percentile": ("95th percentile of the position errors", "p95_mm"),
}
"""What each rule compares with the tolerance: in words, and its name among the statistics."""

LARGEST = 0.1
"""Tolerance beyond which millimetres were meant, metres."""


@dataclass(frozen=True, eq=False, repr=False)
class Conformity(Speaks):
    """Whether the calibrated robot keeps a tolerance.

    Attributes
    ----------
    outcome : str
        ``pass``, ``fail``, or ``not proven``: within the tolerance, but there is something that speaks against a pass.
    rule : str
        ``mean3sigma``, ``max`` or ``percentile`` (the 95th).
    tolerance_mm, value_mm : float
    intervals_mm : dict
        95 % bootstrap intervals of the statistics by their names; empty where poses are too few.
    interval_mm : tuple of two float, or None
        That of the value; None for the largest error, and where poses are too few.
    poses, points : int
        What was judged.
    straddles : bool
        Whether the interval holds the tolerance: other poses of the same kind may come out otherwise.
    against : tuple of str
        Why it is not proven, in sentences.
    remarks : tuple of str
        What to know of it, in sentences.
    simulated : bool
    """

    outcome: Outcome
    rule: Rule
    tolerance_mm: float
    value_mm: float
    intervals_mm: Mapping[str, Sequence[float]]
    interval_mm: tuple[float, ...] | None
    poses: int
    points: int
    straddles: bool
    against: tuple[str, ...]
    remarks: tuple[str, ...]
    simulated: bool

    def __post_init__(self) -> None:
        lock(self)

    def __bool__(self) -> bool:
        return self.outcome == "pass"

    @property
    def figure(self) -> str:
        """What is compared with the tolerance, in words."""
        return FIGURES[self.rule][0]

    def sentence(self) -> str:
        """Figure, interval and tolerance."""
        interval = ""
        if self.interval_mm is not None:
            low, high = self.interval_mm
            interval = f" (95 % interval {low:.3f} to {high:.3f} mm)"
        within = "within" if self.value_mm <= self.tolerance_mm else "beyond"
        kind = "SIMULATED " if self.simulated else ""
        return (
            f"The {self.figure} is {self.value_mm:.3f} mm{interval}, {within} the tolerance of {self.tolerance_mm:.3f} "
            f"mm, on {self.points} {kind}points of {self.poses} poses."
        )

    def told(self) -> Sequence[Told]:
        """Outcome, figures, what speaks against a pass, and remarks."""
        lines = [f"Tolerance: {self.outcome.upper()}. {self.sentence()}"]
        lines += [f"Against a pass: {words}" for words in self.against]
        return [*lines, *(f"Note: {words}" for words in self.remarks)]

    def to_dict(self) -> dict[str, Any]:
        """What ``irbcal evaluate --tolerance --json`` prints."""
        return {
            "outcome": self.outcome,
            "rule": self.rule,
            "tolerance_mm": self.tolerance_mm,
            "value_mm": self.value_mm,
            "interval_mm": None if self.interval_mm is None else list(self.interval_mm),
            "straddles": self.straddles,
            "poses": self.poses,
            "points": self.points,
            "against": list(self.against),
            "remarks": list(self.remarks),
        }


def check_options(tolerance: float | None, rule: str | None) -> Rule:
    """The rule that is meant; refuses a tolerance that is none, and a rule without one.

    Raises
    ------
    OptionError
    """
    if tolerance is None:
        if rule is not None:
            raise OptionError("rule: only a tolerance has one: give the tolerance, too", parameter="rule")
        return "mean3sigma"
    if not 0.0 < length("tolerance", tolerance, 0.0) <= LARGEST:
        raise OptionError(
            f"tolerance: expected metres above 0 and at most {LARGEST:g} (half a millimetre is 0.0005), found "
            f"{tolerance:g}",
            parameter="tolerance",
        )
    return checked("rule", rule or "mean3sigma", RULES)


def conformity(
    statistics: Mapping[str, float],
    distance: ArrayLike,
    place: IntArray,
    verdict: Verdict,
    tolerance: float,
    rule: Rule = "mean3sigma",
    *,
    poses: int,
    largest_covers: float,
    proven: bool = True,
    simulated: bool = False,
    seed: int = 0,
) -> Conformity:
    """Judge errors by a tolerance.

    A pass needs the figure within the tolerance and a trusted verdict: poses that the fit never saw, few points left
    out, no doubts, and a calibration that serves the robot.

    Parameters
    ----------
    statistics : dict
        Statistics and percentiles of the calibrated robot's errors, mm.
    distance : array_like, shape (m,)
        These errors, metres.
    place : ndarray of int, shape (m,)
        Place of each: repeats of one place are drawn together.
    verdict : Verdict
        Of the same errors.
    tolerance : float
        Metres.
    rule : {"mean3sigma", "max", "percentile"}
    poses : int
        How many there are.
    largest_covers : float
        See `irbcal.validation.accuracy.largest_covers`.
    proven : bool
        Whether the fit never saw these poses.
    simulated : bool
    seed : int
        Of the bootstrap.

    Returns
    -------
    Conformity
    """
    words, key = FIGURES[rule]
    distance, limit = np.asarray(distance, dtype=float), tolerance / MM
    value = float(statistics[key])
    intervals = bootstrap.intervals(distance, place, seed=seed) or {}
    interval = tuple(intervals[key]) if key in intervals else None
    straddles = interval is not None and interval[0] <= limit <= interval[1]
    against = _against(verdict, proven, len(np.unique(place)))
    remarks = []
    if straddles:
        remarks.append(
            f"The interval of the {words} holds the tolerance: other poses of the same kind may come out otherwise. "
            "More poses would tell."
        )
    if rule == "max":
        remarks.append(
            "The largest error has no interval: with 95 % confidence, "
            f"{largest_covers:.1%} of all poses of this kind stay below it; others may exceed it."
        )
    outcome: Outcome = "fail" if not value <= limit else "not proven" if against else "pass"
    return Conformity(
        outcome,
        rule,
        limit,
        value,
        intervals,
        interval,
        poses,
        len(distance),
        straddles,
        tuple(against),
        tuple(remarks),
        simulated,
    )


def _against(verdict: Verdict, proven: bool, places: int) -> list[str]:
    """Why a figure within the tolerance would be no pass, in sentences."""
    out = list(verdict.doubts)
    if not proven:
        out.append("Poses that the calibration was fitted to are no proof of accuracy: measure others.")
    if places < bootstrap.FEWEST_POSES:
        out.append(f"{places} places are too few to judge by: {bootstrap.FEWEST_POSES} are the least.")
    if verdict.left_out > MOST_LEFT_OUT:
        out.append(f"{verdict.left_out:.0%} of the measured points were left out, which may be the rule.")
    if verdict.outcome == "worse":
        out.append("The calibrated robot is WORSE than the nominal one on these poses.")
    if verdict.outcome == "no better":
        out.append("The calibrated robot is no better than the nominal one on these poses, beyond chance.")
    if not verdict.trusted and not out:
        out.append("The verdict on the calibration is not to be trusted.")
    return out
