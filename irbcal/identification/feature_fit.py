"""Identification from rows at features, by the evidence of model ``auto``: what they leave open stays near nominal.

Base, tool and features have no prior; the terms of the error model have the priors of
`irbcal.identification.evidence_maximisation`, whose variances the data set. Term sets are compared and averaged as in
`irbcal.identification.evidence`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, IntArray, rms
from irbcal.distributions import NORMAL_95, student_within
from irbcal.errors import IdentificationError
from irbcal.identification import feature_problem, term_sets
from irbcal.identification.choices import LEAST_SQUARES, Goal, Level
from irbcal.identification.evidence import FEWEST_POSES, Averaging
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.evidence_maximisation import (
    NormalEquations,
    Posterior,
)
from irbcal.identification.feature_objectives import minimise
from irbcal.identification.feature_problem import (
    BASE,
    TOOL,
    FeatureProblem,
    FeatureState,
    UnknownKey,
    refuse_undetermined,
    relation_residuals,
)
from irbcal.identification.fit_sections import ModelAverage, ParameterReport
from irbcal.identification.linear_model import LinearModel, Rows, fit_geometry
from irbcal.identification.observation_kind import DIMENSIONS
from irbcal.identification.observations import KINDS
from irbcal.identification.outlier_rule import RULE, OutlierRule
from irbcal.identification.outliers import TRIMMED_TO
from irbcal.identification.relations import RELATION_KINDS
from irbcal.identification.term_sets import TermSet, variances_of_like
from irbcal.measurement.features import FeatureSet, Relation
from irbcal.measurement.motions import usual_load
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import Parameter, term_of
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain, families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.geometry import SIZES as GEOMETRY_SIZES
from irbcal.modeling.terms.harmonics import LOW, order
from irbcal.modeling.terms.situation import Motion, at_rows
from irbcal.modeling.terms.term import Term
from irbcal.option_values import Progress
from irbcal.units import MM
from irbcal.wording import first_of

MOST_STEPS = 20
"""Gauss-Newton steps of the geometry at most."""

HIGHEST = 12
"""Highest order of harmonics compared where rows are no program: they are too few for longer series."""


JOINTS = 200
"""Random joints between those of the rows, at which an unknown base follows the arm, and what rows leave open."""

BASE_REASON = "nothing ties the features to a measuring frame: places are those of the base link"

NOMINAL_FAR = 20 * MM
"""Distance from the nominal robot, of the median or an outlier, from which it is placed among parts of rows, metres."""

DRAWS, DRAWN, ROUGH = 8, 12, 30
"""Parts of the rows that the nominal robot is placed among, rows of each feature in one, and steps of least squares."""

SIZE_OPEN = 0.95
"""Share of what was not known of the arm's size that rows leave open where they do not tell it. SIMULATED robots at
gauges with a stroke of 10 mm leave 0.98 and more, as without any length, and lengths of moves are within their
intervals 75 to 83 % of the time only; balls of 60 mm leave 0.6 to 0.9, and 96 % hold."""

TOO_LARGE = 2e-3
"""Share by which a robot may come out larger than nominal before what gave the scale is doubted: SIMULATED robots of
three makers at six devices come out 0.06 % larger or smaller at most."""


class FeatureModel(LinearModel):
    """Rows at features linearised at one state.

    Parameters
    ----------
    problem : FeatureProblem
    state : FeatureState
    chosen : ndarray of int, optional
        Numbers of the problem's terms that it has; all unless given.
    """

    restarts, sequence = True, False

    def __init__(self, problem: FeatureProblem, state: FeatureState, chosen: IntArray | None = None) -> None:
        self.problem, self.state = problem, state
        self.chosen = np.arange(len(problem.terms)) if chosen is None else chosen
        self.nuisance, self.terms = problem.nuisance, [problem.terms[k] for k in self.chosen]
        self.sizes = np.concatenate([problem.sizes[: self.nuisance], problem.sizes[self.nuisance + self.chosen]])
        self.per_pose, self.noise = problem.per_pose / 3.0, problem.noise
        names, self.target = np.unique(problem.rows.target.astype(str), return_inverse=True)
        self.target_names = tuple(str(name) for name in names)

    @property
    def repeat_group(self) -> IntArray:
        """Each pose by itself, and what is known besides as one each."""
        return np.arange(self.problem.rows.poses + len(self.problem.relations) + len(self.problem.priors))

    @cached_property
    def _rows(self) -> Rows:
        """All rows, in the order of their poses."""
        rows = Rows.joined(list(self.problem.dense(self.state, self.chosen)))
        order = np.argsort(rows.pose, kind="stable")
        return Rows(np.ascontiguousarray(rows.J[:, order]), rows.y[order], rows.pose[order], rows.row[order])

    def blocks(self, columns: IntArray | None = None) -> Iterator[Rows]:
        """All rows in one block; see `LinearModel.blocks`."""
        yield self._rows if columns is None else replace(self._rows, J=self._rows.J[columns])

    def improved(self, coefficients: FloatArray) -> FeatureModel:
        """The rows linearised where some coefficients lead."""
        step = np.zeros(self.nuisance + len(self.problem.terms))
        step[: self.nuisance], step[self.nuisance + self.chosen] = (
            coefficients[: self.nuisance],
            coefficients[self.nuisance :],
        )
        return FeatureModel(self.problem, self.problem.moved(self.state, step), self.chosen)

    def covariance(self, fit: Posterior, term_set: TermSet) -> FloatArray:
        """Of coefficients whose groups, where rows leave their size open, may be as large as like groups.

        Few rows tell their noise but roughly: with Student's factor 1.96 standard deviations hold 95 %.
        """
        widened = fit.with_variances(variances_of_like(fit, term_set), term_set.group)
        return np.asarray(widened.covariance * (student_within(0.95, fit.freedom) / NORMAL_95) ** 2)

    def sums(self, columns: IntArray | None = None) -> NormalEquations:
        """Sums of some columns, all unless given; a group of rows is in memory at a time."""
        sums = self.problem.sums(self.state, self.chosen)
        return sums if columns is None else sums.select(columns)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FeatureFit(EvidenceFit):
    """An average of error models from rows at features."""

    problem: FeatureProblem
    state: FeatureState
    """Base, tool, features, and the coefficients of ``problem.terms``."""
    nominal_state: FeatureState
    """Base, tool and features of the nominal robot, from the same rows."""
    step_covariance: FloatArray
    """Shape (nuisance + terms, nuisance + terms). Of the problem's nuisance steps and coefficients, SI units."""

    def std_of(self, key: UnknownKey) -> FloatArray:
        """Standard deviations of an unknown of tool or features, SI units."""
        shape, at = self.problem.layout[key]
        variances = np.diagonal(self.step_covariance)[at : at + DIMENSIONS[shape]]
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))

    @property
    def rms(self) -> float:
        """Root mean square of what the rows miss, metres."""
        return rms(self.problem.distances(self.state))

    @property
    def nominal_robot(self) -> Robot:
        """The nominal robot with base and tool from the same rows."""
        nominal_values, base = self.nominal_state.values, self.nominal_state.T_world_base
        rotations = {name: nominal_values["axes", name] for name in self.target_rotations}
        targets = {name: nominal_values[TOOL, name] for name in self.targets}
        return Robot(self.nominal, T_world_base=base, targets=targets, target_rotations=rotations)

    @property
    def rank(self) -> int:
        """Number of coefficients that the data determine, base and targets included where they are unknown."""
        return super().rank - (0 if BASE in self.problem.layout else 6)

    @property
    def parameter_count(self) -> int:
        """Number of parameters of the robot; those of the features are not among them."""
        return super().parameter_count - (0 if BASE in self.problem.layout else 6)

    def parameters(self) -> list[ParameterReport]:
        """As of any fit; a base that nothing ties to a measuring frame is held."""
        rows = super().parameters()
        if BASE in self.problem.layout:
            return rows
        held = {"std": None, "low": None, "high": None, "state": "held", "reason": BASE_REASON}
        base = [row.model_copy(update=held) for row in rows[:6]]
        return [*base, *rows[6:]]

    @property
    def scale_measured(self) -> bool:
        """Whether the rows tell the size of the arm, beside what nominal link lengths do."""
        return self.size_open() <= SIZE_OPEN

    def size_open(self) -> float:
        """Which share the rows leave of what was not known of the arm's size: of all its lengths growing alike.

        Lengths that no row of this kind could tell (along the last axis, where the tool is unknown) are part of it.
        """
        nuisance, table = len(self.covariance) - len(self.terms), self.nominal.table
        length = np.zeros(len(self.covariance))
        for k, term in enumerate(self.terms):
            if term.family == "geometry" and term.axis[0] == "t":
                length[nuisance + k] = getattr(table, DHM_COLUMNS[term.axis])[term.joint]
        sizes = {group.name: group.size for group in self.average.groups}
        before = sizes.get("geometry", 1.0) * GEOMETRY_SIZES["t"] * float(np.linalg.norm(length))
        return float(np.sqrt(length @ self.covariance @ length)) / before if before > 0.0 else 0.0

    @property
    def scale_from(self) -> str:
        """What gives the robot its scale where nothing but parts of features does, in words."""
        problem = self.problem
        metric = [group for group in problem.groups if group.kind.metric]
        words = list(dict.fromkeys(group.kind.scale_of(group.feature) for group in metric))
        metric_groups = [group for group in problem.groups if group.feature.centre is not None or group.measured]
        lengths = any(RELATION_KINDS[relation.kind].metric for relation in problem.rows.relations)
        return "" if lengths or metric_groups or "" in words else " and ".join(words)

    def doubts(self) -> list[str]:
        """What speaks against what was known beforehand of features: their own doubts, and fitted numbers far away."""
        problem, state = self.problem, self.state
        doubts = [
            of_group.group.kind.doubt(of_group.observed, of_group.residuals)
            for of_group in problem.group_residuals(state)
        ]
        for (name, feature_name), expected_length in problem.priors.items():
            value = float(state.values[name, feature_name][0])
            if abs(value - expected_length.value[0]) > 2.0 * expected_length.u95:
                doubts.append(
                    f"{name} of {feature_name} comes out at {value:.6g}, {expected_length.value[0]:.6g} was said: "
                    "images and poses that do not belong together, or a lens that is another."
                )
        larger = self._larger()
        if abs(larger) > TOO_LARGE:
            rests = (
                f"and its scale rests on {self.scale_from}: measure these"
                if self.scale_from
                else ("which no arm is: a known length is wrong, or the URDF is another robot's")
            )
            doubts.append(
                f"The robot comes out {abs(larger):.2%} {'larger' if larger > 0 else 'smaller'} than nominal, {rests}."
            )
        return [text for text in dict.fromkeys(doubts) if text]

    def _larger(self) -> float:
        """Share by which the calibrated arm is larger than the nominal one."""
        nominal, calibrated = self.nominal, self.arm
        q = nominal.random_joints(JOINTS, 0)
        a, b = (arm.forward(q)[:, :3, 3] for arm in (nominal, calibrated))
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        return float(np.linalg.svd(a.T @ b, compute_uv=False).sum() / (a**2).sum()) - 1.0

    def left_open(self) -> tuple[float, float]:
        """What is not known of where the tool's point is, before and after: root mean square lengths, metres.

        At joints between those of the rows: from the variances that the data gave the terms, and from what is left of
        them. How the arm as a whole stands does not count, nor before the rows where the point is on the tool.
        """
        motion = self.joint_map.motion(_between(self.problem.rows.q))
        path, values = chain.walk(self.nominal, motion.q), partial(self.problem.term_model.values, motion)
        sizes = {group.name: group.size for group in self.average.groups}
        nuisance = len(self.covariance) - len(self.terms)
        prior = np.array([(sizes.get(t.group, 0.0) * t.size) ** 2 for t in self.terms])
        worst = 0.0, 0.0
        for k, name in enumerate(self.fitted_targets or ("",)):
            tool = self.targets.get(name, np.zeros(3))
            p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], tool)
            J = np.zeros((3 + len(self.terms), 3, JOINTS))
            J[:3] = path.tip[:3] if self.fitted_targets else 0.0
            self.problem.term_model.columns(path, values, p, out=J[3:])
            across = J.transpose(0, 2, 1).reshape(len(J), -1)
            across = across - (across @ (B := frames.by_motion(p.T))) @ np.linalg.pinv(B)
            G = across @ across.T / JOINTS
            columns = np.r_[6 + 3 * k : 9 + 3 * k, nuisance : len(self.covariance)]
            variance_left = float(np.sqrt(np.sum(G * self.covariance[np.ix_(columns, columns)])))
            if variance_left >= worst[1]:
                worst = float(np.sqrt(prior @ np.diagonal(G)[3:])), variance_left
        return worst


