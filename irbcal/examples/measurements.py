"""What trackers, other programs, checks and touches of the virtual cell write: example files, all SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from irbcal.arrays import FloatArray
from irbcal.correction.languages import ros
from irbcal.io import robots, urdf
from irbcal.measurement.column_names import POSITION, QUATERNION
from irbcal.measurement.input_table import poses_to_frame
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.trajectory import Trajectory
from irbcal.names import csv_bytes
from irbcal.simulation import weights
from irbcal.simulation.devices import simulate_device
from irbcal.simulation.pose_list import PoseList, numbered, random_list
from irbcal.simulation.shipped_cells import open_cell, shipped_cell
from irbcal.simulation.simulation import measurement_table
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.units import DEG, MM
from irbcal.validation.ballbar_check import CENTER_JOINTS, circle
from irbcal.validation.pose_check import ISO_POSES as CUBE_POSES
from irbcal.validation.pose_check import five_poses


@dataclass(frozen=True)
class Sample:
    """An example file."""

    path: str
    """In the folder of the samples, with slashes."""
    content: bytes
    about: str
    """What it is, in a few words."""
    tried: str = ""
    """A command that reads it, as typed in that folder; empty where another file's command reads this one, too."""


ROBOT = "irb1600"
TARGETS = ("smr1", "smr2", "smr3")
REFERENCES = ("ref1", "ref2", "ref3")
POSES, VERIFICATION, LATER = 100, 60, 40
MOVES = np.arange(-60.0, 61.0, 10.0)
"""Angles of the moves of one joint, degrees."""
MOVED = frames.transform(frames.rotation_from_vector(np.array([0.0, 0.0, 0.4])), np.array([0.3, -0.2, 0.05]))
"""Where the tracker stood later, seen from where it stood before."""
PROGRAM = (
    (4, 8, -39, 9, -17, -62),
    (34, 24, -16, 67, -29, -34),
    (20, 16, -10, -1, -40, -29),
    (17, 10, 17, 30, -69, -20),
    (-18, 33, -30, -48, -22, 50),
    (-18, 6, 47, 60, 66, -44),
)
"""Joints of a small program, degrees; the tracker sees the tool at all of its stops."""


def example_cell(seed: int = 0) -> VirtualCell:
    """The virtual cell that the samples come from: three reflectors on the tool, three on the floor."""
    cell = open_cell(ROBOT, seed=seed).with_targets(TARGETS)
    return cell.replace(references={name: cell.references[name] for name in REFERENCES})


def measured_table(cell: VirtualCell, poses: PoseList) -> pd.DataFrame:
    """The rows of a measurement file."""
    return measurement_table(cell.measure(poses.q, poses.measured_targets(cell), poses.wait_s), poses, cell.arm)


def one_joint_moves(joints: int) -> PoseList:
    """Every joint moved alone, there and back."""
    angles = np.concatenate([MOVES, MOVES[::-1]]) * DEG
    home = np.zeros(joints)
    home[4] = 30 * DEG
    q = np.vstack([_moved(home, joint, angles) for joint in range(joints)])
    group = np.repeat([f"axis{joint + 1}" for joint in range(joints)], len(angles)).astype(object)
    return PoseList(q, numbered(len(q)), None, np.full(len(q), 4.0), {"group": group}, "moves of one joint")


def _moved(home: FloatArray, joint: int, angles: FloatArray) -> FloatArray:
    q = np.tile(home, (len(angles), 1))
    q[:, joint] = angles * (0.5 if joint in (1, 2) else 1.0)
    return q


def seen_from_elsewhere(table: pd.DataFrame) -> pd.DataFrame:
    """The same points in the frame of the moved tracker."""
    T_moved = frames.inverse(MOVED)
    xyz = table[list(POSITION)].to_numpy(dtype=float) * MM
    moved = table.copy()
    moved[list(POSITION)] = np.round((xyz @ T_moved[:3, :3].T + T_moved[:3, 3]) / MM, 4)
    return moved


def tracker_files() -> Iterator[Sample]:
    """Measurements, joints, poses and a program of the IRB 1600."""
    cell = example_cell()
    table = measured_table(cell, random_list(cell, POSES, 1))
    yield from _main(cell, table)
    yield from _other_days(table)
    yield from _loads()
    yield from _lists(cell)


