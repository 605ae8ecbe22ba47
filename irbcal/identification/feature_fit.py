"""Identification from rows at features, by the evidence of model ``auto``: what they leave open stays near nominal.

Base, tool and features have no prior; the terms of the error model have the priors of
`irbcal.identification.evidence_maximisation`, whose variances the data set. Term sets are compared and averaged as in
`irbcal.identification.evidence`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import feature_problem, term_sets
from irbcal.identification.evidence import Compared, groups_of
from irbcal.identification.evidence_fit import AveragedFit, EvidenceFit, FamilyShown, TermSetResult, families_shown
from irbcal.identification.evidence_maximisation import GEOMETRY_CAP, Posterior, Sums, maximise_evidence
from irbcal.identification.feature_problem import BASE, TOOL, ConstraintProblem, FeatureState, Key, refuse_undetermined
from irbcal.identification.fit import ParameterReport
from irbcal.identification.leave_one_out import closed, single
from irbcal.identification.observations import DIMENSIONS, KINDS, cross, length_misses
from irbcal.identification.term_sets import TermSet
from irbcal.measurement.feature_loads import usual_place
from irbcal.measurement.features import FeatureSet, Length
from irbcal.measurement.motions import usual_load
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.harmonics import LOW, order
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import basis_values, term_columns
from irbcal.modeling.terms.warm_up import SHARES
from irbcal.units import MM

STEPS = 20
"""Gauss-Newton steps of the geometry at most."""

HIGHEST = 12
"""Highest order of harmonics compared where rows are no program: they are too few for longer series."""

FEWEST = 10
"""Poses that are needed."""

BETWEEN = 200
"""Random joints between those of the rows, at which an unknown base follows the arm."""

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class FeatureFit:
    """A robot identified from rows at features.

    Attributes
    ----------
    evidence : EvidenceFit
    state : FeatureState
        Base, tool, features, and the coefficients of ``problem.terms``.
    problem : ConstraintProblem
    nominal : FeatureState
        Base, tool and features of the nominal robot, from the same rows.
    covariance : ndarray, shape (flat + terms, flat + terms)
        Of steps of the problem's flat unknowns and coefficients, SI units.
    """

    evidence: EvidenceFit
    state: FeatureState
    problem: ConstraintProblem
    nominal: FeatureState
    covariance: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    def std(self, key: Key) -> FloatArray:
        """Standard deviations of an unknown of tool or features, SI units."""
        shape, at = self.problem.layout[key]
        size = 6 if shape is None else DIMENSIONS[shape]
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance)[at : at + size], 0.0)))


def identify_features(
    arm: Arm,
    seen: FeatureSet,
    terms: str = term_sets.JOINT_MAP,
    choices: Sequence[Sequence[str]] | None = None,
    progress: Progress | None = None,
    start: FeatureState | None = None,
    bare: bool = False,
) -> FeatureFit:
    """Identify base, tool, features and the averaged terms.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    seen : FeatureSet
    terms : str
        ``joint-map`` or ``all``, see `irbcal.identification.term_sets`.
    choices : sequence of sequence of str, optional
        Families beside the geometry in each choice of terms; those of model ``auto`` unless given.
    progress : callable, optional
    start : FeatureState, optional
        The nominal robot among the features, where it is known from more rows.
    bare : bool
        Leave out what only a report asks for: leave-one-out errors and what the rows show.

    Returns
    -------
    FeatureFit

    Raises
    ------
    IdentificationError
        If the rows leave base, tool or features open, or are too few.
    """
    say = progress or (lambda text: None)
    if seen.poses < FEWEST:
        raise IdentificationError(
            f"{seen.poses} poses at features are too few to identify a robot: at least {FEWEST} are needed, 50 or more "
            "are better"
        )
    elapsed = seen.motion().elapsed
    end = None if elapsed is None else float(elapsed.max())
    taus = [] if elapsed is None else [share * float(np.ptp(elapsed)) for share in SHARES]
    load = seen.payload_kg
    several = load is not None and len(np.unique(load)) > 1
    place = usual_place(load, seen.payload_place, usual_load(load)) if load is not None and several else None
    superset = term_sets.superset(arm, terms, elapsed is not None, place, taus, end=end)
    if not seen.programmed:
        superset = [t for t in superset if t.family != "harmonics" or order(t) <= HIGHEST]
    problem = ConstraintProblem(arm, seen, superset)
    say(f"placing tool and features of {seen.poses} poses")
    nominal = feature_problem.start(problem) if start is None else feature_problem.settle(problem, start)
    refuse_undetermined(problem, problem.sums(nominal, np.zeros(0, dtype=int)))
    say("fitting the geometry")
    t = min(1.0, 6.0 / problem.per_pose)
    state = _geometry(problem, nominal, t)
    sums = problem.sums(state)
    offered = _choices(superset, terms, choices, taus)
    say(f"comparing {len(offered)} choices of terms")
    compared = _compare(problem, sums, offered, t)
    say("averaging")
    return _average(problem, state, nominal, compared, t, terms, bare)


def _choices(
    superset: Sequence[Term], kind: str, choices: Sequence[Sequence[str]] | None, taus: Sequence[float]
) -> list[TermSet]:
    if choices is None:
        each: list[float | None] = [*taus] or [None]
        found = [one for tau in each for one in term_sets.term_sets(superset, kind, tau)]
        longest = max((order(term) for term in superset if term.family == "harmonics"), default=0)
        found = [one for one in found if one.highest <= longest]
    else:
        found = [term_sets.make(superset, list(names), LOW, taus[-1] if taus else None) for names in choices]
    out: list[TermSet] = []
    for one in found:  # without the longest series some are the same
        if all(not np.array_equal(one.terms, other.terms) for other in out):
            out.append(one)
    return out


def _geometry(problem: ConstraintProblem, state: FeatureState, t: float) -> FeatureState:
    """Base, tool, features and constants by Gauss-Newton steps with their prior, its variance by evidence."""
    columns = np.flatnonzero(problem.geometry)
    group, caps = np.zeros(len(columns), dtype=int), np.array([GEOMETRY_CAP])
    found: Posterior | None = None
    for _ in range(STEPS):
        v, s2 = (None, None) if found is None else (found.variances, found.s2)
        found = maximise_evidence(
            problem.sums(state, columns), problem.flat, group, caps, t, v, s2, noise=problem.noise
        )
        step = np.zeros(problem.flat + len(problem.terms))
        step[: problem.flat], step[problem.flat + columns] = found.c[: problem.flat], found.c[problem.flat :]
        before, state = state, problem.moved(state, step)
        far = np.abs(found.c[: problem.flat] * problem.sizes[: problem.flat]).max(initial=0.0)
        if max(far, np.abs(state.coefficients - before.coefficients).max()) < 1e-7:
            break
    return state


def _compare(problem: ConstraintProblem, sums: Sums, offered: Sequence[TermSet], t_fit: float) -> list[Compared]:
    """Log evidence and weight of every choice; fits of those with weight."""
    t = min(1.0, 3.0 / problem.per_pose)
    out = []
    for one in offered:
        part = sums.part(one.columns(problem.flat))
        out.append(Compared(one, maximise_evidence(part, problem.flat, one.group, one.caps, t, noise=problem.noise)))
    shares = term_sets.weights(
        np.array([item.by_evidence.log_evidence for item in out]), [item.dictionary.bands for item in out]
    )
    for item, share in zip(out, shares, strict=True):
        item.weight = float(share)
        if share > 0.0:
            d, old = item.dictionary, item.by_evidence
            item.by_fit = maximise_evidence(
                sums.part(d.columns(problem.flat)),
                problem.flat,
                d.group,
                d.caps,
                t_fit,
                old.variances,
                old.s2,
                noise=problem.noise,
            )
    return out


def _average(
    problem: ConstraintProblem,
    state: FeatureState,
    nominal: FeatureState,
    compared: list[Compared],
    t: float,
    kind: str,
    bare: bool,
) -> FeatureFit:
    """The mean of the choices with weight, fitted once more in the linear model at their first mean."""
    kept = [item for item in compared if item.weight > 0.0]
    union = np.unique(np.concatenate([item.dictionary.terms for item in kept]))
    flat = problem.flat
    width = flat + len(union)
    places = [np.concatenate([np.arange(flat), flat + np.searchsorted(union, i.dictionary.terms)]) for i in kept]
    for again in (True, False):
        blocks = list(problem.dense(state, union))
        J, y = np.concatenate([b.J for b in blocks], axis=1), np.concatenate([b.y for b in blocks])
        row = np.concatenate([b.row for b in blocks])
        sums = Sums(J @ J.T, J @ y, float(y @ y), len(y))
        mean, second = np.zeros(width), np.zeros((width, width))
        for item, columns in zip(kept, places, strict=True):
            d, old = item.dictionary, item.by_fit
            assert old is not None
            part = sums.part(columns)
            fit = maximise_evidence(part, flat, d.group, d.caps, t, old.variances, old.s2, noise=problem.noise)
            item.by_fit = fit
            c, C = np.zeros(width), np.zeros((width, width))
            c[columns], C[np.ix_(columns, columns)] = fit.c, fit.covariance * _wider(fit) ** 2
            mean += item.weight * c
            second += item.weight * (C + np.outer(c, c))
        if again:
            step = np.zeros(flat + len(problem.terms))
            step[:flat], step[flat + union] = mean[:flat], mean[flat:]
            state = problem.moved(state, step)
    covariance = second - np.outer(mean, mean)
    top = max(range(len(kept)), key=lambda k: kept[k].weight)
    loo = {} if bare else _left_out(problem, kept, places, J, y, row, t)
    families = () if bare else _shown(problem, kept[top], sums.part(places[top]))
    scale = np.concatenate([problem.sizes[:flat], problem.sizes[flat + union]])
    smaller = ConstraintProblem(
        problem.arm, problem.seen, [problem.terms[k] for k in union], problem.held, problem.known_base
    )
    state = replace(state, coefficients=state.coefficients[union])
    nominal = replace(nominal, coefficients=nominal.coefficients[union])
    covariance = covariance * np.outer(scale, scale)
    evidence = _evidence(smaller, state, covariance, kept, compared, loo, families, kind)
    return FeatureFit(evidence, state, smaller, nominal, covariance)


def _wider(fit: Posterior) -> float:
    """Student's factor on deviations from few rows, which tell their own noise but roughly: 1.96 of them hold 95 %."""
    from scipy.special import stdtrit

    return float(stdtrit(fit.freedom, 0.975)) / 1.96


