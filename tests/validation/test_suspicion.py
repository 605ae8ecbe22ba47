"""Measurements of another frame are refused; those with larger errors than ever are doubted."""

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import MeasurementError
from irbcal.io import robots


@pytest.fixture(scope="module")
def rows():
    table = pd.read_csv(robots.demo_file("demo_verification.csv"))
    return table[(table["pose"] <= 40) & ~table["target"].str.startswith("ref")]


def test_points_from_elsewhere_are_refused(record, rows):
    with pytest.raises(MeasurementError, match="not measured in its frame"):
        irbcal.evaluate(record, rows.assign(x_mm=rows["x_mm"] + 3000.0, y_mm=rows["y_mm"] * 0.7))


def test_larger_errors_than_ever_are_doubted(record, rows):
    xyz, noisy = ["x_mm", "y_mm", "z_mm"], rows.copy()
    noisy[xyz] += np.random.default_rng(2).normal(0, 1.5, (len(rows), 3))
    found = irbcal.evaluate(record, noisy)
    assert any("something has changed since" in doubt for doubt in found.verdict.doubts)
    assert not any("something has changed since" in doubt for doubt in irbcal.evaluate(record, rows).verdict.doubts)