def _main(cell: VirtualCell, table: pd.DataFrame) -> Iterator[Sample]:
    """What the first steps need."""
    data = robots.robot_file(ROBOT).read_bytes()
    yield Sample("my_robot.urdf", data, "the nominal robot", "irbcal view my_robot.urdf")
    command = "irbcal calibrate measured.csv --robot my_robot.urdf --out my-robot"
    yield Sample("measured.csv", csv_bytes(table), f"{POSES} poses, three reflectors, three references", command)
    other_cell = example_cell(1)
    proof = measured_table(other_cell, random_list(other_cell, VERIFICATION, 2))
    yield Sample("verification.csv", csv_bytes(proof), "other poses", "irbcal evaluate my-robot verification.csv")
    moves = measured_table(example_cell(3), one_joint_moves(len(cell.arm.joint_names)))
    yield Sample("moves.csv", csv_bytes(moves), "moves of one joint, there and back", "irbcal joints moves.csv")
    drawn_places = pd.DataFrame(cell.tool.cad / MM, columns=list(POSITION))
    drawn_places.insert(0, "target", cell.tool.names)
    command = "irbcal circles moves.csv --robot irb1600 --drawn cad.csv"
    yield Sample("cad.csv", csv_bytes(drawn_places), "the tool as it was drawn", command)


def _other_days(table: pd.DataFrame) -> Iterator[Sample]:
    """Measured later: the tracker, or the reflectors, stood elsewhere."""
    later = example_cell(2)
    new = seen_from_elsewhere(measured_table(later, random_list(later, LATER, 3)))
    command = "irbcal calibrate new.csv --with my-robot --out my-robot-2"
    yield Sample("new.csv", csv_bytes(new), "more poses, from another place of the tracker", command)
    two_days = pd.concat([table.assign(session="Monday"), new.assign(session="Tuesday")])
    two_days["pose"] = two_days["session"].str[0] + two_days["pose"].astype(str)
    command = "irbcal calibrate two_days.csv --robot my_robot.urdf --out two-days"
    yield Sample("two_days.csv", csv_bytes(two_days), "two sessions in one file", command)
    cell = open_cell(ROBOT, seed=6).without("visibility")
    names = dict(zip(cell.tool.names[3:6], TARGETS, strict=True))
    cell = cell.with_targets(tuple(names)).replace(references=example_cell().references)
    remounted = measured_table(cell, random_list(cell, LATER, 7)).replace({"target": names})
    command = "irbcal evaluate my-robot remounted.csv --refit-tool"
    yield Sample("remounted.csv", csv_bytes(remounted), "the reflectors remounted", command)
    command = "irbcal evaluate my-robot all_moved.csv --refit-base --refit-tool --refit-from 10"
    yield Sample(
        "all_moved.csv", csv_bytes(seen_from_elsewhere(remounted)), "reflectors remounted and tracker moved", command
    )


def _loads() -> Iterator[Sample]:
    """Measured with several loads."""
    tables = []
    for load, (kilograms, seed) in enumerate(((1.0, 8), (5.0, 9), (3.0, 10))):
        cell = example_cell(seed).with_payload(kilograms)
        table = measured_table(cell, random_list(cell, LATER, seed))
        table["pose"] = [f"L{load}_{pose}" for pose in table["pose"]]
        tables.append(table)
    command = "irbcal calibrate two_loads.csv --robot my_robot.urdf --same-tool --out two-loads"
    yield Sample("two_loads.csv", csv_bytes(pd.concat(tables[:2])), "the same robot with 1 and with 5 kg", command)
    yield Sample("third_load.csv", csv_bytes(tables[2]), "and with 3 kg", "irbcal evaluate two-loads third_load.csv")


