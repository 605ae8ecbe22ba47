"""The shipped cell, for all its tests."""

import pytest
from cell_support import THREE

from irbcal.simulation import pose_list
from irbcal.simulation.shipped_cells import open_cell


@pytest.fixture(scope="module")
def cell():
    """The shipped cell with three targets."""
    return open_cell("irb1600").with_targets(THREE)


@pytest.fixture(scope="module")
def q(cell):
    """300 random poses in the tracker's sight."""
    return pose_list.random_poses(cell, 300, seed=4)
