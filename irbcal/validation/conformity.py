"""Whether a calibrated robot keeps a tolerance: one figure by one rule, its upper bound, and what stands against it.

A pass needs the one-sided 95 % upper bound of the figure and the tracker's expanded uncertainty within the tolerance
(decision rules of ISO 14253-1:2017 and JCGM 106:2012); a figure beyond the tolerance is a fail; all else is not proven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import IntArray
from irbcal.errors import OptionError
from irbcal.options import checked, length
from irbcal.summary import Paragraph, Result
from irbcal.units import MM
from irbcal.validation import bootstrap
from irbcal.validation.region import Region
from irbcal.validation.upper_bound import LARGEST_SHARE, RULES, Rule, upper_bound
from irbcal.validation.verdict import Verdict

Outcome: TypeAlias = Literal["pass", "fail", "not proven"]

FIGURES: Mapping[Rule, tuple[str, str]] = {
    "mean3sigma": ("mean + 3 sigma of the position errors", "mean_plus_3sigma_mm"),
    "max": ("largest position error", "max_mm"),
    "percentile": ("95th percentile of the position errors", "p95_mm"),
}
"""What each rule compares with the tolerance: in words, and its name among the statistics."""

LARGEST = 0.1
"""Tolerance and uncertainty beyond which millimetres were meant, metres."""


@dataclass(frozen=True, eq=False, repr=False)
class Conformity(Result):
    """Whether the calibrated robot keeps a tolerance.

    Attributes
    ----------
    outcome : str
        ``pass``, ``fail`` (the figure is beyond the tolerance), or ``not proven``.
    rule : str
        ``mean3sigma``, ``max`` or ``percentile`` (the 95th).
    tolerance_mm, value_mm : float
    upper_mm : float or None
        One-sided 95 % upper bound of the value; None where poses are too few.
    basis : str
        What the bound rests on.
    tracker_u95_mm : float
        Expanded uncertainty of the tracker, which is added to the bound.
    tracker_source : str
        Where it comes from.
    intervals_mm : dict
        95 % bootstrap intervals of the statistics by their names; empty where poses are too few.
    poses, points : int
        What was judged.
    against : tuple of str
        Why it is not proven, in sentences.
    region_only : bool
        Whether it is judged for the region of these poses only.
    simulated : bool
    """

    outcome: Outcome
    rule: Rule
    tolerance_mm: float
    value_mm: float
    upper_mm: float | None
    basis: str
    tracker_u95_mm: float
    tracker_source: str
    intervals_mm: Mapping[str, Sequence[float]]
    poses: int
    points: int
    against: tuple[str, ...]
    region_only: bool
    simulated: bool

    def __bool__(self) -> bool:
        return self.outcome == "pass"

    @property
    def figure(self) -> str:
        """What is compared with the tolerance, in words."""
        return FIGURES[self.rule][0]

    @property
    def limit_mm(self) -> float | None:
        """Upper bound and the tracker's uncertainty together, which a pass needs within the tolerance."""
        return None if self.upper_mm is None else self.upper_mm + self.tracker_u95_mm

    def sentence(self) -> str:
        """Figure, upper bound, the tracker's part and tolerance."""
        bound = ""
        if self.limit_mm is not None:
            bound = (
                f"; with 95 % confidence at most {self.upper_mm:.3f} mm, with the tracker's "
                f"{self.tracker_u95_mm:.3f} mm {self.limit_mm:.3f} mm"
            )
        kind = "SIMULATED " if self.simulated else ""
        where = " This holds for the region of these poses only." if self.region_only else ""
        return (
            f"The {self.figure} is {self.value_mm:.3f} mm{bound}. The tolerance is {self.tolerance_mm:.3f} mm. Judged "
            f"on {self.points} {kind}points of {self.poses} poses.{where}"
        )

    def rule_in_words(self) -> str:
        """What a pass needs."""
        bound = f" (the error that {LARGEST_SHARE:.0%} of all poses stay below)" if self.rule == "max" else ""
        return (
            f"A pass needs the one-sided 95 % upper bound of the {self.figure}{bound}, {self.basis}, and the tracker's "
            f"expanded uncertainty of {self.tracker_u95_mm:.3f} mm ({self.tracker_source}) within the tolerance "
            "(ISO 14253-1, JCGM 106), and a verdict that may be trusted."
        )

    def report(self) -> Sequence[Paragraph]:
        """Outcome, figures, what speaks against a pass, and the rule."""
        lines = [f"Tolerance: {self.outcome.upper()}. {self.sentence()}"]
        lines += [f"Against a pass: {reason}" for reason in self.against]
        return [*lines, f"Note: {self.rule_in_words()}"]

    def to_dict(self) -> dict[str, Any]:
        """What ``irbcal evaluate --tolerance --json`` prints."""
        names = ("outcome", "rule", "tolerance_mm", "value_mm", "upper_mm", "basis", "tracker_u95_mm", "tracker_source")
        return {
            **{name: getattr(self, name) for name in names},
            "poses": self.poses,
            "points": self.points,
            "region_only": self.region_only,
            "against": list(self.against),
        }


