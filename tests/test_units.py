"""The only conversion factors."""

import numpy as np
import pandas as pd
import pytest

from irbcal import units
from irbcal.errors import MeasurementError
from irbcal.measurement.input_table import InputTable


def test_factors_take_surface_values_to_si():
    assert pytest.approx(0.65, abs=1e-15) == 650 * units.MM
    assert np.pi == 180 * units.DEG
    assert {si: (name, factor) for si, (name, factor) in units.UNIT_OUTSIDE.items()} == {
        "m": ("mm", units.MM),
        "rad": ("deg", units.DEG),
        "1": ("1", 1.0),
    }


@pytest.mark.parametrize("name", ["q2", "other_q2", "c2"])
def test_joints_in_radians_are_columns_of_degrees(name):
    """Half a turn, a blank and what is no number, which is refused as it stands."""
    frame = pd.DataFrame({f"{name}_rad": [str(np.pi), "", "x"], "point": ["a", "b", "c"]})
    table = InputTable.read(frame, [f"{name}_deg"])
    assert table.names == [f"{name}_deg", "point"]
    np.testing.assert_allclose(table[np.array([0, 1])].numbers(f"{name}_deg", lost=True), [180.0, np.nan], atol=1e-12)
    with pytest.raises(MeasurementError, match=f"row 3, column {name}_deg: expected .*, found 'x'"):
        table.numbers(f"{name}_deg", lost=True)