def _left_out(
    problem: ConstraintProblem,
    kept: Sequence[Compared],
    places: Sequence[IntArray],
    J: FloatArray,
    y: FloatArray,
    row: IntArray,
    t: float,
) -> dict[str, float | None]:
    """Root mean square length that a place would be missed by with its pose left out, by target, metres.

    A row of one equation tells one direction; the others are taken for as large. None where a row depends on a
    direction that is open without its pose.
    """
    pose = np.where(row < 0, -1 - np.arange(len(row)), problem.seen.pose_index[row])
    order = np.argsort(pose, kind="stable")
    u = np.zeros(len(y))
    for item, columns in zip(kept, places, strict=True):
        fit = item.by_fit
        assert fit is not None
        e = y - fit.c @ J[columns]
        part = np.ascontiguousarray(J[columns][:, order])
        own = single(part, e[order], pose[order], fit.covariance, t / fit.s2)
        u[order] += item.weight * own
        item.loo = _length(own[row[order] >= 0])
    mine = row >= 0
    target = np.where(mine, problem.seen.target[row], "")
    return {"": _length(u[mine])} | {str(name): _length(u[target == name]) for name in sorted(set(target[mine]))}


def _length(u: FloatArray) -> float | None:
    """Root mean square length in metres of vectors of which one coordinate is known (n,), mm."""
    return closed(float(np.sqrt(3.0 * np.mean(u * u))) * MM)


