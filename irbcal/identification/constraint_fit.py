"""Identification from rows at features, by the evidence of model ``auto``: what they leave open stays near nominal.

Base, tool and features have no prior; the terms of the error model have the priors of `irbcal.identification.mackay`,
whose variances the data set. Choices of terms are compared and averaged as in `irbcal.identification.evidence`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import constraint_start, dictionaries, mackay, shown
from irbcal.identification.constraint_problem import (
    BASE,
    TOOL,
    ConstraintProblem,
    FeatureState,
    Key,
    refuse_undetermined,
)
from irbcal.identification.constraints import DIMENSIONS, cross, length_misses
from irbcal.identification.dictionaries import Dictionary
from irbcal.identification.evidence import Compared, groups_of
from irbcal.identification.evidence_fit import DictionaryResult, EvidenceFit
from irbcal.identification.leave_one_out import closed, single
from irbcal.identification.mackay import Posterior
from irbcal.identification.sums import Sums
from irbcal.measurement.feature_loads import usual_place
from irbcal.measurement.features import FeatureSet, Length
from irbcal.measurement.motions import usual_load
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.harmonics import LOW, order
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
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
    terms: str = dictionaries.JOINT_MAP,
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
        ``joint-map`` or ``all``, see `irbcal.identification.dictionaries`.
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
    superset = dictionaries.superset(arm, terms, elapsed is not None, place, taus, end=end)
    if not seen.programmed:
        superset = [t for t in superset if t.family != "harmonics" or order(t) <= HIGHEST]
    problem = ConstraintProblem(arm, seen, superset)
    say(f"placing tool and features of {seen.poses} poses")
    nominal = constraint_start.start(problem) if start is None else constraint_start.settle(problem, start)
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
) -> list[Dictionary]:
    if choices is None:
        each: list[float | None] = [*taus] or [None]
        found = [one for tau in each for one in dictionaries.dictionaries(superset, kind, tau)]
        longest = max((order(term) for term in superset if term.family == "harmonics"), default=0)
        found = [one for one in found if one.highest <= longest]
    else:
        found = [dictionaries.make(superset, list(names), LOW, taus[-1] if taus else None) for names in choices]
    out: list[Dictionary] = []
    for one in found:  # without the longest series some are the same
        if all(not np.array_equal(one.terms, other.terms) for other in out):
            out.append(one)
    return out


def _geometry(problem: ConstraintProblem, state: FeatureState, t: float) -> FeatureState:
    """Base, tool, features and constants by Gauss-Newton steps with their prior, its variance by evidence."""
    columns = np.flatnonzero(problem.geometry)
    group, caps = np.zeros(len(columns), dtype=int), np.array([mackay.GEOMETRY_CAP])
    found: Posterior | None = None
    for _ in range(STEPS):
        v, s2 = (None, None) if found is None else (found.variances, found.s2)
        found = mackay.fit(problem.sums(state, columns), problem.flat, group, caps, t, v, s2, noise=problem.noise)
        step = np.zeros(problem.flat + len(problem.terms))
        step[: problem.flat], step[problem.flat + columns] = found.c[: problem.flat], found.c[problem.flat :]
        before, state = state, problem.moved(state, step)
        far = np.abs(found.c[: problem.flat] * problem.sizes[: problem.flat]).max(initial=0.0)
        if max(far, np.abs(state.coefficients - before.coefficients).max()) < 1e-7:
            break
    return state


def _compare(problem: ConstraintProblem, sums: Sums, offered: Sequence[Dictionary], t_fit: float) -> list[Compared]:
    """Log evidence and weight of every choice; fits of those with weight."""
    t = min(1.0, 3.0 / problem.per_pose)
    out = []
    for one in offered:
        part = sums.part(one.columns(problem.flat))
        out.append(Compared(one, mackay.fit(part, problem.flat, one.group, one.caps, t, noise=problem.noise)))
    shares = dictionaries.weights(
        np.array([item.by_evidence.log_evidence for item in out]), [item.dictionary.bands for item in out]
    )
    for item, share in zip(out, shares, strict=True):
        item.weight = float(share)
        if share > 0.0:
            d, old = item.dictionary, item.by_evidence
            item.by_fit = mackay.fit(
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
            fit = mackay.fit(part, flat, d.group, d.caps, t, old.variances, old.s2, noise=problem.noise)
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


def _shown(problem: ConstraintProblem, item: Compared, sums: Sums) -> tuple[shown.FamilyShown, ...]:
    assert item.by_fit is not None
    families = [problem.terms[k].family for k in item.dictionary.terms]
    t = min(1.0, 3.0 / problem.per_pose)
    return shown.families_shown(sums, problem.flat, families, item.dictionary, t, item.by_fit)


def _evidence(
    problem: ConstraintProblem,
    state: FeatureState,
    covariance: FloatArray,
    kept: Sequence[Compared],
    compared: Sequence[Compared],
    loo: Mapping[str, float | None],
    families: tuple[shown.FamilyShown, ...],
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
            DictionaryResult(
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
        tau=dictionaries.tau_of(max(kept, key=lambda item: item.weight).dictionary, _superset_of(problem, kept)),
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
    there = constraint_start.start_of_features(problem, state)
    centres = {key[1]: value for key, value in {**state.own, **there.own}.items() if key[0] == "centre"}
    mine_too = [one for one in lengths if {one.first, one.second} & set(rows.features)]
    errors = {
        one.name: length_misses(centres[one.first], centres[one.second], one.length)[0]
        for one in mine_too
        if one.first in centres and one.second in centres
    }
    return problem.residuals(there), errors
