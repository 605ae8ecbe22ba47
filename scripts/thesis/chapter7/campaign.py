"""The thesis's measuring campaign in the virtual cell (Nubiola 2011, sections 7.1, 7.2, 7.4 and 7.7).

Moves of one joint at a time, moves of joints 5 and 6 to find the tool, random poses in the ISO cube and in the whole
range, one target in each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.measurement.points import PointSet
from irbcal.simulation.pose_list import AREAS, IDENTIFIED, VERIFIED, in_cube, in_range, random_poses
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.units import DEG


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


def campaign(cell: VirtualCell, identification: int = 400, verification: int = 8000, seed: int = 0) -> Campaign:
    """Draw the poses of a campaign (Nubiola 2011, sections 7.1 and 7.2).

    Parameters
    ----------
    cell : VirtualCell
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


def measure(cell: VirtualCell, poses: Campaign) -> Measured:
    """Measure a campaign in one go: axes, tool, identification, verification.

    Parameters
    ----------
    cell : VirtualCell
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
