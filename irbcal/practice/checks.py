"""Files of the checks: ISO 9283, the tracker itself, a ballbar, what a controller reports; all SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.measurement.columns import POSITION
from irbcal.modeling import frames
from irbcal.practice.measured import measurements, practice_cell
from irbcal.practice.sample import Sample, csv
from irbcal.simulation.cell import Cell
from irbcal.simulation.pose_list import PoseList
from irbcal.units import DEG, MM
from irbcal.validation.ballbar_check import CENTER_JOINTS
from irbcal.validation.ballbar_circle import circle
from irbcal.validation.cube import POSES, five_poses

CYCLES = 30
BAR = 150.0 * MM
SCALE_BAR_MM = 1050.688
NOISE = 0.01
"""Of a reading, mm."""


def files() -> Iterator[Sample]:
    """Files of every check."""
    cell = practice_cell(5).without("lost", "visibility")
    rng = np.random.default_rng(5)
    yield from _iso9283(cell, rng)
    yield from _tracker(rng)
    yield from _ballbar(cell, rng)
    yield from _controller(cell.arm.random_joints(40, 6), cell)


def _iso9283(cell: Cell, rng: np.random.Generator) -> Iterator[Sample]:
    q = five_poses(cell.arm).q
    n = CYCLES * len(q)
    extra = {"cycle": np.repeat(np.arange(1, CYCLES + 1), len(q)).astype(str).astype(object)}
    poses = PoseList(
        np.tile(q, (CYCLES, 1)),
        np.tile(np.array(POSES, dtype=object), CYCLES),
        None,
        np.full(n, 4.0),
        {**extra, "group": np.full(n, "iso9283", dtype=object)},
        "cycles",
    )
    table = measurements(cell, poses)
    line = "irbcal iso9283 iso9283.csv --calibration my-robot"
    yield Sample("iso9283.csv", csv(table), f"the five test poses, {CYCLES} cycles", line)
    t = np.arange(0, 14, 0.1)
    settling = np.concatenate([_series(t, run, 0.4 * np.exp(-1.5 * t), rng) for run in (1, 2, 3)])
    columns = ["run", "time_s", *POSITION]
    line = "irbcal iso9283 iso9283.csv --calibration my-robot --approaches approaches.csv"
    yield Sample("approaches.csv", csv(pd.DataFrame(settling, columns=columns)), "the robot coming to rest", line)
    yield from _paths(rng)
    yield from _moves_and_forces(rng)


def _paths(rng: np.random.Generator) -> Iterator[Sample]:
    """Two legs with a corner that is rounded, run at 250 mm/s and sampled at 100 Hz; 0.1 mm beside."""
    corners = pd.DataFrame([(0.0, 0.0, 500.0), (100.0, 0.0, 500.0), (100.0, 100.0, 500.0)], columns=list(POSITION))
    yield Sample("commanded_path.csv", csv(corners), "a path with a corner as it was commanded")
    s = np.arange(-10.0, 210.0, 2.5)
    x, y = np.minimum(s, 100.0), np.maximum(s - 100.0, 0.0)
    off = 2.0 * np.exp(-(((s - 100.0) / 8.0) ** 2))  # cut short at the corner
    tables = []
    for cycle in range(1, 11):
        xyz = np.column_stack([x - off / np.sqrt(2), y + off / np.sqrt(2), np.full(len(s), 500.1)])
        xyz += 0.01 * rng.standard_normal(xyz.shape)
        tables.append(np.column_stack([np.full(len(s), cycle), np.arange(len(s)) * 0.01, xyz]))
    table = pd.DataFrame(np.round(np.vstack(tables), 4), columns=["cycle", "time_s", *POSITION])
    line = "irbcal iso9283 --path path.csv --commanded-path commanded_path.csv --velocity 250 --window 0.05"
    yield Sample("path.csv", csv(table.astype({"cycle": int}).assign(simulated="yes")), "ten cycles of that path", line)


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
    line = "irbcal iso9283 --moves posing.csv --band 0.1"
    yield Sample("posing.csv", csv(table), "moves from rest to rest", line)
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


def _series(t: FloatArray, run: int, away: FloatArray, rng: np.random.Generator) -> FloatArray:
    xyz = np.array([800.0, 50.0, 900.0]) + away[:, None] * [0.6, 0.0, 0.8] + 0.002 * rng.standard_normal((len(t), 3))
    return np.round(np.column_stack([np.full(len(t), run), t, xyz]), 4)


def _tracker(rng: np.random.Generator) -> Iterator[Sample]:
    rows = []
    for k in range(20):
        turn = frames.rotation_from_vector(np.array([0.0, 0.1 * k, 0.3 * k]))
        for end, half in (("A", -0.5), ("B", 0.5)):
            place = np.array([2500.0 + 30 * k, -400.0, 300.0]) + turn @ np.array([half * SCALE_BAR_MM, 0, 0])
            rows.append((k + 1, end, *np.round(place + NOISE * rng.standard_normal(3), 4)))
    table = pd.DataFrame(rows, columns=["position", "end", *POSITION])
    yield Sample("bar.csv", csv(table), "a scale bar in 20 places", f"irbcal tracker bar.csv --length {SCALE_BAR_MM}")
    xyz = np.array([2500.0, -400.0, 300.0]) + NOISE * rng.standard_normal((60, 3))
    table = pd.DataFrame(np.round(xyz, 4), columns=list(POSITION))
    yield Sample("repeat.csv", csv(table), "one point, 60 readings", "irbcal tracker repeat.csv")
    t = np.arange(0, 4 * 3600, 120.0)
    warmth = 21 + 1.5 * np.sin(t / 5000)
    xyz = np.array([2500.0, -400.0, 300.0]) + 0.02 * (warmth - 21)[:, None] + NOISE * rng.standard_normal((len(t), 3))
    table = pd.DataFrame(np.round(np.column_stack([t, xyz, warmth]), 4), columns=["time_s", *POSITION, "temperature_c"])
    yield Sample("drift.csv", csv(table), "one point for four hours", "irbcal tracker drift.csv")


def _ballbar(cell: Cell, rng: np.random.Generator) -> Iterator[Sample]:
    """Radii of a circle that the controller runs with its nominal model, as the true robot of the cell has them."""
    from irbcal.correction.joints_along import joint_history

    arm = cell.arm
    centre = np.asarray(CENTER_JOINTS)
    path = circle(arm, centre, BAR)
    s = np.arange(0, 1, 1 / 360)
    true = cell.only("compliance").measure(joint_history(path, arm, centre, s)).T_base_tip[:, :3, 3]
    radius = np.linalg.norm(true - path.ball, axis=1)
    radius += BAR - radius.mean() + 5e-4 * MM * rng.standard_normal(len(s))  # its ball stands where the robot puts it
    table = pd.DataFrame({"angle_deg": s * 360, "radius_mm": np.round(radius / MM, 4)})
    yield Sample("circle.csv", csv(table), "a ballbar's readings", "irbcal ballbar my-robot circle.csv --bar 150")


def _controller(q: FloatArray, cell: Cell) -> Iterator[Sample]:
    """What a controller shows whose third link is 0.3 mm longer."""
    a = cell.arm.table.a.copy()
    a[2] += 0.3 * MM
    T = cell.arm.with_table(replace(cell.arm.table, a=a)).forward(q)
    wxyz = frames.quaternion_from_matrix(T[:, :3, :3])
    numbers = np.round(np.column_stack([q / DEG, T[:, :3, 3] / MM, wxyz]), 6)
    columns = [*(f"q{k}_deg" for k in range(1, 7)), *POSITION, "qw", "qx", "qy", "qz"]
    line = "irbcal controller reported.csv --robot my_robot.urdf --out controller.urdf"
    yield Sample("reported.csv", csv(pd.DataFrame(numbers, columns=columns)), "what the controller shows", line)
