"""Points as arrays: predictions against the robot's own, selection, and that nobody can change them."""

import pickle
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest
from history_cases import sided_points, sided_robot
from support import arm, measured, random_robot, random_rotation

from irbcal.errors import RobotError
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.modeling import frames


@pytest.fixture
def robot():
    """A robot with errors, whose second target has an orientation."""
    rng = np.random.default_rng(4)
    return random_robot(arm(), "34", rng).replace(target_rotations={"smr2": random_rotation(rng)})


@pytest.fixture
def points(robot):
    """Points of eight poses, some lost, with orientations and uncertainties of some."""
    q = arm().random_joints(8, 1)
    whole = measured(robot, q, groups=["a"] * 5 + [""] * 3)
    T = (robot.T_world_base @ robot.poses(q))[whole.pose]
    rotation = np.full((len(whole), 3, 3), np.nan)
    turned = whole.target == 1
    rotation[turned] = T[turned, :3, :3] @ robot.target_rotations["smr2"]
    whole = replace(whole, rotation=rotation, u95=np.where(turned, 2e-5, np.nan))
    return whole.take(~np.isin(np.arange(len(whole)), [0, 7, 12, 13, 14]))


def test_predictions_are_those_of_the_robot(robot, points):
    expected = robot.points(points.joints(), points.names())
    assert np.abs(points.predicted(robot) - expected).max() < 1e-14
    assert np.abs(points.xyz - expected).max() < 1e-14
    one = points.predicted(robot.replace(T_world_base=np.eye(4)))
    assert np.abs(frames.apply(robot.T_world_base, one) - expected).max() < 1e-14


def test_rotations_are_predicted_where_the_robot_knows_them(robot, points):
    predicted = points.predicted_rotations(robot)
    known = points.target == 1
    assert np.abs(predicted[known] - points.rotation[known]).max() < 1e-14
    assert np.isnan(predicted[~known]).all()
    turn = frames.from_xyz_angles([0, 0, 0, 0, 0, 0.01])[:3, :3]
    turned = replace(points, rotation=turn @ points.rotation)
    assert np.abs(rotation_distances(robot, turned) - 0.01).max() < 1e-9
    assert len(rotation_distances(robot, turned)) == known.sum()
    assert len(rotation_distances(robot, replace(points, rotation=None))) == 0


def test_distances(robot, points):
    xyz = points.xyz.copy()
    xyz[3] += [3e-3, 0, 4e-3]
    found = distances(robot, replace(points, xyz=xyz))
    assert abs(found[3] - 5e-3) < 1e-12
    assert np.delete(found, 3).max() < 1e-12


def test_a_target_that_was_seen_must_be_known(robot, points):
    rest = {name: place for name, place in robot.targets.items() if name != "smr3"}
    fewer = robot.replace(targets=rest)
    with pytest.raises(RobotError, match="unknown target 'smr3': this robot has smr1, smr2"):
        points.predicted(fewer)
    without = points.take(points.target < 2)
    assert without.target_names == points.target_names, "the name stays"
    assert np.abs(without.predicted(fewer) - without.xyz).max() < 1e-14


def test_points_and_poses_are_chosen(points):
    assert (len(points), points.poses) == (19, 8)
    lean = points.without_empty_poses()
    assert lean.poses == 7
    assert lean.pose_ids.tolist() == [0, 1, 2, 3, 5, 6, 7]
    assert np.array_equal(lean.joints(), points.joints())
    chosen = points.select(points.groups == "a")
    assert set(chosen.groups) == {"a"}
    assert np.array_equal(chosen.xyz, points.xyz[points.pose < 5])
    seen = points.take(points.target == 1).with_seen_targets()
    assert seen.target_names == ("smr2",)
    assert set(seen.target) == {0}


def test_every_array_is_locked(points):
    arrays = [value for field in fields(points) if isinstance(value := getattr(points, field.name), np.ndarray)]
    assert len(arrays) == 8
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[-1]
    with pytest.raises(FrozenInstanceError):
        points.xyz = arrays[0]


def test_the_callers_arrays_are_copied():
    q, xyz = np.zeros((1, 6)), np.ones((1, 3))
    points = PointSet(
        q, np.zeros(1, int), np.zeros(1, int), xyz, ("a",), np.array(["1"], object), np.array([""], object)
    )
    q[:], xyz[:] = 7, 7
    assert points.q.max() == 0
    assert points.xyz.max() == 1


def test_frame_and_words(points):
    frame = points.to_frame()
    assert list(frame.columns) == [
        *("pose", "group", "q1", "q2", "q3", "q4", "q5", "q6", "target", "x_mm", "y_mm", "z_mm"),
        *("u95_mm", "qw", "qx", "qy", "qz"),
    ]
    assert np.abs(frame[["x_mm", "y_mm", "z_mm"]].to_numpy() - 1e3 * points.xyz).max() < 1e-9
    assert frame["qw"].notna().tolist() == points.oriented().tolist()
    assert frame["target"].tolist() == points.names().tolist()
    many = points.target_names * 400
    assert len(repr(replace(points, target_names=many))) < 2000
    assert repr(points).startswith(
        f"<PointSet: 19 points of 8 poses, {points.oriented().sum()} of them with orientation"
    )
    assert points.report()[1].rows == (("a", 5, 10), ("", 3, 9))
    again = pickle.loads(pickle.dumps(points))
    assert np.array_equal(again.xyz, points.xyz)


def test_stops_before_are_predicted_with_and_stay_with_their_poses():
    robot = sided_robot()
    points = sided_points(robot)
    q, before, mine = points.q, points.previous, points.pose
    theta = robot.joint_map.effective(q)
    theta[1:] = robot.joint_map.effective(q[1:], before[1:])
    T = robot.T_world_base @ robot.arm.forward(theta)[mine]
    local = np.array([robot.targets[name] for name in points.names()])
    expected = np.einsum("mij,mj->mi", T[:, :3, :3], local) + T[:, :3, 3]
    assert np.abs(points.predicted(robot) - expected).max() < 1e-14
    assert distances(robot, replace(points, previous=None))[points.pose > 0].mean() > 1e-4
    assert points.known_moves == points.poses - 1
    keep = np.arange(points.poses) % 3 > 0
    part = points.select(keep)
    assert np.array_equal(part.previous, before[keep], equal_nan=True)
    assert distances(robot, part).max() < 1e-14
    assert np.array_equal(part.moves(), np.nan_to_num(q - before)[keep])


def test_distances_prove_the_noise_and_not_the_errors_of_the_robot(robot):
    rng = np.random.default_rng(8)
    q = arm().random_joints(200, 3)
    whole = measured(robot, q + 1e-3 * rng.standard_normal(q.shape), 3e-5, rng)
    few = [whole.take(np.isin(whole.pose, poses)).distance_noise() for poses in np.split(np.arange(200), 20)]
    assert 2.6e-5 < whole.distance_noise() < 3e-5
    assert np.mean(np.array(few) < 3e-5) >= 0.8
    assert measured(robot, q).distance_noise() < 1e-12
    assert whole.take(whole.target == 0).distance_noise() == 0.0
    assert whole.take(whole.pose == 0).distance_noise() == 0.0
