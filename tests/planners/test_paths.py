"""Directions along paths, and commands that take account of them."""

import numpy as np
import pytest
from history_cases import sided_robot
from support import assert_derivative, assert_same_poses

from irbcal.io import urdf
from irbcal.planners.calibrated_model import CalibratedModel, previous_on_path
from irbcal.units import DEG

TURNS = np.zeros(6, dtype=bool)


@pytest.fixture(scope="module")
def sided():
    """A robot whose joints lean to the side that they come from, and its model."""
    robot = sided_robot(others=("gain", "gravity"))
    return robot, CalibratedModel(urdf.to_bytes(urdf.read("irb120"), robot.arm), robot.arm, robot.joint_map)


def there_and_back():
    """Joints 1 and 2 there and back in steps of half a degree, joint 3 there only; the others stand."""
    theta = np.zeros((81, 6))
    theta[:, 0] = np.r_[np.arange(41), np.arange(39, -1, -1)] * 0.5 * DEG
    theta[:, 1] = 0.5 * theta[:, 0]
    theta[:, 2] = np.arange(81) * 0.25 * DEG
    theta[:, 4] = 0.5
    return theta


def test_moves_have_the_signs_of_joint_speeds_whatever_the_steps():
    theta = there_and_back()
    fine = np.repeat(theta, 3, axis=0)  # the arm waits at each point
    for path, every in ((theta, 1), (fine, 3)):
        move = path - previous_on_path(path, TURNS)
        assert np.isnan(move[:every]).all()
        for part, sign in ((move[every : 41 * every], 1.0), (move[41 * every :], -1.0)):
            assert part[:, 0] == pytest.approx(sign * 5 * DEG)
            assert part[:, 1] == pytest.approx(sign * 2.5 * DEG)
            assert part[:, 2] == pytest.approx(2.5 * DEG)
            assert not part[:, 3:].any()


def test_long_steps_are_moves_as_they_are_and_prismatic_joints_count_in_metres():
    theta = np.array([[0.0, 0.0], [1.0, 0.2], [1.0, 0.21]])
    move = theta - previous_on_path(theta, np.array([False, True]))
    assert move[1] == pytest.approx([1.0, 0.2])
    assert move[2] == pytest.approx([0.0, 0.05])


def test_commands_of_a_path_know_the_sides(sided):
    robot, model = sided
    theta = there_and_back()
    q = model.command_from_model(theta, path=True)
    previous = previous_on_path(theta, TURNS)
    assert_same_poses(model.placement(q, previous=previous), robot.arm.forward(theta), 1e-12, 1e-12)
    single = model.command_from_model(theta)
    assert np.abs(q[0] - single[0]).max() < 1e-13
    assert np.abs(model.placement(single, previous=previous) - robot.arm.forward(theta))[1:, :3, 3].max() > 3e-5
    side = robot.joint_map.history_std[0]
    assert np.abs(q[20] - q[60])[0] > 0.2 * side  # joint 1 comes from the other side


def test_jacobians_know_the_side(sided):
    robot, model = sided
    q, previous = (robot.arm.random_joints(1, seed) for seed in (1, 2))
    J = model.jacobian(q, previous=previous)[0, :3]
    place = lambda x: model.placement(x[None], previous=previous)[0, :3, 3]  # noqa: E731
    assert_derivative(place, q[0], J, 1e-9, step=1e-4)
    near = q - DEG * np.array([0.1, -0.2, 0.3, 0.15, 0.25, -0.05])  # where the side just changes, its slope matters
    J = model.jacobian(q, previous=near)[0, :3]
    place = lambda x: model.placement(x[None], previous=near)[0, :3, 3]  # noqa: E731
    assert_derivative(place, q[0], J, 1e-6, step=1e-5)
    assert np.abs(J - model.jacobian(q)[0, :3]).max() > 1e-4


def test_commands_within_the_models_limits_respect_those_of_the_robot(sided):
    robot, model = sided
    rng = np.random.default_rng(4)
    lower, upper = model.model.lowerPositionLimit, model.model.upperPositionLimit
    corners = np.where(rng.random((200, 6)) < 0.5, lower, upper)
    q = robot.joint_map.commanded(corners, rng.permutation(corners))
    assert not model.beyond_limits(q).any()
    assert not model.beyond_limits(model.command_from_model(corners)).any()
