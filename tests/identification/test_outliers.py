"""Gross errors and mixed-up units against the nominal robot."""

import dataclasses

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification.outliers import find_gross_errors


def test_gross_errors_are_found_and_good_points_kept():
    nominal = arm()
    rng = np.random.default_rng(28)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    xyz = points.xyz.copy()
    wrong = [3, 40, 41, 99, 150]
    xyz[wrong] += rng.uniform(0.02, 0.5, (5, 3))
    found = find_gross_errors(nominal, dataclasses.replace(points, xyz=xyz))
    keep, distance = found.keep, found.distance
    assert np.flatnonzero(~keep).tolist() == wrong
    assert distance[wrong].min() > 0.015


@pytest.mark.parametrize(
    ("q_factor", "xyz_factor", "words"),
    [
        (np.pi / 180, 1.0, "joints in radians instead of degrees"),
        (1.0, 1e-3, "positions in metres instead of millimetres"),
        (np.pi / 180, 1e-3, "joints in radians instead of degrees and positions in metres"),
    ],
)
def test_other_units_are_named(q_factor, xyz_factor, words):
    nominal = arm()
    rng = np.random.default_rng(29)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(40, 1), 3e-5, rng)
    mixed = dataclasses.replace(points, q=points.q * q_factor, xyz=points.xyz * xyz_factor)
    with pytest.raises(MeasurementError, match=f"^m.csv: these look like {words}") as caught:
        find_gross_errors(nominal, mixed, "m.csv")
    assert caught.value.file == "m.csv"


def test_another_robot_is_refused():
    rng = np.random.default_rng(30)
    nominal = arm()
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(40, 1), 3e-5, rng)
    with pytest.raises(
        IdentificationError, match=r"^m\.csv: irb120.* misses the measured points by .* mm \(median\)"
    ) as caught:
        find_gross_errors(arm("irb120"), points, "m.csv")
    assert caught.value.file == "m.csv"


def test_a_lost_zero_does_not_hide_a_gross_error():
    """Against the nominal robot, points of a robot with a joint off by a degree lie some 20 mm off, all of them."""
    nominal = arm()
    rng = np.random.default_rng(31)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(60, 1), 3e-5, rng)
    q, xyz = points.q.copy(), points.xyz.copy()
    q[:, 2] += np.radians(1.0)
    xyz[100] += [0.005, 0.0, 0.0]
    found = find_gross_errors(nominal, dataclasses.replace(points, q=q, xyz=xyz))
    assert np.flatnonzero(~found.keep).tolist() == [100]
    assert found.level == "34"


def test_a_third_of_poses_that_are_wrong_by_little():
    nominal = arm()
    rng = np.random.default_rng(32)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(60, 1), 3e-5, rng)
    wrong = points.pose % 3 == 0
    xyz = points.xyz + wrong[:, None] * np.repeat(3e-3 * np.sign(rng.normal(size=(60, 3))), 3, axis=0)
    found = find_gross_errors(nominal, dataclasses.replace(points, xyz=xyz))
    assert (found.keep == ~wrong).all()


def test_few_poses_are_compared_with_the_nominal_robot():
    nominal = arm()
    rng = np.random.default_rng(33)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(8, 1), 3e-5, rng)
    found = find_gross_errors(nominal, points)
    assert found.level == "nominal"
    assert found.keep.all()
