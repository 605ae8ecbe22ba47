"""Scale bars on small tables worked out by hand."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.validation.tracker_check import scale_bar


def test_scale_bar_by_hand(tmp_path):
    path = written(
        tmp_path / "bar.csv",
        """position,end,x_mm,y_mm,z_mm
        1,A,1000,0,0
        1,B,2050.690,0,0
        1,A,1000,0,0
        1,B,2050.684,0,0
        2,A,0,500,7
        2,B,0,1550.691,7
        """,
    )
    found = scale_bar(path, 1.050688).to_dict()
    assert found["error_mm"] == pytest.approx([0.002, -0.004, 0.003], abs=1e-9)
    assert found["mean_mm"] == pytest.approx(0.001 / 3, abs=1e-9)
    assert found["max_abs_mm"] == pytest.approx(0.004, abs=1e-9)
    assert found["per_position"]["1"]["mean_mm"] == pytest.approx(-0.001, abs=1e-9)
    assert found["per_position"]["1"]["sigma_mm"] == pytest.approx(0.006 / np.sqrt(2), abs=1e-9)
    assert found["per_position"]["2"]["n"] == 1
    with pytest.raises(MeasurementError, match="another bar"):
        scale_bar(path, 2.3)


def test_scale_bar_refusals(tmp_path):
    path = written(tmp_path / "odd.csv", "end,x_mm,y_mm,z_mm\nA,1,0,0\nB,2,0,0\nA,1,0,0\n")
    with pytest.raises(MeasurementError, match="end A was measured 2 times, end B 1 times"):
        scale_bar(path, 1e-3)
    path = written(tmp_path / "one.csv", "end,x_mm,y_mm,z_mm\nA,1,0,0\n")
    with pytest.raises(MeasurementError, match="expected two names, found A"):
        scale_bar(path, 1e-3)
    path = written(tmp_path / "d.csv", "distance_mm\n1000.001\n999.998\n")
    assert scale_bar(path, 1.0).to_dict()["error_mm"] == pytest.approx([0.001, -0.002], abs=1e-9)


def test_what_a_scale_bar_tells(tmp_path):
    path = written(tmp_path / "d.csv", "position,distance_mm\nA,1000.001\nA,999.998\nB,1000.002\nB,1000\n")
    found = scale_bar(path, 1.0)
    assert found.positions() == ["A", "B"]
    assert found.to_frame()["error_mm"].tolist() == pytest.approx([0.001, -0.002, 0.002, 0.0], abs=1e-9)
    assert repr(found) == "<ScaleBar: 4 distances of a scale bar: errors of +0.0003 mm on average, 0.0020 mm at most.>"
    lines = found.summary().splitlines()
    assert "scale bar of 1000 mm, mm" in lines[1]
    assert lines[-1].split() == ["B", "2", "0.0010", "0.0014", "0.0020", "0.0014"]
    with pytest.raises(ValueError, match="read-only"):
        found.error[0] = 0.0
    with pytest.raises(OptionError, match="above zero"):
        scale_bar(path, 0.0)
    with pytest.raises(
        MeasurementError, match="row 3, column distance_mm: expected a number, found nothing"
    ) as refused:
        scale_bar(written(tmp_path / "gap.csv", "position,distance_mm\nA,1000.001\nA,\n"), 1.0)
    assert (refused.value.row, refused.value.column) == (3, "distance_mm")
