"""The virtual cells that come with irbcal: the IRB 1600 of the thesis, and one for any other arm.

The setting for the IRB 1600 is tuned on Nubiola 2011, Table 7.1, by ``scripts/tune_cell``. Other arms get errors drawn
from a seed, in the same sizes.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.opening import read_nominal
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.home import home_joints
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.simulation.cell import Cell
from irbcal.simulation.effect import size_of
from irbcal.simulation.effects import EFFECTS
from irbcal.simulation.masses import Bodies, bodies
from irbcal.simulation.tool import PAYLOAD_KG, thesis_tool
from irbcal.simulation.tracker import Tracker
from irbcal.simulation.weight_effects import Compliance
from irbcal.units import DEG, MM

ROBOT_SEED = 1600
"""Seed of the shipped robot's errors."""

TUNED_ARM = "irb1600_6_145"

LINK_ERRORS = {
    "alpha": ((0.0000, -0.0060, -0.0090, 0.0143, 0.0029, 0.0106), DEG),
    "a": ((0.0000, 0.0875, -0.1163, -0.0085, -0.0233, -0.1524), MM),
    "theta": ((0.0000, 0.0353, -0.0618, 0.0023, -0.0386, -0.0183), DEG),
    "d": ((0.0000, 0.0000, -0.0144, 0.2100, -0.0060, -0.2897), MM),
}
"""Errors of joints 1 to 6 of the shipped IRB 1600, degrees and millimetres; joint 1 is part of the base.

Made by ``scripts/tune_cell``: drawn in the sizes of `SIZES`, then moved until the nominal errors match
Nubiola 2011, Table 7.1.
"""

SIZES = {"alpha": 0.015 * DEG, "a": 0.15 * MM, "theta": 0.04 * DEG, "d": 0.15 * MM}
"""Standard deviations of the link errors of an arm as large as the IRB 1600: machining, and mastering for theta."""

FOURIER = (-0.000373, -0.000750, -0.000956, -0.000244)
"""a1, b1, a2, b2 of joint 6 (Nubiola 2011, Table 5.2), radians."""

T_TRACKER_BASE = frames.from_xyz_angles([2.2400, 0.3671, -1.4795, -0.036 * DEG, -0.717 * DEG, 142.917 * DEG])
"""Where the thesis's robot stood in its tracker's frame: Nubiola 2011, Table A III-1 fitted to the poses of
Nubiola 2011, Table A I-1 with target 1 (rms 0.7 mm)."""

REFERENCES = {
    "ref1": (750.0, 1000.0, 0.0),
    "ref2": (950.0, -850.0, 0.0),
    "ref3": (-750.0, 950.0, 0.0),
    "ref4": (-550.0, -900.0, 250.0),
}
"""Reflectors on the floor around the IRB 1600, in the base link, mm."""


def open_cell(
    robot: str | Path,
    base: str | None = None,
    tip: str | None = None,
    *,
    coupling: str | None = None,
    seed: int = 0,
    robot_seed: int = ROBOT_SEED,
) -> Cell:
    """The shipped virtual cell of a robot.

    Parameters
    ----------
    robot : str or Path
        URDF, a robot's name, or a calibration: the robot that it began from.
    base, tip : str, optional
        Names of the base and the tip link.
    coupling : str, optional
        How the controller counts joints, see `irbcal.io.urdf.declared_coupling`.
    seed, robot_seed : int
        As `shipped_cell`.

    Returns
    -------
    Cell

    Raises
    ------
    RobotError
        If the robot is refused.
    """
    found = read_nominal(robot, base, tip, coupling)
    return shipped_cell(found.arm, bodies(found), seed, robot_seed)


def shipped_cell(arm: Arm, bodies: Bodies, seed: int = 0, robot_seed: int = ROBOT_SEED) -> Cell:
    """The virtual cell with all effects on.

    Parameters
    ----------
    arm : Arm
        Nominal. The IRB 1600 gets the tuned errors, other arms and other seeds drawn ones.
    bodies : Bodies
        Link masses.
    seed : int
        Of the run.
    robot_seed : int
        Of the robot's own errors.

    Returns
    -------
    Cell
    """
    size = size_of(arm)
    tuned = arm.name == TUNED_ARM and robot_seed == ROBOT_SEED and arm.six_revolute
    errors = {k: np.array(v) * unit for k, (v, unit) in LINK_ERRORS.items()} if tuned else None
    table = with_errors(arm, drawn_errors(arm, robot_seed, size) if errors is None else errors)
    parts = tuple(effect().for_arm(arm.table.prismatic, size) for effect in EFFECTS)
    compliance = next(part for part in parts if isinstance(part, Compliance)).rad_per_Nm
    T = np.array(T_TRACKER_BASE)
    T[:3, 3] *= size
    tracker = Tracker(T)
    home = arm.forward(home_joints(arm)[None])[0]
    look = home[:3, :3].T @ (tracker.place - home[:3, 3])
    fourier = np.array(FOURIER) if arm.six_revolute else np.zeros(4)
    return Cell(
        arm,
        table,
        ThesisMap(np.zeros(len(arm.joint_names)), fourier=fourier),
        bodies,
        thesis_tool(look, size, round(PAYLOAD_KG * size**3, 2)),
        tracker,
        {name: size * MM * np.array(place) for name, place in REFERENCES.items()},
        parts,
        compliance,
        seed,
    )


def drawn_errors(arm: Arm, seed: int, size: float = 1.0) -> dict[str, FloatArray]:
    """Random link errors in the sizes of `SIZES`; link 1 has none, it is part of the base.

    Returns
    -------
    dict of str to ndarray, shape (joints,)
        Columns of the DHM table, radians and metres.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(b"geometry"),)))
    free = np.arange(len(arm.joint_names)) > 0
    scale = {name: value * (size if name in ("a", "d") else 1.0) for name, value in SIZES.items()}
    return {name: value * free * rng.standard_normal(len(free)) for name, value in scale.items()}


def with_errors(arm: Arm, errors: Mapping[str, FloatArray]) -> DHMTable:
    """The nominal table with errors added to its columns."""
    return replace(arm.table, **{name: getattr(arm.table, name) + value for name, value in errors.items()})
