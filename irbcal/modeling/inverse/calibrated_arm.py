r"""Inverse kinematics of a calibrated robot (Nubiola 2011, section 6.2), for batches.

The fixed point of the thesis (Figures 6.2 and 6.3), with T_n the nominal and T_R the calibrated forward
kinematics and H the target::

    H_fake,i = H_fake,i-1 H_aprox,i-1^-1 H,    q_i = inverse of T_n at H_fake,i,    H_aprox,i = T_R(q_i)

takes the closed-form inverse in one branch and no derivatives; its error shrinks by about a hundred in each
iteration, but not next to a singularity, and it cannot go where the nominal arm does not reach. Poses for
which it stalls change over to damped Newton steps (Levenberg-Marquardt) on the geometric Jacobian of the
calibrated arm times that of its joint map, from several starts. What neither solves is flagged with the reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray, aligned, row_arithmetic
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, newton
from irbcal.modeling.inverse.branches import branch_signs
from irbcal.modeling.inverse.newton import CalibratedChain
from irbcal.modeling.inverse.orthoparallel import TAU, OrthoParallel
from irbcal.modeling.inverse.poses import check_poses, has_last_row, is_rotation, pose_columns
from irbcal.modeling.inverse.result import InverseResult, Method, Reason
from irbcal.modeling.robot import Robot

__all__ = ["InverseResult", "Method", "Reason", "fixed_point_history", "solve"]

BLOCK = 8192
"""Poses per block: more, and rows no longer stay in the cache; fewer, and the calls of numpy outweigh their work."""

NEAR_NOMINAL = 0.02
"""Entries of the nominal table may be this far (m or rad) from ortho-parallel: the iteration makes it good."""

FIXED_POINT_ITERATIONS = 12
"""Nubiola 2011, Table 6.1, needs three."""

STALLED = 0.5
"""An iteration that leaves more than this share of the error is given up for Newton's steps."""

NEWTON_STARTS = ((1, 0, 10), (6, 0, 10), (24, 2, 10), (96, 2, 10), (64, 0, 40))
"""Number of starts, and `newton.solve`'s straighten and patience, one after the other for the poses still left.

The single start is where the fixed point came to; the last lot is for two singularities at once.
"""

CLOSE = 0.1
"""A target beyond the nominal reach is out of reach when several starts leave more than this share of the largest
distance between the nominal and the calibrated arm's tips."""

SLACK = 0.05
"""Radians that a start may be beyond a limit: the iteration may bring it back."""

PULL = 5e-4
"""Share of the reach by which a start is moved inside the nominal reach: off the elbow singularity."""

