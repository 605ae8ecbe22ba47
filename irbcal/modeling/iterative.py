r"""Inverse kinematics of a calibrated robot (Nubiola 2011, section 6.2), for batches.

The fixed point of the thesis, with T_n the nominal and T_R the calibrated forward kinematics and H the target::

    H_fake,i = H_fake,i-1 H_aprox,i-1^-1 H,    q_i = inverse of T_n at H_fake,i,    H_aprox,i = T_R(q_i)

takes the closed-form inverse in one branch and no derivatives; its error shrinks by about a hundred in each
iteration, but not next to a singularity, and it cannot go where the nominal arm does not reach. Poses for
which it stalls change over to damped Newton steps (Levenberg-Marquardt) on the geometric Jacobian of the
calibrated arm times that of its joint map, from several starts. What neither solves is flagged with the reason.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from irbcal.errors import RobotError
from irbcal.modeling import dhm, inverse
from irbcal.modeling.inverse import TAU, OrthoParallel

BLOCK = 4096
"""Poses per block: the working set of a block stays in the processor's cache."""

NEAR_NOMINAL = 0.02
"""Entries of the nominal table may be this far (m or rad) from ortho-parallel: the iteration makes it good."""

FIXED_POINT_ITERATIONS = 12
STALLED = 0.5
"""An iteration that leaves more than this share of the error is given up for Newton steps."""

NEWTON_ITERATIONS = 60
NEWTON_PATIENCE = 10
"""Newton steps are given up when so many of them have not halved the error."""

NEWTON_STARTS = (24, 96)
"""Numbers of starts tried, one lot after the other, for a pose not reached from the fixed point's last joints."""

LONGEST_STEP = 0.5
"""Radians that a Newton step may turn a joint."""

PULL = 5e-4
"""Share of the reach by which a start is moved inside the nominal reach: off the elbow singularity."""


class Method(IntEnum):
    """How the joints of a pose were found."""

    NONE = 0
    FIXED_POINT = 1
    NEWTON = 2


class Reason(IntEnum):
    """Why a pose has no joints."""

    CONVERGED = 0
    NOT_A_POSE = 1
    BAD_SEED = 2
    OUT_OF_REACH = 3
    NOT_FOUND = 4

    @property
    def words(self):
        """The reason in words."""
        return _WORDS[self]


_WORDS = {
    Reason.CONVERGED: "converged",
    Reason.NOT_A_POSE: "the target holds NaN or is not a rigid transform",
    Reason.BAD_SEED: "the seed joints are not finite",
    Reason.OUT_OF_REACH: "the target is out of the robot's reach in this configuration",
    Reason.NOT_FOUND: "no joints were found to the tolerance, although the nominal arm reaches the target",
}


@dataclass(frozen=True, eq=False)
class InverseResult:
    """Joints of a calibrated robot for a batch of n poses.

    Attributes
    ----------
    joints : ndarray, shape (n, 6)
        Commanded joint angles, radians; NaN where the pose has not converged.
    converged : ndarray of bool, shape (n,)
        Whether position and orientation are both within the tolerance.
    inside : ndarray of bool, shape (n,)
        Whether the joints are within the limits; False where the pose has not converged.
    configuration : ndarray of int, shape (n,)
        Nominal branch of the joints (see `irbcal.modeling.inverse`), -1 where the pose has not converged.
    branch_kept : ndarray of bool, shape (n,)
        Whether that is the branch asked for. Only next to a singularity can it be another one.
    iterations : ndarray of int, shape (n,)
        Evaluations of the calibrated forward kinematics, all methods and starts.
    method : ndarray of int, shape (n,)
        `Method` that gave the joints.
    position_residual, rotation_residual : ndarray, shape (n,)
        Distance of the origins (m) and angle of the relative rotation (rad) of target and forward kinematics;
        of the best joints found where the pose has not converged.
    reason : ndarray of int, shape (n,)
        `Reason`; its ``words`` say what it means.
    """

    joints: np.ndarray
    converged: np.ndarray
    inside: np.ndarray
    configuration: np.ndarray
    branch_kept: np.ndarray
    iterations: np.ndarray
    method: np.ndarray
    position_residual: np.ndarray
    rotation_residual: np.ndarray
    reason: np.ndarray

    def __len__(self):
        return len(self.joints)

    def summary(self):
        """Number of poses for each method and each reason, as text."""
        parts = [
            f"{(self.method == m).sum()} by {m.name.lower().replace('_', ' ')}" for m in (1, 2) for m in [Method(m)]
        ]
        parts += [f"{(self.reason == r).sum()}: {r.words}" for r in Reason if r and (self.reason == r).any()]
        return f"{len(self)} poses: " + "; ".join(parts)


