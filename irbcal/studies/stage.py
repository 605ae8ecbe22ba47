"""The measuring campaign of a study: drawn and measured once, shared by all its calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock, locked
from irbcal.errors import MeasurementError
from irbcal.identification.axis_calibration import calibrate_by_axes
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.simulation import procedure, simulation
from irbcal.simulation.cell import Cell
from irbcal.studies.settings import AREAS, MOVES, PAYLOADS, Settings, repetitions, shares
from irbcal.summary import Speaks, Told
from irbcal.units import DEG, MM

SPHERE_CENTRE, SPHERE_DIAMETER, SPHERE_POINTS = np.array([845.7, 200.0, 965.7]) * MM, 400.0 * MM, 434
"""Of the relative analyses, in the base link (Nubiola 2011, section 7.7.3.6 and Figure 7.12)."""

SPHERE_TURN = 20.0 * DEG
"""Largest turn of the tool from its orientation at zero joints there."""


@dataclass(frozen=True, eq=False, repr=False)
class Stage(Speaks):
    """What all repetitions of a study share (Nubiola 2011, sections 7.1, 7.2 and 7.7, Figure 7.1).

    Attributes
    ----------
    settings : Settings
    cell : Cell
        Eight targets; the poses were chosen so that the tracker sees them.
    first : Robot
        Base and tool from moves of one joint (sections 3.2 and 3.4.2).
    axes : dict of int to PointSet
        Number of axis points -> the points, of target 1.
    identification : dict of str to PointSet
        Area -> measured points of targets 1 to 3.
    verification : dict of int to dict of str to PointSet
        Payload (kg) -> area -> measured points of targets 1 to 8.
    commanded : dict of str to tuple
        Area -> joints (n, 6) and target (n,) of the verification.
    whole : dict of str to ndarray, shape (n, 6)
        Area -> joints at which targets 1 to 3 are all in sight.
    sphere : tuple
        Joints (n, 6) and target (n,) of the relative analyses.
    """

    settings: Settings
    cell: Cell
    first: Robot
    axes: dict[int, PointSet]
    identification: dict[str, PointSet]
    verification: dict[int, dict[str, PointSet]]
    commanded: dict[str, tuple[FloatArray, IntArray]]
    whole: dict[str, FloatArray]
    sphere: tuple[FloatArray, IntArray]

    def __post_init__(self) -> None:
        pairs = {area: locked(list(pair)) for area, pair in self.commanded.items()}
        object.__setattr__(self, "commanded", pairs)
        object.__setattr__(self, "sphere", locked(list(self.sphere)))
        lock(self)

    @classmethod
    def of(cls, settings: Settings) -> Stage:
        """Draw the poses of a study and measure them."""
        cell = simulation.open_cell("irb1600", seed=settings.seed)
        poses = procedure.campaign(cell, settings.pool, settings.points, settings.seed)
        measured = procedure.measure(cell, poses)
        for area in AREAS:
            wanted = max(max(shares(r.measures)[1:]) for r in repetitions(settings))
            if measured.identification[area].poses < wanted:
                raise MeasurementError(
                    f"{measured.identification[area].poses} identification points were seen in {area}, {wanted} are "
                    "needed: ask for more verification points or for smaller procedures"
                )
        heavy = procedure.measure(cell.with_payload(PAYLOADS[1]), poses).verification
        three = cell.with_targets(procedure.IDENTIFIED)
        whole = {
            area: procedure.random_poses(three, settings.verified, [settings.seed, 2, k], where)
            for k, (area, where) in enumerate(zip(AREAS, (procedure.in_cube, procedure.in_range), strict=True))
        }
        cell = cell.with_targets(procedure.VERIFIED).without("visibility")
        return cls(
            settings,
            cell,
            by_axes(cell, measured),
            {n: measured.axes if n == 54 else _axis_points(cell, n) for n in MOVES},
            measured.identification,
            dict(zip(PAYLOADS, (measured.verification, heavy), strict=True)),
            poses.verification,
            whole,
            sphere_poses(cell.arm, settings.seed),
        )

    def told(self) -> Sequence[Told]:
        """What was measured, in a sentence."""
        seen = ", ".join(f"{points.poses} in {area}" for area, points in self.identification.items())
        return (
            f"SIMULATED campaign, seed {self.settings.seed}: measurements to identify from {seen}; "
            f"{self.settings.points} to verify in each area with each payload",
        )


def by_axes(cell: Cell, measured: procedure.Measured) -> Robot:
    """The robot that the moves of single joints give: base, tool and links (Nubiola 2011, sections 3.1 and 5.4.4).

    Parameters
    ----------
    cell : Cell
    measured : Measured

    Returns
    -------
    Robot
    """
    return calibrate_by_axes(cell.arm, measured.moves).robot


def _axis_points(cell: Cell, count: int) -> PointSet:
    """Moves of one joint at a time, seen at target 1."""
    joints = [angle * DEG * np.eye(6)[j] for j, angles in enumerate(MOVES[count]) for angle in angles]
    groups = [f"axis{j + 1}" for j, angles in enumerate(MOVES[count]) for _ in angles]
    return cell.with_targets(["smr1"]).measure(np.array(joints), run=100 + count).points(groups)


def sphere_poses(arm: Arm, seed: int) -> tuple[FloatArray, IntArray]:
    """Random places in the sphere of Nubiola 2011, Figure 7.12, the tool turned a little from zero joints.

    Returns
    -------
    q : ndarray, shape (n, 6)
        Of the configurations the one nearest to zero joints, radians.
    target : ndarray of int, shape (n,)
        Of the eight.
    """
    rng = np.random.default_rng([seed, 3])
    home = arm.forward(np.zeros((1, 6)))[0]
    places = rng.uniform(-1.0, 1.0, (4 * SPHERE_POINTS, 3))
    places = places[np.linalg.norm(places, axis=1) <= 1.0][:SPHERE_POINTS]
    T = np.tile(home, (SPHERE_POINTS, 1, 1))
    T[:, :3, 3] = SPHERE_CENTRE + SPHERE_DIAMETER / 2 * places
    turns = rng.standard_normal((SPHERE_POINTS, 3))
    turns *= SPHERE_TURN * rng.uniform(0, 1, (SPHERE_POINTS, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    T[:, :3, :3] = [home[:3, :3] @ frames.rotation_from_vector(v) for v in turns]
    q, branch = closed_form.nearest(arm, closed_form.branches(arm, T), np.zeros(6))
    if (branch < 0).any():
        raise MeasurementError("the robot does not reach the sphere of the relative analyses")
    return q, rng.integers(0, len(procedure.VERIFIED), SPHERE_POINTS)
