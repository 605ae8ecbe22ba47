"""What an identification by evidence gives: averaged terms, what is known of them, and predictions with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from irbcal.arrays import FloatArray, rms
from irbcal.identification.choices import Objective
from irbcal.identification.evidence_maximisation import (
    NormalEquations,
    Posterior,
    evidence_of_each,
    maximise_evidence,
)
from irbcal.identification.fit import nuisance_reports
from irbcal.identification.fit_sections import (
    AverageChoice,
    FamilyShown,
    ModelAverage,
    Observability,
    ParameterReport,
    TermSetResult,
    groups_table,
    models_table,
    sentence,
)
from irbcal.identification.term_sets import TermSet
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty, FitLimits
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.levels import Level
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import bases, chain
from irbcal.modeling.terms.gear import in_words
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM

COMPARED = 3000
"""Poses on which term sets are compared at most; those with weight are fitted to all."""


def families_shown(
    sums: NormalEquations, nuisance: int, families: Sequence[str], term_set: TermSet, t: float, start: Posterior
) -> tuple[FamilyShown, ...]:
    """Fit a term set, and again without each of its families; geometry is always there.

    Parameters
    ----------
    sums : NormalEquations
        Of the term set's columns.
    nuisance : int
        Columns of base and targets.
    families : sequence of str
        Family of each of the term set's terms.
    term_set : TermSet
    t : float
        Power of the likelihood.
    start : Posterior
        A fit with its groups, whose variances are the start.

    Returns
    -------
    tuple of FamilyShown
        In the order of the terms.
    """
    known = term_set.prior
    found = maximise_evidence(sums, nuisance, term_set.group, term_set.caps, t, start.variances, start.s2, prior=known)
    labels = [None if family == "geometry" else family for family in families]
    worth = evidence_of_each(sums, found, nuisance, labels, term_set.group, term_set.caps, known)
    return tuple(
        FamilyShown(family=name, determined=w.determined, evidence=w.evidence, moves_mm=w.moves / MM)
        for name, w in worth.items()
    )


@dataclass(frozen=True)
class TypePriorResult:
    """What a prior from calibrated robots of the same type did."""

    type: str
    count: int
    """Robots that it is from."""
    simulated: bool
    """Whether any of them is."""
    gain: float
    """Nats by which the best choice of terms with it has more evidence than the best one without."""
    weight: float
    """Of the choices with it."""
    chi2: float
    directions: int
    """Whether the robot is like them, see `irbcal.identification.term_sets`."""

    def in_words(self) -> str:
        """A sentence."""
        kind = "SIMULATED" if self.simulated else "calibrated"
        start = f"hat {self.count} {kind} robots of type {self.type} show"
        test = f"chi-square {self.chi2:.0f} on {self.directions} directions"
        if self.weight >= 0.5:
            return (
                f"W{start} was taken as a prior: this robot is like them ({test}), and the evidence is higher by "
                f"{self.gain:.0f} nats with it."
            )
        if self.weight > 0.0:
            return f"W{start} was taken as a prior with the weight {self.weight:.2f}: it hardly helps ({test})."
        why = test if self.gain > 0.0 else f"{test}; the evidence would be lower by {-self.gain:.0f} nats"
        return f"This robot stands out of its type: w{start} is not true of it ({why}). It was identified without."


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class EvidenceFit(Result):
    """An identified robot as the average of error models, with what the identification knows about itself.

    It has the names of `irbcal.identification.fit.Fit` that a saved calibration needs.

    Attributes
    ----------
    points : PointSet
        Those of the fit, in the measuring frame of the last session.
    motion : Motion
        Of their poses.
    nominal, arm : Arm
        Nominal arm, and the one with the constants in its DHM table.
    terms : tuple of Term
        Union of the term sets with weight, geometry first.
    coefficients : ndarray, shape (terms,)
        Averaged, in the terms' units.
    covariance : ndarray, shape (nuisance + terms, nuisance + terms)
        Of base (turn, shift in the base link), free targets, target frames and coefficients, SI units; scatter within
        and between term sets.
    T_world_base : ndarray, shape (4, 4)
    targets : dict of str to ndarray, shape (3,)
        In the tip link, metres.
    target_rotations : dict of str to ndarray, shape (3, 3)
        Of targets that were measured with an orientation.
    fitted_targets, oriented_targets : tuple of str
        Targets whose places, and frames, were identified: they have columns in the covariance.
    term_sets : tuple of TermSetResult
    average : ModelAverage
    usual_kg : float or None
        The one that predictions are for where none is given.
    other_bases : dict of str to ndarray, shape (4, 4)
        Base in the measuring frame of each session but the last one; behind the target frames in the covariance.
    type_prior : TypePriorResult or None
        What a prior of the robot's type did, where there was one.
    independent : bool
        Whether the points of a pose erred by themselves, see `irbcal.identification.independence`.
    outlier_distance : ndarray, shape (m,)
        How far outliers are from where all other points put them, metres; zero for good points.
    leverage_pose : (int, float) or None
        The pose that no other can check, and how far it is from where all others put it, metres; see
        `irbcal.identification.leave_one_out.leverage_pose`.
    level, method, objective : str
    value, lower_bound : float or None
        Of another objective than the root mean square, metres.
    least_squares, history : None
        What other ways to identify have.
    """

    nominal: Arm
    arm: Arm
    points: PointSet
    motion: Motion
    terms: tuple[Term, ...]
    coefficients: FloatArray
    covariance: FloatArray
    T_world_base: FloatArray
    targets: Mapping[str, FloatArray]
    fitted_targets: tuple[str, ...]
    oriented_targets: tuple[str, ...]
    target_rotations: Mapping[str, FloatArray]
    term_sets: tuple[TermSetResult, ...]
    average: ModelAverage
    usual_kg: float | None = None
    other_bases: Mapping[str, FloatArray] = field(default_factory=dict)
    type_prior: TypePriorResult | None = None
    independent: bool = False
    outlier_distance: FloatArray = field(default_factory=lambda: np.zeros(0))
    leverage_pose: tuple[int, float] | None = None
    level: Level | Literal["auto"] = "auto"
    method: Literal["evidence"] = "evidence"
    objective: Objective = "rms"
    value: float | None = None
    lower_bound: float | None = None
    least_squares: None = None
    history: None = None

    @cached_property
    def joint_ranges(self) -> FloatArray:
        """Smallest and largest joints of the fit, shape (2, joints), radians (metres)."""
        return np.array([self.motion.q.min(axis=0), self.motion.q.max(axis=0)])

    @property
    def loads(self) -> tuple[float, ...]:
        """Masses that were carried, kg; none where they were not given."""
        return tuple(np.unique(self.motion.inputs.get("payload_kg", ())).tolist())

    @cached_property
    def joint_map(self) -> JointMap:
        """The terms about the joints' own axes, of the warm arm with the usual load."""
        return JointMap(self.term_map().select(False), self.joint_ranges, self.usual_kg)

    @cached_property
    def robot(self) -> Robot:
        """The calibrated robot, warm, with a joint map of terms and, of terms ``all``, with frame terms."""
        frame_terms = self.term_map().select(True)
        return Robot(
            self.arm,
            self.joint_map,
            self.T_world_base,
            self.targets,
            self.target_rotations,
            self.certainty,
            frame_terms if frame_terms.terms else None,
        )

    def warmth(self, points: PointSet, elapsed: FloatArray) -> FloatArray | None:
        """By how much points lie elsewhere while the arm warms up.

        Parameters
        ----------
        points : PointSet
        elapsed : ndarray, shape (n,)
            When its poses were measured, as the fit's motion counts.

        Returns
        -------
        ndarray, shape (m, 3), or None
            Metres, in the measuring frame; None where there are no terms of warm-up.
        """
        if all(term.family != "warm_up" for term in self.terms):
            return None
        at_use = self.joint_map.motion(points.q, points.previous, **points.inputs)
        T = self.term_map(warm=False).forward(self.arm, replace(at_use, elapsed=elapsed))
        T_cold_warm = self.T_world_base @ (T - self.term_map().forward(self.arm, at_use))
        targets = np.array([self.targets[name] for name in points.target_names])[points.target]
        T_cold_warm = T_cold_warm[points.pose]
        return np.asarray(np.einsum("mij,mj->mi", T_cold_warm[:, :3, :3], targets) + T_cold_warm[:, :3, 3])

    @property
    def _nuisance(self) -> int:
        """Number of unknowns of base and targets."""
        return len(self.covariance) - len(self.terms)

    @property
    def _used(self) -> list[int]:
        """Terms that are left at use: all but the warm-up."""
        return [k for k, term in enumerate(self.terms) if term.family != "warm_up"]

    @property
    def rank(self) -> int:
        """Number of coefficients that the data determine, base and targets included, rounded."""
        return self._nuisance + round(sum(group.determined for group in self.average.groups if group.name != "warm_up"))

    @property
    def parameter_count(self) -> int:
        """Number of parameters, base and targets included, warm-up excluded."""
        return self._nuisance + len(self._used)

    @property
    def rms(self) -> float:
        """Root mean square distance of the fitted points from the warm robot, metres."""
        return rms(distances(self.robot, self.points))

    def undetermined(self) -> list[str]:
        """Nothing is held: what the data do not show stays near nominal, with the standard deviation it had before."""
        return []

    def parameters(self) -> list[ParameterReport]:
        """Base, targets, constants of the geometry and terms of the joint map with standard deviations."""
        bases = {"base": self.T_world_base} | {f"base@{name}": T for name, T in self.other_bases.items()}
        places = {name: self.targets[name] for name in self.fitted_targets}
        rotations = {name: self.target_rotations[name] for name in self.oriented_targets}
        rows = nuisance_reports(bases, places, rotations, self.covariance)
        std, constants = self.std, iter(self.constants())
        for k in self._used:
            name = next(constants) if self.terms[k].family == "geometry" else self.terms[k].name
            rows.append(ParameterReport.from_si(name, self.coefficients[k], self.terms[k].unit, std[k]))
        return rows

    @property
    def choice(self) -> AverageChoice:
        """Which error models were averaged."""
        return AverageChoice(level=self.level, table=self.term_sets, explanation=self.explanation())

    def observability(self) -> Observability:
        """How many directions are seen."""
        return Observability(singular_values_mm=[], determined=self.rank, indices={}, correlations=[])

    def lag(self) -> Lag | None:
        """How readings lag behind programmed joints, where they were found to; else None."""
        return lag(self, self.points, self.motion) if self.average.readings_lag else None

    def _readings_in_words(self) -> list[str]:
        if self.average.readings_gain is None:
            return []
        if self.average.readings_lag:
            return [
                "The readings were taken before the arm stood still: with a share of the last move free in each pose, "
                f"residuals fall {self.average.readings_gain:.1f} times. The model holds for programmed joints."
            ]
        return [
            "The readings were taken at rest: a free share of the last move makes residuals fall by a factor "
            f"{self.average.readings_gain:.2f} only."
        ]

    def explanation(self) -> str:
        """Why these error models, in two sentences."""
        rows = self.term_sets
        if self.level != "auto":
            return (
                f"The error parameters of model {self.level} were fitted, and no others; each family has the spread "
                "that the rows give it, so that what they leave open stays near nominal."
            )
        weighted = sorted((row for row in rows if row.weight > 0.0), key=lambda row: -row.weight)
        first = weighted[0]
        support = (
            f"Of {len(rows)} error models the evidence of these poses supports {first.name} ({first.weight:.0%}) most"
        )
        support += f", and with it {len(weighted) - 1} more" if len(weighted) > 1 else ""
        plain = rows[0]
        gain = first.log_evidence - plain.log_evidence
        warm = len(self._used) < len(self.terms)
        left = " The parameters leave out the warm-up's terms." if warm else ""
        better = "" if plain is first else f", here by {gain:.0f} nats better than {plain.name} alone"
        return (
            f"{support}. Their evidence says how well each predicts these measurements without knowing them{better}; "
            f"all with weight are averaged, because the best one alone is often best by accident.{left}"
        )

    def sentences(self) -> list[str]:
        """What a user should know of it: gears that were found, and where it is valid."""
        ends = (self.joint_ranges / self.nominal.joint_units).T
        listed = enumerate(zip(ends, self.nominal.joint_unit_names, strict=True), 1)
        ranges = ", ".join(f"joint {j} {low:.1f} to {high:.1f} {unit}" for j, ((low, high), unit) in listed)
        warm = []
        if self.average.warms_up:
            warm.append(
                f"The arm drifted as it warmed up, with a time constant of {self.average.warm_up_tau:.0f} poses: the "
                "calibration is that of the warm arm, so that the first poses miss it by more."
            )
        some = []
        if self.average.poses > COMPARED:
            some.append(
                f"Error models were compared on {COMPARED} of the {self.average.poses} poses, drawn at random; those "
                "that are averaged were fitted to all."
            )
        alone = []
        if self.independent:
            alone.append(
                "The points of a pose err by themselves, as noise does: each coordinate counts, and what is left is no "
                "error of the robot."
            )
        return [
            *([] if self.type_prior is None else [self.type_prior.in_words()]),
            sentence(self.average.families),
            *some,
            *alone,
            *self.gear_sentences(),
            *warm,
            *self._load_sentences(),
            f"Valid within the joint ranges of the fitted poses: {ranges}. Beyond them the joint map is extrapolated "
            "and must not be trusted.",
        ]

    def _load_sentences(self) -> list[str]:
        """What loads it is valid for."""
        loads = dict.fromkeys(
            quantity.note for term in self.terms for quantity in bases()[term.basis].inputs if quantity.note
        )
        if not self.loads:
            return [*loads]
        if len(self.loads) == 1:
            return [
                *loads,
                f"All poses were measured with a payload of {self.loads[0]:g} kg: the calibration is that of the "
                "robot with this load; the effect of another load is not known.",
            ]
        some = ", ".join(f"{load:g}" for load in self.loads)
        return [
            *loads,
            f"Measured with payloads of {some} kg: where no payload is given, predictions and corrections are for "
            f"{self.usual_kg:g} kg, which most poses were measured with (of all loads, if as many); other loads: "
            "--payload.",
        ]

    def report(self) -> Sequence[Paragraph]:
        """The models that were averaged, what the data show of each group of terms, and gears in words."""
        headline = (
            f"{self.nominal.name}, model {self.level} of terms {self.average.terms}: {self.rank} of "
            f"{self.parameter_count} parameters determined by {self.average.poses} poses "
            f"(fitted rms {self.rms / MM:.3f} mm)"
        )
        return (
            headline,
            self.explanation(),
            models_table(self.term_sets),
            groups_table(self.average.groups),
            *self._readings_in_words(),
            *self.sentences(),
        )

    ROWS, COLUMNS = "parameters", "name value unit std low high state reason"

    @property
    def std(self) -> FloatArray:
        """Standard deviations of the coefficients, shape (terms,), in the terms' units."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance)[self._nuisance :], 0.0))

    def term_map(self, warm: bool = True) -> TermMap:
        """All terms but the constants: of the warm arm, or with the warm-up terms, which are zero at use."""
        rows = [
            k
            for k, term in enumerate(self.terms)
            if term.family != "geometry" and not (warm and term.family == "warm_up")
        ]
        return TermMap(self.nominal, tuple(self.terms[k] for k in rows), self.coefficients[rows], self.std[rows])

    def constants(self) -> dict[str, tuple[float, float]]:
        """Constants of the geometry by their names in the DHM table with standard deviations, rad and m."""
        return {
            f"delta_{DHM_COLUMNS[term.axis]}{term.joint + 1}": (float(value), float(std))
            for term, value, std in zip(self.terms, self.coefficients, self.std, strict=True)
            if term.family == "geometry"
        }

    def gear_sentences(self) -> list[str]:
        """What the scan found, in words."""
        return [
            f"A wave stands out (chi2 {gear.chi2:.0f}): "
            f"{in_words(gear.joint, gear.cycles_per_turn, gear.amplitude_deg)}."
            for gear in self.average.gears
        ]

    @cached_property
    def certainty(self) -> Certainty:
        """What is known of the robot, the warm-up left out."""
        used, nuisance = self._used, self._nuisance
        rows = np.concatenate([np.arange(nuisance), nuisance + np.array(used, dtype=int)])
        return Certainty(
            nominal=self.nominal,
            terms=tuple(self.terms[k] for k in used),
            covariance=self.covariance[np.ix_(rows, rows)],
            fitted_targets=self.fitted_targets,
            coefficients=self.coefficients[used],
            limits=FitLimits(
                leave_one_out_mm=self.average.leave_one_out_mm,
                leave_fifths_out_mm=self.average.leave_fifths_out_mm,
                ranges=self.joint_ranges.tolist(),
                measurement_noise_mm=self.points.distance_noise() / MM,
            ),
        )


def _mm(length: float | None) -> float | None:
    return None if length is None else length / MM


RIDGE = 1e-3
"""Ridge of the regression, relative to features of unit root mean square."""
SHORTEST = 0.1 * DEG
"""Largest joint's move below which nothing lags, radians."""


