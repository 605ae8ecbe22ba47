r"""Inverse kinematics of a calibrated robot (Nubiola 2011, section 6.2), for batches.

The fixed point of the thesis (`irbcal.modeling.inverse.fixed_point`) takes most poses there. Poses for
which it stalls change over to damped Newton steps (Levenberg-Marquardt) on the geometric Jacobian of the
calibrated arm times that of its joint map, from several starts. What neither solves is flagged with the reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, row_arithmetic
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, newton
from irbcal.modeling.inverse.branches import branch_signs
from irbcal.modeling.inverse.fixed_point import FixedPoint, FixedPointState, difference, kernel_of, room, starts_of
from irbcal.modeling.inverse.poses import check_poses, pose_columns, usable
from irbcal.modeling.inverse.result import InverseResult, Method, Reason
from irbcal.modeling.robot import Robot

__all__ = ["InverseResult", "Method", "Reason", "solve", "solve_nearest"]

BLOCK = 8192
"""Poses per block: more, and rows no longer stay in the cache; fewer, and the calls of numpy outweigh their work."""

FEW = 32
"""Poses for which what is done around an iteration takes longer than the iteration."""

Stage: TypeAlias = tuple[int, int, int, bool]
NEWTON_STARTS: tuple[Stage, ...] = (
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

AROUND = 0.03
"""Radians: standard deviation of the starts around a seed."""

CLOSE = 0.1
"""A target beyond the nominal reach is out of reach when several starts leave more than this share of the largest
distance between the nominal and the calibrated arm's tips."""

FOLD = 0.2
"""Radians that joints 2 and 3 of nominal and calibrated arm may differ by, next to the elbow singularity."""

NEAR_SEED = 0.1
"""Radians: in whatever branch, a solution so near to the seed is the one that is looked for."""

SINGULAR = 0.1
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
    if configuration is None:
        quick = _few_by_kernel(
            robot, nominal, T_base_tip, seed, position, rotation, len(NEWTON_STARTS) if thorough else 1
        )
        if quick is not None:
            return quick
    stages = NEWTON_STARTS if thorough else NEWTON_STARTS[:1]
    with row_arithmetic("ignore"):
        return _Solver(robot, nominal, position, rotation, stages).solve(T_base_tip, seed, configuration)