def _between(q: FloatArray) -> FloatArray:
    """Random joints (`JOINTS`, joints) between pairs of some (n, joints)."""
    rng = np.random.default_rng(0)
    one, other = (q[rng.integers(len(q), size=JOINTS)] for _ in range(2))
    return one + rng.uniform(size=(JOINTS, 1)) * (other - one)


def identify_features(
    arm: Arm,
    features: FeatureSet,
    terms: str | Sequence[Parameter] = term_sets.JOINT_MAP,
    choices: Sequence[Sequence[str]] | None = None,
    progress: Progress | None = None,
    start: FeatureState | None = None,
    bare: bool = False,
    goal: Goal = LEAST_SQUARES,
    rule: OutlierRule = RULE,
) -> FeatureFit:
    """Identify base, tool, features and the averaged terms.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    features : FeatureSet
    terms : str or sequence of Parameter
        ``joint-map`` or ``all``, see `irbcal.identification.term_sets`; or the error parameters of a level, which are
        fitted without others. They have the priors of model ``auto``, for rows at features leave directions open.
    choices : sequence of sequence of str, optional
        Families beside the geometry in each term set; those of model ``auto`` unless given.
    progress : callable, optional
    start : FeatureState, optional
        The nominal robot among the features, where it is known from more rows.
    bare : bool
        Leave out what only a report asks for: leave-one-out errors and what the rows show.
    goal : Goal
        What to make small from the evidence fit on.
    rule : OutlierRule

    Raises
    ------
    IdentificationError
        If the rows leave base, tool or features open, or are too few.
    """
    say = progress or (lambda text: None)
    if features.poses < FEWEST_POSES:
        raise IdentificationError(
            f"{features.poses} poses at features are too few to identify a robot: at least {FEWEST_POSES} are needed, "
            "50 or more are better"
        )
    usual_kg, taus = usual_load(features.inputs.get("payload_kg")), list[float]()
    if isinstance(terms, str):
        superset, taus = term_sets.of_motion(arm, terms, features.motion(), usual_kg)
        superset += families()["own_weight"].terms(arm)
        if not features.programmed:
            superset = [t for t in superset if t.family != "harmonics" or order(t) <= HIGHEST]
    else:
        superset = sorted((term_of(spelling, arm) for spelling in terms), key=lambda term: term.family != "geometry")
        terms, choices = term_sets.JOINT_MAP, [list(dict.fromkeys(term.family for term in superset))]
    problem = FeatureProblem(arm, features, superset)
    say(f"placing tool and features of {features.poses} poses")
    if start is None:
        nominal = feature_problem.start(problem)
    else:
        nominal = feature_problem.settle(problem, replace(start, coefficients=np.zeros(len(superset))))
    refuse_undetermined(problem, nominal)
    say("fitting the geometry")
    model = FeatureModel(problem, _geometry(problem, nominal))
    averaging = Averaging(model, model.sums(), rule=rule)
    offered = _choices(superset, terms, choices, taus)
    say(f"comparing {len(offered)} choices of terms")
    averaging.weigh(*averaging.weighed(offered, evidence_drop=np.inf)[:2])
    say("averaging")
    union = averaging.union
    narrow = FeatureModel(problem, model.state, union)
    average = averaging.average(narrow)
    linear, covariance, results = average.linear, average.covariance, average.results(report=not bare)
    assert isinstance(linear, FeatureModel)
    state = replace(linear.state, coefficients=linear.state.coefficients[union])
    covariance = covariance * np.outer(linear.sizes, linear.sizes)
    smaller = FeatureProblem(arm, features, linear.terms)
    reached: dict[str, Any] = {}
    if not goal.least_squares:
        say("minimising the objective")
        solution = minimise(smaller, state, goal)
        state = solution.state
        if goal.objective != "rms":
            reached = {"objective": goal.objective, "value": solution.value, "lower_bound": solution.lower_bound}
    names = sorted({key[1] for key in problem.layout if key[0] == TOOL})
    framed = sorted({key[1] for key in problem.layout if key[0] == "axes" and key[1] in set(features.target)})
    points = as_points(features)
    return FeatureFit(
        nominal=arm,
        arm=smaller.arm_at(state),
        points=points,
        motion=Motion(points.q, inputs=points.inputs),
        terms=tuple(linear.terms),
        coefficients=state.coefficients,
        covariance=_of_robot(smaller, state, covariance, names, framed, follow=not bare),
        T_world_base=state.T_world_base,
        targets={name: state.values[TOOL, name] for name in names},
        fitted_targets=tuple(names),
        oriented_targets=tuple(framed),
        target_rotations={name: state.values["axes", name] for name in framed},
        term_sets=averaging.results(),
        average=ModelAverage(terms=terms, poses=features.poses, **results),
        usual_kg=usual_kg,
        problem=smaller,
        state=state,
        nominal_state=replace(nominal, coefficients=nominal.coefficients[union]),
        step_covariance=covariance,
        outlier_distance=np.zeros(0) if bare else average.outlier_distance * MM / smaller.weights,
        **reached,
    )