def _shown(problem: ConstraintProblem, item: Compared, sums: Sums) -> tuple[FamilyShown, ...]:
    assert item.by_fit is not None
    families = [problem.terms[k].family for k in item.dictionary.terms]
    t = min(1.0, 3.0 / problem.per_pose)
    return families_shown(sums, problem.flat, families, item.dictionary, t, item.by_fit)


def _evidence(
    problem: ConstraintProblem,
    state: FeatureState,
    covariance: FloatArray,
    kept: Sequence[Compared],
    compared: Sequence[Compared],
    loo: Mapping[str, float | None],
    families: tuple[FamilyShown, ...],
    kind: str,
) -> EvidenceFit:
    """What of it every calibration has: features are left out of the covariance, an unknown base follows the arm."""
    flat, seen = problem.flat, problem.seen
    names = sorted({key[1] for key in problem.layout if key[0] == TOOL})
    framed = sorted({key[1] for key in problem.layout if key[0] == "axes" and key[1] in set(seen.target)})
    columns: list[int] = [-1] * 6
    if BASE in problem.layout:
        columns = list(range(6))
    for label, of in ((TOOL, names), ("axes", framed)):
        for name in of:
            at = problem.layout[label, name][1]
            columns += range(at, at + 3)
    columns += range(flat, len(covariance))
    where = np.array(columns)
    C = covariance[np.ix_(where, where)] * np.outer(where >= 0, where >= 0)
    if BASE not in problem.layout and names and loo:
        C = _with_base(problem, state, C, names)
    fits = [item.by_fit for item in kept if item.by_fit is not None]
    shares = np.array([item.weight for item in kept])
    return EvidenceFit(
        nominal=problem.arm,
        arm=problem.arm_of(state),
        terms=tuple(problem.terms),
        coefficients=state.coefficients,
        covariance=C,
        T_world_base=state.T_world_base,
        targets={name: state.own[TOOL, name] for name in names},
        free_targets=tuple(names),
        framed_targets=tuple(framed),
        target_rotations={name: state.own["axes", name] for name in framed},
        sigma=float(np.sqrt(shares @ [fit.s2 for fit in fits])) * MM,
        loo=loo,
        loo_blocks=loo,
        dictionaries=tuple(
            TermSetResult(
                item.dictionary.name,
                flat + len(item.dictionary.terms),
                item.by_evidence.log_evidence,
                item.weight,
                None if item.by_fit is None else float(np.sqrt(item.by_fit.s2)) * MM,
                item.loo,
                item.dictionary.bands,
            )
            for item in compared
        ),
        groups=tuple(groups_of(list(kept), list(_superset_of(problem, kept)))),
        families=families,
        gears=(),
        joint_ranges=np.array([seen.q.min(axis=0), seen.q.max(axis=0)]),
        kind=kind,
        tau=term_sets.tau_of(max(kept, key=lambda item: item.weight).dictionary, _superset_of(problem, kept)),
        poses=seen.poses,
        loads=() if seen.payload_kg is None else tuple(float(m) for m in np.unique(seen.payload_kg)),
        usual_kg=usual_load(seen.payload_kg),
    )


