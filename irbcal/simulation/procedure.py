"""Poses for the virtual cell: random ones in the tracker's sight, and the thesis's measuring campaign.

The campaign is that of Nubiola 2011, sections 7.1, 7.2, 7.4 and 7.7: moves of one joint at a time, moves of joints 5
and 6 to find the tool, random poses in the ISO cube and in the whole range, one target in each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock
from irbcal.errors import MeasurementError
from irbcal.measurement.points import PointSet
from irbcal.simulation.cell import Cell
from irbcal.thesis_setup import FRONT, IRB1600_CUBE, IRB1600_HEIGHTS
from irbcal.units import DEG

Region: TypeAlias = "Callable[[FloatArray], BoolArray]"
"""From tip positions (n, 3) in the base link, metres, to a mask (n,) of those inside."""

BLOCK = 20_000
"""Random poses that are looked at together."""
MOST_BLOCKS = 2000

CUBE_CENTRE, CUBE_EDGE = IRB1600_CUBE

AREAS = ("iso_cube", "all_range")
IDENTIFIED = ("smr1", "smr2", "smr3")
"""Targets that the identification uses (Nubiola 2011, section 7.3)."""
VERIFIED = tuple(f"smr{k}" for k in range(1, 9))
"""Targets that the verification uses."""


def in_cube(p: FloatArray) -> BoolArray:
    """Which positions (n, 3) in the base link lie in the ISO cube of the IRB 1600 (Nubiola 2011, section 7.2)."""
    return np.all(np.abs(p - CUBE_CENTRE) <= CUBE_EDGE / 2, axis=1)


def in_range(p: FloatArray) -> BoolArray:
    """Which positions (n, 3) lie above the obstacles around the thesis's robot (Nubiola 2011, section 7.2)."""
    return p[:, 2] > np.where(p[:, 0] >= FRONT, *IRB1600_HEIGHTS)


def above_floor(p: FloatArray) -> BoolArray:
    """Which positions (n, 3) lie above the robot's base plane."""
    return p[:, 2] > 0.0


def random_poses(
    cell: Cell,
    count: int,
    seed: int | Sequence[int] = 0,
    wanted: Region = above_floor,
    targets: IntArray | None = None,
) -> FloatArray:
    """Random joints inside the limits with targets in sight, rounded to 1e-4 degrees (mm) as they are commanded.

    Parameters
    ----------
    cell : Cell
        With the effect ``visibility`` off, every target is in sight.
    count : int
    seed : int or sequence of int
    wanted : callable
        From tip positions (n, 3) in the base link to a mask of the poses to keep.
    targets : ndarray of int, shape (count,), optional
        The target that must be in sight in each pose; by default all that look the same way as the first one.

    Returns
    -------
    ndarray, shape (count, joints)
        Radians (metres for prismatic joints).

    Raises
    ------
    MeasurementError
        If hardly any pose is as wanted.
    """
    arm, rng, units = cell.arm, np.random.default_rng(seed), cell.arm.joint_units
    free = np.where(arm.table.prismatic, 1.0, np.pi)
    lower, upper = (np.where(np.isfinite(b), b, s * free) for b, s in ((arm.lower, -1.0), (arm.upper, 1.0)))
    alike = cell.tool.direction @ cell.tool.direction[0] > 1.0 - 1e-9
    wish = np.zeros(count, dtype=int) if targets is None else np.asarray(targets)
    found, missing = np.zeros((count, len(lower))), np.ones(count, dtype=bool)
    for _ in range(MOST_BLOCKS):
        q = np.round(rng.uniform(lower, upper, (BLOCK, len(lower))) / units, 4) * units
        q = q[np.all((q >= lower) & (q <= upper), axis=1)]
        q = q[wanted(arm.forward(q)[:, :3, 3])]
        seen = cell.visible(q)
        if targets is None:
            seen = np.all(seen[:, alike], axis=1)[:, None]
        for target in np.unique(wish[missing]):
            good = q[seen[:, target]]
            places = np.flatnonzero(missing & (wish == target))[: len(good)]
            found[places], missing[places] = good[: len(places)], False
        if not missing.any():
            return found
    raise MeasurementError(
        f"of {MOST_BLOCKS * BLOCK} random poses {int((~missing).sum())} were as wanted and in the tracker's sight, "
        f"{count} were asked for: move the tracker, or switch the effect visibility off"
    )


