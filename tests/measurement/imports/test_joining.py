"""Joints files: joined by name or by order, or refused."""

import numpy as np
from import_support import FOUR_JOINTS, ROW, refused, understood, write


def test_a_joints_file_of_another_make(tmp_path):
    joints = write(tmp_path / "log.txt", "# robot", "0 0,5 1,0", "1 0,25 -1,0")
    path = write(tmp_path / "smr1.csv", "x,y,z", "1000,2,3", "1000,4,5")
    section = (
        "joints_file={file: {delimiter: space, decimal: ',', comment: '#', header: false}, "
        "columns: {joints: [2, 3]}, units: {joints: rad}}"
    )
    found = understood(path, "per-target", "units.lengths=mm", section, joints=joints)
    assert np.allclose(found.table[["q1_deg", "q2_deg"]], np.degrees([[0.5, 1.0], [0.25, -1.0]]), rtol=0, atol=1e-9)


def test_joints_from_one_place_and_of_every_pose(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    points = write(tmp_path / "smr1.csv", "x,y,z", "900,0,1")
    robodk = write(tmp_path / "r.csv", "h", ROW)
    assert "finds points only" in refused(points, "per-target", "units.lengths=mm")
    assert "expected joints from one place" in refused(robodk, "robodk", joints=joints)
    assert "expected 2 rows, as many as" in refused(points, "per-target", "units.lengths=mm", joints=joints)
    other = write(tmp_path / "other.csv", "a,b", "1,2")
    assert "row 1: expected the columns q1_deg" in refused(points, "per-target", "units.lengths=mm", joints=other)
    named = write(tmp_path / "smr2.csv", "n,x,y,z", "P1,900,0,1")
    double = write(tmp_path / "double.csv", "pose,q1_deg", "P1,1", "P1,2")
    text = refused(named, "per-target", "units.lengths=mm", "columns.pose=n", joints=double)
    assert "row 3, column pose: expected each pose once, found 'P1' again" in text


def test_loads_and_times_of_a_joints_file_come_with_its_joints(tmp_path):
    joints = write(tmp_path / "j.csv", "pose,q1_deg,payload_kg,time_s", "P2,20,5,8", "P1,10,3,")
    named = write(tmp_path / "smr1.csv", "n,x,y,z", "P1,900,0,1", "P2,900,0,2")
    table = understood(named, "per-target", "units.lengths=mm", "columns.pose=n", joints=joints).table
    assert table[["pose", "q1_deg", "payload_kg"]].to_numpy().tolist() == [["P2", 20.0, 5.0], ["P1", 10.0, 3.0]]
    assert table["time_s"].tolist()[0] == 8.0
    assert np.isnan(table["time_s"].tolist()[1])
    # of points that say it themselves, theirs stays
    own = write(tmp_path / "smr2.csv", "n,x,y,z,kg", "P1,900,0,1,7", "P2,900,0,2,9")
    changes = ("units.lengths=mm", "columns.pose=n", "columns.payload=kg")
    assert understood(own, "per-target", *changes, joints=joints).table["payload_kg"].tolist() == [9.0, 7.0]
    bad = write(tmp_path / "bad.csv", "pose,q1_deg,payload_kg", "P1,1,x", "P2,2,3")
    text = refused(named, "per-target", "units.lengths=mm", "columns.pose=n", joints=bad)
    assert "row 2, column payload_kg: expected a number or nothing, found 'x'" in text


def test_two_sessions_of_logs_count_on(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    rows = {"s1_smr1": 100.5, "s1_smr2": 200.5, "s2_smr1": 300.5, "s2_smr2": 400.5}
    paths = [write(tmp_path / f"{name}.csv", "x,y,z", f"{x},0,0") for name, x in rows.items()]
    found = understood(paths, "per-target", "units.lengths=mm", "file_name='{group}_{target}'", joints=joints)
    assert found.table["pose"].tolist() == ["P1", "P1", "P2", "P2"]
    assert found.table["group"].tolist() == ["s1", "s1", "s2", "s2"]
    assert found.table["x_mm"].tolist() == [100.5, 200.5, 300.5, 400.5]
