"""What repeats with every turn: waves of the joints and of their frames."""

from dataclasses import replace

import numpy as np
import pytest
from cell_support import change_of_joints, motion_of

from irbcal.modeling.terms.term import AXES
from irbcal.simulation import turning_effects
from irbcal.units import DEG, MM


def test_harmonics_are_sines_of_the_joint(cell):
    waves = turning_effects.Harmonics(waves=((2, 3, 0.01, 30.0), (-1, 2, 0.02, 0.0)))
    found = change_of_joints(cell, waves, [[0, 20.0, 0, 0, 0, 45.0]])
    np.testing.assert_allclose(found[0], [0, 0.01, 0, 0, 0, 0.02], atol=1e-15)  # sin(3 * 20 + 30), sin(2 * 45)


def test_a_harmonic_drive_swings_twice_with_every_input_turn(cell):
    gear = turning_effects.Gear(waves=((4, 121, 0.003, 0.0), (-1, 50, 0.004, 90.0)))
    turn = 360.0 / 121  # of joint 4, while its input turns once
    joints = [[0, 0, 0, turn * share, 0, 360.0 / 50 * share] for share in (0.0, 0.125, 0.25, 0.5, 1.0)]
    found = change_of_joints(cell, gear, joints)
    np.testing.assert_allclose(found[:, 3], [0, 0.003, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found[:, 5], [0.004, 0, -0.004, 0.004, 0.004], atol=1e-12)
    assert not found[:, [0, 1, 2, 4]].any()


def test_a_bearing_that_runs_out_moves_the_frame(cell):
    wobble = turning_effects.Wobble(waves=((2, "ry", 1, 0.004, 0.0), (-1, "tz", 2, 0.02, 90.0)))
    found = wobble.frames(motion_of(cell, [[0, 30.0, 0, 0, 0, 45.0], [0, 90.0, 0, 0, 0, 90.0]]), None)
    expected = np.zeros((2, 6, 6))
    expected[:, 1, AXES.index("ry")] = [0.002 * DEG, 0.004 * DEG]
    expected[:, 5, AXES.index("tz")] = [0.0, -0.02 * MM]  # cos(90), cos(180)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    bare = cell.only().replace(table=cell.arm.table)
    joints = np.radians([[10.0, 20.0, -30.0, 40.0, 50.0, 90.0]])
    straight, moved = bare.measure(joints), bare.with_effect(wobble).measure(joints)
    shift = moved.T_base_tip[0, :3, 3] - straight.T_base_tip[0, :3, 3]
    lone = bare.with_effect(turning_effects.Wobble(waves=((-1, "tz", 2, 0.02, 90.0),))).measure(joints)
    along = lone.T_base_tip[0, :3, 3] - straight.T_base_tip[0, :3, 3]
    np.testing.assert_allclose(along, -0.02 * MM * straight.T_base_tip[0, :3, 2], atol=1e-9)  # the tool's axis
    assert np.linalg.norm(shift - along) == pytest.approx(0.004 * DEG * np.sin(np.radians(20.0)) * 1.1, rel=0.3)


def test_arms_with_fewer_joints_have_fewer_waves(cell):
    whole = motion_of(cell, np.zeros((1, 6)))
    few = replace(whole, **{k: v[:, :2] for k, v in vars(whole).items() if v.ndim > 1}, prismatic=whole.prismatic[:2])
    assert turning_effects.Gear().joints(few, None).shape == (1, 2)
    assert turning_effects.Wobble().frames(few, None).shape == (1, 2, 6)
