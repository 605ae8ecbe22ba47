"""Tables as text and their columns: the same from a file and from a DataFrame, and errors that carry their place."""

import hashlib
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irbcal.errors import MeasurementError
from irbcal.measurement import columns

TEXT = "name,q1_deg,q2_mm,x_mm,y_mm,z_mm\na,1.5,2,3,4,5\n\nb,-0.25,1e-3,,1,2\n"


def refused(function, *arguments, **options):
    with pytest.raises(MeasurementError) as caught:
        function(*arguments, **options)
    return caught.value


def test_a_file_and_a_data_frame_are_the_same_cells(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(TEXT)
    cells, source, digest = columns.read(path, ["name", "q1_deg"])
    assert (source, digest) == (str(path), hashlib.sha256(TEXT.encode()).hexdigest())
    assert cells.index.tolist() == [2, 4], "lines of the file"
    frame = pd.read_csv(StringIO(TEXT)).set_index(pd.Index([9, 9]))
    same = columns.read(frame, ["name", "q1_deg"])
    assert same.source == "<DataFrame>"
    assert same.cells.index.tolist() == [1, 2], "positions plus one"
    assert same.sha256 == hashlib.sha256(frame.to_csv(index=False).encode()).hexdigest()
    for name in ("q1_deg", "q2_mm", "x_mm"):
        one, other = (columns.numbers(c, name, "s", "a number", lost=True) for c in (cells, same.cells))
        assert np.array_equal(one, other, equal_nan=True)
    assert frame.index.tolist() == [9, 9], "the caller's table stays as it is"


@given(st.lists(st.floats(-1e12, 1e12), min_size=1, max_size=20))
def test_numbers_of_a_data_frame_come_through(values):
    cells = columns.read(pd.DataFrame({"a": values}), ["a"]).cells
    found = columns.numbers(cells, "a", "s", "a number")
    assert np.abs(found - values).max() <= 1e-15 * np.abs(values).max()


def test_what_is_missing_in_a_data_frame_is_nothing():
    frame = pd.DataFrame(
        {"a": [1.0, np.nan, None], "b": ["x", None, pd.NA], "c": pd.array([1, None, 3], dtype="Int64")}
    )
    cells = columns.read(frame, []).cells
    assert cells["b"].tolist() == ["x", "", ""]
    assert cells["c"].tolist() == ["1", "", "3"]
    assert np.array_equal(columns.numbers(cells, "a", "s", "a number", lost=True), [1, np.nan, np.nan], equal_nan=True)
    error = refused(columns.names, cells, "b", "s")
    assert (error.file, error.row, error.column) == ("s", 2, "b")


def test_refusals_carry_file_row_and_column(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n3,x\n")
    cells, source, _ = columns.read(path, ["a", "b"])
    error = refused(columns.numbers, cells, "b", source, "a number")
    assert (error.file, error.row, error.column) == (str(path), 3, "b")
    assert str(error) == f"{path}: row 3, column b: expected a number, found 'x'"
    error = refused(columns.read, path, ["c"])
    assert (error.file, error.row) == (str(path), 1)
    assert str(error) == f"{path}: row 1: missing column c; found a, b"
    error = refused(columns.read, cells, ["c"])
    assert str(error) == "<DataFrame>: missing column c; found a, b"
    assert error.row is None
    assert str(refused(columns.read, cells.iloc[:0], ["a"])) == "<DataFrame>: the table has a header but no rows"
    twice = pd.DataFrame([[1, 2]], columns=["a", " a "])
    assert str(refused(columns.read, twice, ["a"])) == "<DataFrame>: column 'a' stands there more than once"


def test_joints_of_any_arm():
    names = ["q2_deg", "x", "q1_mm", "q3_deg", "q5_deg", "q12_mm", "q0_deg", "q3_rad"]
    assert columns.joint_columns(names) == ["q1_mm", "q2_deg", "q3_deg"]
    assert columns.joint_units(["q1_mm", "q2_deg"]).tolist() == [1e-3, np.pi / 180]
    columns.check_header(["q1_mm", "q2_deg"], [columns.ALL_JOINTS], "s")
    assert "missing column q2_deg" in str(
        refused(columns.check_header, ["q1_deg", "q3_deg"], [columns.ALL_JOINTS], "s")
    )
    error = refused(columns.check_header, ["q1_deg", "q1_mm"], [columns.ALL_JOINTS], "s")
    assert str(error) == "s: row 1: joint 1 stands there in degrees and in mm"


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("q1_deg", 1.1e4, "expected a joint angle in degrees, found 11000"),
        ("q2_mm", -1.1e6, "expected a joint's travel in mm, found -1.1e+06"),
        ("x_mm", 2e6, "expected a position within 1 km in mm, found 2e+06"),
        ("u95_mm", 0.0, "expected an uncertainty above zero in mm or nothing, found 0"),
    ],
)
def test_sizes_that_no_cell_holds(column, value, expected):
    lost = column == "u95_mm"
    cells = columns.read(pd.DataFrame({column: [0.5, value]}), [column]).cells
    assert columns.in_si(cells[:1], [column], "s", lost).item() == 0.5 * columns.declared(column).unit
    error = refused(columns.numbers, cells, column, "s", lost=lost)
    assert (error.row, error.column) == (2, column)
    assert str(error).endswith(expected)


def test_lost_points():
    xyz = np.array([[1.0, 2, 3], [0, 0, 0], [0, 0, 1], [np.nan, 1, 2]])
    assert columns.lost_points(xyz).tolist() == [False, True, False, True]


@pytest.mark.parametrize("name", ["a\x1b[2J", "tab\tin", "line\nend"])
def test_names_that_would_act_on_a_terminal(name):
    cells = columns.read(pd.DataFrame({"target": ["good", name]}), ["target"]).cells
    error = refused(columns.names, cells, "target", "s")
    assert (error.row, error.column) == (2, "target")


def test_parquet(tmp_path):
    frame = pd.read_csv(StringIO(TEXT))
    path = tmp_path / "t.parquet"
    pytest.importorskip("pyarrow")
    frame.to_parquet(path)
    cells = columns.read(path, ["name"]).cells
    assert cells.equals(columns.read(frame, ["name"]).cells)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a,b\x0bc,d\n1,2,3\n", "missing column q1_deg|expected"),
        (b"a\x0b,q1_deg\n1,2\x0b3\n", "expected a number, found"),
        (b"q1_deg," + b"x" * 140_000 + b"\n1,2\n", "expected column names"),
        (b"q1_deg,a\n1,2,3\n1,2,3\n", "expected 2 values in each row|as many values"),
    ],
)
def test_line_ends_of_other_systems_and_long_cells_are_no_accident(data, words):
    """\\x0b ends no line of a CSV file; a header beyond csv's limit is refused, not a traceback."""
    with pytest.raises(MeasurementError, match=words):
        columns.numbers(columns.parse(data, "m.csv", ["q1_deg"]).cells, "q1_deg", "m.csv", "a number")
