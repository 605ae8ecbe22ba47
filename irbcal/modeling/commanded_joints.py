"""Joints of an arm as a plan commands them: where it is at home, and what can be commanded."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

METRES_PER_DEGREE = 10 * MM
"""Travel of a prismatic joint that counts as one degree of a revolute one: in axis moves and in margins."""

DECIMALS = 4
"""Of commanded joints in degrees and millimetres; what is checked is what is commanded."""


def rounded(arm: Arm, q: FloatArray) -> FloatArray:
    """Joints as they are commanded, with `DECIMALS` places in degrees and millimetres."""
    return np.round(q / arm.joint_units, DECIMALS) * arm.joint_units


def home_joints(arm: Arm) -> FloatArray:
    """Zero joints; the middle of the limits for a joint that has no room about zero, shape (joints,)."""
    room = np.where(arm.table.prismatic, 10 * METRES_PER_DEGREE, 10 * DEG)
    with np.errstate(invalid="ignore"):
        middle = np.where(np.isfinite(arm.upper - arm.lower), (arm.lower + arm.upper) / 2, 0.0)
        room = np.minimum(room, (arm.upper - arm.lower) / 4)
    return np.where((arm.lower + room <= 0) & (arm.upper - room >= 0), 0.0, middle)


def line_at_home(arm: Arm) -> FloatArray:
    """A line along the arm at home, for drawings: base, feet of the common normals and origins of the joints, tip.

    In the base link, metres, shape (2 joints + 2, 3).
    """
    joints = (home_joints(arm) + arm.table.offsets)[:, None]
    chain = dhm.chain_frames(arm.table, joints, arm.T_base_0, arm.T_last_tip)
    along = np.stack([chain.o_tilt[..., 0], chain.o[..., 0]], axis=1).reshape(-1, 3)
    return np.vstack([np.zeros(3), along, chain.tip[3, :, 0]])
