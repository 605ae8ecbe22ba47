"""Outliers and mixed-up units against the nominal robot."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from support import arm, measured, random_robot

import irbcal
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification.outliers import find_outliers


def test_outliers_are_found_and_good_points_kept():
    nominal = arm()
    rng = np.random.default_rng(28)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    xyz = points.xyz.copy()
    wrong = [3, 40, 41, 99, 150]
    xyz[wrong] += rng.uniform(0.02, 0.5, (5, 3))
    found = find_outliers(nominal, dataclasses.replace(points, xyz=xyz))
    keep, distance = found.keep, found.distance
    assert np.flatnonzero(~keep).tolist() == wrong
    assert distance[wrong].min() > 0.015


def test_other_units_are_named():
    nominal = arm()
    rng = np.random.default_rng(29)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(40, 1), 3e-5, rng)
    mixed = dataclasses.replace(points, xyz=points.xyz * 1e-3)
    words = "^m.csv: these look like positions in metres instead of millimetres"
    with pytest.raises(MeasurementError, match=words) as caught:
        find_outliers(nominal, mixed, "m.csv")
    assert caught.value.file == "m.csv"


def test_another_robot_is_refused():
    rng = np.random.default_rng(30)
    nominal = arm()
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(40, 1), 3e-5, rng)
    with pytest.raises(
        IdentificationError, match=r"^m\.csv: irb120.* misses the measured points by .* mm \(median\)"
    ) as caught:
        find_outliers(arm("irb120"), points, "m.csv")
    assert caught.value.file == "m.csv"


def test_a_positioner_whose_tip_lies_on_the_crossing_of_its_axes(tmp_path):
    """The tip never moves: how far the reflectors moved says what a miss is worth."""
    origin = '<origin xyz="0 0 {}"/><axis xyz="{}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    robot = tmp_path / "positioner.urdf"
    robot.write_text(
        '<robot name="positioner"><link name="base_link"/><link name="a"/><link name="tool0"/>'
        '<joint name="tilt" type="revolute"><parent link="base_link"/><child link="a"/>'
        + origin.format(0.8, "0 1 0")
        + '<joint name="turn" type="revolute"><parent link="a"/><child link="tool0"/>'
        + origin.format(0.0, "0 0 1")
        + "</robot>"
    )
    nominal = irbcal.read_urdf(robot).arm
    q = nominal.random_joints(20, 1)
    assert np.ptp(nominal.forward(q)[:, :3, 3], axis=0).max() < 1e-12
    rng = np.random.default_rng(2)
    truth = random_robot(nominal, "placement", rng)
    points = measured(truth, q, 3e-5, rng)
    xyz = points.xyz.copy()
    xyz[7] += [0.1, 0.0, 0.0]
    assert np.flatnonzero(~find_outliers(nominal, dataclasses.replace(points, xyz=xyz)).keep).tolist() == [7]


def test_a_lost_zero_does_not_hide_an_outlier():
    """Against the nominal robot, points of a robot with a joint off by a degree lie some 20 mm off, all of them."""
    nominal = arm()
    rng = np.random.default_rng(31)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(60, 1), 3e-5, rng)
    q, xyz = points.q.copy(), points.xyz.copy()
    q[:, 2] += np.radians(1.0)
    xyz[100] += [0.005, 0.0, 0.0]
    found = find_outliers(nominal, dataclasses.replace(points, q=q, xyz=xyz))
    assert np.flatnonzero(~found.keep).tolist() == [100]
    assert found.level == "34"


def test_a_third_of_poses_that_are_wrong_by_little():
    nominal = arm()
    rng = np.random.default_rng(32)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(60, 1), 3e-5, rng)
    wrong = points.pose % 3 == 0
    xyz = points.xyz + wrong[:, None] * np.repeat(3e-3 * np.sign(rng.normal(size=(60, 3))), 3, axis=0)
    found = find_outliers(nominal, dataclasses.replace(points, xyz=xyz))
    assert (found.keep == ~wrong).all()


def test_few_poses_are_compared_with_the_nominal_robot():
    nominal = arm()
    rng = np.random.default_rng(33)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(8, 1), 3e-5, rng)
    found = find_outliers(nominal, points)
    assert found.level == "nominal"
    assert found.keep.all()


def test_points_of_a_ur10_that_are_3_mm_off_are_named_and_left_out(shared_data, tmp_path):
    rows = pd.read_csv(shared_data / "ur10_laser_tracker_6d" / "measurements.csv", dtype=str)
    rows = rows[rows["group"] == "grid"].drop(columns=["qw", "qx", "qy", "qz"]).dropna(subset=["x_mm"])
    rows = rows.sample(240, random_state=1)
    wrong = rows["pose"].iloc[[10, 50]].tolist()
    rows.to_csv(tmp_path / "clean.csv", index=False)
    off = rows["pose"].isin(wrong)
    rows.loc[off, "z_mm"] = (rows.loc[off, "z_mm"].astype(float) + 3.0).astype(str)
    rows.to_csv(tmp_path / "m.csv", index=False)
    options = {"robot": "ur10", "model": "auto", "holdout": 150, "split": "last"}
    good = irbcal.calibrate(tmp_path / "clean.csv", **options)
    made = irbcal.calibrate(tmp_path / "m.csv", **options)
    assert not good.record.excluded
    assert sorted(point.pose for point in made.record.excluded) == sorted(wrong)
    assert all(point.reason.startswith("outlier") for point in made.record.excluded)
    assert [note for note in made.record.notes if all(pose in note for pose in wrong)]
    assert made.record.heldout.all.mean_mm < 1.15 * good.record.heldout.all.mean_mm
