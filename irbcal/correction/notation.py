"""How controllers and tables write poses: with angles about axes in turn, a rotation vector or a quaternion.

Rotations act on columns: ``p_ref = R p_tool``. Angles about axes ``i j k`` mean ``R = Ri(first) Rj(second) Rk(third)``
where the order of the fields is that of the product; a maker that writes the fields the other way round (FANUC's
``W P R`` = fixed x, y, z, so ``Rz(R) Ry(P) Rx(W)``) says so with ``reverse``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

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

GIMBAL_LOCK = 1e-7
"""Cosine (or sine) of the middle angle below which only the sum of the outer two is determined."""

_TURN = 2.0 * np.pi


class Orientation(Protocol):
    """A way to write orientations in k numbers: three angles in radians, or a quaternion."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the fields."""
        ...

    def problem(self, values: Sequence[float]) -> str | None:
        """What is wrong with one row of numbers, one sentence part; None if nothing is."""
        ...

    def matrix(self, values: ArrayLike) -> FloatArray:
        """Rotations (n, 3, 3) of numbers (n, k)."""
        ...

    def values(self, R: ArrayLike, near: ArrayLike) -> FloatArray:
        """Numbers (n, k) of rotations (n, 3, 3): of all that mean the same, the nearest to ``near`` (n, k)."""
        ...


