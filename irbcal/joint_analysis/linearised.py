"""A robot's residuals linearised about it, what each term does to the points, and tests of a few columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray
from irbcal.chance import f_beyond
from irbcal.errors import IdentificationError
from irbcal.identification import outliers
from irbcal.identification.problem import Problem, State
from irbcal.joint_analysis.terms import JointTerm, Kind, fourier_columns, fourier_names, fourier_order, quantile
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.registration import base_on
from irbcal.modeling import parameters
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.units import MM

FARTHEST = 10 * MM
"""Median miss of the robot above which its residuals say nothing about single joints."""

FEWEST_POSES = 12

FACTOR = 8.0
"""Multiple of the median distance from the robot beyond which no joint explains a point."""


def placed(
    robot: Robot, points: PointSet, step: FloatArray
) -> tuple[Robot, PointSet, FloatArray, tuple[tuple[str, str, float], ...]]:
    """The robot with its base where the points say; points that no joint could explain are left out.

    Parameters
    ----------
    robot : Robot
        With the targets of the points.
    points : PointSet
    step : ndarray, shape (n, joints)
        Of each pose.

    Returns
    -------
    robot : Robot
    points : PointSet
    step : ndarray, shape (n, joints)
        Of the poses that are left.
    excluded : tuple of tuple
        (pose, target, distance in metres) of the points left out.

    Raises
    ------
    IdentificationError
        If the points were not measured on this robot, or there are too few poses.
    """
    excluded: tuple[tuple[str, str, float], ...] = ()
    while True:
        robot = base_on(robot, points)
        off = distances(robot, points)
        median = np.median(off)
        far = off > max(outliers.FLOORS["nominal"], FACTOR * median)
        if not far.any() or median > FARTHEST:
            break
        names = points.names()
        excluded += tuple((str(points.pose_ids[points.pose[k]]), names[k], float(off[k])) for k in np.flatnonzero(far))
        used = np.zeros(points.poses, dtype=bool)
        used[points.pose[~far]] = True
        points, step = points.take(~far).select(used).with_seen_targets(), step[used]
    if median > FARTHEST:
        raise IdentificationError(
            f"{robot.arm.name} misses the points by {median / MM:.4g} mm (median) even with its base placed anew: they "
            "were not measured on this robot with this tool"
        )
    if points.poses < FEWEST_POSES:
        raise IdentificationError(
            f"{points.poses} poses are too few to look for effects of single joints: at least {FEWEST_POSES} are needed"
        )
    return robot, points, step, excluded


UNSEEN = 1e-6
"""Share of a column that must be left beside all others for its coefficient to be seen."""

ROUNDING = 1e-8
"""Share of the largest singular value of the normalised columns below which there is only rounding."""


class Linearised:
    """A robot's residuals and their derivatives by geometry, joint map and joint angles, all at one place.

    Rows are those of `irbcal.identification.problem.Problem`, three numbers each; columns are flat, (3 rows, ...).

    Attributes
    ----------
    turn : ndarray, shape (3 rows, joints)
        Derivatives by the effective joints.
    maps : dict of str to ndarray, shape (3 rows,)
        Derivatives by the joint map's parameters.
    value : dict of str to float
        Those parameters as the robot has them.
    active : list of str
        Joint map parameters that the robot has: refitted with the geometry.
    beside : ndarray, shape (3 rows, k)
        Columns of what else is refitted.
    """

    def __init__(self, robot: Robot, points: PointSet, step: FloatArray) -> None:
        arm, joints = robot.arm, len(robot.arm.joint_names)
        geometry = [*parameters.THESIS_LEVELS["26"], "delta_beta3"]
        if not arm.six_revolute:
            geometry = [parameter.name for parameter in parameters.level_parameters("placement", arm)]
        turns = [f"delta_{'d' if slides else 'theta'}{j}" for j, slides in enumerate(arm.table.prismatic, start=1)]
        nominal = robot.joint_map.terms.arm
        maps = [name for name in parameters.all_names(arm) if not name.startswith("delta_")]
        maps = [name for name in maps if nominal.bends_like_the_thesis or not name.startswith("stiffness")]
        names = list(dict.fromkeys([*geometry, *turns, *maps]))
        chosen = tuple(parameters.parameter(name) for name in names)
        thesis_map, refitted = ThesisMap.of(robot.joint_map), points
        if thesis_map is None:  # a map of other terms: held as it is, the thesis's terms come on top of it
            refitted = replace(_without_frame_terms(robot, points), q=robot.joint_map.effective(points.q))
            thesis_map = ThesisMap(np.zeros(joints))
        start = [getattr(thesis_map, p.kind)[p.index] if p.name in maps else 0.0 for p in chosen]
        terms = [parameters.term_of(parameter, nominal) for parameter in chosen]
        problem = Problem(arm, refitted, ()).with_terms(terms, Motion(refitted.q))
        targets = np.array([robot.targets[name] for name in points.target_names])
        rotations = np.array([robot.target_rotations.get(name, np.eye(3)) for name in points.target_names])
        state = State(robot.T_world_base, targets, np.array(start), rotations)
        self.weight = np.repeat(problem.weights, 3)
        J = problem.jacobian(state) * self.weight[:, None]
        self.r = problem.residuals(state).reshape(-1) * self.weight
        self.robot, self.q, self.step = robot, points.q, step
        self.poses, self.joints = points.poses, joints
        self.pose = np.concatenate([points.pose, points.pose[points.oriented()]])
        self.flat_pose = np.repeat(self.pose, 3)
        self.positions = 3 * len(points)
        column = {name: J[:, problem.outer + k] for k, name in enumerate(names)}
        self.turn = np.stack([column[name] for name in turns], axis=1)
        self.maps = {name: column[name] for name in maps}
        self.value = {p.name: value for p, value in zip(chosen, start, strict=True) if p.name in maps}
        self.geometry = np.column_stack([J[:, : problem.outer], *(column[name] for name in geometry)])
        active = {p.kind for p in chosen if p.name in maps and getattr(thesis_map, p.kind).any()}
        self.active = [p.name for p in chosen if p.name in maps and p.kind in active]
        self.beside = np.zeros((len(self.r), 0))
        self._bases: dict[tuple[tuple[str, ...], bool] | None, FloatArray] = {}
        self._last: tuple[FloatArray, FloatArray, float] | None = None
        # where the rows of each pose stand, -1 for none
        order = np.argsort(self.flat_pose, kind="stable")
        count = np.bincount(self.flat_pose, minlength=self.poses)
        place = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
        self.rows = np.full((self.poses, count.max()), -1)
        self.rows[self.flat_pose[order], place] = order

    def basis(self, without: Sequence[str] = (), beside: bool = True) -> FloatArray:
        """Orthonormal basis of what is refitted: geometry, the robot's joint map without some terms, `beside`."""
        key = (tuple(name for name in without if name in self.active), beside)
        if key not in self._bases:
            if None not in self._bases:
                self._bases[None] = _basis(self.geometry)
            names = [name for name in self.active if name not in without]
            columns = np.array([self.maps[name] for name in names]).reshape(len(names), len(self.r)).T
            if beside:
                columns = np.hstack([columns, self.beside])
            self._bases[key] = extended(self._bases[None], columns)
        return self._bases[key]

    def refit_beside(self, columns: FloatArray) -> None:
        """Refit more columns, (3 rows, k), in all tests to come."""
        self.beside = np.hstack([self.beside, columns])
        self._bases = {None: self._bases[None]}

    def explained(self, without: Sequence[str] = ()) -> FloatArray:
        """Residuals of the robot without some of its joint map's terms, (3 rows,)."""
        return self.r + sum((self.maps[name] * self.value[name] for name in without), np.zeros(len(self.r)))

    def size(self, r: FloatArray) -> float:
        """Root mean square distance of rows (3 rows,), metres; orientations do not count."""
        off = (r / self.weight)[: self.positions].reshape(-1, 3)
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))

    def rms(self) -> float:
        """Root mean square distance of the points after the linearised refit, metres."""
        Q = self.basis()
        return self.size(self.r - Q @ (Q.T @ self.r))

    def per_joint(self, size: ArrayLike) -> FloatArray:
        """Derivatives by one coefficient per joint of its own angle times a number of each pose, (3 rows, joints)."""
        return self.turn * np.nan_to_num(np.asarray(size, dtype=float))[self.flat_pose]

    def left_out(self, residual: FloatArray, Q: FloatArray) -> FloatArray:
        """What is left of each pose by the fit to all others: (I - H_pp)^-1 r_p, with the hat matrix H = Q Q^T."""
        used = self.rows >= 0
        padded = np.where(used, self.rows, 0)
        q = Q[padded] * used[..., None]
        r = residual[padded] * used
        value, vector = np.linalg.eigh(np.eye(self.rows.shape[1]) - q @ q.transpose(0, 2, 1))
        # what one pose alone decides leaves no residual and cannot be left out
        inverse = np.where(value > 1e-8, 1.0 / np.maximum(value, 1e-8), 0.0)
        r = np.einsum("nij,nj->ni", vector, inverse * np.einsum("nji,nj->ni", vector, r))
        out = np.empty_like(residual)
        out[self.rows[used]] = r[used]
        return out

    def test(self, X: FloatArray, without: Sequence[str] = (), Q: FloatArray | None = None) -> TestOutcome | None:
        """JointTerms beside what is refitted.

        Parameters
        ----------
        X : ndarray, shape (3 rows, k)
            Derivatives by the terms' coefficients.
        without : sequence of str
            Joint map parameters that the terms take the place of.
        Q : ndarray, optional
            Basis of what is refitted, `basis` unless given.

        Returns
        -------
        TestOutcome or None
            None where no coefficient can be seen.
        """
        Q = self.basis(without) if Q is None else Q
        y = self.explained(without)
        y = y - Q @ (Q.T @ y)
        reduced = X - Q @ (Q.T @ X)
        independent, U = _independent(X, reduced)
        if not len(independent) or len(y) - Q.shape[1] - 2 * len(independent) < 1:
            return None
        reduced = reduced[:, independent]
        P = np.linalg.solve(U.T @ reduced, U.T)
        beta = P @ y
        residual = y - reduced @ beta
        residual_out = self.left_out(residual, np.hstack([Q, U]))
        change = np.stack([np.bincount(self.flat_pose, row * residual_out, minlength=self.poses) for row in P])
        C = (self.poses - 1) / self.poses * change @ change.T
        p = f_beyond(float(beta @ np.linalg.pinv(C) @ beta) / len(independent), len(independent), self.poses - 1)
        return TestOutcome(
            independent, beta, C, p, residual, self._before(y, Q), self.size(residual_out), self.size(reduced @ beta)
        )

    def _before(self, y: FloatArray, Q: FloatArray) -> float:
        """Root mean square of poses left out without a term, metres; many terms share one basis."""
        if self._last is None or self._last[0] is not Q or not np.array_equal(self._last[1], y):
            self._last = (Q, y, self.size(self.left_out(y, Q)))
        return self._last[2]