def identify_without_outliers(
    arm: Arm,
    rows: FeatureSet,
    terms: str | Sequence[Parameter] = term_sets.JOINT_MAP,
    progress: Progress | None = None,
    goal: Goal = LEAST_SQUARES,
    rule: OutlierRule = RULE,
) -> tuple[FeatureFit, dict[int, float], str]:
    """Identify from all rows but outliers, such as a wrong feature, a tool that slipped, a mistyped joint.

    A row is an outlier by the rule for a tracker's points: far from its feature (`irbcal.identification.outliers`,
    within its kind), or contradicted by all others (`irbcal.identification.leave_one_out.outliers`). It bends the fit,
    so that good rows beside it miss, too: only rows that miss at least half as much as the worst are left out before
    the others are fitted again. Where even the nominal robot cannot be placed among all rows, it is placed among parts
    of them, and rows far from where it then is are left out from the start.

    Parameters
    ----------
    arm : Arm
        Nominal.
    rows : FeatureSet
    terms, progress, goal, rule
        As of `identify_features`.

    Returns
    -------
    fit : FeatureFit
        Of ``fit.problem.rows``: all rows where the outliers are too many, or the rest is too little.
    left_out : dict of int to float
        How far each row that was left out is from its feature, by its row in the file, metres.
    doubt : str
        Why outliers were not left out; empty where they were, or where there are none.

    Raises
    ------
    IdentificationError
        As `identify_features`.
    """
    left_out: dict[int, float] = {}
    placed = _placed_robustly(arm, rows, rule)
    remaining, start = rows, None
    if placed is not None:
        start, distance = placed
        outlier = distance > _limits(rows, distance, rule, "nominal")
        left_out = dict(zip(rows.row[outlier].tolist(), distance[outlier].tolist(), strict=True))
        remaining = rows.select(~outlier)
    fit_of_all: FeatureFit | None = None
    while True:
        contradicting = first_of([*map(str, sorted(left_out))], 10)
        doubt = f"Rows that contradict the others were not left out ({contradicting}): "
        if rule.too_many(len(left_out), len(rows)):
            try:
                fit = fit_of_all or identify_features(arm, rows, terms, progress=progress, goal=goal, rule=rule)
            except IdentificationError as error:
                raise IdentificationError(
                    f"{error}; rows {contradicting} contradict the others ({len(left_out)} of {len(rows)}): look at "
                    "these first"
                ) from None
            return fit, {}, f"{doubt}they are more than {rule.share:.0%} of all rows. Look at these rows first."
        try:
            fit = identify_features(arm, remaining, terms, progress=progress, start=start, goal=goal, rule=rule)
        except IdentificationError as error:
            if fit_of_all is None:
                raise
            return fit_of_all, {}, f"{doubt}without them, {error}"
        fit_of_all = fit_of_all or fit
        remaining, distance = fit.problem.rows, fit.problem.distances(fit.state)
        outlier = distance > _limits(remaining, distance, rule)
        if not outlier.any():
            outlier, distance = fit.outlier_distance > 0.0, fit.outlier_distance
        if not outlier.any():
            return fit, left_out, ""
        outlier &= distance >= 0.5 * distance[outlier].max()
        left_out |= dict(zip(remaining.row[outlier].tolist(), distance[outlier].tolist(), strict=True))
        remaining = remaining.select(~outlier)


