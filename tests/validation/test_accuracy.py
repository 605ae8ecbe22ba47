"""Statistics and errors against numbers worked out by hand and motions put in."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from scipy import stats
from simulated_fit import predicted_covariance
from support import arm, measured, random_robot, random_rotation, validated_of
from thesis_formula import ThesisMap, apply

import irbcal
from irbcal.error_statistics import rotation_statistics, statistics, statistics_by
from irbcal.errors import MeasurementError
from irbcal.io import robots
from irbcal.measurement.points import distances
from irbcal.modeling import frames
from irbcal.modeling.parameters import all_names, parameter
from irbcal.units import UNIT_OUTSIDE
from irbcal.validation import accuracy
from irbcal.validation.accuracy import coverage, coverage_in_words, percentiles


def test_statistics_by_hand():
    found = statistics(np.array([1.0, 2.0, 6.0]) * 1e-3)
    assert found["n"] == 3
    assert found["mean_mm"] == pytest.approx(3.0)
    assert found["sigma_mm"] == pytest.approx(np.sqrt((4 + 1 + 9) / 2))
    assert found["max_mm"] == pytest.approx(6.0)
    assert found["mean_plus_3sigma_mm"] == pytest.approx(3 + 3 * np.sqrt(7))
    assert found["rms_mm"] == pytest.approx(np.sqrt(41 / 3))


def test_no_points_have_no_statistics():
    assert statistics([]) is None


def test_statistics_by_label():
    found = statistics_by(np.array([1e-3, 3e-3, 5e-3]), ["b", "a", "b"])
    assert list(found) == ["a", "b"]
    assert found["b"]["mean_mm"] == pytest.approx(3.0)


def test_distances_are_those_of_shifted_points():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(0))
    points = measured(robot, nominal.random_joints(10, 0))
    xyz = points.xyz.copy()
    xyz[4] += [3e-3, 0, 4e-3]
    points = replace(points, xyz=xyz)
    distance = distances(robot, points)
    assert distance[4] == pytest.approx(5e-3, abs=1e-12)
    assert np.delete(distance, 4).max() < 1e-13


def test_percentiles_and_what_the_largest_covers():
    found = accuracy.percentiles(np.arange(101) * 1e-3)
    assert found == pytest.approx({"p50_mm": 50.0, "p90_mm": 90.0, "p95_mm": 95.0, "p99_mm": 99.0})
    assert accuracy.percentiles([]) is None
    # with 59 poses one may be 95 % sure that 95 % of all lie below the largest: the textbook's sample size
    assert accuracy.largest_covers(59) > 0.95 > accuracy.largest_covers(58)
    assert accuracy.largest_covers(2, confidence=0.75) == pytest.approx(0.5)


def three_target_points(n=40):
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(1))
    return robot, measured(robot, nominal.random_joints(n, 3))


def test_tip_errors_are_those_of_moved_tips():
    """Tips moved by 1 mm and turned by 0.1 degrees about themselves: the lever to the targets does not count."""
    robot, points = three_target_points()
    T = robot.T_world_base @ robot.poses(points.q)
    angle = np.radians(0.1)
    T[:, :3, :3] = frames.rot_z(angle) @ T[:, :3, :3]
    T[:, :3, 3] += [0.6e-3, 0.0, -0.8e-3]
    local = np.array([robot.targets[name] for name in points.target_names])[points.target]
    xyz = np.einsum("mij,mj->mi", T[points.pose, :3, :3], local) + T[points.pose, :3, 3]
    moved = replace(points, xyz=xyz)
    found = accuracy.tip_errors(robot, moved)
    assert np.abs(found.position - 1e-3).max() < 1e-12
    assert np.abs(found.rotation - angle).max() < 1e-10
    assert np.abs(distances(robot, moved) - 1e-3).max() > 1e-4, "the targets themselves feel the lever"


def test_tip_errors_of_measured_frames_equal_those_of_points():
    robot, points = three_target_points()
    R_tip_target = random_rotation(np.random.default_rng(5))
    robot = robot.replace(target_rotations={"smr2": R_tip_target})
    T = robot.T_world_base @ robot.poses(points.q)
    xyz = points.xyz + np.array([0.0, 2e-3, 0.0])
    rotation = np.full((len(points), 3, 3), np.nan)
    mine = points.names() == "smr2"
    turn = frames.rot_x(1e-3)
    rotation[mine] = turn @ T[points.pose[mine], :3, :3] @ R_tip_target
    found = accuracy.tip_errors(robot, replace(points, xyz=xyz, rotation=rotation))
    assert np.abs(found.rotation - 1e-3).max() < 1e-10
    # the tip lies -R p from the target: turning about x moves it in the plane across
    lever = -(T[:, :3, :3] @ robot.targets["smr2"])
    expected = np.linalg.norm(lever @ turn.T - lever + [0.0, 2e-3, 0.0], axis=1)
    assert np.abs(found.position - expected).max() < 1e-12


def test_two_targets_make_no_pose():
    robot, points = three_target_points(5)
    with pytest.raises(MeasurementError, match="three targets"):
        accuracy.tip_errors(robot, points.take(points.target < 2).with_seen_targets())


def test_virtual_frame_takes_a_common_shift_off():
    robot, points = three_target_points()
    rest = 1e-4 * np.random.default_rng(2).standard_normal(points.xyz.shape)
    shift_base = np.array([18e-6, -117e-6, 20e-6])
    xyz = points.xyz + robot.T_world_base[:3, :3] @ shift_base + rest
    distance, shift = accuracy.relative_to_virtual_frame(robot, replace(points, xyz=xyz))
    expected = shift_base + robot.T_world_base[:3, :3].T @ rest.mean(axis=0)
    assert np.abs(shift - expected).max() < 1e-12
    assert np.abs(distance - np.linalg.norm(rest - rest.mean(axis=0), axis=1)).max() < 1e-12


def test_three_points_take_any_rigid_motion_off_and_pass_their_errors_on():
    robot, points = three_target_points()
    T = frames.transform(frames.rotation_from_vector([1e-3, -2e-3, 1e-3]), [3e-3, 1e-3, -2e-3])
    moved = replace(points, xyz=frames.apply(T, points.xyz))
    distance, rows = accuracy.relative_to_three_points(robot, moved)
    assert len(distance) == len(points) - 3
    assert distance.max() < 1e-10
    xyz = moved.xyz.copy()
    xyz[rows[0]] += 1e-3
    spoiled, again = accuracy.relative_to_three_points(robot, replace(moved, xyz=xyz), rows)
    assert (again == rows).all()
    assert 1e-4 < np.median(spoiled) < 5e-3
    with pytest.raises(MeasurementError, match="on a line"):
        accuracy.relative_to_three_points(robot, moved, [0, 0, 1])


def test_sphere_is_one_of_the_base():
    robot, points = three_target_points()
    base = frames.apply(frames.inverse(robot.T_world_base), points.xyz)
    inside = accuracy.within_sphere(robot, points, base[7], 0.4)
    assert inside[7]
    assert (inside == (np.linalg.norm(base - base[7], axis=1) <= 0.2)).all()


def test_sphere_holds_its_surface():
    robot, points = three_target_points(4)
    robot = robot.replace(T_world_base=np.eye(4))
    places = np.array([[2.0, 0, 0], [2.25, 0, 0], [2.25 + 1e-9, 0, 0], [1.75, 0, 0]])
    some = replace(points.take(np.arange(len(points)) < 4), xyz=places)
    assert accuracy.within_sphere(robot, some, [2.0, 0, 0], 0.5).tolist() == [True, True, False, True]


def test_widest_triangle_by_hand():
    """The middle is at (3, 7/6, 0): farthest from it is (0, 9, 0), from there (8, -3, 0), from their line (0, -3, 0)."""
    xyz = np.array([[0, 9, 0], [4, 1, 0], [0, -3, 0], [3, 1, 0], [8, -3, 0], [3, 2, 0.0]])
    assert xyz.mean(axis=0) == pytest.approx([3, 7 / 6, 0])
    assert accuracy.widest_triangle(xyz).tolist() == [0, 4, 2]
    # no place of the measuring frame is special
    assert accuracy.widest_triangle(xyz - [20, 5, 7]).tolist() == [0, 4, 2]
    assert accuracy.widest_triangle(np.flipud(xyz) + np.array([3, -50, 7])).tolist() == [5, 1, 3]


def test_a_frame_of_three_points_needs_a_fourth_to_judge():
    robot, points = three_target_points(2)
    distance, rows = accuracy.relative_to_three_points(robot, points.take(np.arange(6) < 4))
    assert (len(distance), len(set(rows))) == (1, 3)
    with pytest.raises(MeasurementError, match="nothing to compare of 3 points"):
        accuracy.relative_to_three_points(robot, points.take(np.arange(6) < 3))


def test_errors_in_a_frame_of_three_points_by_hand():
    """Points of a plane; the first is off along the x axis that it makes, so that the origin stays where it was."""
    robot, points = three_target_points(2)
    xyz = points.xyz.copy()
    xyz[5] += [0.0, 3e-3, 4e-3]
    moved = replace(points, xyz=xyz)
    distance, _ = accuracy.relative_to_three_points(robot, moved, [0, 1, 2])
    assert distance == pytest.approx([0, 0, 5e-3], abs=1e-12)


def test_the_first_measured_frame_of_a_pose_counts():
    robot, points = three_target_points(6)
    R = {name: random_rotation(np.random.default_rng(k)) for k, name in enumerate(("smr1", "smr3"))}
    robot = robot.replace(target_rotations=R)
    T = robot.T_world_base @ robot.poses(points.q)
    rotation = np.full((len(points), 3, 3), np.nan)
    xyz = points.xyz.copy()
    for name in R:
        mine = points.names() == name
        rotation[mine] = T[points.pose[mine], :3, :3] @ R[name]
    xyz[points.names() == "smr1"] += [1e-3, 0, 0]
    xyz[points.names() == "smr3"] += [7e-3, 0, 0]
    rotation[points.pose == 4] = np.nan  # a pose without orientations has no tip then
    rotation[(points.pose == 2) & (points.names() == "smr1")] = np.nan  # and here the second is the first
    found = accuracy.tip_errors(robot, replace(points, xyz=xyz, rotation=rotation))
    assert found.pose.tolist() == [0, 1, 2, 3, 5]
    assert found.T_world_tip.shape == (5, 4, 4)
    assert found.position == pytest.approx([1e-3, 1e-3, 7e-3, 1e-3, 1e-3], abs=1e-12)
    assert found.rotation.max() < 1e-7


def test_tips_of_the_poses_that_saw_three_targets():
    robot, points = three_target_points(6)
    some = points.take(~((points.pose == 1) & (points.target == 0)))
    found = accuracy.tip_errors(robot, some)
    assert found.pose.tolist() == [0, 2, 3, 4, 5]
    assert found.position.max() < 1e-12
    with pytest.raises(ValueError, match="read-only"):
        found.T_world_tip[0] = 0.0
    with pytest.raises(FrozenInstanceError):
        found.pose = found.pose[:1]


def test_error_vectors_point_from_predicted_to_measured():
    robot, points = three_target_points(3)
    off = np.arange(27.0).reshape(9, 3) * 1e-3
    assert np.abs(accuracy.error_vectors(robot, replace(points, xyz=points.xyz + off)) - off).max() < 1e-12


def test_two_targets_are_refused_by_name():
    robot, points = three_target_points(5)
    with pytest.raises(
        MeasurementError, match=r"tool.csv: position and orientation .* targets are smr1, smr2$"
    ) as refused:
        accuracy.tip_errors(robot, points.take(points.target < 2).with_seen_targets(), "tool.csv")
    assert refused.value.file == "tool.csv"
    apart = points.take((points.target < 2) | (points.pose % 2 == 5))
    with pytest.raises(MeasurementError, match="three targets in a pose"):
        accuracy.tip_errors(robot, apart)


def test_flange_poses_of_a_real_robot_are_those_of_scipy(shared_data):
    """IRB 120, three reflectors: tips by scipy's align_vectors, pose by pose; the flange's errors are below the points'."""
    from scipy.spatial.transform import Rotation

    validated = validated_of(
        shared_data / "irb120_laser_tracker" / "measurements.csv", "irb120", "34", holdout=296, split="last"
    )
    robot, points = validated.fit.robot, validated.heldout_points
    found = accuracy.tip_errors(robot, points)
    assert len(found.pose) == 296
    local = np.array([robot.targets[name] for name in points.target_names])
    for k, pose in list(enumerate(found.pose))[::20]:
        mine = points.pose == pose
        places, on_tool = points.xyz[mine], local[points.target[mine]]
        R = Rotation.align_vectors(places - places.mean(axis=0), on_tool - on_tool.mean(axis=0))[0].as_matrix()
        assert np.abs(found.T_world_tip[k, :3, :3] - R).max() < 1e-8
        assert np.abs(found.T_world_tip[k, :3, 3] - (places.mean(axis=0) - R @ on_tool.mean(axis=0))).max() < 1e-9
    flange, at_points = statistics(found.position), statistics(distances(robot, points))
    assert 0.35 < flange["mean_mm"] < at_points["mean_mm"] < 0.45
    assert 0.05 < rotation_statistics(found.rotation)["mean_deg"] < 0.1


