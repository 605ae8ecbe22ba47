"""Poses that are given, and whether they are poses at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, aligned
from irbcal.errors import RobotError

ROTATION_TOLERANCE = 1e-6
"""Deviation from a rotation matrix above which a pose counts as no pose."""


def check_poses(T: ArrayLike) -> FloatArray:
    """Refuse pose arrays that are not (n, 4, 4)."""
    T = np.asarray(T, dtype=float)
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise RobotError(f"poses need shape (n, 4, 4), found {T.shape}", parameter="T_base_tip")
    return T


def is_rotation(X: FloatArray, room: FloatArray | None = None) -> BoolArray:
    """Whether the columns n, o, a in the rows 0 to 8 of X (12, n) form a rotation: a mask (n,).

    A matrix whose squares add up to 3 and whose determinant is 1 is one. ``room`` (10 rows or more) may be given.
    """
    room = aligned(10, X.shape[1]) if room is None else room
    n, o, a = X[:9].reshape(3, 3, -1)
    squares, determinant, product = room[0], room[1], room[2]
    np.add.reduce(np.multiply(X[:9], X[:9], out=room[1:10]), axis=0, out=squares)
    determinant[:] = 0.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(n[j], o[k], out=product)
        np.subtract(product, np.multiply(n[k], o[j], out=room[3]), out=product)
        np.add(determinant, np.multiply(product, a[i], out=product), out=determinant)
    for value, target in ((squares, 3.0), (determinant, 1.0)):
        np.abs(np.subtract(value, target, out=value), out=value)
    return np.maximum(squares, determinant, out=squares) <= ROTATION_TOLERANCE


def has_last_row(T: FloatArray, room: FloatArray | None = None) -> BoolArray:
    """Whether the last row of poses (n, 4, 4) is 0, 0, 0, 1: a mask (n,). ``room`` (4 rows or more) may be given."""
    off = aligned(4, len(T)) if room is None else room[:4]
    off[:] = T[:, 3].T
    np.subtract(off[3], 1.0, out=off[3])
    if off.size and off.min() == 0.0 == off.max():
        return np.ones(len(T), dtype=bool)
    return np.asarray(np.maximum.reduce(np.abs(off, out=off), axis=0) <= ROTATION_TOLERANCE)


def usable(T: FloatArray, columns: FloatArray) -> BoolArray:
    """Whether poses (n, 4, 4), whose `pose_columns` are given, too, are finite rigid transforms: a mask (n,)."""
    return is_rotation(columns.reshape(12, -1)) & np.isfinite(columns[3]).all(axis=0) & has_last_row(T)


def pose_columns(T: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """Columns x, y, z and origin (4, 3, n) of poses (n, 4, 4), into ``out`` where it is given."""
    columns = T[:, :3].transpose(2, 1, 0)
    if out is None:
        return np.ascontiguousarray(columns)
    out[:] = columns
    return out
