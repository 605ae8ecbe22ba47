"""Balls touched in place of a tracker's points, and a cell that was touched with the tool: SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.modeling import frames
from irbcal.practice.measured import practice_cell
from irbcal.practice.sample import Sample, csv
from irbcal.simulation.cell import Cell
from irbcal.simulation.device_simulation import simulate_device
from irbcal.units import DEG, MM

POSES = 80
TIP = np.array([0.0, 0.012, 0.18])
"""Of the tool, in the tip link."""
SOCKET = np.array([0.85, 0.05, 0.6])
"""Fixed place that the tip touches, in the base link."""
T_BASE_FIXTURE = frames.transform(frames.rot_z(20 * DEG), [0.75, -0.15, 0.45])
POINTS = {"origin": (0.0, 0.0, 0.0), "x": (0.3, 0.0, 0.0), "xy": (0.1, 0.2, 0.0)}
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


def files() -> Iterator[Sample]:
    """Rows at four balls, what is known of these, and touches of a tool and a work object."""
    found = simulate_device("irb1600", "balls", POSES, seed=11)
    line = "irbcal calibrate touched.csv --features balls.csv --robot my_robot.urdf --out touched"
    yield Sample("touched.csv", csv(found.to_frame()), "four balls touched, no tracker", line)
    yield Sample("balls.csv", csv(found.features()), "what is known of the balls", line)
    line = "irbcal cell my-robot touches.csv --out cell.json"
    yield Sample("touches.csv", csv(touches(practice_cell())), "a tool and a work object touched", line)


def touches(cell: Cell) -> pd.DataFrame:
    """A table of touches: the tip at one place from several sides, three points of a fixture."""
    fixture = frames.apply(T_BASE_FIXTURE, np.array([*POINTS.values()]))
    places = np.vstack([np.tile(SOCKET, (len(SIDES), 1)), fixture])
    places = places + np.random.default_rng(7).normal(scale=BY_EYE, size=places.shape)
    joints = np.round(_reached(cell, np.radians([*SIDES, *SIDES[: len(POINTS)]]), places) / DEG, 6)
    head = {
        "frame": ["tool"] * len(SIDES) + ["work_object"] * len(POINTS),
        "name": ["1"] * len(places),
        "point": ["socket"] * len(SIDES) + [*POINTS],
        "tool": ["1"] * len(places),
    }
    return pd.DataFrame(head | {name: joints[:, k] for k, name in enumerate(cell.arm.joint_columns)})


def _reached(cell: Cell, q: FloatArray, places: FloatArray) -> FloatArray:
    """Joints next to others at which the true tip is at places: steps by the nominal robot's derivative."""
    tip, step = np.append(TIP, 1.0), 1e-6
    for _ in range(12):
        off = places - cell.measure(q).T_base_tip[:, :3] @ tip
        for k, joints in enumerate(q):
            T = cell.arm.forward(joints + step * np.vstack([np.zeros(6), np.eye(6)]))[:, :3] @ tip
            q[k] += np.linalg.lstsq((T[1:] - T[0]).T / step, off[k], rcond=None)[0]
    return q
