"""Joints of an arm as a plan commands them: where it is at home, and what can be commanded."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
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