@dataclass(frozen=True, eq=False)
class Campaign:
    """Poses of the thesis's measurements.

    Attributes
    ----------
    axes, tool : ndarray, shape (n, 6)
        One joint at a time: nine poses each from -40 to 40 degrees with target 1, and joints 5 and 6 from -90 to 90
        degrees with all targets (Nubiola 2011, section 3.4.4). The operator turns the reflectors to the tracker there.
    identification, verification : dict of str to tuple
        Area -> joints (n, 6) and the target of each pose (n,), for targets 1 to 3 and 1 to 8.
    """

    axes: FloatArray
    tool: FloatArray
    identification: dict[str, tuple[FloatArray, IntArray]]
    verification: dict[str, tuple[FloatArray, IntArray]]

    def __post_init__(self) -> None:
        lock(self)


@dataclass(frozen=True, eq=False)
class Measured:
    """What the tracker saw in a campaign; all in one frame, target names as in the cell.

    Attributes
    ----------
    moves : PointSet
        Axes and tool together, in the groups ``axis1`` ... ``axis6``.
    axes : PointSet
        Target 1 alone.
    identification, verification : dict of str to PointSet
    """

    moves: PointSet
    axes: PointSet
    identification: dict[str, PointSet]
    verification: dict[str, PointSet]

    def __post_init__(self) -> None:
        lock(self)


def campaign(cell: Cell, identification: int = 400, verification: int = 8000, seed: int = 0) -> Campaign:
    """Draw the poses of a campaign (Nubiola 2011, sections 7.1 and 7.2).

    Parameters
    ----------
    cell : Cell
        Of an IRB 1600.
    identification, verification : int
        Poses in each area.
    seed : int

    Returns
    -------
    Campaign
    """
    cell = cell.with_targets(VERIFIED)
    drawn = []
    for part, (count, targets) in enumerate(((identification, IDENTIFIED), (verification, VERIFIED))):
        which = np.arange(count) % len(targets)
        drawn.append(
            {
                area: (random_poses(cell, count, [seed, part, k], where, which), which)
                for k, (area, where) in enumerate(zip(AREAS, (in_cube, in_range), strict=True))
            }
        )
    axes = np.vstack([angle * DEG * np.eye(6)[j] for j in range(6) for angle in range(-40, 41, 10)])
    tool = np.vstack([angle * DEG * np.eye(6)[j] for j in (4, 5) for angle in range(-90, 91, 30)])
    return Campaign(axes, tool, *drawn)


def measure(cell: Cell, poses: Campaign) -> Measured:
    """Measure a campaign in one go: axes, tool, identification, verification.

    Parameters
    ----------
    cell : Cell
    poses : Campaign

    Returns
    -------
    Measured
    """
    cell = cell.with_targets(VERIFIED).without("visibility")  # the poses were chosen so that the targets are seen
    groups = [f"axis{j}" for j in range(1, 7) for _ in range(9)]
    only_first = np.arange(len(VERIFIED))[None] == 0
    axes = cell.measure(poses.axes, np.repeat(only_first, len(poses.axes), axis=0), run=1).points(groups)
    tool = cell.measure(poses.tool, run=2).points(["axis5"] * 7 + ["axis6"] * 7)
    parts: list[dict[str, PointSet]] = []
    for k, part in enumerate((poses.identification, poses.verification)):
        parts.append({})
        for i, (area, (q, which)) in enumerate(part.items()):
            asked = which[:, None] == np.arange(len(VERIFIED))
            parts[-1][area] = cell.measure(q, asked, run=10 * (k + 1) + i).points([area] * len(q))
    return Measured(joined(axes, tool), axes, *parts)


def joined(*sets: PointSet) -> PointSet:
    """Point sets of one measuring frame as one; poses are numbered anew."""
    names = tuple(sorted({name for points in sets for name in points.target_names}))
    starts = np.cumsum([0, *(points.poses for points in sets)])
    target = [np.array([names.index(name) for name in points.target_names])[points.target] for points in sets]
    return PointSet(
        np.concatenate([points.q for points in sets]),
        np.concatenate([points.pose + start for points, start in zip(sets, starts[:-1], strict=True)]),
        np.concatenate(target),
        np.concatenate([points.xyz for points in sets]),
        names,
        np.arange(1, starts[-1] + 1),
        np.concatenate([points.groups for points in sets]),
    )


def drawn(points: PointSet, count: int, rng: np.random.Generator) -> PointSet:
    """A random choice of the poses of a point set."""
    keep = np.zeros(points.poses, dtype=bool)
    keep[rng.permutation(points.poses)[:count]] = True
    return points.select(keep).with_seen_targets()
