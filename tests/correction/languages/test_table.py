"""CSV programs: what is read, and the one sentence for everything else."""

import csv
import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm
from term_cases import rail

from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.languages import table
from irbcal.correction.program import ControllerSetup
from irbcal.errors import OptionError, ProgramError
from irbcal.io import urdf
from irbcal.io.controller_model import unknown_frames
from irbcal.measurement.column_names import JOINTS as JOINT_COLUMNS
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.trajectory import Trajectory

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
        (data(JOINTS.replace("q3_deg", "q3"), ROW), "row 1: missing column"),
        (data(JOINTS.replace("_deg", "_rad"), ROW.replace("30", "x")), "column q3_rad: expected a joint angle in radians"),
        (data(POSES.replace("qz", "q4"), POSE), "row 1: missing column qz; found x_mm"),
        (data("a,b", "1,2"), "row 1: expected columns q1_deg … q6_deg (joints) or x_mm, y_mm, z_mm, qw, qx, qy, qz (poses), found a, b"),
        (data(JOINTS + "," + POSES, ROW + "," + POSE), "row 1: expected columns of joints or of poses, found both"),
        (data(JOINTS + ",q1_deg", ROW + ",1"), "row 1: column 'q1_deg'"),
        (data(JOINTS, ROW, ROW.replace("30", "x")), "row 3, column q3_deg: "),
        (data(JOINTS, ROW, ROW.replace("30", "1_0")), "row 3, column q3_deg: "),
        (data(JOINTS, ROW, ROW.replace("30", "٣")), "row 3, column q3_deg: "),
        (data(JOINTS, ROW, ROW.replace("30", "")), "row 3, column q3_deg: "),
        (data(JOINTS, ROW.replace("30", "inf")), "row 2, column q3_deg: expected a joint angle in degrees, found 'inf'"),
        (data(JOINTS, ROW.replace("30", "9E9")), "row 2, column q3_deg: expected a joint angle in degrees, found 9e+09"),
        (data(POSES, POSE, POSE.replace("-200", "y")), "row 3, column y_mm: expected a position within 1 km in mm, found 'y'"),
        (data(POSES, POSE.replace("0.7071", "0.5")), "row 2, columns qw, qx, qy, qz: "),
        (data(POSES, POSE.replace(",0,", ",,", 1)), "row 2, columns qw, qx, qy, qz: expected a unit quaternion or nothing, found 0.7071, nan, 0, -0.7071"),
        (data(JOINTS), "no rows"),
        (data(JOINTS, ROW, ROW + ",7,8"), "expected 8 values, found 10"),
        (data(JOINTS.replace(",", ";"), ROW), "found semicolons"),
        (data(JOINTS, ROW) + b"\xfc", "row 3: "),
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


@settings(max_examples=60, deadline=None)
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
    for name in set(seen.table.names) - {*table.POSE, *JOINT_COLUMNS}:
        assert list(again.table.content[name]) == list(seen.table.content[name])


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_in_one_sentence(content):
    assert refused(content)


def test_arms_name_the_columns_of_their_joints(tmp_path):
    path = tmp_path / "p.csv"
    path.write_bytes(data("q1_mm,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,q7_deg", "100,10,20,30,40,50,60"))
    assert (
        np.abs(table.read(path, rail(tmp_path)).values[0] - [0.1, *np.radians([10, 20, 30, 40, 50, 60])]).max() < 1e-15
    )
    with pytest.raises(ProgramError, match=r"expected columns q1_deg … q6_deg|missing column"):
        table.read_for(arm(), [tmp_path / "p.csv"], ControllerSetup({}, {}, unknown_frames()))[0].wanted_targets()


def test_all_rows_are_goals():
    (goals,) = table.parse(data(POSES, POSE, "", POSE)).wanted_targets()
    assert (goals.kind, goals.names, goals.lines.tolist()) == ("pose", ("row 2", "row 4"), [2, 4])
    assert goals.joints is None, "the solution next to zero joints"
    assert goals.values.shape == (2, 4, 4)


def test_frames_mean_nothing_to_a_table(tmp_path):
    (tmp_path / "p.csv").write_bytes(data(POSES, POSE))
    with pytest.raises(OptionError, match="tool: the poses of a table are those of the tip") as caught:
        table.read_for(arm(), [tmp_path / "p.csv"], ControllerSetup({"a": np.eye(4)}, {}, unknown_frames()))
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


def test_new_values_and_the_mark_are_written_and_the_rest_is_kept():
    content = "\ufeffnote,q6_deg,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,a b\r\n".encode() + data(
        'x,1,2,3,4,5,6," 7,0"', '"say ""é""",7,8,9,10,11,12,1.50', newline="\r\n"
    )
    seen = table.parse(content)
    new = np.radians([[0, -0.0, 1e-9, -1e-9, 1 / 3, -179.9999999], [1, 2, 3, 4, 5, 6]])
    written = table.with_values(seen, new, "abc123")
    assert written.decode() == (
        "\ufeffnote,q6_deg,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,a b,irbcal_filtered\r\n"
        'x,-180.000000,0.000000,0.000000,0.000000,0.000000,0.333333," 7,0",abc123\r\n'
        '"say ""é""",6.000000,1.000000,2.000000,3.000000,4.000000,5.000000,1.50,abc123\r\n'
    )
    again = table.parse(written)
    assert again.fingerprint is not None
    assert again.fingerprint == "abc123"
    assert np.abs(again.values - new).max() < 1e-8


