"""Which terms each joint needs, from any poses: log evidence with and without each term, beside all the others.

All terms of all joints are fitted together to what the geometry leaves (`irbcal.identification.linear_model`), each
with a variance for its joint; the fit is repeated without each of them. A term is needed where the log evidence and the
fitted points say so (`irbcal.identification.evidence_maximisation.evidence_of_each`), whatever a calibration has of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, group_means
from irbcal.distributions import NORMAL_95
from irbcal.errors import IdentificationError
from irbcal.identification import axes, linear_model, outliers
from irbcal.identification.evidence_fit import COMPARED
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    VARIANCE_CAP,
    Posterior,
    evidence_likelihood_power,
    evidence_of_each,
    maximise_evidence,
)
from irbcal.identification.gear_scan import WaveSums
from irbcal.identification.linear_model import Linearisation
from irbcal.joint_analysis.moves import beyond_reading
from irbcal.joint_analysis.terms import (
    HIGHEST_FREQUENCY,
    EffectKind,
    JointTerm,
    best_frequency,
    evidence_in_words,
    fourier_names,
    frequencies,
    name_of,
    not_tested,
    of_joints,
    play_in_words,
    plus_minus,
    quantile,
    terms_table,
)
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.terms import direction, gain, gravity, harmonics, thesis
from irbcal.modeling.terms import geometry as geometry_terms
from irbcal.modeling.terms import move as last_move
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term, own_axis, own_unit
from irbcal.summary import Paragraph, Result, Table, rows
from irbcal.units import DEG, MM
from irbcal.wording import inflected

FEWEST_POSES_FOR_EFFECTS = 12

SMALLEST_LEVER = 0.3
"""Poses whose targets lie nearer to a joint's axis than this share of the typical distance do not show that joint."""

MOST_BINS, FEWEST_BINS = 10, 2
FEWEST_IN_BIN = 5


@dataclass(frozen=True, eq=False, repr=False)
class ResidualAnalysis(Result):
    """Which terms each joint needs, and what is left about each joint."""

    robot: Robot
    """With base, targets and geometry as these points say, and no joint map."""
    points: PointSet
    step: FloatArray
    """Shape (n, joints). Last move of each joint before each pose, radians; NaN where it is not known."""
    terms: tuple[JointTerm, ...]
    """Each beside all others."""
    angle: FloatArray
    """Shape (n, joints). Angular residual of each pose about each joint with the estimated backlash left in, radians;
    NaN where the targets lie too near to the axis or the direction is not known.
    """
    rms: float
    rms_geometry: float
    """Root mean square distance of the points with all terms, and with geometry alone, metres."""
    excluded: tuple[tuple[str, str, float], ...] = ()
    """(pose, target, distance in metres) of points far from the robot."""

    CONTENT = (
        "robot=robot.arm.name poses=points.poses points=points.__len__ rms_mm rms_geometry_mm terms needed=needed_moves"
    )

    @property
    def direction(self) -> FloatArray:
        """1: reached from below, -1: from above, 0: not known, shape (n, joints)."""
        return np.sign(np.nan_to_num(self.step))

    @property
    def needed(self) -> tuple[JointTerm, ...]:
        """The terms that the robot needs, those that move the points most first."""
        return tuple(sorted((term for term in self.terms if term.needed), key=lambda term: -term.moves))

    def needed_moves(self) -> list[dict[str, Any]]:
        """Which terms it needs, and by how much points move without them."""
        return rows(self.needed, "kind joint moves_mm")

    def by_joint(self, kind: EffectKind) -> dict[int | None, JointTerm]:
        """Terms of one kind, by joint."""
        return {term.joint: term for term in self.terms if term.kind == kind}

    def one_sided_in_words(self, joints: Sequence[int]) -> str:
        """Words for a caption about joints, counted from 0, that have no mean of one of the directions."""
        if not joints:
            return ""
        which = f"{inflected(len(joints), 'joint')} {', '.join(str(j + 1) for j in joints)}"
        return f". At {which}, {self.points.poses} poses are too few for means of both directions"

    def by_angle(self, joint: int, sign: float) -> FloatArray:
        """Means over bins of one joint's angle, of poses reached from one side.

        Parameters
        ----------
        joint : int
            Counted from 0.
        sign : float
            1: from below, -1: from above.

        Returns
        -------
        ndarray, shape (bins, 3)
            Middle of the bin, mean residual and half-width of its 95 % interval, radians; bins of fewer than
            `FEWEST_IN_BIN` poses are left out.
        """
        q, have = self.points.q[:, joint], np.isfinite(self.angle[:, joint])
        bins = int(np.clip(have.sum() / (3 * FEWEST_IN_BIN), FEWEST_BINS, MOST_BINS))
        return self.means(joint, sign, q, np.quantile(q[have], np.linspace(0, 1, bins + 1)))

    def means(self, joint: int, sign: float, x: FloatArray, ends: FloatArray) -> FloatArray:
        """As `by_angle`, over bins of other values ``x`` of the poses, shape (n,), with the ends of the bins."""
        angle, edges = self.angle[:, joint], np.unique(ends)
        selected = np.isfinite(angle) & (self.direction[:, joint] == sign)
        which = np.digitize(x[selected], edges[1:-1])
        count = np.bincount(which, minlength=len(edges) - 1)
        middle, level = (group_means(values[selected], which, len(count)) for values in (x, angle))
        scatter = group_means((angle[selected] - level[which]) ** 2, which, len(count))
        half = NORMAL_95 * np.sqrt(scatter / np.maximum(count - 1, 1))
        return np.column_stack([middle, level, half])[count >= FEWEST_IN_BIN]

    def report(self) -> Sequence[Paragraph]:
        """What the robot needs, the terms as a table, and what they mean."""
        headline = f"{self.robot.arm.name} on {self.points.poses} poses: {needed_by_residuals(self)}"
        return [headline, residual_terms_table(self), *of_residuals(self, None)]


