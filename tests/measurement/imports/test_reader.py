"""Foreign files: each preset on an example written by hand, any dialect back to the numbers, and the refusals."""

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.imports import map_file, reader

JOINTS = [f"q{k}_deg" for k in range(1, 7)]
XYZ = ["x_mm", "y_mm", "z_mm"]
QUATERNION = ["qw", "qx", "qy", "qz"]
FOUR_JOINTS = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\nP1,10,20,30,40,50,60\nP2,11,21,31,41,51,61\n"


def write(path, *lines, encoding="utf-8"):
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def make_map(tmp_path, text, name="map.yaml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def understood(sources, name, *changes, joints=None):
    """The table by a preset or map; what is written is read back to the same numbers."""
    sources = sources if isinstance(sources, list) else [sources]
    found = reader.understand(sources, map_file.read_map(name, changes), joints)
    folder = sources[0].parent
    (folder / "written.csv").write_bytes(found.csv())
    seen = table.read(folder / "written.csv")
    assert np.allclose(seen.table[XYZ], found.table[XYZ], rtol=0, atol=1e-8, equal_nan=True)
    assert seen.table["target"].tolist() == found.table["target"].tolist()
    return found


def refused(sources, name, *changes, joints=None):
    """The one sentence of a refusal."""
    sources = sources if isinstance(sources, list) else [sources]
    with pytest.raises(MeasurementError) as caught:
        reader.understand(sources, map_file.read_map(name, changes), joints).csv()
    text = str(caught.value)
    assert "\n" not in text
    return text


# ---------------------------------------------------------------- presets, numbers by hand


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
    assert np.allclose(found.table[QUATERNION], [[half, 0, 0, half]], atol=1e-12)
    untold = write(tmp_path / "untold.csv", "header", row + ",0,0,90")
    assert understood(untold, "robodk", *euler).table["target"].tolist() == ["tcp"]


def test_robodk_poses_are_runs_of_the_same_joints(tmp_path):
    a, b = "1,2,30,4,5,6", "2,2,30,4,5,6"
    rows = [f"{q},100,200,300,{t}" for q, t in [(a, "s"), (a, "t"), (a, "s"), (b, "s"), (b, "t"), (a, "s")]]
    found = understood(write(tmp_path / "r.csv", "h", *rows), "robodk", "fixed.group=iso")
    assert found.table["pose"].tolist() == ["1", "1", "2", "3", "3", "4"]
    assert set(found.table["group"]) == {"iso"}


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
    assert "expected the unit of the positions to be declared" in refused(path, "spatial-analyzer", joints=joints)
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
    assert np.allclose(R, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)


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
    assert any("1 poses of" in text for text in found.warnings)


def test_two_sessions_of_logs_count_on(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    rows = {"s1_smr1": 100.5, "s1_smr2": 200.5, "s2_smr1": 300.5, "s2_smr2": 400.5}
    paths = [write(tmp_path / f"{name}.csv", "x,y,z", f"{x},0,0") for name, x in rows.items()]
    found = understood(paths, "per-target", "units.lengths=mm", "file_name='{group}_{target}'", joints=joints)
    assert found.table["pose"].tolist() == ["P1", "P1", "P2", "P2"]
    assert found.table["group"].tolist() == ["s1", "s1", "s2", "s2"]
    assert found.table["x_mm"].tolist() == [100.5, 200.5, 300.5, 400.5]


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
    assert np.allclose(R, [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-12)


def test_real_lab_export_equals_the_cleaned_file(shared_data, tmp_path):
    folder = shared_data / "ur10_laser_tracker_6d"
    found = reader.understand([folder / "as_exported_by_the_lab.csv"], map_file.read_map("ur10-lab"))
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


@pytest.mark.parametrize("name", map_file.presets())
def test_presets_are_maps_that_explain_themselves(name):
    text = map_file.preset_text(name)
    assert map_file.read_map(name).about
    assert any(word in text for word in ("Confirmed", "Assumed", "not a maker's format"))


# ---------------------------------------------------------------- maps of one's own

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
    assert np.allclose(seen["u95_mm"], 0.05)
    assert seen["group"].tolist() == ["axis1", "axis1", "rest", "rest"]
    assert set(seen["payload_kg"]) == {5.5}
    assert set(seen["operator"]) == {"Åsa"}


def test_a_joint_measured_against_the_ground(tmp_path):
    path = write(tmp_path / "f.csv", "h", "1,20,30,4,5,6,100,200,300", "1,40,-30,4,5,6,100,200,300")
    found = understood(path, "robodk", "joints.add={3: 2}")
    assert found.table["q3_deg"].tolist() == [50, 10]


def test_status_column_marks_lost_points(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    path = write(tmp_path / "smr1.csv", "x,y,z,state", "1000,2,3,ok", "7,garbage,9,beam broken")
    found = understood(path, "per-target", "units.lengths=mm", "lost.status={column: state, good: [OK]}", joints=joints)
    assert found.lost.tolist() == [False, True]


def test_a_joints_file_of_another_make(tmp_path):
    joints = write(tmp_path / "log.txt", "# robot", "0 0,5 1,0", "1 0,25 -1,0")
    path = write(tmp_path / "smr1.csv", "x,y,z", "1000,2,3", "1000,4,5")
    section = (
        "joints_file={file: {delimiter: space, decimal: ',', comment: '#', header: false}, "
        "columns: {joints: [2, 3]}, units: {joints: rad}}"
    )
    found = understood(path, "per-target", "units.lengths=mm", section, joints=joints)
    assert np.allclose(found.table[["q1_deg", "q2_deg"]], np.degrees([[0.5, 1.0], [0.25, -1.0]]), rtol=0, atol=1e-9)


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


# ---------------------------------------------------------------- any dialect

LENGTHS = {"mm": 1.0, "m": 1e3, "inch": 25.4}


@settings(max_examples=20)
@given(data=st.data())
def test_numbers_come_back_from_any_dialect(data, tmp_path_factory):
    delimiter = data.draw(st.sampled_from([",", ";", "\t", "|", "space"]))
    decimal = data.draw(st.sampled_from([".", ","] if delimiter != "," else ["."]))
    encoding = data.draw(st.sampled_from(["utf-8", "latin-1", "utf-16"]))
    newline = data.draw(st.sampled_from(["\n", "\r\n", "\r"]))
    skip = data.draw(st.integers(0, 3))
    header = data.draw(st.booleans())
    angle = data.draw(st.sampled_from(["deg", "rad"]))
    length = data.draw(st.sampled_from(sorted(LENGTHS)))
    n = data.draw(st.integers(1, 6))
    reals = st.floats(-170, 170).map(lambda v: round(v, 6))
    q = np.array(data.draw(st.lists(st.lists(reals, min_size=6, max_size=6), min_size=n, max_size=n)))
    q[0, 0] = 100.0  # else small angles look like radians
    xyz = np.array(data.draw(st.lists(st.lists(reals, min_size=3, max_size=3), min_size=n, max_size=n))) * 7
    xyz[0, 0] = 3000.0
    lost = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    lost[0] = False
    names = [*(f"Ä{k}" for k in range(1, 7)), "X", "Y", "Z", "Punkt"]
    places = data.draw(st.permutations(range(len(names))))

    def text(value):
        return repr(float(value)).replace(".", decimal)

    columns = [[text(v) for v in (q[:, k] if angle == "deg" else np.radians(q[:, k]))] for k in range(6)]
    for k in range(3):
        columns.append(["LOST" if gone else text(v / LENGTHS[length]) for v, gone in zip(xyz[:, k], lost, strict=True)])
    columns.append([f"smr{k % 2 + 1}" for k in range(n)])
    rows = [list(cells) for cells in zip(*columns, strict=True)]
    mark = " " if delimiter == "space" else delimiter
    lines = ["x" * k for k in range(skip)] + (["// a comment"] if data.draw(st.booleans()) else [])
    for cells in ([names] if header else []) + rows:
        lines.append(mark.join(cells[k] for k in places))
    where = {name: (name if header else places.index(k) + 1) for k, name in enumerate(names)}
    chosen = {
        "file": {"delimiter": data.draw(st.sampled_from([delimiter, "auto"])), "encoding": encoding, "header": header}
        | {"decimal": decimal, "skip_rows": skip, "comment": "//"},
        "columns": {
            "joints": [where[name] for name in names[:6]],
            "position": [where[name] for name in "XYZ"],
            "target": where["Punkt"],
        },
        "units": {"joints": angle, "lengths": length},
        "lost": {"markers": ["lost"]},
    }
    folder = tmp_path_factory.mktemp("dialect")
    (folder / "f.txt").write_bytes(newline.join(lines).encode(encoding))
    seen = understood(folder / "f.txt", make_map(folder, yaml.safe_dump(chosen, allow_unicode=True))).table
    assert np.abs(seen[JOINTS].to_numpy() - q).max() < 1e-8
    assert np.array_equal(seen["x_mm"].isna(), lost | (xyz == 0).all(axis=1))
    have = seen["x_mm"].notna().to_numpy()
    assert np.abs(seen[XYZ].to_numpy() - xyz)[have].max() < 1e-8
    assert seen["target"].tolist() == columns[9]


def test_many_rows(tmp_path):
    rng = np.random.default_rng(0)
    values = np.column_stack([rng.uniform(-170, 170, (30_000, 6)), rng.uniform(-3000, 3000, (30_000, 3))])
    text = pd.DataFrame(values.round(4)).to_csv(index=False, header=False, sep=";", decimal=",")
    (tmp_path / "big.csv").write_text("header\n" + text)
    chosen = map_file.read_map("robodk", ["file.delimiter=;", "file.decimal=,"])
    found = reader.understand([tmp_path / "big.csv"], chosen)
    assert np.abs(found.table[[*JOINTS, *XYZ]].to_numpy() - values.round(4)).max() < 1e-9


# ---------------------------------------------------------------- refusals: files

ROW = "10,-20,30,0,45,90,1200.5,-35.25,640.75"


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


def test_declared_radians_that_are_degrees_and_a_way_round(tmp_path):
    path = write(tmp_path / "r.csv", "h", *[f"{k}0,-20,30,0,45,90,1200,-35,640" for k in range(3)])
    assert "expected joints in rad as declared, found 90" in refused(path, "robodk", "units.joints=rad")
    small = write(tmp_path / "s.csv", "h", *[f"0.{k},-1.5,0.3,0,0.1,3.1,900,0,1" for k in range(4)])
    assert understood(small, "robodk", "trust_units=true").table["q1_deg"].tolist() == [0, 0.1, 0.2, 0.3]
    joints = write(tmp_path / "joints.csv", "q1_deg,q2_deg", *[f"0.{k},1.5" for k in range(3)])
    points = write(tmp_path / "smr1.csv", "x,y,z", *["900,0,1"] * 3)
    text = refused(points, "per-target", "units.lengths=mm", joints=joints)
    assert text.startswith(f"{joints}: row 2, joint 2: expected joints in deg")


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


def test_decimal_marks_are_not_guessed_where_they_could_be_thousands(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    for cells in (["1,975", "2,508", "1,111"], ["1.975,5", "25,5", "1,5"]):
        path = write(tmp_path / "smr1.csv", "x;y;z", ";".join(cells), ";".join(cells))
        assert "declare file.decimal" in refused(path, "per-target", "units.lengths=mm", joints=joints)
    path = write(tmp_path / "smr1.csv", "x;y;z", "1.975,5;2;3", "1;2;3")
    text = refused(path, "per-target", "units.lengths=mm", "file.decimal=,", joints=joints)
    assert "row 2, column x: expected a position in mm or a mark of a lost point, found '1.975,5'" in text
    path = write(tmp_path / "smr1.csv", "x;y;z", "1975,5;2;3", "1;2.125;3")
    text = refused(path, "per-target", "units.lengths=mm", "file.decimal=,", joints=joints)
    assert "row 3, column y: expected" in text
    assert "found '2.125'; the map says file.decimal: ','" in text
    path = write(tmp_path / "smr1.csv", "x;y;z", "1975,5;2;3", "1;2;3")
    assert "the map says file.decimal: '.'" in refused(
        path, "per-target", "units.lengths=mm", "file.decimal=.", joints=joints
    )


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


def test_what_the_reader_would_refuse_is_said_in_rows_of_the_source(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {joints: [a], position: [x, y, z], u95: u}, units: {joints: deg, lengths: mm}, fixed: {target: t}}",
    )
    path = write(tmp_path / "r.csv", "a,x,y,z,u", "", "10,100,0,0,0.1", "11,100,0,0,-1")
    text = refused(path, chosen)
    assert text.startswith(f"{path}: row 4, column u95_mm: expected an uncertainty above zero")


def test_files_that_are_no_text_tables(tmp_path, monkeypatch):
    path = tmp_path / "x.csv"
    path.write_bytes(b"h\n1,2\x00,3\n")
    assert "row 2: expected a text file, found binary data" in refused(path, "robodk")
    path.write_bytes("h\n\nGröße,1".encode("latin-1"))
    text = refused(path, "robodk")
    assert "row 3: expected text in utf-8 (file.encoding), found other bytes" in text
    assert "latin-1" in text
    path.write_bytes(b" \n\n")
    assert "the file is empty" in refused(path, "robodk")
    assert "expected a file, found a folder" in refused(tmp_path, "robodk")
    assert "there is no such file" in refused(tmp_path / "none.csv", "robodk")
    path.write_bytes(b"h\n" + b"1," * 5000)
    assert "expected at most 2000 columns, found 5001" in refused(path, "robodk")
    monkeypatch.setattr(reader.dialect, "LARGEST_FILE", 10)
    path.write_bytes(b"h\n" + ROW.encode())
    assert "expected a file of at most" in refused(path, "robodk")


# ---------------------------------------------------------------- refusals: maps

GOOD = "{columns: {joints: [a], position: [x, y, z]}, units: {joints: deg, lengths: mm}, fixed: {target: t}}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (GOOD.replace("joints: deg, ", ""), "expected the unit of the joints to be declared"),
        (GOOD.replace(", lengths: mm", ""), "expected the unit of the positions to be declared"),
        (GOOD.replace("fixed: {target: t}", "about: x"), "expected the target to be declared"),
        (GOOD.replace("[a]", "[a], time: b"), "expected the unit of the time to be declared"),
        (GOOD.replace("lengths: mm", "lengths: cm"), "units.lengths: expected 'mm', 'm' or 'inch', found 'cm'"),
        (GOOD.replace("lengths", "length"), "units.length: there is no such key; did you mean lengths?"),
        (GOOD.replace("units", "unit"), "unit: there is no such key; did you mean units?"),
        (GOOD.replace("[x, y, z]", "[x, y]"), "columns.position: expected at least 3 items, found ['x', 'y']"),
        (GOOD.replace("[a]", "[x]"), "columns: expected each column of joints and positions once, found 'x' again"),
        (
            GOOD.replace("[x, y, z]", "{s: [x, y, z]}, orientation: [a, a, a]"),
            "columns.orientation: expected one target in a row",
        ),
        (GOOD.replace("[a]", "[0]"), "columns are numbered from 1"),
        (GOOD.replace("[a]", "[no]"), "in quotes if it reads as yes, no"),
        (GOOD.replace("[a]", "[a], keep: {x_mm: b}"), "columns.keep: expected a new name"),
        ("{units: {lengths: mm}}", "columns: expected this key, found nothing"),
        (GOOD.replace("about", "x")[:-1] + ", names: ['{pose}']}", "belong together"),
        (GOOD[:-1] + ", file_name: '{pos}'}", "expected a pattern of {pose}, {target}"),
        (GOOD[:-1] + ", file_name: '{pose}{target}'}", "something between the fields"),
        (GOOD[:-1] + ", orientation: {axes: xxy}}", "two different axes"),
        (GOOD[:-1] + ", joints: {signs: [1, 1]}}", "joints.signs: expected 1 numbers"),
        (GOOD[:-1] + ", joints: {signs: [2]}}", "joints.signs"),
        (GOOD[:-1] + ", groups: [{group: a}]}", "expected either poses"),
        (GOOD.replace("joints: deg", "joints: [deg, deg]"), "units.joints: expected one unit or 1"),
        ("a: &x [1]\nb: *x", "row 1: not a map in YAML: anchors and aliases are not taken"),
        ("a: 1\nb: 2\na: 3", "row 3: not a map in YAML: 'a' stands there twice"),
        ("[" * 1_500, "not a map in YAML"),
        ("a: [1", "not a map in YAML"),
        ("!!python/object/apply:os.system ['true']", "not a map in YAML"),
        ("? {a: 1}\n: 2", "not a map in YAML"),
        ("just words", "expected keys and values"),
        ("# " + "x" * 70_000, "expected a map of at most 64 KiB"),
    ],
)
def test_bad_maps_are_named(tmp_path, text, expected):
    path = write(tmp_path / "f.csv", "a,x,y,z", "10,100,0,0")
    assert expected in refused(path, make_map(tmp_path, text))


def test_names_of_maps_and_changes(tmp_path):
    path = write(tmp_path / "r.csv", "h", ROW)
    assert "robodc: expected a preset (leica-tmac, per-target, robodk" in refused(path, "robodc")
    assert "did you mean robodk?" in refused(path, "robodc")
    assert "there is no such file" in refused(path, str(tmp_path / "none.yaml"))
    assert "expected key=value" in refused(path, "robodk", "units.lengths")
    assert "units.lengths: expected 'mm', 'm' or 'inch'" in refused(path, "robodk", "units.lengths=feet")
    assert "pose_by is no group of keys" in refused(path, "robodk", "pose_by.x=1")
    copied = make_map(tmp_path, map_file.preset_text("robodk"))
    assert understood(path, copied).table.equals(understood(path, "robodk").table)
