"""Foreign files: each preset on an example written by hand, maps of one's own, and bad rows."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pandas as pd
import pytest
from import_support import FOUR_JOINTS, JOINTS, QUATERNION, ROW, XYZ, make_map, refused, understood, write
from scipy.spatial.transform import Rotation

from irbcal.errors import CalibrationError, IrbcalError, MeasurementError, OptionError
from irbcal.io.imported_files import import_measurements
from irbcal.measurement import table
from irbcal.measurement.imports import column_map, reader

WIDE = """
columns:
  joints: [{joints}]
  position: {{smr1: [x1, y1, z1], ref1: [x2, y2, z2]}}
  time: when
  u95: u
  keep: {{operator: who}}
units: {{joints: [mm, deg, rad], lengths: m, time: iso}}
joints: {{signs: [1, -1, 1], offsets_deg: [0, 10, 0]}}
fixed: {{payload_kg: 5.5}}
groups:
  - {{group: axis1, last: 1}}
  - {{group: rest, poses: "*"}}
"""


def test_robodk_with_tcp(tmp_path):
    path = write(
        tmp_path / "robodk.csv",
        "whatever stands here",
        "10,-20,30,0,45,90,1200.5,-35.25,640.75,1",
        "10,-20,30,0,45,90,1210.5,-25.25,640.75,2",
        "15,-20,30,0,45,90,0,0,0,1",
        "15,-20,30,0,45,90,1310.5,-25.25,640.75,2",
    )
    found = understood(path, "robodk", "rename={'1': smr1, '2': ref1}")
    assert found.table["pose"].tolist() == ["1", "1", "2", "2"]
    assert found.table["target"].tolist() == ["smr1", "ref1", "smr1", "ref1"]
    assert found.table[JOINTS].iloc[2].tolist() == [15, -20, 30, 0, 45, 90]
    assert found.table[XYZ].iloc[1].tolist() == [1210.5, -25.25, 640.75]
    assert found.lost.tolist() == [False, False, True, False]
    assert found.targets == {"ref1": (2, 0), "smr1": (1, 1)}
    assert found.poses == 2


def test_robodk_with_and_without_its_optional_columns(tmp_path):
    row = "10,-20,30,0,45,90,1200.5,-35.25,640.75"
    plain = write(tmp_path / "plain.csv", "header", row)
    assert understood(plain, "robodk").table["target"].tolist() == ["tcp"]
    turned = write(tmp_path / "turned.csv", "header", row + ",0,0,90,7")
    assert "expected what the 3 orientation columns mean to be declared" in refused(turned, "robodk")
    assert "qw" not in understood(turned, "robodk", "columns.orientation=null").table.columns
    euler = ["orientation.kind=euler", "orientation.axes=xyz", "orientation.about=fixed", "units.angles=deg"]
    found = understood(turned, "robodk", *euler)
    assert found.table["target"].tolist() == ["7"]
    half = np.sqrt(0.5)  # 90 degrees about z
    assert np.allclose(found.table[QUATERNION], [[half, 0, 0, half]], rtol=0, atol=1e-12)
    untold = write(tmp_path / "untold.csv", "header", row + ",0,0,90")
    assert understood(untold, "robodk", *euler).table["target"].tolist() == ["tcp"]


@pytest.mark.parametrize("separator", [", ", " ", "\t"])
def test_spatial_analyzer_points_by_name(tmp_path, separator):
    path = write(
        tmp_path / "points.txt",
        "// SpatialAnalyzer, frame World",
        "// x y z",
        separator.join(["P1_smr1", "1975.568420", "-310.198889", "-257.870805"]),
        separator.join(["P2_smr1", "2508.005925", "-556.994450", "-244.542473"]),
        "",
        separator.join(["P1_ref1", "100.5", "200.5", "300.5"]),
    )
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    assert "unit of the positions" in refused(path, "spatial-analyzer", joints=joints)
    found = understood(path, "spatial-analyzer", "units.lengths=mm", joints=joints)
    assert found.table["pose"].tolist() == ["P1", "P1", "P2"]
    assert found.table["target"].tolist() == ["smr1", "ref1", "smr1"]
    assert found.table[JOINTS].iloc[2].tolist() == [11, 21, 31, 41, 51, 61]
    assert found.table[XYZ].iloc[2].tolist() == [2508.005925, -556.99445, -244.542473]
    assert found.origin["row"].tolist() == [3, 6, 4]
    inch = understood(path, "spatial-analyzer", "units.lengths=inch", joints=joints).table
    assert inch["x_mm"].iloc[1] == pytest.approx(100.5 * 25.4, abs=1e-9)


def test_spatial_analyzer_names_of_three_parts(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    one = write(tmp_path / "one.txt", "A::Main::P1_smr1 1975.5 -310.1 -257.8", "A::Main::P2_smr1 2508 -556.9 -244.5")
    found = understood(one, "spatial-analyzer", "units.lengths=mm", joints=joints)
    assert found.table["pose"].tolist() == ["P1", "P2"]
    assert found.table["target"].tolist() == ["smr1", "smr1"]
    three = write(tmp_path / "three.txt", "A,P2,smr1,1975.5,-310.1,-257.8", "A,P1,smr1,2508,-556.9,-244.5")
    found = understood(
        three,
        "spatial-analyzer",
        "units.lengths=mm",
        "columns.name=[1, 2, 3]",
        "names=['{ignore}::{pose}::{target}']",
        joints=joints,
    )
    assert found.table["pose"].tolist() == ["P1", "P2"], "in the order of the joints file"
    assert found.table["x_mm"].tolist() == [2508, 1975.5]
    bad = write(tmp_path / "bad.txt", "P1_smr1 1 2 300", "P2 1 2 300")
    assert "row 2: expected a name such as" in refused(bad, "spatial-analyzer", "units.lengths=mm", joints=joints)
    endless = write(tmp_path / "endless.txt", "P" * 150 + "_smr1 1 2 300")
    text = refused(endless, "spatial-analyzer", "units.lengths=mm", joints=joints)
    assert "row 1: expected a name of at most 100 characters" in text
    other = write(tmp_path / "other.txt", "P1_smr1 1 2 300", "P9_smr1 1 2 300")
    text = refused(other, "spatial-analyzer", "units.lengths=mm", joints=joints)
    assert "row 2: expected a pose of" in text
    assert "'P9'" in text


@pytest.mark.parametrize(("separator", "mark"), [(";", ","), (";", "."), (",", ".")])
def test_leica_tmac(tmp_path, separator, mark):
    # (0.5, 0.5, 0.5, 0.5) turns x to y, y to z, z to x
    rows = [["2361.9831", "-1368.5474", "119.3971", "0.5", "0.5", "0.5", "0.5"], ["", "", "", "", "", "", ""]]
    lines = [separator.join(cell.replace(".", mark) for cell in row) for row in rows]
    path = write(
        tmp_path / "t.csv", separator.join(["X", "Y", "Z", "Q0", "Q1", "Q2", "Q3", "Größe"]),
        *[line + separator + "°" for line in lines], encoding="latin-1",
    )  # fmt: skip
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    found = understood(path, "leica-tmac", joints=joints)
    assert found.table["target"].tolist() == ["tmac", "tmac"]
    assert found.table[XYZ].iloc[0].tolist() == [2361.9831, -1368.5474, 119.3971]
    assert found.lost.tolist() == [False, True]
    assert found.table[QUATERNION].isna().all(axis=1).tolist() == [False, True]
    (tmp_path / "back.csv").write_bytes(found.csv())
    R = table.read(tmp_path / "back.csv").rotations()[0]
    assert np.allclose(R, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], rtol=0, atol=1e-12)


def test_per_target_logs(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    one = write(tmp_path / "smr1.csv", "x;y;z", "1975,568;-310,199;-257,871", "INVALID")
    two = write(tmp_path / "ref1.csv", "x;y;z", "-9999;-9999;-9999", "5,5;6,5;70,5")
    found = understood([one, two], "per-target", "units.lengths=mm", joints=joints)
    assert found.table["pose"].tolist() == ["P1", "P1", "P2", "P2"], "as the joints file calls them"
    assert found.table["target"].tolist() == ["smr1", "ref1", "smr1", "ref1"]
    assert found.lost.tolist() == [False, True, True, False]
    assert found.table[XYZ].iloc[3].tolist() == [5.5, 6.5, 70.5]
    assert found.table["q1_deg"].tolist() == [10, 10, 11, 11]
    short = write(tmp_path / "smr2.csv", "x;y;z", "1975,568;-310,199;-257,871")
    text = refused([one, short], "per-target", "units.lengths=mm", joints=joints)
    assert str(short) in text
    assert "expected 2 rows" in text
    named = write(tmp_path / "a_smr9.csv", "Pose;x;y;z", "P2;1975,568;-310,199;-257,871")
    changes = ["units.lengths=mm", "columns.pose=Pose", "file_name='{ignore}_{target}'"]
    found = understood(named, "per-target", *changes, joints=joints)
    assert found.table[["pose", "q1_deg", "target"]].iloc[0].tolist() == ["P2", 11, "smr9"]
    assert any("1 poses of" in text for text in found.notes)


def test_lab_export_by_hand(tmp_path):
    header = (
        "shoulder_pan_joint;shoulder_lift_joint;elbow_joint;wrist_1_joint;wrist_2_joint;wrist_3_joint;"
        "measurement_temperature;measurement_x;measurement_y;measurement_z;measurement_rx;measurement_ry;measurement_rz"
    )
    pi = "3,14159265358979"
    path = write(tmp_path / "lab.csv", header, f"{pi};-{pi};0;0;0;1,5E-1;21,5;1,5;-2,5;1E+03;90;0;90")
    found = understood(path, "ur10-lab")
    assert np.allclose(found.table[JOINTS], [[180, -180, 0, 0, 0, np.degrees(0.15)]], rtol=0, atol=1e-9)
    assert found.table[XYZ].iloc[0].tolist() == [1.5, -2.5, 1000]
    assert found.table["temperature_c"].tolist() == [21.5]
    # 90 degrees about x, then 90 about the new z (the old -y)
    R = Rotation.from_quat(np.roll(found.table[QUATERNION].to_numpy(), -1, axis=1)).as_matrix()[0]
    assert np.allclose(R, [[0, -1, 0], [0, 0, -1], [1, 0, 0]], rtol=0, atol=1e-12)


def test_real_lab_export_equals_the_cleaned_file(shared_data, tmp_path):
    folder = shared_data / "ur10_laser_tracker_6d"
    found = reader.understand([folder / "as_exported_by_the_lab.csv"], column_map.read_map("ur10-lab"))
    path = tmp_path / "m.csv"
    path.write_bytes(found.csv())
    seen = table.read(path).table
    clean = pd.read_csv(folder / "measurements.csv")
    clean = clean[clean["group"] == "random"].iloc[: len(seen)]
    assert len(seen) == 100
    assert np.abs(seen[JOINTS].to_numpy() - clean[JOINTS].to_numpy()).max() < 1e-6
    assert np.abs(seen[XYZ].to_numpy() - clean[XYZ].to_numpy()).max() < 1e-6
    turn = (
        Rotation.from_quat(seen[["qx", "qy", "qz", "qw"]]) * Rotation.from_quat(clean[["qx", "qy", "qz", "qw"]]).inv()
    )
    assert np.degrees(turn.magnitude()).max() < 1e-6
    assert np.abs(seen["temperature_c"].astype(float).to_numpy() - clean["temperature_c"].to_numpy()).max() < 1e-6


def test_wide_rows_rails_signs_offsets_groups_and_times(tmp_path):
    chosen = make_map(tmp_path, WIDE.format(joints="rail, a, b"))
    path = write(
        tmp_path / "w.csv",
        "rail [mm],a (deg),b [rad],x1 [m],y1,z1,x2,y2,z2,when,u,who",
        "250,30,1.5707963267948966,1,2,3,4,5,6,2024-05-31T12:00:00Z,0.00005,Åsa",
        "260,-40,0,1,2,3,,,,2024-05-31 12:00:01.5,0.00005,Åsa",
    )
    got = understood(path, chosen)
    seen = got.table
    assert seen["target"].tolist() == ["smr1", "ref1"] * 2
    assert np.allclose(
        seen[["q1_mm", "q2_deg", "q3_deg"]].iloc[[0, 2]], [[250, -20, 90], [260, 50, 0]], rtol=0, atol=1e-9
    )
    assert seen[XYZ].iloc[1].tolist() == [4000, 5000, 6000]
    assert got.lost.tolist() == [False, False, False, True]
    assert seen["time_s"].diff().iloc[2] == pytest.approx(1.5)
    assert np.allclose(seen["u95_mm"], 0.05, rtol=0, atol=1e-12)
    assert seen["group"].tolist() == ["axis1", "axis1", "rest", "rest"]
    assert set(seen["payload_kg"]) == {5.5}
    assert set(seen["operator"]) == {"Åsa"}


def test_many_rows(tmp_path):
    rng = np.random.default_rng(0)
    values = np.column_stack([rng.uniform(-170, 170, (5_000, 6)), rng.uniform(-3000, 3000, (5_000, 3))])
    text = pd.DataFrame(values.round(4)).to_csv(index=False, header=False, sep=";", decimal=",")
    (tmp_path / "big.csv").write_text("header\n" + text)
    chosen = column_map.read_map("robodk", ["file.delimiter=;", "file.decimal=,"])
    found = reader.understand([tmp_path / "big.csv"], chosen)
    assert np.abs(found.table[[*JOINTS, *XYZ]].to_numpy() - values.round(4)).max() < 1e-9


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["h", ROW.replace("640.75", "abc")], "row 2, column 9: expected a position in mm or a mark of a lost point, found 'abc'"),
        (["h", ROW.replace("-20", "INVALID")], "row 2, column 2: expected a joint angle in deg, found 'INVALID'"),
        (["h", ROW.replace("-20", "")], "row 2, column 2: expected a joint angle in deg, found nothing"),
        (["h", ROW, "", ROW + ",1,2,3,4,5"], "row 4: expected 9 values, found 14"),
        (["h", ROW, ROW.replace(",640.75", "")], "row 3: expected 9 values, found 8"),
        (["h", ROW.replace("640.75", "inf")], "row 2, column 9: expected a position"),
        (["h", ROW.replace("1200.5", "0").replace("-35.25", "0").replace("640.75", "0")], "found only lost ones (1 rows)"),
        (["h", '1,2,"3', '4",5,6,7,8,9,10,11'], "expected"),
        (["h"], "expected rows after 1 skipped rows, found 0 rows"),
        (["h", "1,2,3"], "row 2: expected a column 7 for the position, found 3 columns"),
        (["h", ROW.replace("640.75", "64000000")], "row 2: expected positions in mm as declared, found the farthest"),
        (["h", *[f"0.{k},-1.5,0.3,0,0.1,3.1,900,0,1" for k in range(4)]], "these look like rad"),
        (["h", *[f"{k}0,-15,3,0,1,31,0.9,0,1.{k}" for k in range(4)]], "too near for a tracker"),
        (["h", "1,2,3;4,5,6;7,8,9,10,11"], "column 3: expected a joint angle in deg, found '3;4'"),
    ],
)  # fmt: skip
def test_bad_rows_are_named(tmp_path, lines, expected):
    path = write(tmp_path / "r.csv", *lines)
    text = refused(path, "robodk")
    assert str(path) in text
    assert expected in text


def _turn_and_row(joints="10,-20,30,0,45,90"):
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.3, -0.5, 0.2])
    return turn, turn.as_matrix(), joints


@pytest.mark.parametrize("rows", [3, 4])
def test_orientation_as_a_matrix(tmp_path, rows):
    turn, R, joints = _turn_and_row()
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [900.0, -10.0, 700.0]
    line = f"{joints},{','.join(f'{v:.12g}' for v in T[:rows].ravel())}"
    text = (
        f"{{file: {{header: false}}, columns: {{joints: [1, 2, 3, 4, 5, 6], transform: {list(range(7, 7 + 4 * rows))}}}, "
        "units: {joints: deg, lengths: mm}, fixed: {target: t}}"
    )
    found = understood(write(tmp_path / "t.csv", line, line), str(make_map(tmp_path, text))).table
    assert found.loc[0, XYZ].tolist() == [900.0, -10.0, 700.0]
    assert np.abs(found.loc[0, QUATERNION].to_numpy(float) - np.roll(turn.as_quat(canonical=True), 1)).max() < 1e-9


def test_matrices_that_are_none_are_refused(tmp_path):
    text = (
        "{file: {header: false}, columns: {joints: [1], position: [2, 3, 4], orientation: [5, 6, 7, 8, 9, 10, 11, 12, 13]}, "
        "orientation: {kind: matrix}, units: {joints: deg, lengths: mm}, fixed: {target: t}}"
    )
    name = str(make_map(tmp_path, text))
    assert "found rows that are no unit vectors at right angles" in refused(
        write(tmp_path / "a", "1,900,0,0,1,0,0,1,1,0,0,0,1"), name
    )
    assert "found a left-handed one" in refused(write(tmp_path / "b", "1,900,0,0,1,0,0,0,1,0,0,0,-1"), name)
    bad = str(make_map(tmp_path, "{columns: {transform: [1, 2]}}", "bad.yaml"))
    assert "columns.transform: expected 12 or 16 columns" in refused(write(tmp_path / "c", "1,2"), bad)


def test_blanks_and_tabs_in_one_file(tmp_path):
    path = write(tmp_path / "a.txt", "P1_smr1\t1000 2000\t300", "P2_smr1 1100\t2000 300")
    joints = tmp_path / "j.csv"
    joints.write_text(FOUR_JOINTS)
    found = understood(path, "spatial-analyzer", "units.lengths=mm", joints=joints).table
    assert found[XYZ].to_numpy().tolist() == [[1000, 2000, 300], [1100, 2000, 300]]


def test_compact_time_stamps(tmp_path):
    text = (
        "{file: {header: false}, columns: {joints: [1], position: [2, 3, 4], time: 5}, "
        "units: {joints: deg, lengths: mm, time: iso}, fixed: {target: t}}"
    )
    rows = ["10,900,0,0,20200714163904", "20,901,0,0,20200714163905.250", "30,902,0,0,2020-07-14 16:39:06"]
    time = understood(write(tmp_path / "a", *rows), str(make_map(tmp_path, text))).table["time_s"]
    assert (time - time[0]).tolist() == pytest.approx([0.0, 1.25, 2.0])
    assert "expected a time such as" in refused(
        write(tmp_path / "b", "1,900,0,0,20201714163904"), str(tmp_path / "map.yaml")
    )


def test_targets_of_a_joints_file(tmp_path):
    points = write(tmp_path / "p.csv", "x,y,z", "1000,0,0", "1100,0,0", "1000,5,0", "1100,5,0")
    joints = write(
        tmp_path / "j.csv", "pose,q1_deg,q2_deg,target", *(f"P{p},{10 * p},20,smr{t}" for p in (1, 2) for t in (1, 2))
    )
    text = "{columns: {position: [x, y, z]}, units: {lengths: mm}}"
    name = str(make_map(tmp_path, text))
    found = reader.understand([points], column_map.read_map(name), joints).table
    assert found["target"].tolist() == ["smr1", "smr2", "smr1", "smr2"]
    assert found["pose"].tolist() == ["P1", "P1", "P2", "P2"]
    assert found["q1_deg"].tolist() == [10, 10, 20, 20]
    assert "expected 4 rows, as many as" in refused(write(tmp_path / "q.csv", "x,y,z", "1000,0,0"), name, joints=joints)


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


def test_joints_in_radians_need_no_map(tmp_path):
    points = write(tmp_path / "smr1.csv", "x,y,z", "1000,2,3", "1000,4,5")
    joints = write(tmp_path / "joints.csv", "q1_rad,q2_rad,c1_rad,c2_rad", "0.1,0.2,0.11,0.21", "0.3,0.4,0.31,0.41")
    table = understood(points, "per-target", "units.lengths=mm", joints=joints).table
    assert np.radians(table[["q2_deg", "c1_deg"]]).to_numpy() == pytest.approx(np.array([[0.2, 0.11], [0.4, 0.31]]))
    header = f"pose,{','.join(f'q{k}_rad' for k in range(1, 7))},target,x_mm,y_mm,z_mm"
    own = write(tmp_path / "own.csv", header, "1,0.1,0.2,0,0,0,0,a,1000,2,3")
    table = understood(own, "irbcal", "joints.signs=[1, -1, 1, 1, 1, 1]").table
    assert np.radians(table[["q1_deg", "q2_deg"]]).to_numpy() == pytest.approx(np.array([[0.1, -0.2]]))


def test_own_files_may_have_semicolons_and_decimal_commas(tmp_path):
    points = write(tmp_path / "smr1.csv", "x,y,z", "1000,2,3", "1000,4,5")
    joints = write(tmp_path / "joints.csv", "q1_deg;q2_deg", "0,5;1,25", "0,75;2", encoding="utf-16")
    table = understood(points, "per-target", "units.lengths=mm", joints=joints).table
    assert table[["q1_deg", "q2_deg"]].to_numpy().tolist() == [[0.5, 1.25], [0.75, 2.0]]
    header = f"pose;{';'.join(f'q{k}_deg' for k in range(1, 5))};target;x_mm;y_mm;z_mm"
    own = write(tmp_path / "own.csv", header, "1;0,5;0,25;0;0;a;1000,5;2;3")
    for as_ in (None, "irbcal"):
        table = import_measurements(own, as_=as_, set_=["joints.signs=[1, -1, 1, 1]"]).table
        assert table.loc[0, ["q1_deg", "q2_deg", "x_mm"]].tolist() == [0.5, -0.25, 1000.5]


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
        assert "missing column c2_deg" in refused(points, "per-target", *changes, joints=gap)


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
    assert any("1 rows repeat a target" in text for text in understood(path, chosen).notes)
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
    assert "The rule for group never fits no pose" in found.notes


def test_rows_of_a_pose_that_contradict_carry_file_and_row(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {pose: p, joints: [a], position: [x, y, z]}, units: {joints: deg, lengths: mm}, fixed: {target: t}}",
    )
    path = write(tmp_path / "r.csv", "p,a,x,y,z", "1,10,100,0,0", "1,12,100,0,0")
    with pytest.raises(MeasurementError) as caught:
        reader.understand([path], column_map.read_map(chosen))
    assert (caught.value.file, caught.value.row) == (str(path), 3)


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
    assert found.notes == ("Every point of target b is lost", "Joint 2, 3, 4, 5, 6 never moves")


def test_what_the_reader_would_refuse_is_said_in_rows_of_the_source(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {joints: [a], position: [x, y, z], u95: u}, units: {joints: deg, lengths: mm}, fixed: {target: t}}",
    )
    path = write(tmp_path / "r.csv", "a,x,y,z,u", "", "10,100,0,0,0.1", "11,100,0,0,-1")
    text = refused(path, chosen)
    assert text.startswith(f"{path}: row 4, column u95_mm: expected an uncertainty above zero")


@pytest.fixture
def robodk(tmp_path):
    """Two points of one pose and a lost one of another."""
    rows = [ROW + ",smr1", ROW.replace("1200.5", "1210.5") + ",ref1", ROW.replace("10,", "11,", 1) + ",smr1"]
    return write(tmp_path / "r.csv", "h", *rows[:2], rows[2].replace("1200.5,-35.25,640.75", "0,0,0"))


def test_import_measurements_writes_what_it_returns(robodk, tmp_path):
    out = tmp_path / "new" / "m.csv"
    found = import_measurements(robodk, as_="robodk", out=out)
    assert found.out == out
    assert [path.name for path in out.parent.iterdir()] == ["m.csv"]
    assert out.read_bytes() == found.csv()
    written, seen = table.read(out), found.measurements()
    assert seen.sha256 == written.sha256
    assert seen.source == str(robodk)
    assert np.array_equal(seen.positions(), written.positions(), equal_nan=True)
    assert np.array_equal(seen.joints(), written.joints())
    assert found.report()[-1] == f"Written to {out}"


def test_nothing_is_written_without_out_and_in_a_dry_run(robodk, tmp_path):
    before = sorted(path.name for path in tmp_path.iterdir())
    found = import_measurements(robodk, as_="robodk", out=tmp_path / "m.csv", dry_run=True)
    assert found.out is None
    import_measurements(str(robodk), as_="robodk")
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert found.report()[0] == "3 rows, 2 poses, 1 lost points; points: ref1 1, smr1 1 (and 1 lost)"
    shown = found.report()[1]
    assert shown.columns == ("row of file", "2", "3", "4")
    assert ("x_mm", 1200.5, 1210.5, "") in shown.rows


def test_options_of_the_function(robodk, tmp_path):
    assert len(import_measurements(robodk, as_=column_map.read_map("robodk")).table) == 3
    with pytest.raises(CalibrationError) as caught:
        import_measurements(robodk, as_="robodk", out=tmp_path / "." / "r.csv")
    assert caught.value.parameter == "out"
    mine = make_map(tmp_path, column_map.preset_text("robodk"))
    with pytest.raises(CalibrationError) as caught:
        import_measurements(robodk, as_=mine, out=mine)
    assert caught.value.file == str(mine)
    with pytest.raises(OptionError, match="no changes beside an ImportMap"):
        import_measurements(robodk, as_=column_map.read_map("robodk"), set_={"trust_units": True})
    with pytest.raises(OptionError, match="expected one file or more"):
        import_measurements(as_="robodk")
    with pytest.raises(CalibrationError, match="found a folder"):
        import_measurements(robodk, as_="robodk", out=tmp_path)
    blocked = write(tmp_path / "file", "x")
    with pytest.raises(CalibrationError, match="to this folder"):
        import_measurements(robodk, as_="robodk", out=blocked / "m.csv")


def test_several_files_and_a_joints_file(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    files = [write(tmp_path / f"{name}.csv", "x,y,z", "1000,2,3", "1000,4,5") for name in ("smr1", "ref1")]
    found = import_measurements(*files, as_="per-target", joints=joints, set_={"units.lengths": "mm"})
    seen = found.measurements()
    assert (len(seen), seen.poses) == (4, 2)
    assert np.abs(np.degrees(seen.joints()[1]) - [11, 21, 31, 41, 51, 61]).max() < 1e-12


def test_nobody_can_change_what_was_understood(robodk):
    found = import_measurements(robodk, as_="robodk")
    before = found.csv()
    for frame, column, value in (
        (found.table, "x_mm", 1.0),
        (found.origin, "row", 0),
        (found.to_frame(), "target", "x"),
    ):
        frame[column] = value
    with pytest.raises(FrozenInstanceError):
        found.notes = ()
    assert found.csv() == before
    assert found.origin["row"].tolist() == [2, 3, 4]
    again = pickle.loads(pickle.dumps(found))
    assert again.csv() == before
    assert again.map == found.map


def test_words(robodk, tmp_path):
    found = import_measurements(robodk, as_="robodk", set_={"rename": {"none": "x"}})
    assert len(repr(found)) < 2000
    assert "There is no target none to rename" in found.summary()
    assert "units: {joints: deg, lengths: mm}" in found.summary()
    assert "<table>" in found._repr_html_()


def test_an_import_is_measurements(robodk, tmp_path):
    found = import_measurements(robodk, as_="robodk")
    assert table.read(found).sha256 == found.measurements().sha256
