"""Effects of the robot: each against its formula or a hand calculation."""

from dataclasses import replace

import numpy as np
import pytest
from cell_support import change_of_joints, motion_of

from irbcal.cell import robot_effects
from irbcal.modeling import frames
from irbcal.units import DEG, MM


def test_three_kilograms_bend_the_stretched_arm_as_table_4_3_says(cell):
    """Nubiola 2011, Table 4.3: 0.29 mm from 3 kg, 2.13 mm in all with 1.8 kg."""
    joints = np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    bare = cell.only("compliance").replace(table=cell.arm.table)
    at_rest = cell.arm.forward(joints)[0, :3, 3]
    sag = [
        np.linalg.norm(bare.with_payload(load).measure(joints).T_base_tip[0, :3, 3] - at_rest) for load in (1.8, 4.8)
    ]
    assert sag[0] == pytest.approx(2.134 * MM, rel=0.15)
    assert sag[1] - sag[0] == pytest.approx(0.292 * MM, rel=0.15)


def test_backlash_depends_on_where_each_joint_came_from(cell):
    # joint 1 rises, falls, stays, rises; joint 2 falls and stays; joint 3 never moves (counts as reached from below)
    joints = [[10, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [6, -5, 0, 0, 0, 0]]
    gap = robot_effects.Backlash(peak_to_peak_deg=(0.04, 0.02, 0.06, 0.0, 0.0, 0.0))
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


def test_settling_and_warm_up_follow_their_formulas(cell):
    swing = robot_effects.Settling(amplitude_deg=0.012, tau_s=0.4, frequency_Hz=8.0)
    found = change_of_joints(cell, swing, [[10.0, -10.0, 0, 0, 0, 0]], wait_s=0.5)
    expected = 0.012 * np.exp(-0.5 / 0.4) * np.cos(2 * np.pi * 8.0 * 0.5)
    np.testing.assert_allclose(found[0], [expected, -expected, expected, 0, 0, 0], atol=1e-15)
    assert np.abs(change_of_joints(cell, swing, [[10.0] * 6], wait_s=2.0)).max() < 0.012 / 100  # annex V
    warm = robot_effects.WarmUp(before_min=0.0, tau_min=40.0, growth=1e-4, joint_deg=(0.004, -0.006))
    motion = motion_of(cell, np.zeros((2, 6)), time_s=np.array([0.0, 40 * 60.0]))
    np.testing.assert_allclose(
        warm.joints(motion, None)[:, 1:3] / DEG, [[0.004, -0.006], [0.004 / np.e, -0.006 / np.e]], rtol=1e-12
    )
    T = cell.arm.forward(motion.q)
    shrunk = warm.tips(T, motion)
    np.testing.assert_allclose(shrunk[:, :3, 3], T[:, :3, 3] * (1 - 1e-4 * np.array([[1.0], [1 / np.e]])), rtol=1e-12)


def test_growth_of_all_lengths_is_a_growth_of_the_tip_position(cell, q):
    table = cell.arm.table
    longer = replace(table, a=table.a * 1.001, d=table.d * 1.001)
    T = cell.arm.with_table(longer).forward(q)
    np.testing.assert_allclose(T[:, :3, 3], 1.001 * cell.arm.forward(q)[:, :3, 3], atol=1e-12)


def test_harmonics_are_sines_of_the_joint(cell):
    waves = robot_effects.Harmonics(waves=((2, 3, 0.01, 30.0), (-1, 2, 0.02, 0.0)))
    found = change_of_joints(cell, waves, [[0, 20.0, 0, 0, 0, 45.0]])
    np.testing.assert_allclose(found[0], [0, 0.01, 0, 0, 0, 0.02], atol=1e-15)  # sin(3 * 20 + 30), sin(2 * 45)


def test_repeatability_has_the_stated_sigmas(cell):
    part = robot_effects.Repeatability(sigma_deg=(0.001, 0.002, 0.003, 0.004, 0.005, 0.006))
    found = change_of_joints(cell, part, np.zeros((20_000, 6)))
    np.testing.assert_allclose(found.std(axis=0), part.sigma_deg, rtol=0.03)