def _limits(rows: FeatureSet, distance: FloatArray, rule: OutlierRule, level: Level | None = None) -> FloatArray:
    """Distance from which each row is an outlier, by its kind, metres."""
    limits = {kind: rule.distance_limit(distance[rows.kind == kind], level) for kind in set(rows.kind)}
    return np.array([limits[kind] for kind in rows.kind])


def _placed_robustly(arm: Arm, rows: FeatureSet, rule: OutlierRule) -> tuple[FeatureState, FloatArray] | None:
    """The nominal robot placed among the part of the rows that it fits best, and how far all rows are from it, metres.

    None where it can be placed among all rows, and none is far from it.
    """
    problem = FeatureProblem(arm, rows, ())
    try:
        state = feature_problem.start(problem)
        distance = problem.distances(state)
        far = distance > np.maximum(NOMINAL_FAR, _limits(rows, distance, rule, "nominal"))
        if np.median(distance) < NOMINAL_FAR and not far.any():
            return None
        best = float(np.quantile(distance, TRIMMED_TO)), state
    except IdentificationError:
        best = None
    rng, key = np.random.default_rng(0), rows.feature.astype(str)
    for _ in range(DRAWS):
        order = rng.permutation(len(rows))
        rank = pd.Series(key[order]).groupby(key[order]).cumcount().to_numpy()
        drawn = np.zeros(len(rows), dtype=bool)
        drawn[order[rank < DRAWN]] = True
        for _ in range(3):  # the part that it fits best, from a part drawn at random
            try:
                state = feature_problem.start(FeatureProblem(arm, rows.select(drawn), ()), steps=ROUGH)
            except IdentificationError:
                break
            if not problem.layout.keys() <= state.values.keys():  # a feature or target has no row in this part
                break
            distance = problem.distances(state)
            core = float(np.quantile(distance, TRIMMED_TO))
            best = min((each for each in (best, (core, state)) if each is not None), key=lambda each: each[0])
            drawn = distance <= core
    return None if best is None else (best[1], problem.distances(best[1]))