@dataclass(frozen=True, eq=False, repr=False)
class Lag(Result):
    """Share of the last move by which readings lag behind the programmed joints."""

    weights: FloatArray
    """Shape (features,). Of `features`, whose root mean squares are ``scale``."""
    scale: FloatArray
    """Shape (features,)."""
    shares: FloatArray
    """Shape (n,). Found in the poses of the fit."""
    sigma: float
    """Standard deviation of what the regression leaves of them."""

    def report(self) -> Sequence[Paragraph]:
        """How much readings lag, and how well that is known."""
        return (
            f"readings lag behind the programmed joints by {np.median(self.shares):.2e} of the last move in the median "
            f"of {len(self.shares)} poses; known within {self.sigma:.1e} of a move",
        )

    def share(self, fit: EvidenceFit, motion: Motion) -> FloatArray:
        """Expected share for other readings with their last moves, shape (n,)."""
        return (features(fit, motion) / self.scale) @ self.weights

    def programmed(self, fit: EvidenceFit, motion: Motion) -> FloatArray:
        """Programmed joints that belong to readings, shape (n, joints)."""
        return motion.q + self.share(fit, motion)[:, None] * motion.moves


def features(fit: EvidenceFit, motion: Motion) -> FloatArray:
    """What a share may depend on: 1, 1/m, 1/L, L/m^2, |D_j|/m^2 and D_j^2/m^3.

    m is the largest joint's move and L the tool's path: times m, the angle by which the leading joint lags, they
    say how far it went, how the other joints went beside it, and how far the tool went with it.

    Returns
    -------
    ndarray, shape (n, 4 + 2 joints)
        Zero rows for stops without a move.
    """
    size = np.abs(motion.moves)
    m = size.max(axis=1)
    there = chain.poses(chain.walk(fit.arm, motion.q))
    before = chain.poses(chain.walk(fit.arm, motion.q - motion.moves))
    place = np.append(next(iter(fit.targets.values())), 1.0)
    L = np.linalg.norm((there - before)[:, :3] @ place, axis=1)
    moved = m > SHORTEST
    m, L = np.where(moved, m, 1.0), np.where(moved, np.maximum(L, 1e-3), 1.0)
    beside = size / m[:, None]
    out = np.column_stack([m, np.ones(len(m)), m / L, L / m, beside, beside * beside]) / m[:, None]
    return np.where(moved[:, None], out, 0.0)


