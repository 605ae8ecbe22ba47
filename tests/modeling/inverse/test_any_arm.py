"""Newton's steps alone: arms that no closed form takes."""

import numpy as np
import pytest
from support import assert_same_poses, example_robot, on_a_rail, random_robot

from irbcal.errors import RobotError
from irbcal.io import urdf
from irbcal.modeling.inverse import any_arm, closed_form
from irbcal.modeling.inverse.result import Reason
from irbcal.modeling.robot import Robot


def an_arm(name, folder):
    """A real arm with six or seven joints, or one on a rail."""
    if name == "rail":
        return urdf.read(on_a_rail(folder / "rail.urdf"), "rail_base", "tool0").arm
    file, tip = {
        "ur10": ("ur_description/urdf/ur10_robot.urdf", None),
        "panda": ("panda_description/urdf/panda.urdf", "panda_link8"),
    }[name]
    return urdf.read(example_robot(file), tip_link=tip).arm


@pytest.mark.parametrize("name", ["ur10", "panda", "rail"])
def test_numerical_inverse(name, tmp_path):
    """Poses of random joints are reached within the limits; a seed near the answer is kept near."""
    arm = an_arm(name, tmp_path)
    robot = random_robot(arm, "placement", np.random.default_rng(3), size=0.2)
    assert not closed_form.has_closed_form(arm)
    q = arm.random_joints(60, 12)
    T = robot.poses(q)
    found = any_arm.solve(robot, arm, T)
    solved = found.converged & found.inside
    assert solved.mean() > 0.95
    assert_same_poses(robot.poses(found.joints[solved]), T[solved], 1e-9, 1e-9)
    near = any_arm.solve(robot, arm, T, q + 0.01, thorough=False)
    assert near.converged.all()
    assert np.abs(near.joints - q)[near.inside].max() < 0.3
    T[0, 0, 3] = np.nan
    bad = any_arm.solve(robot, arm, T[:2], q[:2])
    assert list(bad.converged) == [False, True]
    assert "NaN" in Reason(bad.reason[0]).in_words
    far = any_arm.solve(robot, arm, away(T[1:2]))
    assert not far.converged.any()
    assert np.isnan(far.joints).all()


def away(T):
    T = T.copy()
    T[:, 2, 3] += 50.0
    return T


def test_seeds_of_another_shape_or_unit_are_refused(tmp_path):
    arm = an_arm("rail", tmp_path)
    T = arm.forward(arm.random_joints(3, 0))
    with pytest.raises(RobotError, match=r"seed joints need shape \(7,\) or \(3, 7\), found \(2, 7\)"):
        any_arm.solve(Robot(arm), arm, T, np.zeros((2, 7)))
    with pytest.raises(RobotError, match="these look like degrees"):
        any_arm.solve(Robot(arm), arm, T, [0.5, 10, 20, 30, 40, 50, 60])
    assert len(any_arm.solve(Robot(arm), arm, np.empty((0, 4, 4)))) == 0