def solve(robot, nominal, T_base_tip, seed=None, configuration=None, position=1e-10, rotation=1e-10):
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

    Returns
    -------
    InverseResult

    Raises
    ------
    RobotError
        If shapes do not fit, or the nominal arm has no closed-form inverse.
    """
    return _Solver(robot, nominal, position, rotation).solve(T_base_tip, seed, configuration)


def fixed_point_history(robot, nominal, T_base_tip, configuration, iterations):
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
    H = _columns(inverse.check_poses(T_base_tip))
    branch = inverse.check_configuration(configuration, len(T_base_tip))
    fake, q, errors = H, None, []
    for _ in range(iterations):
        q_new, _ = solver.closed.branch(fake.reshape(12, -1), branch)
        q = solver.start_turns(q_new, np.zeros((6, 1))) if q is None else _same_turn(q_new, q)
        tip = solver.tip(q)
        errors.append((*_errors(tip, H),))
        fake = _next_fake(fake, tip, H)
    position, rotation = np.array(errors).swapaxes(0, 1)
    return position, rotation


class _State:
    """Best known joints and their errors for all poses."""

    def __init__(self, n):
        self.q = np.full((6, n), np.nan)
        self.position, self.rotation = np.full(n, np.nan), np.full(n, np.nan)
        self.iterations = np.zeros(n, dtype=int)
        self.method = np.zeros(n, dtype=np.int8)
        self.margin = np.full(n, np.nan)
        self.rank = np.full(n, np.inf)


class _Solver:
    def __init__(self, robot, nominal, position, rotation):
        self.robot, self.nominal = robot, nominal
        self.closed = OrthoParallel.of(nominal, NEAR_NOMINAL)
        self.tolerance = position, rotation
        arm = robot.arm
        self.after = None if np.array_equal(arm.T_6_tip, np.eye(4)) else arm.T_6_tip
        self.offsets = arm.table.theta[:, None]
        self.pull = PULL * self.closed.reach
        # a wrist centre may be out of the nominal reach by what the two arms differ, and be reached all the same
        q = nominal.random_joints(500, 0)
        difference = robot.poses(q) - nominal.forward(q)
        self.difference = 1e-6 + np.linalg.norm(difference[:, :3, 3], axis=1).max()

    # -------------------------------------------------------------- pieces

    def angles(self, q):
        """Angles (6, n) of the DHM table for commanded joints (6, n)."""
        return self.robot.joint_map.effective(q.T).T + self.offsets

    def tip(self, q):
        """Tip columns (4, 3, n) of the calibrated robot for commanded joints (6, n)."""
        return dhm.tip_columns(self.robot.arm.table, self.angles(q), self.robot.arm.T_base_0, self.after)

    def start_turns(self, q, near):
        """Joints (6, n) shifted into the limits at the turns nearest to ``near`` (6, n)."""
        return np.ascontiguousarray(inverse.into_limits(self.nominal, q.T, near.T)[0].T)

    def good(self, position, rotation):
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def merit(self, position, rotation):
        """Position and rotation error as one number, position in units of the reach."""
        return position / self.closed.reach + rotation

    # -------------------------------------------------------------- all poses

    def solve(self, T_base_tip, seed, configuration):
        T = inverse.check_poses(T_base_tip)
        n = len(T)
        near = np.zeros((6, 1))
        bad_seed = np.zeros(n, dtype=bool)
        if seed is not None:
            seed = self.nominal.check_joints(seed)
            if len(seed) not in (1, n):
                raise RobotError(f"seed joints need shape (6,) or ({n}, 6), found {seed.shape}")
            bad_seed = np.broadcast_to(~np.isfinite(seed).all(axis=1), (n,))
            near = np.broadcast_to(np.where(np.isfinite(seed), seed, 0.0), (n, 6)).T
        if configuration is None:
            branch = np.zeros(n, dtype=int) if seed is None else self.closed.configuration(near.T)
        else:
            branch = inverse.check_configuration(configuration, n)
        near = np.broadcast_to(near, (6, n))
        state = _State(n)
        bad_pose = np.zeros(n, dtype=bool)
        for start in range(0, n, BLOCK):
            block = slice(start, min(start + BLOCK, n))
            H = _columns(T[block])
            with np.errstate(invalid="ignore", over="ignore"):
                usable = inverse.is_rotation(H.reshape(12, -1)[:9]) & np.isfinite(H[3]).all(axis=0)
            bad_pose[block] = ~usable
            todo = start + np.flatnonzero(usable & ~bad_seed[block])
            self._fixed_point(H[:, :, todo - start], branch[todo], near[:, todo], todo, state)
        done = self.good(state.position, state.rotation)
        state.method[done] = Method.FIXED_POINT
        left = np.flatnonzero(~done & ~bad_pose & ~bad_seed)
        for start in range(0, len(left), BLOCK):
            rows = left[start : start + BLOCK]
            self._newton_starts(_columns(T[rows]), branch[rows], near[:, rows], seed is not None, rows, state)
        self._turns(T, near, state)
        return self._result(state, branch, bad_pose, bad_seed)

    def _turns(self, T, near, state):
        """Bring solutions that ended beyond a limit back by whole turns, where that is possible."""
        with np.errstate(invalid="ignore"):
            beyond = ~self._inside(state.q.T) & self.good(state.position, state.rotation)
        for start in range(0, len(rows := np.flatnonzero(beyond)), BLOCK):
            block = rows[start : start + BLOCK]
            turned, fits = inverse.into_limits(self.nominal, state.q[:, block].T, near[:, block].T)
            block, turned = block[fits], turned[fits].T
            # joint gains tell one turn from another: the steps make that good
            q, position, rotation, iterations = self._newton(_columns(T[block]), turned)
            state.iterations[block] += iterations
            take = self.good(position, rotation) & self._inside(q.T)
            block = block[take]
            state.q[:, block], state.position[block], state.rotation[block] = q[:, take], position[take], rotation[take]

    def _inside(self, joints):
        """Whether joints (n, 6) are within the limits as they are."""
        lower, upper = self.nominal.lower - inverse.LIMIT_TOLERANCE, self.nominal.upper + inverse.LIMIT_TOLERANCE
        return ((joints >= lower) & (joints <= upper)).all(axis=1)

    def _result(self, state, branch, bad_pose, bad_seed):
        converged = self.good(state.position, state.rotation)
        joints = np.where(converged, state.q, np.nan).T.copy()
        found = np.where(converged, self.closed.configuration(np.where(converged, state.q, 0.0).T), -1)
        reason = np.where(state.margin < 0, Reason.OUT_OF_REACH, Reason.NOT_FOUND)
        reason[bad_seed], reason[bad_pose], reason[converged] = Reason.BAD_SEED, Reason.NOT_A_POSE, Reason.CONVERGED
        return InverseResult(
            joints=joints,
            converged=converged,
            inside=self._inside(joints),
            configuration=found,
            branch_kept=found == branch,
            iterations=state.iterations,
            method=np.where(converged, state.method, Method.NONE),
            position_residual=state.position,
            rotation_residual=state.rotation,
            reason=reason,
        )

    # -------------------------------------------------------------- the fixed point

    def _fixed_point(self, H, branch, near, index, state):
        """The thesis's iteration for a block; ``index`` (n,) places the block's poses in the state."""
        fake, q, last = H, None, np.inf
        for iteration in range(FIXED_POINT_ITERATIONS):
            q_new, margin = self.closed.branch(fake.reshape(12, -1), branch)
            if iteration == 0:
                state.margin[index] = margin
                q_new = self.start_turns(q_new, near)
            else:
                q_new = _same_turn(q_new, q)
            tip = self.tip(q_new)
            position, rotation = _errors(tip, H)
            state.iterations[index] += 1
            merit = self.merit(position, rotation)
            better = merit < last  # False for NaN: no nominal solution
            keep = index if better.all() else index[better]
            for array, value in ((state.q, q_new), (state.position, position), (state.rotation, rotation)):
                array[..., keep] = value if keep is index else value[..., better]
            go = (merit <= STALLED * last) & ~self.good(position, rotation)
            if not go.any():
                return
            if not go.all():
                index, branch, last = index[go], branch[go], merit[go]
                H, fake, tip, q = (np.ascontiguousarray(v[..., go]) for v in (H, fake, tip, q_new))
            else:
                q, last = q_new, merit
            fake = _next_fake(fake, tip, H)

    # -------------------------------------------------------------- damped Newton

    def _newton_starts(self, H, branch, near, seeded, rows, state):
        """Newton's steps for poses that the fixed point left: from where it came to, then from many starts at once."""
        pulled, state.margin[rows] = self.closed.branch(H.reshape(12, -1), branch, self.pull)
        pulled = self.start_turns(pulled, near)
        best = state.q[:, rows].copy()
        unknown = ~np.isfinite(best).all(axis=0)
        best[:, unknown] = pulled[:, unknown]
        lacking = self._newton_choice(H, best[:, None], branch, rows, state)
        lacking &= state.margin[rows] > -2.0 * self.difference
        rng = np.random.default_rng(0)
        for starts in NEWTON_STARTS:
            left = np.flatnonzero(lacking)
            for first in range(0, len(left), BLOCK // starts):
                todo = left[first : first + BLOCK // starts]
                goal = H[:, :, todo]
                tried = [pulled[:, todo]] + ([near[:, todo]] if seeded else [])
                while len(tried) < starts:
                    # solutions of targets moved a little: on all sides of the holes that errors leave at singularities
                    turn, shift = rng.standard_normal((2, 3, len(todo)))
                    turn *= (0.01, 0.0, 0.03)[len(tried) % 3]
                    shift *= (0.0, 0.5, 1.5)[len(tried) % 3] * self.difference
                    moved = _moved(goal, turn, shift)
                    q, _ = self.closed.branch(moved.reshape(12, -1), branch[todo], self.pull)
                    tried.append(self.start_turns(q, near[:, todo]))
                tried = np.stack(tried, axis=1)
                lacking[todo] = self._newton_choice(goal, tried, branch[todo], rows[todo], state)

    def _newton_choice(self, H, starts, branch, rows, state):
        """Run from all starts (6, k, n) and keep the best: which poses lack one in branch and limits, a mask (n,)."""
        _, k, n = starts.shape
        many = np.ascontiguousarray(np.broadcast_to(H[:, :, None], (4, 3, k, n))).reshape(4, 3, -1)
        q, position, rotation, iterations = self._newton(many, starts.reshape(6, -1).copy(), straighten=2 * (k > 1))
        kept = self.closed.configuration(q.T) == np.tile(branch, k)
        inside = inverse.into_limits(self.nominal, q.T)[1]
        # a solution within the limits, then one in its branch, then the least error; the first of equals
        rank = np.where(self.good(position, rotation), -1.0 - kept - 2.0 * inside, self.merit(position, rotation))
        rank = rank.reshape(k, n)
        rank = np.where(np.isnan(rank), np.inf, rank)
        pick = np.argmin(rank, axis=0)
        columns = pick * n + np.arange(n)
        state.iterations[rows] += iterations.reshape(k, n).sum(axis=0)
        take = ~(rank[pick, np.arange(n)] >= state.rank[rows])
        where, columns = rows[take], columns[take]
        state.q[:, where] = q[:, columns]
        state.position[where], state.rotation[where] = position[columns], rotation[columns]
        state.rank[where] = rank.min(axis=0)[take]
        state.method[where] = Method.NEWTON
        return state.rank[rows] > -4.0

    def _newton(self, H, q, straighten=0):
        """Levenberg-Marquardt from joints q (6, n): joints, position and rotation error, iterations.

        Next to the shoulder singularity the joints that leave the pose nearly unchanged lie on a curve along
        which straight steps only crawl: ``straighten`` times, the wrist makes good what a step turns the tip.
        """
        n = q.shape[1]
        out_q, out_errors, iterations = q.copy(), np.empty((2, n)), np.ones(n, dtype=int)
        index = np.arange(n)
        damping, bound, patience = np.full(n, 1e-6), np.full(n, np.inf), np.zeros(n, dtype=int)
        J, e, cost, errors = self._linearised(H, q)
        out_errors[:] = errors
        for _ in range(NEWTON_ITERATIONS):
            halved = cost <= 0.25 * bound  # cost is the square of the error
            bound, patience = np.where(halved, cost, bound), np.where(halved, 0, patience + 1)
            go = ~self.good(*errors) & (patience <= NEWTON_PATIENCE) & np.isfinite(cost)
            if not go.any():
                break
            if not go.all():
                J, e = J[go], e[go]
                index, q, H, cost, errors, damping, bound, patience = (
                    v[..., go] for v in (index, q, H, cost, errors, damping, bound, patience)
                )
            J_t = J.swapaxes(1, 2)
            A = J_t @ J
            A[:, range(6), range(6)] += (damping * np.minimum(np.sqrt(cost), 1.0) + 1e-15)[:, None]
            step = np.linalg.solve(A, J_t @ e[:, :, None])[:, :, 0].T
            step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=0), LONGEST_STEP))
            iterations[index] += 1
            trial = q + step
            J_new, e_new, cost_new, errors_new = self._linearised(H, trial)
            for _ in range(straighten):
                W = J_new[:, 3:, 3:]
                W_t = W.swapaxes(1, 2)
                turn = np.linalg.solve(W_t @ W + 1e-8 * np.eye(3), W_t @ e_new[:, 3:, None])[:, :, 0].T
                trial[3:] += turn * np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(turn).max(axis=0), LONGEST_STEP))
                J_new, e_new, cost_new, errors_new = self._linearised(H, trial)
            better = cost_new < cost
            damping = np.where(better, np.maximum(damping * 0.2, 1e-8), np.minimum(damping * 8.0 + 1e-6, 1e8))
            q, errors, cost = (
                np.where(better, new, old) for new, old in ((trial, q), (errors_new, errors), (cost_new, cost))
            )
            J, e = np.where(better[:, None, None], J_new, J), np.where(better[:, None], e_new, e)
            out_q[:, index], out_errors[:, index] = q, errors
        return out_q, *out_errors, iterations

    def _linearised(self, H, q):
        """Jacobian (n, 6, 6) by commanded joints, residual (n, 6), its square (n,), both errors (2, n)."""
        arm, reach, n = self.robot.arm, self.closed.reach, q.shape[1]
        chain = dhm.chain_frames(arm.table, self.angles(q), arm.T_base_0, self.after)
        tip, (zx, zy, zz) = chain.tip, chain.z.swapaxes(0, 1)
        lx, ly, lz = (tip[3] - chain.o).swapaxes(0, 1)
        rows = (zy * lz - zz * ly, zz * lx - zx * lz, zx * ly - zy * lx, zx, zy, zz)
        J, e = np.empty((n, 6, 6)), np.empty((n, 6))
        for i, row in enumerate(rows):
            J[:, i] = row.T / reach if i < 3 else row.T
        if not self.robot.joint_map.is_identity:
            J = J @ self.robot.joint_map.jacobian(q.T)
        e[:, :3] = (H[3] - tip[3]).T / reach
        e[:, 3:] = _rotation_vector(tip, H).T
        return J, e, (e * e).sum(axis=1), np.array(_errors(tip, H))


