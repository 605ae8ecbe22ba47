"""Good inputs, from which damaged ones are made: one folder, written once a run."""

from __future__ import annotations

import ast
import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

import irbcal
from irbcal.arrays import FloatArray
from irbcal.correction.known_languages import KNOWN
from irbcal.correction.language import Language
from irbcal.correction.languages import all_languages
from irbcal.fleet.adding import stored
from irbcal.fleet.store import opened
from irbcal.io import calibration_folder, robots
from irbcal.modeling import frames
from irbcal.modeling.inverse import calibrated_arm

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = Path(__file__).parent / "programs"
RNG = np.random.default_rng(0)


def write(folder: Path) -> None:
    """All good inputs into a folder; a calibration takes some seconds."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = robots.demo_file("demo_identification.csv").read_text().splitlines()
    kept = [line for line in lines[1:] if int(line.split(",")[0]) % 3 == 0 or ",axis" in line]
    _lines(folder / "m.csv", [lines[0], *kept])
    verification = robots.demo_file("demo_verification.csv").read_text().splitlines()
    _lines(folder / "v.csv", verification[:61])
    _save(irbcal.calibrate(folder / "m.csv", "irb1600", "26"), folder / "cal")
    _save(irbcal.calibrate(folder / "m.csv", "irb1600", "16"), folder / "cal2")
    (folder / "robot.urdf").write_bytes(robots.robot_file("irb1600").read_bytes())
    (folder / "small.urdf").write_text(SMALL)
    _joints(folder)
    _tracker(folder)
    _validation(folder)
    _imports(folder)
    _programs(folder)
    _auto(folder)
    _features(folder)
    _lines_of_joints(folder)
    _fleet(folder)
    _pictures(folder)
    _touches(folder)


def _save(made: irbcal.Calibration, folder: Path) -> None:
    """Without its page, which no command reads, and which takes a third of the time."""
    calibration_folder.write(folder, made.record, made.urdf, "")


def _touches(folder: Path) -> None:
    """A tip at one point from six sides, and the three points of a work object, by the calibration ``cal``."""
    loaded = irbcal.load(folder / "cal")
    robot, nominal = loaded.robot_calibrated(), loaded.record.arm(calibrated=False)
    seed = np.tile([0.1, 0.3, 0.1, 0.2, 0.7, 0.1], (9, 1))
    shifts = np.array([*np.zeros((6, 3)), [0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.15, 0.0]])
    turns = 0.3 * np.random.default_rng(3).normal(size=(9, 3))
    T = np.array([robot.poses(seed[:1])[0] @ frames.from_xyz_angles([0.0, 0.0, 0.15, *turn]) for turn in turns])
    T[:, :3, 3] += shifts
    q = np.degrees(
        calibrated_arm.solve(robot, nominal, T @ frames.from_xyz_angles([0, 0, -0.15, 0, 0, 0]), seed=seed).joints
    )
    frames_of = ["tool"] * 6 + ["work_object"] * 3
    points = ["p"] * 6 + ["origin", "x", "xy"]
    names = ["3"] * 6 + ["1"] * 3
    lines = ["frame,name,point,tool,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"]
    for frame, name, point, row in zip(frames_of, names, points, q, strict=True):
        lines.append(",".join([frame, name, point, "3", *(f"{x:.4f}" for x in row)]))
    _lines(folder / "touches.csv", lines)
    on_axes = [f"{line},{'e1_mm,e2_deg' if not k else f'{10 * k},{k % 3}'}" for k, line in enumerate(lines)]
    _lines(folder / "touches-axes.csv", on_axes)


@cache
def languages() -> dict[str, Language]:
    """Every language that the package knows, by the name of its file."""
    return {file.name: language for file, language in zip(KNOWN, all_languages(), strict=True)}


@cache
def programs() -> dict[str, list[Path]]:
    """Sample programs of every language, by the name of its file; maybe none of a new one."""
    return {name: sorted(PROGRAMS.glob(f"{name}.*")) for name in languages()}


@cache
def axes_of(name: str) -> tuple[str, ...]:
    """How the axes of a language's arms point, of a language by its file; empty: any arm."""
    maker = languages()[name].maker
    return () if maker is None else maker.axes


@cache
def endings() -> dict[str, tuple[str, ...]]:
    """Endings of every language's files, by the name of its file."""
    return {name: language.endings for name, language in languages().items()}


