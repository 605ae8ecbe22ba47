"""Which rows make a pose, and its joints."""

import pytest
from import_support import make_map, refused, understood, write

from irbcal.errors import MeasurementError
from irbcal.measurement.imports import column_map, reader


def test_robodk_poses_are_runs_of_the_same_joints(tmp_path):
    a, b = "1,2,30,4,5,6", "2,2,30,4,5,6"
    rows = [f"{q},100,200,300,{t}" for q, t in [(a, "s"), (a, "t"), (a, "s"), (b, "s"), (b, "t"), (a, "s")]]
    found = understood(write(tmp_path / "r.csv", "h", *rows), "robodk", "fixed.group=iso")
    assert found.table["pose"].tolist() == ["1", "1", "2", "3", "3", "4"]
    assert set(found.table["group"]) == {"iso"}


def test_a_joint_measured_against_the_ground(tmp_path):
    path = write(tmp_path / "f.csv", "h", "1,20,30,4,5,6,100,200,300", "1,40,-30,4,5,6,100,200,300")
    found = understood(path, "robodk", "joints.add={3: 2}")
    assert found.table["q3_deg"].tolist() == [50, 10]


def test_one_pose_has_one_set_of_joints(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {pose: p, joints: [a], position: [x, y, z]}, units: {joints: deg, lengths: mm}, fixed: {target: t}}",
    )
    path = write(tmp_path / "r.csv", "p,a,x,y,z", "1,10,100,0,0", "2,11,100,0,0", "1,12,100,0,0")
    assert "row 4: expected the joints of pose 1 as in row 2" in refused(path, chosen)
    path = write(tmp_path / "r.csv", "p,a,x,y,z", "1,10,100,0,0", "1,10,101,0,0")
    assert any("1 rows repeat a target" in text for text in understood(path, chosen).warnings)
    path = write(tmp_path / "r.csv", "p,a,x,y,z", "1,10,100,0,0", ",10,101,0,0")
    assert "row 3, column p: expected the name of a pose, found nothing" in refused(path, chosen)


def test_groups_by_name_and_by_order(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {pose: p, joints: [a], position: [x, y, z]}, units: {joints: deg, lengths: mm}, fixed: {target: t}, "
        "groups: [{group: iso, poses: 'I*'}, {group: late, first: 2}, {group: never, poses: Z}]}",
    )
    path = write(tmp_path / "r.csv", "p,a,x,y,z", "A,10,100,0,0", "I1,11,100,0,0", "B,12,100,0,0")
    found = understood(path, chosen)
    assert found.table["group"].tolist() == ["", "iso", "late"]
    assert "The rule for group never fits no pose" in found.warnings


def test_rows_of_a_pose_that_contradict_carry_file_and_row(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {pose: p, joints: [a], position: [x, y, z]}, units: {joints: deg, lengths: mm}, fixed: {target: t}}",
    )
    path = write(tmp_path / "r.csv", "p,a,x,y,z", "1,10,100,0,0", "1,12,100,0,0")
    with pytest.raises(MeasurementError) as caught:
        reader.understand([path], column_map.read_map(chosen))
    assert (caught.value.file, caught.value.row) == (str(path), 3)
