"""The reader: what it takes, and the one sentence for everything that it does not."""

import gzip
import hashlib
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.text_files import text_lines

HEADER = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,target,x_mm,y_mm,z_mm"
ROW = "1,10,20,30,40,50,60,smr1,100,200,300"


def write(tmp_path, *lines, name="m.csv", newline="\n"):
    path = tmp_path / name
    path.write_bytes((newline.join(lines) + newline).encode())
    return path


def refused(path):
    with pytest.raises(MeasurementError) as caught:
        table.read(path)
    text = str(caught.value)
    assert str(path) in text
    assert "\n" not in text
    return text


def test_values_units_and_lost_points(tmp_path):
    path = write(
        tmp_path,
        HEADER + ",operator",
        ROW + ",Åsa",
        "1,10,20,30,40,50,60,smr2,,,,x",
        "2,11,20,30,40,50,60,smr1,0,0,0,",
        "2,11,20,30,40,50,60,smr2,NaN,1,2,",
        "2,11,20,30,40,50,60,ref1,0,1,2,",
    )
    seen = table.read(path)
    assert seen.poses == 2
    assert np.abs(seen.joints() - np.radians([[10, 20, 30, 40, 50, 60], [11, 20, 30, 40, 50, 60]])).max() < 1e-15
    assert np.isnan(seen.positions()).any(axis=1).tolist() == [False, True, True, True, False]
    assert np.abs(seen.positions()[0] - [0.1, 0.2, 0.3]).max() < 1e-15
    assert seen.table["operator"][0] == "Åsa"
    assert seen.is_reference().tolist() == [False] * 4 + [True]
    assert not seen.simulated


def test_a_compressed_file_is_that_file(tmp_path):
    plain = write(tmp_path, HEADER, ROW).read_bytes()
    packed = tmp_path / "m.csv.gz"
    packed.write_bytes(gzip.compress(plain))
    pd.testing.assert_frame_equal(table.read(packed).table, table.read(tmp_path / "m.csv").table)
    assert text_lines(str(packed)) == text_lines(str(tmp_path / "m.csv"))
    assert table.read(packed).sha256 == hashlib.sha256(packed.read_bytes()).hexdigest()
    packed.write_bytes(packed.read_bytes()[:-9])
    with pytest.raises(MeasurementError, match="not a gzip file that can be read"):
        table.read(packed)
    packed.write_bytes(gzip.compress(bytes(300 * 10**6), 1))
    with pytest.raises(MeasurementError, match="at most 200 MB when unpacked"):
        table.read(packed)


def test_column_order_line_ends_and_byte_order_mark(tmp_path):
    columns = HEADER.split(",")
    values = ROW.split(",")
    order = np.random.default_rng(0).permutation(len(columns))
    path = write(
        tmp_path,
        "\ufeff" + ",".join(f" {columns[k]} " for k in order),
        ",".join(values[k] for k in order),
        "",
        newline="\r\n",
    )
    straight = table.read(write(tmp_path, HEADER, ROW, name="s.csv"))
    mixed = table.read(path)
    assert np.array_equal(mixed.joints(), straight.joints())
    assert np.array_equal(mixed.positions(), straight.positions())


def test_simulated_column_speaks_for_the_file(tmp_path):
    assert table.read(write(tmp_path, HEADER + ",simulated", ROW + ",yes")).simulated
    assert not table.read(write(tmp_path, HEADER + ",simulated", ROW + ",no")).simulated


def test_cycles_are_poses_of_their_own(tmp_path):
    path = write(tmp_path, HEADER + ",cycle", ROW + ",1", ROW.replace("10", "12", 1) + ",2")
    assert table.read(path).poses == 2


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([HEADER.replace(",q3_deg", ""), ROW], "row 1: missing column q3_deg; found pose, q1_deg"),
        ([HEADER.replace("_mm", "_m"), ROW], "positions are expected in millimetres"),
        ([HEADER, ROW, "2,a b,0,0,0,0,0,smr1,1,2,3"], "row 3, column q1_deg: expected a joint angle in degrees, found 'a b'"),
        ([HEADER, ROW, "2,,0,0,0,0,0,smr1,1,2,3"], "row 3, column q1_deg: expected a joint angle in degrees, found nothing"),
        ([HEADER, "2,0,0,0,0,0,nan,smr1,1,2,3"], "row 2, column q6_deg: expected a joint angle in degrees, found 'nan'"),
        ([HEADER, "2,0,0,0,0,0,inf,smr1,1,2,3"], "row 2, column q6_deg: expected a joint angle in degrees, found 'inf'"),
        ([HEADER, ROW, "", "2,0,0,0,0,0,0,smr1,1,2,3.4.5"], "row 4, column z_mm: expected a position within 1 km in mm or nothing, found '3.4.5'"),
        ([HEADER, "2,0,0,0,0,0,0,,1,2,3"], "row 2, column target: expected a name, found nothing"),
        ([HEADER, ROW, ROW.replace("20", "21", 1)], "row 3, column q2_deg: expected the joints of pose 1 as in row 2, found 21"),
        ([HEADER], "the file has a header but no rows"),
        ([""], "the file is empty"),
        ([HEADER, ROW, ROW + ",7,8"], "row 3: expected 11 values, found 13"),
        ([HEADER + ",q1_deg", ROW + ",3"], "column 'q1_deg' stands there more than once"),
        ([HEADER, ROW.replace("smr1", "a\x00b")], "found binary data"),
    ],
)  # fmt: skip
def test_refusals_name_file_row_and_column(tmp_path, lines, expected):
    assert expected in refused(write(tmp_path, *lines))


