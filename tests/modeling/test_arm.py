"""Arms: limits, refusals, what they say of themselves."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from support import arm, example_robot, on_a_rail

from irbcal.errors import RobotError
from irbcal.io import urdf
from irbcal.modeling.arm import relative_difference
from irbcal.modeling.dhm import DHMTable


@pytest.mark.parametrize("joints", ["random_joints", "spread_joints"])
def test_drawn_joints_fill_the_limits_and_stay_inside(joints):
    nominal = arm("irb120")
    q = nominal.random_joints(2000, 0) if joints == "random_joints" else nominal.spread_joints(2000)
    assert (q >= nominal.lower).all()
    assert (q <= nominal.upper).all()
    assert (np.ptp(q, axis=0) > 0.98 * (nominal.upper - nominal.lower)).all()
    assert np.linalg.matrix_rank(q - q.mean(axis=0), tol=1.0) == 6


@pytest.mark.parametrize(("name", "lengths"), [("irb1600", (0.7, 0.6)), ("irb120", (0.27, np.hypot(0, 0.302)))])
def test_arm_lengths_and_directions_of_the_shipped_robots(name, lengths):
    phases, stiffness = arm(name).stiffness_geometry()
    assert np.abs(phases - [0, np.pi / 2]).max() < 1e-12
    assert abs(stiffness.L_1 - lengths[0]) < 1e-12
    assert abs(stiffness.L_2 - lengths[1]) < 1e-12
    assert stiffness.m == 1.0


def test_stiffness_needs_a_shoulder_and_an_elbow_that_gravity_bends():
    tilted = arm().with_table(replace(arm().table, alpha=arm().table.alpha + np.array([0, 0.1, 0, 0, 0, 0])))
    with pytest.raises(RobotError, match="needs axes 2 and 3 horizontal and pointing the same way"):
        tilted.stiffness_geometry()


def test_units_of_a_joint_that_slides(tmp_path):
    rail = urdf.read(on_a_rail(tmp_path / "rail.urdf"), "rail_base").arm
    assert rail.joint_columns == ["q1_mm", *(f"q{k}_deg" for k in range(2, 8))]
    q = np.array([2.4, *np.radians([10, 20, 30, 40, 50, 60])])
    assert rail.check_joints(q).shape == (1, 7)
    with pytest.raises(RobotError, match="expected in metres, found 2400 for rail: these look like millimetres"):
        rail.check_joints([2400.0, 0, 0, 0, 0, 0, 0])
    with pytest.raises(RobotError, match="these look like degrees"):
        rail.check_joints([2.4, 10, 20, 30, 40, 50, 60])
    assert repr(rail) == "<Arm irb120_3_058: 6 revolute and 1 prismatic joints, rail_base to tool0>"


def test_continuous_joints_may_turn_for_ever_where_others_can_tell():
    kinova = urdf.read(example_robot("kinova_description/robots/kinova.urdf"), tip_link="j2s6s200_end_effector").arm
    endless = ~np.isfinite(kinova.upper)
    assert endless.sum() == 3
    assert kinova.check_joints(np.where(endless, 100 * np.pi, 1.0)).shape == (1, 6)
    with pytest.raises(RobotError, match="these look like degrees"):
        kinova.check_joints(np.full(6, 90.0))
    free = replace(arm(), lower=np.full(6, -np.inf), upper=np.full(6, np.inf))
    assert free.check_joints(np.full(6, 12 * np.pi)).shape == (1, 6)
    with pytest.raises(RobotError, match="these look like degrees"):
        free.check_joints(np.full(6, 90.0))


def test_an_arm_cannot_be_changed_and_can_be_pickled():
    nominal = arm()
    with pytest.raises(ValueError, match="read-only"):
        nominal.lower[0] = 0.0
    nominal.check_joints(np.zeros(6))  # keeps what it worked out
    again = pickle.loads(pickle.dumps(nominal))
    q = nominal.random_joints(10, 0)
    assert relative_difference(again.forward(q), nominal.forward(q)) == (0.0, 0.0)
    assert repr(again) == repr(nominal)


def test_a_table_shows_its_numbers():
    assert repr(arm().table) == (
        "<DHMTable of 6 joints: alpha_deg a_mm theta_deg d_mm: 0 0 0 486.5; -90 150 -90 0; 0 700 0 0; -90 0 0 600; "
        "90 0 0 0; -90 0 180 65>"
    )
    many = DHMTable(*np.zeros((4, 20)), beta=np.full(20, 0.1))
    assert len(many) == 20
    assert "beta_deg" in repr(many)
    assert len(repr(many)) < 500
