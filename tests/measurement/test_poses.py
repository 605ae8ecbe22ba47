"""Full poses from three points, and frames from three references."""

import numpy as np
import pytest
from support import TARGETS, arm, measured, random_robot

from irbcal.errors import MeasurementError
from irbcal.identification.fit import identify
from irbcal.measurement.points import distances, rotation_distances
from irbcal.measurement.poses import as_poses, in_frame_of
from irbcal.modeling import frames


def test_three_points_become_the_pose_of_the_tool():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(1))
    points = measured(robot, nominal.random_joints(30, 1))
    seen, shape = as_poses(points)
    T = robot.T_world_base @ robot.poses(points.q)
    centre = np.mean(list(TARGETS.values()), axis=0)
    assert np.abs(seen.xyz - (T[:, :3, :3] @ centre + T[:, :3, 3])).max() < 1e-9
    turn = T[:, :3, :3].transpose(0, 2, 1) @ seen.rotation
    assert frames.rotation_distance(turn, turn[0]).max() < 1e-7, "the frame is fixed to the tool"
    fit = identify(nominal, seen, "34")
    check, _ = as_poses(measured(robot, nominal.random_joints(20, 2)), shape=shape)
    assert distances(fit.robot, check).max() < 1e-8
    assert rotation_distances(fit.robot, check).max() < 1e-7


def test_poses_with_fewer_points_go_and_lines_are_refused():
    nominal = arm()
    robot = random_robot(nominal, "11", np.random.default_rng(2))
    points = measured(robot, nominal.random_joints(10, 1))
    keep = np.ones(len(points), dtype=bool)
    keep[[0, 13]] = False
    assert as_poses(points.take(keep))[0].pose_ids.tolist() == [1, 2, 3, 5, 6, 7, 8, 9]
    line = robot.replace(targets={"a": [0, 0, 0.1], "b": [0.1, 0, 0.1], "c": [0.2, 0, 0.1]})
    with pytest.raises(MeasurementError, match="the targets a, b, c lie on a line"):
        as_poses(measured(line, nominal.random_joints(10, 1)))
    two = robot.replace(targets={"a": [0, 0, 0.1], "b": [0.1, 0, 0.1]})
    with pytest.raises(MeasurementError, match="needs three targets on the tool, found a, b"):
        as_poses(measured(two, nominal.random_joints(10, 1)))


def test_frame_of_three_points_by_hand():
    T = frames.from_three_points([1, 1, 0], [3, 1, 0], [2, 5, 0])
    expected = np.eye(4)
    expected[:3, 3] = [2, 1, 0]
    assert np.abs(T - expected).max() < 1e-15
    with pytest.raises(ValueError, match="three points on a line"):
        frames.from_three_points([0, 0, 0], [1, 1, 1], [2, 2, 2])


def test_measuring_frame_from_references():
    nominal = arm()
    robot = random_robot(nominal, "11", np.random.default_rng(3))
    points = measured(robot, nominal.random_joints(10, 1))
    places = {
        "ref1": np.array([2.0, 0.5, -0.5]),
        "ref2": np.array([2.5, 1.0, -0.5]),
        "ref3": np.array([2.0, 1.2, -0.45]),
    }
    moved, references = in_frame_of(points, places, ["ref1", "ref2", "ref3"])
    assert np.abs(references["ref1"][1:]).max() < 1e-12
    assert np.abs(references["ref3"][[0, 2]]).max() < 1e-12
    assert references["ref2"][0] > references["ref1"][0]
    assert references["ref3"][1] > 0
    gaps = [np.linalg.norm(p.xyz[1:] - p.xyz[:-1], axis=1) for p in (points, moved)]
    assert np.abs(gaps[0] - gaps[1]).max() < 1e-12
    with pytest.raises(MeasurementError, match="found ref1, ref2, ref3 but not ref9"):
        in_frame_of(points, places, ["ref1", "ref2", "ref9"])