@dataclass(frozen=True)
class Angles:
    """Three angles about axes."""

    names: tuple[str, str, str]
    """Of the fields as the maker writes them."""
    axes: str
    """``zyx`` for ``Rz Ry Rx``, and so on; neighbours differ."""
    reverse: bool = False
    """Whether the first field is the angle about the last axis."""

    def problem(self, values: Sequence[float]) -> str | None:
        """Nothing is: all angles mean rotations."""
        return None

    def matrix(self, values: ArrayLike) -> FloatArray:
        """Rotations, see `Orientation.matrix`."""
        rows = self._in_order(values)
        first, second, third = (_about(axis, angle) for axis, angle in zip(self.axes, rows.T, strict=True))
        return np.asarray(first @ second @ third)

    def values(self, R: ArrayLike, near: ArrayLike) -> FloatArray:
        """Angles, see `Orientation.values`.

        Where the middle angle is singular, the first axis of the product keeps its angle. Angles are between -180 and
        180 degrees, unless ``near`` is not.
        """
        R = np.asarray(R, dtype=float).reshape(-1, 3, 3)
        old = self._in_order(near)
        up, along = self._first(R)
        first = np.where(np.hypot(up, along) < GIMBAL_LOCK, old[:, 0], np.arctan2(up, along))
        sets = []
        for start in (first, first + np.pi):
            R_rest = np.swapaxes(_about(self.axes[0], start), 1, 2) @ R
            second, third = _last_two(R_rest, self.axes[1], self.axes[2])
            sets.append(_turned(np.column_stack([start, second, third]), old))
        distance = [np.abs(angles - old).max(axis=1) for angles in sets]
        chosen = np.where((distance[1] < distance[0] - 1e-9)[:, None], sets[1], sets[0])
        return chosen[:, ::-1] if self.reverse else chosen

    def _in_order(self, values: ArrayLike) -> FloatArray:
        rows = np.asarray(values, dtype=float).reshape(-1, 3)
        return rows[:, ::-1] if self.reverse else rows

    def _first(self, R: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sine and cosine of the first angle, both times the cosine (or sine) of the middle one."""
        j, k = "xyz".index(self.axes[1]), "xyz".index(self.axes[2])
        i = _other(j, k)
        sign = _parity(i, j)
        if self.axes[0] == self.axes[2]:
            return R[:, j, k], sign * R[:, i, k]
        return -sign * R[:, j, k], R[:, k, k]


@dataclass(frozen=True)
class RotationVector:
    """The axis of the rotation with its angle as length (Universal Robots)."""

    names: tuple[str, str, str] = ("rx", "ry", "rz")

    def problem(self, values: Sequence[float]) -> str | None:
        """Nothing is: all angles mean rotations."""
        return None

    def matrix(self, values: ArrayLike) -> FloatArray:
        """Rotations, see `Orientation.matrix`."""
        rows = np.asarray(values, dtype=float).reshape(-1, 3)
        half = 0.5 * np.linalg.norm(rows, axis=1, keepdims=True)
        vector_part = 0.5 * np.sinc(half / np.pi) * rows  # sin(half) / (2 half) of the vector, also at zero
        return frames.matrix_from_quaternion(np.column_stack([np.cos(half), vector_part]))

    def values(self, R: ArrayLike, near: ArrayLike) -> FloatArray:
        """Vectors, see `Orientation.values`: next to half a turn, the one on the side of ``near``."""
        q = frames.quaternion_from_matrix(np.asarray(R, dtype=float).reshape(-1, 3, 3))
        old = np.asarray(near, dtype=float).reshape(-1, 3)
        length = np.linalg.norm(q[:, 1:], axis=1, keepdims=True)
        angle = 2.0 * np.arctan2(length, q[:, :1])
        size = np.linalg.norm(old, axis=1, keepdims=True)
        fallback = np.where(size > 0, old / np.where(size > 0, size, 1.0), 0.0)
        axis = np.where(length > 1e-12, q[:, 1:] / np.where(length > 1e-12, length, 1.0), fallback)
        turns = np.rint((np.sum(axis * old, axis=1, keepdims=True) - angle) / _TURN)
        return np.asarray(axis * (angle + _TURN * turns))


@dataclass(frozen=True)
class Quaternion:
    """Four numbers, scalar first (ABB, and tables of poses)."""

    names: tuple[str, ...] = ("q1", "q2", "q3", "q4")

    def problem(self, values: Sequence[float]) -> str | None:
        """What is wrong with the length of a quaternion; see `Orientation.problem`."""
        length = math.hypot(*values)
        if abs(length - 1.0) <= QUATERNION_TOLERANCE:
            return None
        return f"expected a unit quaternion, found one of length {length:.4g}"

    def matrix(self, values: ArrayLike) -> FloatArray:
        """Rotations of quaternions of any positive length, see `Orientation.matrix`."""
        rows = np.asarray(values, dtype=float).reshape(-1, 4)
        w, x, y, z = (rows / np.linalg.norm(rows, axis=1, keepdims=True)).T
        R = np.empty((len(rows), 3, 3))
        R[:, 0] = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
        R[:, 1] = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
        R[:, 2] = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
        return R

    def values(self, R: ArrayLike, near: ArrayLike) -> FloatArray:
        """Unit quaternions, see `Orientation.values`: of ``q`` and ``-q`` the nearer one."""
        quaternion = frames.quaternion_from_matrix(R)
        sign = (quaternion * np.asarray(near, dtype=float)).sum(axis=1)
        return np.asarray(quaternion * np.where(sign < 0, -1.0, 1.0)[:, None])


def _about(axis: str, angle: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) about one axis by n angles."""
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    R = np.zeros((len(angle), 3, 3))
    R[:, k, k] = 1.0
    R[:, i, i] = R[:, j, j] = np.cos(angle)
    R[:, j, i] = np.sin(angle)
    R[:, i, j] = -R[:, j, i]
    return R


def _other(i: int, j: int) -> int:
    return 3 - i - j


def _parity(i: int, j: int) -> float:
    """1 where axes i, j and the third are in turn, -1 else."""
    return 1.0 if (j - i) % 3 == 1 else -1.0


def _last_two(M: FloatArray, second: str, third: str) -> tuple[FloatArray, FloatArray]:
    """Angles of ``M = Rj(second) Rk(third)``."""
    j, k = "xyz".index(second), "xyz".index(third)
    i = _other(j, k)
    sign = _parity(i, j)
    return np.arctan2(sign * M[:, i, k], M[:, k, k]), np.arctan2(sign * M[:, j, i], M[:, j, j])


def _turned(values: FloatArray, old: FloatArray) -> FloatArray:
    """Angles within half a turn of zero; at the turn of the old one where that is beyond."""
    inside = values - _TURN * np.rint(values / _TURN)
    beyond = np.abs(old) > np.pi + 1e-9
    near = values + _TURN * np.rint((old - values) / _TURN)
    # 180 and -180 degrees are the same: the sign of the old one is kept
    edge = (np.abs(np.abs(inside) - np.pi) < 1e-9) & (np.abs(old - inside) > np.pi)
    return np.where(beyond, near, np.where(edge, -inside, inside))


def poses_from_numbers(numbers: ArrayLike) -> FloatArray:
    """Transforms (n, 4, 4), metres, of x, y, z in mm and a quaternion, scalar first, of any positive length (n, 7)."""
    rows = np.asarray(numbers, dtype=float).reshape(-1, 7)
    T = np.zeros((len(rows), 4, 4))
    T[:, :3, :3] = Quaternion().matrix(rows[:, 3:])
    T[:, :3, 3] = rows[:, :3] * MM
    T[:, 3, 3] = 1.0
    return T


def numbers_from_poses(T: ArrayLike, near: FloatArray | None = None) -> FloatArray:
    """Millimetres and unit quaternions (n, 7) of transforms (n, 4, 4); the inverse of `poses_from_numbers`.

    Parameters
    ----------
    T : ndarray, shape (n, 4, 4)
        Metres.
    near : ndarray, shape (n, 4), optional
        Quaternions, scalar first: of ``q`` and ``-q``, the one nearer to these is taken. Without, the scalar
        part is not negative.

    Raises
    ------
    ValueError
        If a transform is not rigid.
    """
    poses = np.asarray(T, dtype=float).reshape(-1, 4, 4)
    check_rigid(poses)
    identity = np.array([[1.0, 0.0, 0.0, 0.0]])
    return np.column_stack(
        [poses[:, :3, 3] / MM, Quaternion().values(poses[:, :3, :3], identity if near is None else near)]
    )


def check_rigid(T: FloatArray) -> None:
    """Refuse what is no rigid transform, shape (n, 4, 4).

    Raises
    ------
    ValueError
        If one is not.
    """
    R = T[:, :3, :3]
    rigid = np.isfinite(T).all() and np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0.0) < 1e-6
    if not rigid or (np.linalg.det(R) < 0).any() or (T[:, 3] != [0, 0, 0, 1]).any():
        raise ValueError("expected rigid transforms")


def number_text(value: float, decimals: int) -> str:
    """A number without exponent, without needless zeros and without a negative zero."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
