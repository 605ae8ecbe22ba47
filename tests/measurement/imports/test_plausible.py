"""Numbers that contradict the declared units."""

import pytest
from import_support import refused, understood, write

from irbcal.errors import MeasurementError
from irbcal.measurement.imports import column_map, reader


def test_declared_radians_that_are_degrees_and_a_way_round(tmp_path):
    path = write(tmp_path / "r.csv", "h", *[f"{k}0,-20,30,0,45,90,1200,-35,640" for k in range(3)])
    assert "expected joints in rad as declared, found 90" in refused(path, "robodk", "units.joints=rad")
    small = write(tmp_path / "s.csv", "h", *[f"0.{k},-1.5,0.3,0,0.1,3.1,900,0,1" for k in range(4)])
    assert understood(small, "robodk", "trust_units=true").table["q1_deg"].tolist() == [0, 0.1, 0.2, 0.3]
    joints = write(tmp_path / "joints.csv", "q1_deg,q2_deg", *[f"0.{k},1.5" for k in range(3)])
    points = write(tmp_path / "smr1.csv", "x,y,z", *["900,0,1"] * 3)
    text = refused(points, "per-target", "units.lengths=mm", joints=joints)
    assert text.startswith(f"{joints}: row 2, joint 2: expected joints in deg")


def test_positions_in_another_unit_carry_file_and_row(tmp_path):
    path = write(tmp_path / "r.csv", "h", *[f"{k}0,-15,3,0,1,31,0.9,0,1.{k}" for k in range(4)])
    with pytest.raises(MeasurementError) as caught:
        reader.understand([path], column_map.read_map("robodk"))
    assert (caught.value.file, caught.value.row) == (str(path), 5)
    found = reader.understand([path], column_map.read_map("robodk", {"trust_units": True}))
    assert found.table["z_mm"].tolist() == [1.0, 1.1, 1.2, 1.3]


def test_what_looks_strange_is_said(tmp_path):
    rows = [f"{q},0,30,0,45,90,{x},-35,640,{t}" for q, x, t in [(1, 900, "a"), (2, 901, "a"), (3, 902, "a")]]
    path = write(tmp_path / "r.csv", "h", *rows, "3,0,30,0,45,90,0,0,0,b")
    found = understood(path, "robodk")
    assert found.warnings == ("Every point of target b is lost", "Joint 2, 3, 4, 5, 6 never moves")
