"""Identification by evidence: many term sets, each with its prior variances from the data, averaged.

The largest model that data support is not chosen but weighed: every term set is fitted in one linearisation about the
geometry solution, and coefficients, base and targets are averaged with weights from the log evidence. What the data do
not show shrinks to nothing and keeps its prior's standard deviation. Repeats of one stop are averaged first: they tell
of the tracker's noise, not of the robot's errors elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import gear_scan, leave_one_out, linear_model, term_sets
from irbcal.identification.evidence_fit import (
    COMPARED,
    AveragedFit,
    EvidenceFit,
    FamilyShown,
    GearFound,
    GroupResult,
    Sisters,
    TermSetResult,
    families_shown,
)
from irbcal.identification.evidence_maximisation import Posterior, Sums, evidence_temper, fit_temper, maximise_evidence
from irbcal.identification.linear_model import Linearisation
from irbcal.identification.term_sets import TermSet
from irbcal.identification.type_prior import WIDE, TypePrior, chi_square_of_type, like_type, taken
from irbcal.measurement.motions import usual_load
from irbcal.measurement.points import PointSet
from irbcal.measurement.sessions import into_one_frame
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.warm_up import SHARES
from irbcal.units import MM

FEWEST = 10
"""Poses below which there is nothing to compare."""
GIVE_UP = 80.0
"""Nats below the best dictionary at which another one can have no weight, with room for what iterations still gain."""
READINGS_GATE = 1.5
"""Factor by which the residuals must fall for readings to count as taken before the arm stood still, beyond what a few
poses leave to chance."""
GATE_CERTAINTY = 0.95
LAG_FAMILIES = ("move",)
"""Families that cannot be told from readings that lag: joints lag by somewhat different shares of their moves. Where
readings lag these terms are fitted, but count as part of the lag, and are none of the robot's."""

Progress = Callable[[str], None]


