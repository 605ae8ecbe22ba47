"""Identification by evidence: many term sets, each with its prior variances from the data, averaged.

The largest model that data support is not chosen but weighed: every term set is fitted in one linearisation about the
geometry solution, and coefficients, base and targets are averaged with weights from the log evidence. What the data do
not show shrinks to nothing and keeps its prior's standard deviation. Repeats of one stop are averaged first: they tell
of the tracker's noise, not of the robot's errors elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, Locked, group_means
from irbcal.distributions import f_survival
from irbcal.errors import IdentificationError
from irbcal.identification import gear_scan as gears
from irbcal.identification import leave_one_out, linear_model, term_sets, type_prior
from irbcal.identification.evidence_fit import (
    COMPARED,
    EvidenceFit,
    TypePriorResult,
    families_shown,
)
from irbcal.identification.evidence_maximisation import (
    NormalEquations,
    Posterior,
    evidence_likelihood_power,
    fit_likelihood_power,
    maximise_evidence,
)
from irbcal.identification.fit_sections import (
    FamilyShown,
    GearSpectrum,
    GearWave,
    GroupResult,
    ModelAverage,
    TermSetResult,
)
from irbcal.identification.independence import independent
from irbcal.identification.linear_model import Linearisation, LinearModel
from irbcal.identification.outlier_rule import RULE, OutlierRule
from irbcal.identification.problem import Problem, State
from irbcal.identification.term_sets import TermSet
from irbcal.identification.type_prior import WIDE, TypePrior, chi_square_of_type, is_compared, like_type
from irbcal.measurement.motions import usual_load
from irbcal.measurement.points import PointSet
from irbcal.measurement.session_blocks import into_one_frame
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import families, inputs
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.harmonics import FAMILY as HARMONICS
from irbcal.modeling.terms.harmonics import HIGHEST, LONGEST, band_group
from irbcal.modeling.terms.situation import Motion, at_rows
from irbcal.modeling.terms.term import Term
from irbcal.option_values import Progress
from irbcal.section import in_unit
from irbcal.units import DEG, MM, UNIT_OUTSIDE

FEWEST_POSES = 10
"""Poses below which there is nothing to compare."""
FEWEST_FOR_LONGEST = 120
"""Poses below which the longest series of harmonics is not tried: fewer do not show it, and it takes seconds."""
LONGEST_OPTIMISM = 1.1
"""By how much left-out residuals of the longest series are too small: its 144 variances are from the same poses. On a
UR10 (300 poses) 95 % intervals hold 91 to 93 % without."""
EVIDENCE_DROP = 80.0
"""Nats below the best term set at which another one can have no weight, with room for what iterations still gain."""
READINGS_GATE = 1.5
"""Factor by which the residuals must fall for readings to count as taken before the arm stood still, beyond what a few
poses leave to chance."""
GATE_CERTAINTY = 0.95


@dataclass(eq=False)
class ComparedTermSet:
    """A term set with its fits."""

    term_set: TermSet
    by_evidence: Posterior
    """At the likelihood power of the log evidence."""
    weight: float = 0.0
    """In the average."""
    by_fit: Posterior | None = None
    """At the likelihood power of a fit; of term sets with weight."""
    leave_one_out: float | None = None
    """Root mean square length of its leave-one-pose-out residuals, metres."""

    @property
    def optimism(self) -> float:
        """By how much its left-out residuals are too small."""
        return LONGEST_OPTIMISM if self.term_set.highest > HIGHEST else 1.0


def fit_term_set(
    linear: LinearModel,
    sums: NormalEquations,
    term_set: TermSet,
    t: float,
    start: Posterior | None = None,
    evidence_floor: float = -np.inf,
) -> Posterior:
    """Coefficients and variances of a term set from the sums of its columns; ``t``: power of the likelihood.

    It starts from the variances of another fit, where one is given: new groups from one.
    """
    variances, s2 = None, None
    if start is not None:
        variances, s2 = np.ones(len(term_set.groups)), start.s2
        variances[: len(start.variances)] = start.variances
    return maximise_evidence(
        sums,
        linear.nuisance,
        term_set.group,
        term_set.caps,
        t,
        variances,
        s2,
        evidence_floor=evidence_floor,
        noise=linear.noise,
        prior=term_set.prior,
    )


class Averaging:
    """Term sets compared by their evidence on one linear model, and averaged.

    Parameters
    ----------
    linear : LinearModel
        Of all terms that a term set may have.
    sums : NormalEquations
        Of all its columns.
    independent : bool
        Whether the points of a pose err by themselves, so that each coordinate counts for itself.
    rule : OutlierRule
    """

    def __init__(
        self, linear: LinearModel, sums: NormalEquations, independent: bool = False, rule: OutlierRule = RULE
    ) -> None:
        self.linear, self.sums, self.independent, self.rule = linear, sums, independent, rule
        self.superset = list(linear.terms)
        self.compared: list[ComparedTermSet] = []
        per_pose = 1.0 if independent else linear.per_pose
        self.fit_likelihood_power, self.evidence_likelihood_power = (
            fit_likelihood_power(per_pose),
            evidence_likelihood_power(per_pose),
        )

    def fit(
        self, term_set: TermSet, t: float, start: Posterior | None = None, evidence_floor: float = -np.inf
    ) -> Posterior:
        """A term set's fit to the model that is compared on; see `fit_term_set`."""
        return fit_term_set(self.linear, self.sums_of(term_set), term_set, t, start, evidence_floor)

    def sums_of(self, term_set: TermSet) -> NormalEquations:
        """The sums of a term set's columns."""
        return self.sums.select(term_set.columns(self.linear.nuisance))

    def weighed(
        self, choices: Sequence[TermSet], taus: Sequence[float] = (), evidence_drop: float = EVIDENCE_DROP
    ) -> tuple[list[ComparedTermSet], FloatArray, float]:
        """Term sets with their log evidence, their weights among each other, and the largest log evidence.

        Parameters
        ----------
        choices : sequence of TermSet
        taus : sequence of float
            Time constants of warm-up, from short to long; of each term set the best is taken, looked for from the best
            of the term set before. Without any that of the choices stays.
        evidence_drop : float
            Nats below the best at which a fit is not brought to its end.
        """
        best, tau, out = -np.inf, None, list[ComparedTermSet]()
        for choice in choices:
            first_tau = term_sets.tau_of(choice, self.superset) if taus else None
            if first_tau is not None:
                tau = tau or first_tau
                choice = term_sets.with_tau(choice, self.superset, tau)
            floor = best - evidence_drop
            candidate = ComparedTermSet(choice, self.fit(choice, self.evidence_likelihood_power, evidence_floor=floor))
            if tau is not None and first_tau is not None and candidate.by_evidence.log_evidence > floor:
                tau = self._choose_tau(candidate, tau, taus)
            out.append(candidate)
            best = max(best, candidate.by_evidence.log_evidence)
        return out, term_sets.weights([candidate.by_evidence for candidate in out]), float(best)

    def _choose_tau(self, candidate: ComparedTermSet, tau: float, taus: Sequence[float]) -> float:
        """The time constant of a term set's warm-up with the largest log evidence: shorter ones are tried first."""
        index, start = taus.index(tau), candidate.by_evidence
        for direction in (taus[:index][::-1], taus[index + 1 :]):
            for another_tau in direction:
                changed = term_sets.with_tau(candidate.term_set, self.superset, another_tau)
                start_fit = candidate.by_evidence
                fit = self.fit(changed, self.evidence_likelihood_power, start_fit, start_fit.log_evidence)
                if fit.log_evidence <= candidate.by_evidence.log_evidence:
                    break
                candidate.term_set, candidate.by_evidence, tau = changed, fit, another_tau
            if candidate.by_evidence is not start:
                break
        return tau

    def weigh(self, compared: list[ComparedTermSet], weights: FloatArray) -> None:
        """Fit the term sets that have a weight by their evidence, and divide it by squared leave-one-out residuals."""
        self.compared = compared
        chosen, precision = np.flatnonzero(weights), weights.copy()
        for k in chosen:
            candidate = compared[k]
            candidate.by_fit = self.fit(candidate.term_set, self.fit_likelihood_power, candidate.by_evidence)
            if len(chosen) > 1:
                u, _, row = leave_one_out.residuals(
                    self.linear, candidate.term_set.columns(self.linear.nuisance), candidate.by_fit
                )
                precision[k] /= np.mean(u[row >= 0] ** 2)  # zero where a direction is open
        for candidate, weight in zip(
            compared, term_sets.shares(precision if precision.any() else weights), strict=True
        ):
            candidate.weight = float(weight)
            candidate.by_fit = candidate.by_fit if weight > 0.0 else None

    @property
    def weighted(self) -> list[ComparedTermSet]:
        """Term sets with weight."""
        return [candidate for candidate in self.compared if candidate.weight > 0.0]

    @property
    def union(self) -> IntArray:
        """Terms of the term sets with weight, places in the superset."""
        return np.unique(np.concatenate([candidate.term_set.terms for candidate in self.weighted]))

    def average(self, linear: LinearModel, sums: NormalEquations | None = None) -> Average:
        """Average the term sets with weight: once roughly, then in the linear model that is improved there.

        Parameters
        ----------
        linear : LinearModel
            Of the `union` of terms.
        sums : NormalEquations, optional
            Of its columns, where they are others than those that were compared on.
        """
        averaged, nuisance = self.weighted, linear.nuisance
        columns_of = self._columns(nuisance)
        starts = fits = [candidate.by_fit or candidate.by_evidence for candidate in averaged]
        compared_on = sums is None
        sums = self.sums.select(np.concatenate([np.arange(nuisance), nuisance + self.union])) if sums is None else sums
        for last in (False, True):
            if last or not compared_on:
                fits = [
                    fit_term_set(linear, sums.select(columns), candidate.term_set, self.fit_likelihood_power, start)
                    for candidate, columns, start in zip(averaged, columns_of, starts, strict=True)
                ]
            mean = np.zeros(nuisance + len(self.union))
            for candidate, columns, fit in zip(averaged, columns_of, fits, strict=True):
                candidate.by_fit = fit
                mean[columns] += candidate.weight * fit.c
            better = linear if last else linear.improved(mean)
            if better is linear:
                break
            linear, sums = better, better.sums_again(sums)
            starts = fits if linear.restarts else starts
        return Average(self, linear, sums, columns_of, fits, mean)

    def _columns(self, nuisance: int) -> list[IntArray]:
        """Columns of each term set with weight in a linear model of their `union`."""
        places = (np.searchsorted(self.union, candidate.term_set.terms) for candidate in self.weighted)
        return [np.concatenate([np.arange(nuisance), nuisance + place]) for place in places]

    def results(self) -> tuple[TermSetResult, ...]:
        """All term sets in the comparison; those with weight as averaged."""
        return tuple(
            TermSetResult(
                name=candidate.term_set.name,
                terms=self.linear.nuisance + len(candidate.term_set.terms),
                log_evidence=candidate.by_evidence.log_evidence,
                weight=candidate.weight,
                sigma_mm=None if candidate.by_fit is None else np.sqrt(candidate.by_fit.s2),
                leave_one_out_mm=None if candidate.leave_one_out is None else candidate.leave_one_out / MM,
            )
            for candidate in self.compared
        )


