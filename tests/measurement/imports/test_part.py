"""One foreign file, column by column: units, orientations, marks of lost points, missing columns."""

import numpy as np
import pandas as pd
import pytest
from import_support import FOUR_JOINTS, QUATERNION, make_map, refused, understood, write
from scipy.spatial.transform import Rotation


def test_status_column_marks_lost_points(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    path = write(tmp_path / "smr1.csv", "x,y,z,state", "1000,2,3,ok", "7,garbage,9,beam broken")
    found = understood(path, "per-target", "units.lengths=mm", "lost.status={column: state, good: [OK]}", joints=joints)
    assert found.lost.tolist() == [False, True]


@pytest.mark.parametrize(
    ("kind", "columns", "values"),
    [
        ("{kind: quaternion, scalar: last}", 4, lambda R: R.as_quat()),
        ("{kind: quaternion, scalar: last, maps: tracker-to-target}", 4, lambda R: R.inv().as_quat()),
        ("{kind: rotation-vector}", 3, lambda R: R.as_rotvec(degrees=True)),
        ("{kind: ur}", 3, lambda R: R.as_rotvec()),
        ("{kind: euler, axes: zyx, about: moving}", 3, lambda R: R.as_euler("ZYX", degrees=True)),
        ("{kind: euler, axes: zyz, about: fixed}", 3, lambda R: R.as_euler("zyz", degrees=True)),
    ],
)
def test_orientations_come_back(tmp_path, kind, columns, values):
    R = Rotation.random(20, rng=np.random.default_rng(5))
    frame = pd.DataFrame(np.column_stack([np.tile([500.0, 600, 700], (20, 1)), np.arange(20) * 9, values(R)]))
    frame.to_csv(tmp_path / "o.csv", index=False, header=False)
    chosen = make_map(
        tmp_path,
        "{file: {header: false}, columns: {position: [1, 2, 3], joints: [4], orientation: "
        f"{list(range(5, 5 + columns))}}}, units: {{joints: deg, lengths: mm, angles: deg}}, orientation: {kind}, "
        "fixed: {target: t}}",
    )
    seen = understood(tmp_path / "o.csv", chosen).table
    back = Rotation.from_quat(np.roll(seen[QUATERNION].to_numpy(), -1, axis=1))
    assert (back * R.inv()).magnitude().max() < 1e-10
    assert (seen["qw"] >= 0).all()


def test_units_in_the_header_must_agree(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    path = write(tmp_path / "t.csv", "X [m];Y [m];Z [m];Q0;Q1;Q2;Q3", "1,5;2,5;3,5;1;0;0;0", "1,5;2,5;3,5;1;0;0;0")
    assert "row 1, column X [m]: expected lengths in mm as declared in the map, found m" in refused(
        path, "leica-tmac", joints=joints
    )
    assert understood(path, "leica-tmac", "units.lengths=m", joints=joints).table["x_mm"].tolist() == [1500, 1500]


def test_columns_that_are_missing_double_or_no_quaternion(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    path = write(tmp_path / "t.csv", "X,Y,Q0,Q1,Q2,Q3", "1,2,3,4,5,6", "1,2,3,4,5,6")
    assert "row 1: there is no column 'Z' for the position; found X, Y, Q0" in refused(
        path, "leica-tmac", joints=joints
    )
    path = write(tmp_path / "t.csv", "X,Y,Z,Z,Q0,Q1,Q2,Q3", "1,2,3,4,5,6,7,8")
    assert "expected one column 'Z' for the position, found 2" in refused(path, "leica-tmac", joints=joints)
    path = write(tmp_path / "t.csv", "X,Y,Z,Q0,Q1,Q2,Q3", "100,2,3,1,0,0,0", "100,2,3,1,1,0,0")
    assert "row 3, columns Q0, Q1, Q2, Q3: expected a unit quaternion, found 1, 1, 0, 0" in refused(
        path, "leica-tmac", joints=joints
    )