def identify_evidence(
    arm: Arm,
    points: PointSet,
    motion: Motion | None = None,
    *,
    terms: str = term_sets.JOINT_MAP,
    gear_scan: bool = True,
    seed: int = 0,
    known_targets: dict[str, FloatArray] | None = None,
    payload_place: Sequence[float] | None = None,
    usual_kg: float | None = None,
    prior: TypePrior | None = None,
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
        ``joint-map`` or ``all``, see `irbcal.identification.term_sets`.
    gear_scan : bool
        Look for single high harmonics, unless the best dictionary has long series of them.
    seed : int
        Of the poses on which dictionaries are compared where there are more than `COMPARED`.
    known_targets : dict of str to ndarray, shape (3,), optional
        Targets whose places in the tip link are known, metres.
    payload_place : sequence of three float, optional
        Centre of the payload in the tip link where the motion does not tell it, metres; the tip unless given.
    usual_kg : float, optional
        The load of predictions where none is given; the one of most poses unless given.
    prior : TypePrior, optional
        What calibrated robots of the same type show. Choices of terms with it compete by their evidence with those
        without: a robot that is not like its sisters is identified without.
    progress : callable, optional
        Called with a short text at each step.

    Returns
    -------
    EvidenceFit

    Raises
    ------
    IdentificationError
        If the data do not allow it, or ``terms`` is not one of the two.

    Examples
    --------
    >>> seen = cleaning.clean(irbcal.read_measurements("m.csv")).points  # doctest: +SKIP
    >>> identify_evidence(irbcal.read_urdf("irb120").arm, seen, Motion.in_order(seen.q))  # doctest: +SKIP
    """
    if terms not in (term_sets.JOINT_MAP, term_sets.ALL):
        raise IdentificationError(f"terms are joint-map or all, not {terms!r}")
    say = progress or (lambda text: None)
    motion = Motion(points.q) if motion is None else motion
    if motion.q.shape != points.q.shape:
        raise IdentificationError(f"the motion has {len(motion)} stops, the points {points.poses} poses")
    points, motion = average_repeats(replace(points, q=np.array(motion.q)), motion)
    work = _Work(arm, points, motion, terms, known_targets, payload_place, usual_kg, seed, prior)
    say("fitting the geometry")
    work.prepare()
    say(f"comparing {len(work.dictionaries)} choices of terms")
    work.compare()
    found = work.scan(say) if gear_scan else []
    say("averaging")
    return work.average(found)


def prepared(arm: Arm, points: PointSet, motion: Motion) -> _Work:
    """Geometry solution, superset of terms and its sums, ready for comparisons."""
    points, motion = average_repeats(replace(points, q=np.array(motion.q)), motion)
    work = _Work(arm, points, motion, term_sets.JOINT_MAP, None, None, None, 0)
    work.prepare()
    return work


@dataclass(eq=False)
class Compared:
    """A dictionary with its fits."""

    dictionary: TermSet
    by_evidence: Posterior
    weight: float = 0.0
    by_fit: Posterior | None = None
    loo: float | None = None


class _Work:
    """The steps of an identification, in their order."""

    def __init__(
        self,
        arm: Arm,
        points: PointSet,
        motion: Motion,
        kind: str,
        known: dict[str, FloatArray] | None,
        payload_place: Sequence[float] | None,
        usual_kg: float | None,
        seed: int,
        prior: TypePrior | None = None,
    ) -> None:
        self.arm, self.points, self.motion, self.kind = arm, points, motion, kind
        self.known, self.seed, self.prior = known, seed, prior
        self.sisters: Sisters | None = None
        loads, places = motion.payload_kg, motion.payload_place
        self.usual_kg = usual_load(loads) if usual_kg is None else usual_kg
        self.payload_place = (0.0, 0.0, 0.0) if payload_place is None else tuple(float(x) for x in payload_place)
        if loads is not None and places is not None:
            usual = np.flatnonzero(loads == self.usual_kg)
            self.payload_place = tuple(float(x) for x in places[usual[-1] if len(usual) else -1])
        self.project = False
        self.compared: list[Compared] = []
        self.spectrum: gear_scan.Spectrum | None = None

    def prepare(self) -> None:
        """Geometry solution, superset of terms and, where there are readings only, whether they lag behind."""
        geometry = GEOMETRY.terms(self.arm)
        self.problem = linear_model.geometry_problem(self.arm, self.points, geometry, self.known)
        loads = self.motion.payload_kg
        payload = self.payload_place if loads is not None and len(np.unique(loads)) > 1 else None
        elapsed = self.motion.elapsed
        span = 0.0 if elapsed is None else float(np.ptp(elapsed))
        self.taus = [share * span for share in SHARES] if span > 0.0 else []
        self.superset: list[Term] = term_sets.superset(
            self.arm,
            self.kind,
            bool(self.motion.moves.any()),
            payload,
            self.taus,
            self.motion.torques is not None,
            None if elapsed is None else float(elapsed.max()),
        )
        self.readings_gain: float | None = None
        if self.motion.readings and self.motion.moves.any():
            self.readings_gain = self._try_projection(geometry)
        self.state = linear_model.geometry_solution(self.problem, self.motion, geometry, self.project)
        chosen = self._compared_rows()
        problem, motion = self.problem, self.motion
        if chosen is not None:
            problem = linear_model.at_poses(problem, self.points.select(chosen))
            motion = self.motion.select(chosen)
        self.linear = Linearisation(problem, self.state, motion, self.superset, self.project)
        self.sums: Sums = self.linear.sums()
        self.dictionaries = term_sets.term_sets(self.superset, self.kind, self.taus[-1] if self.taus else None)

    def _compared_rows(self) -> np.ndarray | None:
        if self.points.poses <= COMPARED:
            return None
        rows = np.zeros(self.points.poses, dtype=bool)
        rows[np.random.default_rng(self.seed).permutation(self.points.poses)[:COMPARED]] = True
        return rows

    def _try_projection(self, geometry: list[Term]) -> float:
        """By how much residuals fall if a share of the last move is taken from each pose; sets ``project``."""
        sizes, spare = [], []
        for project in (False, True):
            state = linear_model.geometry_solution(self.problem, self.motion, geometry, project)
            linear = Linearisation(self.problem, state, self.motion, self.superset, project)
            middle = term_sets.make(self.superset, ["gravity", "gain", "harmonics"], 2, None)
            sums = linear.sums(middle.columns(linear.flat))
            t = fit_temper(linear.per_pose)
            found = maximise_evidence(sums, linear.flat, middle.group, middle.caps, t)
            sizes.append(np.sqrt(found.s2))
            spare.append(max(t * sums.equations - linear.flat - float(found.gammas.sum()), 1.0))
        from scipy.special import fdtri

        chance = np.sqrt(fdtri(*spare, GATE_CERTAINTY))
        self.project = bool(sizes[0] > READINGS_GATE * chance * sizes[1])
        return float(sizes[0] / sizes[1])

    def _fit(
        self, dictionary: TermSet, sums: Sums, t: float, start: Posterior | None = None, give_up: float = -np.inf
    ) -> Posterior:
        part = sums.part(dictionary.columns(self.linear.flat))
        v, s2 = (None, None) if start is None else (start.variances, start.s2)
        d = dictionary
        return maximise_evidence(
            part, self.linear.flat, d.group, d.caps, t, v, s2, give_up=give_up, expected=d.expected
        )

    def compare(self) -> None:
        """Log evidence and weight of every dictionary; fits of those with weight."""
        self.compared, shares, best = self._weighed(self.dictionaries)
        if self.prior is not None:
            tau = self.taus[-1] if self.taus else None
            others, their_shares, theirs = self._weighed(
                term_sets.with_sisters(self.superset, tau, self.prior.expected)
            )
            top = max(others, key=lambda item: item.by_evidence.log_evidence)
            part = self.sums.part(top.dictionary.columns(self.linear.flat))
            alone = max(self.compared, key=lambda item: item.by_evidence.log_evidence).by_evidence
            test = chi_square_of_type(part, self.linear.flat, top.dictionary, top.by_evidence, alone.s2)
            weight = term_sets.share(theirs - best) if like_type(*test) else 0.0
            p = self.prior
            self.sisters = Sisters(p.type, len(p.sisters), p.simulated, theirs - best, weight, *test)
            shares = np.concatenate([(1.0 - weight) * shares, weight * their_shares])
            shares[shares < term_sets.LEAST_WEIGHT] = 0.0
            shares, self.compared = shares / shares.sum(), [*self.compared, *others]
        for item, share in zip(self.compared, shares, strict=True):
            item.weight = float(share)
            if share > 0.0:
                item.by_fit = self._fit(item.dictionary, self.sums, self._temper, item.by_evidence)

    def _weighed(self, choices: Sequence[TermSet]) -> tuple[list[Compared], FloatArray, float]:
        """Choices with their log evidence, their weights among each other, and the largest log evidence."""
        t = evidence_temper(self.linear.per_pose)
        best, out = -np.inf, list[Compared]()
        for dictionary in choices:
            item = Compared(dictionary, self._fit(dictionary, self.sums, t, give_up=best - GIVE_UP))
            if item.by_evidence.log_evidence > best - GIVE_UP:
                self._choose_tau(item, t)
            out.append(item)
            best = max(best, item.by_evidence.log_evidence)
        evidences = np.array([item.by_evidence.log_evidence for item in out])
        return out, term_sets.weights(evidences, [d.bands for d in choices]), float(best)

    def _choose_tau(self, item: Compared, t: float) -> None:
        """The time constant of a dictionary's warm-up with the largest log evidence, from the longest downwards."""
        if term_sets.tau_of(item.dictionary, self.superset) is None:
            return
        for tau in reversed(self.taus[:-1]):
            other = term_sets.with_tau(item.dictionary, self.superset, tau)
            found = self._fit(other, self.sums, t, item.by_evidence)
            if found.log_evidence <= item.by_evidence.log_evidence:
                break
            item.dictionary, item.by_evidence = other, found

    @property
    def _temper(self) -> float:
        return fit_temper(self.linear.per_pose)

    def scan(self, say: Progress) -> list[gear_scan.Found]:
        """Frequencies beyond the best dictionary; their terms join the superset and all dictionaries with weight."""
        best = max(self.compared, key=lambda item: item.weight)
        if best.by_fit is None or best.dictionary.bands:
            # beside long series single harmonics are accidents: on a UR10 they took the held-out mean from 0.134 to
            # 0.141 mm and the intervals' coverage from 96 to 92 %
            return []
        part = self.sums.part(best.dictionary.columns(self.linear.flat))
        found, self.spectrum = gear_scan.scan(self.linear, best.dictionary, part, (best.by_evidence, best.by_fit), say)
        terms = [term for item in found for term in gear_terms(item.joint, item.cycles)]
        places = list(range(len(self.superset), len(self.superset) + len(terms)))
        self.superset = [*self.superset, *terms]
        for item in self.compared:
            if item.weight > 0.0 and terms:
                item.dictionary = item.dictionary.extended(places, [term.group for term in terms])
        return found

    def average(self, found: list[gear_scan.Found]) -> EvidenceFit:
        """Fit the dictionaries with weight to all poses, once more with what the scan found, and average them.

        The linear model is straightened at the average before the last fits.
        """
        kept = [item for item in self.compared if item.weight > 0.0]
        union = np.unique(np.concatenate([item.dictionary.terms for item in kept]))
        linear = Linearisation(self.problem, self.state, self.motion, [self.superset[k] for k in union], self.project)
        flat, width = linear.flat, linear.flat + len(union)
        sums = (
            linear.sums()
            if found or len(self.motion) != len(self.linear.motion)
            else self.sums.part(np.concatenate([np.arange(flat), flat + union]))
        )
        places = [np.concatenate([np.arange(flat), flat + np.searchsorted(union, i.dictionary.terms)]) for i in kept]
        rough = np.zeros(width)
        for item, columns in zip(kept, places, strict=True):
            rough[columns] += item.weight * _refit(sums.part(columns), flat, item, self._temper).c
        if not self.project:  # readings are not known well enough for it to matter
            linear.straighten(rough)
            sums = linear.sums()
        mean, second = np.zeros(width), np.zeros((width, width))
        u_pose, u_block = np.zeros((self.problem.rows, 3)), np.zeros((self.problem.rows, 3))
        for item, columns in zip(kept, places, strict=True):
            fit = _refit(sums.part(columns), flat, item, self._temper)
            c, C = np.zeros(width), np.zeros((width, width))
            c[columns] = fit.c
            C[np.ix_(columns, columns)] = fit.covariance
            mean += item.weight * c
            second += item.weight * (C + np.outer(c, c))
            u, _ = leave_one_out.residuals(linear, columns, fit)
            v, _ = leave_one_out.block_residuals(linear, columns, fit)
            item.by_fit, item.loo = fit, _of_points(u, self.points, self.project)[""]
            u_pose, u_block = u_pose + item.weight * u, u_block + item.weight * v
        covariance = second - np.outer(mean, mean)
        top = max(range(len(kept)), key=lambda k: kept[k].weight)
        self.shown = self._shown(kept[top], sums.part(places[top]))
        return self._result(linear, kept, mean, covariance, u_pose, u_block, found)

    def _shown(self, item: Compared, sums: Sums) -> tuple[FamilyShown, ...]:
        """What a fitted dictionary would lose without each of its families, from the sums of its columns."""
        if item.by_fit is None:
            return ()
        families = [self.superset[k].family for k in item.dictionary.terms]
        t = evidence_temper(self.linear.per_pose)
        return families_shown(sums, self.linear.flat, families, item.dictionary, t, item.by_fit)

    def _result(
        self,
        linear: Linearisation,
        kept: list[Compared],
        mean: FloatArray,
        covariance: FloatArray,
        u_pose: FloatArray,
        u_block: FloatArray,
        found: list[gear_scan.Found],
    ) -> EvidenceFit:
        state = linear.moved(mean)
        arm, _ = self.problem.model(state)
        flat = linear.flat
        names = self.points.target_names
        lagging = LAG_FAMILIES if self.project else ()
        own = np.array([k for k, term in enumerate(linear.terms) if term.family not in lagging], dtype=int)
        columns = np.concatenate([np.arange(flat), flat + own])
        scale = linear.sizes[columns]
        fits = [item.by_fit for item in kept if item.by_fit is not None]
        shares = np.array([item.weight for item in kept])
        return EvidenceFit(
            nominal=self.arm,
            arm=arm,
            terms=tuple(linear.terms[k] for k in own),
            coefficients=scale[flat:] * mean[columns[flat:]],
            covariance=covariance[np.ix_(columns, columns)] * np.outer(scale, scale),
            T_world_base=state.T_world_base,
            targets=dict(zip(names, state.targets, strict=True)),
            free_targets=tuple(names[k] for k in self.problem.free),
            framed_targets=tuple(names[k] for k in self.problem.framed),
            target_rotations={names[k]: state.rotations[k] for k in self.problem.framed},
            sigma=float(np.sqrt(shares @ [fit.s2 for fit in fits])) * MM,
            loo=_of_points(u_pose, self.points, self.project),
            loo_blocks=_of_points(u_block, self.points, self.project),
            dictionaries=tuple(self._table()),
            groups=tuple(groups_of(kept, self.superset)),
            families=self.shown,
            gears=tuple(GearFound(f.joint, f.cycles, f.chi2, f.evidence_gain) for f in found),
            joint_ranges=np.array([self.motion.q.min(axis=0), self.motion.q.max(axis=0)]),
            kind=self.kind,
            tau=term_sets.tau_of(max(kept, key=lambda item: item.weight).dictionary, self.superset),
            poses=len(self.motion),
            loads=() if self.motion.payload_kg is None else tuple(float(m) for m in np.unique(self.motion.payload_kg)),
            usual_kg=self.usual_kg,
            readings_gain=self.readings_gain,
            readings_projected=self.project,
            spectrum=self.spectrum,
            other_bases=dict(zip(self.problem.sessions[:-1], state.others, strict=True)),
            sisters=self.sisters,
        )

    def _table(self) -> list[TermSetResult]:
        rows = []
        for item in self.compared:
            sigma = None if item.by_fit is None else float(np.sqrt(item.by_fit.s2)) * MM
            rows.append(
                TermSetResult(
                    item.dictionary.name,
                    self.linear.flat + len(item.dictionary.terms),
                    item.by_evidence.log_evidence,
                    item.weight,
                    sigma,
                    item.loo,
                    item.dictionary.bands,
                )
            )
        return rows


def _refit(sums: Sums, flat: int, item: Compared, t: float) -> Posterior:
    """The fit of a dictionary from the variances it had, new groups from one."""
    old = item.by_fit or item.by_evidence
    variances = np.ones(len(item.dictionary.groups))
    variances[: len(old.variances)] = old.variances
    d = item.dictionary
    return maximise_evidence(sums, flat, d.group, d.caps, t, variances, old.s2, expected=d.expected)


def groups_of(kept: list[Compared], superset: Sequence[Term]) -> list[GroupResult]:
    """What was expected of each group and what the data show of it, averaged over the dictionaries."""
    totals: dict[str, FloatArray] = {}
    members: dict[str, list[Term]] = {}
    for item in kept:
        fit, d = item.by_fit, item.dictionary
        if fit is None:
            continue
        flat = len(fit.c) - len(d.terms)
        counts = np.bincount(d.group, minlength=len(d.groups))
        unit = 1.0 if d.expected is None else np.bincount(d.group, d.expected.std**2, len(d.groups)) / counts
        unit = np.broadcast_to(unit, counts.shape)
        squares = np.bincount(d.group, fit.c[flat:] ** 2, len(d.groups)) / counts
        scatter = np.bincount(d.group, np.diagonal(fit.covariance)[flat:], len(d.groups)) / counts
        for k, name in enumerate(d.groups):
            row = np.array([fit.gammas[k], fit.variances[k] * unit[k], squares[k], scatter[k], 1.0])
            totals[name] = totals.get(name, np.zeros(5)) + item.weight * row
            members.setdefault(name, [superset[j] for j in d.terms[d.group == k]])
    out = []
    for name, (seen, *squared, weight) in totals.items():
        terms = members[name]
        prior, found, std = np.sqrt(np.array(squared) / weight)
        natural = {term.unit: term.size for term in terms}
        out.append(
            GroupResult(name, len(terms), float(seen), float(prior), terms[0].family, natural, float(found), float(std))
        )
    return out


def _of_points(u: FloatArray, points: PointSet, projected: bool) -> dict[str, float | None]:
    """Root mean square length of leave-one-out residuals of each target and of all together (``""``), metres.

    None where a residual is infinite: without its pose a direction that it depends on is open.

    Rows are ordered by pose: positions, then orientations of a pose, which are left out. Where a direction of each pose
    was projected out, what all its points have in common shows in two of three coordinates only; the third is as large.
    """
    oriented = points.oriented()
    pose = np.concatenate([points.pose, points.pose[oriented]])
    kind = np.concatenate([points.target, np.full(int(oriented.sum()), -1)])
    order = np.argsort(pose, kind="stable")
    seen = kind[order] >= 0
    kind, pose, u = kind[order][seen], pose[order][seen], u[seen]
    square = np.sum(u * u, axis=1)
    if projected:
        count = np.bincount(pose, minlength=points.poses)
        total = [np.bincount(pose, u[:, k], points.poses) for k in range(3)]
        common = np.sum(np.square(total), axis=0) / np.maximum(count, 1) ** 2
        square = square + 0.5 * common[pose]
    figures = {"": square.mean()} | {name: square[kind == k].mean() for k, name in enumerate(points.target_names)}
    return {name: leave_one_out.closed(float(np.sqrt(mean)) * MM) for name, mean in figures.items()}


def check_averaging(arm: Arm, poses: int) -> None:
    """Refuse what cannot be averaged by evidence.

    Raises
    ------
    IdentificationError
        If the poses are too few to weigh error models, or all axes of the arm are parallel.
    """
    if poses < FEWEST:
        raise IdentificationError(
            f"{poses} poses are too few to weigh error models against each other, which needs at least {FEWEST}: "
            "measure more, or choose model placement"
        )
    if arm.planar:
        raise IdentificationError(
            "all axes of this arm are parallel, so that base and tool cannot be told apart, and the evidence of error "
            "models has no meaning: choose model placement"
        )


def identify_averaged(
    arm: Arm,
    points: PointSet,
    motion: Motion,
    known_targets: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    terms: str = term_sets.JOINT_MAP,
    payload_place: Sequence[float] | None = None,
    usual_kg: float | None = None,
    prior: TypePrior | None = None,
) -> AveragedFit:
    """Identify base, targets and the average of error models.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    motion : Motion
        Of the points' poses.
    known_targets : dict of str to array_like, shape (3,), optional
        Targets whose places in the tip link are known, metres.
    seed : int
        Of the poses on which models are compared where there are very many.
    progress : callable, optional
        Called with a short text at each step.
    terms : str
        ``joint-map``: what URDF and a joint map can carry; ``all``: frame terms, too.
    payload_place, usual_kg, prior : optional
        See `irbcal.identification.evidence.identify_evidence`.

    Returns
    -------
    AveragedFit

    Raises
    ------
    IdentificationError
        As `check_averaging`, or if the poses do not determine base and targets.
    """
    check_averaging(arm, points.poses)
    known = None if known_targets is None else {k: np.asarray(v, dtype=float) for k, v in known_targets.items()}
    found = identify_evidence(
        arm,
        points,
        motion,
        terms=terms,
        seed=seed,
        known_targets=known,
        payload_place=payload_place,
        usual_kg=usual_kg,
        prior=prior,
        progress=progress,
    )
    return AveragedFit(found, into_one_frame(points, found.T_world_base, found.other_bases), motion)


@dataclass(frozen=True, eq=False)
class TypeTerms:
    """What one robot's measurements show of the terms.

    Attributes
    ----------
    terms : tuple of Term
    values, covariance : ndarray, shape (k,), (k, k)
        The estimate under a prior of `WIDE` natural sizes about zero, SI units.
    """

    terms: tuple[Term, ...]
    values: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        lock(self)


def type_terms(arm: Arm, points: PointSet, motion: Motion) -> TypeTerms:
    """What measurements show of a type's terms; base, tool and warm-up are left free, a pose counts as one vector.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    motion : Motion
        Of its poses.

    Returns
    -------
    TypeTerms

    Raises
    ------
    IdentificationError
        If the poses do not determine base and targets.
    """
    work = prepared(arm, points, motion)
    superset, flat = work.superset, work.linear.flat
    names = [*term_sets.TYPE_FAMILIES, "warm_up"]
    choice = term_sets.make(superset, names, term_sets.TYPE_ORDERS, work.taus[-1] if work.taus else None)
    sums = work.sums.part(choice.columns(flat))
    t = evidence_temper(work.linear.per_pose)
    found = maximise_evidence(sums, flat, choice.group, choice.caps, t)
    terms = [superset[k] for k in choice.terms]
    mine = np.array([taken(term) for term in terms], dtype=bool)
    prior = np.where(mine, WIDE**-2.0, 1.0 / found.variances[choice.group])
    A = (t / found.s2) * sums.H + np.diag(np.concatenate([np.zeros(flat), prior]))
    own = np.concatenate([np.zeros(flat, dtype=bool), mine])
    covariance = np.linalg.inv(A)
    values = covariance @ ((t / found.s2) * sums.g)
    size = np.array([term.size for term in terms])[mine]
    return TypeTerms(
        tuple(term for term, own_term in zip(terms, mine, strict=True) if own_term),
        size * values[own],
        np.outer(size, size) * covariance[np.ix_(own, own)],
    )


SAME_STOP = 1e-6
"""Joints and last moves that agree within this are the same stop, radians or metres."""


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
    keys = np.round(np.column_stack([motion.q, motion.moves]) / SAME_STOP)
    if motion.payload_kg is not None:
        keys = np.column_stack([keys, motion.payload_kg])
    if motion.payload_place is not None:
        keys = np.column_stack([keys, motion.payload_place])
    if points.session is not None:
        keys = np.column_stack([keys, np.unique(points.session.astype(str), return_inverse=True)[1]])
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(keys) or points.oriented().any():
        return points, motion
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))  # in the order of the first of each
    pose = rank[which.ravel()]
    first = np.sort(first)
    count = np.bincount(pose)
    cell = pose[points.pose] * len(points.target_names) + points.target
    cells, where = np.unique(cell, return_inverse=True)
    where = where.ravel()
    seen = np.bincount(where)
    xyz = np.column_stack([np.bincount(where, points.xyz[:, k]) for k in range(3)]) / seen[:, None]
    u95 = None if points.u95 is None else np.bincount(where, points.u95) / seen
    load: dict[str, Any] = {k: v if v is None else v[first] for k, v in points.load().items()}
    merged = replace(
        points,
        q=motion.q[first],
        pose=cells // len(points.target_names),
        target=cells % len(points.target_names),
        xyz=xyz,
        pose_ids=points.pose_ids[first],
        groups=points.groups[first],
        previous=None if points.previous is None else points.previous[first],
        session=None if points.session is None else points.session[first],
        rotation=None,
        u95=u95,
        **load,
    )
    elapsed = None if motion.elapsed is None else np.bincount(pose, motion.elapsed) / count
    torques = motion.torques
    if torques is not None:
        torques = np.column_stack([np.bincount(pose, felt) / count for felt in torques.T])
    return merged, replace(motion.select(first), move=motion.moves[first], elapsed=elapsed, torques=torques)