@pytest.fixture(scope="module")
def points(record):
    robot = record.robot_calibrated()
    low, high = np.array(robot.certainty.limits.ranges)
    q = low + (high - low) * np.random.default_rng(1).uniform(0.02, 0.98, (40, 6))
    return measured(robot, q, 2e-5, np.random.default_rng(3))


def test_coordinates_are_counted(record, points):
    robot = record.robot_calibrated()
    found = coverage(robot, points)
    assert found["expected"] == 0.95
    inside = 0
    for k, name in enumerate(points.target_names):
        mine = points.target == k
        seen = robot.predict(points.q[points.pose[mine]], target=name)
        each = np.abs(points.xyz[mine] - seen.position) < seen.interval
        assert found["targets"][name]["inside"] == pytest.approx(each.mean())
        inside += each.sum()
    assert found["parts"]["all"] == {**found["parts"]["all"], "n": 360, "inside": inside / 360}
    assert "outside" not in found["parts"]


def test_names_of_targets_are_no_parts(record, points):
    """A reflector may be called as one of the parts is."""
    robot = record.robot_calibrated()
    names = ("all", "outside", "within")
    renamed = robot.replace(targets=dict(zip(names, robot.targets.values(), strict=True)))
    found = coverage(renamed, replace(points, target_names=names))
    assert {name: row["n"] for name, row in found["parts"].items()} == {"all": 360, "within": 360}
    assert {name: row["n"] for name, row in found["targets"].items()} == dict.fromkeys(names, 120)