def check_options(
    tolerance: float | None, rule: str | None, tracker: float | None = None, region_only: bool = False
) -> Rule:
    """The rule that is meant; refuses a tolerance that is none, and what only it needs without one.

    Raises
    ------
    OptionError
    """
    if tolerance is None:
        for name, value in (("rule", rule), ("tracker_u95", tracker), ("region_only", region_only or None)):
            if value is not None:
                raise OptionError(f"{name}: only a tolerance needs it: give the tolerance, too", parameter=name)
        return "mean3sigma"
    if not 0.0 < length("tolerance", tolerance, 0.0) <= LARGEST:
        raise OptionError(
            f"tolerance: expected metres above 0 and at most {LARGEST:g} (half a millimetre is 0.0005), found "
            f"{tolerance:g}",
            parameter="tolerance",
        )
    if tracker is not None and not 0.0 <= length("tracker_u95", tracker, 0.0) <= LARGEST:
        raise OptionError(
            f"tracker_u95: expected metres from 0 to {LARGEST:g} (fifty micrometres are 0.00005), found {tracker:g}",
            parameter="tracker_u95",
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
    tracker: tuple[float, str] = (0.0, "as stated by the user"),
    region: Region | None = None,
    region_only: bool = False,
    simulated: bool = False,
    seed: int = 0,
) -> Conformity:
    """Judge errors by a tolerance.

    A pass needs the figure's upper bound and the tracker's uncertainty within the tolerance, and a trusted verdict:
    poses that the fit never saw, few points left out, no doubts, and a calibration that serves the robot.

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
    tracker : tuple of float and str
        Its expanded uncertainty, metres, and where that comes from.
    region : Region, optional
        Where the poses are.
    region_only : bool
        Judge for that region only; else it must cover the calibrated ranges.
    simulated : bool
    seed : int
        Of the bootstrap.
    """
    figure, key = FIGURES[rule]
    distance, limit = np.asarray(distance, dtype=float), tolerance / MM
    value, places, u95 = float(statistics[key]), len(np.unique(place)), tracker[0] / MM
    against = _against(verdict, places, None if region_only else region)
    upper, basis = None, f"of {bootstrap.FEWEST_POSES} places or more"
    if places >= bootstrap.FEWEST_POSES:
        bound, basis = upper_bound(rule, value * MM, distance, place)
        upper = bound / MM
        if value <= limit < upper + u95:
            against.append(
                f"The {figure} may be larger than it was on these poses: {upper + u95:.3f} mm with 95 % confidence "
                "and the tracker's uncertainty. Measure more poses: the bound comes nearer to the figure."
            )
    outcome: Outcome = "fail" if not value <= limit else "not proven" if against else "pass"
    return Conformity(
        outcome,
        rule,
        limit,
        value,
        upper,
        basis,
        u95,
        tracker[1],
        bootstrap.intervals(distance, place, seed=seed) or {},
        poses,
        len(distance),
        tuple(against),
        region_only,
        simulated,
    )


def _against(verdict: Verdict, places: int, region: Region | None) -> list[str]:
    """Why a figure within the tolerance would be no pass, in sentences."""
    out = list(verdict.doubts)
    if region is not None and not region.whole:
        out.append(
            f"Nothing is proven beyond the region of these poses: {region.narrow_in_words()}. Measure poses all over "
            "the calibrated ranges, or ask for a certificate of this region only (--region-only)."
        )
    if places < bootstrap.FEWEST_POSES:
        out.append(f"{places} places are too few to judge by: {bootstrap.FEWEST_POSES} are the least.")
    if verdict.outcome == "worse":
        out.append("The calibrated robot is WORSE than the nominal one on these poses.")
    if verdict.outcome == "no better":
        out.append("The calibrated robot is no better than the nominal one on these poses, beyond chance.")
    return out
