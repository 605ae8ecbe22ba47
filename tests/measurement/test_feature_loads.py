import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement.load_columns import payloads, usual_place

CELLS = pd.DataFrame({"payload_kg": ["0", "5.5", ""]}, index=[2, 3, 4])
PLACED = pd.DataFrame(
    {"payload_kg": ["0", "5.5"], "payload_x_mm": ["", "10"], "payload_y_mm": ["", "0"], "payload_z_mm": ["", "120"]},
    index=[2, 3],
)


def test_masses_and_places_are_read_in_si_units():
    load, place = payloads(PLACED, "rows.csv")
    np.testing.assert_array_equal(load, [0.0, 5.5])
    np.testing.assert_allclose(place, [[0, 0, 0], [0.01, 0, 0.12]])
    assert usual_place(load, place, 0.0) == pytest.approx((0.01, 0.0, 0.12))
    assert payloads(CELLS.iloc[[1, 2]], "rows.csv")[0].tolist() == [5.5, 5.5]
    assert payloads(CELLS[[]], "rows.csv") == (None, None)


def test_which_of_several_masses_must_be_told():
    with pytest.raises(MeasurementError, match=r"row 4.*write 0 for a bare flange"):
        payloads(CELLS, "rows.csv")
    with pytest.raises(MeasurementError, match="missing column payload_y_mm"):
        payloads(PLACED.drop(columns="payload_y_mm"), "rows.csv")
    with pytest.raises(MeasurementError, match="expected the place of the payload"):
        payloads(PLACED.assign(payload_x_mm=""), "rows.csv")
    with pytest.raises(MeasurementError, match="expected a mass from 0"):
        payloads(CELLS.assign(payload_kg=["0", "-1", "2"]), "rows.csv")