def _with_base(problem: ConstraintProblem, state: FeatureState, C: FloatArray, names: list[str]) -> FloatArray:
    """The covariance with a base that follows the arm, where nothing ties it to a measuring frame.

    Places are then those among the features: how the arm as a whole stands on its base link (its height along axis 1,
    its zero of joint 1) cannot be seen, and does not count as uncertainty of points.
    """
    flat, seen = len(C) - len(problem.terms), problem.seen
    rng = np.random.default_rng(0)
    one, other = (rng.integers(len(seen), size=BETWEEN) for _ in range(2))
    q = seen.q[one] + rng.uniform(size=(BETWEEN, 1)) * (seen.q[other] - seen.q[one])
    usual = usual_load(seen.payload_kg)
    motion = Motion(q, payload_kg=None if usual is None else np.full(len(q), usual))
    path = chain.walk(problem.arm_of(state), *problem.term_map(state).split(motion))
    B, J = [], []
    for k, name in enumerate(names):
        p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], state.own[TOOL, name])
        rigid = np.concatenate([-cross(p.T), np.broadcast_to(np.eye(3), (BETWEEN, 3, 3))], axis=2)
        here = np.zeros((len(C), BETWEEN, 3))
        here[6 + 3 * k : 9 + 3 * k] = path.tip[:3].transpose(0, 2, 1)
        here[flat:] = problem.points_by_terms(path, p.T, motion).transpose(0, 2, 1)
        B.append(rigid.reshape(-1, 6))
        J.append(here.reshape(len(C), -1))
    follow = -np.linalg.pinv(np.concatenate(B), rcond=1e-9) @ np.concatenate(J, axis=1).T
    A = np.eye(len(C))
    A[:6] = follow
    return np.asarray(A @ C @ A.T)