def test_poses_outside_are_counted_apart(record, points):
    robot = record.robot_calibrated()
    q = points.q.copy()
    q[:4, 1] = robot.certainty.limits.ranges[1][1] + 0.05
    xyz = points.predicted(robot)
    moved = replace(points, q=q, xyz=xyz)  # far from where these joints lead
    parts = coverage(robot, moved)["parts"]
    assert (parts["outside"]["n"], parts["within"]["n"]) == (36, 324)
    assert parts["outside"]["inside"] < 0.5
    assert parts["within"]["inside"] == 1.0
    assert coverage_in_words(coverage(robot, moved)).endswith("% outside.")


def test_without_certainty_there_is_none(record, points):
    assert coverage(record.robot_nominal(), points) is None


def test_evaluate_says_whether_intervals_hold(record):
    found = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"))
    share = found.coverage["parts"]["all"]["inside"]
    assert 0.88 < share <= 1.0
    assert f"{share:.1%} of " in found.summary()
    assert found.to_dict()["coverage"]["expected"] == 0.95
    table = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"), intervals=True).summary()
    assert "Coordinates within the predicted 95 % intervals" in table


def test_lengths_of_moves_are_counted_where_the_base_was_placed_anew(record, points):
    robot = record.robot_calibrated()
    away = robot.replace(T_world_base=frames.from_xyz_angles([3.0, -2.0, 1.0, 0.3, 0.2, -2.0]))
    found = coverage(away, points, moves=True)
    assert found["parts"]["all"]["n"] == 3 * 39
    length, width = robot.predict_moves(points.q, target=points.target_names[0])
    xyz = points.xyz[points.target == 0]
    inside = np.abs(np.linalg.norm(np.diff(xyz, axis=0), axis=1) - length) < width
    assert found["targets"][points.target_names[0]]["inside"] == pytest.approx(inside.mean())
    assert found["parts"]["all"]["inside"] > 0.9
    evaluated = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"), refit_base=True)
    share = evaluated.coverage["parts"]["all"]
    assert 0.88 < share["inside"] <= 1.0
    assert f"{share['inside']:.1%} of {share['n']} measured lengths of moves" in evaluated.summary()


