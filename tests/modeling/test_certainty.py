"""Predictions with intervals: positions are the robot's own, what is not known widens them, ranges are counted."""

import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from evidence_cases import Truth, moves
from support import arm, random_robot

from irbcal.cell.robot_derivatives import point_derivatives
from irbcal.errors import RobotError
from irbcal.identification.evidence import identify_evidence
from irbcal.units import DEG


@pytest.fixture(scope="module")
def robot():
    truth = Truth(["gravity", "direction"], scale=2.0)
    motion = replace(moves(truth.nominal, 80, 3), elapsed=None)
    return identify_evidence(truth.nominal, truth.measured(motion, 1e-5), motion).robot


def test_positions_are_forward_kinematics(robot):
    q, previous = robot.arm.random_joints(30, 5), robot.arm.random_joints(30, 6)
    for name, place in robot.targets.items():
        T = robot.T_world_base @ robot.forward(q, previous)
        expected = T[:, :3, :3] @ place + T[:, :3, 3]
        np.testing.assert_allclose(robot.predict(q, previous, name).position, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        robot.predict(q).position, robot.points(q, next(iter(robot.targets))), rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(robot.predict_tip(q).position, robot.poses(q)[:, :3, 3], rtol=0, atol=1e-13)


def test_unknown_moves_are_unknown_row_by_row(robot):
    q, previous = robot.arm.random_joints(20, 5), robot.arm.random_joints(20, 6)
    known, unknown = robot.predict(q, previous), robot.predict(q)
    previous[::2] = np.nan
    mixed = robot.predict(q, previous)
    for name in ("position", "covariance", "interval"):
        np.testing.assert_allclose(getattr(mixed, name)[::2], getattr(unknown, name)[::2], rtol=1e-9)
        np.testing.assert_allclose(getattr(mixed, name)[1::2], getattr(known, name)[1::2], rtol=1e-9)
    assert (unknown.interval > known.interval).all()


def with_limits(robot, **changes):
    return replace(robot.certainty, limits=robot.certainty.limits.model_copy(update=changes))


def test_the_interval_is_the_formula(robot):
    q = robot.arm.random_joints(9, 5)
    limits = robot.certainty.limits
    for in_order, loo_mm in ((False, limits.leave_one_out_mm), (True, limits.leave_fifths_out_mm)):
        seen = robot.predict(q, target="smr2", in_order=in_order)
        variance = np.einsum("nii->ni", seen.covariance)
        np.testing.assert_allclose(
            seen.interval, 1.96 * np.sqrt(variance + (1e-3 * loo_mm["smr2"]) ** 2 / 3), rtol=1e-12
        )


def test_the_noise_of_the_measurements_moves_no_part(robot):
    q = robot.arm.random_joints(4, 5)
    place = np.zeros((4, 3))
    of_noise = {
        noise: point_derivatives(robot, with_limits(robot, measurement_noise_mm=1e3 * noise), q, place)[2]
        for noise in (0.0, 2e-6, 1.0)
    }
    np.testing.assert_allclose(of_noise[0.0] - of_noise[2e-6], 4e-12, rtol=1e-6)
    np.testing.assert_allclose(of_noise[0.0] - of_noise[1.0], robot.certainty.left_out(None) ** 2 / 3, rtol=1e-6)


def test_covariance_grows_with_its_matrix_and_follows_the_base(robot):
    q = robot.arm.random_joints(9, 5)
    base = np.zeros_like(robot.certainty.covariance)
    base[3:6, 3:6] = 1e-8 * np.diag([1.0, 4.0, 9.0])
    only = robot.replace(
        certainty=replace(robot.certainty, covariance=base, coefficients=0 * robot.certainty.coefficients)
    )
    R = robot.T_world_base[:3, :3]
    np.testing.assert_allclose(
        only.predict(q).covariance, np.broadcast_to(R @ base[3:6, 3:6] @ R.T, (9, 3, 3)), atol=1e-20
    )
    assert not only.predict_tip(q).covariance.any()


def test_lengths_of_moves_are_as_uncertain_as_finite_differences_say(robot):
    """Covariance of one reflector's place and of the base, which no length depends on."""
    q, name = robot.arm.random_joints(12, 5), "smr2"
    slot = 6 + 3 * robot.certainty.fitted_targets.index(name)
    covariance = np.zeros_like(robot.certainty.covariance)
    covariance[:6, :6] = 1e-6 * np.eye(6)
    covariance[slot : slot + 3, slot : slot + 3] = 1e-8 * np.diag([1.0, 4.0, 9.0])
    still = 0.0 * robot.certainty.coefficients
    one = robot.replace(certainty=replace(robot.certainty, covariance=covariance, coefficients=still))
    length, width = one.predict_moves(q, target=name)
    np.testing.assert_allclose(length, np.linalg.norm(np.diff(robot.points(q, name), axis=0), axis=1), atol=1e-13)
    variance = np.zeros(11)
    for axis, std in enumerate([1e-4, 2e-4, 3e-4]):
        step = 1e-6 * np.eye(3)[axis]
        ahead, behind = (
            robot.replace(targets={**robot.targets, name: robot.targets[name] + sign * step}).predict_moves(
                q, None, name
            )[0]
            for sign in (1.0, -1.0)
        )
        variance += ((ahead - behind) / 2e-6 * std) ** 2
    loo = robot.certainty.left_out(name)
    np.testing.assert_allclose(width, 1.96 * np.sqrt(variance + 2.0 * loo**2 / 3.0), rtol=1e-6)
    known = robot.predict_moves(q, robot.arm.random_joints(12, 6))[1]
    assert (robot.predict_moves(q)[1] > known).all()  # from which side the joints come is not known


def test_poses_outside_are_told_by_joint_and_degrees(robot):
    low, high = np.array(robot.certainty.limits.ranges)
    q = np.tile(0.5 * (low + high), (5, 1))
    assert robot.certainty.outside_in_words(q) == ""
    q[0, 1] = high[1] + 3.0 * DEG
    q[1, 1] = low[1] - 7.25 * DEG
    q[1, 4] = high[4] + 1.0 * DEG
    q[2, 3] = high[3] + 0.005 * DEG  # as files are rounded
    words = robot.certainty.outside_in_words(q, "targets")
    assert words.startswith(
        "2 of 5 targets lie outside the joint ranges of the calibration's fit (joint_2 in 2 by up to "
    )
    assert "7.2 degrees" in words or "7.3 degrees" in words
    assert "joint_5 in 1 by up to 1.0 degrees)" in words
    np.testing.assert_array_equal(robot.predict(q).outside, [True, True, False, False, False])


def test_robots_without_certainty_say_so():
    plain = random_robot(arm(), "34", np.random.default_rng(0))
    for call in (plain.predict, plain.predict_tip):
        with pytest.raises(RobotError, match="nothing is known of how certain irb1600"):
            call(np.zeros((1, 6)))


def test_wrong_calls(robot):
    with pytest.raises(RobotError, match="'x'"):
        robot.predict(np.zeros((1, 6)), target="x")
    with pytest.raises(RobotError, match="these look like degrees"):
        robot.predict([[0, 0, 0, 0, 90, 0]])
    bare = robot.replace(certainty=with_limits(robot, leave_one_out_mm={}, leave_fifths_out_mm={}))
    with pytest.raises(RobotError, match="without a pose it does not determine where smr1 is"):
        bare.predict(np.zeros((1, 6)))


def test_predictions_can_be_pickled_and_listed(robot):
    q = robot.arm.random_joints(4, 2)
    again = pickle.loads(pickle.dumps(robot))
    frame = again.predict(q).to_frame()
    assert list(frame) == ["x_mm", "y_mm", "z_mm", "x_u95_mm", "y_u95_mm", "z_u95_mm", "outside"]
    np.testing.assert_allclose(frame["y_u95_mm"], 1e3 * robot.predict(q).interval[:, 1], rtol=1e-12)
    assert len(repr(robot.certainty)) < 200


OF_JOINTS = {
    "effective": lambda robot, q, previous: robot.joint_map.effective(q, previous),
    "commanded": lambda robot, q, previous: robot.joint_map.commanded(q, previous),
    "jacobian": lambda robot, q, previous: robot.joint_map.jacobian(q, previous),
    "predict": lambda robot, q, previous: robot.predict(q, previous).position,
    "predict_tip": lambda robot, q, previous: robot.predict_tip(q, previous).position,
    "predict_moves": lambda robot, q, previous: robot.predict_moves(q, previous)[0],
    "jacobian_derivative": lambda robot, q, _: robot.joint_map.jacobian_derivative(q, np.ones_like(q)),
    "outside": lambda robot, q, _: robot.joint_map.outside(q),
    "poses": lambda robot, q, _: robot.poses(q),
    "points": lambda robot, q, _: robot.points(q, "smr1"),
    "position_std": lambda robot, q, _: robot.position_std(q, "smr1"),
}


@pytest.mark.parametrize("call", OF_JOINTS.values(), ids=OF_JOINTS)
def test_joints_are_radians_of_one_pose_or_several_wherever_a_user_gives_them(robot, call):
    q, previous = robot.arm.random_joints(3, 5), robot.arm.random_joints(3, 6)
    np.testing.assert_array_equal(call(robot, q[0], previous[0]), call(robot, q[:1], previous[:1]))
    table = pd.DataFrame(q / DEG, columns=robot.arm.joint_columns)
    for wrong, words in ((q / DEG, "look like degrees"), (table, "found a table"), (q[:, :5], "need shape")):
        with pytest.raises(RobotError, match=words):
            call(robot, wrong, None)
        if call in [*OF_JOINTS.values()][:6]:
            with pytest.raises(RobotError, match=words):
                call(robot, q, wrong)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda robot, q: robot.points(q, None), "unknown target None"),
        (lambda robot, q: robot.points(q, ["smr1", "smr2"]), "expected one, or one for each of 3 poses, found 2"),
        (lambda robot, q: robot.predict(q, target=["smr1"]), r"unknown target \['smr1'\]"),
        (lambda robot, q: robot.position_std(q, ["smr1"]), r"unknown target \['smr1'\]"),
    ],
)
def test_targets_are_names(robot, call, words):
    with pytest.raises(RobotError, match=words) as refused:
        call(robot, robot.arm.random_joints(3, 5))
    assert refused.value.parameter == "target"
