r"""The fixed point of a calibrated robot's inverse (Nubiola 2011, section 6.2), for batches.

With T_n the nominal and T_R the calibrated forward kinematics and H the target (Figures 6.2 and 6.3)::

    H_fake,i = H_fake,i-1 H_aprox,i-1^-1 H,    q_i = inverse of T_n at H_fake,i,    H_aprox,i = T_R(q_i)

takes the closed-form inverse in one branch and no derivatives; its error shrinks by about a hundred in each
iteration, but not next to a singularity, and it cannot go where the nominal arm does not reach.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, newton
from irbcal.modeling.inverse.branches import branch_signs
from irbcal.modeling.inverse.newton import CalibratedChain
from irbcal.modeling.inverse.orthoparallel import TAU, OrthoParallel
from irbcal.modeling.inverse.poses import check_poses, pose_columns
from irbcal.modeling.parts import compiled as made
from irbcal.modeling.robot import Robot

NEAR_NOMINAL = 0.02
"""Entries of the nominal table may be this far (m or rad) from ortho-parallel: the iteration makes it good."""

ITERATIONS = 24
"""Nubiola 2011, Table 6.1, needs three; arms far from their nominal ones up to twenty."""

STALLED = 0.5
"""An iteration that leaves more than this share of the error is given up for Newton's steps."""

SLACK = 0.05
"""Radians that a start may be beyond a limit: the iteration may bring it back."""


class FixedPointState:
    """Best known joints and their errors for all poses."""

    def __init__(self, n: int) -> None:
        self.q = np.full((6, n), np.nan)
        self.position, self.rotation = np.full(n, np.nan), np.full(n, np.nan)
        self.iterations = np.zeros(n, dtype=int)
        self.method = np.zeros(n, dtype=np.int8)
        self.margin = np.full(n, np.nan)
        self.rank = np.full(n, np.inf)


def room(n: int) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
    """Where the kernel writes the inverses of n poses.

    Joints (n, 6); errors of position and rotation and the margin of reach (3, n); steps, branch, method and reason
    (4, n); and what is converged, within the limits and in the branch asked for (3, n). The last two are whole only
    where nothing is left to be done.
    """
    return np.empty((n, 6)), np.empty((3, n)), np.empty((4, n), dtype=np.int64), np.empty((3, n), dtype=bool)


@lru_cache(maxsize=16)
def kernel_of(robot: Robot, nominal: Arm) -> Any:
    """The compiled kernel of a robot with the closed form of its nominal arm; None where there is none."""
    parts = robot.joint_map.parts
    if parts is None:
        return None
    closed = OrthoParallel.of(nominal, NEAR_NOMINAL)
    usual = None if robot.joint_map.is_identity else parts
    starts = np.concatenate([starts_of(k) for k in (12, 6, 24, 96, 64)])
    more = {"starts": starts, "difference": difference(robot, nominal)}
    return made(robot.arm, usual, nominal, closed.numbers, closed.reach, more, robot.frame_terms)


def starts_of(count: int) -> FloatArray:
    """Standard normal numbers that move targets for so many starts: the same for each pose, whatever its neighbours.

    Returns
    -------
    ndarray, shape (count, 6)
        Rotation vector and shift.
    """
    return np.random.default_rng(count).standard_normal((count, 6))


@lru_cache(maxsize=16)
def difference(robot: Robot, nominal: Arm) -> float:
    """About the largest distance (m) between tips of the two arms, from random joints."""
    q = nominal.random_joints(500, 0)
    q -= TAU * np.rint(q / TAU)  # joints of many turns look like degrees
    apart = robot.poses(q) - nominal.forward(q)
    return 1e-6 + float(np.linalg.norm(apart[:, :3, 3], axis=1).max())