def test_tips_spread_as_the_parameters_do(record):
    """Parameters drawn from the covariance: the tips of the robots that they make, in the base link."""
    robot, nominal = record.robot_calibrated(), record.arm(calibrated=False)
    factor = dict(UNIT_OUTSIDE.values())
    rows = [row for row in record.parameters if row.name in all_names(nominal)]
    chosen = [parameter(row.name) for row in rows]
    values = np.array([row.value * factor[row.unit] for row in rows])
    C = record.covariance_matrix()[-len(rows) :, -len(rows) :]
    draws = np.random.default_rng(0).multivariate_normal(values, C, 600, method="eigh")
    q = nominal.random_joints(4, 0)
    tips = []
    for errors in draws:
        table, joint_map = apply(chosen, errors, nominal.table, ThesisMap.from_joint_map(robot.joint_map))
        tips.append(
            robot.replace(arm=nominal.with_table(table), joint_map=joint_map.joint_map(nominal)).poses(q)[:, :3, 3]
        )
    found = record.robot_calibrated().position_std(q)
    assert found.shape == (4, 3)
    assert found == pytest.approx(np.std(tips, axis=0), rel=0.1)
    assert (found > 1e-7).all()


def test_a_target_is_surer_than_the_tip_where_it_was_measured(record):
    """In the measuring frame, base and target errors belong to it; the fitted points themselves are known best."""
    q = np.radians([[0.0, -14, 14, 0, 10, 0]])
    at_target = record.robot_calibrated().position_std(q, "smr1")
    assert at_target.shape == (1, 3)
    assert 1e-6 < at_target.min() < at_target.max() < 1e-4
    assert not np.allclose(at_target, record.robot_calibrated().position_std(q), rtol=1e-3, atol=0.0)


