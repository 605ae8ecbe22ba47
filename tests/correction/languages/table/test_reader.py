"""CSV programs: what is read, and the one sentence for everything else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm

from irbcal.correction.languages import table
from irbcal.correction.program import Given
from irbcal.errors import OptionError, ProgramError
from irbcal.files.controller_frames import unknown
from irbcal.measurement.columns import JOINTS as JOINT_COLUMNS
from irbcal.modeling import frames

JOINTS = "name,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,note"
POSES = "x_mm,y_mm,z_mm,qw,qx,qy,qz,speed"
ROW = "a,10,-20,30,-40.5,50,60,v100"
POSE = "100,-200,300,0.7071,0,0,-0.7071,v100"


def data(*lines, newline="\n"):
    return (newline.join(lines) + newline).encode()


def refused(content):
    with pytest.raises(ProgramError) as caught:
        table.parse(content, "p.csv")
    text = str(caught.value)
    assert text.startswith("p.csv: ")
    assert "\n" not in text
    return text


def test_joints_are_read_in_radians():
    seen = table.parse(data(JOINTS, ROW, "", ROW.replace("60", "-.5e1")))
    assert seen.kind == "joint"
    assert np.abs(np.degrees(seen.values) - [[10, -20, 30, -40.5, 50, 60], [10, -20, 30, -40.5, 50, -5]]).max() < 1e-12
    assert seen.rows.tolist() == [2, 4]
    assert seen.fingerprint is None
    assert seen.fingerprint is None
    with pytest.raises(ValueError, match="read-only"):
        seen.values[0, 0] = 0.0


def test_poses_are_read_in_metres():
    seen = table.parse(data(POSES, POSE))
    assert seen.kind == "pose"
    assert np.abs(seen.values[0] - frames.transform(frames.rot_z(-np.pi / 2), [0.1, -0.2, 0.3])).max() < 1e-15


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (data(JOINTS.replace("q3_deg", "q3"), ROW), "row 1: missing column q3_deg; found name, q1_deg"),
        (data(JOINTS.replace("_deg", "_rad"), ROW), "joints are expected in degrees (q1_deg … q6_deg), found radians"),
        (data(POSES.replace("qz", "q4"), POSE), "row 1: missing column qz; found x_mm"),
        (data("a,b", "1,2"), "row 1: expected columns q1_deg … q6_deg (joints) or x_mm, y_mm, z_mm, qw, qx, qy, qz (poses), found a, b"),
        (data(JOINTS + "," + POSES, ROW + "," + POSE), "row 1: expected columns of joints or of poses, found both"),
        (data(JOINTS + ",q1_deg", ROW + ",1"), "row 1: column 'q1_deg' stands there more than once"),
        (data(JOINTS, ROW, ROW.replace("30", "x")), "row 3, column q3_deg: expected a joint angle in degrees, found 'x'"),
        (data(JOINTS, ROW, ROW.replace("30", "1_0")), "row 3, column q3_deg: expected a joint angle in degrees, found '1_0'"),
        (data(JOINTS, ROW, ROW.replace("30", "٣")), "row 3, column q3_deg: expected a joint angle in degrees, found '٣'"),
        (data(JOINTS, ROW, ROW.replace("30", "")), "row 3, column q3_deg: expected a joint angle in degrees, found nothing"),
        (data(JOINTS, ROW.replace("30", "inf")), "row 2, column q3_deg: expected a joint angle in degrees, found 'inf'"),
        (data(JOINTS, ROW.replace("30", "9E9")), "row 2, column q3_deg: expected a number up to 1e+09, found '9E9'"),
        (data(POSES, POSE, POSE.replace("-200", "y")), "row 3, column y_mm: expected a position in mm, found 'y'"),
        (data(POSES, POSE.replace("0.7071", "0.5")), "row 2, columns qw, qx, qy, qz: expected a unit quaternion, found 0.5, 0, 0, -0.5"),
        (data(POSES, POSE.replace(",0,", ",,", 1)), "row 2, column qx: expected a component of a quaternion, found nothing"),
        (data(JOINTS), "the file has a header but no rows"),
        (data(JOINTS, ROW, ROW + ",7,8"), "not a table with as many values in each row as names"),
        (data(JOINTS.replace(",", ";"), ROW), "expected commas between the columns, found semicolons"),
        (data(JOINTS, ROW) + b"\xfc", "row 3: expected UTF-8 text"),
        (b"\x00", "binary data"),
        (b" \n", "the file is empty"),
    ],
)  # fmt: skip
def test_refusals_name_file_row_and_column(content, expected):
    assert expected in refused(content)


def test_files(tmp_path):
    path = tmp_path / "p.csv"
    path.write_bytes(data(JOINTS, ROW))
    assert table.read(path).values.shape == (1, 6)
    for wrong, expected in ((tmp_path / "none.csv", "there is no such file"), (tmp_path, "found a folder")):
        with pytest.raises(ProgramError, match=expected):
            table.read(wrong)
    path.write_bytes(b"\n")
    with pytest.raises(ProgramError, match="the file is empty"):
        table.read(path)


CELL = st.sampled_from(
    ["", "0", "1", "-1.5", "-3e2", "nan", "inf", "x", "0x1", " 7 ", '"1,5"', "é", '"', "1e999", "1e308", "'", '"a""b"']
)
VALUES = st.lists(st.floats(-1e4, 1e4), min_size=6, max_size=6)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.lists(CELL, min_size=8, max_size=8), min_size=1, max_size=3), st.sampled_from([JOINTS, POSES]), VALUES
)
def test_any_cells_are_read_and_kept_or_refused_in_one_sentence(rows, header, values):
    content = data(header, *(",".join(row) for row in rows))
    try:
        seen = table.parse(content, "p.csv")
    except ProgramError as error:
        assert "\n" not in str(error)
        return
    new = np.tile(np.radians(values), (len(seen.rows), 1))
    new = (
        new
        if seen.kind == "joint"
        else frames.transform(frames.rot_x(values[3]), np.array(values[:3]) / 1e3) + 0 * seen.values
    )
    again = table.parse(table.with_values(seen, new, "f"))
    assert np.abs(again.values - new).max() < 1e-8
    for name in set(seen.table.columns) - {*table.POSE, *JOINT_COLUMNS}:
        assert again.table[name].tolist() == seen.table[name].tolist()


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_in_one_sentence(content):
    assert refused(content)


def test_arms_name_the_columns_of_their_joints(tmp_path):
    path = tmp_path / "p.csv"
    path.write_bytes(data("q1_mm,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,q7_deg", "100,10,20,30,40,50,60"))
    names = ["q1_mm", *(f"q{k}_deg" for k in range(2, 8))]
    assert np.abs(table.read(path, names).values[0] - [0.1, *np.radians([10, 20, 30, 40, 50, 60])]).max() < 1e-15
    with pytest.raises(ProgramError, match=r"expected columns q1_deg … q6_deg|missing column"):
        table.read_for(arm(), [tmp_path / "p.csv"], Given({}, {}, unknown()))[0].goals()


def test_all_rows_are_goals():
    (goals,) = table.parse(data(POSES, POSE, "", POSE)).goals()
    assert (goals.kind, goals.names, goals.lines.tolist()) == ("pose", ("row 2", "row 4"), [2, 4])
    assert goals.configurations is None
    assert goals.values.shape == (2, 4, 4)


def test_frames_mean_nothing_to_a_table(tmp_path):
    (tmp_path / "p.csv").write_bytes(data(POSES, POSE))
    with pytest.raises(OptionError, match="tool: the poses of a CSV program are those of the tip") as caught:
        table.read_for(arm(), [tmp_path / "p.csv"], Given({"a": np.eye(4)}, {}, unknown()))
    assert caught.value.parameter == "tool"


def test_refusals_carry_their_place():
    with pytest.raises(ProgramError) as caught:
        table.parse(data(JOINTS, ROW, ROW.replace("30", "9E9")), "p.csv")
    assert (caught.value.file, caught.value.row, caught.value.column) == ("p.csv", 3, "q3_deg")


def test_the_mark_is_found_without_knowing_the_arm():
    assert table.fingerprint(data("a,b", "1,2"), "p.csv") is None
    assert table.fingerprint(data(f"a,{table.MARK}", "1,", "2, abc "), "p.csv") == "abc"
    with pytest.raises(ProgramError, match=r"p\.csv: row 1: expected commas"):
        table.fingerprint(data("a;b", "1;2"), "p.csv")
