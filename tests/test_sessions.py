"""Sessions from the file to the saved calibration, new poses added to an earlier one; the real UR10."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sessions_cases import NOISE, parts, truth
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal import sessions
from irbcal.errors import CalibrationError, MeasurementError, OptionError
from irbcal.measurement import table
from irbcal.measurement.points import distances
from irbcal.modeling import frames
from irbcal.sessions import earlier_of

COUNTS = {"mon": 60, "wed": 40}


def file_of(folder, counts=COUNTS, column="session", **options):
    """One file of several sessions, poses numbered through; returns its path and the robots."""
    sets, robots = parts(counts, **options)
    tables, start = [], 0
    for name, points in sets:
        numbered = replace(points, pose_ids=points.pose_ids + start)
        start += points.poses
        tables.append(pd.read_csv(write_measurements(folder / f"{name}.csv", numbered)).assign(**{column: name}))
    path = folder / f"{column}.csv"
    pd.concat(tables).to_csv(path, index=False)
    return path, robots


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path, robots = file_of(tmp_path_factory.mktemp("sessions"))
    return irbcal.calibrate(path, "irb1600", "34"), robots


def test_a_session_column_is_enough(made, tmp_path):
    calibration, robots = made
    record = calibration.record
    assert [item.name for item in record.sessions] == ["mon", "wed"]
    assert set(record.placement.targets_mm) == {f"smr{k}{s}" for k in (1, 2, 3) for s in ("", "@mon")}
    assert any(note.startswith("Sessions mon (60 poses), wed (40 poses) share one robot") for note in record.notes)
    assert record.heldout.all.mean_mm < 4e3 * NOISE
    other = measured(robots["wed"], arm().random_joints(50, 9))
    assert distances(calibration.robot_calibrated(), other).max() < 20 * NOISE
    for item in record.sessions:
        T = robots[item.name].T_world_base[:3, 3]
        base = 1e-3 * np.array([item.base.x_mm, item.base.y_mm, item.base.z_mm])
        np.testing.assert_allclose(base, T, rtol=0, atol=2e-3)  # as far as base and link errors can be told apart
    calibration.save(tmp_path / "links", target_links=True)
    assert b"smr1@mon" not in (tmp_path / "links" / "calibrated.urdf").read_bytes()
    calibration.save(tmp_path)
    loaded = irbcal.load(tmp_path)
    assert loaded.record.model_copy(update={"seal": None}) == record
    # saved points are all in the frame of the last session
    for heldout, errors in ((False, record.fit), (True, record.heldout)):
        points, _ = loaded.record.used_points(heldout)
        assert 1e3 * distances(loaded.robot_calibrated(), points).mean() == pytest.approx(errors.all.mean_mm, abs=1e-5)


def test_one_session_is_what_it_was(tmp_path):
    path, _ = file_of(tmp_path, {"mon": 40})
    frame = pd.read_csv(path)
    one = irbcal.calibrate(frame, "irb1600", "26").record
    two = irbcal.calibrate(frame.drop(columns="session"), "irb1600", "26").record
    assert one.sessions == []
    assert one.joint_origins == two.joint_origins
    assert one.placement == two.placement


def test_groups_that_differ_by_far_are_taken_as_sessions(tmp_path):
    path, _ = file_of(tmp_path, column="group")
    found = irbcal.calibrate(path, "irb1600", "26")
    notes = " ".join(found.record.notes)
    assert "the groups were taken as sessions, as --session-by group says" in notes
    named = irbcal.calibrate(path, "irb1600", "26", session_by="group")
    assert named.record.joint_origins == found.record.joint_origins
    assert "were taken as sessions" not in " ".join(named.record.notes)
    one = irbcal.calibrate(path, "irb1600", "26", session_by="none").record
    assert one.sessions == []
    assert len(one.excluded) == 3 * 40  # the smaller group is all outliers


@pytest.mark.parametrize("column", ["group", "day"])
def test_groups_of_one_base_and_tool_stay_one(tmp_path, column):
    robot = truth()["mon"]
    points = measured(robot, arm().random_joints(60, 1), NOISE, np.random.default_rng(1))
    frame = pd.read_csv(write_measurements(tmp_path / "m.csv", points))
    frame["group"] = np.where(frame["pose"] < 30, "near", "far")
    seen = table.read(frame)
    assert sessions.differing_groups(seen, arm()) is None
    assert irbcal.calibrate(frame, "irb1600", "11").record.sessions == []


def test_a_tool_moved_by_millimetres_is_noticed(tmp_path):
    robot = truth("11", size=0.05)["mon"]
    shifted = robot.replace(targets={name: np.add(place, [0.0025, 0, 0.002]) for name, place in robot.targets.items()})
    q = arm().random_joints(60, 1)
    one, two = (
        measured(robot, q, NOISE, np.random.default_rng(1)),
        measured(shifted, q, NOISE, np.random.default_rng(2)),
    )
    late = (np.arange(60) >= 30)[one.pose]
    frame = pd.read_csv(
        write_measurements(tmp_path / "m.csv", replace(one, xyz=np.where(late[:, None], two.xyz, one.xyz)))
    )
    frame["group"] = np.where(frame["pose"] < 30, "a", "b")
    _, together, apart = sessions.differing_groups(table.read(frame), arm())
    assert 5e-3 > together > 3 * apart
    record = irbcal.calibrate(frame, "irb1600", "11").record
    assert record.sessions == []
    assert any("if base or tool were moved between the groups, add --session-by group" in note for note in record.notes)


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """A saved calibration of 90 poses, and the robots."""
    folder = tmp_path_factory.mktemp("earlier")
    path, robots = file_of(folder, {"mon": 90})
    irbcal.calibrate(pd.read_csv(path).drop(columns="session"), "irb1600", "34").save(folder / "my-robot")
    return folder / "my-robot", robots


def new_file(robots, path, poses=12, seed=31):
    points = measured(robots["wed"], arm().random_joints(poses, seed), NOISE, np.random.default_rng(seed))
    return write_measurements(path, points)


def test_few_new_poses_join_an_earlier_calibration(earlier, tmp_path, program):
    folder, robots = earlier
    new = new_file(robots, tmp_path / "new.csv")
    program("calibrate", new, "--with", folder, "--out", tmp_path / "both", "--holdout", "4")
    found, old = irbcal.load(tmp_path / "both"), irbcal.load(folder).record
    record = found.record
    assert record.model == "34"
    assert record.earlier == old.fingerprint != record.fingerprint
    assert [item.name for item in record.sessions] == ["my-robot", "new"]
    assert {item.sha256 for item in record.data} > {item.sha256 for item in old.data}
    assert (record.poses_fit, record.poses_heldout) == (90 + 8, 4)
    assert set(np.array(record.points.target)[record.points.heldout]) == {"smr1", "smr2", "smr3"}
    other = measured(robots["wed"], arm().random_joints(200, 5))
    alone = irbcal.calibrate(new, "irb1600", "34", holdout=4)
    errors = [distances(item.robot_calibrated(), other).mean() for item in (found, alone)]
    assert errors[0] < 0.6 * errors[1]
    # no fifth of the poses is a whole session, whose base nothing else would tell
    known = record.certainty
    assert all(known.leave_fifths_out_mm[k] < 1.5 * known.leave_one_out_mm[k] for k in known.leave_one_out_mm)


def test_a_third_session_keeps_the_first_two(earlier, tmp_path):
    folder, robots = earlier
    irbcal.calibrate(new_file(robots, tmp_path / "new.csv"), with_=folder).save(tmp_path / "two")
    points = measured(robots["tue"], arm().random_joints(12, 8), NOISE, np.random.default_rng(8))
    third = irbcal.calibrate(write_measurements(tmp_path / "new.v2.csv", points), with_=tmp_path / "two")
    assert [item.name for item in third.record.sessions] == ["my-robot", "new", "new.v2"]
    assert third.record.heldout.all.mean_mm < 5e3 * NOISE
    assert third.record.fit.all.mean_mm < 3e3 * NOISE
    again = irbcal.calibrate(write_measurements(tmp_path / "new.csv", points), with_=irbcal.load(tmp_path / "two"))
    assert [item.name for item in again.record.sessions] == ["my-robot", "new", "new-2"]


def test_places_that_were_measured_before_prove_nothing(earlier, tmp_path):
    folder, robots = earlier
    q = irbcal.load(folder).record.used_points(False)[0].q[:20]
    new = write_measurements(tmp_path / "same.csv", measured(robots["wed"], q, NOISE, np.random.default_rng(4)))
    record = irbcal.calibrate(new, with_=folder, holdout=5).record
    # the old poses at the places that are held out are held out, too
    assert record.poses_heldout == 10
    assert sum("@" in name for name in np.array(record.points.target)[record.points.heldout]) == 15


def test_the_first_new_pose_can_be_held_out_like_the_others(earlier, tmp_path):
    folder, robots = earlier
    record = irbcal.calibrate(new_file(robots, tmp_path / "new.csv"), with_=folder, holdout=9).record
    first = arm().random_joints(12, 31)[0]
    assert record.poses_heldout == 9
    assert np.abs(record.used_points(True)[0].q - first).max(axis=1).min() < 1e-9  # the seed draws it


def test_what_is_refused(earlier, tmp_path):
    folder, robots = earlier
    new = new_file(robots, tmp_path / "new.csv")
    with pytest.raises(OptionError):
        irbcal.calibrate(new)
    with pytest.raises(OptionError, match="is not the nominal robot of the earlier calibration"):
        irbcal.calibrate(new, "irb120", with_=folder)
    record = irbcal.load(folder).record
    mine = record.model_copy(update={"robot": record.robot.model_copy(update={"urdf": "mine.urdf"})})
    with pytest.raises(OptionError, match=r"made from mine\.urdf, which is neither here nor known by name"):
        irbcal.calibrate(new, with_=mine)
    assert irbcal.calibrate(new, "irb1600", with_=mine).record.earlier == record.fingerprint
    with pytest.raises(OptionError, match="circles takes one session"):
        irbcal.calibrate(new, "irb1600", "26", with_=folder, method="circles")


def test_the_ur10_goes_through_as_it_is(shared_data, tmp_path):
    data = shared_data / "ur10_laser_tracker_6d" / "measurements.csv"
    found = irbcal.calibrate(data, "ur10", "placement", session_by="group")
    assert [item.name for item in found.record.sessions] == ["grid", "random"]
    assert 0.40 < found.record.heldout.all.mean_mm < 0.50
    assert found.record.heldout.per_target["tmac@grid"].mean_mm < 0.5
    _, together, apart = sessions.differing_groups(table.read(data), irbcal.read_urdf("ur10").arm)
    assert together > 100 * apart


@pytest.fixture(scope="module")
def earlier_16(tmp_path_factory):
    """A saved calibration of 40 poses of level 16, and the robot."""
    folder, robot = tmp_path_factory.mktemp("earlier"), truth("16")["mon"]
    points = measured(robot, arm().random_joints(40, 100), NOISE, np.random.default_rng(1))
    irbcal.calibrate(write_measurements(folder / "m.csv", points), "irb1600", "16").save(folder / "my-robot")
    return folder / "my-robot", points


def test_the_order_of_the_poses_and_their_last_moves_are_kept(earlier_16):
    folder, measured_points = earlier_16
    ((name, points, motion),) = earlier_of(folder).sessions
    assert name == "my-robot"
    np.testing.assert_array_equal(motion.elapsed, np.arange(40))
    np.testing.assert_array_equal(points.pose_ids.astype(int), np.arange(40))
    np.testing.assert_allclose(motion.q, arm().random_joints(40, 100), rtol=0, atol=1e-10)
    np.testing.assert_allclose(motion.moves[1:], np.diff(motion.q, axis=0), rtol=0, atol=1e-10)
    np.testing.assert_array_equal(motion.moves[0], 0.0)
    assert points.names().tolist() == measured_points.names().tolist()
    np.testing.assert_allclose(points.xyz, measured_points.xyz, rtol=0, atol=1e-9)


def test_a_calibration_with_sessions_gives_them_back(earlier_16, tmp_path):
    folder, _ = earlier_16
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


def test_without_points_nothing_can_be_added(earlier_16):
    record = irbcal.load(earlier_16[0]).record
    with pytest.raises(CalibrationError, match="has no measured points"):
        earlier_of(record.model_copy(update={"points": record.points.model_copy(update={"x_mm": []})}))


def test_loads_of_the_fit_stay_where_the_file_of_the_proof_tells_none(tmp_path):
    truth, rng = random_robot(arm(), "11", np.random.default_rng(1)), np.random.default_rng(2)
    files = [
        write_measurements(tmp_path / f"{name}.csv", measured(truth, arm().random_joints(poses, poses), 3e-5, rng))
        for name, poses in (("fit", 24), ("proof", 10))
    ]
    loaded = pd.read_csv(files[0]).assign(payload_kg=3.0)
    loaded.to_csv(files[0], index=False)
    calibration = irbcal.calibrate(files[0], "irb1600", "11", verify=files[1])
    assert calibration.record.poses.inputs == {"payload_kg": [3.0] * 24 + [None] * 10}
    of_kind = [calibration.record.used_points(heldout)[0].inputs for heldout in (False, True)]
    assert of_kind[1] == {}
    np.testing.assert_array_equal(of_kind[0]["payload_kg"], 3.0)
    ((_, _, motion),) = earlier_of(calibration).sessions
    np.testing.assert_array_equal(motion.inputs["payload_kg"], np.full(34, 3.0))


def test_an_input_that_a_session_lacks_is_named(earlier_16, tmp_path):
    robot = truth("16")["wed"]
    new = measured(robot, arm().random_joints(15, 7), NOISE, np.random.default_rng(2))
    rows = pd.read_csv(write_measurements(tmp_path / "wed.csv", new)).assign(payload_kg=2.0)
    both = irbcal.calibrate(rows, with_=earlier_16[0])
    assert [note for note in both.record.notes if "payload_kg: missing in my-robot" in note]


def test_the_same_file_is_not_added_twice(earlier, tmp_path):
    folder, robots = earlier
    new = new_file(robots, tmp_path / "new.csv")
    irbcal.calibrate(new, with_=folder).save(tmp_path / "two")
    with pytest.raises(MeasurementError) as refused:
        irbcal.calibrate(new, with_=tmp_path / "two")
    assert refused.value.file == str(new)


def test_a_file_that_has_grown_counts_each_pose_once(earlier_16, tmp_path):
    folder, points = earlier_16
    more = measured(truth("16")["mon"], arm().random_joints(20, 8), NOISE, np.random.default_rng(3))
    rows = [pd.read_csv(write_measurements(tmp_path / f"{k}.csv", points)) for k, points in enumerate((points, more))]
    rows[1]["pose"] += 100
    grown = tmp_path / "m.csv"
    pd.concat(rows).to_csv(grown, index=False)
    with_earlier, alone = irbcal.calibrate(grown, with_=folder), irbcal.calibrate(grown, "irb1600", "16")
    np.testing.assert_array_equal(*(item.robot_calibrated().table.theta for item in (with_earlier, alone)))
    kept = [(item.record.poses_fit, item.record.poses_heldout, item.record.sessions) for item in (with_earlier, alone)]
    assert kept[0] == kept[1]
    assert sum(kept[1][:2]) == 60
    # of few old poses the others stay, in a session of their own; a pose that is measured again is new
    again = pd.read_csv(write_measurements(tmp_path / "again.csv", measured_again(points)))
    again["pose"] += 200
    pd.concat([rows[0][rows[0]["pose"] < 10], rows[1], again]).to_csv(grown, index=False)
    record = irbcal.calibrate(grown, with_=folder).record
    assert [item.name for item in record.sessions] == ["my-robot", "m"]
    assert record.poses_fit + record.poses_heldout == 30 + 10 + 20 + 40
    assert any(
        "10 of 40 poses of the earlier calibration's session my-robot stand in m.csv again" in note
        for note in record.notes
    )


def test_poses_are_known_again_in_another_frame_by_the_distances_of_their_targets(earlier_16):
    """References put poses of a longer file into a frame that differs by their noise; one target tells no distances."""
    _, points = earlier_16
    T = frames.from_xyz_angles([0.02, -0.01, 0.03, 1e-3, -2e-3, 3e-3])
    moved = replace(points, xyz=frames.apply(T, points.xyz))
    assert all(mask.all() for mask in sessions._copied_poses(points, moved))
    assert not any(mask.any() for mask in sessions._copied_poses(points, measured_again(moved)))
    one_target = [each.take(each.target == 0).with_seen_targets() for each in (points, moved)]
    assert not any(mask.any() for mask in sessions._copied_poses(*one_target))
    late = points.select(np.arange(40) >= 30)
    old, new = sessions._copied_poses(points, late)
    assert new.all()
    assert np.flatnonzero(old).tolist() == list(range(30, 40))


def measured_again(points):
    """The same poses with other noise."""
    return replace(points, xyz=points.xyz + np.random.default_rng(9).normal(0, NOISE, points.xyz.shape))


def test_a_file_without_a_new_pose_adds_nothing(earlier_16, tmp_path):
    folder, points = earlier_16
    rows = pd.read_csv(write_measurements(tmp_path / "m.csv", points))
    with pytest.raises(MeasurementError, match="in the earlier calibration already"):
        irbcal.calibrate(rows[rows["pose"] < 30][::-1], with_=folder)
