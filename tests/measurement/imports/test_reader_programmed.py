"""Programmed joints of foreign files: by the rules of the joints, or refused."""

import numpy as np
import pytest
from import_support import make_map, refused, understood, write

from irbcal.errors import IrbcalError
from irbcal.measurement.imports import column_map

MAP = (
    "{columns: {pose: p, joints: [a, b], programmed: [ca, cb], position: [x, y, z]}, units: {joints: rad, lengths: mm}, "
    "joints: {signs: [1, -1], offsets_deg: [10, 0], add: {2: 1}}, fixed: {target: t}}"
)
ROWS = ("1,0.1,0.2,0.11,0.22,100,0,0", "1,0.1,0.2,0.11,0.22,100,5,0", "2,0.3,0.5,0.3,0.5,100,9,0")


def test_units_and_rules_are_those_of_the_joints(tmp_path):
    found = understood(write(tmp_path / "f.csv", "p,a,b,ca,cb,x,y,z", *ROWS), make_map(tmp_path, MAP))
    assert list(found.table.columns[:6]) == ["pose", "q1_deg", "q2_deg", "c1_deg", "c2_deg", "target"]
    expected = np.degrees([[0.1, -0.3], [0.11, -0.33]]) + np.array([10, 0])
    first = found.table.iloc[0]
    np.testing.assert_allclose(first[["q1_deg", "q2_deg"]].astype(float), expected[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(first[["c1_deg", "c2_deg"]].astype(float), expected[1], rtol=0, atol=1e-9)
    seen = found.measurements()
    np.testing.assert_allclose(np.degrees(seen.joints()[0]), expected[1], rtol=0, atol=1e-8)


def test_a_pose_has_one_set_of_them_and_each_is_a_number(tmp_path):
    rows = [ROWS[0], ROWS[1].replace("0.22", "0.23"), ROWS[2]]
    text = refused(write(tmp_path / "f.csv", "p,a,b,ca,cb,x,y,z", *rows), make_map(tmp_path, MAP))
    assert "row 3: expected the programmed joints of pose 1 as in row 2" in text
    assert "(joint 2: " in text
    rows = [ROWS[0], ROWS[1].replace("0.22", ""), ROWS[2]]
    text = refused(write(tmp_path / "f.csv", "p,a,b,ca,cb,x,y,z", *rows), make_map(tmp_path, MAP))
    assert "row 3, column cb: expected a joint angle in rad" in text


def test_they_may_be_optional(tmp_path):
    path = write(tmp_path / "f.csv", "p,a,b,x,y,z", "1,0.1,0.2,100,0,0", "2,0.3,0.5,100,9,0")
    assert "ca" in refused(path, make_map(tmp_path, MAP))
    chosen = make_map(tmp_path, MAP.replace("columns: {", "columns: {optional: [programmed], "))
    assert "c1_deg" not in understood(path, chosen).table.columns


def test_one_for_each_joint_and_no_kept_column_in_their_place(tmp_path):
    for change in (MAP.replace("[ca, cb]", "[ca]"), MAP.replace("joints: [a, b], ", "")):
        with pytest.raises(IrbcalError, match=r"columns\.programmed: expected a column for each of the"):
            column_map.read_map(make_map(tmp_path, change), ())
    with pytest.raises(IrbcalError, match="expected a new name for the column, found 'c1_deg'"):
        column_map.read_map(make_map(tmp_path, MAP.replace("pose: p,", "pose: p, keep: {c1_deg: w},")), ())


def test_degrees_declared_as_radians_are_seen_in_them_too(tmp_path):
    rows = [f"{k},0.1,{k / 10},{40 * k},{50 * k},100,{k},0" for k in range(1, 5)]
    text = refused(write(tmp_path / "f.csv", "p,a,b,ca,cb,x,y,z", *rows), make_map(tmp_path, MAP))
    assert "these look like deg" in text


@pytest.mark.parametrize("own", [True, False])
def test_joints_files_hold_them(tmp_path, own):
    points = write(tmp_path / "smr1.csv", "x,y,z", "1000,2,3", "1000,4,5")
    head = "q1_deg,q2_deg,c1_deg,c2_deg" if own else "a,b,ca,cb"
    joints = write(tmp_path / "joints.csv", head, "10,20,11,21", "30,40,31,42")
    section = "joints_file={columns: {joints: [a, b], programmed: [ca, cb]}, units: {joints: deg}}"
    changes = ["units.lengths=mm", *([] if own else [section])]
    found = understood(points, "per-target", *changes, joints=joints)
    assert found.table[["c1_deg", "c2_deg"]].to_numpy().tolist() == [[11, 21], [31, 42]]
    if own:
        gap = write(tmp_path / "gap.csv", "q1_deg,q2_deg,c1_deg", "10,20,11", "30,40,31")
        assert "missing column c2_deg: programmed joints" in refused(points, "per-target", *changes, joints=gap)