def _without_frame_terms(robot: Robot, points: PointSet) -> PointSet:
    """Points as they would have been measured without what the robot's frame terms do."""
    if robot.frame_terms is None:
        return points
    plain = robot.replace(frame_terms=None)
    xyz = points.xyz + points.predicted(plain) - points.predicted(robot)
    if points.rotation is None or not robot.target_rotations:
        return replace(points, xyz=xyz)
    turn = points.predicted_rotations(plain) @ points.predicted_rotations(robot).transpose(0, 2, 1)
    return replace(points, xyz=xyz, rotation=turn @ points.rotation)


@dataclass(frozen=True, eq=False)
class TestOutcome:
    """Outcome of `Linearised.test`; made by the hundred inside searches and kept by nobody, so its arrays stay open.

    Attributes
    ----------
    kept : ndarray of int, shape (k,)
        Columns whose coefficients were seen.
    beta : ndarray, shape (k,)
    C : ndarray, shape (k, k)
        Their covariance.
    p : float
    left : ndarray, shape (3 rows,)
        Residuals with the terms.
    before, after : float
        Root mean square distance of poses left out, without and with the terms, metres.
    at_tool : float
        See `irbcal.joint_analysis.terms.Term`.
    """

    kept: IntArray
    beta: FloatArray
    C: FloatArray
    p: float
    left: FloatArray
    before: float
    after: float
    at_tool: float


