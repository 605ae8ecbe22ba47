"""The virtual cells that come with irbcal: the IRB 1600 of the thesis, one for any other arm, and a realistic one.

The setting for the IRB 1600 is tuned on Nubiola 2011, Table 7.1, by ``scripts/thesis/tune_cell``. Other arms get errors
drawn from a seed, in the same sizes. The realistic cell has the errors of all families that evidence on a measured
IRB 120 and a measured UR10 shows: weight at all joints and about all axes, harmonic drives, bearings that run out,
every frame drifting as the arm warms up, stops that depend on the last move, and joint readings that are taken too
early. Sizes are drawn from a seed, each family's as large as those robots show it.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.opening import open_robot
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import home_joints
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import direction, gain, harmonics, move, warm_up, wobble
from irbcal.modeling.terms.term_map import TermMap
from irbcal.simulation.effects import (
    EFFECTS,
    BendingEffect,
    ComplianceEffect,
    DirectionEffect,
    DriftEffect,
    Effect,
    GearEffect,
    HarmonicsEffect,
    LostEffect,
    MoveEffect,
    NoiseEffect,
    ReadingLagEffect,
    RepeatabilityEffect,
    ThawEffect,
    VisibilityEffect,
    WobbleEffect,
    size_of,
)
from irbcal.simulation.instruments import PAYLOAD_KG, Tracker, thesis_tool
from irbcal.simulation.simulation_options import ROBOT_SEED, VirtualCellOptions
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.simulation.weights import Bodies, bodies, torques
from irbcal.units import DEG, MM

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
) -> VirtualCell:
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

    Raises
    ------
    RobotError
        If the robot is refused.
    """
    nominal = open_robot(robot, nominal=True, base_link=base, tip_link=tip, coupling=coupling).nominal_urdf
    return shipped_cell(nominal.arm, bodies(nominal), seed, robot_seed)


def shipped_cell(arm: Arm, bodies: Bodies, seed: int = 0, robot_seed: int = ROBOT_SEED) -> VirtualCell:
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
    """
    size = size_of(arm)
    tuned = arm.name == TUNED_ARM and robot_seed == ROBOT_SEED and arm.six_revolute
    errors = {k: np.array(v) * unit for k, (v, unit) in LINK_ERRORS.items()} if tuned else None
    table = with_errors(arm, drawn_errors(arm, robot_seed, size) if errors is None else errors)
    effects = tuple(effect().for_arm(arm.table.prismatic, size) for effect in EFFECTS)
    compliance = next(effect for effect in effects if isinstance(effect, ComplianceEffect)).rad_per_Nm
    T = np.array(T_TRACKER_BASE)
    T[:3, 3] *= size
    tracker = Tracker(T)
    home = arm.forward(home_joints(arm)[None])[0]
    look = home[:3, :3].T @ (tracker.position - home[:3, 3])
    waves = [wave for k in (1, 2) for wave in harmonics.pair(5, k, "rz", harmonics.SIZE, "harmonics", "harmonics")]
    series = JointMap(TermMap(arm, tuple(waves), np.array(FOURIER))) if arm.six_revolute else JointMap.identity(arm)
    return VirtualCell(
        arm,
        table,
        series,
        bodies,
        thesis_tool(look, size, round(PAYLOAD_KG * size**3, 2)),
        tracker,
        {name: size * MM * np.array(xyz) for name, xyz in REFERENCES.items()},
        effects,
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


SHARES = {"harmonics": 0.35, "wobble": 0.35, "direction": 0.15, "move": 0.15, "warm_up": 0.9}
"""Sizes against the natural ones of the error model: each family then explains about as much as on the measured
IRB 120, where the last move matters little."""
DEFLECTION, TILT = 6e-4, 5e-5
"""Root mean square deflection of a joint, and tilt of a frame, under weight: radians, whatever the arm weighs."""
GAIN = 1e-4
"""Standard deviation of the joints' gains: a fifth of the natural size, as robots are delivered."""
ORDERS = (1, 2)
RATIOS = (50, 80, 100, 101, 120, 121, 160)
"""Of harmonic drives."""
GEARS = 4
"""Joints with such a drive."""
GEAR_DEG = (0.002, 0.005)
"""Smallest and largest amplitude of their waves."""
PART = (0.5, 1.5)
"""Smallest and largest deflection of a joint against that."""

TORQUE_POSES, LEAST_TORQUE = 400, 1e-3
"""Random poses of the mean squares, and the root mean square torque (N m) below which an axis is not turned."""

SEEING = (RepeatabilityEffect, NoiseEffect, DriftEffect, VisibilityEffect, LostEffect)
"""Effects that are as in the cell of the thesis."""


def asked_cell(options: VirtualCellOptions) -> VirtualCell:
    """The shipped virtual cell of a robot with the effects that are asked for; errors as of `open_cell`."""
    links, only, also = (options.base_link, options.tip_link), options.only, options.also
    cell = open_cell(options.robot, *links, coupling=options.coupling, seed=options.seed, robot_seed=options.robot_seed)
    cell = realistic(cell, options.robot_seed) if options.cell == "realistic" else cell
    cell = cell.also(*also, *(only or ()))
    cell = (cell if only is None else cell.only(*only, *also)).without(*options.without)
    return cell if options.payload is None else cell.with_payload(options.payload)