def _choices(
    superset: Sequence[Term], kind: str, choices: Sequence[Sequence[str]] | None, taus: Sequence[float]
) -> list[TermSet]:
    if choices is None:
        each: list[float | None] = [*taus] or [None]
        candidates_of_kind = [term_set for tau in each for term_set in term_sets.candidates(superset, kind, tau)]
        longest = max((order(term) for term in superset if term.family == "harmonics"), default=0)
        candidates_of_kind = [term_set for term_set in candidates_of_kind if term_set.highest <= longest]
    else:
        candidates_of_kind = [
            term_sets.make(superset, list(names), LOW, taus[-1] if taus else None) for names in choices
        ]
    out: list[TermSet] = []
    for term_set in candidates_of_kind:  # without the longest series some are the same
        if all(not np.array_equal(term_set.terms, earlier.terms) for earlier in out):
            out.append(term_set)
    return out


def _geometry(problem: FeatureProblem, state: FeatureState) -> FeatureState:
    """Base, tool, features and constants by Gauss-Newton steps with their prior, its variance by evidence."""
    model = FeatureModel(problem, state, np.flatnonzero(problem.geometry))
    posterior: Posterior | None = None
    for _ in range(MOST_STEPS):
        posterior = fit_geometry(model, posterior)
        before, model = model, model.improved(posterior.c)
        far = np.abs(posterior.c * model.sizes)[: problem.nuisance].max(initial=0.0)
        if max(far, np.abs(model.state.coefficients - before.state.coefficients).max()) < 1e-7:
            break
    return model.state