def _superset_of(problem: ConstraintProblem, kept: Sequence[Compared]) -> list[Term]:
    """Terms by the numbers that the choices count with."""
    union = np.unique(np.concatenate([item.dictionary.terms for item in kept]))
    out: list[Term] = [problem.terms[0]] * (int(union.max()) + 1)
    for k, term in zip(union, problem.terms, strict=True):
        out[k] = term
    return out


def held_out(
    fit: FeatureFit, rows: FeatureSet, calibrated: bool = True, lengths: Sequence[Length] = ()
) -> tuple[FloatArray, dict[str, float]]:
    """What rows that the fit has not seen miss: features that it has not seen either are placed anew, others stay.

    Parameters
    ----------
    fit : FeatureFit
    rows : FeatureSet
    calibrated : bool
        The calibrated robot, or the nominal one with its own tool.
    lengths : sequence of Length
        Known lengths between these features, or from these to those of the fit.

    Returns
    -------
    misses : ndarray, shape (rows,)
        Metres.
    lengths : dict of str to float
        Found minus known, metres.

    Raises
    ------
    IdentificationError
        If their tool is not that of the fit.
    """
    state = fit.state if calibrated else fit.nominal
    stay = {*fit.problem.seen.target, *fit.problem.seen.features}
    mine = {key: value for key, value in state.own.items() if key[0] == TOOL or key[1] in stay}
    strange = sorted(set(rows.target.astype(str)) - {key[1] for key in mine})
    if strange:
        raise IdentificationError(f"target {strange[0]} is measured in the left-out rows only: its place is not known")
    problem = ConstraintProblem(fit.problem.arm, rows, fit.problem.terms, mine, state.T_world_base)
    there = feature_problem.start_of_features(problem, state)
    centres = {key[1]: value for key, value in {**state.own, **there.own}.items() if key[0] == "centre"}
    mine_too = [one for one in lengths if {one.first, one.second} & set(rows.features)]
    errors = {
        one.name: length_misses(centres[one.first], centres[one.second], one.length)[0]
        for one in mine_too
        if one.first in centres and one.second in centres
    }
    return problem.residuals(there), errors


BASE_REASON = "nothing ties the features to a measuring frame: places are those of the base link"

TOO_LARGE = 2e-3
"""Share by which a robot may come out larger than nominal before what gave the scale is doubted."""

JOINTS = 200
"""Random joints on which it is asked what the rows leave open."""


