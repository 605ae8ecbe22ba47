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

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.inverse.orthoparallel import TAU, OrthoParallel
from irbcal.modeling.robot import Robot
from irbcal.modeling.term_sums import compiled as made

NEAR_NOMINAL = 0.02
"""Entries of the nominal table may be this far (m or rad) from ortho-parallel: the iteration makes it good."""

SLACK = 0.05
"""Radians that a start may be beyond a limit: the iteration may bring it back."""


@lru_cache(maxsize=16)
def kernel_of(robot: Robot, nominal: Arm) -> Any:
    """The compiled kernel of a robot with the closed form of its nominal arm; None where there is none."""
    sums = robot.joint_map.sums
    if sums is None:
        return None
    closed = OrthoParallel.from_arm(nominal, NEAR_NOMINAL)
    usual = None if robot.joint_map.is_identity else sums
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


def start_turns(nominal: Arm, q: FloatArray, near: FloatArray | None) -> FloatArray:
    """Joints (6, n) shifted near the limits at the turns nearest to ``near`` (6, n) or zero."""
    lower, upper = nominal.lower[:, None] - SLACK, nominal.upper[:, None] + SLACK
    close = np.zeros((6, 1)) if near is None else near
    stay = (q >= lower) & (q <= upper) & ((near is None) | (np.abs(close - q) <= np.pi))
    return np.where(stay, q, q + TAU * closed_form.whole_turns(lower, upper, q, close)[0])


def next_fake(fake: FloatArray, tip: FloatArray, H: FloatArray) -> FloatArray:
    """The product fake tip^-1 H of columns (4, 3, n), step 1 of Nubiola 2011, section 6.2."""
    in_tip = np.einsum("jin,kin->jkn", np.concatenate([H[:3], (H[3] - tip[3])[None]]), tip[:3])
    out = np.einsum("jkn,kin->jin", in_tip, fake[:3])
    out[3] += fake[3]
    return out


def same_turn(q: FloatArray, q_before: FloatArray) -> FloatArray:
    """Joints q at the turns nearest to the joints before."""
    return q + TAU * np.rint((q_before - q) / TAU)
