"""The last move of each joint before each pose: what backlash and lag depend on."""

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, NameArray
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
    out = np.full(q.shape, np.nan)
    fresh = np.zeros(len(q), dtype=bool) if groups is None else np.r_[True, groups[1:] != groups[:-1]]
    change = np.diff(q, axis=0)
    for k in range(1, len(q)):
        if not fresh[k]:
            out[k] = np.where(np.abs(change[k - 1]) > STILL, change[k - 1], out[k - 1])
    return out
