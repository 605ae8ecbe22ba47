"""Repeats: poses that are the same place of the robot, measured several times.

A pose that is measured again shows the tracker's noise anew, and the robot's error once more: whoever has seen one of
the repeats knows the robot's error at the others. Proof on poses that a fit never saw, cross-validation, bootstrap and
leaving out one at a time therefore take all repeats of a place together.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.measurement import near
from irbcal.measurement.points import PointSet
from irbcal.units import DEG

MANY = 2000
"""Poses from which time matters."""
SAME_PLACE = 0.01 * DEG
"""Joints that all agree within this are one place, radians (metres for prismatic joints)."""


def places(points: PointSet) -> IntArray:
    """Which poses are one place: the same joints within `SAME_PLACE`, or the same name.

    Poses of one name are the cycles of one pose of a program. Across sessions names mean nothing, equal joints do.

    Parameters
    ----------
    points : PointSet

    Returns
    -------
    ndarray of int, shape (n,)
        Number of each pose's place, from 0 in the order in which they are first seen.
    """
    if points.session is None:
        return of_joints(points.q, points.pose_ids)
    names = [f"{session}\n{name}" for session, name in zip(points.session, points.pose_ids, strict=True)]
    return of_joints(points.q, np.array(names, dtype=object))


def of_joints(q: FloatArray, names: np.ndarray | None = None) -> IntArray:
    """As `places`, of joints (n, joints), radians (metres), and names (n,) of the poses."""
    n = len(q)
    if not n:
        return np.zeros(0, dtype=int)
    # exact copies first: many of them would make very many pairs
    copy_of, first = _equal(q)
    single = q[first]
    edges = [near.pairs(single, SAME_PLACE)]
    if names is not None:
        called = _called(names)
        leader = np.zeros(called.max() + 1, dtype=int)
        leader[called[::-1]] = copy_of[::-1]
        edges.append(np.column_stack([copy_of, leader[called]]))
    between = np.concatenate(edges)
    between = between[between[:, 0] != between[:, 1]]
    if not len(between) and len(single) == n:
        return np.arange(n)
    label = near.connected(len(single), between)[copy_of]
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[number.ravel()]


def _equal(q: FloatArray) -> tuple[IntArray, IntArray]:
    """Number of each row, the same for equal rows, and the first row of each number."""
    order = np.lexsort(q.T[::-1]) if len(q) < MANY else np.argsort(near.mixture(q))
    new = np.r_[True, (q[order[1:]] != q[order[:-1]]).any(axis=1)]
    number = np.empty(len(q), dtype=int)
    number[order] = np.cumsum(new) - 1
    return number, order[new]


def _called(names: np.ndarray) -> IntArray:
    """Number of each name, from 0."""
    if len(names) < MANY:
        return np.unique(names.astype(str), return_inverse=True)[1].ravel()
    import pandas as pd

    return np.asarray(pd.factorize(names)[0])


def copies(points: PointSet) -> int:
    """Number of points that stand in the data before with the same joints and position, to the last digit."""
    order = np.lexsort([points.target, *points.xyz.T])  # equal rows beside one another: pose by pose they differ
    pose, target, xyz = points.pose[order], points.target[order], points.xyz[order]
    alike = np.flatnonzero((target[1:] == target[:-1]) & (xyz[1:] == xyz[:-1]).all(axis=1))
    if not len(alike):
        return 0
    candidates = np.unique([alike, alike + 1])
    rows = np.column_stack([points.q[pose[candidates]], target[candidates], xyz[candidates]])
    return len(rows) - len(np.unique(rows, axis=0))


def notes(points: PointSet) -> list[str]:
    """What the user should know of repeats and of copied rows, in sentences."""
    label = places(points)
    count = int(label.max(initial=-1)) + 1
    out = []
    if count < points.poses:
        out.append(
            f"The {points.poses} poses are {count} places, some of them measured several times: repeats of a place are "
            "fitted together or held out together, and what is held out is counted in places."
        )
    twice = copies(points)
    if twice:
        out.append(
            f"{twice} point{'s stand' if twice > 1 else ' stands'} in the measurements again with the same joints and "
            "position to the last digit: copies of rows, not repeats, which count twice in the fit. Leave them out of "
            "the file."
        )
    return out
