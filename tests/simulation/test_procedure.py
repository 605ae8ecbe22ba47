"""The thesis's campaign in the cell against its tables."""

import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
import pytest

from irbcal.simulation import procedure
from irbcal.simulation.shipped import open_cell


@pytest.fixture(scope="module")
def tables():
    """The functions of scripts/thesis/cell_tables."""
    path = Path(__file__).parents[2] / "scripts" / "thesis" / "cell_tables"
    loader = SourceFileLoader("cell_tables", str(path))
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        loader.exec_module(module := module_from_spec(spec_from_loader("cell_tables", loader)))
    finally:
        sys.dont_write_bytecode = written
    return module


def test_nominal_errors_are_those_of_table_7_1_and_34_parameters_leave_a_third(tables):
    cell = open_cell("irb1600")
    poses = procedure.campaign(cell, identification=150, verification=1600, seed=5)
    measured = procedure.measure(cell, poses)
    found = tables.errors(tables.nominal(cell, tables.by_axes(cell, measured)), measured.verification)
    np.testing.assert_allclose(found[:, 0], [1.004, 0.961], rtol=0.10)
    np.testing.assert_allclose(found[:, 2], [1.890, 2.268], rtol=0.25)  # of 1,600 points, not 8,000
    fit = tables.identified(cell, measured, "34", (76, 70), 0, method="nelder-mead")
    found = tables.errors(fit, measured.verification)
    np.testing.assert_allclose(found[:, 0], [0.272, 0.321], rtol=0.35)
    np.testing.assert_allclose(found[:, 2], [0.714, 0.858], rtol=0.35)
