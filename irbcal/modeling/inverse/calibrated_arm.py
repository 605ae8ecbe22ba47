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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray, row_arithmetic
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

MOST = 0.85
"""Poses that are done go along until they are more than the rest of these: to take them out costs a quarter round."""


class _Work(NamedTuple):
    """Poses under way: places in the state (n,), signs of the branch (3, n), last merit (n,), target and fake target.

    Both are columns (4, 3, n). Joints (6, n) are the last ones; at first those whose turns to keep, where there are.
    """

    places: IntArray
    signs: FloatArray
    last: FloatArray
    H: FloatArray
    fake: FloatArray
    q: FloatArray | None


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
    fake, errors = H, list[tuple[FloatArray, FloatArray]]()
    q = np.zeros((6, H.shape[2]))
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
        index: IntArray,
        these: BoolArray,
        better: BoolArray,
        now: Sequence[FloatArray],
        before: Sequence[FloatArray] | None,
        iterations: int,
    ) -> None:
        """Joints and errors of these poses of a block: those of now where they are better, else those of before.

        After the first iteration there are none of before, and where it found none the state stays.
        """
        places: IntArray | slice = index
        if np.count_nonzero(these) < len(index) // 8:
            few = np.flatnonzero(these)
            places, these, better = index[few], these[few], better[few]
            now = [np.take(v, few, axis=-1) for v in now]
            before = None if before is None else [np.take(v, few, axis=-1) for v in before]
        elif index[-1] - index[0] == len(index) - 1:
            places = slice(index[0], index[-1] + 1)
        self.iterations[places] += iterations * these
        if before is None:
            these = these & better
        elif not (better | ~these).all():
            now = [np.where(better, new, old) for new, old in zip(now, before, strict=True)]
        for kept, best in zip((self.q, self.position, self.rotation), now, strict=True):
            if isinstance(places, slice):
                np.copyto(kept[..., places], best, where=these)
            else:
                kept[..., places[these]] = best[..., these]


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

    def start_turns(self, q: FloatArray, near: FloatArray | None) -> FloatArray:
        """Joints (6, n) shifted near the limits at the turns nearest to ``near`` (6, n) or zero, in place."""
        lower, upper = self.wider.lower, self.wider.upper
        stay = (q >= lower[:, None]) & (q <= upper[:, None])
        if near is not None:
            stay &= np.abs(near - q) <= np.pi
        for j in np.flatnonzero(~stay.all(axis=1)):
            turn = np.flatnonzero(~stay[j])
            close = 0.0 if near is None else near[j, turn]
            q[j, turn] += TAU * closed_form.whole_turns(lower[j], upper[j], q[j, turn], close)[0]
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
            first = np.full(len(todo), np.inf)
            work = _Work(todo, branch_signs(branch[todo]), first, H, H, None if near is None else near[:, todo])
            left = self._fixed_point(work, state, first=True)
            later += [] if left is None else [left]
        # the few that take longer, of all blocks together
        if later:
            together: list[NDArray[Any]] = [np.concatenate(parts, axis=-1) for parts in zip(*later, strict=True)]
            for start in range(0, len(together[0]), BLOCK):
                block = slice(start, start + BLOCK)
                self._fixed_point(_Work(*(np.ascontiguousarray(v[..., block]) for v in together)), state)
        done = self.good(state.position, state.rotation)
        state.method[done] = Method.FIXED_POINT
        hard = np.flatnonzero(~done & ~bad_pose & ~bad_seed)
        for start in range(0, len(hard), BLOCK):
            rows = hard[start : start + BLOCK]
            close = None if near is None else near[:, rows]
            self._newton_starts(pose_columns(T[rows]), branch[rows], close, rows, state)
        self._turns(T, near, state)
        return self._result(state, branch, bad_pose, bad_seed)

    def _turns(self, T: FloatArray, near: FloatArray | None, state: _State) -> None:
        """Bring solutions that ended beyond a limit back by whole turns, where that is possible."""
        beyond = self.good(state.position, state.rotation) & ~self.inside(state.q)
        for start in range(0, len(rows := np.flatnonzero(beyond)), BLOCK):
            block = rows[start : start + BLOCK]
            turned, fits = closed_form.into_limits(
                self.nominal, state.q[:, block].T, None if near is None else near[:, block].T
            )
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

        The fake target is moved by what the columns of the tip lack, added where the thesis multiplies transforms
        (`_next_fake`): the error shrinks as fast, in a tenth of the arithmetic. That a fake target is no rigid
        transform in between does no harm, since the closed form takes it as it is.
        """
        index, signs, last, H, fake, q = work
        if not len(index):
            return None
        few = len(index) // 8 if first else 0
        before: Sequence[FloatArray] | None = None
        alive = np.ones(len(index), dtype=bool)
        for count in range(1, FIXED_POINT_ITERATIONS + 1):
            q_new, margin = self.closed.branch(fake.reshape(12, -1), signs)
            if first and count == 1:
                state.margin[index] = margin
                q = self.start_turns(q_new, q)
            else:
                assert q is not None
                q = _same_turn(q_new, q)
            lacking = self.chain.tip(q)
            np.subtract(H, lacking, out=lacking)
            position, rotation = newton.lengths(lacking)
            merit = self.chain.merit(position, rotation)
            on = alive & (merit <= STALLED * last) & ~self.good(position, rotation)  # False for NaN: not within reach
            left = np.count_nonzero(on)
            ends = left <= few or count == FIXED_POINT_ITERATIONS
            if ends or left < np.count_nonzero(alive):
                done = alive if ends else alive & ~on
                state.keep(index, done, merit < last, (q, position, rotation), before, count)
            if left == 0:
                return None
            alive, last = on, merit
            fake = np.add(fake, lacking, out=lacking)
            if left <= few or left < MOST * len(index):
                rows = np.flatnonzero(on)
                index = index[rows]
                signs, last, H, fake, q, position, rotation = (
                    np.take(v, rows, axis=-1) for v in (signs, last, H, fake, q, position, rotation)
                )
                alive = np.ones(left, dtype=bool)
            if left <= few:
                return _Work(index, signs, last, H, fake, q)
            before = q, position, rotation
        return None

    # -------------------------------------------------------------- damped Newton

    def _newton_starts(
        self, H: FloatArray, branch: IntArray, near: FloatArray | None, rows: IntArray, state: _State
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
                close = None if near is None else near[:, todo]
                tried = [start[:, todo]]
                if starts > 1:
                    tried = [pulled[:, todo], *([] if close is None else [close])]
                while len(tried) < starts:
                    # solutions of targets moved a little: on all sides of the holes that errors leave at singularities
                    turn, shift = rng.standard_normal((2, 3, 1))
                    turn *= (0.01, 0.0, 0.03)[len(tried) % 3]
                    shift *= (0.0, 0.5, 1.5)[len(tried) % 3] * self.difference
                    other = newton.moved(goal, turn, shift)
                    q, _ = self.closed.branch(other.reshape(12, -1), branch_signs(branch[todo]), self.pull)
                    tried.append(self.start_turns(q, close))
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
    """The product fake tip^-1 H of columns (4, 3, n), step 1 of Nubiola 2011, section 6.2."""
    missing = np.concatenate([H[:3], (H[3] - tip[3])[None]])
    along = np.einsum("kin,cin->ckn", tip[:3], missing)
    moved = np.einsum("kin,ckn->cin", fake[:3], along)
    moved[3] += fake[3]
    return moved


def _same_turn(q: FloatArray, before: FloatArray) -> FloatArray:
    """Joints q at the turns nearest to the joints before, in place."""
    turns = before - q
    turns *= 1.0 / TAU
    np.rint(turns, out=turns)
    turns *= TAU
    q += turns
    return q
