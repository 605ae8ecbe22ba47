"""How programs write targets: millimetres, degrees and quaternions with so many decimals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.modeling import frames
from irbcal.units import MM

DECIMALS = 6
"""Decimals written for millimetres and degrees."""

QUATERNION_DECIMALS = 9
"""Decimals written for the components of a quaternion."""

QUATERNION_TOLERANCE = 1e-3
"""How far the length of a quaternion may be from one."""


def quaternion_problem(quaternion: Sequence[float]) -> str | None:
    """What is wrong with the length of a quaternion, None if nothing is."""
    length = math.hypot(*quaternion)
    if abs(length - 1.0) <= QUATERNION_TOLERANCE:
        return None
    return f"expected a unit quaternion, found one of length {length:.4g}"


def poses_from_numbers(numbers: ArrayLike) -> FloatArray:
    """Transforms from millimetres and quaternions.

    Parameters
    ----------
    numbers : ndarray, shape (n, 7)
        x, y, z in mm and the quaternion, scalar first, of any positive length.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        Metres.
    """
    rows = np.asarray(numbers, dtype=float).reshape(-1, 7)
    w, x, y, z = (rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)).T
    T = np.zeros((len(rows), 4, 4))
    T[:, 0, :3] = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
    T[:, 1, :3] = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    T[:, 2, :3] = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    T[:, :3, 3] = rows[:, :3] * MM
    T[:, 3, 3] = 1.0
    return T


def numbers_from_poses(T: ArrayLike, near: FloatArray | None = None) -> FloatArray:
    """Millimetres and unit quaternions of transforms; the inverse of `poses_from_numbers`.

    Parameters
    ----------
    T : ndarray, shape (n, 4, 4)
        Metres.
    near : ndarray, shape (n, 4), optional
        Quaternions, scalar first: of ``q`` and ``-q``, the one nearer to these is taken. Without, the scalar
        part is not negative.

    Returns
    -------
    ndarray, shape (n, 7)

    Raises
    ------
    ValueError
        If a transform is not rigid.
    """
    poses = np.asarray(T, dtype=float).reshape(-1, 4, 4)
    R = poses[:, :3, :3]
    rigid = np.isfinite(poses).all() and np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0.0) < 1e-6
    if not rigid or (np.linalg.det(R) < 0).any() or (poses[:, 3] != [0, 0, 0, 1]).any():
        raise ValueError("expected rigid transforms")
    quaternion = frames.quaternion_from_matrix(R)
    sign = quaternion[:, 0] if near is None else (quaternion * near).sum(axis=1)
    quaternion *= np.where(sign < 0, -1.0, 1.0)[:, None]
    return np.column_stack([poses[:, :3, 3] / MM, quaternion])


def number_text(value: float, decimals: int) -> str:
    """A number without exponent, without needless zeros and without a negative zero."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
