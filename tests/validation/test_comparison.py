"""Comparisons of calibrations and expected against verified errors, on simulated robots."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.correction.fake_targets import correct_joints
from irbcal.errors import MeasurementError
from irbcal.validation import comparison


def test_better_worse_and_not_told():
    rng = np.random.default_rng(0)
    pose = np.repeat(np.arange(40), 2)
    first = 1e-3 * (1 + 0.1 * rng.random(80))
    names = np.array([f"p{k}" for k in range(40)])
    better = comparison.compare(first, first - 1e-4, pose, names)
    assert better.difference == pytest.approx(-1e-4, abs=1e-12)
    assert better.second_is_better == 1.0
    assert better.verdict("A", "B").startswith("On these poses B is better than A by 0.100 mm")
    worse = comparison.compare(first, first + 2e-4, pose, names)
    assert worse.verdict("A", "B").startswith("On these poses A is better than B by 0.200 mm")
    same = comparison.compare(first, first + 1e-4 * rng.standard_normal(80), pose, names)
    assert "do not tell A and B apart" in same.verdict("A", "B")
    assert "too few" in comparison.compare(first[:4], first[:4], pose[:4], names).verdict("A", "B")


def test_pose_means_by_hand():
    found = comparison.compare([1.0, 3.0, 5.0], [2.0, 2.0, 1.0], np.array([4, 4, 7]), np.arange(8))
    assert found.pose.tolist() == [4, 7]
    assert found.first.tolist() == [2.0, 5.0]
    assert found.second.tolist() == [2.0, 1.0]
    assert found.difference == pytest.approx(-2.0)


def test_common_points_are_matched_by_pose_and_target():
    nominal = arm()
    robot = random_robot(nominal, "11", np.random.default_rng(0))
    points = measured(robot, nominal.random_joints(6, 0))
    other = points.select(np.arange(6) != 2)
    other = replace(
        other.take(other.target > 0), target=other.target[other.target > 0] - 1, target_names=("smr2", "smr3")
    )
    mine, theirs = comparison.common_points(points, other)
    assert len(mine) == 10
    assert np.array_equal(points.xyz[mine], other.xyz[theirs])
    with pytest.raises(MeasurementError, match="no measured point in common"):
        comparison.common_points(points, replace(other, target_names=("a", "b")))


def test_verified_errors_of_a_perfect_calibration_are_zero_and_expected_ones_too():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4))
    q = 0.5 * nominal.random_joints(30, 1)
    corrected = correct_joints(robot, nominal, q)
    keep = corrected.ok
    assert keep.sum() > 25
    expected = measured(robot, q[keep])
    verified = measured(robot, corrected.q[keep])
    found = comparison.expected_and_verified(robot, nominal, expected, verified)
    assert found["expected"]["max_mm"] < 1e-9
    assert found["verified"]["max_mm"] < 1e-5, "fake targets are found to 1e-10 m at the tip"
    assert found["command_mm"] < 1e-5
    assert found["uncorrected"]["mean_mm"] > 0.1


def test_verified_errors_of_an_imperfect_calibration_are_like_the_expected_ones():
    """Section 7.6: what the calibrated model misses by at the uncorrected poses is what verification finds."""
    nominal = arm()
    truth = random_robot(nominal, "34", np.random.default_rng(4))
    robot = random_robot(nominal, "11", np.random.default_rng(4), targets=truth.targets)
    robot = robot.replace(T_world_base=truth.T_world_base)
    q = 0.5 * nominal.random_joints(200, 1)
    corrected = correct_joints(robot, nominal, q)
    expected, verified = measured(truth, q[corrected.ok]), measured(truth, corrected.q[corrected.ok])
    found = comparison.expected_and_verified(robot, nominal, expected, verified)
    assert found["verified"]["mean_mm"] == pytest.approx(found["expected"]["mean_mm"], rel=0.03)
    assert found["verified"]["max_mm"] == pytest.approx(found["expected"]["max_mm"], rel=0.05)
    strangers = replace(verified, pose_ids=np.array([f"x{k}" for k in range(verified.poses)]))
    with pytest.raises(MeasurementError, match="no pose of the same name"):
        comparison.expected_and_verified(robot, nominal, expected, strangers)