_Work: TypeAlias = Sequence[NDArray[Any]]
"""Of some poses: places in the state, signs of the branch, last errors, targets, fake targets and last joints."""


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
        Joints (radians) whose branch is kept and whose turns are nearest.
    configuration : array_like of int, shape () or (n,), optional
        Branch to keep, 0 to 7; that of the seed where there is one, else front, up, no-flip.
    position, rotation : float
        Tolerances, metres and radians.
    thorough : bool
        Try many starts for poses that the seed's neighbourhood does not solve. Without, only solutions near the seed
        are looked for, which is what a correction needs, and much quicker for poses that have none.

    Returns
    -------
    InverseResult

    Raises
    ------
    RobotError
        If shapes do not fit, the seed looks like degrees, or the nominal arm has no closed-form inverse.
    """
    stages = NEWTON_STARTS if thorough else NEWTON_STARTS[:1]
    with row_arithmetic("ignore"):
        return _Solver(robot, nominal, position, rotation, stages).solve(T_base_tip, seed, configuration)


def fixed_point_history(
    robot: Robot, nominal: Arm, T_base_tip: FloatArray, configuration: ArrayLike, iterations: int
) -> tuple[FloatArray, FloatArray]:
    """Errors of the fixed point alone, iteration by iteration (Nubiola 2011, Table 6.1).

    Parameters
    ----------
    robot : Robot
    nominal : Arm
    T_base_tip : ndarray, shape (n, 4, 4)
    configuration : array_like of int, shape () or (n,)
    iterations : int

    Returns
    -------
    position, rotation : ndarray, shape (iterations, n)
        Metres and radians; NaN where the nominal arm does not reach.
    """
    solver = _Solver(robot, nominal, 0.0, 0.0)
    H = pose_columns(check_poses(T_base_tip))
    signs = branch_signs(closed_form.check_configuration(configuration, len(T_base_tip)))
    fake, q, errors = H, np.zeros((6, 1)), []
    for iteration in range(iterations):
        q_new, _ = solver.closed.branch(fake.reshape(12, -1), signs)
        q = _same_turn(q_new, q) if iteration else solver.start_turns(q_new, q)
        tip = solver.chain.tip(q)
        errors.append(newton.errors(tip, H))
        fake = _next_fake(fake, tip, H)
    position, rotation = np.array(errors).swapaxes(0, 1)
    return position, rotation


class _State:
    """Best known joints and their errors for all poses."""

    def __init__(self, n: int) -> None:
        self.q = np.full((6, n), np.nan)
        self.position, self.rotation = np.full(n, np.nan), np.full(n, np.nan)
        self.iterations = np.zeros(n, dtype=int)
        self.method = np.zeros(n, dtype=np.int8)
        self.margin = np.full(n, np.nan)
        self.rank = np.full(n, np.inf)

    def keep(
        self,
        these: IntArray | slice,
        index: IntArray,
        better: BoolArray,
        now: Sequence[FloatArray],
        before: Sequence[FloatArray],
        iterations: int,
    ) -> None:
        """Joints and errors of some poses of a block: those of now where they are better, else those of before.

        After the first iteration there are none of before, and where it found none the state stays.
        """
        rows, better = index[these], better[these]
        self.iterations[rows] += iterations
        for kept, new, old in zip((self.q, self.position, self.rotation), now, before, strict=True):
            if better.all():
                kept[..., rows] = new[..., these]
            elif iterations > 1:
                kept[..., rows] = np.where(better, new[..., these], old[..., these])
            else:
                kept[..., rows[better]] = new[..., these][..., better]


class _Solver:
    def __init__(
        self,
        robot: Robot,
        nominal: Arm,
        position: float,
        rotation: float,
        stages: Sequence[tuple[int, int, int]] = NEWTON_STARTS,
    ) -> None:
        self.stages = stages
        self.robot, self.nominal = robot, nominal
        self.closed = OrthoParallel.of(nominal, NEAR_NOMINAL)
        self.chain = CalibratedChain(robot, self.closed.reach)
        self.tolerance = position, rotation
        self.pull = PULL * self.closed.reach
        self.wider = replace(nominal, lower=nominal.lower - SLACK, upper=nominal.upper + SLACK)

    @cached_property
    def difference(self) -> float:
        """About the largest distance (m) between tips of the two arms, from random joints."""
        q = self.nominal.random_joints(500, 0)
        difference = self.robot.poses(q) - self.nominal.forward(q)
        return 1e-6 + float(np.linalg.norm(difference[:, :3, 3], axis=1).max())

    def start_turns(self, q: FloatArray, near: FloatArray) -> FloatArray:
        """Joints (6, n) shifted near the limits at the turns nearest to ``near`` (6, n), in place."""
        stay = (np.abs(near - q) <= np.pi) & (q >= self.wider.lower[:, None]) & (q <= self.wider.upper[:, None])
        if not stay.all():
            turn = np.flatnonzero(~stay.all(axis=0))
            q[:, turn] = closed_form.into_limits(self.wider, q[:, turn].T, np.broadcast_to(near, q.shape)[:, turn].T)[
                0
            ].T
        return q

    def good(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Whether both errors (n,) are within the tolerances."""
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def inside(self, joints: FloatArray) -> BoolArray:
        """Whether joints (6, n) are within the limits as they are."""
        lower = self.nominal.lower - closed_form.LIMIT_TOLERANCE
        upper = self.nominal.upper + closed_form.LIMIT_TOLERANCE
        return np.logical_and.reduce((joints >= lower[:, None]) & (joints <= upper[:, None]), axis=0)

    def out_of_reach(self, state: _State, rows: IntArray | slice) -> BoolArray:
        """Whether the nominal arm does not reach poses, nor the calibrated one nearly so."""
        return (state.margin[rows] < 0) & ~(state.position[rows] <= CLOSE * self.difference)

    # -------------------------------------------------------------- all poses

    def asked_for(
        self, n: int, seed: ArrayLike | None, configuration: ArrayLike | None
    ) -> tuple[FloatArray, BoolArray, IntArray]:
        """Joints to stay near (6, n), which seeds are not finite (n,), and branches (n,)."""
        near, bad_seed = np.zeros((6, n)), np.zeros(n, dtype=bool)
        branch = np.zeros(n, dtype=int)
        if seed is not None:
            joints = self.nominal.check_joints(seed)
            if len(joints) not in (1, n):
                raise RobotError(f"seed joints need shape (6,) or ({n}, 6), found {joints.shape}", parameter="seed")
            bad_seed = np.broadcast_to(~np.isfinite(joints).all(axis=1), (n,))
            near = np.broadcast_to(np.where(np.isfinite(joints), joints, 0.0), (n, 6)).T
        if configuration is not None:
            branch = closed_form.check_configuration(configuration, n)
        elif seed is not None:
            branch = self.closed.configuration(near.T)
        return near, bad_seed, branch

    def solve(self, T_base_tip: ArrayLike, seed: ArrayLike | None, configuration: ArrayLike | None) -> InverseResult:
        T = check_poses(T_base_tip)
        n = len(T)
        near, bad_seed, branch = self.asked_for(n, seed, configuration)
        state = _State(n)
        bad_pose = np.zeros(n, dtype=bool)
        later: list[_Work] = []
        for start in range(0, n, BLOCK):
            block = slice(start, min(start + BLOCK, n))
            H = pose_columns(T[block])
            usable = is_rotation(H.reshape(12, -1)) & np.isfinite(H[3]).all(axis=0) & has_last_row(T[block])
            bad_pose[block] = ~usable
            todo = np.flatnonzero(usable & ~bad_seed[block])
            H = H if len(todo) == len(usable) else np.take(H, todo, axis=-1)
            todo += start
            work = (todo, branch_signs(branch[todo]), np.full(len(todo), np.inf), H, H, near[:, todo])
            left = self._fixed_point(work, state, first=True)
            later += [] if left is None else [left]
        # the few that take longer, of all blocks together
        if later:
            together = [np.concatenate(parts, axis=-1) for parts in zip(*later, strict=True)]
            for start in range(0, len(together[0]), BLOCK):
                self._fixed_point([np.ascontiguousarray(v[..., start : start + BLOCK]) for v in together], state)
        done = self.good(state.position, state.rotation)
        state.method[done] = Method.FIXED_POINT
        hard = np.flatnonzero(~done & ~bad_pose & ~bad_seed)
        for start in range(0, len(hard), BLOCK):
            rows = hard[start : start + BLOCK]
            self._newton_starts(pose_columns(T[rows]), branch[rows], near[:, rows], seed is not None, rows, state)
        self._turns(T, near, state)
        return self._result(state, branch, bad_pose, bad_seed)

    def _turns(self, T: FloatArray, near: FloatArray, state: _State) -> None:
        """Bring solutions that ended beyond a limit back by whole turns, where that is possible."""
        beyond = self.good(state.position, state.rotation) & ~self.inside(state.q)
        for start in range(0, len(rows := np.flatnonzero(beyond)), BLOCK):
            block = rows[start : start + BLOCK]
            turned, fits = closed_form.into_limits(self.nominal, state.q[:, block].T, near[:, block].T)
            block, turned = block[fits], turned[fits].T
            # joint gains tell one turn from another: the steps make that good
            q, position, rotation, iterations = newton.solve(self.chain, pose_columns(T[block]), turned, self.good)
            state.iterations[block] += iterations
            take = self.good(position, rotation) & self.inside(q)
            block = block[take]
            state.q[:, block], state.position[block], state.rotation[block] = q[:, take], position[take], rotation[take]

    def _result(self, state: _State, branch: IntArray, bad_pose: BoolArray, bad_seed: BoolArray) -> InverseResult:
        converged = self.good(state.position, state.rotation)
        found = np.where(converged, self.closed.configuration(np.where(converged, state.q, 0.0).T), -1)
        state.q[:, ~converged] = np.nan
        reason = np.full(len(branch), Reason.NOT_FOUND)
        if not converged.all():
            reason[self.out_of_reach(state, slice(None))] = Reason.OUT_OF_REACH
        reason[bad_seed], reason[bad_pose], reason[converged] = Reason.BAD_SEED, Reason.NOT_A_POSE, Reason.CONVERGED
        return InverseResult(
            joints=state.q.T.copy(),
            converged=converged,
            inside=self.inside(state.q),
            configuration=found,
            branch_kept=found == branch,
            iterations=state.iterations,
            method=np.where(converged, state.method, Method.NONE),
            position_residual=state.position,
            rotation_residual=state.rotation,
            reason=reason,
        )

    # -------------------------------------------------------------- the fixed point

    def _fixed_point(self, work: _Work, state: _State, first: bool = False) -> _Work | None:
        """The iteration of Nubiola 2011, Figure 6.2, for a block, until few poses are left: those, or None.

        ``work`` holds the poses' place in the state (n,), signs of the branch (3, n), error (n,), target and fake
        target (4, 3, n) and last joints (6, n); at first the fake target is the target, and the joints say which turns.
        """
        index, signs, last, H, fake, q = work
        few = len(index) // 8 if first else 0
        position = rotation = last
        for count in range(1, FIXED_POINT_ITERATIONS + 1):
            before = q, position, rotation
            q_new, margin = self.closed.branch(fake.reshape(12, -1), signs)
            if first:
                state.margin[index] = margin
                q = self.start_turns(q_new, q)
                first = False
            else:
                q = _same_turn(q_new, q)
            tip = self.chain.tip(q)
            position, rotation = newton.errors(tip, H)
            merit = self.chain.merit(position, rotation)
            better = merit < last  # False for NaN: no nominal solution
            on = np.flatnonzero((merit <= STALLED * last) & ~self.good(position, rotation))
            found = q, position, rotation
            if len(on) <= few or count == FIXED_POINT_ITERATIONS:
                state.keep(slice(None), index, better, found, before, count)
            elif len(on) < len(index):
                gone = np.ones(len(index), dtype=bool)
                gone[on] = False
                state.keep(np.flatnonzero(gone), index, better, found, before, count)
            if len(on) == 0:
                return None
            last = merit
            if len(on) < len(index):
                index, signs, last, H, fake, tip, q, position, rotation = (
                    np.take(v, on, axis=-1) for v in (index, signs, last, H, fake, tip, q, position, rotation)
                )
            fake = _next_fake(fake, tip, H)
            if len(on) <= few:
                return index, signs, last, H, fake, q
        return None

    # -------------------------------------------------------------- damped Newton

    def _newton_starts(
        self, H: FloatArray, branch: IntArray, near: FloatArray, seeded: bool, rows: IntArray, state: _State
    ) -> None:
        """Newton's steps for poses that the fixed point left: from where it came to, then from many starts at once."""
        pulled, state.margin[rows] = self.closed.branch(H.reshape(12, -1), branch_signs(branch), self.pull)
        pulled = self.start_turns(pulled, near)
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
        for starts, straighten, patience in self.stages:
            if starts > 6:
                lacking &= ~(plain & self.out_of_reach(state, rows))
            left = np.flatnonzero(lacking)
            for first in range(0, len(left), BLOCK // starts):
                todo = left[first : first + BLOCK // starts]
                goal = H[:, :, todo]
                rng = np.random.default_rng(starts)  # the same for each pose, whatever its neighbours
                tried = [pulled[:, todo], *([near[:, todo]] if seeded else [])] if starts > 1 else [start[:, todo]]
                while len(tried) < starts:
                    # solutions of targets moved a little: on all sides of the holes that errors leave at singularities
                    turn, shift = rng.standard_normal((2, 3, 1))
                    turn *= (0.01, 0.0, 0.03)[len(tried) % 3]
                    shift *= (0.0, 0.5, 1.5)[len(tried) % 3] * self.difference
                    other = newton.moved(goal, turn, shift)
                    q, _ = self.closed.branch(other.reshape(12, -1), branch_signs(branch[todo]), self.pull)
                    tried.append(self.start_turns(q, near[:, todo]))
                these = branch[todo], rows[todo]
                lacking[todo] = self._newton_choice(goal, np.stack(tried, axis=1), *these, state, straighten, patience)

    def _newton_choice(
        self,
        H: FloatArray,
        starts: FloatArray,
        branch: IntArray,
        rows: IntArray,
        state: _State,
        straighten: int,
        patience: int,
    ) -> BoolArray:
        """Run from all starts (6, k, n) and keep the best: which poses lack one in branch and limits, a mask (n,)."""
        _, k, n = starts.shape
        many = np.ascontiguousarray(np.broadcast_to(H[:, :, None], (4, 3, k, n))).reshape(4, 3, -1)
        q, position, rotation, evaluations = newton.solve(
            self.chain, many, starts.reshape(6, -1).copy(), self.good, straighten, patience
        )
        state.iterations[rows] += evaluations.reshape(k, n).sum(axis=0)
        kept = self.closed.configuration(q.T) == np.tile(branch, k)
        inside = closed_form.into_limits(self.nominal, q.T)[1]
        # a solution within the limits, then one in its branch, then the least error; the first of equals
        rank = np.where(self.good(position, rotation), -1.0 - kept - 2.0 * inside, self.chain.merit(position, rotation))
        rank = np.where(np.isnan(rank), np.inf, rank).reshape(k, n)
        best = rank.min(axis=0)
        take = best < state.rank[rows]
        column = (np.argmin(rank, axis=0) * n + np.arange(n))[take]
        where = rows[take]
        state.q[:, where], state.rank[where] = q[:, column], best[take]
        state.position[where], state.rotation[where] = position[column], rotation[column]
        state.method[where] = Method.NEWTON
        return state.rank[rows] > -4.0


def _next_fake(fake: FloatArray, tip: FloatArray, H: FloatArray) -> FloatArray:
    """The product fake tip^-1 H of columns (4, 3, n), step 1 of Nubiola 2011, section 6.2; overwrites the tip."""
    n = tip.shape[2]
    terms, along, column = aligned(3, 3, n), aligned(4, 3, n), aligned(3, n)
    np.subtract(H[3], tip[3], out=column)
    for k in (0, 1, 3):  # the transpose of the tip's axes times a column; z is the product of x and y
        np.multiply(tip[:3], H[k] if k < 3 else column, out=terms)
        np.add(np.add(terms[:, 0], terms[:, 1], out=along[k]), terms[:, 2], out=along[k])
    for k in (0, 1, 3):
        np.multiply(fake[:3], along[k][:, None], out=terms)
        np.add(np.add(terms[0], terms[1], out=tip[k]), terms[2], out=tip[k])
    np.add(tip[3], fake[3], out=tip[3])
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(tip[0, i], tip[1, j], out=tip[2, k])
        np.subtract(tip[2, k], np.multiply(tip[0, j], tip[1, i], out=column[0]), out=tip[2, k])
    return tip


def _same_turn(q: FloatArray, before: FloatArray) -> FloatArray:
    """Joints q at the turns nearest to the joints before, in place."""
    turns = before - q
    turns *= 1.0 / TAU
    np.rint(turns, out=turns)
    turns *= TAU
    q += turns
    return q
