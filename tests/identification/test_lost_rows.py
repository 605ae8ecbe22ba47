"""Rows lost or doubled in the middle of a file, and files in which none is."""

import dataclasses

import numpy as np
import pytest
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.identification import data_entry_errors
from irbcal.measurement.points import PointSet

TOOL = {"smr": np.array([0.05, 0.02, 0.1])}


def points(nominal, seed=1, poses=60, targets=None):
    """A simulated robot, measured at random poses."""
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng, targets=targets)
    return robot, measured(robot, 0.7 * nominal.random_joints(poses, seed), 3e-5, rng)


def beside(seen, joints, positions):
    """The joints of some poses, one after the other, beside the positions of others."""
    n, k = min(len(joints), len(positions)), len(seen.target_names)
    xyz = seen.xyz.reshape(seen.poses, k, 3)[positions[:n]].reshape(-1, 3)
    pose, target = np.repeat(np.arange(n), k), np.tile(np.arange(k), n)
    return PointSet(seen.q[joints[:n]], pose, target, xyz, seen.target_names, np.arange(1, n + 1), np.full(n, ""))


def damaged(seen, how, place):
    """The file with a row lost or doubled, and how late positions are behind it."""
    every = np.arange(seen.poses)
    lost, doubled = np.delete(every, place), np.insert(every, place, place - 1)
    cases = {
        "position lost": (every, lost, -1),
        "position doubled": (every, doubled, 1),
        "joints lost": (lost, every, 1),
        "joints doubled": (doubled, every, -1),
    }
    joints, positions, late = cases[how]
    return beside(seen, joints, positions), late


def with_gross_errors(seen, share, seed=0):
    rng = np.random.default_rng(seed)
    xyz = seen.xyz.copy()
    wrong = rng.random(len(xyz)) < share
    xyz[wrong] += rng.uniform(-0.5, 0.5, (wrong.sum(), 3))
    return dataclasses.replace(seen, xyz=xyz)


@pytest.mark.parametrize("how", ["position lost", "position doubled", "joints lost", "joints doubled"])
@pytest.mark.parametrize("place", [5, 20, 30, 45, 54])
def test_the_place_is_found_anywhere(how, place):
    nominal = arm()
    robot, seen = points(nominal, targets=TOOL if place % 2 else None)
    wrong, late = damaged(seen, how, place)
    for found in (data_entry_errors.find_lost_row(nominal, wrong), data_entry_errors.lost_row_of_robot(robot, wrong)):
        assert found is not None
        assert found.late == late
        assert abs(int(found.pose) - 1 - place) <= 1  # of a row that has no partner nobody knows the side
        assert found.before > 8 * found.after


def test_it_is_found_among_gross_errors():
    nominal = arm()
    wrong, late = damaged(points(nominal)[1], "position lost", 25)
    found = data_entry_errors.find_lost_row(nominal, with_gross_errors(wrong, 0.1))
    assert found is not None
    assert (found.late, abs(int(found.pose) - 26) <= 1) == (late, True)


@pytest.mark.parametrize("seed", range(8))
def test_nothing_is_named_where_there_is_nothing(seed):
    nominal = arm(("irb1600", "irb120", "ur10", "panda")[seed % 4])
    robot, seen = points(nominal, seed, poses=(25, 60, 90)[seed % 3], targets=TOOL if seed % 2 else None)
    for share in (0.0, 0.1, 0.3):
        wrong = with_gross_errors(seen, share, seed)
        assert data_entry_errors.find_lost_row(nominal, wrong) is None
        assert data_entry_errors.lost_row_of_robot(robot, wrong) is None
    noise = np.random.default_rng(seed).normal(size=seen.xyz.shape)
    assert data_entry_errors.find_lost_row(nominal, dataclasses.replace(seen, xyz=noise)) is None


def test_small_steps_between_poses():
    """Neighbours are then nearly as near as the row's own partner."""
    nominal = arm()
    rng = np.random.default_rng(3)
    ends = 0.5 * nominal.random_joints(2, 3)
    q = ends[0] + np.linspace(0, 1, 80)[:, None] * 0.1 * (ends[1] - ends[0])
    q += 0.05 * np.sin(np.arange(80)[:, None] * np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29]))
    robot = random_robot(nominal, "placement", rng)
    seen = measured(robot, q, 3e-5, rng)
    assert data_entry_errors.find_lost_row(nominal, seen) is None
    found = data_entry_errors.find_lost_row(nominal, damaged(seen, "position lost", 40)[0])
    assert found is None or found.pose == "41"


def test_too_few_poses_name_nothing():
    nominal = arm()
    assert (
        data_entry_errors.find_lost_row(nominal, damaged(points(nominal, poses=20)[1], "position lost", 10)[0]) is None
    )


def test_the_row_is_told_by_calibrate_and_evaluate(tmp_path):
    nominal = arm()
    _, seen = points(nominal, poses=80, targets=TOOL)
    good = write_measurements(tmp_path / "good.csv", beside(seen, np.arange(80), np.arange(80)))
    middle = write_measurements(tmp_path / "middle.csv", damaged(seen, "position lost", 40)[0])
    begin = write_measurements(tmp_path / "begin.csv", damaged(seen, "position lost", 20)[0])
    end = write_measurements(tmp_path / "end.csv", damaged(seen, "joints lost", 70)[0])
    words = (
        "from pose 41 on the points are one pose early: a position is missing or a row of joints is doubled at about "
    )
    with pytest.raises(irbcal.MeasurementError) as caught:
        irbcal.calibrate(middle, "irb1600")
    assert words + "row 42 of middle.csv" in str(caught.value)
    # where the rest is enough for a calibration it is a note
    made = irbcal.calibrate(end, "irb1600")
    assert any("the points are one pose late" in note and "of end.csv" in note for note in made.proven.notes)
    calibration = irbcal.calibrate(good, "irb1600")
    assert not any("one pose" in note for note in calibration.proven.notes)
    calibration.save(tmp_path / "cal")
    with pytest.raises(irbcal.MeasurementError, match="from pose 21 on the points are one pose early"):
        irbcal.evaluate(tmp_path / "cal", begin, include_fitted=True)
    found = irbcal.evaluate(tmp_path / "cal", end, include_fitted=True)
    assert any("one pose late" in note for note in found.notes)