def _few_by_kernel(
    robot: Robot, nominal: Arm, T: ArrayLike, seed: ArrayLike | None, position: float, rotation: float, stages: int
) -> InverseResult | None:
    """The result of `solve` for a few poses where the compiled kernel leaves nothing to be done; else None."""
    n = len(T) if isinstance(T, np.ndarray) and T.ndim == 3 and T.shape[1:] == (4, 4) else 0
    kernel = kernel_of(robot, nominal) if 0 < n <= FEW else None
    if kernel is None:
        return None
    q, left, numbers, flags = room(n)
    if kernel.inverses(T, None, seed, position, rotation, q, left, numbers, flags, stages) != n:
        return None
    for array in (q, left, numbers, flags):
        array.setflags(write=False)
    steps, branch, method, reason = numbers
    converged, inside, kept = flags
    return InverseResult.of_new(
        joints=q,
        converged=converged,
        inside=inside,
        configuration=branch,
        branch_kept=kept,
        iterations=steps,
        method=method,
        position_residual=left[0],
        rotation_residual=left[1],
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
    solver = _Solver(robot, nominal, 1e-10, 1e-10, NEWTON_STARTS[:4])
    with row_arithmetic("ignore"):
        result = solver.solve(T, seed, None)
        for stages in (NEWTON_STARTS[:1], NEWTON_STARTS[:3], NEWTON_STARTS[:4], NEWTON_STARTS):
            solver.stages = stages
            for configuration in (None, *range(8)):
                outside = np.flatnonzero(~result.inside & (result.reason != Reason.NOT_A_POSE))
                if not len(outside):
                    return result
                start = seed[outside] if configuration is None else near
                result = result.improved(outside, solver.solve(T[outside], start, configuration))
    return result


class _Solver:
    def __init__(
        self,
        robot: Robot,
        nominal: Arm,
        position: float,
        rotation: float,
        stages: Sequence[Stage] = NEWTON_STARTS,
    ) -> None:
        self.stages = stages
        self.robot, self.nominal = robot, nominal
        self.iteration = FixedPoint(robot, nominal, position, rotation)
        self.closed, self.chain, self.good = self.iteration.closed, self.iteration.chain, self.iteration.good
        self.pull = PULL * self.closed.reach

    @property
    def difference(self) -> float:
        """See `irbcal.modeling.inverse.fixed_point.difference`."""
        return difference(self.robot, self.nominal)

    def inside(self, joints: FloatArray) -> BoolArray:
        """Whether joints (6, n) are within the limits as they are."""
        lower = self.nominal.lower - closed_form.LIMIT_TOLERANCE
        upper = self.nominal.upper + closed_form.LIMIT_TOLERANCE
        return np.logical_and.reduce((joints >= lower[:, None]) & (joints <= upper[:, None]), axis=0)

    def out_of_reach(self, state: FixedPointState, rows: IntArray | slice) -> BoolArray:
        """Whether the nominal arm does not reach poses, nor the calibrated one nearly so."""
        return (state.margin[rows] < 0) & ~(state.position[rows] <= CLOSE * self.difference)

    # -------------------------------------------------------------- all poses

    def asked_for(
        self, n: int, seed: ArrayLike | None, configuration: ArrayLike | None
    ) -> tuple[FloatArray | None, BoolArray, IntArray]:
        """Joints to stay near (6, n) where there are seeds, which of these are not finite (n,), and branches (n,)."""
        near, bad_seed = None, np.zeros(n, dtype=bool)
        branch = np.zeros(n, dtype=int)
        if seed is not None:
            joints = self.nominal.check_joints(seed)
            if len(joints) not in (1, n):
                raise RobotError(f"seed joints need shape (6,) or ({n}, 6), found {joints.shape}", parameter="seed")
            bad_seed = np.broadcast_to(~np.isfinite(joints).all(axis=1), (n,))
            near = np.broadcast_to(np.where(np.isfinite(joints), joints, 0.0), (n, 6)).T
        if configuration is not None:
            branch = closed_form.check_configuration(configuration, n)
        elif near is not None:
            branch = self.closed.configuration(near.T)
        return near, bad_seed, branch

    def solve(self, T_base_tip: ArrayLike, seed: ArrayLike | None, configuration: ArrayLike | None) -> InverseResult:
        """Joints for poses of the tip, shape (n, 4, 4), near seeds or in configurations, by a fixed point."""
        T = check_poses(T_base_tip)
        n = len(T)
        near, bad_seed, branch = self.asked_for(n, seed, configuration)
        state = FixedPointState(n)
        blocks = [slice(start, start + BLOCK) for start in range(0, n, BLOCK)]
        bad_pose = np.concatenate([~usable(T[k], pose_columns(T[k])) for k in blocks] or [np.zeros(0, dtype=bool)])
        todo = np.flatnonzero(~bad_pose & ~bad_seed)
        signs, close = branch_signs(branch[todo]), None if near is None else near[:, todo]
        if not self.iteration.compiled(T, todo, signs, close, state, len(self.stages)):
            for block in blocks:
                H = pose_columns(T[todo[block]])
                close_here = None if close is None else close[:, block]
                self.iteration.run(todo[block], H, signs[:, block], close_here, state)
        done = self.good(state.position, state.rotation)
        state.method[done & (state.method == Method.NONE)] = Method.FIXED_POINT
        self._newton(np.flatnonzero(~done & ~bad_pose & ~bad_seed), T, branch, near, state)
        beyond = self._into_limits(T, near, state)
        if len(self.stages) > 1 and len(beyond):
            beyond = beyond[done[beyond]]
            singular = self.singular(state)[beyond]
            state.rank[beyond] = -2.0
            self._newton(beyond[singular], T, branch, near, state)
            self._newton(beyond[~singular], T, branch, near, state, 2)
            self._into_limits(T, near, state)
        return self._result(state, branch, bad_pose, bad_seed)

    def _into_limits(self, T: FloatArray, near: FloatArray | None, state: FixedPointState) -> IntArray:
        """Bring solutions beyond a limit back by whole turns, and by what the tolerance leaves open, where possible.

        Those that stay beyond are returned.
        """
        beyond = self.good(state.position, state.rotation) & ~self.inside(state.q)
        for start in range(0, len(rows := np.flatnonzero(beyond)), BLOCK):
            block = rows[start : start + BLOCK]
            close = None if near is None else near[:, block]
            fits, q, errors, evaluations = newton.into_limits(
                self.chain, self.nominal, pose_columns(T[block]), state.q[:, block], close
            )
            block = block[fits]
            state.iterations[block] += evaluations
            take = self.good(*errors)
            block = block[take]
            state.q[:, block], (state.position[block], state.rotation[block]) = q[:, take], errors[:, take]
            beyond[block] = False
        return np.flatnonzero(beyond)

    def _result(
        self, state: FixedPointState, branch: IntArray, bad_pose: BoolArray, bad_seed: BoolArray
    ) -> InverseResult:
        converged = self.good(state.position, state.rotation)
        configuration = np.where(converged, self.closed.configuration(np.where(converged, state.q, 0.0).T), -1)
        state.q[:, ~converged] = np.nan
        reason = np.full(len(branch), Reason.NOT_FOUND)
        if not converged.all():
            reason[self.out_of_reach(state, slice(None))] = Reason.OUT_OF_REACH
        reason[bad_seed], reason[bad_pose], reason[converged] = Reason.BAD_SEED, Reason.NOT_A_POSE, Reason.CONVERGED
        return InverseResult(
            joints=state.q.T.copy(),
            converged=converged,
            inside=self.inside(state.q),
            configuration=configuration,
            branch_kept=configuration == branch,
            iterations=state.iterations,
            method=np.where(converged, state.method, Method.NONE),
            position_residual=state.position,
            rotation_residual=state.rotation,
            reason=reason,
        )

    # -------------------------------------------------------------- damped Newton

    def singular(self, state: FixedPointState) -> BoolArray:
        """Whether joints are next to a singularity, where a branch of a calibrated arm has several solutions, (n,)."""
        wrist, radius = self.closed.wrist_angle(state.q.T), np.abs(self.closed.radius(state.q.T))
        return (wrist < SINGULAR) | (np.minimum(radius, state.margin) < 20 * self.difference)

    def _newton(
        self,
        rows: IntArray,
        T: FloatArray,
        branch: IntArray,
        near: FloatArray | None,
        state: FixedPointState,
        stages: int | None = None,
    ) -> None:
        for start in range(0, len(rows), BLOCK):
            block = rows[start : start + BLOCK]
            close = None if near is None else near[:, block]
            self._newton_starts(pose_columns(T[block]), branch[block], close, block, state, self.stages[:stages])

    def _newton_starts(
        self,
        H: FloatArray,
        branch: IntArray,
        near: FloatArray | None,
        rows: IntArray,
        state: FixedPointState,
        stages: Sequence[Stage],
    ) -> None:
        """Newton's steps for poses that the fixed point left: from where it came to, then from many starts at once."""
        pulled, state.margin[rows] = self.closed.branch(H.reshape(12, -1), branch_signs(branch), self.pull)
        pulled = self.iteration.start_turns(pulled, near)
        start = np.where(np.isfinite(state.q[:, rows]).all(axis=0), state.q[:, rows], pulled)
        lacking = state.margin[rows] > -2.0 * self.difference
        beyond = rows[~lacking]  # how far they are from the nearest joints is all there is to say
        errors = newton.errors(self.chain.tip(start[:, ~lacking]), H[:, :, ~lacking])
        state.position[beyond], state.rotation[beyond] = errors
        state.iterations[beyond] += 1
        # at the limit of the reach alone a few starts are enough to know; with another singularity they are not
        plain = (self.closed.wrist_angle(pulled.T) > 0.05) & (
            np.abs(self.closed.radius(pulled.T)) > 5 * self.difference
        )
        # upper arm and forearm are where the wrist centre wants them, but for the fold of the stretched arm
        lower, upper = (limit[1:3, None] for limit in (self.nominal.lower - FOLD, self.nominal.upper + FOLD))
        folds = ((pulled[1:3] >= lower) & (pulled[1:3] <= upper)).all(axis=0)
        seeded = np.zeros(len(rows), dtype=bool) if near is None else self.closed.configuration(near.T) == branch
        for starts, straighten, patience, within in stages:
            if starts > 6:
                lacking &= folds & ~(plain & self.out_of_reach(state, rows))
            # a seed may be across a singularity from its solution
            unsolved = np.flatnonzero(seeded & (state.rank[rows] > -4.0) if within else lacking)
            for first in range(0, len(unsolved), BLOCK // starts):
                todo = unsolved[first : first + BLOCK // starts]
                goal = H[:, :, todo]
                normal = iter(starts_of(starts))
                close = None if near is None else near[:, todo]
                best = state.q[:, rows[todo]]
                tried = [np.where(np.isfinite(best), best, start[:, todo])]
                if within and near is not None:
                    low, high = self.nominal.lower[:, None], self.nominal.upper[:, None]
                    steps = np.zeros((6, 1)), *(AROUND * starts_of(starts)[: starts - 1, :, None])
                    tried = [np.clip(near[:, todo] + step, low, high) for step in steps]
                elif starts > 1:
                    tried = [pulled[:, todo], *([] if close is None else [close])]
                while len(tried) < starts:
                    # solutions of targets moved a little: on all sides of the holes that errors leave at singularities
                    turn, shift = next(normal).reshape(2, 3, 1)
                    turn = turn * (0.01, 0.0, 0.03)[len(tried) % 3]
                    shift = shift * (0.0, 0.5, 1.5)[len(tried) % 3] * self.difference
                    start_pose = newton.moved(goal, turn, shift)
                    q, _ = self.closed.branch(start_pose.reshape(12, -1), branch_signs(branch[todo]), self.pull)
                    tried.append(self.iteration.start_turns(q, close))
                these = branch[todo], close, rows[todo]
                how = straighten, patience, (self.nominal.lower, self.nominal.upper) if within else None
                lacking[todo] &= self._newton_choice(goal, np.stack(tried, axis=1), *these, state, how)
            if starts >= 6 and not within:
                lacking &= ~(state.rank[rows] <= -3.0)

    def _newton_choice(
        self,
        H: FloatArray,
        starts: FloatArray,
        branch: IntArray,
        near: FloatArray | None,
        rows: IntArray,
        state: FixedPointState,
        how: tuple[int, int, tuple[FloatArray, FloatArray] | None],
    ) -> BoolArray:
        """Run from all starts (6, k, n), keep the best: which lack one in branch (by the seed) and limits, (n,).

        ``how`` are `newton.solve`'s last arguments.
        """
        _, k, n = starts.shape
        targets = np.ascontiguousarray(np.broadcast_to(H[:, :, None], (4, 3, k, n))).reshape(4, 3, -1)
        q, position, rotation, evaluations = newton.solve(
            self.chain, targets, starts.reshape(6, -1).copy(), self.iteration.tolerance, *how
        )
        every_near = None if near is None else np.tile(near, k)
        beyond = np.flatnonzero(self.good(position, rotation) & ~self.inside(q))
        if len(beyond):
            close = None if every_near is None else every_near[:, beyond]
            fits, back, left, more = newton.into_limits(
                self.chain, self.nominal, targets[:, :, beyond], q[:, beyond], close
            )
            evaluations[beyond[fits]] += more
            take = self.good(*left)
            beyond = beyond[fits][take]
            q[:, beyond], position[beyond], rotation[beyond] = back[:, take], *left[:, take]
        state.iterations[rows] += evaluations.reshape(k, n).sum(axis=0)
        same_branch = self.closed.configuration(q.T) == np.tile(branch, k)
        if every_near is not None:
            same_branch |= np.abs(q - every_near).max(axis=0) < NEAR_SEED
        inside = self.inside(q)
        # a solution within the limits, then one in its branch, then the least error; the first of equals
        rank = np.where(
            self.good(position, rotation), -1.0 - same_branch - 2.0 * inside, self.chain.merit(position, rotation)
        )
        rank = np.where(np.isnan(rank), np.inf, rank).reshape(k, n)
        best = rank.min(axis=0)
        take = best < state.rank[rows]
        column = (np.argmin(rank, axis=0) * n + np.arange(n))[take]
        where = rows[take]
        state.q[:, where], state.rank[where] = q[:, column], best[take]
        state.position[where], state.rotation[where] = position[column], rotation[column]
        state.method[where] = Method.NEWTON
        return state.rank[rows] > -4.0