def test_not_a_file_and_not_text(tmp_path):
    assert "there is no such file" in refused(tmp_path / "none.csv")
    assert "found a folder" in refused(tmp_path)
    path = tmp_path / "latin.csv"
    path.write_bytes((HEADER + "\n" + ROW + "\n").encode() + b"2,0,0,0,0,0,0,Z\xfcrich,1,2,3\n")
    assert "row 3: expected UTF-8 text" in refused(path)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_refused_in_one_sentence(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("fuzz") / "m.csv"
    path.write_bytes(data)
    with pytest.raises(MeasurementError):
        table.read(path)


CELL = st.sampled_from(
    ["", "0", "1.5", "-3e2", "nan", "inf", "x", "0x10", " 7 ", "1,5", "é", "smr1", "ref1", '"', "1e999"]
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.lists(CELL, min_size=11, max_size=11), min_size=1, max_size=5))
def test_any_cells_are_read_or_refused_in_one_sentence(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("fuzz") / "m.csv"
    path.write_text("\n".join([HEADER, *(",".join(row) for row in rows)]), encoding="utf-8")
    try:
        seen = table.read(path)
    except MeasurementError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(seen.joints()).all()
        xyz = seen.positions()
        assert not (xyz == 0).all(axis=1).any()
        assert not np.isinf(xyz).any()


@given(st.lists(st.floats(-1e4, 1e4), min_size=9, max_size=9))
def test_numbers_come_through_to_the_last_digits(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("digits") / "m.csv"
    cells = [repr(v) for v in values]
    path.write_text(f"{HEADER}\np,{','.join(cells[:6])},t,{','.join(cells[6:])}\n")
    seen = table.read(path)
    assert np.abs(np.degrees(seen.joints()[0]) - values[:6]).max() <= 1e-11
    if any(values[6:]):
        assert np.abs(seen.positions()[0] * 1e3 - values[6:]).max() <= 1e-11


def test_orientations_and_uncertainties(tmp_path):
    header = HEADER + ",qw,qx,qy,qz,u95_mm"
    path = write(tmp_path, header, ROW + ",0.70710678,0,0,0.70710678,0.02", ROW.replace("smr1", "smr2") + ",,,,,")
    seen = table.read(path)
    R = seen.rotations()
    assert np.abs(R[0] - [[0, -1, 0], [1, 0, 0], [0, 0, 1]]).max() < 1e-8
    assert np.abs(R[0] @ R[0].T - np.eye(3)).max() < 1e-15
    assert np.isnan(R[1]).all()
    assert seen.uncertainties()[0] == pytest.approx(2e-5)
    assert "missing column qz" in refused(write(tmp_path, HEADER + ",qw,qx,qy", ROW + ",1,0,0"))
    assert "row 2, columns qw, qx, qy, qz: expected a unit quaternion or nothing, found 2, 0, 0, 0" in refused(
        write(tmp_path, header, ROW + ",2,0,0,0,")
    )
    assert "found 1, nan, 0, 0" in refused(write(tmp_path, header, ROW + ",1,,0,0,"))


# ---------------------------------------------------------------- from DataFrames


LINES = [
    HEADER + ",group,qw,qx,qy,qz,u95_mm,simulated",
    ROW + ",iso,1,0,0,0,0.02,yes",
    "1,10,20,30,40,50,60,ref1,,,,iso,,,,,,yes",
    "P2,-11.125,20,30,40,50,60,smr1,0.1,-7.25e2,300,,0.6,0,0.8,0,,yes",
]


def test_a_data_frame_reads_as_its_file(tmp_path):
    path = write(tmp_path, *LINES)
    frame = pd.read_csv(path)
    before = frame.copy()
    from_file, seen = table.read(path), table.read(frame.sample(frac=1, random_state=0).sort_index())
    assert seen.source == "<DataFrame>"
    assert seen.table.drop(columns="row").equals(from_file.table.drop(columns="row"))
    assert seen.table["row"].tolist() == [1, 2, 3], "positions plus one"
    assert seen.simulated
    assert frame.equals(before)
    assert seen.sha256 == table.read(frame).sha256
    frame.loc[0, "x_mm"] += 1e-9
    assert table.read(frame).sha256 != seen.sha256


def test_what_was_read_is_taken_as_it_is(tmp_path):
    seen = table.read(write(tmp_path, *LINES))
    assert table.read(seen) is seen
    again = table.read(seen.to_frame())
    assert again.to_frame().equals(seen.to_frame())
    assert list(seen.to_frame().columns)[:11] == HEADER.split(",")
    assert table.read(seen.table).to_frame().equals(seen.to_frame())


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("q3_deg", "x", "<DataFrame>: row 3, column q3_deg: expected a joint angle in degrees, found 'x'"),
        ("q3_deg", np.nan, "<DataFrame>: row 3, column q3_deg: expected a joint angle in degrees, found nothing"),
        ("q3_deg", 1e5, "<DataFrame>: row 3, column q3_deg: expected a joint angle in degrees, found 100000"),
        ("target", None, "<DataFrame>: row 3, column target: expected a name, found nothing"),
        ("qw", 0.7, "<DataFrame>: row 3, columns qw, qx, qy, qz: expected a unit quaternion or nothing, found 0.7, 0, 0.8, 0"),
        ("u95_mm", -1, "<DataFrame>: row 3, column u95_mm: expected an uncertainty above zero in mm or nothing, found -1"),
        ("pose", 1, "<DataFrame>: row 3, column q1_deg: expected the joints of pose 1 as in row 1, found -11.125"),
    ],
)  # fmt: skip
def test_refusals_of_a_data_frame_name_row_and_column(tmp_path, column, value, expected):
    frame = pd.read_csv(write(tmp_path, *LINES)).astype(object)
    frame.index = [5, 6, 7]
    frame.loc[7, column] = value
    with pytest.raises(MeasurementError) as caught:
        table.read(frame)
    assert str(caught.value) == expected
    assert caught.value.row == 3


