"""Cleaning and registration on simulated data with known faults."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support import TARGETS, arm, measured, random_robot

from irbcal.errors import MeasurementError
from irbcal.measurement import cleaning
from irbcal.measurement.column_names import JOINTS, POSITION
from irbcal.measurement.registration import register
from irbcal.measurement.table import MeasurementSet
from irbcal.measurement.table_columns import ColumnArrays
from irbcal.modeling import frames

REFERENCES = {"ref1": [2.4, 0.5, -0.56], "ref2": [2.9, 0.8, -0.55], "ref3": [2.7, 0.0, -0.57], "ref4": [2.0, 0.3, -0.5]}


def simulated_set(poses=40, drift=0.0, seed=0, references=("ref1", "ref2", "ref3")):
    """A measurement set of three targets and references; returns it with the robot and the true points."""
    rng = np.random.default_rng(seed)
    nominal = arm()
    robot = random_robot(nominal, "34", rng)
    points = measured(robot, nominal.random_joints(poses, seed))
    rows, T_all = [], []
    for p in range(poses):
        twist = drift * rng.uniform(-1, 1, 6)
        T = frames.from_xyz_angles(twist * [1, 1, 1, 0.1, 0.1, 0.1])
        T_all.append(T)
        seen = {points.target_names[points.target[k]]: points.xyz[k] for k in np.flatnonzero(points.pose == p)}
        seen |= {name: np.array(REFERENCES[name]) for name in references}
        for name, xyz in seen.items():
            rows.append([p * len(seen) + 2, str(p), *np.degrees(points.q[p]), name, *(frames.apply(T, xyz) * 1e3), p])
    table = pd.DataFrame(rows, columns=["row", "pose", *JOINTS, "target", *POSITION, "pose_index"])
    return MeasurementSet(ColumnArrays.of_frame(table), "simulated.csv", "0"), robot, points, np.array(T_all)


def at(seen, pose, target):
    return seen.table.index[(seen.table["pose"] == str(pose)) & (seen.table["target"] == target)][0]


def put(seen, rows, columns, value):
    """The measurements with other values in some rows; a function makes them from those that are there."""
    table = seen.table
    table.loc[rows, columns] = value(table.loc[rows, columns]) if callable(value) else value
    return seen.with_table(table)


def test_clean_data_pass_untouched():
    seen, _, points, _ = simulated_set()
    found = cleaning.clean(seen)
    assert found.excluded == ()
    assert np.abs(found.points.xyz - points.xyz).max() < 1e-12
    assert np.array_equal(found.points.pose, points.pose)


def test_registration_removes_the_drift():
    seen, _, points, _ = simulated_set(drift=1e-3)
    raw = seen.positions()[~seen.is_reference()]
    assert np.linalg.norm(raw - points.xyz, axis=1).max() > 5e-4
    found = cleaning.clean(seen)
    # the frame of the middle pose is the measuring frame: all points agree up to one common motion
    T = frames.rigid_fit(found.points.xyz, points.xyz)
    assert np.abs(frames.apply(T, found.points.xyz) - points.xyz).max() < 1e-9
    assert found.registration.residual < 1e-12
    assert found.registration.with_references.all()


def test_registration_to_the_places_of_an_earlier_calibration():
    seen, _, points, _ = simulated_set(drift=1e-3)
    found = cleaning.clean(seen, {k: np.array(v) for k, v in REFERENCES.items()})
    assert np.abs(found.points.xyz - points.xyz).max() < 1e-12


def test_targets_that_are_known_may_differ_in_upper_and_lower_case():
    seen, *_ = simulated_set(drift=1e-3)
    known = cleaning.clean(seen).points.target_names
    places = cleaning.clean(seen).registration.references
    upper = seen.with_table(seen.table.assign(target=seen.table["target"].str.upper()))
    found = cleaning.clean(upper, places, known)
    assert found.points.target_names == known
    np.testing.assert_allclose(found.points.xyz, cleaning.clean(seen, places, known).points.xyz, rtol=0, atol=1e-12)
    # a file that has both names means two targets
    both = seen.with_table(seen.table.assign(target=seen.table["target"].replace("smr2", "SMR1")))
    assert {point.target for point in cleaning.clean(both, places, known).excluded} >= {"SMR1"}


def test_lost_points_are_left_out_with_their_reason():
    seen, *_ = simulated_set()
    seen = put(seen, at(seen, 3, "smr2"), POSITION, np.nan)
    found = cleaning.clean(seen)
    assert [(e.pose, e.target, e.reason) for e in found.excluded] == [("3", "smr2", "lost: no position")]
    assert len(found.points) == 119


def test_a_wrong_reference_is_named_and_its_pose_left_out():
    seen, *_ = simulated_set()
    seen = put(seen, at(seen, 5, "ref2"), "y_mm", lambda value: value + 60)
    found = cleaning.clean(seen)
    assert {e.pose for e in found.excluded} == {"5"}
    reasons = {e.target: e.reason for e in found.excluded}
    assert reasons["ref2"].startswith("wrong reference: its distance to another one is off by")
    assert "its reference ref2 is off" in reasons["smr1"]
    assert len(reasons) == 6
    assert found.points.poses == 39


def test_a_target_that_does_not_keep_its_distances_is_left_out_alone():
    seen, *_ = simulated_set()
    seen = put(seen, at(seen, 7, "smr3"), "x_mm", lambda value: value + 30)
    found = cleaning.clean(seen)
    assert [(e.pose, e.target) for e in found.excluded] == [("7", "smr3")]
    assert "wrong distance: off by" in found.excluded[0].reason


def test_of_two_targets_with_a_wrong_distance_neither_is_trusted():
    seen, *_ = simulated_set()
    rest = seen.table[seen.table["target"] != "smr3"].reset_index(drop=True)
    seen = seen.with_table(rest)
    seen = put(seen, at(seen, 7, "smr2"), "x_mm", lambda value: value + 30)
    found = cleaning.clean(seen)
    assert [(e.pose, e.target) for e in found.excluded] == [("7", "smr1"), ("7", "smr2")]


def test_poses_that_lost_a_reference_are_interpolated_between_neighbours():
    """Drift that grows steadily is recovered for a pose that saw two references only."""
    seen, _, points, _ = simulated_set()
    shift = np.linspace(0, 1, 40)[seen.table["pose_index"]]
    seen = put(seen, slice(None), "x_mm", lambda value: value + shift)
    seen = put(seen, at(seen, 20, "ref1"), POSITION, np.nan)
    found = cleaning.clean(seen, {k: np.array(v) for k, v in REFERENCES.items()})
    assert found.registration.with_references.sum() == 39
    assert np.abs(found.points.xyz - points.xyz).max() < 1e-12
    assert "1 of 40 poses saw fewer than three references" in found.notes[0]


def test_references_on_a_line_are_refused():
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 1e-4, 0]]) + np.zeros((5, 1, 1))
    with pytest.raises(MeasurementError, match="lie on a line"):
        register(line, ["ref1", "ref2", "ref3"], "m.csv")


def test_four_references_of_which_each_pose_sees_some():
    seen, _, points, _ = simulated_set(drift=1e-3, references=tuple(REFERENCES))
    rng = np.random.default_rng(1)
    for p in range(40):
        seen = put(seen, at(seen, p, f"ref{rng.integers(1, 5)}"), POSITION, np.nan)
    found = cleaning.clean(seen, {k: np.array(v) for k, v in REFERENCES.items()})
    assert found.registration.with_references.all()
    assert np.abs(found.points.xyz - points.xyz).max() < 1e-12
    common = cleaning.clean(seen)
    T = frames.rigid_fit(common.points.xyz, points.xyz)
    assert np.abs(frames.apply(T, common.points.xyz) - points.xyz).max() < 1e-8


def test_a_tracker_that_changed_its_station_between_the_poses():
    seen, _, points, _ = simulated_set()
    station = frames.from_xyz_angles([1.0, -2.0, 0.3, 0.2, -0.1, 1.5])
    later = (seen.table["pose_index"] >= 25).to_numpy()
    seen = put(seen, later, POSITION, frames.apply(station, seen.positions()[later]) * 1e3)
    found = cleaning.clean(seen)
    T = frames.rigid_fit(found.points.xyz, points.xyz)
    assert np.abs(frames.apply(T, found.points.xyz) - points.xyz).max() < 1e-9


def test_two_references_are_reported_as_unused():
    seen, *_ = simulated_set(references=("ref1", "ref2"))
    found = cleaning.clean(seen)
    assert found.registration is None
    assert "registration needs three" in found.notes[0]


def test_nothing_left_is_refused():
    seen, *_ = simulated_set()
    seen = put(seen, slice(None), POSITION, np.nan)
    with pytest.raises(MeasurementError, match="no usable point is left of 120: lost: no position"):
        cleaning.clean(seen)


def test_targets_the_calibration_does_not_know_are_left_out():
    seen, *_ = simulated_set()
    found = cleaning.clean(seen, only_targets=["smr1", "smr2"])
    assert {e.reason for e in found.excluded} == {"target unknown to the calibration"}
    assert found.points.target_names == ("smr1", "smr2")


NAMES = tuple(TARGETS)


def simulated(seed=1, poses=40):
    rng = np.random.default_rng(seed)
    robot = random_robot(arm(), "34", rng)
    return robot, measured(robot, arm().random_joints(poses, seed), 3e-5, rng)


def exchanged(points, poses, order):
    """The points with other names in some poses: target k is called order[k]."""
    mine = np.isin(points.pose, poses)
    return replace(points, target=np.where(mine, np.array(order)[points.target], points.target))


def shaped(points):
    seen = np.full((points.poses, 3, 3), np.nan)
    seen[points.pose, points.target] = points.xyz
    return seen


def test_by_shape():
    _, points = simulated()
    assert cleaning.by_shape(shaped(points)) == []
    found = cleaning.by_shape(shaped(exchanged(points, [3, 5, 8], [1, 0, 2])))
    assert [(p, order.tolist()) for p, order in found] == [(p, [1, 0, 2]) for p in (3, 5, 8)]
    # the cycle smr1 -> smr2 -> smr3: what is called smr2 is smr1
    ((pose, order),) = cleaning.by_shape(shaped(exchanged(points, [7], [1, 2, 0])))
    assert pose == 7
    assert order.tolist() == [2, 0, 1]


def test_an_outlier_is_no_exchange():
    _, points = simulated()
    seen = shaped(points)
    seen[4, 1] += 0.02
    seen[9, 2] = np.nan
    assert cleaning.by_shape(seen) == []


def test_by_robot():
    """Two reflectors have one distance only: a robot tells."""
    robot, points = simulated()
    two = points.take(points.target < 2).with_seen_targets()
    assert cleaning.by_robot(robot, two) == []
    found = cleaning.by_robot(robot, exchanged(two, range(20), [1, 0, 2]))
    assert [(p, order.tolist()) for p, order in found] == [(p, [1, 0]) for p in range(20)]


def test_in_words():
    found = [(f"P{k}", np.array([1, 0, 2])) for k in range(1, 4)] + [("X", np.array([2, 0, 1]))]
    assert cleaning.in_words(found, NAMES) == [
        "smr1 and smr2 are swapped in 3 poses (P1 to P3): correct their names in the file.",
        "smr1, smr2, smr3 are in truth smr3, smr1, smr2 in pose X: correct their names in the file.",
    ]
