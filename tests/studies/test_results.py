"""Rows by what they say; a table as text, as a frame and as JSON."""

import pytest

from irbcal.studies.results import Cell, Table
from irbcal.studies.settings import NOMINAL, Repetition


def test_a_number_with_the_thesis_s_beside():
    assert str(Cell(0.12345, 0.5)) == "0.123 (0.500)"
    assert str(Cell(0.12345)) == "0.123"
    assert Cell(1.0).beside == ""


def test_rows_by_what_they_say(results):
    row = results.row(NOMINAL, "expected", "iso_cube")
    assert row["unit"] == "mm"
    assert results.row(NOMINAL, "poses", "all_range", quantity="orientation")["unit"] == "deg"
    assert results.has(NOMINAL, Repetition("34", 80, 2))
    assert not results.has(NOMINAL, Repetition("34", 80, 3))
    with pytest.raises(KeyError):
        results.row(NOMINAL, "expected", "iso_cube", 4)


def test_a_table_speaks_and_is_a_frame(tables):
    table = tables["7.1"]
    assert table.heading == "Table 7.1. Nominal model, expected position error of 8 targets (mm)"
    frame = table.to_frame()
    assert frame["μ (thesis)"].tolist() == [1.004, 0.961, 0.970, 0.979]
    assert frame["μ"].tolist() == [row[2].value for row in table.rows]
    assert "SIMULATED" in table.summary()
    assert f"{table.rows[0][2].value:.3f} (1.004)" in table.summary()
    assert len(repr(table)) < 2000
    assert table.to_dict()["rows"][0][2] == {"value": table.rows[0][2].value, "thesis": 1.004}
    words = Table("targets", "Words", ("a", "n"), (("x", 3),))
    assert words.heading == "Words"
    assert words.to_frame().to_dict("list") == {"a": ["x"], "n": [3]}