def term_of(
    model: Linearised,
    outcome: TestOutcome,
    kind: Kind,
    joint: int | None,
    names: Sequence[str],
    frequency: float | None = None,
    tried: int = 1,
) -> JointTerm:
    """A test's outcome as a term without a verdict; its p counts as often as ``tried`` says."""
    half = quantile(model.poses - 1) * np.sqrt(np.diag(outcome.C))
    return JointTerm(
        kind,
        joint,
        tuple(names[k] for k in outcome.kept),
        tuple(map(float, outcome.beta)),
        tuple(map(float, outcome.beta - half)),
        tuple(map(float, outcome.beta + half)),
        min(1.0, outcome.p * tried),
        outcome.before,
        outcome.after,
        outcome.at_tool,
        frequency=None if frequency is None else (frequency,),
    )


def _independent(X: FloatArray, reduced: FloatArray) -> tuple[IntArray, FloatArray]:
    """Columns of which something is left beside the others, and an orthonormal basis of what is left (Gram-Schmidt)."""
    chosen: list[int] = []
    Q = np.empty(X.shape, order="F")
    for k in range(X.shape[1]):
        basis = Q[:, : len(chosen)]
        column = reduced[:, k] - basis @ (basis.T @ reduced[:, k])
        column -= basis @ (basis.T @ column)
        size, norm = np.linalg.norm(column), np.linalg.norm(X[:, k])
        if size > UNSEEN * norm:
            Q[:, len(chosen)] = column / size
            chosen.append(k)
    return np.array(chosen, dtype=int), Q[:, : len(chosen)]