def _lists(cell: VirtualCell) -> Iterator[Sample]:
    """Joints, poses, a program, a table of Denavit-Hartenberg parameters."""
    arm = cell.arm
    q = np.array(PROGRAM, dtype=float)
    joints = pd.DataFrame(q, columns=arm.joint_columns)
    yield Sample("joints.csv", csv_bytes(joints), "joints", "irbcal fk my-robot --joints joints.csv")
    yield Sample(
        "job.csv", csv_bytes(joints), "a program of joints", "irbcal filter my-robot job.csv --out corrected.csv"
    )
    yield from _trajectory(arm, q[:-1] * DEG)  # the last one lies behind a singularity
    poses = poses_to_frame(arm.forward(q * DEG)).round(9)
    yield Sample("poses.csv", csv_bytes(poses), "poses of the tip", "irbcal ik my-robot --poses poses.csv")
    command = "irbcal urdf --dh table.csv --convention modified --out arm.urdf"
    yield Sample("table.csv", DH_TABLE.encode(), "Denavit-Hartenberg parameters", command)


DH_TABLE = """joint,alpha_deg,a_mm,theta_deg,d_mm,lower_deg,upper_deg
joint_1,0,0,0,486.5,-180,180
joint_2,-90,150,-90,0,-90,150
joint_3,0,700,0,0,-238,65
joint_4,-90,110,0,600,-200,200
joint_5,90,0,0,0,-115,115
joint_6,-90,0,180,65,-400,400
"""


def _trajectory(arm: Arm, q: FloatArray) -> Iterator[Sample]:
    """The way between the joints of a program, from rest to rest."""
    through = CubicSpline(3.0 * np.arange(len(q)), q, bc_type="clamped")
    t = np.array([0.1 * k for k in range(30 * (len(q) - 1) + 1)])
    motion = Trajectory(t, through(t), names=arm.joint_names, prismatic=arm.table.prismatic)
    motion = replace(motion, dq=through(t, 1), ddq=through(t, 2))
    command = "irbcal filter my-robot trajectory.yaml --out trajectory-sent.yaml"
    yield Sample("trajectory.yaml", ros.to_yaml(motion).encode(), "a motion as a ROS JointTrajectory", command)
    command = "irbcal filter my-robot trajectory.csv --out trajectory-sent.csv"
    yield Sample("trajectory.csv", csv_bytes(motion.to_frame(), float_format="%.9f"), "the same motion as CSV", command)


FOREIGN_POSES = 40


def foreign_files() -> Iterator[Sample]:
    """A file or a set of files for each preset."""
    cell = example_cell(4).without("lost", "visibility")
    poses = random_list(cell, FOREIGN_POSES, 4)
    run = cell.measure(poses.q, None, poses.wait_s)
    joints = np.round(poses.q / DEG, 6)
    xyz = np.round(run.xyz / MM, 4)
    yield from _by_joints(joints, xyz[:, : run.targets], run.names[: run.targets])
    yield from _apart(joints, xyz, run.names)
    yield from _full_poses(cell.tracker.T_tracker_base @ run.T_base_tip)
    yield from _lab_export()


