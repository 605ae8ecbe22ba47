"""What the way to a pose leaves: each against its formula."""

import numpy as np
import pytest
from cell_support import change_of_joints

from irbcal.modeling import frames
from irbcal.simulation import history_effects
from irbcal.units import DEG


def test_backlash_depends_on_where_each_joint_came_from(cell):
    # joint 1 rises, falls, stays, rises; joint 2 falls and stays; joint 3 never moves (counts as reached from below)
    joints = [[10, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [6, -5, 0, 0, 0, 0]]
    gap = history_effects.Backlash(peak_to_peak_deg=(0.04, 0.02, 0.06, 0.0, 0.0, 0.0))
    found = change_of_joints(cell, gap, joints)
    np.testing.assert_allclose(found[:, 0], [-0.02, 0.02, 0.02, -0.02], atol=1e-15)
    np.testing.assert_allclose(found[:, 1], [0.01] * 4, atol=1e-15)
    np.testing.assert_allclose(found[:, 2], [-0.03] * 4, atol=1e-15)


def test_backlash_of_a_pose_reached_from_both_sides(cell):
    bare = cell.only("backlash").replace(table=cell.arm.table)
    there = np.radians([[0, 0, 0, 0, 0, 30.0], [0, 0, 0, 0, 0, 60.0], [0, 0, 0, 0, 0, 30.0]])
    run = bare.measure(there)
    turn = frames.rotation_distance(run.T_base_tip[0, :3, :3], run.T_base_tip[2, :3, :3])
    assert turn == pytest.approx(0.05 * DEG, rel=1e-9)  # section 4.2


def test_settling_follows_its_formula(cell):
    swing = history_effects.Settling(amplitude_deg=0.012, tau_s=0.4, frequency_Hz=8.0)
    found = change_of_joints(cell, swing, [[10.0, -10.0, 0, 0, 0, 0]], wait_s=0.5)
    expected = 0.012 * np.exp(-0.5 / 0.4) * np.cos(2 * np.pi * 8.0 * 0.5)
    np.testing.assert_allclose(found[0], [expected, -expected, expected, 0, 0, 0], atol=1e-15)
    assert np.abs(change_of_joints(cell, swing, [[10.0] * 6], wait_s=2.0)).max() < 0.012 / 100  # annex V


def test_direction_saturates_and_forgets_small_moves(cell):
    part = history_effects.Direction(size_deg=(0.004, 0.0, 0.0, 0.0, 0.0, -0.008))
    found = change_of_joints(cell, part, [[10, 0, 0, 0, 0, 0], [10.5, 0, 0, 0, 0, 5], [0, 0, 0, 0, 0, 4.75]])
    np.testing.assert_allclose(found[:, 0], [0.004, 0.004 * np.tanh(1.0), -0.004], atol=1e-10)
    np.testing.assert_allclose(found[:, 5], [0.0, -0.008, 0.008 * np.tanh(0.5)], atol=1e-10)


def test_move_is_a_share_of_the_own_and_of_the_largest_move(cell):
    part = history_effects.Move(size_deg=(0.004, 0.002, 0, 0, 0, 0), share=(0, 1e-4, 0, 0, 0, 0))
    found = change_of_joints(cell, part, [[20, -10, 0, 0, 0, 0], [20, -10, 0, 0, 0, 0], [20, 30, 0, 0, 0, 0]])
    np.testing.assert_allclose(found[:, 0], [0.004, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(found[:, 1], [-0.001 - 1e-3, 0.0, 0.002 + 4e-3], atol=1e-15)
