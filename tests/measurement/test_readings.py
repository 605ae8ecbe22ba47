"""Tables of readings: numbers, labels, optional columns and lost points."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import readings

FRAME = pd.DataFrame(
    {
        "position": ["a", "a", "b"],
        "time_s": [0.0, 1.5, 2.0],
        "x_mm": [1.0, 0.0, np.nan],
        "y_mm": [2.0, 0.0, 1.0],
        "z_mm": [3.0, 0.0, 1.0],
        "note": ["x", None, "y"],
        "qw": 0.0,
        "qx": 0.0,
        "qy": 1.0,
        "qz": 0.0,
    }
)


def test_columns_by_what_they_hold(tmp_path):
    path = tmp_path / "r.csv"
    FRAME.to_csv(path, index=False)
    for source, row in ((path, 2), (FRAME, 1)):
        found = readings.read(source, ["time_s"], ["position"], ["x_mm"])
        assert found["time_s"].tolist() == [0.0, 1.5, 2.0]
        assert found["position"].tolist() == ["a", "a", "b"]
        assert found["x_mm"].isna().tolist() == [False, False, True]
        assert found["note"].tolist() == ["x", "", "y"]
        assert found["row"].tolist() == [row, row + 1, row + 2]
    assert found.attrs["source"] == "<DataFrame>"
    with pytest.raises(
        MeasurementError, match="row 3, column x_mm: expected a position within 1 km in mm, found nothing"
    ):
        readings.read(FRAME, ["x_mm"])
    with pytest.raises(MeasurementError, match="missing column who"):
        readings.read(FRAME, ["time_s"], ["who"])


def test_lost_points_are_left_out():
    found = readings.read_points(FRAME, ["position"], ["time_s"])
    assert found["time_s"].tolist() == [0.0]
    assert found.attrs == {"source": "<DataFrame>", "lost": 2}
    with pytest.raises(MeasurementError, match="<DataFrame>: every point is lost"):
        readings.read_points(FRAME.iloc[1:])
    with pytest.raises(MeasurementError) as caught:
        readings.read_points(FRAME.drop(columns="z_mm"))
    assert str(caught.value) == "<DataFrame>: missing column z_mm"


def test_orientations():
    found = readings.rotations(readings.read(FRAME, []))
    assert np.abs(found - np.diag([-1.0, 1.0, -1.0])).max() < 1e-15
    gap = FRAME.astype(object)
    gap.loc[1, ["qw", "qx", "qy", "qz"]] = None
    assert readings.rotations(readings.read(gap, [])) is None
    assert readings.rotations(readings.read(FRAME.drop(columns=["qw", "qx", "qy", "qz"]), [])) is None


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [("x_mm", "1e308", "a position within 1 km"), ("time_s", "1e300", "a number within ±")],
)
def test_numbers_that_no_instrument_writes_are_refused(tmp_path, column, value, words):
    header = ["time_s", "x_mm", "y_mm", "z_mm"]
    row = [value if name == column else "1" for name in header]
    (tmp_path / "r.csv").write_text(f"{','.join(header)}\n1,1,1,1\n{','.join(row)}\n")
    with pytest.raises(MeasurementError, match=rf"row 3, column {column}: expected {words}"):
        readings.read_points(tmp_path / "r.csv", numbers=["time_s"])
