"""The same measurements as other programs would write them, one set for each import preset: SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.measurement.columns import POSITION
from irbcal.modeling import frames
from irbcal.practice.measured import practice_cell
from irbcal.practice.sample import Sample, csv
from irbcal.simulation.pose_list import drawn
from irbcal.units import DEG, MM

COUNT = 40


def files() -> Iterator[Sample]:
    """A file or a set of files for each preset."""
    cell = practice_cell(4).without("lost", "visibility")
    poses = drawn(cell, COUNT, 4)
    run = cell.measure(poses.q, None, poses.wait_s)
    joints = np.round(poses.q / DEG, 6)
    xyz = np.round(run.xyz / MM, 4)
    yield from _by_joints(joints, xyz[:, : run.targets], run.names[: run.targets])
    yield from _apart(joints, xyz, run.names)
    yield from _full_poses(poses.q, cell.tracker.T_tracker_base @ run.T_base_tip)


def _by_joints(joints: FloatArray, xyz: FloatArray, names: tuple[str, ...]) -> Iterator[Sample]:
    rows = [(*q, *p, k) for q, points in zip(joints, xyz, strict=True) for k, p in enumerate(points, start=1)]
    columns = [*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z", "TCP"]
    line = "irbcal import robodk.csv --as robodk --out from_robodk.csv"
    yield Sample("robodk.csv", csv(pd.DataFrame(rows, columns=columns)), "as RoboDK takes measurements", line)
    points = [f"{axis}{k}" for k in range(1, len(names) + 1) for axis in "XYZ"]
    wide = pd.DataFrame(np.hstack([joints, xyz.reshape(len(joints), -1)]), columns=[*columns[:6], *points])
    mapped = ", ".join(f"{name}: [X{k}, Y{k}, Z{k}]" for k, name in enumerate(names, start=1))
    line = (
        "irbcal import wide.csv --as table --set 'columns.joints=[J1, J2, J3, J4, J5, J6]' "
        f"--set 'columns.position={{{mapped}}}' --set units.joints=deg --set units.lengths=mm --out from_wide.csv"
    )
    yield Sample("wide.csv", csv(wide, sep=";"), "a row a pose, all points in it", line)
    turned = csv(_own(joints * np.array([1, 1, -1, 1, 1, 1]), xyz, names))
    line = "irbcal import turned.csv --as irbcal --set 'joints.signs=[1, 1, -1, 1, 1, 1]' --out mended.csv"
    yield Sample("turned.csv", turned, "irbcal's own format with the sign of joint 3 turned", line)


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
    yield Sample("measured_joints.csv", csv(table), "joints of the poses measured below")
    lines = ["// SIMULATED points, working frame: tracker, millimetres"]
    for pose, points in zip(table["pose"], xyz, strict=True):
        lines += [f"{pose}_{name}, {x:.4f}, {y:.4f}, {z:.4f}" for name, (x, y, z) in zip(names, points, strict=True)]
    text = ("\n".join(lines) + "\n").encode()
    line = (
        "irbcal import points.txt --as spatial-analyzer --set units.lengths=mm --joints measured_joints.csv "
        "--out from_points.csv"
    )
    yield Sample("points.txt", text, "as SpatialAnalyzer exports points", line)
    line = "irbcal import smr*.csv ref*.csv --as per-target --set units.lengths=mm --joints measured_joints.csv "
    for k, name in enumerate(names):
        log = pd.DataFrame(xyz[:, k], columns=["x", "y", "z"])
        tried = line + "--out from_logs.csv" if k == 0 else ""
        yield Sample(f"{name}.csv", csv(log, sep=";", decimal=","), f"a log of {name}, a row a pose", tried)


def _full_poses(q: FloatArray, T: FloatArray) -> Iterator[Sample]:
    """Files of trackers that measure orientations: the tip in the tracker's frame, exactly."""
    from scipy.spatial.transform import Rotation

    place = np.round(T[:, :3, 3] / MM, 4)
    numbers = np.hstack([place, np.round(frames.quaternion_from_matrix(T[:, :3, :3]), 9)])
    table = pd.DataFrame(numbers, columns=["X", "Y", "Z", "Q0", "Q1", "Q2", "Q3"])
    line = "irbcal import tmac.csv --as leica-tmac --joints measured_joints.csv --out from_tmac.csv"
    yield Sample("tmac.csv", csv(table, sep=";", decimal=","), "poses of a Leica T-Mac", line)
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    angles = Rotation.from_matrix(T[:, :3, :3]).as_euler("XYZ", degrees=True)
    columns = [*(f"{name}_joint" for name in names), *(f"measurement_{c}" for c in ("x", "y", "z", "rx", "ry", "rz"))]
    table = pd.DataFrame(np.round(np.hstack([q, place, angles]), 9), columns=columns)
    table["measurement_temperature"] = 21.0
    line = "irbcal import export.csv --as ur10-lab --out from_lab.csv"
    yield Sample("export.csv", csv(table, sep=";", decimal=","), "a lab's export with decimal commas", line)