class _JointCandidate(NamedTuple):
    """Terms of one kind at one joint, and what a value as people are told of it is of the terms' coefficients."""

    kind: EffectKind
    joint: int | None
    names: tuple[str, ...]
    terms: Sequence[Term] = ()
    factor: float = 1.0
    frequency: float | None = None
    note: str = ""
    tried: int = 1


def analyse_residuals(
    arm: Arm,
    points: PointSet,
    step: FloatArray,
    joint: int | None = None,
    order: int = 2,
    frequency: float | None = 1.0,
    cleaned: bool = False,
) -> ResidualAnalysis:
    """Which terms each joint needs, from any poses.

    Parameters
    ----------
    arm : Arm
        Nominal.
    points : PointSet
    step : ndarray, shape (n, joints)
        Of `irbcal.measurement.motions.last_moves`, for the poses of ``points``.
    joint : int, optional
        Only this joint, counted from 1; the others are fitted beside it all the same.
    order : int
        Of the Fourier series.
    frequency : float or None
        Periods per turn; None: free.
    cleaned : bool
        Outliers were left out before.

    Raises
    ------
    IdentificationError
        If there are too few poses or the robot is not that of the points.
    """
    if joint is not None and joint > len(arm.joint_names):
        raise IdentificationError(f"there is no joint {joint}: {arm.name} has {len(arm.joint_names)}")
    points, step, excluded = _usable(arm, points, step, cleaned)
    motion = Motion(points.q, np.nan_to_num(step))
    geometry = geometry_terms.FAMILY.terms(arm)
    problem = linear_model.geometry_problem(arm, points, geometry, None)
    state = linear_model.geometry_solution(problem, motion, geometry)
    candidates = _candidates(arm, points, step, order, frequency)
    if frequency is None:
        base = [c for c in candidates if c.kind != "fourier"]
        fit = _TermComparison(Linearisation(problem, state, motion, [*geometry, *_terms(base)]), base)
        candidates = [fit.tuned(c, points.q, order) if c.kind == "fourier" else c for c in candidates]
    fit = _TermComparison(Linearisation(problem, state, motion, [*geometry, *_terms(candidates)]), candidates)
    found = [fit.joint_term(c) for c in candidates]
    fitted = fit.linear.moved(fit.posterior.c)
    targets = dict(zip(points.target_names, fitted.targets, strict=True))
    return ResidualAnalysis(
        Robot(problem.arm_at(fitted), JointMap.identity(arm), fitted.T_world_base, targets),
        points,
        step,
        tuple(term for term in found if joint is None or term.joint in (None, joint)),
        fit.angle(step),
        fit.rms(fit.posterior),
        fit.rms(fit.of_geometry()),
        excluded,
    )


