"""Refusals: one sentence for people, the same facts as data."""

import pickle
from pathlib import Path

import pytest

from irbcal.errors import IrbcalError, MeasurementError, OptionError, ProgramError


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ({}, "no."),
        ({"file": Path("a.csv")}, "a.csv: no."),
        ({"file": "a.csv", "row": 3}, "a.csv: row 3: no."),
        ({"file": "a.mod", "line": 3}, "a.mod: line 3: no."),
        ({"file": "a.csv", "row": 3, "column": "x_mm"}, "a.csv: row 3, column x_mm: no."),
        ({"file": "a.csv", "column": ("qw", "qx")}, "a.csv: columns qw, qx: no."),
        ({"parameter": "gain_2"}, "no."),
    ],
)
def test_the_place_stands_before_the_message_and_in_the_error(place, sentence):
    error = MeasurementError("no.", **place)
    assert str(error) == sentence
    assert error.row == place.get("row", place.get("line"))
    assert error.file == (str(place["file"]) if "file" in place else None)
    assert error.parameter == place.get("parameter")


def test_errors_survive_a_process_boundary():
    error = pickle.loads(pickle.dumps(ProgramError("no.", file="a.mod", line=7, column=("a", "b"))))
    assert isinstance(error, ProgramError)
    assert (str(error), error.file, error.row, error.column) == ("a.mod: line 7, columns a, b: no.", "a.mod", 7, "a, b")


def test_unknown_options_list_what_is_known():
    error = OptionError.unknown("order", "lst", ["random", "last"])
    assert str(error) == "order: expected random or last, found 'lst': did you mean last?"
    assert error.parameter == "order"
    assert isinstance(error, IrbcalError)
    assert str(OptionError.unknown("x", 1, ["a", "b", "c"])) == "x: expected a, b or c, found 1"
    assert str(OptionError.unknown("x", 1, ["a"])) == "x: expected a, found 1"