@dataclass(frozen=True, eq=False, repr=False)
class FeaturedFit(AveragedFit):
    """An average of error models from rows at features.

    Attributes
    ----------
    found : FeatureFit or None
        Always there; last because of what it derives from.
    """

    found: FeatureFit | None = None

    @staticmethod
    def of(found: FeatureFit) -> FeaturedFit:
        """With the names of a fit to points."""
        points = as_points(found.problem.seen)
        load, place = points.payload_kg, points.payload_place
        motion = Motion(points.q, payload_kg=load, payload_place=place)
        return FeaturedFit(found.evidence, points, motion, found=found)

    @property
    def at_features(self) -> FeatureFit:
        """What was found, features and all."""
        assert self.found is not None
        return self.found

    @property
    def rms(self) -> float:
        """Root mean square of what the rows miss, metres."""
        return float(np.sqrt(np.mean(self.at_features.problem.residuals(self.at_features.state) ** 2)))

    @property
    def nominal_robot(self) -> Robot:
        """The nominal robot with base and tool from the same rows."""
        found = self.at_features
        own = found.nominal.own
        rotations = {name: own["axes", name] for name in self.evidence.target_rotations}
        targets = {name: own[TOOL, name] for name in self.evidence.targets}
        return Robot(
            found.problem.arm, T_world_base=found.nominal.T_world_base, targets=targets, target_rotations=rotations
        )

    @property
    def rank(self) -> int:
        """Number of coefficients that the data determine, base and targets included where they are unknown."""
        return super().rank - (0 if BASE in self.at_features.problem.layout else 6)

    @property
    def parameter_count(self) -> int:
        """Number of parameters of the robot; those of the features are not among them."""
        return super().parameter_count - (0 if BASE in self.at_features.problem.layout else 6)

    def _outer(self) -> list[ParameterReport]:
        """Base and targets; a base that nothing ties to a measuring frame is held."""
        rows = super()._outer()
        if BASE in self.at_features.problem.layout:
            return rows
        return [
            ParameterReport(r.name, r.value, r.unit, None, "held", BASE_REASON) if r.name.startswith("base_") else r
            for r in rows
        ]

    @property
    def scale_measured(self) -> bool:
        """Whether some row or feature tells a length of the size of the arm."""
        problem = self.at_features.problem
        known = [group for group in problem.groups if group.feature.centre is not None or group.measured]
        return bool(problem.seen.lengths or known or any(group.kind.metric for group in problem.groups))

    @property
    def scale_from(self) -> str:
        """What gives the robot its scale where nothing but parts of features does, in words."""
        problem = self.at_features.problem
        metric = [group for group in problem.groups if group.kind.metric]
        words = list(dict.fromkeys(group.kind.scale_of(group.feature) for group in metric))
        others = [group for group in problem.groups if group.feature.centre is not None or group.measured]
        return "" if problem.seen.lengths or others or "" in words else " and ".join(words)

    def doubts(self) -> list[str]:
        """What speaks against what was known beforehand of features: their own doubts, and fitted numbers far away."""
        problem, state = self.at_features.problem, self.at_features.state
        found = [one.group.kind.doubt(one.seen, one.found) for one in problem.misses(state)]
        for (name, of), known in problem.expected.items():
            value = float(state.own[name, of][0])
            if abs(value - known.value[0]) > 2.0 * known.u95:
                found.append(
                    f"{name} of {of} comes out at {value:.6g}, {known.value[0]:.6g} was said: images and poses that "
                    "do not belong together, or a lens that is another."
                )
        larger = self._larger()
        if self.scale_from and abs(larger) > TOO_LARGE:
            found.append(
                f"The robot comes out {abs(larger):.2%} {'larger' if larger > 0 else 'smaller'} than nominal, and its "
                f"scale rests on {self.scale_from}: measure these."
            )
        return [text for text in dict.fromkeys(found) if text]

    def _larger(self) -> float:
        """Share by which the calibrated arm is larger than the nominal one."""
        nominal, own = self.at_features.problem.arm, self.evidence.arm
        q = nominal.random_joints(JOINTS, 0)
        a, b = (arm.forward(q)[:, :3, 3] for arm in (nominal, own))
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        return float(np.linalg.svd(a.T @ b, compute_uv=False).sum() / (a**2).sum()) - 1.0

    def left_open(self) -> tuple[float, float]:
        """What is not known of where the tool's point is, before and after: root mean square lengths, metres.

        At joints between those of the rows: from the variances that the data gave the terms, and from what is left of
        them. How the arm as a whole stands does not count, nor before the rows where the point is on the tool.
        """
        found = self.evidence
        q, rng = self.at_features.problem.seen.q, np.random.default_rng(0)
        one, other = (q[rng.integers(len(q), size=JOINTS)] for _ in range(2))
        motion = found.motion(one + rng.uniform(size=(JOINTS, 1)) * (other - one))
        path = chain.walk(found.nominal, motion.q)
        pose = np.arange(JOINTS)
        sizes = {group.name: group.size for group in found.groups}
        flat = len(found.covariance) - len(found.terms)
        constant = np.array([t.family == "geometry" for t in found.terms], dtype=bool)
        values = basis_values(found.terms, Situation(found.nominal, motion))
        prior = np.array([(sizes.get(t.group, 0.0) * t.size) ** 2 for t in found.terms])
        worst = 0.0, 0.0
        for k, name in enumerate(found.free_targets or ("",)):
            tool = found.targets.get(name, np.zeros(3))
            p = path.tip[3] + np.einsum("acm,a->cm", path.tip[:3], tool)
            J = np.zeros((3 + len(found.terms), 3, JOINTS))
            J[:3] = path.tip[:3] if found.free_targets else 0.0
            for part in (True, False):
                rows = np.flatnonzero(constant == part)
                terms = [found.terms[j] for j in rows]
                J[3 + rows] = term_columns(terms, chain.point_columns(path, p, pose, part), values[rows], pose)
            B = np.concatenate([-cross(p.T), np.broadcast_to(np.eye(3), (JOINTS, 3, 3))], axis=2).reshape(-1, 6)
            across = J.transpose(0, 2, 1).reshape(len(J), -1)
            across = across - (across @ B) @ np.linalg.pinv(B)
            G = across @ across.T / JOINTS
            columns = np.r_[6 + 3 * k : 9 + 3 * k, flat : len(found.covariance)]
            left = float(np.sqrt(np.sum(G * found.covariance[np.ix_(columns, columns)])))
            if left >= worst[1]:
                worst = float(np.sqrt(prior @ np.diagonal(G)[3:])), left
        return worst