@dataclass(frozen=True, eq=False)
class Average:
    """The average of the term sets with weight; what few ask for is computed when it is asked for."""

    averaging: Averaging
    linear: LinearModel
    """Made exact at the mean."""
    sums: NormalEquations
    """Of its columns."""
    columns: Sequence[IntArray]
    fits: Sequence[Posterior]
    """Columns of each term set in the linear model, and its fit there."""
    mean: FloatArray
    """Shape (nuisance + terms,). In units of the columns."""

    @property
    def _parts(self) -> Iterator[tuple[ComparedTermSet, IntArray, Posterior]]:
        return zip(self.averaging.weighted, self.columns, self.fits, strict=True)

    @cached_property
    def covariance(self) -> FloatArray:
        """Scatter within and between term sets, shape (nuisance + terms, nuisance + terms)."""
        out = np.zeros((len(self.mean), len(self.mean)))
        for candidate, columns, fit in self._parts:
            apart = -self.mean
            apart[columns] += fit.c
            out[np.ix_(columns, columns)] += candidate.weight * self.linear.covariance(fit, candidate.term_set)
            out += candidate.weight * np.outer(apart, apart)
        return out

    @cached_property
    def _left_out(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Leave-one-pose-out residuals, mm, with pose and measurement of each, shape (equations,)."""
        single = list[FloatArray]()
        for candidate, columns, fit in self._parts:
            u, pose, row = leave_one_out.residuals(self.linear, columns, fit)
            u = candidate.optimism * u
            candidate.leave_one_out = leave_one_out.lengths(self.linear, u, pose, row)[""]
            single.append(candidate.weight * u)
        return np.sum(single, axis=0), pose, row

    @cached_property
    def _residuals(self) -> FloatArray:
        """Of the mean, mm, shape (equations,)."""
        return np.concatenate([block.y - self.mean @ block.J for block in self.linear.blocks()])

    @cached_property
    def outlier_distance(self) -> FloatArray:
        """See `irbcal.identification.leave_one_out.outliers`, shape (measurements,)."""
        u, _, row = self._left_out
        return leave_one_out.outliers(self.linear, self._residuals, u, row, self.averaging.rule)

    @property
    def leverage_pose(self) -> tuple[int, float] | None:
        """See `irbcal.identification.leave_one_out.leverage_pose`."""
        (u, pose, row), e = self._left_out, self._residuals
        return leave_one_out.leverage_pose(e[row >= 0], u[row >= 0], self.linear.repeat_group[pose[row >= 0]])

    @cached_property
    def all_outliers(self) -> FloatArray:
        """Distances of outliers, and of those that show once these are left out, (points,), mm, else zero."""
        linear, averaging = self.linear, self.averaging
        if not isinstance(linear, Linearisation):
            return self.outlier_distance
        points, fits = linear.problem.points, list(self.fits)
        out = more = self.outlier_distance[: len(points)]
        while more.any() and not averaging.rule.too_many(int(np.count_nonzero(out)), len(out)):
            if not np.bincount(points.target[out == 0.0], minlength=len(points.target_names)).all():
                break
            inliers = linear.without(out > 0.0)
            sums, u, mean = inliers.sums(), np.zeros(0), np.zeros(len(self.mean))
            for k, (candidate, columns, _) in enumerate(self._parts):
                fits[k] = fit = fit_term_set(
                    inliers, sums.select(columns), candidate.term_set, averaging.fit_likelihood_power, fits[k]
                )
                left_out, _, row = leave_one_out.residuals(inliers, columns, fit)
                u = candidate.weight * candidate.optimism * left_out + (u if len(u) else 0.0)
                mean[columns] += candidate.weight * fit.c
            e = np.concatenate([block.y - mean @ block.J for block in inliers.blocks()])
            more = leave_one_out.outliers(inliers, e, u, row, averaging.rule)[: len(points)]
            out = out + more
        return out

    def results(self, report: bool = True) -> dict[str, Any]:
        """Those fields of `ModelAverage` that say how the average came about.

        Parameters
        ----------
        report : bool
            Whether leave-one-out errors and what each family is worth are wanted.
        """
        averaging, linear = self.averaging, self.linear
        weighted, nuisance, power = averaging.weighted, linear.nuisance, averaging.evidence_likelihood_power
        top = max(range(len(weighted)), key=lambda k: weighted[k].weight)
        term_set, single, fifths = weighted[top].term_set, dict[str, Any](), dict[str, Any]()
        families: tuple[FamilyShown, ...] = ()
        if report:
            u, pose, row = self._left_out
            single = fifths = leave_one_out.lengths(linear, u, pose, row)
            if linear.sequence:
                parts = [
                    candidate.weight * candidate.optimism * leave_one_out.block_residuals(linear, columns, fit)
                    for candidate, columns, fit in self._parts
                ]
                fifths = leave_one_out.lengths(linear, np.sum(parts, axis=0), pose, row)
            names = [averaging.superset[k].family for k in term_set.terms]
            sums = self.sums.select(self.columns[top])
            families = families_shown(sums, nuisance, names, term_set, power, self.fits[top])
        return {
            "sigma_mm": float(np.sqrt(sum(candidate.weight * fit.s2 for candidate, _, fit in self._parts))),
            "leave_one_out_mm": in_unit(single, MM),
            "leave_fifths_out_mm": in_unit(fifths, MM),
            "groups": tuple(groups_of(weighted, averaging.superset)),
            "families": families,
            "warm_up_tau": term_sets.tau_of(term_set, averaging.superset),
        }


def groups_of(averaged: list[ComparedTermSet], superset: Sequence[Term]) -> list[GroupResult]:
    """What was expected of each group and what the data show of it, averaged over the term sets."""
    totals: dict[str, FloatArray] = {}
    members: dict[str, list[Term]] = {}
    for candidate in averaged:
        fit, d = candidate.by_fit, candidate.term_set
        if fit is None:
            continue
        nuisance = len(fit.c) - len(d.terms)
        counts = np.bincount(d.group, minlength=len(d.groups))
        unit = 1.0 if d.prior is None else np.bincount(d.group, d.prior.std**2, len(d.groups)) / counts
        unit = np.broadcast_to(unit, counts.shape)
        squares = np.bincount(d.group, fit.c[nuisance:] ** 2, len(d.groups)) / counts
        scatter = np.bincount(d.group, np.diagonal(fit.covariance)[nuisance:], len(d.groups)) / counts
        for k, name in enumerate(d.groups):
            row = np.array([fit.gammas[k], fit.variances[k] * unit[k], squares[k], scatter[k], 1.0])
            totals[name] = totals.get(name, np.zeros(5)) + candidate.weight * row
            members.setdefault(name, [superset[j] for j in d.terms[d.group == k]])
    out = []
    for name, (determined, *squared, weight) in totals.items():
        terms = members[name]
        size, estimate, std = np.sqrt(np.array(squared) / weight)
        natural = {}
        for term in terms:
            base, slash, per = term.unit.partition("/")
            outside, factor = UNIT_OUTSIDE.get(base, (base, 1.0))
            natural[outside + slash + per] = term.size / factor
        out.append(
            GroupResult(
                name=name,
                terms=len(terms),
                determined=determined,
                size=size,
                family=terms[0].family,
                natural=natural,
                estimate=estimate,
                std=std,
            )
        )
    return out


@dataclass(frozen=True, eq=False)
class LinearisedPoints:
    """Points linearised about the geometry solution, with all terms that a term set may have."""

    arm: Arm
    points: PointSet
    motion: Motion
    """As measured."""
    terms: str
    problem: Problem
    state: State
    """Base, targets and constants of the geometry solution."""
    stops: Motion
    """Of the problem's poses: repeats are averaged."""
    linear: Linearisation
    """Of at most `COMPARED` poses."""
    sums: NormalEquations
    taus: list[float]
    """Time constants of warm-up."""
    usual_kg: float | None
    readings_gain: float | None
    """By how much residuals fall if a share of the last move is taken from each pose; None unless joints are readings.
    """


def linearise(
    arm: Arm,
    points: PointSet,
    motion: Motion,
    terms: str = term_sets.JOINT_MAP,
    known_targets: Mapping[str, ArrayLike] | None = None,
    payload_centre: Sequence[float] | None = None,
    usual_kg: float | None = None,
    seed: int = 0,
) -> LinearisedPoints:
    """Average repeats, solve for the geometry, and linearise all terms there; see `identify_evidence`."""
    if terms not in (term_sets.JOINT_MAP, term_sets.ALL):
        raise IdentificationError(f"terms are {term_sets.JOINT_MAP} or {term_sets.ALL}, not {terms!r}")
    check_averaging(arm, points.poses)
    if motion.q.shape != points.q.shape:
        raise IdentificationError(f"the motion has {len(motion)} stops, the points {points.poses} poses")
    averaged, stops = average_repeats(replace(points, q=np.array(motion.q)), motion)
    usual = usual_load(stops.inputs.get("payload_kg")) if usual_kg is None else usual_kg
    geometry = GEOMETRY.terms(arm)
    problem = linear_model.geometry_problem(arm, averaged, geometry, known_targets)
    superset, taus = term_sets.of_motion(arm, terms, stops, usual, payload_centre)
    project, gain, state = False, None, None
    if stops.readings and stops.moves.any():
        project, gain, state = _lagging(problem, stops, superset, geometry)
    state = state or linear_model.geometry_solution(problem, stops, geometry)
    subset, subset_motion = problem, stops
    if averaged.poses > COMPARED:
        chosen = np.zeros(averaged.poses, dtype=bool)
        chosen[np.random.default_rng(seed).permutation(averaged.poses)[:COMPARED]] = True
        subset, subset_motion = problem.of_poses(chosen), stops.select(chosen)
    linear = Linearisation(subset, state, subset_motion, superset, project)
    return LinearisedPoints(arm, points, motion, terms, problem, state, stops, linear, linear.sums(), taus, usual, gain)


def _lagging(
    problem: Problem, motion: Motion, superset: Sequence[Term], geometry: Sequence[Term]
) -> tuple[bool, float, State]:
    """Whether readings lag, how much residuals fall if a share of each last move is free, and the geometry solution."""
    sizes, spare, states = [], [], []
    for project in (False, True):
        states.append(linear_model.geometry_solution(problem, motion, geometry, project))
        linear = Linearisation(problem, states[-1], motion, superset, project)
        middle = term_sets.make(superset, ["gravity", "gain", "harmonics"], 2, None)
        sums, t = linear.sums(middle.columns(linear.nuisance)), fit_likelihood_power(linear.per_pose)
        fit = fit_term_set(linear, sums, middle, t)
        sizes.append(np.sqrt(fit.s2))
        spare.append(max(t * sums.equations - linear.nuisance - float(fit.gammas.sum()), 1.0))
    ratio = float(sizes[0] / sizes[1])
    project = f_survival((ratio / READINGS_GATE) ** 2, *spare) < 1.0 - GATE_CERTAINTY
    return project, ratio, states[project]


def identify_evidence(
    arm: Arm,
    points: PointSet,
    motion: Motion | None = None,
    *,
    terms: str = term_sets.JOINT_MAP,
    gear_scan: bool = True,
    seed: int = 0,
    known_targets: Mapping[str, ArrayLike] | None = None,
    payload_centre: Sequence[float] | None = None,
    usual_kg: float | None = None,
    prior: TypePrior | None = None,
    rule: OutlierRule = RULE,
    progress: Progress | None = None,
) -> EvidenceFit:
    """Identify base, targets and the averaged terms.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
        Its joints are not used: those of the motion are.
    motion : Motion, optional
        Programmed joints, last moves, time and payload of the points' poses; the points' own joints without history
        unless given.
    terms : str
        ``joint-map``: what URDF and a joint map can carry; ``all``: frame terms, too.
    gear_scan : bool
        Look for single high harmonics, unless the best term set has long series of them.
    seed : int
        Of the poses on which term sets are compared where there are more than `COMPARED`.
    known_targets : dict of str to array_like, shape (3,), optional
        Targets whose places in the tip link are known, metres.
    payload_centre : sequence of three float, optional
        Centre of the payload in the tip link where the motion does not tell it, metres; the tip unless given.
    usual_kg : float, optional
        The load of predictions where none is given; the one of most poses unless given.
    prior : TypePrior, optional
        What calibrated robots of the same type show. Term sets with it compete by their evidence with those without: a
        robot that is not like its type is identified without.
    rule : OutlierRule
        From where on a point is one that contradicts all others.
    progress : callable, optional
        Called with a short text at each step.

    Raises
    ------
    IdentificationError
        As `check_averaging`, if the data do not allow it, or ``terms`` is not one of the two.

    Examples
    --------
    >>> seen = cleaning.clean(irbcal.read_measurements("m.csv")).points  # doctest: +SKIP
    >>> identify_evidence(irbcal.read_urdf("irb120").arm, seen, Motion.in_order(seen.q))  # doctest: +SKIP
    """
    motion = Motion(points.q) if motion is None else motion
    if progress:
        progress("fitting the geometry")
    linearised = linearise(arm, points, motion, terms, known_targets, payload_centre, usual_kg, seed)
    return draft_evidence(linearised, gear_scan=gear_scan, prior=prior, rule=rule, progress=progress).fit()


def draft_evidence(
    linearised: LinearisedPoints,
    *,
    gear_scan: bool = True,
    prior: TypePrior | None = None,
    rule: OutlierRule = RULE,
    progress: Progress | None = None,
) -> Draft:
    """Average term sets, without what only the result needs; parameters as `identify_evidence`."""
    say = progress or (lambda text: None)
    averaging = Averaging(linearised.linear, linearised.sums, rule=rule)
    tau = linearised.taus[-1] if linearised.taus else None
    choices = term_sets.candidates(averaging.superset, linearised.terms, tau)
    say(f"comparing {len(choices)} choices of terms")
    compared, weights, best = averaging.weighed(choices, linearised.taus)
    if _each_counts(averaging, compared):
        averaging = Averaging(linearised.linear, linearised.sums, True, rule)
        compared, weights, best = averaging.weighed(choices, linearised.taus)
    of_type = None
    if prior is not None:
        compared, weights, of_type = _with_type(averaging, prior, linearised.taus, (compared, weights, best))
    averaging.weigh(compared, weights)
    linearised, averaging = _with_longer_series(linearised, averaging, say)
    harmonics, spectrum = _scan(averaging, linearised.linear, say) if gear_scan else ([], None)
    say("averaging")
    if harmonics or len(linearised.stops) != len(linearised.linear.motion):
        used, project = [averaging.superset[k] for k in averaging.union], linearised.linear.projected
        linear = Linearisation(linearised.problem, linearised.state, linearised.stops, used, project)
        average = averaging.average(linear, linear.sums())
    else:
        linear = linearised.linear.of_terms(averaging.union)
        average = averaging.average(linear)
    return Draft(linearised, averaging, linear, average, harmonics, spectrum, of_type)


@dataclass(frozen=True, eq=False)
class Draft:
    """An identification whose outliers are known, and whose covariance and worth of families are not computed yet."""

    linearised: LinearisedPoints
    averaging: Averaging
    linear: Linearisation
    """Of the terms with weight, before it was improved at the average."""
    average: Average
    gears: Sequence[GearWave]
    spectrum: GearSpectrum | None
    type_prior: TypePriorResult | None

    @cached_property
    def _stop(self) -> IntArray:
        """Stop of each pose."""
        motion, stops = self.linearised.motion, self.linearised.stops
        return stop_numbers(self.linearised.points, motion) if len(stops) < len(motion) else np.arange(len(motion))

    @cached_property
    def outlier_distance(self) -> FloatArray:
        """How far outliers are from where all other points put them, metres, shape (m,); zero for good points."""
        of_problem, points = self.linearised.problem.points, self.linearised.points
        out = np.zeros((len(self.linearised.stops), len(points.target_names)))
        out[of_problem.pose, of_problem.target] = self.average.all_outliers * MM
        return np.asarray(out[self._stop[points.pose], points.target])

    def fit(self) -> EvidenceFit:
        """The result, with what is known of it."""
        linearised, averaging, linear, average = self.linearised, self.averaging, self.linear, self.average
        problem, nuisance, terms_used = linearised.problem, linear.nuisance, linear.terms
        state, names = linear.moved(average.mean), linearised.points.target_names
        like_lag = [linear.projected and families()[term.family].like_lag for term in terms_used]
        used = np.flatnonzero(~np.array(like_lag, dtype=bool))
        columns = np.concatenate([np.arange(nuisance), nuisance + used])
        scale = linear.sizes[columns]
        other_bases = dict(zip(problem.sessions[:-1], state.earlier_bases, strict=True))
        terms, coefficients = tuple(terms_used[k] for k in used), (scale * average.mean[columns])[nuisance:]
        coefficient_of = {term.name: float(value) for term, value in zip(terms, coefficients, strict=True)}
        results, leverage = average.results(), average.leverage_pose
        return EvidenceFit(
            nominal=linearised.arm,
            arm=linear.problem.arm_at(state),
            points=into_one_frame(linearised.points, state.T_world_base, other_bases),
            motion=linearised.motion,
            terms=terms,
            coefficients=coefficients,
            covariance=average.covariance[np.ix_(columns, columns)] * np.outer(scale, scale),
            T_world_base=state.T_world_base,
            targets=dict(zip(names, state.targets, strict=True)),
            fitted_targets=tuple(names[k] for k in problem.fitted_targets),
            oriented_targets=tuple(names[k] for k in problem.oriented_targets),
            target_rotations={names[k]: state.rotations[k] for k in problem.oriented_targets},
            term_sets=averaging.results(),
            average=ModelAverage(
                terms=linearised.terms,
                poses=len(linearised.stops),
                gears=tuple(_with_amplitude(gear, coefficient_of) for gear in self.gears),
                spectrum=self.spectrum,
                readings_gain=linearised.readings_gain,
                readings_lag=linear.projected,
                **results,
            ),
            usual_kg=linearised.usual_kg,
            other_bases=other_bases,
            type_prior=self.type_prior,
            independent=averaging.independent,
            outlier_distance=self.outlier_distance,
            leverage_pose=None
            if leverage is None
            else (int(np.flatnonzero(linear.repeat_group[self._stop] == leverage[0])[0]), leverage[1]),
        )


def _with_amplitude(gear: GearWave, coefficient_of: Mapping[str, float]) -> GearWave:
    """A wave with how far it turns its joint to and fro."""
    cosine, sine = (coefficient_of[term.name] for term in gear_terms(gear.joint - 1, gear.cycles_per_turn))
    return gear.model_copy(update={"amplitude_deg": float(np.hypot(cosine, sine)) / DEG})


def _each_counts(averaging: Averaging, compared: Sequence[ComparedTermSet]) -> bool:
    """Whether the likeliest term set, fitted as if each coordinate counted for itself, leaves errors that do so."""
    linear = averaging.linear
    if (
        averaging.evidence_likelihood_power == 1.0
        or linear.projected
        or linear.session is not None
        or (linear.target < 0).any()
    ):
        return False
    best = max(compared, key=lambda candidate: candidate.by_evidence.log_evidence)
    fit = averaging.fit(best.term_set, 1.0, best.by_evidence)
    return independent(linear, best.term_set.columns(linear.nuisance), fit)


def log_evidence(linearised: LinearisedPoints) -> float:
    """Log evidence of measurements, whichever of the term sets is true: what other joints or names are compared by."""
    averaging = Averaging(linearised.linear, linearised.sums)
    tau = linearised.taus[-1] if linearised.taus else None
    choices = term_sets.candidates(averaging.superset, linearised.terms, tau)
    compared, _, _ = averaging.weighed(choices, linearised.taus)
    return float(np.logaddexp.reduce([candidate.by_evidence.log_evidence for candidate in compared]))


def _with_type(
    averaging: Averaging,
    prior: TypePrior,
    taus: Sequence[float],
    alone: tuple[list[ComparedTermSet], FloatArray, float],
) -> tuple[list[ComparedTermSet], FloatArray, TypePriorResult]:
    """Term sets without and with a type's prior, their weights, and what became of the prior."""
    compared, weights, best = alone
    choices = type_prior.with_type(averaging.superset, taus[-1] if taus else None, prior.coefficients)
    with_type, their_weights, theirs = averaging.weighed(choices, taus)
    top = max(with_type, key=lambda candidate: candidate.by_evidence.log_evidence)
    without = max(compared, key=lambda candidate: candidate.by_evidence.log_evidence).by_evidence
    part = averaging.sums_of(top.term_set)
    test = chi_square_of_type(part, averaging.linear.nuisance, top.term_set, top.by_evidence, without.s2)
    weight = term_sets.share(theirs - best) if like_type(*test) else 0.0
    shares = np.concatenate([(1.0 - weight) * weights, weight * their_weights])
    result = TypePriorResult(prior.type, len(prior.robots), prior.simulated, theirs - best, weight, *test)
    return [*compared, *with_type], term_sets.shares(shares), result


def _with_longer_series(
    linearised: LinearisedPoints, averaging: Averaging, say: Progress
) -> tuple[LinearisedPoints, Averaging]:
    """Where the long series of harmonics has most weight, the same term sets with a longer one join the comparison."""
    best = max(averaging.compared, key=lambda candidate: candidate.weight)
    if best.term_set.highest < HIGHEST or len(linearised.stops) < FEWEST_FOR_LONGEST:
        return linearised, averaging
    say(f"comparing harmonics to {LONGEST}")
    more = HARMONICS.terms(linearised.problem.arm, HIGHEST + 1, LONGEST)
    linear = linearised.linear.extended(more)
    longer = Averaging(linear, linear.sums(), averaging.independent, averaging.rule)
    new_terms = range(len(averaging.superset), len(longer.superset))
    compared = list(averaging.compared)
    for candidate in averaging.weighted:
        if candidate.term_set.highest == HIGHEST:
            term_set = candidate.term_set.longer(new_terms, [band_group(term, LONGEST) for term in more], LONGEST)
            compared.append(
                ComparedTermSet(term_set, longer.fit(term_set, longer.evidence_likelihood_power, candidate.by_evidence))
            )
    longer.weigh(compared, term_sets.weights([candidate.by_evidence for candidate in compared]))
    return replace(linearised, linear=linear, sums=longer.sums), longer


def _scan(averaging: Averaging, linear: Linearisation, say: Progress) -> tuple[list[GearWave], GearSpectrum | None]:
    """Frequencies beyond the best term set; their terms join the superset and all term sets with weight."""
    best = max(averaging.compared, key=lambda candidate: candidate.weight)
    if best.by_fit is None or best.term_set.bands:
        # beside long series single harmonics are accidents: on a UR10 they took the held-out mean from 0.134 to
        # 0.141 mm and the intervals' coverage from 96 to 92 %
        return [], None
    fits = best.by_evidence, best.by_fit
    cycles, spectrum = gears.scan(
        linear, best.term_set, averaging.sums_of(best.term_set), fits, say, averaging.independent
    )
    added = [term for candidate in cycles for term in gear_terms(candidate.joint - 1, candidate.cycles_per_turn)]
    new_terms = list(range(len(averaging.superset), len(averaging.superset) + len(added)))
    averaging.superset += added
    for candidate in averaging.weighted if added else ():
        candidate.term_set = candidate.term_set.extended(new_terms, [term.group for term in added])
    return cycles, spectrum


def check_averaging(arm: Arm, poses: int) -> None:
    """Refuse what cannot be averaged by evidence.

    Raises
    ------
    IdentificationError
        If the poses are too few to weigh error models, or all axes of the arm are parallel.
    """
    if poses < FEWEST_POSES:
        raise IdentificationError(
            f"{poses} poses are too few to weigh error models against each other, which needs at least {FEWEST_POSES}: "
            "measure more, or choose model placement"
        )
    if arm.planar:
        raise IdentificationError(
            "all axes of this arm are parallel, so that base and tool cannot be separated, and the evidence of error "
            "models has no meaning: choose model placement"
        )


@dataclass(frozen=True, eq=False)
class TypeTerms(Locked):
    """What one robot's measurements show of the terms."""

    terms: tuple[Term, ...]
    values: FloatArray
    covariance: FloatArray
    """Shapes (k,), (k, k). The estimate under a prior of `WIDE` natural sizes about zero, SI units."""


def type_terms(arm: Arm, points: PointSet, motion: Motion) -> TypeTerms:
    """What measurements show of a type's terms; base, tool and warm-up are left free, a pose counts as one vector.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    motion : Motion
        Of its poses.

    Raises
    ------
    IdentificationError
        As `check_averaging`, or if the poses do not determine base and targets.
    """
    linearised = linearise(arm, points, motion)
    superset, nuisance = linearised.linear.terms, linearised.linear.nuisance
    names = [*type_prior.families_of_type(), "warm_up"]
    choice = term_sets.make(superset, names, type_prior.TYPE_ORDERS, linearised.taus[-1] if linearised.taus else None)
    sums = linearised.sums.select(choice.columns(nuisance))
    t = evidence_likelihood_power(linearised.linear.per_pose)
    posterior = maximise_evidence(sums, nuisance, choice.group, choice.caps, t)
    terms = [superset[k] for k in choice.terms]
    of_type = np.array([is_compared(term) for term in terms], dtype=bool)
    prior = np.where(of_type, WIDE**-2.0, 1.0 / posterior.variances[choice.group])
    A = (t / posterior.s2) * sums.H + np.diag(np.concatenate([np.zeros(nuisance), prior]))
    of_type_columns = np.concatenate([np.zeros(nuisance, dtype=bool), of_type])
    covariance = np.linalg.inv(A)
    values = covariance @ ((t / posterior.s2) * sums.g)
    size = np.array([term.size for term in terms])[of_type]
    return TypeTerms(
        tuple(term for term, own_term in zip(terms, of_type, strict=True) if own_term),
        size * values[of_type_columns],
        np.outer(size, size) * covariance[np.ix_(of_type_columns, of_type_columns)],
    )


SAME_STOP = 1e-6
"""Joints and last moves that agree within this are the same stop, radians or metres."""


def stop_numbers(points: PointSet, motion: Motion) -> IntArray:
    """Number of the stop that each pose is at, in the order of the first pose of each, shape (n,)."""
    keys = np.round(np.column_stack([motion.q, motion.moves]) / SAME_STOP)
    keys = np.column_stack([keys, *(values for name, values in motion.inputs.items() if inputs()[name].per_pose)])
    if points.session is not None:
        keys = np.column_stack([keys, np.unique(points.session.astype(str), return_inverse=True)[1]])
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[which.ravel()])


