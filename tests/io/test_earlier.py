"""What an earlier calibration gives back: its points by session, in their order, with plain names."""

import numpy as np
import pytest
from sessions_cases import NOISE, truth
from support import arm, measured, write_measurements

import irbcal
from irbcal.errors import CalibrationError
from irbcal.io.earlier import earlier_of
from irbcal.measurement.points import distances


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """A saved calibration of 40 poses of level 16, and the robot."""
    folder, robot = tmp_path_factory.mktemp("earlier"), truth("16")["mon"]
    points = measured(robot, arm().random_joints(40, 100), NOISE, np.random.default_rng(1))
    irbcal.calibrate(write_measurements(folder / "m.csv", points), "irb1600", "16").save(folder / "my-robot")
    return folder / "my-robot", points


def test_the_order_of_the_poses_and_their_last_moves_are_kept(earlier):
    folder, measured_points = earlier
    ((name, points, motion),) = earlier_of(folder).sessions
    assert name == "my-robot"
    np.testing.assert_array_equal(motion.elapsed, np.arange(40))
    np.testing.assert_array_equal(points.pose_ids.astype(int), np.arange(40))
    np.testing.assert_allclose(motion.q, arm().random_joints(40, 100), rtol=0, atol=1e-10)
    np.testing.assert_allclose(motion.moves[1:], np.diff(motion.q, axis=0), rtol=0, atol=1e-10)
    np.testing.assert_array_equal(motion.moves[0], 0.0)
    assert points.names().tolist() == measured_points.names().tolist()
    np.testing.assert_allclose(points.xyz, measured_points.xyz, rtol=0, atol=1e-9)


def test_a_calibration_with_sessions_gives_them_back(earlier, tmp_path):
    folder, _ = earlier
    robots = truth("16")
    new = measured(robots["wed"], arm().random_joints(15, 7), NOISE, np.random.default_rng(2))
    both = irbcal.calibrate(write_measurements(tmp_path / "wed.csv", new), with_=folder)
    (one, first, _), (two, second, motion) = earlier_of(both).sessions
    assert (one, first.poses, two, second.poses) == ("my-robot", 40, "wed", 15)
    assert first.target_names == second.target_names == ("smr1", "smr2", "smr3")
    np.testing.assert_array_equal(motion.elapsed, np.arange(15))
    # the first stands in the frame of the last now: its own robot, moved
    shape = [
        np.linalg.norm(np.diff(points.xyz[:3], axis=0), axis=1) for points in (first, earlier_of(folder).sessions[0][1])
    ]
    np.testing.assert_allclose(*shape, rtol=0, atol=1e-8)
    assert distances(both.robot_calibrated(), second).mean() < 3 * NOISE


def test_without_points_nothing_can_be_added(earlier):
    record = irbcal.load(earlier[0]).record
    with pytest.raises(CalibrationError, match="has no measured points"):
        earlier_of(record.model_copy(update={"poses": None}))
