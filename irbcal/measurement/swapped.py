"""Reflectors whose names are exchanged: a permutation of targets, seen by the tool's shape or against a robot."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling.robot import Robot
from irbcal.units import MM

SAME = 0.5 * MM
"""Deviation of all distances of a rigid tool below which two poses show the same shape, metres."""
OTHER = 1.0 * MM
"""Deviation above which they do not."""
CANDIDATES = 60
"""Poses that are tried as the one that most others look like."""
MOST_TARGETS = 6
"""Beyond, permutations are too many to be tried."""
FAR = 5 * MM
"""Largest distance of a pose's points from the robot below which no exchange is looked for, metres."""
CLOSER = 0.2
"""Share of that distance to which an exchange must bring it."""


def by_shape(measured: FloatArray) -> list[tuple[int, IntArray]]:
    """Poses whose targets have the distances of most other poses once their names are exchanged.

    Parameters
    ----------
    measured : ndarray, shape (n, k, 3)
        Targets on a rigid tool as measured in each pose, metres; NaN where not seen.

    Returns
    -------
    list of (pose, order)
        ``order[k]`` is the target that is called ``k`` in this pose.
    """
    n, k, _ = measured.shape
    if not 3 <= k <= MOST_TARGETS or n < 3:
        return []
    i, j = np.triu_indices(k, 1)
    D = np.stack([np.linalg.norm(measured[:, a] - measured[:, b], axis=1) for a, b in zip(i, j, strict=True)])
    full = np.flatnonzero(np.isfinite(D).all(axis=0))
    if len(full) < 3:
        return []
    D = D[:, full]

    def off_from(shape: FloatArray) -> FloatArray:
        return np.abs(D - shape[:, None]).max(axis=0)

    tried = np.unique(np.linspace(0, len(full) - 1, CANDIDATES).astype(int))
    alike = np.array([np.count_nonzero(off_from(D[:, c]) < SAME) for c in tried])
    shape = np.median(D[:, off_from(D[:, tried[np.argmax(alike)]]) < SAME], axis=1)
    distances = np.zeros((k, k))
    distances[i, j] = distances[j, i] = shape
    out = []
    for row in np.flatnonzero(off_from(shape) > OTHER):
        p = full[row]
        orders = [np.array(order) for order in permutations(range(k))]
        off = [np.abs(D[:, row] - distances[np.ix_(order, order)][i, j]).max() for order in orders]
        if min(off) < SAME:
            out.append((int(p), orders[int(np.argmin(off))]))
    return out


def by_robot(robot: Robot, points: PointSet) -> list[tuple[int, IntArray]]:
    """Poses whose points a robot meets once their names are exchanged; as `by_shape`, of all the points' targets."""
    k = len(points.target_names)
    if not 2 <= k <= MOST_TARGETS:
        return []
    distance = distances(robot, points)
    worst = np.zeros(points.poses)
    np.maximum.at(worst, points.pose, distance)
    far = np.flatnonzero(worst > FAR)
    if not len(far):
        return []
    far_points = points.select(np.isin(np.arange(points.poses), far))
    # where each pose's points would be expected, were they any of the targets: (poses, targets, 3)
    n = far_points.poses
    every = PointSet(
        far_points.q,
        np.repeat(np.arange(n), k),
        np.tile(np.arange(k), n),
        np.zeros((n * k, 3)),
        far_points.target_names,
        far_points.pose_ids,
        far_points.groups,
        previous=far_points.previous,
    )
    expected = every.predicted(robot).reshape(n, k, 3)
    measured = np.full((n, k, 3), np.nan)
    measured[far_points.pose, far_points.target] = far_points.xyz
    best = worst[far] * CLOSER
    best_order = np.full((n, k), -1)
    for permutation in permutations(range(k)):
        off = np.linalg.norm(measured - expected[:, permutation], axis=2)
        largest: FloatArray = np.where(np.isfinite(off), off, 0.0).max(axis=1)
        improved = largest < best
        best[improved] = largest[improved]
        best_order[improved] = permutation
    return [(int(far[row]), best_order[row]) for row in np.flatnonzero(best_order[:, 0] >= 0)]


def in_words(swaps: Sequence[tuple[object, IntArray]], names: Sequence[str]) -> list[str]:
    """Sentences on exchanged names.

    Parameters
    ----------
    swaps : sequence of (pose, order)
        Names of the poses, and as `by_shape`.
    names : sequence of str
        Of the targets.

    Returns
    -------
    list of str
        One for each exchange.
    """
    by_order: dict[tuple[int, ...], list[str]] = {}
    for pose, order in swaps:
        by_order.setdefault(tuple(order.tolist()), []).append(str(pose))
    out = []
    for change, poses in by_order.items():
        moved = [k for k, target in enumerate(change) if target != k]
        if len(moved) == 2:
            mixed = f"{names[moved[0]]} and {names[moved[1]]} are swapped"
        else:
            mixed = f"{', '.join(names[k] for k in moved)} are in truth {', '.join(names[change[k]] for k in moved)}"
        first = f"pose {poses[0]}" if len(poses) == 1 else f"{len(poses)} poses ({poses[0]} to {poses[-1]})"
        out.append(f"{mixed} in {first}: correct their names in the file.")
    return out
