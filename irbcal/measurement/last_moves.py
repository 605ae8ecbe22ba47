"""The stop before each pose and the last move of each joint: what backlash and lag depend on."""

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, NameArray
from irbcal.units import DEG

STILL = 2e-3 * DEG
"""Largest change of a joint, whole turns aside, that still counts as standing still."""


def last_moves(q: ArrayLike, groups: NameArray | None = None) -> FloatArray:
    """Last move of each joint before each pose.

    A joint that stands still keeps its last move: it still leans to the side it came from. The first pose and the first
    pose of each group follow a move that the file does not tell.

    Parameters
    ----------
    q : array_like, shape (n, joints)
        Joints in the order in which the robot visited them, radians.
    groups : ndarray of str, shape (n,), optional

    Returns
    -------
    ndarray, shape (n, joints)
        Radians, NaN where unknown.
    """
    q = np.asarray(q, dtype=float)
    change = np.vstack([np.full((min(len(q), 1), q.shape[1]), np.nan), np.diff(q, axis=0)])
    if groups is not None and len(q):
        change[np.r_[True, groups[1:] != groups[:-1]]] = np.nan
    moves_seen = ~(np.abs(change) <= STILL)
    last = np.maximum.accumulate(np.where(moves_seen, np.arange(len(q))[:, None], 0), axis=0)
    return np.take_along_axis(change, last, axis=0)


def previous_stops(q: FloatArray, pose: IntArray, groups: NameArray) -> FloatArray:
    """The stop before each pose, from the order of a file's rows.

    Where the robot stands still from one pose to the next (`STILL`), the next one is a repeat: it has the stop before
    of the first, because its joints still lean to the side they came from.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
        Joints of each pose, radians (metres for prismatic joints).
    pose : ndarray of int, shape (rows,)
        Pose of each row, in the order of the file.
    groups : ndarray of str, shape (rows,)
        Group of each row.

    Returns
    -------
    ndarray, shape (n, joints)
        NaN rows where it is not known: for the first pose of the file and of each stretch of a group, and for poses
        that stand in several places of the file behind different poses.
    """
    first = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])  # of each stretch of rows of one pose
    stops, stop_groups = pose[first], groups[first]
    previous = np.full((len(stops), q.shape[1]), np.nan)
    same_group = np.r_[False, stop_groups[1:] == stop_groups[:-1]]
    previous[same_group] = q[stops[np.flatnonzero(same_group) - 1]]
    repeat = same_group & (np.abs(previous - q[stops]) <= STILL).all(axis=1)
    previous = previous[np.maximum.accumulate(np.where(repeat, 0, np.arange(len(stops))))]
    out = np.full(q.shape, np.nan)
    out[stops[::-1]] = previous[::-1]  # the first stretch of each pose
    unlike = (previous != out[stops]).any(axis=1)
    out[stops[unlike]] = np.nan
    return out