@cache
def words(language: str) -> list[bytes]:
    """Pieces of a language: the texts that stand in its readers and in their tests.

    So a language that is added is written by the fuzzer at once.
    """
    found: set[bytes] = set()
    for name in (f"irbcal/correction/languages/{language}.py", f"tests/correction/languages/test_{language}.py"):
        if (ROOT / name).is_file():
            found |= set(_texts(ast.parse((ROOT / name).read_text(encoding="utf-8"))))
    return sorted(found)


def _texts(tree: ast.AST) -> Iterator[bytes]:
    inside = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}  # docstrings
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and node not in inside and isinstance(node.value, (str, bytes)):
            text = node.value.encode("utf-8", "replace") if isinstance(node.value, str) else node.value
            if 1 < len(text) < 2000:
                yield text


def _programs(folder: Path) -> None:
    """Programs, and a calibration of an arm as each language wants it, as ``cal-NAME``; ``cal`` does for most."""
    made: dict[tuple[str, ...], Path] = {}
    for name in languages():
        for path in programs()[name]:
            (folder / f"{name}{path.suffix}").write_bytes(path.read_bytes())
            if path.suffix == ".csv":
                pd.read_csv(path).to_parquet(folder / f"{name}.parquet", index=False)
        if len(programs()[name]) == 1:  # a folder of two programs
            (folder / f"jobs-{name}").mkdir(exist_ok=True)
            for path in programs()[name]:
                for number in (1, 2):
                    (folder / f"jobs-{name}" / f"job{number}{path.suffix}").write_bytes(path.read_bytes())
        axes = axes_of(name)
        if axes and axes not in made:
            made[axes] = _calibration(folder, name, axes)
        if axes:
            shutil.copytree(made[axes], folder / f"cal-{name}", dirs_exist_ok=True)


def _calibration(folder: Path, name: str, axes: tuple[str, ...]) -> Path:
    """A simulated calibration of an arm whose axes point along given directions at zero joints."""
    urdf, measured, out = folder / f"{name}.urdf", folder / f"{name}-m.csv", folder / "made" / name
    urdf.write_text(arm_of(axes), encoding="utf-8")
    irbcal.simulate(urdf, random=40, seed=1).save(measured)
    _save(irbcal.calibrate(measured, urdf, "16"), out)
    return out


