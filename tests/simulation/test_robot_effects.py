"""Effects of the robot that are neither weight, turns, way nor warmth."""

import numpy as np
from cell_support import change_of_joints

from irbcal.simulation import robot_effects
from irbcal.units import DEG


def test_tilts_join_the_table(cell):
    tilts = robot_effects.Tilt(beta_deg=(0.0, 0.0, 0.014, 0.0, 0.02, 0.0))
    table = tilts.table(cell.arm.table)
    np.testing.assert_allclose(table.beta - cell.arm.table.beta, np.array(tilts.beta_deg) * DEG, atol=1e-15)


def test_repeatability_has_the_stated_sigmas(cell):
    part = robot_effects.Repeatability(sigma_deg=(0.001, 0.002, 0.003, 0.004, 0.005, 0.006))
    found = change_of_joints(cell, part, np.zeros((20_000, 6)))
    np.testing.assert_allclose(found.std(axis=0), part.sigma_deg, rtol=0.03)