def _of_robot(
    problem: FeatureProblem,
    state: FeatureState,
    covariance: FloatArray,
    names: Sequence[str],
    framed: Sequence[str],
    follow: bool,
) -> FloatArray:
    """The covariance of base, targets and terms: features are left out; an unknown base may follow the arm."""
    columns = list(range(6)) if BASE in problem.layout else [-1] * 6
    for label, nouns in ((TOOL, names), ("axes", framed)):
        for name in nouns:
            at = problem.layout[label, name][1]
            columns += range(at, at + 3)
    columns += range(problem.nuisance, len(covariance))
    where = np.array(columns)
    C = covariance[np.ix_(where, where)] * np.outer(where >= 0, where >= 0)
    return _with_base(problem, state, C, names) if BASE not in problem.layout and names and follow else C


def _with_base(problem: FeatureProblem, state: FeatureState, C: FloatArray, names: Sequence[str]) -> FloatArray:
    """The covariance with a base that follows the arm, where nothing ties it to a measuring frame.

    Places are then those among the features: how the arm as a whole stands on its base link (its height along axis 1,
    its zero of joint 1) cannot be seen, and does not count as uncertainty of points.
    """
    nuisance, rows = len(C) - len(problem.terms), problem.rows
    q, usual = _between(rows.q), usual_load(rows.inputs.get("payload_kg"))
    motion = Motion(q, inputs={} if usual is None else {"payload_kg": np.full(len(q), usual)})
    path, values = problem.walk_at(state, motion), partial(problem.term_model.values, motion)
    B, J = [], []
    for k, name in enumerate(names):
        p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], state.values[TOOL, name])
        by_base = np.zeros((len(C), JOINTS, 3))
        by_base[6 + 3 * k : 9 + 3 * k] = path.tip[:3].transpose(0, 2, 1)
        by_base[nuisance:] = problem.term_model.columns(path, values, p).transpose(0, 2, 1)
        B.append(frames.by_motion(p.T))
        J.append(by_base.reshape(len(C), -1))
    A = np.eye(len(C))
    A[:6] = -np.linalg.pinv(np.concatenate(B), rcond=1e-9) @ np.concatenate(J, axis=1).T
    return np.asarray(A @ C @ A.T)


