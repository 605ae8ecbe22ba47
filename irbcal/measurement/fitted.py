"""Which poses a fit has seen: they prove nothing about it."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, IntArray
from irbcal.measurement import near
from irbcal.measurement.places import SAME_PLACE
from irbcal.measurement.points import PointSet

SAME_POINT = 2e-6
"""Metres: two measurements of one reflector differ by more, one that was rounded and registered again does not."""
SAME_JOINTS = 1e-7
"""Radians (metres): joints of one row, as they are written into files."""


def rows_of(points: PointSet, fit: PointSet) -> BoolArray:
    """Which poses are rows of the fit: the same joints and, for one of their targets, the same measured place.

    Parameters
    ----------
    points, fit : PointSet
        In the same measuring frame.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    out = np.zeros(points.poses, dtype=bool)
    if not len(points) or not len(fit) or points.q.shape[1] != fit.q.shape[1]:
        return out
    alike = near.between(points.q, fit.q, SAME_JOINTS)
    if alike is not None:  # poses at the same joints first: of other measurements there are none
        return _measured_alike(points, fit, alike)
    nearest = near.nearest(points.xyz, fit.xyz, SAME_POINT)
    found = np.flatnonzero(nearest >= 0)
    same = np.abs(points.joints()[found] - fit.joints()[nearest[found]]).max(axis=1) <= SAME_JOINTS
    out[points.pose[found[same]]] = True
    return out


def places_of(points: PointSet, fit: PointSet) -> BoolArray:
    """Which poses are at joints of the fit, within `irbcal.measurement.places.SAME_PLACE`; as `rows_of`."""
    if not points.poses or not fit.poses or points.q.shape[1] != fit.q.shape[1]:
        return np.zeros(points.poses, dtype=bool)
    alike = near.between(points.q, fit.q, SAME_PLACE)
    if alike is None:
        return np.asarray(near.nearest(points.q, fit.q, SAME_PLACE, p=np.inf) >= 0)
    out = np.zeros(points.poses, dtype=bool)
    out[alike[:, 0]] = True
    return out


def _measured_alike(points: PointSet, fit: PointSet, alike: IntArray) -> BoolArray:
    """Which poses have a point where one of the fit at the same joints has one; ``alike``: (pose, pose of the fit)."""
    out = np.zeros(points.poses, dtype=bool)
    if not len(alike):
        return out
    ends = [np.searchsorted(fit.pose, alike[:, 1] + side) for side in (0, 1)]  # points are sorted by pose
    mine = [np.searchsorted(points.pose, alike[:, 0] + side) for side in (0, 1)]
    for one in range(int((mine[1] - mine[0]).max())):
        for other in range(int((ends[1] - ends[0]).max())):
            there = (mine[0] + one < mine[1]) & (ends[0] + other < ends[1])
            a, b = mine[0][there] + one, ends[0][there] + other
            near_ = np.linalg.norm(points.xyz[a] - fit.xyz[b], axis=1) < SAME_POINT
            out[alike[there, 0][near_]] = True
    return out
