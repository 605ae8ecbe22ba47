"""Zeros of joints that were lost, from few poses: known truth, intervals, and what cannot be told."""

from dataclasses import replace

import numpy as np
import pytest
from sessions_cases import truth
from support import arm, measured, write_measurements

import irbcal
from irbcal.errors import MeasurementError, OptionError
from irbcal.validation.refit import Refit

NOISE = 2e-5
LOST = {3: np.radians(0.4), 5: np.radians(-0.7)}


def crashed(robot, lost=LOST):
    theta = np.array(robot.arm.table.theta)
    for joint, by in lost.items():
        theta[joint - 1] += by
    return robot.replace(arm=robot.arm.with_table(replace(robot.arm.table, theta=theta)))


@pytest.fixture(scope="module")
def robots():
    return truth("26")


@pytest.mark.parametrize("which", [(), ("base",), ("base", "tool")])
def test_lost_zeros_are_found(robots, which):
    true, other = robots["mon"], robots["wed"]
    moved = true.replace(**({"T_world_base": other.T_world_base} if "base" in which else {}))
    moved = crashed(moved.replace(targets=other.targets) if "tool" in which else moved)
    points = measured(moved, arm().random_joints(8, 5))
    refit = Refit("base" in which, "tool" in which, zeros=(3, 5))
    placed = refit.placed(true, points, "m.csv")
    np.testing.assert_allclose(placed.arm.table.theta, moved.arm.table.theta, rtol=0, atol=1e-10)
    np.testing.assert_allclose(placed.poses(points.q), moved.poses(points.q), rtol=0, atol=1e-9)
    assert "Joint 3 stands +0.4000 ± 0.0000 degrees" in refit.zeros_in_words(true, placed, points)[0]


def test_intervals_hold(robots):
    """Noise of each pose alike for its targets, drawn 200 times: about 95 % of the estimates are within."""
    true, moved = robots["mon"], crashed(robots["mon"])
    points = measured(moved, arm().random_joints(6, 5))
    refit, held = Refit(base=True, zeros=(3, 5)), []
    rng = np.random.default_rng(1)
    for _ in range(200):
        noisy = replace(points, xyz=points.xyz + rng.normal(scale=1e-4, size=(points.poses, 3))[points.pose])
        placed = refit.placed(true, noisy, "m.csv")
        for joint, words in zip((3, 5), refit.zeros_in_words(true, placed, noisy), strict=True):
            value, _, half = words.split("stands ")[1].split()[:3]
            held.append(abs(float(value) - np.degrees(LOST[joint])) < float(half))
    assert 0.92 < np.mean(held) < 0.98


@pytest.mark.parametrize(("which", "joint"), [({"base": True}, 1), ({"base": True, "tool": True}, 6)])
def test_what_base_or_tool_hide_is_refused(robots, which, joint):
    points = measured(robots["mon"], arm().random_joints(8, 5))
    with pytest.raises(MeasurementError, match="the first joint's zero cannot be told from a base placed anew"):
        Refit(**which, zeros=(joint,)).placed(robots["mon"], points, "m.csv")


def test_evaluate_tells_the_zeros_of_a_calibrated_robot(program, robots, tmp_path):
    points = measured(robots["mon"], arm().random_joints(60, 1), NOISE, np.random.default_rng(1))
    irbcal.calibrate(write_measurements(tmp_path / "m.csv", points), "irb1600", "26").save(tmp_path / "cal")
    moved = crashed(robots["mon"].replace(T_world_base=robots["wed"].T_world_base))
    few = measured(moved, arm().random_joints(8, 7), NOISE, np.random.default_rng(2))
    data = write_measurements(tmp_path / "few.csv", few)
    found = program("evaluate", tmp_path / "cal", data, "--refit-base", "--refit-zeros", "3,5", "--json")
    for joint, note in zip((3, 5), found["notes"][:2], strict=True):
        words = note.split()
        assert words[1] == str(joint)
        value, half = float(words[3]), float(words[5])
        assert abs(value - np.degrees(LOST[joint])) < max(1.5 * half, 1e-3)
        assert half < 0.01
    assert found["calibrated"]["mean_mm"] < 0.1
    without = irbcal.evaluate(tmp_path / "cal", data, refit_base=True)
    assert without.calibrated["mean_mm"] > 1.0


@pytest.mark.parametrize("zeros", [(7,), (0,), (3, 3), (2.5,)])
def test_joints_that_are_none_are_refused(robots, tmp_path, zeros):
    points = measured(robots["mon"], arm().random_joints(40, 1), NOISE, np.random.default_rng(1))
    calibration = irbcal.calibrate(write_measurements(tmp_path / "m.csv", points), "irb1600", "26")
    with pytest.raises(OptionError, match="refit_zeros"):
        irbcal.evaluate(calibration, tmp_path / "m.csv", refit_zeros=zeros)
