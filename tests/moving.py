"""Robots whose joints lag, bend and turn unevenly, moved one by one or at random, for tests of single joints."""

from dataclasses import replace

import numpy as np
import pytest
from support import TARGETS, arm, measured
from thesis_formula import ThesisMap

from irbcal.errors import IrbcalError
from irbcal.measurement.motions import last_moves
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot

BACKLASH = np.radians(0.05)
SERIES = np.array([-0.000373, -0.000750, -0.000956, -0.000244])
"""Backlash of joint 6 and the coefficients of its series in radians (Nubiola 2011, section 4.2 and Table 5.2)."""


def there_and_back(low, high, step):
    up = np.radians(np.arange(low, high + step / 2, step))
    return np.r_[up, up[::-1]]


def moves(joint, angles, home=(0, 0, 0, 0, 30, 0)):
    """Commands (n, 6) in which one joint moves, counted from 1."""
    q = np.tile(np.radians(np.array(home, dtype=float)), (len(angles), 1))
    q[:, joint - 1] = angles
    return q


def simulated(commands, groups=None, backlash=0.0, per_move=0.0, noise=0.0, rng=None, **joint_map):
    """Points of a robot whose joints lag and bend; returns the points, their last moves and the robot without all that."""
    nominal = arm("irb1600")
    robot = Robot(
        nominal,
        ThesisMap(**joint_map).joint_map(nominal),
        frames.transform(frames.rot_z(2.0), [3.0, -1.0, 0.5]),
        TARGETS,
    )
    step = last_moves(commands, groups)
    known = np.nan_to_num(step)
    effective = robot.joint_map.effective(commands) - 0.5 * np.sign(known) * backlash + known * per_move
    points = measured(robot.replace(joint_map=JointMap.identity(nominal)), effective, noise, rng, groups)
    return replace(points, q=commands), step, robot.replace(joint_map=JointMap.identity(nominal))


def random_commands(n, seed):
    nominal = arm("irb1600")
    return nominal.random_joints(n, seed) * 0.6


def refusal(function, *arguments, **options):
    with pytest.raises(IrbcalError) as caught:
        function(*arguments, **options)
    text = str(caught.value)
    assert "\n" not in text
    return text
