"""Where a measuring plan is made for: robot, reflectors, tracker, ISO cube and the conditions that poses must meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.errors import MeasurementError, OptionError, RobotError
from irbcal.io import robots
from irbcal.io.opening import open_robot
from irbcal.io.urdf import speed_limits
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.robot import Robot
from irbcal.option_values import length, point_in_metres
from irbcal.planning.conditions import CONDITIONS, SOLID, Setting, reflectors
from irbcal.planning.plan_options import PlanOptions
from irbcal.simulation.effects import size_of
from irbcal.simulation.instruments import IRB1600_HEIGHTS, has_thesis_cube, iso_cube
from irbcal.simulation.shipped_cells import T_TRACKER_BASE
from irbcal.units import DEG, MM
from irbcal.wording import joined

if TYPE_CHECKING:
    from irbcal.planning.collisions import CollisionModel

TRACKER_RADIUS, NEAR_TRACKER = 0.25, 0.3
"""Metres: the ball around the tracker that the robot keeps out of, and how far from the base link it must stand."""
USUAL_SPEED = (60 * DEG, 0.5)
"""Of revolute and prismatic joints where the URDF has none, SI units."""


@dataclass(frozen=True, eq=False)
class Scene(Locked):
    """Where a plan is made for."""

    setting: Setting
    nominal: Arm
    """What the controller believes: predictions are made there."""
    T_world_base: FloatArray
    """Shape (4, 4). The base link in the frame of the expected coordinates."""
    cube: tuple[FloatArray, float]
    """Centre (3,) in the base link and edge, metres."""
    joint_speed: FloatArray
    """Shape (joints,). SI units."""
    notes: tuple[str, ...] = ()
    tracker_notes: tuple[str, ...] = ()
    """What is to be known of tracker and reflectors."""
    certainty: Certainty | None = None
    """Of a calibration: with the joint ranges of its fit."""


def open_scene(options: PlanOptions) -> Scene:
    """Robot, reflectors, tracker and conditions; without a tracker that of the thesis's cell, scaled to the arm.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    for name in options.ignore:
        if name not in CONDITIONS:
            raise OptionError.unknown("ignore", name, tuple(CONDITIONS))
    opened = open_robot(
        options.robot,
        base_link=options.base_link,
        tip_link=options.tip_link,
        coupling=options.coupling,
        package_dirs=options.package_dirs,
    )
    if opened.urdf is None or opened.urdf_bytes is None:
        raise RobotError(
            f"{opened.name}: a plan needs the URDF, which a loaded calibration does not hold: give its folder",
            parameter="robot",
        )
    arm = opened.robot.arm
    notes: list[str] = []
    T_world_base, of_tracker = _base(opened.robot, options.tracker)
    station = frames.inverse(T_world_base)[:3, 3]
    targets_seen = reflectors(opened.robot, options.targets, station)
    on = tuple(name for name in CONDITIONS if name not in options.ignore)
    if targets_seen.directions is None and "acceptance" in on:
        of_tracker.append(
            "the reflectors' directions are not known: the condition acceptance is off (--targets FILE with nx, ny, nz)"
        )
    heights = IRB1600_HEIGHTS if options.min_height is None and has_thesis_cube(arm) else options.min_height
    folders = [*options.package_dirs, *opened.mesh_folders, *([opened.folder] if opened.folder else [])]
    solids = _solids(opened.urdf_bytes, arm, station, folders, notes) if SOLID & set(on) else None
    on = tuple(name for name in on if solids is not None or name not in SOLID)
    margin, acceptance, centre, edge = options.margin, options.acceptance, options.cube_centre, options.cube_edge
    setting = Setting(opened.robot, targets_seen, station, on, margin, acceptance, heights, solids)
    cube = _cube(setting) if edge is None else (point_in_metres("cube_centre", centre), length("cube_edge", edge))
    usual = np.where(arm.table.prismatic, USUAL_SPEED[1], USUAL_SPEED[0])
    limits = speed_limits(opened.urdf_bytes, arm.joint_names)
    speed, certainty = np.where(np.isfinite(limits), limits, usual), opened.robot.certainty
    return Scene(setting, opened.nominal, T_world_base, cube, speed, tuple(notes), tuple(of_tracker), certainty)


def _solids(
    urdf: bytes, arm: Arm, tracker: FloatArray, folders: Sequence[str | Path], notes: list[str]
) -> CollisionModel | None:
    """The robot's solids with the tracker in their way; None, with a note, where the URDF has none that can be read."""
    from irbcal.planning.collisions import CollisionModel, NoSolidsError

    if (distance := float(np.linalg.norm(tracker))) < NEAR_TRACKER:
        raise MeasurementError(
            f"--tracker: expected a place at least {NEAR_TRACKER / MM:.0f} mm from the base link, found "
            f"{distance / MM:.0f} mm",
            parameter="tracker",
        )
    try:
        solids = CollisionModel(urdf, arm, package_dirs=robots.package_dirs(*folders))
    except NoSolidsError as error:
        off = [name for name in CONDITIONS if name in SOLID]
        notes.append(f"the conditions {joined(off)} are off: {error}")
        return None
    solids.add_obstacle(tracker, TRACKER_RADIUS)
    if solids.overlapping:
        pairs = ", ".join(" and ".join(pair) for pair in solids.overlapping)
        notes.append(f"links that overlap by construction are not checked against each other: {pairs}")
    return solids


def _base(robot: Robot, tracker: ArrayLike | None) -> tuple[FloatArray, list[str]]:
    """The base link in the frame of the expected coordinates, and a note where the tracker's place is assumed."""
    if tracker is not None:
        coordinates = point_in_metres(
            "tracker", tracker, "x, y, z of the tracker in metres, optionally its rotation about z in radians", (3, 4)
        )
        x, y, z, yaw = [*coordinates, 0.0][:4]
        return frames.inverse(frames.from_xyz_angles([x, y, z, 0.0, 0.0, yaw])), []
    stood = float(np.linalg.norm(frames.inverse(robot.T_world_base)[:3, 3]))
    if robot.targets and stood >= NEAR_TRACKER:  # rows at features have no tracker
        stood_there = "no --tracker given: it is taken to stand where it stood for the calibration's measurements"
        return robot.T_world_base, [stood_there]
    T: FloatArray = np.array(T_TRACKER_BASE)
    T[:3, 3] *= size_of(robot.arm)
    x, y, z = frames.inverse(T)[:3, 3] / MM
    note = (
        f"no --tracker given: it is taken to stand at {x:.0f}, {y:.0f}, {z:.0f} mm in the base link; "
        "the expected coordinates hold for that place and turn only"
    )
    return T, [note]


def _cube(setting: Setting) -> tuple[FloatArray, float]:
    lower, upper = setting.bounds

    def keep(q: FloatArray) -> BoolArray:
        good: BoolArray = np.all((q >= lower) & (q <= upper), axis=1)
        return good if setting.heights is None else good & setting.high(*setting.tip_and_reflectors(q)[:2])

    return iso_cube(setting.arm, keep)