def test_rows_that_are_not_corrected_keep_their_text():
    seen = table.parse(data(JOINTS + "," + table.MARK, "a,1.,2,3,4,5,6,," + "", 'b,1.,2,3,4,5,"6",,'))
    assert seen.fingerprint is None
    new = np.full((2, 6), np.nan)
    new[1] = 0.0
    written = table.with_values(seen, new, "f", rows=[False, True]).decode().splitlines()
    assert written[1] == "a,1.,2,3,4,5,6,,"
    assert written[2] == "b," + "0.000000," * 6 + ",f"
    assert written[0] == JOINTS + "," + table.MARK
    assert table.parse("\n".join(written).encode()).fingerprint is not None


def test_poses_keep_the_sign_of_their_quaternion():
    seen = table.parse(data(POSES, POSE, "1,2,3,-1,0,0,0,x"))
    written = list(csv.DictReader(io.StringIO(table.with_values(seen, seen.values).decode())))
    assert [written[0][name] for name in table.POSE[3:]] == [
        "0.707106781",
        "0.000000000",
        "0.000000000",
        "-0.707106781",
    ]
    assert written[1]["qw"] == "-1.000000000"
    assert written[1]["speed"] == "x"
    assert table.MARK not in written[0]


def test_values_that_cannot_be_written_are_refused():
    seen = table.parse(data(POSES, POSE))
    for wrong in (np.zeros((1, 6)), np.full((1, 4, 4), np.nan), 2 * np.eye(4)[None], np.eye(4)):
        with pytest.raises(ValueError, match="expected"):
            table.with_values(seen, wrong)


def test_twenty_thousand_rows():
    numbers = np.random.default_rng(0).uniform(-180, 180, (20_000, 6))
    body = ("a,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,v100\n" * len(numbers)) % tuple(numbers.ravel())
    content = (JOINTS + "\n" + body).encode()
    seen = table.parse(content)
    written = table.with_values(seen, seen.values, "abc")
    assert np.abs(np.degrees(seen.values) - numbers).max() < 1e-6
    assert written.count(b"\n") == content.count(b"\n")
    assert written.replace(b",abc\n", b"\n").partition(b"\n")[2] == content.partition(b"\n")[2]


COUPLING = np.eye(6)
COUPLING[2, 1] = -1.0


def written(nominal, n=5, **changed):
    """A motion of all joints as CSV, with a column of its own."""
    t = 0.1 * np.arange(n)
    q = np.outer(t, 0.1 * np.arange(1, 7))
    motion = Trajectory(t, q, np.gradient(q, t, axis=0), 0 * q, nominal.joint_names)
    frame = motion.to_frame().assign(note="ü,x")
    return motion, frame.assign(**changed).to_csv(index=False).encode()


def test_speeds_and_accelerations_go_in_and_out_as_the_controller_counts():
    nominal = replace(urdf.read("irb1600").arm, coupling=COUPLING)
    motion, data = written(nominal)
    program = table.along_time(table.parse(data, "a.csv", nominal), nominal)
    assert program.motion.dq == pytest.approx(motion.dq)
    assert program.trajectory.q[:, 2] == pytest.approx(motion.q[:, 2] - motion.q[:, 1])
    assert program.trajectory.dq == pytest.approx(nominal.from_controller(motion.dq))
    (goals,) = program.wanted_targets()
    np.testing.assert_allclose(goals.values, nominal.from_controller(motion.q), rtol=0, atol=1e-9)
    fake = correct_joints(Robot(nominal), nominal, goals.values)
    (out,) = program.with_motion(program.trajectory.slowed(2.0)).with_fake_targets([(goals, fake)], "abc").values()
    again = table.along_time(table.parse(out, "a.csv", nominal), nominal)
    assert again.fingerprint == "abc"
    assert again.motion.q == pytest.approx(motion.q, abs=1e-8)
    assert again.motion.dq == pytest.approx(motion.dq / 2, abs=1e-8)
    assert again.motion.times.tolist() == motion.times.tolist()
    assert b'"\xc3\xbc,x"' in out


def test_rows_without_times_and_poses_are_no_motion():
    nominal = urdf.read("irb1600").arm
    _, data = written(nominal)
    frame = pd.read_csv(pd.io.common.BytesIO(data)).drop(columns="time_s")
    assert not table.has_times(table.parse(frame.to_csv(index=False).encode()))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"time_s": [0, 0.1, 0.1, 0.3, 0.4]},
            "row 4, column time_s: times of a trajectory grow, found 0.1 s after 0.1",
        ),
        ({"time_s": [0, 0.1, "soon", 0.3, 0.4]}, "row 4, column time_s: expected a time in seconds, found 'soon'"),
        ({"v2_deg_s": [0, 0.1, np.nan, 0.3, 0.4]}, "row 4, column v2_deg_s: expected a number"),
        ({"v2_deg_s": [0, 0.1, "inf", 0.3, 0.4]}, "row 4, column v2_deg_s: expected a number"),
    ],
)
def test_refusals_name_the_row_and_the_column(changed, words):
    nominal = urdf.read("irb1600").arm
    with pytest.raises(ProgramError, match=f"a.csv: {words}"):
        table.along_time(table.parse(written(nominal, **changed)[1], "a.csv"), nominal)


def test_columns_that_are_not_whole_are_refused():
    nominal = urdf.read("irb1600").arm
    frame = pd.read_csv(pd.io.common.BytesIO(written(nominal)[1]))
    with pytest.raises(ProgramError, match="v3_deg_s"):
        table.along_time(table.parse(frame.drop(columns="v3_deg_s").to_csv(index=False).encode()), nominal)
    alone = frame.drop(columns=[f"v{k}_deg_s" for k in range(1, 7)])
    with pytest.raises(ProgramError, match="accelerations"):
        table.along_time(table.parse(alone.to_csv(index=False).encode()), nominal)