def realistic(cell: VirtualCell, robot_seed: int = ROBOT_SEED) -> VirtualCell:
    """A shipped cell with the errors of a real robot in place of the thesis's, links' errors kept.

    Parameters
    ----------
    cell : VirtualCell
        As `irbcal.simulation.shipped_cells.open_cell` gives it.
    robot_seed : int
        Of the robot's errors.
    """
    rng = np.random.default_rng(np.random.SeedSequence(robot_seed, spawn_key=(zlib.crc32(b"realistic"),)))
    prismatic, n = cell.arm.table.prismatic, len(cell.arm.joint_names)
    soft = tuple(_soft(DEFLECTION * rng.uniform(*PART, n), cell, 0))
    effects: list[Effect] = [
        ComplianceEffect(soft),
        BendingEffect(*(tuple(_soft(TILT * rng.uniform(*PART, n), cell, axis)) for axis in (1, 2))),
        _harmonics(cell.arm, rng),
        _gears(cell.arm, rng),
        _wobble(cell.arm, rng),
        DirectionEffect(_drawn(rng, cell.arm, SHARES["direction"], direction.SIZES)),
        MoveEffect(
            _drawn(rng, cell.arm, SHARES["move"], move.SIZES),
            tuple(SHARES["move"] * move.GAIN_SIZE * rng.standard_normal(n)),
        ),
        _thaw(n, rng),
        ReadingLagEffect(),
        *(effect for effect in cell.effects if isinstance(effect, SEEING)),
    ]
    gains = TermMap(cell.arm, tuple(gain.FAMILY.terms(cell.arm)), GAIN * rng.standard_normal(n) * ~prismatic)
    out = cell.replace(effects=(), compliance=soft, joint_map=JointMap(gains))
    for part in effects:
        out = out.with_effect(part)
    return out


def _soft(deflection: FloatArray, cell: VirtualCell, axis: int) -> list[float]:
    """Compliances that deflect joints (axis 0) or tilt frames about x (1) or y (2) by so much in random poses.

    Of axes that weight does not turn about (those that stand upright), and of prismatic joints: none.
    """
    q = cell.arm.random_joints(TORQUE_POSES, seed=0)
    torque = torques(cell.arm, cell.bodies_with_payload(), q, ("rz", "rx", "ry")[axis])
    rms = np.sqrt(np.mean(torque**2, axis=0))
    turned = rms > LEAST_TORQUE
    values: list[float] = np.where(turned, deflection / np.where(turned, rms, 1.0), 0.0).tolist()
    return values


def _drawn(rng: np.random.Generator, arm: Arm, share: float, sizes: dict[str, float]) -> tuple[float, ...]:
    """A number for each joint in the sizes of ``rad`` and ``m``, degrees and millimetres."""
    size = np.where(arm.table.prismatic, sizes["m"] / MM, sizes["rad"] / DEG)
    return tuple((share * size * rng.standard_normal(len(size))).tolist())


def _wave(rng: np.random.Generator, size: float) -> tuple[float, float]:
    """Amplitude, rounded to a millionth, and phase (degrees) of a cosine and a sine of a size."""
    cos, sin = size * rng.standard_normal(2)
    return round(float(np.hypot(cos, sin)), 6), round(float(np.degrees(np.arctan2(cos, sin))), 2)


def _harmonics(arm: Arm, rng: np.random.Generator) -> HarmonicsEffect:
    turning = int((~arm.table.prismatic).sum())
    size = SHARES["harmonics"] * harmonics.SIZE / DEG
    return HarmonicsEffect(tuple((j, k, *_wave(rng, size)) for j in range(1, turning + 1) for k in ORDERS))


def _wobble(arm: Arm, rng: np.random.Generator) -> WobbleEffect:
    turning, share = int((~arm.table.prismatic).sum()), SHARES["wobble"]
    sizes = {"r": share * wobble.SIZES["r"] / DEG, "t": share * wobble.SIZES["t"] / MM}
    axes = ("rx", "ry", "tx", "ty", "tz")
    waves = ((j, a, k, *_wave(rng, sizes[a[0]])) for j in range(1, turning + 1) for a in axes for k in wobble.ORDERS)
    return WobbleEffect(tuple(waves))


def _gears(arm: Arm, rng: np.random.Generator) -> GearEffect:
    turning = int((~arm.table.prismatic).sum())
    joints = np.sort(rng.choice(np.arange(1, turning + 1), min(GEARS, turning), replace=False))
    return GearEffect(
        tuple(
            (
                int(j),
                int(rng.choice(RATIOS)),
                round(float(rng.uniform(*GEAR_DEG)), 5),
                round(rng.uniform(0.0, 360.0), 1),
            )
            for j in joints
        )
    )


def _thaw(joints: int, rng: np.random.Generator) -> ThawEffect:
    sizes = {"deg": warm_up.SIZES["r"] / DEG, "mm": warm_up.SIZES["t"] / MM}

    def drift(unit: str) -> tuple[float, ...]:
        values: FloatArray = SHARES["warm_up"] * sizes[unit] * rng.standard_normal(joints)
        return tuple(values.tolist())

    return ThawEffect(
        x_deg=drift("deg"), y_deg=drift("deg"), z_deg=drift("deg"), x_mm=drift("mm"), y_mm=drift("mm"), z_mm=drift("mm")
    )
