"""Files of the checks show what was put into them."""

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.practice.checks import NOISE, SCALE_BAR_MM


def test_the_scale_bar_has_its_length(written):
    found = irbcal.tracker(written.folder / "bar.csv", length=SCALE_BAR_MM * 1e-3).to_frame()
    errors = found.select_dtypes("number")
    assert len(found) == 20
    points = pd.read_csv(written.folder / "bar.csv")[["x_mm", "y_mm", "z_mm"]].to_numpy().reshape(-1, 2, 3)
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    assert np.abs(length - SCALE_BAR_MM).max() < 5 * NOISE
    assert len(errors.columns)


def test_the_path_cuts_its_corner_by_two_millimetres(written):
    found = irbcal.iso9283(path=written.folder / "path.csv", commanded_path=written.folder / "commanded_path.csv")
    assert pytest.approx(2.0e-3, abs=5e-5) == found.path.errors.AT
    assert "SIMULATED" in found.summary()


def test_the_compliance_is_what_was_put_in(written):
    table = pd.read_csv(written.folder / "forces.csv")
    x = table[table["direction"] == "+x"]
    assert np.polyfit(x["force_n"], x["x_mm"], 1)[0] == pytest.approx(0.02, abs=1e-4)
    assert "0.020" in irbcal.iso9283(forces=written.folder / "forces.csv").summary()


def test_the_controller_has_a_longer_link(written):
    found = irbcal.controller(written.folder / "reported.csv", written.folder / "my_robot.urdf")
    told = found.summary()
    assert "0.300" in told
    assert "a3" in told or "a4" in told


def test_the_circle_is_about_the_ballbars_length(written):
    table = pd.read_csv(written.folder / "circle.csv")
    assert len(table) == 360
    assert table["radius_mm"].mean() == pytest.approx(150.0, abs=1e-3)
    assert 0.05 < np.ptp(table["radius_mm"]) < 2.0
