"""Robots: targets, refusals, and what they say of themselves."""

import pickle

import numpy as np
import pandas as pd
import pytest
from support import TARGETS, arm, assert_same_poses, random_robot

from irbcal.errors import RobotError
from irbcal.modeling.robot import Robot


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


@pytest.mark.parametrize(
    ("joints", "found"),
    [
        ([0, -14, 14, 0, 30, 0], "-14 for joint_2"),
        ([0, 0, 0, 0, 0, 90], "90 for joint_6"),
        ([[0, 0, 0, 0, 0, 0], [-170, 0, 0, np.nan, 0, 0]], "-170 for joint_1"),
    ],
)
def test_degrees_are_refused_and_so_is_nothing_that_a_robot_does(joints, found):
    robot = random_robot(arm(), "34", np.random.default_rng(0))
    for call in (robot.poses, lambda q: robot.points(q, "smr1")):
        with pytest.raises(RobotError, match="these look like degrees") as caught:
            call(joints)
        assert f"expected in radians, found {found}" in str(caught.value)
        assert robot.arm.name in str(caught.value)
        call(np.radians(joints))
    ends = np.array([robot.arm.lower, robot.arm.upper])  # joint 6 of the IRB 1600 turns by 400 degrees
    assert robot.arm.upper[5] > 6.9
    assert_same_poses(robot.poses(1.2 * ends), robot.forward(1.2 * ends), 0.0, 0.0)
    assert robot.forward(np.atleast_2d(joints)).shape[1:] == (4, 4)


def test_a_robot_cannot_be_changed_and_can_be_pickled():
    place = np.array([0.1, 0.0, 0.2])
    robot = Robot(arm(), targets={"a": place}, target_rotations={"a": np.eye(3)})
    place[0] = 5.0
    assert robot.targets["a"][0] == 0.1
    with pytest.raises(ValueError, match="read-only"):
        robot.T_world_base[0, 3] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        robot.targets["a"][0] = 1.0
    with pytest.raises(TypeError, match="cannot be changed"):
        robot.targets["b"] = place
    again = pickle.loads(pickle.dumps(robot))
    q = robot.arm.random_joints(5, 0)
    assert np.array_equal(again.points(q, "a"), robot.points(q, "a"))


def test_what_a_robot_says_of_itself():
    robot = random_robot(arm(), "34", np.random.default_rng(0))
    said = repr(robot)
    for words in ("irb1600", "6 revolute joints", "6 terms (thesis)", "3 targets (smr1, smr2, smr3)"):
        assert words in said
    assert "no targets" in repr(Robot(arm()))
    assert "no joint map" in repr(Robot(arm()))
    many = robot.replace(targets={f"t{k}": np.zeros(3) for k in range(1000)})
    assert max(map(len, map(repr, (robot, many, robot.arm, robot.table, robot.joint_map)))) < 500


def test_tables_and_texts_are_no_joints():
    table = pd.DataFrame([[90.0, 0, 0, 0, 0, 0]], columns=[f"q{k}_deg" for k in range(1, 7)])
    with pytest.raises(RobotError, match=r"expected as an array in radians .* found a table") as refused:
        Robot(arm()).poses(table)
    assert refused.value.parameter == "q"
    with pytest.raises(RobotError, match="expected as an array of numbers, found 'abc'") as refused:
        Robot(arm()).poses("abc")
    assert refused.value.parameter == "q"
