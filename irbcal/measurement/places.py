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
    sessions = np.zeros(points.poses) if points.session is None else points.session
    names = [f"{session}\n{name}" for session, name in zip(sessions, points.pose_ids, strict=True)]
    return of_joints(points.q, np.array(names, dtype=object))


def of_joints(q: FloatArray, names: np.ndarray | None = None) -> IntArray:
    """As `places`, of joints (n, joints), radians (metres), and names (n,) of the poses."""
    n = len(q)
    if not n:
        return np.zeros(0, dtype=int)
    # exact copies first: many of them would make very many pairs
    single, copy_of = np.unique(q, axis=0, return_inverse=True)
    copy_of = copy_of.ravel()
    edges = [near.pairs(single, SAME_PLACE)]
    if names is not None:
        _, called = np.unique(names.astype(str), return_inverse=True)
        leader = np.zeros(called.max() + 1, dtype=int)
        leader[called[::-1]] = copy_of[::-1]
        edges.append(np.column_stack([copy_of, leader[called]]))
    found = near.connected(len(single), np.concatenate(edges))[copy_of]
    _, first, number = np.unique(found, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[number.ravel()]


def copies(points: PointSet) -> int:
    """Number of points that stand in the data before with the same joints and position, to the last digit."""
    rows = np.column_stack([points.joints(), points.target, points.xyz])
    return len(rows) - len(np.unique(rows, axis=0))


def notes(points: PointSet) -> list[str]:
    """What the user should know of repeats and of copied rows, in sentences."""
    found = places(points)
    count = int(found.max(initial=-1)) + 1
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
