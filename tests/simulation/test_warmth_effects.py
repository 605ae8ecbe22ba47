"""What warmth does: each against its formula."""

from dataclasses import replace

import numpy as np
from cell_support import motion_of

from irbcal.modeling.terms.term import AXES
from irbcal.simulation import warmth_effects
from irbcal.units import DEG, MM


def test_warm_up_follows_its_formula(cell):
    warm = warmth_effects.WarmUp(before_min=0.0, tau_min=40.0, growth=1e-4, joint_deg=(0.004, -0.006))
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


def test_frames_thaw_with_one_time_constant(cell):
    drifts = warmth_effects.Thaw(12.0, *[tuple(row) for row in np.arange(36.0).reshape(6, 6)])
    motion = motion_of(cell, np.zeros((3, 6)), time_s=np.array([0.0, 12 * 60.0, 1e6]))
    found = drifts.frames(motion, None)
    assert found[0, 2, AXES.index("ry")] == (6 + 2) * DEG
    assert found[0, 5, AXES.index("tz")] == (30 + 5) * MM
    np.testing.assert_allclose(found[1], found[0] / np.e, rtol=1e-12)
    assert np.abs(found[2]).max() < 1e-20  # nothing is left