def average_repeats(points: PointSet, motion: Motion) -> tuple[PointSet, Motion]:
    """Points and motion with repeats of one joint vector, reached by the same move, averaged into one pose.

    Poses with measured orientations are left as they are, and so are stops reached from another side: their difference
    shows the direction terms.

    Parameters
    ----------
    points : PointSet
    motion : Motion
        Of the points' poses.

    Returns
    -------
    points : PointSet
    motion : Motion
    """
    pose = stop_numbers(points, motion)
    if pose.max(initial=-1) + 1 == points.poses or points.oriented().any():
        return points, motion
    first = np.unique(pose, return_index=True)[1]
    cell = pose[points.pose] * len(points.target_names) + points.target
    cells, where = np.unique(cell, return_inverse=True)
    where = where.ravel()
    merged = replace(
        points.select(np.isin(np.arange(points.poses), first)),
        q=motion.q[first],
        pose=cells // len(points.target_names),
        target=cells % len(points.target_names),
        xyz=group_means(points.xyz, where),
        rotation=None,
        u95=None if points.u95 is None else group_means(points.u95, where),
    )
    elapsed = None if motion.elapsed is None else group_means(motion.elapsed, pose)
    known = at_rows(motion.inputs, first)
    for name, values in motion.inputs.items():
        if not inputs()[name].per_pose:
            known[name] = group_means(values, pose)
    return merged, replace(motion.select(first), move=motion.moves[first], elapsed=elapsed, inputs=known)
