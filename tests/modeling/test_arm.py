"""Arm and robot: shapes, refusals, targets."""

import numpy as np
import pytest
from support import TARGETS, arm, random_robot

from irbcal.errors import RobotError


def test_points_are_the_pose_applied_to_the_target():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(0))
    q = nominal.random_joints(20, 0)
    T = robot.T_world_base @ robot.poses(q)
    expected = (T @ np.r_[TARGETS["smr2"], 1.0])[:, :3]
    assert np.abs(robot.points(q, "smr2") - expected).max() < 1e-14
    mixed = robot.points(q[:2], ["smr1", "smr2"])
    assert np.abs(mixed[1] - expected[1]).max() < 1e-14


def test_unknown_target_lists_the_known_ones():
    with pytest.raises(RobotError, match="unknown target 'x': this robot has smr1, smr2, smr3"):
        random_robot(arm(), "11", np.random.default_rng(0)).points(np.zeros((1, 6)), "x")


def test_joints_of_another_shape_are_refused():
    with pytest.raises(RobotError, match=r"shape \(n, 6\), found \(1, 7\)"):
        random_robot(arm(), "11", np.random.default_rng(0)).poses(np.zeros(7))


def test_random_joints_stay_inside_the_limits():
    nominal = arm("irb120")
    q = nominal.random_joints(2000, 0)
    assert (q >= nominal.lower).all()
    assert (q <= nominal.upper).all()
    assert (np.ptp(q, axis=0) > 0.98 * (nominal.upper - nominal.lower)).all()