def _basis(N: FloatArray) -> FloatArray:
    """Orthonormal basis of the columns' space; columns that others can make do not count."""
    size = np.linalg.norm(N, axis=0)
    Q, R = np.linalg.qr(N[:, size > 0] / size[size > 0])
    U, value, _ = np.linalg.svd(R)
    return Q @ U[:, value > ROUNDING * value[0]]


def extended(Q: FloatArray, X: FloatArray) -> FloatArray:
    """A basis with more columns."""
    reduced = X - Q @ (Q.T @ X)
    reduced = reduced - Q @ (Q.T @ reduced)
    return np.hstack([Q, _independent(X, reduced)[1]])


def by_play(model: Linearised) -> FloatArray:
    """By the backlash of each joint: reached from below, half of it is missing; shape (3 rows, joints)."""
    return -0.5 * model.per_joint(np.sign(model.step))


def by_move(model: Linearised) -> FloatArray:
    """By the error of each joint per radian of its last move; shape (3 rows, joints)."""
    return model.per_joint(model.step)


def by_gain(model: Linearised, j: int) -> tuple[FloatArray, tuple[str, ...]]:
    """By the gain of a joint (Nubiola 2011, eq. 3.31), and what of the joint map it takes the place of."""
    name = f"gain{j + 1}"
    return model.maps[name][:, None], (name,)


def by_series(model: Linearised, j: int, order: int, frequency: float) -> tuple[FloatArray, tuple[str, ...]]:
    """By the coefficients of a joint's `fourier_columns`, and what of the joint map it replaces."""
    is_joint_6 = j == 5 and model.robot.arm.six_revolute
    X = model.turn[:, j : j + 1] * fourier_columns(model.q[:, j], order, frequency)[model.flat_pose]
    return X, tuple(f"fourier_{name}" for name in parameters.FOURIER) if is_joint_6 else ()


def by_stiffness(model: Linearised) -> tuple[FloatArray, tuple[str, ...]]:
    """By A and B of the bending arm (`Stiffness.coefficients`), and what of the joint map they replace."""
    names = ("stiffness_A", "stiffness_B")
    return np.stack([model.maps[name] for name in names], axis=1), names


def of_term(model: Linearised, term: JointTerm) -> FloatArray:
    """Of a term that was tested, shape (3 rows, k)."""
    if term.kind == "stiffness" or term.joint is None:
        return by_stiffness(model)[0]
    j = term.joint - 1
    if term.kind == "backlash":
        return by_play(model)[:, j : j + 1]
    if term.kind == "move":
        return by_move(model)[:, j : j + 1]
    if term.kind == "gain":
        return by_gain(model, j)[0]
    frequency = 1.0 if term.frequency is None else term.frequency[0]
    return by_series(model, j, fourier_order(term), frequency)[0]


def names_of(term: JointTerm) -> tuple[str, ...]:
    """Names of the coefficients that the columns of `of_term` belong to, seen or not."""
    if term.kind == "stiffness":
        return ("A", "B")
    return fourier_names(fourier_order(term)) if term.kind == "fourier" else term.names