def arm_of(axes: tuple[str, ...]) -> str:
    """A URDF of an arm with a spherical wrist, its six axes along ``+z`` and so on."""
    units = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "z": np.array([0, 0, 1.0])}
    steps = [[0, 0, 0.4], [0.15, 0, 0], [0, 0, 0.6], 0.6 * units[axes[3][1]], [0, 0, 0], [0, 0, 0]]
    links = ["base_link", *(f"link_{k}" for k in range(1, 7)), "tool0"]
    parts = [f'<link name="{link}"/>' for link in links]
    for k, (axis, step) in enumerate(zip(axes, steps, strict=True)):
        direction = units[axis[1]] * (1 if axis[0] == "+" else -1)
        parts.append(
            f'<joint name="joint_{k + 1}" type="revolute"><parent link="{links[k]}"/><child link="{links[k + 1]}"/>'
            f'<origin xyz="{" ".join(map(str, step))}"/><axis xyz="{" ".join(map(str, direction))}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    tip = " ".join(map(str, 0.1 * units[axes[5][1]]))
    parts.append(
        f'<joint name="end" type="fixed"><parent link="link_6"/><child link="tool0"/><origin xyz="{tip}"/></joint>'
    )
    return '<?xml version="1.0"?>\n<robot name="made">\n' + "\n".join(parts) + "\n</robot>\n"


def _auto(folder: Path) -> None:
    """Calibrations of model auto: ``cal-map`` (joint map alone) and ``cal-auto`` (loads, last moves, frame terms).

    ``auto-m.csv`` and ``auto-v.csv`` are what the second one is measured with.
    """
    _save(irbcal.calibrate(folder / "m.csv", "irb1600", "auto"), folder / "cal-map")
    parts = []
    for number, load in enumerate((0.5, 5.0)):
        run = irbcal.simulate(
            "irb120", random=32, seed=number + 1, robot_seed=1, cell="realistic", payload=load
        ).measurements()
        rows = run.table.drop(columns=["pose_index", "row"], errors="ignore")
        reference = rows["target"].str.startswith("ref")
        rows["target"] = rows["target"].where(reference, rows["target"] + f"_{number}")
        rows["pose"] = (rows["pose"].astype(int) + 1000 * number).astype(str)
        parts.append(rows)
    rows = pd.concat(parts, ignore_index=True)
    late = rows["pose"].astype(int) % 1000 > 25
    rows[~late].to_csv(folder / "auto-m.csv", index=False, float_format="%.5f")
    rows[late].to_csv(folder / "auto-v.csv", index=False, float_format="%.5f")
    _save(irbcal.calibrate(folder / "auto-m.csv", "irb120", "auto", terms="all"), folder / "cal-auto")


def _features(folder: Path) -> None:
    """Contacts with balls, and what is known of these: ``f.csv`` and ``f.features.csv``."""
    irbcal.simulate_device("irb1600", "balls", 40, seed=1).save(folder / "f.csv")


def _lines_of_joints(folder: Path) -> None:
    """What ``irbcal stream`` reads: ``s.jsonl``."""
    steps = [[0.01 * k, -0.01 * k, 0.0, 0.0, 30.0, 0.02 * k] for k in range(6)]
    lines = [{name: step} for step in steps for name in ("joints", "model")]
    lines = [{**line, "t": 0.01 * k} for k, line in enumerate(lines)]
    _lines(folder / "s.jsonl", [json.dumps(line) for line in [{**lines[0], "at": steps[0]}, *lines[1:]]])


def _fleet(folder: Path) -> None:
    """A list of robots, and a store that holds one: ``fleet.csv``, ``fleet.db``."""
    rows = [
        "id,serial,measurements,robot,date,options",
        "a,1,m.csv,irb1600,2026-03-02,model=16",
        "b,2,no.csv,irb1600,,",
    ]
    _lines(folder / "fleet.csv", rows)
    irbcal.fleet_add([folder / "cal"], folder / "fleet.db", id="a", serial="1", date="2026-03-02")
    for name, options in (("list", "model=16"), ("list2", "model=26")):
        rows = [f"{robot},{robot},m.csv,irb1600,,{options}" for robot in ("a", "b")]
        _lines(folder / f"{name}.csv", ["id,serial,measurements,robot,date,options", *rows])
    _type(folder)


def _type(folder: Path) -> None:
    """A store of six robots of a type, and what to expect of a seventh: ``type.db``, ``prior.json``."""
    one, rng = stored(folder / "cal"), np.random.default_rng(1)
    assert one.terms is not None
    with opened(folder / "type.db", create=True) as store:
        for robot in "abcdef":
            drawn = rng.multivariate_normal(one.terms.values, one.terms.covariance)
            head = {**one.calibration, "robot": robot, "folder": robot}
            about = {**one.robot, "id": robot, "serial": robot}
            store.add(replace(one, robot=about, calibration=head, terms=replace(one.terms, values=drawn)))
            store.add(replace(one, robot=about, calibration={**head, "measured": date(2025, 1, 1)}))
    irbcal.fleet_prior(one.robot["type"], folder / "prior.json", folder / "type.db")


def _pictures(folder: Path) -> None:
    """A picture of a board, where OpenCV is installed, its joints and its camera; samples of easy_handeye2."""
    at = "{{translation: {{x: 0.{0}, y: 0.1, z: 0.4}}, rotation: {{x: {1}, y: {2}, z: 0.0, w: {3}}}}}"
    turns = [(1, 0.0, 0.0, 1.0), (2, 0.6, 0.0, 0.8), (3, 0.0, 0.6, 0.8), (4, -0.6, 0.0, 0.8)]
    poses = [at.format(*turn) for turn in turns]
    samples = [f"- {{robot: {pose}, tracking: {other}}}" for pose, other in zip(poses, reversed(poses), strict=True)]
    _lines(folder / "cell.samples", ["samples:", *samples])
    _lines(folder / "cell.calib", ["parameters: {calibration_type: eye_in_hand}"])
    (folder / "pictures").mkdir()
    _lines(folder / "pictures.csv", ["image,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,place", "1.png,1,2,3,4,5,6,a"])
    names = "feature,kind,fx_px,cx_px,cy_px,width_px,height_px,squares_x,squares_y,square_mm,marker_mm,dictionary"
    _lines(folder / "board.csv", [names, "board,image-on-tool,700,320,240,640,480,8,6,30,22,DICT_5X5_100"])
    try:
        import cv2
    except ImportError:
        (folder / "pictures" / "1.png").write_bytes(b"")
        return
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    drawn = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.022, words).generateImage((480, 360), marginSize=0)
    seen = cv2.copyMakeBorder(drawn, 60, 60, 80, 80, cv2.BORDER_CONSTANT, value=200)
    cv2.imwrite(str(folder / "pictures" / "1.png"), seen)