def as_points(seen: FeatureSet) -> PointSet:
    """Rows as points without measured places (zeros stand for them), one pose a row group."""
    _, first, pose = np.unique(seen.pose_index, return_index=True, return_inverse=True)
    order = np.argsort(pose, kind="stable")
    names = tuple(sorted(set(seen.target.astype(str))))
    target = np.array([names.index(str(name)) for name in seen.target], dtype=int)
    groups = seen.places("place") if "place" in seen.cells.columns else seen.places()
    return PointSet(
        seen.q[first],
        pose[order],
        target[order],
        np.zeros((len(seen), 3)),
        names,
        seen.pose[first],
        groups[first],
        payload_kg=None if seen.payload_kg is None else seen.payload_kg[first],
        payload_place=None if seen.payload_place is None else seen.payload_place[first],
    )


def shape_only(seen: FeatureSet) -> bool:
    """Whether (nearly) all rows say no more than that points lie in planes or on lines of unknown place."""
    others = sum(count for name, count in seen.kinds().items() if name in KINDS and not KINDS[name].shape_only)
    return others < 10 and not seen.lengths


def frames_of(value: FloatArray) -> FloatArray:
    """Angles about x, y and z of a rotation (3, 3), radians."""
    return frames.to_xyz_angles(frames.transform(value))[3:]
