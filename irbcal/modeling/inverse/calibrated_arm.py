r"""Inverse kinematics of a calibrated robot (Nubiola 2011, section 6.2), for batches.

The fixed point of the thesis (`irbcal.modeling.inverse.fixed_point`) takes most poses there. Poses for
which it stalls change over to damped Newton steps (Levenberg-Marquardt) on the geometric Jacobian of the
calibrated arm times that of its joint map, from several starts. What neither solves is flagged with the reason.
The compiled kernel does all of it where there is one (`inverses_of` in ``kernel.hpp``); numpy is its oracle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, newton
from irbcal.modeling.inverse.branches import branch_signs
from irbcal.modeling.inverse.fixed_point import (
    NEAR_NOMINAL,
    difference,
    kernel_of,
    next_fake,
    same_turn,
    start_turns,
    starts_of,
)
from irbcal.modeling.inverse.orthoparallel import OrthoParallel
from irbcal.modeling.inverse.poses import check_poses, pose_columns, usable
from irbcal.modeling.inverse.result import InverseResult, Method, Reason
from irbcal.modeling.robot import Robot

__all__ = ["InverseResult", "Method", "Reason", "solve", "solve_nearest"]

PIECE = 2048
"""Poses that numpy works on at a time, for memory."""

ITERATIONS = 24
"""Nubiola 2011, Table 6.1, needs three; arms far from their nominal ones up to twenty."""

STALLED = 0.5
"""An iteration that leaves more than this share of the error is given up for Newton's steps."""

SolveStage: TypeAlias = tuple[int, int, int, bool]
STAGES: tuple[SolveStage, ...] = (
    (1, 0, 10, False),
    (12, 1, 3, True),
    (6, 0, 10, False),
    (24, 2, 10, False),
    (96, 2, 10, False),
    (64, 2, 30, False),
    (1, 2, 100, False),
)
"""Number of starts, `newton.solve`'s straighten and patience, and whether starts are around a seed of the branch and
steps within the limits, one after the other for the poses still left.

The single start is where the fixed point came to; the last lot is for two singularities at once.
"""

START_SPREAD = 0.03
"""Radians: standard deviation of the starts around a seed."""

CLOSE = 0.1
"""A target beyond the nominal reach is out of reach when several starts leave more than this share of the largest
distance between the nominal and the calibrated arm's tips."""

FOLD = 0.2
"""Radians that joints 2 and 3 of nominal and calibrated arm may differ by, next to the elbow singularity."""

NEAR_SEED = 0.1
"""Radians: in whatever branch, a solution so near to the seed is the one that is looked for."""

NEAR_WRIST_SINGULARITY = 0.1
"""Radians between axes 4 and 6 next to the wrist singularity."""

PULL = 5e-4
"""Share of the reach by which a start is moved inside the nominal reach: off the elbow singularity."""


def solve(
    robot: Robot,
    nominal: Arm,
    T_base_tip: ArrayLike,
    seed: ArrayLike | None = None,
    configuration: ArrayLike | None = None,
    position: float = 1e-10,
    rotation: float = 1e-10,
    thorough: bool = True,
) -> InverseResult:
    """Commanded joints that bring the tip of a calibrated robot to given poses.

    Parameters
    ----------
    robot : Robot
        Calibrated arm and joint map.
    nominal : Arm
        The arm before calibration; near to ortho-parallel with a spherical wrist.
    T_base_tip : array_like, shape (n, 4, 4)
        Tip link in the base link.
    seed : array_like, shape (n, 6) or (6,), optional
        Joints (radians) whose branch is kept and whose turns are nearest; next to a singularity a solution within 0.1
        rad in another branch will do.
    configuration : array_like of int, shape () or (n,), optional
        Branch to keep, 0 to 7; that of the seed where there is one, else front, up, no-flip.
    position, rotation : float
        Tolerances, metres and radians.
    thorough : bool
        Try many starts for poses that the seed's neighbourhood does not solve. Without, only solutions near the seed
        are looked for, which is what a correction needs, and much quicker for poses that have none.

    Raises
    ------
    RobotError
        If shapes do not fit, the seed looks like degrees, or the nominal arm has no closed-form inverse.
    """
    tolerance = position, rotation
    return _solved(robot, nominal, T_base_tip, seed, configuration, tolerance, len(STAGES) if thorough else 1)