def _lines(path: Path, lines: list[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _table(path: Path, header: str, *columns: object) -> None:
    rows = zip(*(np.asarray(column, dtype=object) for column in columns), strict=True)
    _lines(path, [header, *(",".join(str(value) for value in row) for row in rows)])


def _joints(folder: Path) -> None:
    names = ",".join(f"q{k}_deg" for k in range(1, 7))
    q = np.round(np.array([[10, -10, 20, 15, 40, -30], [0, -14, 14, 0, 0, 0], [40, 5, 0, -20, 60, 10]], float), 3)
    _table(folder / "j.csv", f"name,{names}", ["a", "b", "=c"], *q.T)
    poses = irbcal.load(folder / "cal").robot_calibrated().poses(np.radians(q))
    turns = np.array([frames.quaternion_from_matrix(T[:3, :3]) for T in poses])
    _table(folder / "p.csv", "x_mm,y_mm,z_mm,qw,qx,qy,qz", *(1e3 * poses[:, :3, 3]).T, *turns.T)
    _table(folder / "dh.csv", "joint,alpha_deg,a_mm,theta_deg,d_mm,lower_deg,upper_deg", *DH.T)
    _table(folder / "c.csv", f"{names},x_mm,y_mm,z_mm,qw,qx,qy,qz", *_controller().T)
    _table(folder / "t.csv", "target,x_mm,y_mm,z_mm", ["smr1", "smr2", "smr3"], [-87, 84, 86], [87, 84, -86], [110] * 3)


DH = np.array(
    [
        ["j1", 0, 0, 0, 290, -165, 165], ["j2", -90, 0, -90, 0, -110, 110], ["j3", 0, 270, 0, 0, -110, 70],
        ["j4", -90, 70, 0, 302, -160, 160], ["j5", 90, 0, 0, 0, -120, 120], ["j6", -90, 0, 180, 72, -400, 400],
    ],
    dtype=object,
)  # fmt: skip


def _controller() -> FloatArray:
    """Joints (degrees) and poses (millimetres, quaternions) that a controller would report for an IRB 120."""
    arm = irbcal.read_urdf("irb120").arm
    q = 0.8 * arm.random_joints(12, 1)
    poses = arm.forward(q)
    turns = np.array([frames.quaternion_from_matrix(T[:3, :3]) for T in poses])
    return np.round(np.column_stack([np.degrees(q), 1e3 * poses[:, :3, 3], turns]), 6)


def _tracker(folder: Path) -> None:
    n = 30
    x, y, z = np.round(RNG.normal(0, 0.004, (3, n)), 6)
    end = ["A", "B"] * (n // 2)
    bar = x + np.where(np.array(end) == "B", 1000.0, 0.0)
    _table(folder / "bar.csv", "position,end,x_mm,y_mm,z_mm", [1 + k // 10 for k in range(n)], end, bar, y, z)
    _table(folder / "repeat.csv", "position,x_mm,y_mm,z_mm", ["P1", "P2"] * (n // 2), x + 900, y, z)
    air = [22 + 0.1 * k for k in range(n)]
    _table(folder / "drift.csv", "time_s,x_mm,y_mm,z_mm,temperature_c", range(0, 17 * n, 17), x + 5, y, z, air)
    time = np.tile(np.arange(10) * 0.75, 3)
    _table(folder / "settle.csv", "run,time_s,x_mm,y_mm,z_mm", [1 + k // 10 for k in range(n)], time, x, y, z)


def _validation(folder: Path) -> None:
    angle = np.arange(0, 360, 12.0)
    _table(folder / "ball.csv", "angle_deg,radius_mm", angle, 150 + 0.05 * np.cos(np.radians(angle)))
    rows = ["pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,cycle,target,x_mm,y_mm,z_mm"]
    paths = ["cycle,x_mm,y_mm,z_mm"]
    approach = ["run,time_s,x_mm,y_mm,z_mm"]
    poses = ["pose,x_mm,y_mm,z_mm"]
    for p in range(5):
        poses.append(f"P{p + 1},{900 + 50 * p},{30 * p},{700 - 20 * p}")
        for c in range(1, 4):
            place = RNG.normal(0, 0.02, 3) + np.array([900.0 + 50 * p, 30 * p, 700 - 20 * p])
            joints = ",".join(f"{v:.3f}" for v in (10.0 * p, -10 + 5.0 * p, 20 - 3.0 * p, 15.0, 40.0, -30.0))
            rows.append(f"P{p + 1},{joints},{c},smr1," + ",".join(f"{v:.5f}" for v in place))
    for c in (1, 2, 3):
        for k in range(12):
            paths.append(f"{c},{900 + 10 * k},{RNG.normal(0, 0.02):.5f},700")
            approach.append(f"{c},{0.2 * k:.2f},{900 + np.exp(-k):.5f},0,700")
    _lines(folder / "cycles.csv", rows)
    _lines(folder / "commanded.csv", poses)
    _lines(folder / "path.csv", paths)
    _lines(folder / "approach.csv", approach)
    _lines(folder / "commanded_path.csv", ["x_mm,y_mm,z_mm", "900,0,700", "1010,0,700"])


def _imports(folder: Path) -> None:
    axes = ["axis,carries,dx,dy,dz,x_mm,y_mm,z_mm", "e1_mm,robot,0,1,0,,,", "e2_deg,fixture,0,1,0,900,0,400"]
    _lines(folder / "axes.csv", axes)
    xml = (folder / "robot.urdf").read_text(encoding="utf-8").replace('name="link_1"', 'name="${prefix}link_1"')
    xml = xml.replace('link="link_1"', 'link="${prefix}link_1"')
    argument = '<xacro:property name="prefix" value="l_"/>'
    start = xml.index(">", xml.index("<robot")) + 1
    head = xml[:start].replace("<robot", '<robot xmlns:xacro="http://ros.org/wiki/xacro"', 1)
    (folder / "robot.xacro").write_text(head + argument + xml[start:], encoding="utf-8")
    rows = pd.read_csv(folder / "m.csv")
    names = ["Nr", *(f"A{k}" for k in range(1, 7)), "Punkt", "X", "Y", "Z"]
    columns = rows[["pose", *(f"q{k}_deg" for k in range(1, 7)), "target", "x_mm", "y_mm", "z_mm"]]
    text = columns.set_axis(names, axis=1).to_csv(sep=";", decimal=",", index=False, float_format="%.4f")
    (folder / "messy.csv").write_bytes(f"Messprotokoll;Prüfer: Müller\n\n{text}".encode("latin-1"))
    joints = "shoulder_pan_joint;shoulder_lift_joint;elbow_joint;wrist_1_joint;wrist_2_joint;wrist_3_joint"
    place = "measurement_x;measurement_y;measurement_z;measurement_rx;measurement_ry;measurement_rz"
    lab = [f"0,{k};0,5;-0,25;1,{k};0,1;0,2;12{k}0,5;-35,25;640,75;1,5;2,5;3{k},5;21,5" for k in range(1, 6)]
    _lines(folder / "lab.csv", [f"{joints};{place};measurement_temperature", *lab])
    _lines(folder / "sa.txt", ["// comment", *(f"P{k}_smr1, {1975 + k}.5, -310.1{k}, -257.8" for k in range(1, 5))])
    _lines(folder / "tmac.csv", ["X;Y;Z;Q0;Q1;Q2;Q3", *(f"236{k},98;-1368,5;119,3;0,5;-0,5;0,5;0,5" for k in range(4))])
    names = ",".join(f"q{k}_deg" for k in range(1, 7))
    _lines(folder / "pj.csv", [f"pose,{names}", *(f"P{k},1{k},20,30,40,50,6{k}" for k in range(1, 5))])
    _lines(folder / "map.yaml", MAP.splitlines())


def calibration(folder: Path) -> dict[str, object]:
    """Content of the good calibration.json."""
    return dict(json.loads((folder / "cal" / "calibration.json").read_bytes()))


MAP = """about: a map
file: {encoding: utf-8, delimiter: ";", decimal: ","}
columns:
  joints: [shoulder_pan_joint, shoulder_lift_joint, elbow_joint, wrist_1_joint, wrist_2_joint, wrist_3_joint]
  position: [measurement_x, measurement_y, measurement_z]
  orientation: [measurement_rx, measurement_ry, measurement_rz]
  keep: {temperature_c: measurement_temperature}
units: {joints: rad, lengths: mm, angles: deg}
orientation: {kind: euler, axes: xyz, about: moving, maps: target-to-tracker}
fixed: {target: tmac}
lost: {markers: [INVALID, -9999]}"""

SMALL = """<?xml version="1.0"?>
<robot name="small">
  <link name="base_link"/><link name="a"/><link name="b"><visual><geometry><box size="1 .1 .1"/></geometry></visual></link>
  <link name="c"/><link name="tool0"/>
  <joint name="j1" type="revolute"><parent link="base_link"/><child link="a"/><origin xyz="0 0 0.4" rpy="0 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="j3" type="continuous"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0" rpy="0.1 0.2 0.3"/>
    <axis xyz="0 1 0"/></joint>
  <joint name="f" type="fixed"><parent link="c"/><child link="tool0"/><origin xyz="0 0 0.1"/></joint>
</robot>
"""