def test_uncertainty_of_a_saved_calibration_is_that_of_its_fit(validated, folder):
    loaded = irbcal.load(folder)
    q = validated.urdf.arm.random_joints(20, 6)
    expected = np.sqrt(np.einsum("nii->ni", predicted_covariance(validated.fit, q, "smr2")))
    assert np.abs(loaded.robot_calibrated().position_std(q, "smr2") / expected - 1).max() < 1e-6
    tip = loaded.robot_calibrated().position_std(q)
    assert tip.shape == (20, 3)
    assert 0 < tip.min() < tip.max() < 1e-3


def errors_by_pose(rng, poses=30, spread=0.3):
    """Distances (m) of one to three points of each pose, alike within a pose."""
    pose = np.repeat(np.arange(poses), rng.integers(1, 4, poses))
    level = rng.gamma(4, 1e-4, poses)
    return level[pose] * (1 + spread * rng.random(len(pose))), pose


def test_every_resample_is_recomputed_by_numpy():
    """The ends of the percentile intervals are those of resamples drawn point by point and given to numpy."""
    distance, pose = errors_by_pose(np.random.default_rng(0))
    found = accuracy.intervals(distance, pose, resamples=50, seed=3)
    counts = np.concatenate(list(accuracy.draws(30, 50, 3)))
    assert (counts.sum(axis=1) == 30).all()
    resamples = [np.repeat(distance, count[pose]) for count in counts]
    for key in ("p50_mm", "p90_mm", "p95_mm", "p99_mm"):
        values = [percentiles(sample)[key] for sample in resamples]
        assert found[key] == pytest.approx(np.percentile(values, [2.5, 97.5]), abs=1e-12)
    for key in accuracy.MOMENTS:
        values = np.array([statistics(sample)[key] for sample in resamples])
        jackknife = np.array([statistics(distance[pose != k])[key] for k in range(30)])
        expected = accuracy.bca(values, statistics(distance)[key], jackknife)
        assert found[key] == pytest.approx(expected, abs=1e-11)


