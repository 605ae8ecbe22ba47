"""Poses that are given, and whether they are poses at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import RobotError

ROTATION_TOLERANCE = 1e-6
"""Deviation from a rotation matrix above which a pose counts as no pose."""


def check_poses(T: ArrayLike) -> FloatArray:
    """Refuse pose arrays that are not (n, 4, 4)."""
    T = np.asarray(T, dtype=float)
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise RobotError(f"poses need shape (n, 4, 4), found {T.shape}", parameter="T_base_tip")
    return T


def is_rotation(X: FloatArray) -> BoolArray:
    """Whether the columns n, o, a in the rows 0 to 8 of X (12, n) form a rotation: a mask (n,).

    A matrix whose squares add up to 3 and whose determinant is 1 is one.
    """
    n, o, a = X[:9].reshape(3, 3, -1)
    squares, determinant = (X[:9] ** 2).sum(axis=0), (np.cross(n, o, axis=0) * a).sum(axis=0)
    return np.maximum(np.abs(squares - 3.0), np.abs(determinant - 1.0)) <= ROTATION_TOLERANCE


def has_last_row(T: FloatArray) -> BoolArray:
    """Whether the last row of poses (n, 4, 4) is 0, 0, 0, 1: a mask (n,)."""
    return np.abs(T[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1) <= ROTATION_TOLERANCE


def usable(T: FloatArray, columns: FloatArray) -> BoolArray:
    """Whether poses (n, 4, 4), whose `pose_columns` are given, too, are finite rigid transforms: a mask (n,)."""
    return is_rotation(columns.reshape(12, -1)) & np.isfinite(columns[3]).all(axis=0) & has_last_row(T)


def pose_columns(T: FloatArray) -> FloatArray:
    """Columns x, y, z and origin (4, 3, n) of poses (n, 4, 4)."""
    return np.ascontiguousarray(T[:, :3].transpose(2, 1, 0))