def test_a_data_frame_without_a_column_and_what_is_no_table(tmp_path):
    frame = pd.read_csv(write(tmp_path, *LINES))
    with pytest.raises(MeasurementError) as caught:
        table.read(frame.drop(columns="q3_deg"))
    assert str(caught.value).startswith("<DataFrame>: missing column q3_deg; found pose, q1_deg")
    with pytest.raises(MeasurementError, match=r"expected measurements .*, found array"):
        table.read(np.zeros((3, 3)))


def test_an_arm_with_other_joints_is_refused(tmp_path):
    seen = table.read(write(tmp_path, HEADER.replace(",q6_deg", ""), "1,1,2,3,4,5,smr1,1,2,3"))
    with pytest.raises(MeasurementError, match=r"row 1: missing column q6_deg: .* has 6 joints between") as caught:
        seen.check_joints(arm())
    assert (caught.value.file, caught.value.row) == (seen.source, 1)


# ---------------------------------------------------------------- as a result


def test_nobody_can_change_measurements(tmp_path):
    frame = pd.read_csv(write(tmp_path, *LINES))
    seen = table.read(frame)
    before = seen.table
    xyz, q = seen.positions().copy(), seen.joints().copy()
    frame["x_mm"] = 7.0
    for own in (seen.table, seen.to_frame()):
        for column in own.columns:
            own[column] = 0
            own.loc[:, column] = 0
    for array in (seen.positions(), seen.joints(), seen.rotations(), seen.uncertainties(), seen.is_reference()):
        if array.flags.writeable:
            array[:] = 0
    with pytest.raises(FrozenInstanceError):
        seen.table = frame
    assert seen.table.equals(before)
    assert np.array_equal(seen.positions(), xyz, equal_nan=True)
    assert np.array_equal(seen.joints(), q)
    other = seen.with_table(before.assign(pose="x"))
    assert set(other.table["pose"]) == {"x"}
    assert seen.table.equals(before)


def test_measurements_travel_and_speak(tmp_path):
    seen = table.read(write(tmp_path, *LINES))
    again = pickle.loads(pickle.dumps(seen))
    assert again.table.equals(seen.table)
    assert (again.source, again.sha256) == (seen.source, seen.sha256)
    assert repr(seen) == f"<MeasurementSet: {seen.source}: 3 rows, 2 poses, 1 lost points, SIMULATED>"
    targets, groups = seen.report()[1:]
    assert targets.rows == (("ref1", "reference", 1, 1), ("smr1", "tool", 2, 0))
    assert groups.rows == (("iso", 1), ("", 1))
    assert "SIMULATED" in seen.summary()
    assert "<table>" in seen._repr_html_()
    with pytest.raises(AttributeError, match="no attribute 'tabel'"):
        _ = seen.tabel


def test_results_that_hold_measurements_are_measurements(tmp_path):
    class Holder:
        def __init__(self, held):
            self.held = held

        def measurements(self):
            return self.held

    seen = table.read(write(tmp_path, HEADER, ROW))
    assert table.read(Holder(seen)) is seen


@pytest.mark.parametrize("source", [None, 5, ["a.csv"]])
def test_what_holds_no_measurements_is_refused(source):
    with pytest.raises(MeasurementError, match=r"expected measurements .* found") as refused:
        table.read(source)
    assert refused.value.parameter == "measurements"


def test_reflectors_are_no_references():
    names = ["ref1", "REF_left", "reference", "reflector1", "Reflektor_links", "smr1"]
    assert [table.names_reference(name) for name in names] == [True, True, True, False, False, False]
