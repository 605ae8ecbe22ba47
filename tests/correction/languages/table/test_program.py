"""CSV programs: what is written back, and what is kept."""

import csv
import io

import numpy as np
import pytest

from irbcal.correction.languages import table

JOINTS = "name,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,note"
POSES = "x_mm,y_mm,z_mm,qw,qx,qy,qz,speed"
POSE = "100,-200,300,0.7071,0,0,-0.7071,v100"


def data(*lines, newline="\n"):
    return (newline.join(lines) + newline).encode()


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


def test_a_hundred_thousand_rows():
    numbers = np.random.default_rng(0).uniform(-180, 180, (100_000, 6))
    body = ("a,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,v100\n" * len(numbers)) % tuple(numbers.ravel())
    content = (JOINTS + "\n" + body).encode()
    seen = table.parse(content)
    written = table.with_values(seen, seen.values, "abc")
    assert np.abs(np.degrees(seen.values) - numbers).max() < 1e-6
    assert written.count(b"\n") == content.count(b"\n")
    assert written.replace(b",abc\n", b"\n").partition(b"\n")[2] == content.partition(b"\n")[2]