def _usable(
    arm: Arm, points: PointSet, step: FloatArray, cleaned: bool
) -> tuple[PointSet, FloatArray, tuple[tuple[str, str, float], ...]]:
    """Points that a robot of this kind could have reached, of `COMPARED` poses at most, and those that it could not."""
    step = step[np.isin(np.arange(points.poses), points.pose)]
    points = points.without_empty_poses()
    excluded: tuple[tuple[str, str, float], ...] = ()
    if points.poses >= FEWEST_POSES_FOR_EFFECTS and not cleaned:
        screened, names = outliers.find_outliers(arm, points), points.names()
        far = np.flatnonzero(~screened.keep)
        excluded = tuple((str(points.pose_ids[points.pose[k]]), names[k], float(screened.distance[k])) for k in far)
        used = np.isin(np.arange(points.poses), points.pose[screened.keep])
        points, step = points.take(screened.keep).select(used).with_seen_targets(), step[used]
    if points.poses < FEWEST_POSES_FOR_EFFECTS:
        raise IdentificationError(
            f"{points.poses} poses are too few to look for effects of single joints: at least "
            f"{FEWEST_POSES_FOR_EFFECTS} are needed"
        )
    if points.poses > COMPARED:
        drawn: BoolArray = np.isin(
            np.arange(points.poses), np.random.default_rng(0).permutation(points.poses)[:COMPARED]
        )
        points, step = points.select(drawn).with_seen_targets(), step[drawn]
    return points, step, excluded


def _candidates(
    arm: Arm, points: PointSet, step: FloatArray, order: int, frequency: float | None
) -> list[_JointCandidate]:
    """All terms that a joint may need."""
    joints, slides = range(len(arm.joint_names)), arm.table.prismatic
    out = []
    signs = np.sign(np.nan_to_num(step))
    for term in direction.FAMILY.terms(arm):
        note = "" if {-1.0, 1.0} <= set(signs[:, term.joint]) else "reached from one side only"
        note = note if signs[:, term.joint].any() else "the direction of approach is not known"
        # reached from above minus from below: the term holds half of it, with the opposite sign
        out.append(_JointCandidate("backlash", term.joint, ("backlash",), (term,), -2.0, note=note))
    for term in (term for term in last_move.FAMILY.terms(arm) if term.basis == "move"):
        sizes = np.abs(step[np.isfinite(step[:, term.joint]), term.joint])
        varied = len(sizes) and sizes.std() >= 0.1 * sizes.mean() and sizes.any()
        note = "" if varied else "all moves of the joint are of one size"
        out.append(_JointCandidate("move", term.joint, ("per_move",), (term,), note=note))
    out += [_JointCandidate("gain", term.joint, ("gain",), (term,)) for term in gain.FAMILY.terms(arm)]
    for j in (j for j in joints if not slides[j]):
        out.append(_series(j, order, 1.0 if frequency is None else frequency))
    if arm.bends_like_the_thesis:
        bending = thesis.stiffness_of(arm, arm.stiffness_geometry()[0])
        return [*out, _JointCandidate("stiffness", None, ("A", "B"), bending)]
    levers = gravity.FAMILY.terms(arm)
    for j in dict.fromkeys(term.joint for term in levers):
        own = [term for term in levers if term.joint == j]
        out.append(_JointCandidate("gravity", j, tuple(term.name for term in own), own))
    return out


def _series(j: int, order: int, frequency: float, note: str = "", tried: int = 1) -> _JointCandidate:
    """A Fourier series of a joint (Nubiola 2011, section 5.2)."""
    terms = [
        Term(j, "rz", basis, harmonics.SIZE, "", "harmonics", "rad", {"cycles_per_turn": k * frequency})
        for k in range(1, order + 1)
        for basis in ("cos", "sin")
    ]
    return _JointCandidate("fourier", j, fourier_names(order), terms, 1.0, frequency, note, tried)


def _terms(candidates: Sequence[_JointCandidate]) -> list[Term]:
    return [term for candidate in candidates if not candidate.note for term in candidate.terms]


