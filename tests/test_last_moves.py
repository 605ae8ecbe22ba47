"""Last moves from end to end: held-out errors, and programs corrected in their order; simulated robots."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from history_cases import sided_points, sided_robot
from support import write_measurements

import irbcal
from irbcal.measurement.points import distances

NOISE = 1e-5
JOINTS = [f"q{k}_deg" for k in range(1, 7)]


def run(path, robot, q, seed):
    """Measurements of a program that goes to joints one after the other; a file of them."""
    points = sided_points(robot, len(q), seed, q=q, noise=NOISE)
    return write_measurements(path, points)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A robot with terms of the last move, the folder of its measurements, and its calibration."""
    robot, folder = sided_robot(others=("gain", "gravity"), size=4.0), tmp_path_factory.mktemp("sides")
    fit = run(folder / "fit.csv", robot, robot.arm.random_joints(150, 1), 1)
    rng = np.random.default_rng(5)
    q = 0.8 * robot.arm.random_joints(120, 2)
    q[:, 4] = np.sign(q[:, 4]) * (0.3 + np.abs(q[:, 4]))  # not next to the wrist singularity
    pd.DataFrame(np.degrees(q), columns=JOINTS).to_csv(folder / "job.csv", index=False, float_format="%.9f")
    check = run(folder / "check.csv", robot, q, int(rng.integers(1000)))
    return robot, folder, irbcal.calibrate(fit, "irb120", "auto", verify=check)


def test_corrected_programs_err_as_held_out_poses_do(calibrated):
    robot, folder, calibration = calibrated
    found = irbcal.correct(calibration, folder / "job.csv", out=folder / "corrected.csv", allow_partial=True)
    assert len(found.targets) > 115
    q = np.radians(pd.read_csv(folder / "corrected.csv")[JOINTS].to_numpy())
    after = run(folder / "after.csv", robot, q, 9)
    verified = irbcal.evaluate(calibration, folder / "check.csv", verified=after).verified
    expected, reached = verified["expected"]["mean_mm"], verified["verified"]["mean_mm"]
    assert expected == pytest.approx(calibration.record.heldout.all.mean_mm, rel=0.02)
    assert reached == pytest.approx(expected, rel=0.05)
    assert expected < 0.05
    assert found.expected_errors[0] > 2 * found.expected_errors[1:].mean()  # the first stop is not known

    # without the order of the program nothing like it is reached
    robot_calibrated = calibration.robot_calibrated()
    q_alone = robot_calibrated.joint_map.commanded(robot_calibrated.joint_map.effective(q, np.vstack([q[:1], q[:-1]])))
    alone = run(folder / "alone.csv", robot, q_alone, 9)
    verified = irbcal.evaluate(calibration, folder / "check.csv", verified=alone).verified
    assert verified["verified"]["mean_mm"] > 1.5 * expected


def test_held_out_errors_know_the_last_moves(calibrated):
    _, folder, calibration = calibrated
    robot = calibration.robot_calibrated()
    points, _ = calibration.record.used_points(True)
    assert points.known_moves == points.poses - 1
    mean = 1e3 * distances(robot, points).mean()
    assert calibration.record.heldout.all.mean_mm == pytest.approx(mean, rel=1e-4)
    assert 1e3 * distances(robot, replace(points, previous=None)).mean() > 1.5 * mean
    (note,) = [note for note in calibration.record.notes if "order of the file" in note]
    assert "119 of 120 poses" in note
    found = irbcal.evaluate(calibration, folder / "check.csv")
    assert found.calibrated["mean_mm"] == pytest.approx(mean, rel=1e-4)
    assert any("119 of 120 poses" in note for note in found.notes)


def test_backlash_of_the_virtual_cell_is_taken_off_in_programs(tmp_path):
    only = ["backlash", "noise"]
    poses = irbcal.simulate("irb120", random=130, seed=3, only=only, robot_seed=4)
    job = irbcal.simulate("irb120", random=60, seed=5, only=only, robot_seed=4)
    calibration = irbcal.calibrate(poses.measurements(), "irb120", "auto", verify=job.measurements())
    program = job.to_frame().groupby("pose", sort=False)[JOINTS].first().reset_index(drop=True)
    left = irbcal.correct(calibration, write(tmp_path / "job.csv", program)).unchanged_targets
    program = program.drop(index=[item.line - 2 for item in left]).reset_index(drop=True)
    found = irbcal.correct(calibration, write(tmp_path / "job.csv", program))
    fakes = pd.DataFrame(np.degrees(found.q), columns=JOINTS)
    again = {"seed": 6, "only": only, "robot_seed": 4, "wanted": program, "calibration": calibration}
    missed = irbcal.simulate("irb120", fakes, **again).program_errors
    assert 1e3 * missed.mean() == pytest.approx(calibration.record.heldout.all.mean_mm, rel=0.1)
    # corrected one by one, without the order
    robot = calibration.robot_calibrated()
    alone = robot.joint_map.commanded(robot.joint_map.effective(found.q, np.vstack([found.q[:1], found.q[:-1]])))
    missed_alone = irbcal.simulate("irb120", pd.DataFrame(np.degrees(alone), columns=JOINTS), **again).program_errors
    assert missed_alone.mean() > 3.0 * missed.mean()


def write(path, frame):
    frame.to_csv(path, index=False, float_format="%.9f")
    return path
