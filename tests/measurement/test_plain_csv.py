"""Plain files read fast are what they are cell by cell; all others are left to the slow way, which can name a fault."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import table, table_columns

HEAD = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,target,x_mm,y_mm,z_mm,u95_mm,note\n"
ROWS = "a1,1.5,-2,3e-1, 4,5,6,smr1,1,2,3,0.1,x y\n'=b,0,0,0,0,0,0,sm\u00e9,,,,,\n'=b,0,0,0,0,0,0,smr1,0,0,0,,7\n"


def ways(text, monkeypatch):
    """Measurements read as a short file, by pyarrow and cell by cell; the sentence where they are refused."""

    def read():
        try:
            return table.parse(text.encode(), "m.csv")
        except MeasurementError as error:
            return str(error)

    short = read()
    monkeypatch.setattr(table_columns, "LONG_FILE", 0)
    fast = read()
    monkeypatch.setattr(table_columns, "parse_plain", lambda *_: None)
    slow = read()
    monkeypatch.undo()
    return short, fast, slow


def plain(text):
    names = HEAD.strip().split(",")
    return table_columns.parse_plain(text.encode(), names, lambda name: name.endswith(("_deg", "_mm")))


@pytest.mark.parametrize("start", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["", "a9,1,1,1,1,1,1,smr1,123.456789,0.1,1e-3,0.2,last"])
def test_plain_files_are_read_alike(monkeypatch, start, end):
    assert plain(start + HEAD + ROWS + end) is not None
    assert (
        table_columns._plain_cells(HEAD + ROWS + end, HEAD.strip().split(","), lambda name: name == "q1_deg")
        is not None
    )
    short, fast, slow = ways(start + HEAD + ROWS + end, monkeypatch)
    pd.testing.assert_frame_equal(fast.table, slow.table, check_exact=True)
    pd.testing.assert_frame_equal(short.table, slow.table, check_exact=True)
    assert short.sha256 == fast.sha256 == slow.sha256
    assert fast.table["pose"].tolist()[:3] == ["a1", "=b", "=b"]
    assert np.isnan(fast.positions()[1:3]).all()


@pytest.mark.parametrize(
    "text",
    [
        (HEAD + ROWS).replace("\n", "\r\n"),
        HEAD.replace("\n", "\r\n") + ROWS,
        ",".join(f'"{name}"' for name in HEAD.strip().split(",")) + "\n" + ROWS,
        HEAD + ROWS.replace("x y", '"x, ""y"""').replace("smr1", '"smr1"').replace("-2", '"-2"'),
        HEAD + ROWS.replace("x y", 'a "x" y').replace(",7", ',""'),
    ],
)
def test_windows_lines_and_quoted_cells_are_plain(monkeypatch, text):
    assert plain(text) is not None
    short, fast, slow = ways(text, monkeypatch)
    pd.testing.assert_frame_equal(fast.table, slow.table, check_exact=True)
    pd.testing.assert_frame_equal(short.table, slow.table, check_exact=True)


@pytest.mark.parametrize(
    "text",
    [
        HEAD + "\n" + ROWS,  # a blank line
        "\n" + HEAD + ROWS,
        HEAD + "," * 12 + "\n" + ROWS,  # a line of commas
        HEAD + ROWS.replace("x y", '"x\ny"'),
        HEAD + ROWS.replace("x y", '2"'),  # a quote that does not end
        HEAD + ROWS.replace("x y", "x\ry"),
        HEAD + ROWS.replace("1.5", "inf"),
        HEAD + ROWS.replace("1.5", "1e999"),  # as large as no number can be
        HEAD + ROWS.replace("0.1", "NaN"),
        HEAD + ROWS.replace("1.5", "1.5x"),
        HEAD + ROWS.replace("1.5,", ""),
        HEAD + ROWS.replace("1.5", "1_5"),
    ],
)
def test_other_files_are_read_cell_by_cell(monkeypatch, text):
    assert plain(text) is None
    short, fast, slow = ways(text, monkeypatch)
    for way in (short, fast):
        assert isinstance(way, str) or way.table.equals(slow.table)
        assert not isinstance(way, str) or way == slow


@pytest.mark.parametrize(
    ("old", "new"), [("1.5", ""), ("1.5", "nan"), ("a1", " "), ("smr1", "\x1b[2J"), ("1.5", "1e9"), ("0.1", "-1")]
)
def test_a_fault_is_named_alike(monkeypatch, old, new):
    short, fast, slow = ways(HEAD + ROWS.replace(old, new, 1), monkeypatch)
    assert short == fast == slow
    assert "m.csv: row 2, column" in fast
