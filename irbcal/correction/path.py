"""Paths: straight lines and circles of tool poses, and how far points are from them (Nubiola 2011, annex VI)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError


@dataclass(frozen=True, eq=False)
class Line:
    """Straight move between two poses; orientation turns evenly about one axis.

    Parameters
    ----------
    T_start, T_end : ndarray, shape (4, 4)
        Poses in the base link, metres.
    """

    T_start: FloatArray
    T_end: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def length(self) -> float:
        """Length of the path of the origin, metres."""
        return float(np.linalg.norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    def poses(self, s: ArrayLike) -> FloatArray:
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        part = np.asarray(s, dtype=float)
        T = _turned(self.T_start, self.T_end, part)
        T[:, :3, 3] = self.T_start[:3, 3] + part[:, None] * (self.T_end[:3, 3] - self.T_start[:3, 3])
        return T


@dataclass(frozen=True, eq=False)
class Circle:
    """Move along a circular arc; orientation turns evenly about one axis.

    Parameters
    ----------
    T_start, T_end : ndarray, shape (4, 4)
        Poses in the base link, metres.
    center, normal : ndarray, shape (3,)
        Of the circle, in the base link; the move turns by ``angle`` about the normal.
    angle : float
        Radians.
    """

    T_start: FloatArray
    T_end: FloatArray
    center: FloatArray
    normal: FloatArray
    angle: float

    def __post_init__(self) -> None:
        lock(self)

    @staticmethod
    def through(T_start: FloatArray, p_via: ArrayLike, T_end: FloatArray) -> Circle:
        """Arc from one pose to another through a point, as MoveC defines it.

        Raises
        ------
        RobotError
            If the three points lie on a line.
        """
        p_1, p_2, p_3 = T_start[:3, 3], np.asarray(p_via, dtype=float), T_end[:3, 3]
        a, b = p_2 - p_1, p_3 - p_1
        normal = np.cross(a, b)
        if np.linalg.norm(normal) <= 1e-9 * np.linalg.norm(a) * max(float(np.linalg.norm(b)), 1e-12):
            raise RobotError("a circular move needs three points that do not lie on a line")
        center = p_1 + np.cross(b @ b * a - a @ a * b, normal) * -1.0 / (2 * normal @ normal)
        normal = normal / np.linalg.norm(normal)
        u, v = p_1 - center, p_3 - center
        angle = np.arctan2(normal @ np.cross(u, v), u @ v) % (2 * np.pi)
        return Circle(T_start, T_end, center, normal, float(angle))

    @staticmethod
    def full(T_start: FloatArray, center: ArrayLike, normal: ArrayLike) -> Circle:
        """A whole turn from a pose about a centre, with constant orientation.

        Such are the circles of Nubiola 2011, annex VI, Figures A VI-3, A VI-6 and A VI-9.
        """
        axis = np.asarray(normal, dtype=float)
        return Circle(T_start, T_start, np.asarray(center, dtype=float), axis / np.linalg.norm(axis), 2 * np.pi)

    @property
    def length(self) -> float:
        """Length of the arc, metres."""
        return float(abs(self.angle) * np.linalg.norm(self.T_start[:3, 3] - self.center))

    def poses(self, s: ArrayLike) -> FloatArray:
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        part = np.asarray(s, dtype=float)
        T = _turned(self.T_start, self.T_end, part)
        u = self.T_start[:3, 3] - self.center
        v = np.cross(self.normal, u)
        angle = part[:, None] * self.angle
        T[:, :3, 3] = self.center + np.cos(angle) * u + np.sin(angle) * v
        return T


def _turned(T_start: FloatArray, T_end: FloatArray, s: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(T_start[:3, :3].T @ T_end[:3, :3]).as_rotvec()
    T = np.zeros((len(s), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, :3] = T_start[:3, :3] @ Rotation.from_rotvec(s[:, None] * vector).as_matrix()
    return T


ToolPath: TypeAlias = Line | Circle
"""What a linear or circular move asks for."""


def distance_to_path(path: ToolPath, points: ArrayLike) -> FloatArray:
    """Distance of points from a path, metres, shape (n,).

    Straight lines are exact; circles are taken as they are, arcs at their ends included.
    """
    at = np.atleast_2d(np.asarray(points, dtype=float))
    if isinstance(path, Line):
        p, along = path.T_start[:3, 3], path.T_end[:3, 3] - path.T_start[:3, 3]
        t = np.clip((at - p) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
        return np.linalg.norm(at - p - t[:, None] * along, axis=1)
    u = path.T_start[:3, 3] - path.center
    v = np.cross(path.normal, u)
    radius = np.linalg.norm(u)
    rel = at - path.center
    turned = np.arctan2(rel @ v, rel @ u) % (2 * np.pi)
    in_plane = np.hypot(rel @ u, rel @ v) / radius
    on_arc = np.hypot(in_plane - radius, rel @ path.normal)
    ends = np.minimum(np.linalg.norm(at - path.T_start[:3, 3], axis=1), np.linalg.norm(at - path.T_end[:3, 3], axis=1))
    return np.where(turned <= path.angle, on_arc, ends)