def shares(fit: EvidenceFit, points: PointSet, motion: Motion) -> FloatArray:
    """Share of the last move that explains each pose's points best, shape (n,).

    Parameters
    ----------
    fit : EvidenceFit
        Identified from readings with the last move projected out.
    points : PointSet
    motion : Motion
        Readings and last moves of the points' poses.
    """
    term_map = fit.term_map(warm=False)
    pose = points.pose
    local = np.array([fit.targets[name] for name in points.target_names])[points.target].T
    path = chain.walk(fit.arm, *term_map.split(motion)).select(pose)
    p = path.tip[3] + np.einsum("acm,am->cm", path.tip[:3], local)
    R, t = fit.T_world_base[:3, :3], fit.T_world_base[:3, 3]
    e = ((points.xyz - t) @ R).T - p
    d = np.einsum("jcm,jm->cm", chain.by_joints(path, fit.arm, p), motion.moves[pose].T)
    above = np.bincount(pose, (d * e).sum(axis=0), points.poses)
    below = np.bincount(pose, (d * d).sum(axis=0), points.poses)
    return np.where(below > 0.0, above / np.where(below > 0.0, below, 1.0), 0.0)


def lag(fit: EvidenceFit, points: PointSet, motion: Motion) -> Lag:
    """Regress the shares of the poses of a fit, by ridge; parameters as `shares`."""
    share_of_joint = shares(fit, points, motion)
    X = features(fit, motion)
    scale = np.sqrt(np.mean(X * X, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    # each share is known as well as the move is long: weigh by the largest joint's move
    w = np.abs(motion.moves).max(axis=1)
    A = X / scale * w[:, None]
    weights = np.linalg.solve(
        A.T @ A + RIDGE * np.trace(A.T @ A) / len(scale) * np.eye(len(scale)), A.T @ (w * share_of_joint)
    )
    left = share_of_joint - (X / scale) @ weights
    return Lag(weights, scale, share_of_joint, float(np.sqrt(np.average(left**2, weights=w**2))))
