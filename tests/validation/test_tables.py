"""What validation takes out of tables."""

import numpy as np
import pandas as pd
import pytest

from irbcal.validation import tables

TABLE = pd.DataFrame({"x_mm": [1.0, 2.0], "y_mm": [0.0, 0.0], "z_mm": [5, 6], "run": [" b", "a "]})


def test_places_are_in_metres():
    assert tables.places(TABLE) == pytest.approx(np.array([[0.001, 0, 0.005], [0.002, 0, 0.006]]))


def test_names_are_those_of_the_file_in_its_order():
    found = tables.names(TABLE, "run")
    assert found.tolist() == ["b", "a"]
    assert tables.in_order([*found, "b"]) == ["b", "a"]
    assert tables.names(TABLE, "end") is None