class _TermComparison:
    """All terms of all joints fitted together, and again without each of them."""

    def __init__(self, linear: Linearisation, candidates: Sequence[_JointCandidate]) -> None:
        tested = [k for k, candidate in enumerate(candidates) if not candidate.note]
        geometry = len(linear.terms) - len(_terms(candidates))
        number = np.repeat(1 + np.arange(len(tested)), [len(candidates[k].terms) for k in tested])
        self.group = np.concatenate([np.zeros(geometry, dtype=int), number])
        self.caps = np.array([GEOMETRY_CAP, *[VARIANCE_CAP] * len(tested)])
        self.keys = [(candidates[k].kind, candidates[k].joint) for k in tested]
        self.likelihood_power = evidence_likelihood_power(linear.per_pose)
        rough = maximise_evidence(linear.sums(), linear.nuisance, self.group, self.caps, self.likelihood_power)
        self.linear = linear.improved(rough.c)
        self.sums = self.linear.sums()
        self.posterior = maximise_evidence(
            self.sums, linear.nuisance, self.group, self.caps, self.likelihood_power, rough.variances, rough.s2
        )
        labels = [None if number == 0 else self.keys[number - 1] for number in self.group]
        self.worth = evidence_of_each(self.sums, self.posterior, linear.nuisance, labels, self.group, self.caps)

    def joint_term(self, candidate: _JointCandidate) -> JointTerm:
        """A candidate with its values and what it is worth; joints are counted from 1."""
        joint = None if candidate.joint is None else candidate.joint + 1
        frequency = None if candidate.frequency is None else (candidate.frequency,)
        prismatic = any(term.unit == "m" for term in candidate.terms)
        if candidate.note:
            return JointTerm(
                candidate.kind, joint, candidate.names, frequency=frequency, note=candidate.note, prismatic=prismatic
            )
        key = (candidate.kind, candidate.joint)
        columns = self.linear.nuisance + np.flatnonzero(self.group == 1 + self.keys.index(key))
        size = candidate.factor * self.linear.sizes[columns]
        value = size * self.posterior.c[columns]
        std = np.abs(size) * np.sqrt(np.diagonal(self.posterior.covariance)[columns])
        half = quantile(self.posterior.freedom) * std
        worth = self.worth[key]
        return JointTerm(
            candidate.kind,
            joint,
            candidate.names,
            tuple(value.tolist()),
            tuple((value - half).tolist()),
            tuple((value + half).tolist()),
            worth.evidence - float(np.log(candidate.tried)),
            worth.moves,
            frequency=frequency,
            prismatic=prismatic,
        )

    def of_geometry(self) -> Posterior:
        """The fit of geometry alone."""
        stays = np.concatenate(
            [np.arange(self.linear.nuisance), self.linear.nuisance + np.flatnonzero(self.group == 0)]
        )
        group = np.zeros(len(stays) - self.linear.nuisance, dtype=int)
        return maximise_evidence(
            self.sums.select(stays), self.linear.nuisance, group, self.caps[:1], self.likelihood_power
        )

    def rms(self, fit: Posterior) -> float:
        """Root mean square distance of the points, metres; columns of the fit are the first ones."""
        c, k, sums = fit.c, len(fit.c), self.sums
        rss = sums.yy - 2.0 * float(c @ sums.g[:k]) + float(c @ sums.H[:k, :k] @ c)
        return float(np.sqrt(max(3.0 * rss / sums.equations, 0.0))) * MM

    def tuned(self, series: _JointCandidate, q: FloatArray, order: int) -> _JointCandidate:
        """A joint's series with the frequency that explains most of what all other terms leave."""
        assert series.joint is not None
        angles = q[:, series.joint]
        extent, highest = float(np.ptp(angles)), min(HIGHEST_FREQUENCY, len(axes.distinct_angles(angles)) / 2 / order)
        if extent < 10 * DEG:
            return series._replace(note="the joint hardly moves")
        sums = WaveSums(self.linear, np.arange(len(self.posterior.c)), [series.joint])
        each = np.arange(1.0, order + 1.0)
        tried = frequencies(extent, highest)
        k, a, c = len(self.posterior.c), self.posterior.likelihood_power / self.posterior.s2, self.posterior.c

        def misfit(f: float) -> float:
            wide = sums.extended(self.sums, [(0, cycles) for cycles in f * each])
            cross = wide.H[k:, :k]
            b, S = wide.g[k:] - cross @ c, wide.H[k:, k:] - a * cross @ self.posterior.covariance @ cross.T
            return -float(b @ np.linalg.pinv(S) @ b)

        best = best_frequency(misfit, tried)
        return _series(series.joint, order, best, tried=len(tried))

    def angle(self, step: FloatArray) -> FloatArray:
        """The turn about each joint that explains most of what is left at each pose; see `ResidualAnalysis.angle`."""
        arm, n = self.linear.problem.arm, len(step)
        joints = range(len(arm.joint_names))
        axis = [
            Term(j, own_axis(arm, j), "cos", 1.0, "", "probe", own_unit(arm, j), {"cycles_per_turn": 0.0})
            for j in joints
        ]
        sides = dict(zip(self.keys, range(1, 1 + len(self.keys)), strict=True))
        linear, k = self.linear.extended(axis), len(self.posterior.c)
        square, along = np.zeros((2, n, len(joints)))
        for block in linear.blocks():
            left = block.y - self.posterior.c @ block.J[:k]
            for j in joints:
                turn = block.J[k + j]
                number = sides.get(("backlash", j))
                columns = self.linear.nuisance + np.flatnonzero(self.group == number)  # none where nothing is known
                r = left + self.posterior.c[columns] @ block.J[columns]
                square[:, j] += np.bincount(block.pose, turn * turn, n)
                along[:, j] += np.bincount(block.pose, turn * r, n)
        hidden = square < SMALLEST_LEVER**2 * np.median(square, axis=0)
        hidden |= ~(np.abs(np.nan_to_num(step)) > 0.0) | np.array([("backlash", j) not in sides for j in joints])
        return np.where(hidden, np.nan, along / np.where(square > 0.0, square, 1.0))


