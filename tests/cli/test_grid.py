"""Rows for programs, lists of numbers from the command line."""

import json

import numpy as np
import pandas as pd
import pytest
import typer

from irbcal.cli import grid


def test_rows_as_csv_and_as_json(capsys):
    frame = pd.DataFrame({"x_mm": [1.0, np.nan], "note": ["", "far"]})
    grid.write(frame, as_json=False)
    assert capsys.readouterr().out == "x_mm,note\n1.000000000,\n,far\n"
    grid.write(frame, as_json=True)
    lines = capsys.readouterr().out.splitlines()
    assert [json.loads(line) for line in lines] == [{"x_mm": 1.0, "note": ""}, {"x_mm": None, "note": "far"}]


def test_numbers():
    assert grid.numbers("1,-2.5, 3e1", [3], "--near") == [1.0, -2.5, 30.0]
    for text in ("1,2", "1,2,x", "1,2,inf", ""):
        with pytest.raises(typer.BadParameter, match=r"expected 3 or 4 numbers \(a, b, c\), found"):
            grid.numbers(text, [3, 4], "--cube", ("a", "b", "c"))
