"""Damped Newton steps: their Jacobian, their errors, and how far they come."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, assert_derivative, assert_same_poses, on_a_rail, random_robot, random_rotation, with_thesis

from irbcal.io import urdf
from irbcal.modeling import frames
from irbcal.modeling.inverse import newton
from irbcal.modeling.inverse.poses import pose_columns
from irbcal.modeling.robot import Robot


def a_robot(name, folder):
    """A calibrated robot with all there is in its joint map; one with a joint that slides."""
    if name == "rail":
        nominal = urdf.read(on_a_rail(folder / "rail.urdf"), "rail_base").arm
        robot = random_robot(nominal, "placement", np.random.default_rng(2))
        return robot.replace(joint_map=with_thesis(robot.joint_map, gain=np.linspace(-2e-3, 3e-3, 7)))
    robot = random_robot(arm(name), "34", np.random.default_rng(1), 1.0)
    return robot.replace(joint_map=with_thesis(robot.joint_map, gain=np.linspace(-2e-3, 3e-3, 6)))


@pytest.mark.parametrize("name", ["irb1600", "irb120", "rail"])
def test_jacobian_of_newton_steps(name, tmp_path):
    robot = a_robot(name, tmp_path)
    chain = newton.CalibratedChain(robot, 1.3)
    H = pose_columns(robot.poses(robot.arm.random_joints(4, 1)))
    q = robot.arm.random_joints(4, 2).T
    J, e, cost, errors = chain.linearised(H, q)
    for k in range(4):
        R = chain.tip(q[:, k : k + 1])

        def moved(x, R=R):
            tip = chain.tip(x[:, None])
            return np.concatenate([tip[3, :, 0] / 1.3, newton.rotation_vector(R, tip)[:, 0]])

        # J is the derivative of what the tip does; what is lacking falls by as much
        assert_derivative(moved, q[:, k], J[k], 1e-9, 1e-5)
    np.testing.assert_allclose(cost, (e**2).sum(axis=1), rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(e[:, :3], axis=1) * 1.3, errors[0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(e[:, 3:], axis=1), errors[1], rtol=0, atol=1e-13)


def test_errors_are_a_distance_and_an_angle():
    rng = np.random.default_rng(3)
    T = np.array([frames.transform(random_rotation(rng), rng.normal(size=3)) for _ in range(20)])
    H = np.array([frames.transform(random_rotation(rng), rng.normal(size=3)) for _ in range(20)])
    position, rotation = newton.errors(pose_columns(T), pose_columns(H))
    np.testing.assert_allclose(position, np.linalg.norm((T - H)[:, :3, 3], axis=1), rtol=0, atol=1e-15)
    np.testing.assert_allclose(rotation, frames.rotation_distance(T[:, :3, :3], H[:, :3, :3]), rtol=0, atol=1e-14)
    # eq. 6.41 as printed, of the relative pose
    relative = frames.inverse(T) @ H
    printed = np.arccos((np.trace(relative[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0)
    np.testing.assert_allclose(rotation, printed, rtol=0, atol=1e-7)


def test_turning_and_shifting_columns():
    rng = np.random.default_rng(4)
    T = np.array([frames.transform(random_rotation(rng), rng.normal(size=3)) for _ in range(10)])
    turn, shift = rng.normal(size=(2, 3, 10))
    expected = T.copy()
    for k in range(10):
        expected[k, :3, :3] = frames.rotation_from_vector(turn[:, k]) @ T[k, :3, :3]
        expected[k, :3, 3] += shift[:, k]
    found = newton.moved(pose_columns(T), turn, shift)
    np.testing.assert_allclose(found, pose_columns(expected), rtol=0, atol=1e-14)
    back = newton.rotation_vector(pose_columns(T), found)
    small = np.linalg.norm(turn, axis=0) < 3.0
    assert small.sum() > 5
    np.testing.assert_allclose(back[:, small], turn[:, small], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["irb1600", "rail"])
def test_steps_come_home_from_nearby(name, tmp_path):
    robot = a_robot(name, tmp_path)
    chain = newton.CalibratedChain(robot, 1.0)
    q = 0.5 * robot.arm.random_joints(200, 5)
    T = robot.poses(q)
    start = q + np.random.default_rng(6).uniform(-0.05, 0.05, q.shape)
    found, position, rotation, evaluations = newton.solve(chain, pose_columns(T), start.T.copy(), (1e-11, 1e-11))
    good = (position <= 1e-11) & (rotation <= 1e-11)
    assert good.mean() > 0.97
    assert_same_poses(robot.poses(found.T[good]), T[good], 1e-10, 1e-10)
    assert np.median(evaluations) < 8


def test_a_pose_that_is_met_already_costs_one_evaluation():
    robot = Robot(arm())
    q = robot.arm.random_joints(10, 7)
    H = pose_columns(robot.poses(q))
    chain = newton.CalibratedChain(robot, 1.0)
    found, _, _, evaluations = newton.solve(chain, H, q.T.copy(), (1e-9, 1e-9))
    assert np.array_equal(found, q.T)
    assert (evaluations == 1).all()


def test_a_tip_beside_the_last_frame_counts():
    """Arms whose tip link is no frame of the DHM chain, against the forward kinematics."""
    robot = a_robot("irb1600", None)
    T = frames.transform(random_rotation(np.random.default_rng(4)), np.array([0.1, -0.2, 0.05]))
    robot = robot.replace(arm=replace(robot.arm, T_last_tip=T))
    q = robot.arm.random_joints(5, 3)
    tip = newton.CalibratedChain(robot, 1.3).tip(q.T.copy())
    poses = robot.poses(q)
    np.testing.assert_allclose(np.moveaxis(tip[3], -1, 0), poses[:, :3, 3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.moveaxis(tip[:3], -1, 0).swapaxes(1, 2), poses[:, :3, :3], rtol=0, atol=1e-12)
