"""Repeatability of fixed points on a small table worked out by hand."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError
from irbcal.validation.tracker_check import repeatability


def test_repeatability_by_hand(tmp_path):
    path = written(
        tmp_path / "repeat.csv",
        "position,x_mm,y_mm,z_mm\nP1,1,0,9\nP1,-1,0,9\nP2,5,5,1\nP1,0,2,9\nP1,0,-2,9\nP2,5,5,3\nP2,0,0,0\n",
    )
    found = repeatability(path).to_dict()
    first, second = found["per_position"]["P1"], found["per_position"]["P2"]
    assert (first["n"], second["n"], found["lost"]) == (4, 2, 1)
    assert first["mean_mm"] == pytest.approx(1.5)
    assert first["mean_plus_3sigma_mm"] == pytest.approx(1.5 + 3 * np.sqrt(1 / 3))
    assert [second[k] for k in ("x_mm", "y_mm", "z_mm", "max_mm")] == pytest.approx([5, 5, 2, 1])
    with pytest.raises(MeasurementError, match="one reading only"):
        repeatability(written(tmp_path / "r1.csv", "x_mm,y_mm,z_mm\n1,2,3\n"))


def test_what_repeatability_tells(tmp_path):
    text = "position,x_mm,y_mm,z_mm\nP1,1,0,9\nP1,-1,0,9\nP2,5,5,1\nP2,5,5,5\nP2,0,0,0\n"
    found = repeatability(written(tmp_path / "r.csv", text))
    assert (
        found.headline() == "4 readings of 2 points: mean + 3σ of the distances from the mean 2.0000 mm at most (P2)."
    )
    assert found.report()[-1] == "Left out: 1 lost points"
    table = found.to_frame()
    assert table.columns.tolist() == ["position", "x_mm", "y_mm", "z_mm", "error_mm"]
    assert table["error_mm"].tolist() == pytest.approx([1, 1, 2, 2])
    assert len(repr(found)) < 2000
