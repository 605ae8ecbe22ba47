"""Whether a calibrated robot keeps a tolerance, and in which region.

A pass needs the one-sided 95 % upper bound of the figure and the tracker's expanded uncertainty within the tolerance
(decision rules of ISO 14253-1:2017 and JCGM 106:2012); a figure beyond the tolerance is a fail; all else is not proven.

What is proven in a corner of the workspace says little about the rest: on 12 SIMULATED robots (four arms, 60 fitted
poses) mean + 3 sigma over all calibrated ranges was up to 4.0 times that of poses in a tenth of each joint's range, 2.6
times in a quarter, 1.7 in a half and 1.5 in six tenths (the 90th percentiles are 2.9, 1.9, 1.45 and 1.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, consecutive
from irbcal.distributions import student_within
from irbcal.errors import OptionError
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.workspace_coverage import even_width
from irbcal.option_values import checked, number
from irbcal.summary import Content, Paragraph, Remark, Result, remarks
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.verdict import Verdict

Rule: TypeAlias = Literal["mean3sigma", "max", "percentile"]
RULES: tuple[Rule, ...] = get_args(Rule)

RISK = 0.05
"""Probability with which an upper bound may be too small."""
LARGEST_SHARE = 0.99
"""Share of all poses that must stay below what is called the largest error: no sample bounds that of all poses."""
SHARES = {"percentile": 0.95, "max": LARGEST_SHARE}
"""Share of the poses that each rule's figure must cover."""
EXPONENTIAL = 1.25
"""Relative standard error of mean + 3 sigma of n values of an exponential distribution, times the root of n (its
fourth standardised moment is 9: 25 / n is the variance of a figure of 4)."""

ASSUMED_U95 = 0.05 * MM
"""Expanded uncertainty where none is declared, metres: the permissible error of a usual laser tracker at 5 m."""

DISTRIBUTION_FREE = "order statistics, whatever the distribution"
MODEL = "under tails no heavier than an exponential distribution's"


ConformityOutcome: TypeAlias = Literal["pass", "fail", "not proven"]

FIGURES: Mapping[Rule, tuple[str, str]] = {
    "mean3sigma": ("mean + 3 sigma of the position errors", "mean_plus_3sigma_mm"),
    "max": ("largest position error", "max_mm"),
    "percentile": ("95th percentile of the position errors", "p95_mm"),
}
"""What each rule compares with the tolerance: in words, and its name among the statistics."""

SMALLEST, LARGEST = 1e-6, 0.1
"""The smallest tolerance, and the largest tolerance and uncertainty, metres: beyond, millimetres were meant."""


