"""How the arm came to each pose, from the order of the file."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from history_cases import sided_points, sided_robot
from support import measured, random_robot

from irbcal.errors import MeasurementError
from irbcal.measurement import cleaning, table
from irbcal.measurement.motions import (
    last_moves,
    motion_of,
    previous_stops,
    shown_share,
    times_of,
    usual_load,
    with_last_moves,
)
from irbcal.measurement.points import distances


def rows(q, groups=None, names=None):
    frame = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
    frame.insert(0, "pose", np.arange(len(q)) if names is None else names)
    if groups is not None:
        frame["group"] = groups
    places = 1000.0 + 10.0 * np.arange(3 * len(q)).reshape(-1, 3)
    return frame.assign(target="smr1", x_mm=places[:, 0], y_mm=places[:, 1], z_mm=places[:, 2])


def test_moves_are_those_of_the_file_also_where_poses_are_left_out():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 6))
    seen = table.read(rows(q, ["a"] * 4 + ["b"] * 4))
    points = cleaning.clean(seen).points
    keep = np.array([True, False, True, True, True, True, False, True])
    motion = motion_of(seen, points.select(keep))
    expected = np.diff(q, axis=0, prepend=q[:1])
    expected[4] = 0.0  # first of its group
    assert np.abs(motion.moves - expected[keep]).max() < 1e-12
    assert np.array_equal(motion.elapsed, np.flatnonzero(keep))
    assert np.array_equal(motion.q, points.q[keep])
    assert motion.readings


def test_cycles_of_a_pose_have_their_own_moves():
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 6))
    q[3] = q[1]
    frame = rows(q, names=[0, 1, 2, 1, 4])
    frame["cycle"] = [1, 1, 1, 2, 2]
    seen = table.read(frame)
    motion = motion_of(seen, cleaning.clean(seen).points)
    assert np.abs(motion.moves[1:] - np.diff(q, axis=0)).max() < 1e-12
    assert not motion.moves[0].any()
    assert np.array_equal(motion.elapsed, [0.0, 2.0, 2.0, 2.0, 4.0])  # which of the two is when is not told


def test_a_pose_in_two_places_of_the_file_has_no_move():
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 6))
    q[3] = q[1]
    seen = table.read(rows(q, names=[0, 1, 2, 1, 4]))
    motion = motion_of(seen, cleaning.clean(seen).points)
    assert len(motion) == 4
    assert not motion.moves[1].any()
    assert np.abs(motion.moves[[2, 3]] - [q[2] - q[1], q[4] - q[1]]).max() < 1e-12


def test_programmed_joints_are_no_readings():
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 6))
    frame = rows(q + 1e-4)
    frame[[f"c{k}_deg" for k in range(1, 7)]] = np.degrees(q)
    seen = table.read(frame)
    motion = motion_of(seen, cleaning.clean(seen).points)
    assert not motion.readings
    assert np.abs(motion.moves[1:] - np.diff(q, axis=0)).max() < 1e-12


def test_loads_of_the_poses_without_gaps():
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (4, 6))
    frame = rows(q).assign(payload_kg=[2.0, np.nan, 2.0, 2.0])
    seen = table.read(frame)
    motion = motion_of(seen, cleaning.clean(seen).points)
    assert np.array_equal(
        motion.inputs["payload_kg"], np.full(4, 2.0)
    )  # one load only: the file told it where it told any
    seen = table.read(frame.assign(payload_kg=[2.0, np.nan, 0.0, 2.0]))
    with pytest.raises(
        MeasurementError,
        match="pose 1: expected a mass, others carry 0 to 2 kg: write 0 for a bare flange, found nothing",
    ):
        motion_of(seen, cleaning.clean(seen).points)
    place = {"payload_x_mm": [1.0, np.nan, 3.0, 4.0], "payload_y_mm": 0.0, "payload_z_mm": 50.0}
    seen = table.read(frame.assign(payload_kg=[2.0, 0.0, 2.0, 2.0], **place))
    motion = motion_of(seen, cleaning.clean(seen).points)
    assert np.abs(motion.inputs["payload_centre"][:, 0] - [0.001, 0.0, 0.003, 0.004]).max() < 1e-15
    assert not motion.inputs["payload_centre"][1].any()
    seen = table.read(frame.assign(payload_kg=2.0, **place))
    with pytest.raises(MeasurementError, match="pose 1"):
        motion_of(seen, cleaning.clean(seen).points)


def test_the_usual_load():
    assert usual_load(None) is usual_load(np.array([np.nan])) is None
    assert usual_load(np.array([1.0, 2.0, np.nan, 2.0, 1.0, 3.0])) == 1.0  # of equals the last measured


def test_times_of_poses_between_known_ones():
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (6, 6))
    seen = table.read(rows(q))
    points = cleaning.clean(seen).points
    keep = np.array([True, False, True, True, False, False])
    part = points.select(keep)
    (found,) = times_of([points], [(part, motion_of(seen, part))])
    assert found.tolist() == [0.0, 1.0, 2.0, 3.0, 3.0, 3.0]
    assert times_of([points.select(~keep)], [(part, motion_of(seen, part))]) == [None]


def test_the_last_move_is_kept_while_a_joint_stands_still():
    q = np.radians([[0.0, 5.0], [10.0, 5.0], [10.0, 5.001], [10.0, 2.0], [4.0, 2.0]])
    assert np.degrees(last_moves(q)[1:]) == pytest.approx(
        np.array([[10.0, np.nan], [10.0, np.nan], [10.0, -3.001], [-6.0, -3.001]]), abs=1e-12, nan_ok=True
    )
    groups = np.array(["a", "a", "b", "b", "b"], object)
    assert np.isnan(last_moves(q, groups)[[0, 2]]).all()
    assert np.isfinite(last_moves(q, groups)[4]).all()


def test_a_group_begins_with_a_move_that_is_not_known():
    q = np.arange(4.0)[:, None]
    found = last_moves(q, np.array(["a", "a", "b", "b"], dtype=object))
    assert np.array_equal(found[:, 0], [np.nan, 1.0, np.nan, 1.0], equal_nan=True)


def test_previous_stops_are_those_of_the_rows_in_order():
    q = np.arange(8.0).reshape(4, 2)
    none = np.full(9, "", dtype=object)
    before = previous_stops(q, np.array([0, 0, 1, 1, 1, 2, 3, 3, 3]), none)
    assert np.isnan(before[0]).all()
    assert np.array_equal(before[1:], q[:3])
    # target by target: the first pose follows nothing the first time and the last pose the second time
    before = previous_stops(q, np.array([0, 1, 2, 3, 0, 1, 2, 3]), none[:8])
    assert np.isnan(before[0]).all()
    assert np.array_equal(before[1:], q[:3])


def test_previous_stops_do_not_cross_groups_and_are_unknown_where_two_differ():
    q = np.arange(8.0).reshape(4, 2)
    groups = np.array(["a", "a", "b", "b"], dtype=object)
    before = previous_stops(q, np.arange(4), groups)
    assert np.isnan(before[[0, 2]]).all()
    assert np.array_equal(before[[1, 3]], q[[0, 2]])
    before = previous_stops(q, np.array([0, 1, 2, 1, 3]), np.full(5, "", dtype=object))
    assert np.isnan(before[[0, 1]]).all()
    assert np.array_equal(before[[2, 3]], q[[1, 1]])


def test_a_repeat_has_the_stop_before_of_its_first_reading():
    q = np.radians([[0.0, 5.0], [10.0, 5.0], [10.0, 5.001], [10.0, 5.0], [4.0, 2.0], [4.0, 2.0]])
    before = previous_stops(q, np.arange(6), np.full(6, "", dtype=object))
    assert np.array_equal(before[1:], q[[0, 0, 0, 3, 3]])
    groups = np.array(["a", "a", "b", "b", "b", "b"], dtype=object)
    before = previous_stops(q, np.arange(6), groups)
    assert np.isnan(before[[0, 2, 3]]).all()  # a repeat of a pose whose stop before is not known
    assert np.array_equal(before[[1, 4, 5]], q[[0, 3, 3]])


def test_last_moves_are_used_where_the_order_is_right():
    robot = sided_robot()
    points = sided_points(robot, noise=1e-5)
    share, std = shown_share(robot, points)
    assert abs(share - 1.0) < 3 * std
    assert std < 0.05
    found, notes = with_last_moves(robot, points)
    assert found is points
    assert "39 of 40 poses" in notes[0]


def test_last_moves_are_dropped_where_they_make_errors_larger():
    robot = sided_robot()
    points = sided_points(robot, noise=1e-5)
    wrong = replace(points, previous=2 * points.q - points.previous)  # every joint from the other side
    assert shown_share(robot, wrong)[0] < -0.5
    found, notes = with_last_moves(robot, wrong)
    assert found.previous is None
    assert "not the order of measuring" in notes[0]
    assert distances(robot, found).mean() < distances(robot, wrong).mean()


def test_a_shuffled_file_makes_errors_no_larger():
    robot = sided_robot()
    points = sided_points(robot, n=300, noise=1e-5)
    order = np.random.default_rng(0).permutation(points.poses)
    before = np.full(points.q.shape, np.nan)
    before[order[1:]] = points.q[order[:-1]]
    mixed = replace(points, previous=before)
    found, _ = with_last_moves(robot, mixed)
    unknown = distances(robot, replace(points, previous=None))
    assert distances(robot, found).mean() <= 1.01 * unknown.mean()
    assert distances(robot, points).mean() < 0.1 * unknown.mean()


def test_robots_without_history_and_files_without_order_say_so():
    thesis = random_robot(sided_robot().arm, "34", np.random.default_rng(2))
    q = thesis.arm.random_joints(5, 1)
    assert with_last_moves(thesis, measured(thesis, q))[1] == []
    points = replace(sided_points(sided_robot()), previous=None)
    assert "not known" in with_last_moves(sided_robot(), points)[1][0]