# ------------------------------------------------------------------ poses as columns (4, 3, n)


def _columns(T):
    """Columns x, y, z and origin (4, 3, n) of poses (n, 4, 4)."""
    return np.ascontiguousarray(T[:, :3].transpose(2, 1, 0))


def _errors(tip, H):
    """Distance of the origins and angle of the relative rotation of columns (4, 3, n), metres and radians."""
    difference = tip - H
    np.multiply(difference, difference, out=difference)
    squares = difference.sum(axis=1)
    chord = np.sqrt((squares[0] + squares[1] + squares[2]) * 0.125)  # sine of half the angle
    return np.sqrt(squares[3]), 2.0 * np.arcsin(np.minimum(chord, 1.0))


def _next_fake(fake, tip, H):
    """The product fake tip^-1 H of columns (4, 3, n)."""
    out = np.empty_like(fake)
    for k in range(4):
        u = H[k] if k < 3 else H[3] - tip[3]
        along = [tip[j, 0] * u[0] + tip[j, 1] * u[1] + tip[j, 2] * u[2] for j in range(3)]
        out[k] = fake[0] * along[0]
        out[k] += fake[1] * along[1]
        out[k] += fake[2] * along[2]
    out[3] += fake[3]
    return out


def _moved(H, turn, shift):
    """Columns (4, 3, n) turned by small rotation vectors (3, n) about their origin and shifted by metres (3, n)."""
    angle = np.sqrt((turn * turn).sum(axis=0))
    axis = turn / np.maximum(angle, 1e-300)
    out = np.empty_like(H)
    for k in range(3):
        v = H[k]
        out[k] = v + np.sin(angle) * np.cross(axis, v, axis=0)
        out[k] += (1.0 - np.cos(angle)) * (axis * (axis * v).sum(axis=0) - v)
    out[3] = H[3] + shift
    return out


def _rotation_vector(tip, H):
    """Rotation vector (3, n) in the base frame that turns the tip's axes into those of H, radians."""
    # sum of the cross products of the axes is 2 sin(angle) times the axis
    v = 0.5 * sum(np.cross(tip[k], H[k], axis=0) for k in range(3))
    sine = np.sqrt((v * v).sum(axis=0))
    cosine = 0.5 * ((tip[:3] * H[:3]).sum(axis=(0, 1)) - 1.0)
    return v * np.where(sine > 1e-12, np.arctan2(sine, cosine) / np.maximum(sine, 1e-300), 1.0)


def _same_turn(q, before):
    """Joints q at the turns nearest to the joints before, in place."""
    turns = before - q
    turns *= 1.0 / TAU
    np.rint(turns, out=turns)
    turns *= TAU
    q += turns
    return q