@dataclass(frozen=True, eq=False, repr=False)
class Conformity(Result):
    """Whether the calibrated robot keeps a tolerance."""

    outcome: ConformityOutcome
    """``pass``, ``fail`` (the figure is beyond the tolerance), or ``not proven``."""
    rule: Rule
    """``mean3sigma``, ``max`` or ``percentile`` (the 95th)."""
    tolerance_mm: float
    value_mm: float | None
    """None for mean + 3 sigma of one point."""
    upper_mm: float | None
    """One-sided 95 % upper bound of the value; None where poses are too few."""
    basis: str
    """What the bound rests on."""
    tracker_u95_mm: float
    """Expanded uncertainty of the tracker, which is added to the bound."""
    tracker_source: str
    """Where it comes from."""
    intervals_mm: Mapping[str, Sequence[float]]
    """95 % bootstrap intervals of the statistics by their names; empty where poses are too few."""
    poses: int
    points: int
    """What was judged."""
    against: tuple[str, ...]
    """Why it is not proven, in sentences."""
    region_only: bool
    """Whether it is judged for the region of these poses only."""
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
                f"; with 95 % confidence at most {self.upper_mm:.3f} mm, and {self.limit_mm:.3f} mm with "
                f"the tracker's {self.tracker_u95_mm:.3f} mm"
            )
        kind = "SIMULATED " if self.simulated else ""
        where = " This holds for the region of these poses only." if self.region_only else ""
        value = "unknown" if self.value_mm is None else f"{self.value_mm:.3f} mm{bound}"
        return (
            f"The {self.figure} is {value}. The tolerance is {self.tolerance_mm:.3f} mm. Judged "
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
        outcome = Remark("Tolerance", f"{self.outcome.upper()}. {self.sentence()}", bool(self))
        against = remarks("Against a pass", self.against, good=False)
        return [outcome, *against, Remark("Note", self.rule_in_words())]

    CONTENT = (
        "outcome rule tolerance_mm value_mm upper_mm basis tracker_u95_mm tracker_source poses points region_only "
        "against"
    )


@dataclass(frozen=True)
class Requirement:
    """What a calibrated robot must keep."""

    tolerance: float
    """Metres."""
    rule: Rule = "mean3sigma"
    """What must be within it."""
    tracker_u95: float | None = None
    """Expanded uncertainty of a measured position, metres, as the user states it."""
    region_only: bool = False
    """Judge for the region of the poses only; else they must cover the calibrated ranges."""


def requirement(
    tolerance: float | None, rule: str | None = None, tracker_u95: float | None = None, region_only: bool = False
) -> Requirement | None:
    """What these options ask for, checked; None without a tolerance.

    Raises
    ------
    OptionError
        If a tolerance or an uncertainty is none, or if there are options that only a tolerance needs.
    """
    if tolerance is None:
        for name, value in (("rule", rule), ("tracker_u95", tracker_u95), ("region_only", region_only or None)):
            if value is not None:
                raise OptionError(f"{name}: only a tolerance needs it: give the tolerance, too", parameter=name)
        return None
    number("tolerance", tolerance, SMALLEST, LARGEST, example="metres: half a millimetre is 0.0005")
    if tracker_u95 is not None:
        number("tracker_u95", tracker_u95, 0.0, LARGEST, example="metres: fifty micrometres are 0.00005")
    return Requirement(tolerance, checked("rule", rule or "mean3sigma", RULES), tracker_u95, region_only)


def conformity(
    required: Requirement,
    statistics: Mapping[str, float | None],
    distance: ArrayLike,
    place: IntArray,
    verdict: Verdict,
    *,
    poses: int,
    declared_u95: ArrayLike | None = None,
    region: Region | None = None,
    simulated: bool = False,
    seed: int = 0,
) -> Conformity:
    """Judge errors by a tolerance.

    A pass needs the figure's upper bound and the tracker's uncertainty within the tolerance, and a trusted verdict:
    poses that the fit never saw, few points left out, no doubts, and a calibration that serves the robot.

    Parameters
    ----------
    required : Requirement
    statistics : dict
        Statistics and percentiles of the calibrated robot's errors, mm.
    distance : array_like, shape (m,)
        These errors, metres.
    place : ndarray of int, shape (m,)
        Place of each: repeats of one place are drawn together.
    verdict : Verdict
        Of the same errors.
    poses : int
        How many there are.
    declared_u95 : array_like, shape (m,), optional
        Expanded uncertainty that the measurements declare of each point, metres.
    region : Region, optional
        Where the poses are.
    simulated : bool
    seed : int
        Of the bootstrap.
    """
    figure, key = FIGURES[required.rule]
    distance = np.asarray(distance)
    value, limit = statistics[key], required.tolerance / MM
    u95, source = expanded_uncertainty(declared_u95, required.tracker_u95)
    against = _against(verdict, region if not required.region_only else None)
    places, fewest = int(consecutive(place).max(initial=-1)) + 1, accuracy.FEWEST_POSES_FOR_INTERVALS
    if value is None or places < fewest:
        upper, basis = None, f"of {fewest} places or more"
        against.append(f"{places} places are too few to judge by: {fewest} are the least.")
    else:
        bound, basis = upper_bound(required.rule, value * MM, distance, place)
        upper = bound / MM
        with_tracker = upper + u95 / MM
        if value <= limit < with_tracker:
            against.append(
                f"The {figure} may be larger than it was on these poses: {with_tracker:.3f} mm with 95 % confidence "
                "and the tracker's uncertainty. Measure more poses: the bound comes nearer to the figure."
            )
    outcome: ConformityOutcome = "not proven" if against else "pass"
    if value is not None and not value <= limit:
        outcome = "fail"
    return Conformity(
        outcome,
        required.rule,
        limit,
        value,
        upper,
        basis,
        u95 / MM,
        source,
        accuracy.intervals(distance, place, seed=seed) or {},
        poses,
        len(distance),
        tuple(against),
        required.region_only,
        simulated,
    )


def _against(verdict: Verdict, region: Region | None) -> list[str]:
    """Why a figure within the tolerance would be no pass, in sentences."""
    out = list(verdict.doubts)
    if region is not None and not region.complete:
        out.append(
            f"Nothing is proven beyond the region of these poses: {region.narrow_in_words()}. Measure poses all over "
            "the calibrated ranges, or ask for a certificate of this region only (--region-only)."
        )
    if verdict.outcome == "worse":
        out.append("The calibrated robot is WORSE than the nominal one on these poses.")
    if verdict.outcome == "no better":
        out.append("The calibrated robot is no better than the nominal one on these poses, beyond chance.")
    return out


def upper_bound(rule: Rule, figure: float, distance: ArrayLike, cluster: IntArray) -> tuple[float, str]:
    """Bound that the figure of all such poses exceeds with a probability of `RISK` at most.

    Percentiles and the largest error are bounded by order statistics, without any assumption, where there are enough
    places for that (Wilks 1941): 59 for the 95th percentile, 299 for the share that `LARGEST_SHARE` asks for. With
    fewer places, and for mean + 3 sigma, one model holds: tails no heavier than an exponential distribution's (the
    hazard rate's average does not decrease; Barlow and Proschan 1975, "Statistical Theory of Reliability and Life
    Testing", section 4.2). Then the order statistic is extrapolated along an exponential tail, and the standard error
    of mean + 3 sigma is taken as that of an exponential distribution, the largest of these. ``scripts/false_pass``
    counts how often the bounds are too small.

    Parameters
    ----------
    rule : {"mean3sigma", "max", "percentile"}
    figure : float
        Of the errors, metres.
    distance : array_like, shape (m,)
        Errors, metres.
    cluster : ndarray of int, shape (m,)
        Place of each, at which the robot was measured several times or by several targets: errors of one place count
        together, by the largest of them for percentiles.

    Returns
    -------
    bound : float
        Metres, never below the figure.
    basis : str
        What the bound rests on, in words.
    """
    number = consecutive(cluster)
    n = int(number.max()) + 1
    if rule == "mean3sigma":
        relative = student_within(1.0 - 2.0 * RISK, n - 1) * EXPONENTIAL / math.sqrt(n)
        return figure * math.exp(relative), MODEL
    worst = np.zeros(n)
    np.maximum.at(worst, number, np.asarray(distance, dtype=float))
    worst.sort()
    share = SHARES[rule]
    rank = _rank(n, share)
    if rank:
        return max(figure, float(worst[-rank])), DISTRIBUTION_FREE
    beyond = 1.0 - RISK ** (1.0 / n)  # with this confidence no larger share of all poses exceeds the largest
    return float(worst[-1]) * math.log(1.0 - share) / math.log(beyond), MODEL


def _rank(n: int, share: float) -> int:
    """Which of n values, from the largest on, exceeds a share of all with a probability of 1 - `RISK`; 0 for none."""
    from scipy.special import bdtr

    return int((bdtr(np.arange(n), n, 1.0 - share) <= RISK).sum())


def expanded_uncertainty(declared: ArrayLike | None, stated: float | None) -> tuple[float, str]:
    """Expanded uncertainty of a measured position, metres, and where it comes from, in words.

    Parameters
    ----------
    declared : array_like, shape (m,), or None
        What the measurements declare of each point, metres, NaN where they do not: the largest counts.
    stated : float or None
        What the user states, metres; it counts before what is declared.
    """
    if stated is not None:
        return stated, "as stated by the user"
    values = np.asarray([] if declared is None else declared, dtype=float)
    if np.isfinite(values).any():
        return float(np.nanmax(values)), "the largest u95_mm of the measurements"
    return ASSUMED_U95, "assumed for a laser tracker at 5 m, for none was declared"


LEAST_COVERAGE = 0.6
"""Share of each calibrated range that proof poses must cover to prove anything of the rest."""


@dataclass(frozen=True, eq=False)
class Region(Content):
    """Where proof poses are."""

    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    """Units are ``deg`` or ``mm``."""
    joints: FloatArray
    """Shape (2, joints). Smallest and largest joints of the poses, in these units."""
    box: FloatArray
    """Shape (2, 3). Smallest and largest coordinates of the measured points in the base link, mm."""
    joint_shares: FloatArray | None
    box_shares: FloatArray | None
    """Shapes (joints,) and (3,). Of the calibrated ranges; None where these are not known. That of a joint is the even
    width, see `irbcal.modeling.workspace_coverage.even_width`.
    """

    @property
    def complete(self) -> bool:
        """Whether each calibrated range is covered to `LEAST_COVERAGE` or more."""
        if self.joint_shares is None or self.box_shares is None:
            return False
        return bool(min(self.joint_shares.min(), self.box_shares.min()) >= LEAST_COVERAGE)

    CONTENT = "joints=by_joint box_mm=box_ends_mm least_share=LEAST_SHARE joint_shares box_shares complete"
    LEAST_SHARE = LEAST_COVERAGE

    def by_joint(self) -> dict[str, dict[str, Any]]:
        """Unit and range of each joint."""
        ranges = zip(self.joint_names, self.joint_units, self.joints.T, strict=True)
        return {name: {"unit": unit, "range": ends} for name, unit, ends in ranges}

    def box_ends_mm(self) -> dict[str, FloatArray]:
        """Range of each coordinate, mm."""
        return dict(zip("xyz", self.box.T, strict=True))

    def joints_in_words(self) -> str:
        """Range of each joint, and its share of the calibrated one."""
        return _ranges(self.joint_names, self.joints, self.joint_units, self.joint_shares)

    def box_in_words(self) -> str:
        """The box, and its share of the calibrated one along each axis."""
        return _ranges(("x", "y", "z"), self.box, ("mm",) * 3, self.box_shares)

    def narrow_in_words(self) -> str:
        """What the poses cover too little of, or that this is not known; an empty text where they cover all."""
        if self.joint_shares is None or self.box_shares is None:
            return "the calibrated ranges are not known"
        names = (*self.joint_names, *(f"{axis} in the base" for axis in "xyz"))
        shares = np.concatenate([self.joint_shares, self.box_shares])
        narrow = [f"{share:.0%} of {name}" for name, share in zip(names, shares, strict=True) if share < LEAST_COVERAGE]
        return (
            f"they cover {', '.join(narrow)} as calibrated, where {LEAST_COVERAGE:.0%} of each are needed"
            if narrow
            else ""
        )


def region(robot: Robot, points: PointSet, fit: PointSet | None) -> Region:
    """The region of proof poses.

    Parameters
    ----------
    robot : Robot
        The calibrated one: its base link carries the box.
    points : PointSet
        Of the proof, in the robot's measuring frame.
    fit : PointSet or None
        Fitted points; None where they are not known.
    """
    arm, T_base_world = robot.arm, frames.inverse(robot.T_world_base)
    box = _extent(frames.apply(T_base_world, points.xyz))
    shares: tuple[FloatArray | None, FloatArray | None] = None, None
    if fit is not None and fit.poses:
        fitted_box = _extent(frames.apply(T_base_world, fit.xyz))
        inside = np.clip(box, *fitted_box)
        shares = _share(even_width(points.q, _extent(fit.q)), _extent(fit.q)), _share(inside[1] - inside[0], fitted_box)
    joints = _extent(points.q) / arm.joint_units
    return Region(tuple(arm.joint_names), arm.joint_unit_names, joints, box / MM, *shares)


def _extent(rows: FloatArray) -> FloatArray:
    return np.array([rows.min(axis=0), rows.max(axis=0)])


def _share(width: FloatArray, of: FloatArray) -> FloatArray:
    """Shares of ranges; all of a range that has no width."""
    extent = of[1] - of[0]
    return np.where(extent > 0.0, width / np.where(extent > 0.0, extent, 1.0), 1.0)


def _ranges(names: tuple[str, ...], ends: FloatArray, units: tuple[str, ...], shares: FloatArray | None) -> str:
    out = []
    for k, name in enumerate(names):
        share = "" if shares is None else f" ({shares[k]:.0%})"
        out.append(f"{name} {ends[0, k]:.0f} to {ends[1, k]:.0f} {units[k]}{share}")
    return ", ".join(out)
