"""The sides from which joints come along a path: what takes the place of the last move there."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.moves_along import strides


def previous_on_path(theta: FloatArray, prismatic: BoolArray) -> FloatArray:
    """Stops before the points of a path that have the directions of its joint speeds.

    Points of a path lie close together, and the arm does not stop there: the sign of a joint's speed tells which side
    it leans to, not how far the last point is. So each point is taken as reached by a move along the path's last step
    that is long enough to take up all play.

    Parameters
    ----------
    theta : ndarray, shape (n, joints)
        Joints along the path, radians (metres for prismatic joints).
    prismatic : ndarray of bool, shape (joints,)

    Returns
    -------
    ndarray, shape (n, joints)
        NaN for the first point, and for others up to the first step that moves a joint. Points without a step keep the
        direction of those before.
    """
    stride = strides(prismatic)
    step = np.diff(theta, axis=0)
    size = np.abs(step / stride).max(axis=1, initial=0.0)
    longer = np.maximum(1.0, 1.0 / np.where(size > 0.0, size, np.inf))
    move = np.vstack([np.full((1, theta.shape[1]), np.nan), step * longer[:, None]])
    last = np.maximum.accumulate(np.where(np.r_[False, size > 0.0], np.arange(len(theta)), 0))
    return np.asarray(theta - move[last], dtype=float)