def of_residuals(
    analysis: ResidualAnalysis, geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None
) -> list[str]:
    """What the poses say; the last sentence is what the robot needs."""
    out = [
        "each term is fitted beside geometry and all other terms; its log evidence says how much better the poses are "
        "predicted with it than without"
    ]
    for term in analysis.terms:
        worth = evidence_in_words(term)
        if term.kind == "backlash" and term.tested:
            out.append(f"{play_in_words(term)}: {worth}")
        elif term.kind == "move" and term.needed:
            amount = plus_minus(term.values[0], term.low[0], term.high[0], 0.01)
            unit = "mm" if term.prismatic else "degrees"
            out.append(
                f"joint {term.joint}: the size of the last move counts beside its direction: {amount} {unit} per 100 "
                f"{unit} moved: {worth}; play in gears does not grow with the move: a lag does, or joints that were "
                "read before the robot stood still"
            )
        elif term.kind == "stiffness" and term.tested:
            out.append(f"{_stiffness_in_words(term, geometry)}: {worth}")
        elif term.needed:
            out.append(f"joint {term.joint}: {name_of(term)}: {worth}")
    for kind, name in (("gain", "gain error"), ("fourier", "Fourier series"), ("gravity", "bending under gravity")):
        joints = [term.joint for term in analysis.terms if term.kind == kind and term.tested and not term.needed]
        out += [f"{name}{of_joints(joints)}: not needed"] if joints else []
    play = [term for term in analysis.by_joint("backlash").values() if term.needed]
    return [*out, *beyond_reading(play), *not_tested(analysis.terms, "these poses"), needed_by_residuals(analysis)]


def _stiffness_in_words(term: JointTerm, geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None) -> str:
    values = dict(zip(term.names, zip(term.values, term.low, term.high, strict=True), strict=True))
    said = ", ".join(f"{name} = {plus_minus(*value, DEG)} degrees" for name, value in values.items())
    physical = geometry[1].with_coefficients(*term.values) if geometry else None
    if physical is not None:
        said += f"; the stretched arm bends by {physical.delta_L / MM:.2f} mm"
    return f"arm stiffness ({said})"


def needed_by_residuals(analysis: ResidualAnalysis) -> str:
    """The terms that the robot needs, in one sentence."""
    if not analysis.needed:
        return f"This robot needs no term beyond geometry ({analysis.rms_geometry / MM:.3f} mm rms)."
    names = {
        "backlash": "backlash of joint {}",
        "move": "error by the size of the last move of joint {}",
        "gain": "gain of joint {}",
        "fourier": "Fourier series of joint {}",
        "gravity": "bending of joint {} under gravity",
        "stiffness": "arm stiffness",
    }
    steps = ", ".join(f"{names[t.kind].format(t.joint)} ({t.moves / MM:.3f})" for t in analysis.needed)
    return (
        f"This robot needs, the most important first: {steps}; in brackets, how far points move without it, mm; "
        f"geometry alone leaves {analysis.rms_geometry / MM:.3f}, all terms {analysis.rms / MM:.3f}."
    )


def residual_terms_table(analysis: ResidualAnalysis, mark: str = "") -> Table:
    """The terms of `terms_table` from any poses."""
    title = (
        f"{mark}Terms of each joint beside geometry and all others, {analysis.robot.arm.name} on "
        f"{analysis.points.poses} poses ({analysis.rms / MM:.3f} mm rms)"
    )
    return terms_table(analysis.terms, title)
