"""Tables that are read: the same from a file and from a DataFrame, each column checked, errors that carry their place."""

import hashlib
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import (
    ALL_JOINTS,
    POSITION,
    QUATERNION,
    check_header,
    declared,
    joint_columns,
    joint_units,
)
from irbcal.measurement.input_table import InputTable, column_names, lost_points, read_targets
from irbcal.measurement.motions import usual_centre

TEXT = "name,q1_deg,q2_mm,x_mm,y_mm,z_mm\na,1.5,2,3,4,5\n\nb,-0.25,1e-3,,1,2\n"


def refused(function, *arguments, **options):
    with pytest.raises(MeasurementError) as caught:
        function(*arguments, **options)
    return caught.value


def test_a_file_and_a_data_frame_are_the_same_cells(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(TEXT)
    table = InputTable.read(path, ["name", "q1_deg"])
    assert (table.source, table.sha256) == (str(path), hashlib.sha256(TEXT.encode()).hexdigest())
    assert table.rows.tolist() == [2, 4], "lines of the file"
    frame = pd.read_csv(StringIO(TEXT)).set_index(pd.Index([9, 9]))
    same = InputTable.read(frame, ["name", "q1_deg"])
    assert same.source == "<DataFrame>"
    assert same.rows.tolist() == [1, 2], "positions plus one"
    assert same.sha256 == hashlib.sha256(frame.to_csv(index=False).encode()).hexdigest()
    for name in ("q1_deg", "q2_mm", "x_mm"):
        assert np.array_equal(table.numbers(name, lost=True), same.numbers(name, lost=True), equal_nan=True)
    assert frame.index.tolist() == [9, 9], "the caller's table stays as it is"


def spelt(rows, delimiter, mark, encoding):
    lines = [delimiter.join(f'"{cell}"' if delimiter in cell else cell for cell in row) for row in rows]
    return "\r\n".join(lines).replace("#", mark).encode(encoding)


ROWS = [["pose", "q1_deg", "note", "x_mm"], ["1,1", "-1#5", 'a "b"', "1234#25"], [], ["1,2", "2#5e-3", "c,d; e", "0"]]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_a_spreadsheet_may_write_a_table_its_own_way(tmp_path, delimiter, decimal, encoding):
    """Delimiters, decimal marks and encodings of a spreadsheet's exports; names such as 1,1 are no numbers."""
    path = tmp_path / "t.csv"
    path.write_bytes(spelt(ROWS, delimiter, decimal, encoding))
    table = InputTable.read(path, ["pose", "q1_deg"])
    assert table.rows.tolist() == [2, 4]
    assert table.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert table.numbers("q1_deg").tolist() == [-1.5, 0.0025]
    assert table.numbers("x_mm").tolist() == [1234.25, 0.0]
    assert table.texts("pose").tolist() == ["1,1", "1,2"]
    assert table.texts("note").tolist() == ['a "b"', "c,d; e"]
    assert column_names(path) == ROWS[0]


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_blank_lines_before_the_header_count(tmp_path, delimiter):
    path = tmp_path / "t.csv"
    path.write_text("\n\npose,q1_deg\n\n1,2\n".replace(",", delimiter))
    table = InputTable.read(path)
    assert table.rows.tolist() == [5]
    assert table.numbers("q1_deg").tolist() == [2.0]


def test_names_in_the_encoding_of_a_windows_spreadsheet(tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes("target;x_mm\nPrüfpunkt;1,5\n".encode("cp1252"))
    assert InputTable.read(path).texts("target").tolist() == ["Prüfpunkt"]
    path.write_bytes("target,x_mm\nPrüfpunkt,1.5\n".encode("cp1252"))  # irbcal's format is UTF-8
    assert "expected UTF-8 text" in str(refused(InputTable.read, path))


def test_commas_that_may_be_marks_of_thousands_are_no_decimal_ones(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a\tb\n1,234\t5,678\n")
    assert "expected a number, found '1,234'" in str(refused(InputTable.read(path).numbers, "a"))
    path.write_text("a;b\n1,25;5.678\n")
    assert "column a: expected a number, found '1,25'" in str(refused(InputTable.read(path).numbers, "a"))
    path.write_text("x_mm;remark\n1,25;20.5\n")
    assert InputTable.read(path).numbers("x_mm").tolist() == [1.25]
    path.write_text("a;b\n1,234;5\n2.345,5;6\n")
    assert InputTable.read(path).numbers("a").tolist() == [1.234, 2345.5]
    path.write_text('a;b\n"1;2\n')
    assert "t.csv: not a table: unexpected end of data" in str(refused(InputTable.read, path))
    path.write_bytes("a;b\n1;2\n".encode("utf-16")[:-1])
    assert "expected UTF-8 text, found other bytes" in str(refused(InputTable.read, path))


@settings(max_examples=40)
@given(st.lists(st.floats(-1e12, 1e12), min_size=1, max_size=20))
def test_numbers_of_a_data_frame_come_through(values):
    numbers = InputTable.read(pd.DataFrame({"a": values}), ["a"]).numbers("a")
    assert np.abs(numbers - values).max() <= 1e-15 * np.abs(values).max()


def test_what_is_missing_in_a_data_frame_is_nothing():
    frame = pd.DataFrame(
        {"a": [1.0, np.nan, None], "b": ["x", None, pd.NA], "c": pd.array([1, None, 3], dtype="Int64")}
    )
    table = InputTable.read(frame)
    assert table.cells["b"].tolist() == ["x", "", ""]
    assert table.cells["c"].tolist() == ["1", "", "3"]
    assert np.array_equal(table.optional("a"), [1, np.nan, np.nan], equal_nan=True)
    assert np.isnan(table.optional("d")).all()
    assert table.texts("b").tolist() == ["x", "", ""]
    assert table.texts("d", "usual").tolist() == ["usual"] * 3
    error = refused(table.filled, "b")
    assert (error.file, error.row, error.column) == ("<DataFrame>", 2, "b")


def test_refusals_carry_file_row_and_column(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n3,x\n")
    table = InputTable.read(path, ["a", "b"])
    error = refused(table.numbers, "b")
    assert (error.file, error.row, error.column) == (str(path), 3, "b")
    assert str(error) == f"{path}: row 3, column b: expected a number, found 'x'"
    error = refused(table[np.array([False, True])].choice, "b", ("y", "z"))
    assert str(error) == f"{path}: row 3, column b: expected y, z, found 'x'"
    error = refused(InputTable.read, path, ["c"])
    assert (error.file, error.row) == (str(path), 1)
    assert str(error) == f"{path}: row 1: missing column c; found a, b"
    assert str(refused(InputTable.read, path, ["a"], ["a"])) == (f"{path}: row 1: there is a column b: expected only a")
    assert str(refused(table.either, "a", "b")) == f"{path}: row 1: expected a column a or b, found both a and b"
    error = refused(InputTable.read, table.cells, ["c"])
    assert str(error) == "<DataFrame>: missing column c; found a, b"
    assert error.row is None
    assert str(refused(InputTable.read, table.cells.iloc[:0])) == "<DataFrame>: the table has a header but no rows"
    twice = pd.DataFrame([[1, 2]], columns=["a", " a "])
    assert str(refused(InputTable.read, twice, ["a"])) == "<DataFrame>: column 'a' stands there more than once"


def test_joints_of_any_arm():
    names = ["q2_deg", "x", "q1_mm", "q3_deg", "q5_deg", "q12_mm", "q0_deg", "q3_rad"]
    assert joint_columns(names) == ["q1_mm", "q2_deg", "q3_deg"]
    assert joint_units(["q1_mm", "q2_deg"]).tolist() == [1e-3, np.pi / 180]
    check_header(["q1_mm", "q2_deg"], [ALL_JOINTS], "s")
    assert "missing column q2_deg" in str(refused(check_header, ["q1_deg", "q3_deg"], [ALL_JOINTS], "s"))
    assert "small letters: pose" in str(refused(check_header, ["Pose", "b"], ["pose", "target"], "s"))
    error = refused(check_header, ["q1_deg", "q1_mm"], [ALL_JOINTS], "s")
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
    table = InputTable.read(pd.DataFrame({column: [0.5, value]}), [column])
    assert table[np.array([0])].si([column], lost).item() == 0.5 * declared(column).unit
    error = refused(table.numbers, column, lost)
    assert (error.row, error.column) == (2, column)
    assert str(error).endswith(expected)


def test_lost_points():
    xyz = np.array([[1.0, 2, 3], [0, 0, 0], [0, 0, 1], [np.nan, 1, 2]])
    assert lost_points(xyz).tolist() == [False, True, False, True]


@pytest.mark.parametrize("name", ["a\x1b[2J", "tab\tin", "line\nend"])
def test_names_that_would_act_on_a_terminal(name):
    error = refused(InputTable.read(pd.DataFrame({"target": ["good", name]})).texts, "target")
    assert (error.row, error.column) == (2, "target")


def test_parquet(tmp_path):
    frame = pd.read_csv(StringIO(TEXT))
    path = tmp_path / "t.parquet"
    pytest.importorskip("pyarrow")
    frame.to_parquet(path)
    assert InputTable.read(path, ["name"]).cells.equals(InputTable.read(frame, ["name"]).cells)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a,b\x0bc,d\n1,2,3\n", "missing column q1_deg|expected"),
        (b"a\x0b,q1_deg\n1,2\x0b3\n", "expected a number, found"),
        (b"q1_deg," + b"x" * 140_000 + b"\n1,2\n", "expected column names"),
        (b"q1_deg,a\n1,2,3\n1,2,3\n", "row 2: expected 2 values, found 3"),
    ],
)
def test_line_ends_of_other_systems_and_long_cells_are_no_accident(data, words):
    """\\x0b ends no line of a CSV file; a header beyond csv's limit is refused, not a traceback."""
    with pytest.raises(MeasurementError, match=words):
        InputTable.parse(data, "m.csv", ["q1_deg"]).numbers("q1_deg", expected="a number")


READINGS = pd.DataFrame(
    {
        "time_s": [0.0, 1.5, 2.0],
        "x_mm": [1.0, 0.0, np.nan],
        "y_mm": [2.0, 0.0, 1.0],
        "z_mm": [3.0, 0.0, 1.0],
        "qw": 0.0,
        "qx": 0.0,
        "qy": 1.0005,
        "qz": 0.0,
    }
)


def test_lost_points_are_left_out():
    assert InputTable.read(READINGS).measured().si("time_s").tolist() == [0.0]
    with pytest.raises(MeasurementError, match="<DataFrame>: every point is lost"):
        InputTable.read(READINGS.iloc[1:]).measured()
    assert str(refused(InputTable.read(READINGS.drop(columns="z_mm")).measured)).startswith(
        "<DataFrame>: missing column z_mm; found"
    )


def test_times_grow_and_words_are_some():
    table = InputTable.read(READINGS.assign(time_s=[0, 2, 2], way=["Up", "down", "up"]))
    assert table.choice("way", ("up", "down")).tolist() == ["up", "down", "up"]
    assert table.choice("side", ("left", "right"), "left").tolist() == ["left"] * 3
    assert refused(table.ascending, "time_s").row == 3
    assert InputTable.read(READINGS).ascending("time_s").tolist() == [0.0, 1.5, 2.0]


def test_orientations_are_exactly_unit_or_refused():
    R = InputTable.read(READINGS).rotations()
    assert np.abs(R - np.diag([-1.0, 1.0, -1.0])).max() < 1e-15
    gap = READINGS.astype(object)
    gap.loc[1, QUATERNION] = None
    assert InputTable.read(gap).rotations() is None
    assert np.isnan(InputTable.read(gap).rotations(lost=True)).any(axis=(1, 2)).tolist() == [False, True, False]
    assert InputTable.read(READINGS.drop(columns=QUATERNION)).rotations() is None
    half = gap.copy()
    half.loc[1, "qw"] = 1.0
    for wrong in (half, READINGS.assign(qy=[1.0, 1.01, 1.0])):
        error = refused(InputTable.read(wrong).rotations)
        assert (error.row, error.column) == (2, "qw, qx, qy, qz")
    assert "missing column qx" in str(refused(InputTable.read(READINGS.drop(columns="qx")).rotations))


def test_joints_of_a_rail_and_a_data_frame():
    frame = pd.DataFrame({"q2_deg": [90.0, 0.0], "q1_mm": [250, -1]}, index=[7, 7])
    names = ["q1_mm", "q2_deg"]
    assert np.abs(InputTable.read(frame, names).joints(names) - [[0.25, np.pi / 2], [-0.001, 0]]).max() < 1e-15
    error = refused(InputTable.read(frame.assign(q1_mm=["1", "x"]), names).joints, names)
    assert str(error) == "<DataFrame>: row 2, column q1_mm: expected a joint's travel in mm, found 'x'"


def test_poses():
    half = np.sqrt(0.5)
    frame = pd.DataFrame([[1, 2, 3, half, 0, 0, half]], columns=[*POSITION, *QUATERNION])
    T = InputTable.read(frame).poses()[0]
    assert np.abs(T - [[0, -1, 0, 0.001], [1, 0, 0, 0.002], [0, 0, 1, 0.003], [0, 0, 0, 1]]).max() < 1e-15
    assert "column z_mm: expected a position within 1 km in mm, found -1e+308" in str(
        refused(InputTable.read(frame.assign(z_mm=-1e308)).poses)
    )
    assert refused(InputTable.read(frame.assign(qw=None, qx=None, qy=None, qz=None)).poses).column == "qw"


def test_known_targets():
    frame = pd.DataFrame([["smr1", 10, 20, 30], [" smr2 ", -1, 0, 0.5]], columns=["target", *POSITION])
    targets = read_targets(frame)
    assert list(targets) == ["smr1", "smr2"]
    assert np.abs(np.array(list(targets.values())) - [[0.01, 0.02, 0.03], [-0.001, 0, 0.0005]]).max() < 1e-18
    error = refused(read_targets, frame.assign(target="a"))
    assert str(error) == "<DataFrame>: row 2, column target: 'a' stands there more than once"


def test_rows_of_one_pose_have_the_same_joints():
    frame = pd.DataFrame({"pose": ["a", "b", " a"], "target": ["s", "s", "t"], "q1_deg": ["1", "2", "1"]})
    table, targets = InputTable.read(frame).one_row_a_pose(["q1_deg"])
    assert np.abs(np.degrees(table.joints(["q1_deg"])) - [[1], [2]]).max() < 1e-12
    assert targets.tolist() == ["s t", "s"]
    assert len(InputTable.read(frame.assign(cycle=["1", "1", "2"])).one_row_a_pose(["q1_deg"])[0]) == 3
    assert InputTable.read(frame.drop(columns="target")).one_row_a_pose(["q1_deg"])[1] is None
    frame.loc[2, "q1_deg"] = "1.5"
    error = refused(InputTable.read(frame).one_row_a_pose, ["q1_deg"])
    assert str(error) == (
        "<DataFrame>: row 3, column q1_deg: expected the joints of the pose's first row (1), found '1.5'"
    )


LOADS = pd.DataFrame({"payload_kg": ["0", "5.5", ""]}, index=[2, 3, 4])
PLACED = pd.DataFrame(
    {"payload_kg": ["0", "5.5"], "payload_x_mm": ["", "10"], "payload_y_mm": ["", "0"], "payload_z_mm": ["", "120"]},
    index=[2, 3],
)


def test_masses_and_their_centres_are_read_in_si_units():
    load, centre = InputTable(PLACED).inputs(6).values()
    np.testing.assert_array_equal(load, [0.0, 5.5])
    np.testing.assert_allclose(centre, [[0, 0, 0], [0.01, 0, 0.12]], rtol=0, atol=1e-15)
    assert usual_centre(load, centre, 0.0) == pytest.approx((0.01, 0.0, 0.12))
    assert InputTable(LOADS.iloc[[1, 2]]).inputs(6)["payload_kg"].tolist() == [5.5, 5.5]
    assert InputTable(LOADS[[]]).inputs(6) == {}


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (LOADS, r"row 4.*write 0 for a bare flange"),
        (PLACED.drop(columns="payload_y_mm"), "missing column payload_y_mm"),
        (PLACED.assign(payload_x_mm=""), "expected the place of the payload"),
        (LOADS.assign(payload_kg=["0", "-1", "2"]), "expected a mass from 0"),
    ],
)
def test_which_of_several_masses_must_be_told(cells, words):
    with pytest.raises(MeasurementError, match=words):
        InputTable(cells).inputs(6)
