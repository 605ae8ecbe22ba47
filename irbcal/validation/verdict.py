"""The verdict on a calibration: better than the nominal robot or not, and whether it keeps a tolerance.

A pass needs the one-sided 95 % upper bound of the figure and the tracker's expanded uncertainty within the tolerance
(decision rules of ISO 14253-1:2017 and JCGM 106:2012); a figure beyond the tolerance is a fail; all else is not proven.

What is proven in a corner of the workspace says little about the rest: on 12 SIMULATED robots (four arms, 60 fitted
poses) mean + 3 sigma over all calibrated ranges was up to 4.0 times that of poses in a tenth of each joint's range, 2.6
times in a quarter, 1.7 in a half and 1.5 in six tenths (the 90th percentiles are 2.9, 1.9, 1.45 and 1.3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, Locked, plain
from irbcal.errors import OptionError
from irbcal.io.schema import FeaturesSection, Record
from irbcal.measurement.cleaning import LeftOut
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.elsewhere import even_width
from irbcal.modeling.robot import Robot
from irbcal.options import checked, length
from irbcal.statistics import consecutive
from irbcal.summary import Paragraph, Result, values
from irbcal.units import MM
from irbcal.validation import accuracy

Outcome = Literal["better", "no better", "worse"]
MOST_LEFT_OUT = 0.15
"""Share of the points left out above which it is part of the verdict."""
NOT_COUNTED = ("lost", "target unknown to the calibration", "wrong reference")
"""Reasons of points that were not there to be used."""
NO_PROOF = "Poses {basis} are no proof of accuracy: measure others, or hold some out of the fit."
LEFT_OUT = "{share:.0%} of the measured points were left out, which may be the rule."
CLEAR = 2.0
"""Standard errors of the difference, pose by pose, beyond which one model is called better."""


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """Whether a calibration serves these measurements.

    Attributes
    ----------
    outcome : str
        ``better``, ``no better`` or ``worse`` than the nominal robot.
    words : str
        One or two sentences.
    left_out : float
        Share of the points that were left out.
    trusted : bool
        Whether nothing speaks against it: better, few points were left out, and there are no doubts.
    doubts : tuple of str
        All that speaks against it besides the outcome, in sentences.
    """

    outcome: Outcome
    words: str
    left_out: float
    trusted: bool
    doubts: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.trusted

    CONTENT = "outcome words left_out trusted doubts"

    def report(self) -> Sequence[Paragraph]:
        """The words, and what speaks against it."""
        return [f"Verdict: {self.sentence()}", *(f"Doubt: {doubt}" for doubt in self.doubts)]

    def sentence(self) -> str:
        """The words, and that it must not be trusted where that does not follow from them."""
        if self.outcome == "better" and not self.trusted:
            return f"NOT TO BE TRUSTED, though {self.words}"
        return self.words[0].upper() + self.words[1:]


def verdict(
    nominal: ArrayLike,
    calibrated: ArrayLike,
    pose: ArrayLike,
    left_out: int = 0,
    proven: bool = True,
    doubts: Sequence[str] = (),
    used: int | None = None,
    basis: str = "",
) -> Verdict:
    """Judge errors of the same points under both models, pose by pose.

    Parameters
    ----------
    nominal, calibrated : array_like, shape (m,)
        Errors, mm.
    pose : array_like, shape (m,)
        Pose of each point: any labels.
    left_out : int
        Points that were measured, but left out.
    proven : bool
        Whether the fit never saw these poses.
    doubts : sequence of str
        What else speaks against the calibration.
    used : int, optional
        Points that were used in all; m unless given.
    basis : str
        What poses these are, in words that follow "poses"; by default that the fit saw them, or never did.
    """
    a, b = np.asarray(nominal), np.asarray(calibrated)
    gain, labels = a - b, np.asarray(pose)
    if labels.dtype.kind not in "iu" or not (labels[1:] > labels[:-1]).all():  # else a pose has one point
        number = consecutive(labels)
        gain = np.bincount(number, gain) / np.bincount(number)
    n = len(gain)
    error = float(gain.std(ddof=1, dtype=float) / np.sqrt(n)) if n > 1 else np.inf
    mean = float(gain.mean(dtype=float))
    outcome: Outcome = "better" if mean > CLEAR * error else "worse" if mean < -CLEAR * error else "no better"
    means = [float(errors.mean(dtype=float)) for errors in (a, b)]
    figures = f"mean {means[1]:.3f} mm against {means[0]:.3f} mm, largest {b.max():.3f} against {a.max():.3f} mm"
    poses = f"{n} pose{'s' if n > 1 else ''}"
    on = f"{poses} {basis or ('that the fit never saw' if proven else 'that were fitted, which proves nothing')}"
    text = {
        "better": f"better than the nominal robot on {on} ({figures}).",
        "no better": f"NO BETTER than the nominal robot on {on}, beyond chance ({figures}).",
        "worse": f"WORSE than the nominal robot on {on} ({figures}). Is it this robot's calibration, with this tool, "
        "and are these poses like those of the fit? Do not correct programs with it.",
    }[outcome]
    if np.array_equal(a, b):
        text = f"the nominal robot itself, its base and targets identified, on {on}: mean {means[1]:.3f} mm, largest "
        text += f"{b.max():.3f} mm."
    share = left_out / (left_out + (len(a) if used is None else used))
    if share > MOST_LEFT_OUT:
        text += (
            f" {share:.0%} of the points were left out: this is the verdict on the rest only, and what was left out "
            "may be the rule. See why each was."
        )
    against = [] if proven else [NO_PROOF.format(basis=basis or "that were fitted")]
    against += [LEFT_OUT.format(share=share)] if share > MOST_LEFT_OUT else []
    reasons = (*doubts, *(reason for reason in against if reason not in doubts))
    return Verdict(outcome, text, float(share), outcome == "better" and not reasons, reasons)


def verdict_of(record: Record) -> Verdict:
    """The verdict on a calibration by its own held-out poses; by the fitted ones, where nothing was held out."""
    p = record.points
    heldout = np.array(p.heldout, dtype=bool)
    proven = bool(heldout.any())
    rows = heldout == proven
    pose = np.array(p.row if p.row else p.pose)[rows]
    nominal, calibrated = (np.array(column)[rows] for column in (p.nominal_mm, p.calibrated_mm))
    if record.model == "nominal":
        calibrated = nominal
    warning = record.certainty.warning()
    doubts = [*record.doubts, *([warning] if warning and warning not in record.doubts else [])]
    result = verdict(nominal, calibrated, pose, counted(record.excluded), proven, doubts, len(heldout))
    return (
        result if record.features is None else replace(result, words=f"{result.words} {_at_features(record.features)}")
    )


def _at_features(section: FeaturesSection) -> str:
    """What errors at features mean."""
    turn = f"Each {'set' if section.left_out == 'features' else section.left_out} was left out of the fit in turn. "
    return (
        f"{turn if section.left_out else ''}These are distances of rows from features whose own places are fitted: "
        "how well the robot agrees with itself, not its accuracy in a measuring frame."
    )


def counted(excluded: Sequence[LeftOut]) -> int:
    """How many points were left out though they were measured and known."""
    return sum(not point.reason.startswith(NOT_COUNTED) for point in excluded)


LEAST = 0.6
"""Share of each calibrated range that proof poses must cover to prove anything of the rest."""


@dataclass(frozen=True, eq=False)
class Region(Locked):
    """Where proof poses are.

    Attributes
    ----------
    joint_names, joint_units : tuple of str
        Units are ``deg`` or ``mm``.
    joints : ndarray, shape (2, joints)
        Smallest and largest joints of the poses, in these units.
    box : ndarray, shape (2, 3)
        Smallest and largest coordinates of the measured points in the base link, mm.
    joint_shares, box_shares : ndarray, shape (joints,) and (3,), or None
        Of the calibrated ranges; None where these are not known. That of a joint is the even width, see
        `irbcal.modeling.elsewhere.even_width`.
    """

    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    joints: FloatArray
    box: FloatArray
    joint_shares: FloatArray | None
    box_shares: FloatArray | None

    @property
    def whole(self) -> bool:
        """Whether each calibrated range is covered to `LEAST` or more."""
        if self.joint_shares is None or self.box_shares is None:
            return False
        return bool(min(self.joint_shares.min(), self.box_shares.min()) >= LEAST)

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
        narrow = [f"{share:.0%} of {name}" for name, share in zip(names, shares, strict=True) if share < LEAST]
        return f"they cover {', '.join(narrow)} as calibrated, where {LEAST:.0%} of each are needed" if narrow else ""

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        ranges = zip(self.joint_names, self.joint_units, self.joints.T, strict=True)
        joints = {name: {"unit": unit, "range": ends} for name, unit, ends in ranges}
        content = {"joints": joints, "box_mm": dict(zip("xyz", self.box.T, strict=True)), "least_share": LEAST}
        out: dict[str, Any] = plain(content | values(self, "joint_shares box_shares whole"))
        return out


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
    units = tuple("mm" if slides else "deg" for slides in arm.table.prismatic)
    return Region(tuple(arm.joint_names), units, _extent(points.q) / arm.joint_units, box / MM, *shares)


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
    from scipy.special import stdtrit

    number = consecutive(cluster)
    n = int(number.max()) + 1
    if rule == "mean3sigma":
        relative = float(stdtrit(n - 1, 1.0 - RISK)) * EXPONENTIAL / math.sqrt(n)
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


ConformityOutcome: TypeAlias = Literal["pass", "fail", "not proven"]

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

    outcome: ConformityOutcome
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

    CONTENT = (
        "outcome rule tolerance_mm value_mm upper_mm basis tracker_u95_mm tracker_source poses points region_only "
        "against"
    )


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
    distance, limit = np.asarray(distance), tolerance / MM
    value, places, u95 = float(statistics[key]), int(consecutive(place).max(initial=-1)) + 1, tracker[0] / MM
    against = _against(verdict, places, None if region_only else region)
    upper, basis = None, f"of {accuracy.FEWEST_POSES} places or more"
    if places >= accuracy.FEWEST_POSES:
        bound, basis = upper_bound(rule, value * MM, distance, place)
        upper = bound / MM
        if value <= limit < upper + u95:
            against.append(
                f"The {figure} may be larger than it was on these poses: {upper + u95:.3f} mm with 95 % confidence "
                "and the tracker's uncertainty. Measure more poses: the bound comes nearer to the figure."
            )
    outcome: ConformityOutcome = "fail" if not value <= limit else "not proven" if against else "pass"
    return Conformity(
        outcome,
        rule,
        limit,
        value,
        upper,
        basis,
        u95,
        tracker[1],
        accuracy.intervals(distance, place, seed=seed) or {},
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
    if places < accuracy.FEWEST_POSES:
        out.append(f"{places} places are too few to judge by: {accuracy.FEWEST_POSES} are the least.")
    if verdict.outcome == "worse":
        out.append("The calibrated robot is WORSE than the nominal one on these poses.")
    if verdict.outcome == "no better":
        out.append("The calibrated robot is no better than the nominal one on these poses, beyond chance.")
    return out