def _by_joints(joints: FloatArray, xyz: FloatArray, names: tuple[str, ...]) -> Iterator[Sample]:
    rows = [(*q, *p, k) for q, points in zip(joints, xyz, strict=True) for k, p in enumerate(points, start=1)]
    columns = [*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z", "TCP"]
    command = "irbcal import robodk.csv --as robodk --out from_robodk.csv"
    yield Sample(
        "robodk.csv", _marked(csv_bytes(pd.DataFrame(rows, columns=columns))), "as RoboDK takes measurements", command
    )
    points = [f"{axis}{k}" for k in range(1, len(names) + 1) for axis in "XYZ"]
    wide = pd.DataFrame(np.hstack([joints, xyz.reshape(len(joints), -1)]), columns=[*columns[:6], *points])
    mapped = ", ".join(f"{name}: [X{k}, Y{k}, Z{k}]" for k, name in enumerate(names, start=1))
    command = (
        "irbcal import wide.csv --as table --set 'columns.joints=[J1, J2, J3, J4, J5, J6]' "
        f"--set 'columns.position={{{mapped}}}' --set units.joints=deg --set units.lengths=mm --out from_wide.csv"
    )
    yield Sample("wide.csv", _marked(csv_bytes(wide, sep=";")), "a row a pose, all points in it", command)
    turned = csv_bytes(_own(joints * np.array([1, 1, -1, 1, 1, 1]), xyz, names))
    command = "irbcal import turned.csv --as irbcal --set 'joints.signs=[1, 1, -1, 1, 1, 1]' --out mended.csv"
    yield Sample("turned.csv", turned, "irbcal's own format with the sign of joint 3 turned", command)


def _marked(table: bytes) -> bytes:
    """A file of another program, with the comment by which an import takes it for simulated."""
    return b"# SIMULATED\n" + table


def _own(joints: FloatArray, xyz: FloatArray, names: tuple[str, ...]) -> pd.DataFrame:
    n, m = xyz.shape[:2]
    table = pd.DataFrame(np.repeat(joints, m, axis=0), columns=[f"q{k}_deg" for k in range(1, 7)])
    table.insert(0, "pose", np.repeat(np.arange(1, n + 1), m))
    table["target"] = np.tile(np.array(names, dtype=object), n)
    table[list(POSITION)] = xyz.reshape(-1, 3)
    table["simulated"] = "yes"
    return table


def _apart(joints: FloatArray, xyz: FloatArray, names: tuple[str, ...]) -> Iterator[Sample]:
    """Points in files of their own, joints in another."""
    table = pd.DataFrame(joints, columns=[f"q{k}_deg" for k in range(1, 7)])
    table.insert(0, "pose", [f"P{k}" for k in range(1, len(joints) + 1)])
    yield Sample("measured_joints.csv", csv_bytes(table), "joints of the poses measured below")
    lines = ["// SIMULATED points, working frame: tracker, millimetres"]
    for pose, points in zip(table["pose"], xyz, strict=True):
        lines += [f"{pose}_{name}, {x:.4f}, {y:.4f}, {z:.4f}" for name, (x, y, z) in zip(names, points, strict=True)]
    text = ("\n".join(lines) + "\n").encode()
    command = (
        "irbcal import points.txt --as spatial-analyzer --set units.lengths=mm --joints measured_joints.csv "
        "--out from_points.csv"
    )
    yield Sample("points.txt", text, "as SpatialAnalyzer exports points", command)
    command = "irbcal import smr*.csv ref*.csv --as per-target --set units.lengths=mm --joints measured_joints.csv "
    for k, name in enumerate(names):
        log = pd.DataFrame(xyz[:, k], columns=["x", "y", "z"])
        tried = command + "--out from_logs.csv" if k == 0 else ""
        yield Sample(
            f"{name}.csv", _marked(csv_bytes(log, sep=";", decimal=",")), f"a log of {name}, a row a pose", tried
        )


def _full_poses(T: FloatArray) -> Iterator[Sample]:
    """A file of a tracker that measures orientations: the tip in the tracker's frame, exactly."""
    table = poses_to_frame(T).round({**dict.fromkeys(POSITION, 4), **dict.fromkeys(QUATERNION, 9)})
    table.columns = ["X", "Y", "Z", "Q0", "Q1", "Q2", "Q3"]
    command = "irbcal import tmac.csv --as leica-tmac --joints measured_joints.csv --out from_tmac.csv"
    yield Sample("tmac.csv", _marked(csv_bytes(table, sep=";", decimal=",")), "poses of a Leica T-Mac", command)


def _lab_export() -> Iterator[Sample]:
    """A UR10 as a lab wrote it down: the tip in the tracker's frame, exactly."""
    from scipy.spatial.transform import Rotation

    robot = urdf.read("ur10")
    cell = shipped_cell(robot.arm, weights.bodies(robot)).with_targets(TARGETS)
    poses = random_list(cell, FOREIGN_POSES, 4)
    q, T = poses.q, cell.tracker.T_tracker_base @ cell.measure(poses.q, None, poses.wait_s).T_base_tip
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    angles = Rotation.from_matrix(T[:, :3, :3]).as_euler("XYZ", degrees=True)
    columns = [*(f"{name}_joint" for name in names), *(f"measurement_{c}" for c in ("x", "y", "z", "rx", "ry", "rz"))]
    table = pd.DataFrame(np.round(np.hstack([q, np.round(T[:, :3, 3] / MM, 4), angles]), 9), columns=columns)
    table["measurement_temperature"] = 21.0
    command = "irbcal import export.csv --as ur10-lab --out from_lab.csv"
    about = "a lab's export of a UR10 with decimal commas"
    yield Sample("export.csv", _marked(csv_bytes(table, sep=";", decimal=",")), about, command)


CYCLES = 30
BAR = 150.0 * MM
SCALE_BAR_MM = 1050.688
READING_NOISE_MM = 0.01
"""Of a reading, mm."""


def check_files() -> Iterator[Sample]:
    """Files of every check."""
    cell = example_cell(5).without("lost", "visibility")
    rng = np.random.default_rng(5)
    yield from _iso9283(cell, rng)
    yield from _tracker(rng)
    yield from _ballbar(cell, rng)
    yield from _controller(cell.arm.random_joints(40, 6), cell)


def _iso9283(cell: VirtualCell, rng: np.random.Generator) -> Iterator[Sample]:
    q = five_poses(cell.arm).q
    n = CYCLES * len(q)
    extra = {"cycle": np.repeat(np.arange(1, CYCLES + 1), len(q)).astype(str).astype(object)}
    poses = PoseList(
        np.tile(q, (CYCLES, 1)),
        np.tile(np.array(CUBE_POSES, dtype=object), CYCLES),
        None,
        np.full(n, 4.0),
        {**extra, "group": np.full(n, "iso9283", dtype=object)},
        "cycles",
    )
    table = measured_table(cell, poses)
    command = "irbcal iso9283 iso9283.csv --calibration my-robot"
    yield Sample("iso9283.csv", csv_bytes(table), f"the five test poses, {CYCLES} cycles", command)
    t = np.arange(0, 14, 0.1)
    settling = np.concatenate([_series(t, run, 0.4 * np.exp(-1.5 * t), rng) for run in (1, 2, 3)])
    columns = ["run", "time_s", *POSITION]
    command = "irbcal iso9283 iso9283.csv --calibration my-robot --approaches approaches.csv"
    table = pd.DataFrame(settling, columns=columns).assign(simulated="yes")
    yield Sample("approaches.csv", csv_bytes(table), "the robot coming to rest", command)
    yield from _paths(rng)
    yield from _moves_and_forces(rng)


def _paths(rng: np.random.Generator) -> Iterator[Sample]:
    """Two legs with a corner that is rounded, run at 250 mm/s and sampled at 100 Hz; 0.1 mm beside."""
    corners = pd.DataFrame([(0.0, 0.0, 500.0), (100.0, 0.0, 500.0), (100.0, 100.0, 500.0)], columns=list(POSITION))
    yield Sample("commanded_path.csv", csv_bytes(corners), "a path with a corner as it was commanded")
    s = np.arange(-10.0, 210.0, 2.5)
    x, y = np.minimum(s, 100.0), np.maximum(s - 100.0, 0.0)
    off = 2.0 * np.exp(-(((s - 100.0) / 8.0) ** 2))  # cut short at the corner
    tables = []
    for cycle in range(1, 11):
        xyz = np.column_stack([x - off / np.sqrt(2), y + off / np.sqrt(2), np.full(len(s), 500.1)])
        xyz += 0.01 * rng.standard_normal(xyz.shape)
        tables.append(np.column_stack([np.full(len(s), cycle), np.arange(len(s)) * 0.01, xyz]))
    table = pd.DataFrame(np.round(np.vstack(tables), 4), columns=["cycle", "time_s", *POSITION])
    command = "irbcal iso9283 --path path.csv --commanded-path commanded_path.csv --velocity 250 --window 0.05"
    yield Sample(
        "path.csv", csv_bytes(table.astype({"cycle": int}).assign(simulated="yes")), "ten cycles of that path", command
    )


def _moves_and_forces(rng: np.random.Generator) -> Iterator[Sample]:
    """Moves from rest to rest, and places under load: 0.02 mm/N along x."""
    t = np.arange(0, 2.5, 0.01)
    rows = []
    for length, took in ((100.0, 0.5), (200.0, 0.8)):
        phase = np.clip((t - 0.3) / took, 0, 1)
        x = length * (phase - np.sin(2 * np.pi * phase) / (2 * np.pi))
        for cycle in (1, 2, 3):
            xyz = np.column_stack([x, 0 * x, 500 + 0 * x]) + 0.002 * rng.standard_normal((len(t), 3))
            rows += [(f"{length:g} mm", cycle, *row) for row in np.round(np.column_stack([t, xyz]), 4)]
    table = pd.DataFrame(rows, columns=["move", "cycle", "time_s", *POSITION]).assign(simulated="yes")
    command = "irbcal iso9283 --moves posing.csv --band 0.1"
    yield Sample("posing.csv", csv_bytes(table), "moves from rest to rest", command)
    rows = []
    for k, axis in enumerate("xyz"):
        for sign in (1, -1):
            for force in (0.0, 20.0, 40.0, 60.0):
                for cycle in (1, 2, 3):
                    xyz = np.array([812.3, 10.0, 955.3]) + 0.002 * rng.standard_normal(3)
                    xyz[k] += sign * force * (0.02, 0.015, 0.01)[k]
                    rows.append((f"{'+' if sign > 0 else '-'}{axis}", force, cycle, *np.round(xyz, 4)))
    table = pd.DataFrame(rows, columns=["direction", "force_n", "cycle", *POSITION]).assign(simulated="yes")
    data = table.to_csv(index=False, lineterminator="\n").encode()  # +x is a direction, and no formula
    yield Sample("forces.csv", data, "places under load", "irbcal iso9283 --forces forces.csv")


def _series(t: FloatArray, run: int, distance: FloatArray, rng: np.random.Generator) -> FloatArray:
    xyz = (
        np.array([800.0, 50.0, 900.0]) + distance[:, None] * [0.6, 0.0, 0.8] + 0.002 * rng.standard_normal((len(t), 3))
    )
    return np.round(np.column_stack([np.full(len(t), run), t, xyz]), 4)


def _tracker(rng: np.random.Generator) -> Iterator[Sample]:
    rows = []
    for k in range(20):
        turn = frames.rotation_from_vector(np.array([0.0, 0.1 * k, 0.3 * k]))
        for end, half in (("A", -0.5), ("B", 0.5)):
            place = np.array([2500.0 + 30 * k, -400.0, 300.0]) + turn @ np.array([half * SCALE_BAR_MM, 0, 0])
            rows.append((k + 1, end, *np.round(place + READING_NOISE_MM * rng.standard_normal(3), 4)))
    table = pd.DataFrame(rows, columns=["position", "end", *POSITION]).assign(simulated="yes")
    yield Sample(
        "bar.csv", csv_bytes(table), "a scale bar in 20 places", f"irbcal tracker bar.csv --length {SCALE_BAR_MM}"
    )
    xyz = np.array([2500.0, -400.0, 300.0]) + READING_NOISE_MM * rng.standard_normal((60, 3))
    table = pd.DataFrame(np.round(xyz, 4), columns=list(POSITION)).assign(simulated="yes")
    yield Sample("repeat.csv", csv_bytes(table), "one point, 60 readings", "irbcal tracker repeat.csv")
    t = np.arange(0, 4 * 3600, 120.0)
    warmth = 21 + 1.5 * np.sin(t / 5000)
    xyz = (
        np.array([2500.0, -400.0, 300.0])
        + 0.02 * (warmth - 21)[:, None]
        + READING_NOISE_MM * rng.standard_normal((len(t), 3))
    )
    table = pd.DataFrame(np.round(np.column_stack([t, xyz, warmth]), 4), columns=["time_s", *POSITION, "temperature_c"])
    table["simulated"] = "yes"
    yield Sample("drift.csv", csv_bytes(table), "one point for four hours", "irbcal tracker drift.csv")


def _ballbar(cell: VirtualCell, rng: np.random.Generator) -> Iterator[Sample]:
    """Radii of a circle that the controller runs with its nominal model, as the true robot of the cell has them."""
    from irbcal.correction.paths import joint_history

    arm = cell.arm
    centre = np.asarray(CENTER_JOINTS)
    path = circle(arm, centre, BAR)
    s = np.arange(0, 1, 1 / 360)
    true = cell.only("compliance").measure(joint_history(path, arm, centre, s)).T_base_tip[:, :3, 3]
    radius = np.linalg.norm(true - path.ball, axis=1)
    radius += BAR - radius.mean() + 5e-4 * MM * rng.standard_normal(len(s))  # its ball stands where the robot puts it
    table = pd.DataFrame({"angle_deg": s * 360, "radius_mm": np.round(radius / MM, 4), "simulated": "yes"})
    yield Sample("circle.csv", csv_bytes(table), "a ballbar's readings", "irbcal ballbar my-robot circle.csv --bar 150")


def _controller(q: FloatArray, cell: VirtualCell) -> Iterator[Sample]:
    """What a controller shows whose third link is 0.3 mm longer."""
    a = cell.arm.table.a.copy()
    a[2] += 0.3 * MM
    T = cell.arm.with_table(replace(cell.arm.table, a=a)).forward(q)
    table = pd.DataFrame(q / DEG, columns=cell.arm.joint_columns).join(poses_to_frame(T)).round(6)
    table["simulated"] = "yes"
    command = "irbcal controller reported.csv --robot my_robot.urdf --out controller.urdf"
    yield Sample("reported.csv", csv_bytes(table), "what the controller shows", command)


RAIL_POSES = 60
RAIL = """  <link name="rail_base"/>
  <joint name="rail" type="prismatic">
    <parent link="rail_base"/>
    <child link="base_link"/>
    <axis xyz="0 1 0"/>
    <limit lower="0" upper="2" effort="1000" velocity="1"/>
  </joint>
</robot>
"""


def rail_files() -> Iterator[Sample]:
    """A small arm on a rail."""
    text = robots.robot_file("irb120").read_text(encoding="utf-8").replace("</robot>", RAIL)
    yield Sample("cell.urdf", text.encode(), "an arm on a rail")
    robot = urdf.from_bytes(text.encode(), "cell.urdf", "rail_base", "tool0")
    cell = shipped_cell(robot.arm, weights.bodies(robot)).without("visibility").with_targets(TARGETS)
    table = measured_table(cell, random_list(cell, RAIL_POSES, 1))
    command = (
        "irbcal calibrate rail.csv --robot cell.urdf --base-link rail_base --tip-link tool0 --out rail-calibration"
    )
    yield Sample("rail.csv", csv_bytes(table), f"{RAIL_POSES} poses of the arm on its rail", command)


TOUCHED_POSES = 80
TOUCHING_TIP = np.array([0.0, 0.012, 0.18])
"""Of the tool, in the tip link."""
SOCKET = np.array([0.85, 0.05, 0.6])
"""Fixed place that the tip touches, in the base link."""
T_BASE_FIXTURE = frames.transform(frames.rot_z(20 * DEG), [0.75, -0.15, 0.45])
FIXTURE_POINTS = {"origin": (0.0, 0.0, 0.0), "x": (0.3, 0.0, 0.0), "xy": (0.1, 0.2, 0.0)}
SIDES = (
    (0, 25, 10, 0, 45, 0),
    (5, 20, 15, 40, 50, 30),
    (-5, 25, 15, -45, 40, -20),
    (0, 30, 0, 20, 20, 90),
    (5, 30, 10, 0, 70, -60),
    (-5, 20, 10, 60, 60, 10),
)
"""Near these joints (degrees) the tip touches."""
BY_EYE = 0.05 * MM
"""Standard deviation of a touch in each direction."""


def touched_files() -> Iterator[Sample]:
    """Rows at four balls, what is known of these, and touches of a tool and a work object."""
    touched = simulate_device("irb1600", "balls", TOUCHED_POSES, seed=11)
    command = "irbcal calibrate touched.csv --features balls.csv --robot my_robot.urdf --out touched"
    yield Sample("touched.csv", csv_bytes(touched.to_frame()), "four balls touched, no tracker", command)
    yield Sample("balls.csv", csv_bytes(touched.features()), "what is known of the balls", command)
    command = "irbcal cell my-robot touches.csv --out cell.json"
    yield Sample("touches.csv", csv_bytes(touches(example_cell())), "a tool and a work object touched", command)


REACHED_STEP = 1e-6
"""Of the differences behind derivatives by the joints, radians."""


def reached(
    cell: VirtualCell, q: FloatArray, tip: FloatArray, xyz: FloatArray, starts: FloatArray | None = None
) -> FloatArray:
    """Joints next to others (n, joints) at which the true tip is at places (n, 3) in the base link, metres.

    Each is come to from its start (n, joints), radians, or else from the one before. Steps by the nominal derivative.
    """
    joints, point = np.array(q), np.append(tip, 1.0)
    for _ in range(12):
        if starts is None:
            T_true = cell.measure(joints).T_base_tip
        else:
            alone = zip(joints, starts, strict=True)
            T_true = np.array([cell.measure(row[None], start=start).T_base_tip[0] for row, start in alone])
        off = xyz - T_true[:, :3] @ point
        for k, row in enumerate(joints):
            T = cell.arm.forward(row + REACHED_STEP * np.vstack([np.zeros(len(row)), np.eye(len(row))]))[:, :3] @ point
            joints[k] += np.linalg.lstsq((T[1:] - T[0]).T / REACHED_STEP, off[k], rcond=None)[0]
    return joints


def touches(cell: VirtualCell) -> pd.DataFrame:
    """A table of touches: the tip at one place from several sides, three points of a fixture."""
    fixture = frames.apply(T_BASE_FIXTURE, np.array([*FIXTURE_POINTS.values()]))
    xyz = np.vstack([np.tile(SOCKET, (len(SIDES), 1)), fixture])
    xyz = xyz + np.random.default_rng(7).normal(scale=BY_EYE, size=xyz.shape)
    q = np.radians([*SIDES, *SIDES[: len(FIXTURE_POINTS)]])
    joints = np.round(reached(cell, q, TOUCHING_TIP, xyz) / DEG, 6)
    head = {
        "frame": ["tool"] * len(SIDES) + ["work_object"] * len(FIXTURE_POINTS),
        "name": ["1"] * len(xyz),
        "point": ["socket"] * len(SIDES) + [*FIXTURE_POINTS],
        "tool": ["1"] * len(xyz),
    }
    return pd.DataFrame(head | {name: joints[:, k] for k, name in enumerate(cell.arm.joint_columns)})


ROBOTS, FLEET_POSES = 2, 40
MOVED_DEG = 0.05
"""By how much joint 3's zero of the last robot moved between the months."""
MONTHS = (("march", "2026-03-02"), ("july", "2026-07-06"))
OPTIONS = "model=34"


def fleet_files() -> Iterator[Sample]:
    """A list for each month, and its robots' measurements."""
    for later, (month, day) in enumerate(MONTHS):
        rows = []
        for k in range(ROBOTS):
            name, path = f"cell-{k + 1}", f"{month}/cell-{k + 1}.csv"
            moved = MOVED_DEG if later and k == ROBOTS - 1 else 0.0
            yield Sample(
                f"fleet/{path}", csv_bytes(_measured_later(20 + k, 30 + 10 * later + k, moved)), f"{name} in {month}"
            )
            rows.append((name, f"1600-1012{k + 1}", path, ROBOT, day, OPTIONS))
        table = pd.DataFrame(rows, columns=["id", "serial", "measurements", "robot", "date", "options"])
        command = f"irbcal fleet calibrate fleet/{month}.csv --out {month}"
        yield Sample(f"fleet/{month}.csv", csv_bytes(table), f"a list of robots, measured in {month}", command)


def _measured_later(robot: int, seed: int, moved_deg: float) -> pd.DataFrame:
    """A measurement file of a robot whose joint 3 is not where its zero says."""
    cell = open_cell(ROBOT, seed=seed, robot_seed=robot).with_targets(TARGETS)
    poses = random_list(cell, FLEET_POSES, seed)
    run = cell.measure(poses.q + moved_deg * DEG * np.eye(6)[2], poses.measured_targets(cell), poses.wait_s)
    return measurement_table(run, poses, cell.arm)  # the joints that were commanded
