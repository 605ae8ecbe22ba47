"""The cells that come with irbcal: the thesis's IRB 1600, and other arms."""

import numpy as np
import pytest
from cell_support import OTHERS, THREE, robot_file

from irbcal.identification.fit import identify
from irbcal.measurement.points import distances
from irbcal.simulation import procedure
from irbcal.simulation.shipped import open_cell
from irbcal.units import MM


def test_the_shipped_tracker_stands_where_the_thesis_had_it(cell):
    """Tables A I-1 and A III-1: target 1 at the five ISO poses as the thesis's tracker saw it."""
    joints = np.radians(
        [
            [0.0, -14.0, 14.0, 0.0, 0.0, 0.0],
            [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
            [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
            [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
            [41.373, -24.788, 47.145, 66.643, -46.052, -58.108],
        ]
    )
    seen = [
        [1568.937, 753.352, -234.817],
        [1184.504, 700.874, 31.782],
        [1512.934, 1135.976, 36.515],
        [1952.791, 806.731, -502.204],
        [1625.478, 372.956, -505.890],
    ]
    run = cell.without("visibility", "lost").measure(joints)
    assert np.linalg.norm(run.xyz[:, 0] / MM - seen, axis=1).max() < 3.0  # the nominal robot errs by up to 2 mm


@pytest.mark.parametrize("name", list(OTHERS))
def test_other_arms_have_a_cell_too(name, tmp_path):
    base, tip = OTHERS[name]
    cell = open_cell(robot_file(name, tmp_path), base, tip, robot_seed=3).with_targets(THREE)
    joints = procedure.random_poses(cell, 150, seed=1)
    level = "34" if cell.arm.six_revolute else "placement"

    def heldout(setting, model):
        points = setting.measure(joints).points()
        fitted = np.arange(points.poses) < 110
        return distances(identify(cell.arm, points.select(fitted), model).robot, points.select(~fitted)).mean()

    assert heldout(cell.only("noise"), level) < 20e-6
    assert 30e-6 < heldout(cell, level) < 0.7 * heldout(cell, "nominal")