def held_out(
    fit: FeatureFit, rows: FeatureSet, calibrated: bool = True, relations: Sequence[Relation] = ()
) -> tuple[FloatArray, dict[str, float]]:
    """What rows that the fit has not seen miss: features that it has not seen either are fitted again, others stay.

    Parameters
    ----------
    fit : FeatureFit
    rows : FeatureSet
    calibrated : bool
        The calibrated robot, or the nominal one with its own tool.
    relations : sequence of Relation
        What is known between these features, or between them and those of the fit.

    Returns
    -------
    misses : ndarray, shape (rows,)
        Metres.
    residuals : dict of str to float
        Of relations: known minus fitted, metres or radians.

    Raises
    ------
    IdentificationError
        If their tool is not that of the fit.
    """
    state = fit.state if calibrated else fit.nominal_state
    stay = {*fit.problem.rows.target, *fit.problem.rows.features}
    values_kept = {key: value for key, value in state.values.items() if key[0] == TOOL or key[1] in stay}
    strange = sorted(set(rows.target.astype(str)) - {key[1] for key in values_kept})
    if strange:
        raise IdentificationError(f"target {strange[0]} is measured in the left-out rows only: its place is not known")
    base = {BASE: state.T_world_base}
    # what is known between them is a test of the robot here: it must not place them
    problem = FeatureProblem(fit.problem.arm, replace(rows, relations=()), fit.problem.terms, {**values_kept, **base})
    placed = feature_problem.start_of_features(problem, state)
    of_rows = [relation for relation in relations if {relation.first, relation.second} & set(rows.features)]
    return problem.distances(placed), relation_residuals(of_rows, {**state.values, **placed.values})


def as_points(features: FeatureSet) -> PointSet:
    """Rows as points without measured places (zeros stand for them), one pose a row group."""
    _, first, pose = np.unique(features.pose_index, return_index=True, return_inverse=True)
    order = np.argsort(pose, kind="stable")
    names = tuple(sorted(set(features.target.astype(str))))
    target = np.array([names.index(str(name)) for name in features.target], dtype=int)
    groups = features.left_out_together("place") if "place" in features.cells.columns else features.left_out_together()
    return PointSet(
        features.q[first],
        pose[order],
        target[order],
        np.zeros((len(features), 3)),
        names,
        features.pose[first],
        groups[first],
        inputs=at_rows(features.inputs, first),
    )


def shape_only(features: FeatureSet) -> bool:
    """Whether (nearly) all rows say no more than that points lie in planes or on lines of unknown place."""
    shapes = {name for name in features.kinds() if name in KINDS and KINDS[name].shape_only}
    of_position = sum(count for name, count in features.kinds().items() if name not in shapes)
    return (
        bool(shapes)
        and of_position < 10
        and not any(RELATION_KINDS[relation.kind].metric for relation in features.relations)
    )