def test_bca_is_that_of_scipy():
    values = np.random.default_rng(1).gamma(2, 1.0, 40)
    reference = stats.bootstrap(
        (values,), np.mean, n_resamples=20000, method="BCa", rng=np.random.default_rng(2)
    ).confidence_interval
    found = accuracy.difference(values, resamples=20000, seed=4)
    assert found == pytest.approx([reference.low, reference.high], abs=0.02), "both are random to about 0.01"


def test_same_seed_same_interval_whatever_the_block():
    distance, pose = errors_by_pose(np.random.default_rng(5))
    first = accuracy.intervals(distance, pose, resamples=200, seed=1)
    assert first == accuracy.intervals(distance, pose, resamples=200, seed=1)
    assert first != accuracy.intervals(distance, pose, resamples=200, seed=2)


def test_blocks_do_not_change_the_draws(monkeypatch):
    whole = np.concatenate(list(accuracy.draws(20, 30, 7)))
    monkeypatch.setattr(accuracy, "BLOCK", 45)
    parts = list(accuracy.draws(20, 30, 7))
    assert len(parts) == 15
    assert (np.concatenate(parts) == whole).all()


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Three points of a pose share its error: drawing points instead of poses would hold the mean in 75 % only."""
    rng = np.random.default_rng(8)
    truth = 4e-4 * 1e3
    held = []
    for _ in range(150):
        level = rng.gamma(4, 1e-4, 40)
        low, high = accuracy.intervals(np.repeat(level, 3), np.repeat(np.arange(40), 3), 300, 0)["mean_mm"]
        held.append(low <= truth <= high)
    assert 0.88 <= np.mean(held) <= 0.99


def test_too_few_poses_have_no_interval():
    assert accuracy.intervals(np.ones(27) * 1e-3, np.repeat(np.arange(9), 3)) is None
    assert accuracy.difference(np.ones(9)) is None


def test_equal_errors_have_an_interval_without_width():
    found = accuracy.intervals(np.full(20, 1e-3), np.arange(20), 50)
    assert found["mean_mm"] == pytest.approx([1.0, 1.0])
    assert found["sigma_mm"] == pytest.approx([0.0, 0.0])


def test_a_part_of_many_poses_tells_the_interval_of_all(monkeypatch):
    rng = np.random.default_rng(3)
    pose = np.repeat(np.arange(3000), 3)
    d = np.abs(rng.normal(1e-4, 3e-5, len(pose)) + rng.normal(0, 2e-5, 3000)[pose])
    monkeypatch.setattr(accuracy, "MOST_DRAWN", 10**6)
    whole, change = accuracy.intervals(d, pose, 1000), accuracy.difference(d[::3], 1000)
    monkeypatch.setattr(accuracy, "MOST_DRAWN", 500)
    part, some = accuracy.intervals(d, pose, 1000), accuracy.difference(d[::3], 1000)
    for name in ("mean_mm", "sigma_mm", "rms_mm", "p95_mm"):
        width = whole[name][1] - whole[name][0]
        assert np.abs(np.subtract(part[name], whole[name])).max() < 0.35 * width
    assert np.abs(np.subtract(some, change)).max() < 0.35 * (change[1] - change[0])
