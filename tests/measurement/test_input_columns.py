"""Columns of an input beside what was computed for its rows."""

import numpy as np
import pandas as pd

from irbcal.measurement.input_table import with_input_columns

GIVEN = pd.DataFrame(
    {"pose": ["007", "8"], "x_mm": ["+1.50", ""], "given_x_mm": ["a", "b"], "note": ["x", "1"]},
    index=[2, 5],
    dtype=object,
)
FOUND = pd.DataFrame({"x_mm": [3.0, 4.0]})


def test_nothing_is_lost_and_names_stay_apart():
    table = with_input_columns(GIVEN, FOUND, as_written=True)
    assert list(table.columns) == ["pose", "given_given_x_mm", "given_x_mm", "note", "x_mm"]
    assert table["given_given_x_mm"].tolist() == ["+1.50", ""]
    assert table["x_mm"].tolist() == [3.0, 4.0]
    assert with_input_columns(None, FOUND) is FOUND


def test_numbers_are_numbers_and_names_are_names():
    table = with_input_columns(GIVEN, FOUND)
    np.testing.assert_array_equal(table["given_given_x_mm"], [1.5, np.nan])
    assert table["pose"].tolist() == ["007", "8"]
    assert table["note"].tolist() == ["x", "1"]


def test_what_is_no_finite_number_stays_a_text():
    given = pd.DataFrame({"label": ["-Infinity", "1", "1e999"], "speed": ["1", "2", ""]}, dtype=object)
    table = with_input_columns(given, pd.DataFrame({"q": [1.0, 2.0, 3.0]}))
    assert table["label"].tolist() == ["-Infinity", "1", "1e999"]
    np.testing.assert_array_equal(table["speed"], [1.0, 2.0, np.nan])


def test_rows_of_the_input_repeat():
    table = with_input_columns(GIVEN, pd.DataFrame({"q": [1.0, 2.0, 3.0]}), row=np.array([1, 1, 0]))
    assert table["pose"].tolist() == ["8", "8", "007"]
    assert table["q"].tolist() == [1.0, 2.0, 3.0]
