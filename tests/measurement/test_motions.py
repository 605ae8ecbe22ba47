"""How the arm came to each pose, from the order of the file."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import cleaning, table
from irbcal.measurement.motions import motion_of, times_of, usual_load


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
    assert np.array_equal(motion.payload_kg, np.full(4, 2.0))  # one load only: the file told it where it told any
    seen = table.read(frame.assign(payload_kg=[2.0, np.nan, 0.0, 2.0]))
    with pytest.raises(MeasurementError, match="pose 1 has no payload, others carry 0 to 2 kg"):
        motion_of(seen, cleaning.clean(seen).points)
    place = {"payload_x_mm": [1.0, np.nan, 3.0, 4.0], "payload_y_mm": 0.0, "payload_z_mm": 50.0}
    seen = table.read(frame.assign(payload_kg=[2.0, 0.0, 2.0, 2.0], **place))
    motion = motion_of(seen, cleaning.clean(seen).points)
    assert np.abs(motion.payload_place[:, 0] - [0.001, 0.0, 0.003, 0.004]).max() < 1e-15
    assert not motion.payload_place[1].any()
    seen = table.read(frame.assign(payload_kg=2.0, **place))
    with pytest.raises(MeasurementError, match="pose 1 has a payload without a place"):
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