def _solved(
    robot: Robot,
    nominal: Arm,
    T: ArrayLike,
    seed: ArrayLike | None,
    configuration: ArrayLike | None,
    tolerance: tuple[float, float],
    stages: int,
) -> InverseResult:
    """The result of `solve`, where so many of `STAGES` are gone through."""
    kernel = kernel_of(robot, nominal)
    if kernel is not None and configuration is None and isinstance(T, np.ndarray):
        result = _by_kernel(kernel, T, None, seed, tolerance, stages)  # as they are, which it mostly takes
        if result is not None:
            return result
    T = np.ascontiguousarray(check_poses(T))
    near = None
    if seed is not None:
        near = nominal.check_joints(seed)
        if len(near) not in (1, len(T)):
            raise RobotError(f"seed joints need shape (6,) or ({len(T)}, 6), found {near.shape}", parameter="seed")
        near = np.ascontiguousarray(np.broadcast_to(near, (len(T), 6)))
    branch = None if configuration is None else closed_form.check_configuration(configuration, len(T))
    if kernel is not None:
        signs = None if branch is None else np.ascontiguousarray(branch_signs(branch).T)
        result = _by_kernel(kernel, T, signs, near, tolerance, stages)
        if result is not None:
            return result
    parts = []
    for first in range(0, max(len(T), 1), PIECE):
        rows = slice(first, first + PIECE)
        near_rows, branch_rows = None if near is None else near[rows], None if branch is None else branch[rows]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            solver = _Solver(robot, nominal, T[rows], near_rows, branch_rows, tolerance)
            parts.append(solver.solve(STAGES[:stages]))
    names = [field.name for field in fields(InverseResult)]
    return InverseResult(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _by_kernel(
    kernel: Any,
    T: FloatArray,
    signs: FloatArray | None,
    near: ArrayLike | None,
    tolerance: tuple[float, float],
    stages: int,
) -> InverseResult | None:
    """Inverses of poses T (n, 4, 4) by the compiled kernel; None where it refuses what it is given."""
    n = len(T)
    joints, residuals = np.empty((n, 6)), np.empty((2, n))
    numbers, flags = np.empty((4, n), dtype=np.int64), np.empty((3, n), dtype=bool)
    if not kernel.inverses(T, signs, near, *tolerance, joints, residuals, numbers, flags, stages):
        return None
    for array in (joints, residuals, numbers, flags):
        array.setflags(write=False)
    iterations, configuration, method, reason = numbers
    converged, inside, branch_kept = flags
    return InverseResult.of_new(
        joints=joints,
        converged=converged,
        inside=inside,
        configuration=configuration,
        branch_kept=branch_kept,
        iterations=iterations,
        method=method,
        position_residual=residuals[0],
        rotation_residual=residuals[1],
        reason=reason,
    )


def solve_nearest(robot: Robot, nominal: Arm, T_base_tip: ArrayLike, near: FloatArray) -> InverseResult:
    """The solution in the nominal branch nearest to given joints, else one within the limits in any branch.

    Parameters
    ----------
    robot, nominal, T_base_tip
        See `solve`.
    near : ndarray, shape (6,)
        Radians.
    """
    T = check_poses(T_base_tip)
    seed, branch = closed_form.nearest(nominal, closed_form.branches(nominal, T), near)
    seed = np.where(branch[:, None] >= 0, seed, near)
    tolerance = 1e-10, 1e-10
    result = _solved(robot, nominal, T, seed, None, tolerance, 4)
    for stages in (1, 3, 4, len(STAGES)):
        for configuration in (None, *range(8)):
            outside = np.flatnonzero(~result.inside & (result.reason != Reason.NOT_A_POSE))
            if not len(outside):
                return result
            start = seed[outside] if configuration is None else near
            second = _solved(robot, nominal, T[outside], start, configuration, tolerance, stages)
            result = result.improved(outside, second)
    return result


class _Solver:
    """The inverse by numpy: for poses (n, 4, 4), joints (n, 6) to stay near, and branches (n,)."""

    def __init__(
        self,
        robot: Robot,
        nominal: Arm,
        T: FloatArray,
        near: FloatArray | None,
        branch: IntArray | None,
        tolerance: tuple[float, float],
    ) -> None:
        n = len(T)
        self.nominal, self.tolerance = nominal, tolerance
        self.closed = OrthoParallel.from_arm(nominal, NEAR_NOMINAL)
        self.chain = newton.CalibratedChain(robot, self.closed.reach)
        self.difference = difference(robot, nominal)
        self.H = pose_columns(T)
        self.bad_pose, self.bad_seed = ~usable(T, self.H), np.zeros(n, dtype=bool)
        self.near = None
        if near is not None:
            self.bad_seed = np.isnan(near.sum(axis=1))
            self.near = np.nan_to_num(near).T
            branch = self.closed.configuration(self.near.T) if branch is None else branch
        self.branch = np.zeros(n, dtype=int) if branch is None else branch
        self.q = np.full((6, n), np.nan)  # the best known, their errors, and how good they are
        self.position, self.rotation, self.margin = np.full((3, n), np.nan)
        self.iterations, self.method, self.rank = np.zeros(n, dtype=int), np.zeros(n, dtype=int), np.full(n, np.inf)

    def good(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Whether both errors (n,) are within the tolerances."""
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def inside(self, joints: FloatArray) -> BoolArray:
        """Whether joints (6, n) are within the limits as they are."""
        lower = self.nominal.lower - closed_form.LIMIT_TOLERANCE
        upper = self.nominal.upper + closed_form.LIMIT_TOLERANCE
        return np.logical_and.reduce((joints >= lower[:, None]) & (joints <= upper[:, None]), axis=0)

    def out_of_reach(self) -> BoolArray:
        """Whether the nominal arm does not reach poses, nor the calibrated one nearly so, (n,)."""
        return (self.margin < 0) & ~(self.position <= CLOSE * self.difference)

    def close(self, rows: IntArray) -> FloatArray | None:
        """Joints (6, k) that some poses are to stay near."""
        return None if self.near is None else self.near[:, rows]

    def solve(self, stages: Sequence[SolveStage]) -> InverseResult:
        """Joints of all poses."""
        todo = np.flatnonzero(~self.bad_pose & ~self.bad_seed)
        self.fixed_point(todo)
        solved = self.good(self.position, self.rotation)
        self.method[solved] = Method.FIXED_POINT
        self.search(todo[~solved[todo]], stages)
        beyond = self.into_limits()
        if len(stages) > 1:  # next to a singularity a branch has several solutions
            beyond = beyond[solved[beyond]]
            wrist, radius = self.closed.wrist_angle(self.q.T), np.abs(self.closed.radius(self.q.T))
            singular = ((wrist < NEAR_WRIST_SINGULARITY) | (np.minimum(radius, self.margin) < 20 * self.difference))[
                beyond
            ]
            self.rank[beyond] = -2.0
            self.search(beyond[singular], stages)
            self.search(beyond[~singular], stages[:2])
            self.into_limits()
        converged = self.good(self.position, self.rotation)
        configuration = np.where(converged, self.closed.configuration(np.nan_to_num(self.q).T), -1)
        conditions = [self.bad_pose, self.bad_seed, converged, self.out_of_reach()]
        reasons = [Reason.NOT_A_POSE, Reason.BAD_SEED, Reason.CONVERGED, Reason.OUT_OF_REACH]
        joints = np.where(converged, self.q, np.nan)
        return InverseResult(
            joints=joints.T,
            converged=converged,
            inside=self.inside(joints),
            configuration=configuration,
            branch_kept=configuration == self.branch,
            iterations=self.iterations,
            method=np.where(converged, self.method, Method.NONE),
            position_residual=self.position,
            rotation_residual=self.rotation,
            reason=np.select(conditions, reasons, Reason.NOT_FOUND),
        )

    def fixed_point(self, rows: IntArray) -> None:
        """The iteration of Nubiola 2011, Figure 6.2, until each pose is done or stalls."""
        fake, last, q = self.H[:, :, rows], np.full(len(rows), np.inf), None
        for count in range(1, ITERATIONS + 1):
            if not len(rows):
                return
            H = self.H[:, :, rows]
            q_new, margin = self.closed.branch(fake.reshape(12, -1), branch_signs(self.branch[rows]))
            if q is None:
                self.margin[rows] = margin
                q = start_turns(self.nominal, q_new, self.close(rows))
            else:
                q = same_turn(q_new, q)
            tip = self.chain.tip(q)
            position, rotation = newton.errors(tip, H)
            merit = self.chain.merit(position, rotation)
            better = merit < last  # False for NaN: not within reach
            self._keep(rows[better], q[:, better], position[better], rotation[better])
            self.iterations[rows] = count
            on = np.flatnonzero((merit <= STALLED * last) & ~self.good(position, rotation))
            fake = next_fake(fake[..., on], tip[..., on], H[..., on])
            rows, last, q = rows[on], merit[on], q[:, on]

    def _keep(self, rows: IntArray, q: FloatArray, position: FloatArray, rotation: FloatArray) -> None:
        self.q[:, rows], self.position[rows], self.rotation[rows] = q, position, rotation

    def into_limits(self) -> IntArray:
        """Bring solutions beyond a limit back where possible; those that stay beyond are returned."""
        beyond = np.flatnonzero(self.good(self.position, self.rotation) & ~self.inside(self.q))
        fits, q, errors, evaluations = newton.into_limits(
            self.chain, self.nominal, self.H[:, :, beyond], self.q[:, beyond], self.close(beyond)
        )
        self.iterations[beyond[fits]] += evaluations
        take = self.good(*errors)
        self._keep(beyond[fits][take], q[:, take], *errors[:, take])
        return beyond[~self.inside(self.q[:, beyond])]

    # -------------------------------------------------------------- damped Newton

    def search(self, rows: IntArray, stages: Sequence[SolveStage]) -> None:
        """Newton's steps for poses that the fixed point left: from where it came to, then from many starts at once."""
        if not len(rows):
            return
        pull, lower, upper = PULL * self.closed.reach, self.nominal.lower[:, None], self.nominal.upper[:, None]
        H, signs, near = self.H[:, :, rows], branch_signs(self.branch[rows]), self.close(rows)
        pulled, self.margin[rows] = self.closed.branch(H.reshape(12, -1), signs, pull)
        pulled = start_turns(self.nominal, pulled, near)
        start = np.where(np.isfinite(self.q[:, rows]).all(axis=0), self.q[:, rows], pulled)
        lacking = self.margin[rows] > -2.0 * self.difference
        beyond = rows[~lacking]  # how far they are from the nearest joints is all there is to say
        errors = newton.errors(self.chain.tip(start[:, ~lacking]), H[:, :, ~lacking])
        self.position[beyond], self.rotation[beyond] = errors
        self.iterations[beyond] += 1
        # at the limit of the reach alone a few starts are enough to know; with another singularity they are not
        radius = np.abs(self.closed.radius(pulled.T))
        plain = (self.closed.wrist_angle(pulled.T) > 0.05) & (radius > 5 * self.difference)
        # upper arm and forearm are where the wrist centre wants them, but for the fold of the stretched arm
        folds = ((pulled[1:3] >= lower[1:3] - FOLD) & (pulled[1:3] <= upper[1:3] + FOLD)).all(axis=0)
        seeded = np.zeros(len(rows), dtype=bool)
        if near is not None:
            seeded = self.closed.configuration(near.T) == self.branch[rows]
        for count, straighten, patience, within in stages:
            if count > 6:
                lacking &= folds & ~(plain & self.out_of_reach()[rows])
            # a seed may be across a singularity from its solution
            todo = np.flatnonzero(seeded & (self.rank[rows] > -4.0) if within else lacking)
            if not len(todo):
                continue
            normal, best, limits = iter(starts_of(count)), self.q[:, rows[todo]], None
            tried = [np.where(np.isfinite(best), best, start[:, todo])]
            if within and near is not None:
                limits = self.nominal.lower, self.nominal.upper
                steps = np.zeros((6, 1)), *(START_SPREAD * starts_of(count)[: count - 1, :, None])
                tried = [np.clip(near[:, todo] + step, lower, upper) for step in steps]
            elif count > 1:
                tried = [pulled[:, todo], *([] if near is None else [near[:, todo]])]
            while len(tried) < count:
                # solutions of targets moved a little: on all sides of the holes that errors leave at singularities
                turn, shift = next(normal).reshape(2, 3, 1)
                turn = turn * (0.01, 0.0, 0.03)[len(tried) % 3]
                shift = shift * (0.0, 0.5, 1.5)[len(tried) % 3] * self.difference
                moved = newton.moved(H[:, :, todo], turn, shift).reshape(12, -1)
                q, _ = self.closed.branch(moved, signs[:, todo], pull)
                tried.append(start_turns(self.nominal, q, None if near is None else near[:, todo]))
            self._best(rows[todo], np.stack(tried, axis=1), straighten, patience, limits)
            lacking[todo] &= self.rank[rows[todo]] > -4.0
            if count >= 6 and not within:
                lacking &= self.rank[rows] > -3.0

    def _best(self, rows: IntArray, starts: FloatArray, *how: Any) -> None:
        """Run from all starts (6, k, n) of n poses, and keep what is best; ``how``: `newton.solve`'s last arguments."""
        _, k, n = starts.shape
        every = np.tile(rows, k)
        H, near = self.H[:, :, every], self.close(every)
        q, position, rotation, evaluations = newton.solve(self.chain, H, starts.reshape(6, -1), self.tolerance, *how)
        beyond = np.flatnonzero(self.good(position, rotation) & ~self.inside(q))
        fits, back, left, more = newton.into_limits(
            self.chain, self.nominal, H[:, :, beyond], q[:, beyond], self.close(every[beyond])
        )
        evaluations[beyond[fits]] += more
        take = self.good(*left)
        beyond = beyond[fits][take]
        q[:, beyond], position[beyond], rotation[beyond] = back[:, take], *left[:, take]
        self.iterations[rows] += evaluations.reshape(k, n).sum(axis=0)
        same_branch = self.closed.configuration(q.T) == self.branch[every]
        if near is not None:
            same_branch |= np.abs(q - near).max(axis=0) < NEAR_SEED
        # a solution within the limits, then one in its branch, then the least error; the first of equals
        merit = self.chain.merit(position, rotation)
        rank = np.where(self.good(position, rotation), -1.0 - same_branch - 2.0 * self.inside(q), merit)
        rank = np.where(np.isnan(rank), np.inf, rank).reshape(k, n)
        best = rank.min(axis=0)
        take = best < self.rank[rows]
        column = (np.argmin(rank, axis=0) * n + np.arange(n))[take]
        self._keep(rows[take], q[:, column], position[column], rotation[column])
        self.rank[rows[take]], self.method[rows[take]] = best[take], Method.NEWTON