class FixedPoint:
    """The iteration for one robot.

    Parameters
    ----------
    robot : Robot
        Calibrated arm and joint map.
    nominal : Arm
        The arm before calibration; near to ortho-parallel with a spherical wrist.
    position, rotation : float
        Tolerances, metres and radians.

    Raises
    ------
    RobotError
        If the nominal arm has no closed-form inverse.
    """

    def __init__(self, robot: Robot, nominal: Arm, position: float = 0.0, rotation: float = 0.0) -> None:
        self.closed = OrthoParallel.of(nominal, NEAR_NOMINAL)
        self.chain = CalibratedChain(robot, self.closed.reach)
        self.tolerance = position, rotation
        self.lower, self.upper = nominal.lower - SLACK, nominal.upper + SLACK
        self._kernel = kernel_of(robot, nominal)

    def good(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Whether both errors (n,) are within the tolerances."""
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def compiled(
        self,
        T: FloatArray,
        rows: IntArray,
        signs: FloatArray,
        near: FloatArray | None,
        state: FixedPointState,
        stages: int = 0,
    ) -> bool:
        """The iteration for poses ``rows`` of T (n, 4, 4) by the compiled kernel, as `run`; False where there is none.

        ``signs`` (3, m) and ``near`` (6, m) are those of the m rows. What it leaves is searched, in so many ``stages``.
        """
        if self._kernel is None:
            return False
        q, left, numbers, flags = room(len(rows))
        close = None if near is None else near.T.copy()
        out = (q, left, numbers, flags, stages)
        if self._kernel.inverses(T[rows], signs.T.copy(), close, *self.tolerance, *out) is None:
            return False
        state.q[:, rows] = q.T
        state.position[rows], state.rotation[rows], state.margin[rows] = left
        state.iterations[rows], state.method[rows] = numbers[0], numbers[2]
        return True

    def start_turns(self, q: FloatArray, near: FloatArray | None) -> FloatArray:
        """Joints (6, n) shifted near the limits at the turns nearest to ``near`` (6, n) or zero, in place."""
        stay = (q >= self.lower[:, None]) & (q <= self.upper[:, None])
        if near is not None:
            stay &= np.abs(near - q) <= np.pi
        for j in np.flatnonzero(~stay.all(axis=1)):
            turn = np.flatnonzero(~stay[j])
            close = 0.0 if near is None else near[j, turn]
            q[j, turn] += TAU * closed_form.whole_turns(self.lower[j], self.upper[j], q[j, turn], close)[0]
        return q

    def run(
        self, rows: IntArray, H: FloatArray, signs: FloatArray, near: FloatArray | None, state: FixedPointState
    ) -> None:
        """The iteration of Nubiola 2011, Figure 6.2, for poses ``rows`` of the state, until each is done or stalls.

        Parameters
        ----------
        rows : ndarray of int, shape (n,)
        H : ndarray, shape (4, 3, n)
            Columns of the targets.
        signs : ndarray, shape (3, n)
            Branches, as `irbcal.modeling.inverse.branches.branch_signs` has them.
        near : ndarray, shape (6, n), optional
            Joints whose turns are kept.
        state : FixedPointState
        """
        fake, q, last = H, near, np.full(len(rows), np.inf)
        for count in range(1, ITERATIONS + 1):
            if not len(rows):
                return
            q_new, margin = self.closed.branch(fake.reshape(12, -1), signs)
            if count == 1:
                state.margin[rows] = margin
            q = self.start_turns(q_new, q) if count == 1 or q is None else _same_turn(q_new, q)
            tip = self.chain.tip(q)
            position, rotation = newton.errors(tip, H)
            merit = self.chain.merit(position, rotation)
            better = merit < last  # False for NaN: not within reach
            chosen = rows[better]
            state.q[:, chosen] = q[:, better]
            state.position[chosen], state.rotation[chosen] = position[better], rotation[better]
            state.iterations[rows] = count
            on = np.flatnonzero((merit <= STALLED * last) & ~self.good(position, rotation))
            fake = _next_fake(fake[..., on], tip[..., on], H[..., on])
            rows, signs, last, H, q = rows[on], signs[:, on], merit[on], H[..., on], q[:, on]


def history(
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
    fixed_point = FixedPoint(robot, nominal)
    H = pose_columns(check_poses(T_base_tip))
    signs = branch_signs(closed_form.check_configuration(configuration, len(T_base_tip)))
    fake, errors = H, list[tuple[FloatArray, FloatArray]]()
    q = np.zeros((6, H.shape[2]))
    for iteration in range(iterations):
        q_new, _ = fixed_point.closed.branch(fake.reshape(12, -1), signs)
        q = _same_turn(q_new, q) if iteration else fixed_point.start_turns(q_new, q)
        tip = fixed_point.chain.tip(q)
        errors.append(newton.errors(tip, H))
        fake = _next_fake(fake, tip, H)
    position, rotation = np.array(errors).swapaxes(0, 1)
    return position, rotation


def _next_fake(fake: FloatArray, tip: FloatArray, H: FloatArray) -> FloatArray:
    """The product fake tip^-1 H of columns (4, 3, n), step 1 of Nubiola 2011, section 6.2."""
    in_tip = np.einsum("jin,kin->jkn", np.concatenate([H[:3], (H[3] - tip[3])[None]]), tip[:3])
    out = np.einsum("jkn,kin->jin", in_tip, fake[:3])
    out[3] += fake[3]
    return out


def _same_turn(q: FloatArray, q_before: FloatArray) -> FloatArray:
    """Joints q at the turns nearest to the joints before."""
    return q + TAU * np.rint((q_before - q) / TAU)
