"""Zeros of joints that were lost, by a crash or a change of a motor: all else of the robot is as it was calibrated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import OptionError
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.option_values import number
from irbcal.units import DEG, MM

WELL = 0.01 * DEG
"""Half of an interval of a zero with which a robot is as good as before; its controller shows so much, too."""
MANY = 200
"""Poses at most of which it is said that they are enough."""


def lost_joints(joints: Sequence[int], arm: Arm) -> tuple[int, ...]:
    """Joints whose zeros were lost, from 1, as a caller names them in ``refit_zeros``.

    Raises
    ------
    OptionError
        If one is no joint of the arm, or named twice.
    """
    for joint in joints:
        number("refit_zeros", joint, 1, len(arm.joint_names), whole=True)
    if len(set(joints)) < len(joints):
        raise OptionError("refit_zeros: a joint is named twice", parameter="refit_zeros")
    return tuple(joints)


def with_zeros(robot: Robot, joints: Sequence[int], by: FloatArray) -> Robot:
    """The robot with the zeros of joints (from 1) moved, radians (metres)."""
    table = robot.arm.table
    theta, d = np.array(table.theta), np.array(table.d)
    for joint, amount in zip(joints, by, strict=True):
        (d if table.prismatic[joint - 1] else theta)[joint - 1] += amount
    return robot.replace(arm=robot.arm.with_table(replace(table, theta=theta, d=d)))


def zeros_in_words(arm: Arm, joints: Sequence[int], moved: FloatArray, half: FloatArray) -> list[str]:
    """How far each joint stands beside what it shows, and what to do.

    Parameters
    ----------
    arm : Arm
    joints : sequence of int
        From 1.
    moved, half : ndarray, shape (joints,)
        With half of the 95 % interval; radians (metres).
    """
    out = []
    for joint, shift, width in zip(joints, moved, half, strict=True):
        unit, name = (MM, "mm") if arm.table.prismatic[joint - 1] else (DEG, "degrees")
        out.append(
            f"Joint {joint} stands {shift / unit:+.4f} ± {width / unit:.4f} {name} (95 %) beside what it shows: let it "
            f"show {shift / unit:+.4f} {name} more there (mastering), then the calibration holds again"
        )
    return out
