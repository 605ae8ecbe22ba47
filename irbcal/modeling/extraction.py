"""From joint axes to a DHM table: what reading a URDF and measuring a robot's axes have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling import dhm, frames

NEARLY_PARALLEL = np.sin(np.radians(5.0))
"""Sine of the angle below which two axes get Hayati's form instead of a far-away common normal.

It is the tolerance of Nubiola 2011, section 3.1.3.
"""


def dhm_from_axes(
    points: FloatArray,
    axes: FloatArray,
    T_base_tip: FloatArray,
    prismatic: Sequence[bool] | BoolArray | None = None,
) -> tuple[dhm.DHMTable, FloatArray, FloatArray]:
    """DHM table of joint axes and a tip frame at zero joints (Nubiola 2011, section 3.1.2, Figures 3.2 and 5.1).

    The x axis of each frame runs along the common normal to the next axis; where the axes intersect, its
    sign is the one nearer to the previous x axis. Nearly parallel axes get Hayati's form: the next axis is
    met where it pierces the plane normal to this one, so that no frame is thrown far away.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        A point on each axis, in the base link, metres; any point will do for a prismatic joint.
    axes : ndarray, shape (n, 3)
        Unit direction of each axis.
    T_base_tip : ndarray, shape (4, 4)
    prismatic : sequence of bool, optional
        Which joints slide; none unless given.

    Returns
    -------
    table : DHMTable
    T_base_0, T_last_tip : ndarray, shape (4, 4)
    """
    n = len(axes)
    z, across = axes[0], np.array([1.0, 0.0, 0.0])
    if abs(z @ across) > 0.9:
        across = np.array([0.0, 1.0, 0.0])
    x = _unit(across - z * (z @ across))
    entry = points[0] - z * (z @ points[0])  # where the chain arrives on this axis
    T_base_0 = frames.transform(np.column_stack([x, frames.cross(z, x), z]), entry)
    alpha, a, theta, d, beta = (np.zeros(n) for _ in range(5))
    for i in range(n):
        z = axes[i]
        if i < n - 1:
            origin, next_entry, next_x = _common_normal(entry, z, points[i + 1], axes[i + 1], x)
        else:
            origin, next_x = _last_frame(entry, z, x, T_base_tip)
        d[i] = z @ (origin - entry)
        theta[i] = np.arctan2(z @ frames.cross(x, next_x), x @ next_x)
        if i < n - 1:
            x = next_x
            a[i + 1] = x @ (next_entry - origin)
            ahead = np.array([x, frames.cross(z, x), z]) @ axes[i + 1]  # next axis seen in this frame
            if np.linalg.norm(frames.cross(z, axes[i + 1])) < NEARLY_PARALLEL:
                beta[i + 1] = np.arcsin(ahead[0])
                x = _carried_x(next_x, z, axes[i + 1], beta[i + 1])
            alpha[i + 1] = np.arctan2(-ahead[1], ahead[2])
            entry = next_entry
    T_base_last = frames.transform(np.column_stack([next_x, frames.cross(axes[-1], next_x), axes[-1]]), origin)
    for column in (alpha, a, theta, d, beta):
        column[np.abs(column) < 1e-14] = 0.0
    T_last_tip = frames.inverse(T_base_last) @ T_base_tip
    if np.abs(T_last_tip - np.eye(4)).max() < 1e-12:
        T_last_tip = np.eye(4)
    slides = np.zeros(n, dtype=bool) if prismatic is None else np.array(prismatic, dtype=bool)
    return dhm.DHMTable(alpha, a, theta, d, beta, prismatic=slides), T_base_0, T_last_tip


def _unit(v: FloatArray) -> FloatArray:
    return v / np.linalg.norm(v)


def _carried_x(x: FloatArray, z: FloatArray, z_next: FloatArray, beta: float) -> FloatArray:
    """The x axis after Hayati's tilt: Rot(x, alpha) Rot(y, beta) applied to x."""
    # z_next = sin(beta) x + cos(beta) w with w the tilted z before beta, and x' = cos(beta) x - sin(beta) w
    w = (z_next - np.sin(beta) * x) / np.cos(beta)
    return np.cos(beta) * x - np.sin(beta) * w


def _common_normal(
    entry: FloatArray, z: FloatArray, next_point: FloatArray, z_next: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Origin on this axis, entry point on the next one, and the x axis between them."""
    cross = frames.cross(z, z_next)
    sine = np.linalg.norm(cross)
    if sine < NEARLY_PARALLEL:
        origin = entry
        next_entry = next_point + z_next * (z @ (origin - next_point)) / (z @ z_next)
        along = next_entry - origin
        return origin, next_entry, _unit(along) if np.linalg.norm(along) > 1e-9 else x
    gap = next_point - entry
    origin = entry + z * (frames.cross(gap, z_next) @ cross) / sine**2
    next_entry = next_point + z_next * (frames.cross(gap, z) @ cross) / sine**2
    length = (next_entry - origin) @ cross / sine
    direction = cross / sine
    if abs(length) > 1e-9:
        return origin, next_entry, direction * np.sign(length)
    near = direction @ x
    return origin, next_entry, direction if near > -1e-9 else -direction


def _last_frame(
    entry: FloatArray, z: FloatArray, x: FloatArray, T_base_tip: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Last frame: the tip itself where its z axis lies on the last axis, else the foot of the tip's origin on it."""
    tip = T_base_tip[:3, 3]
    origin = entry + z * (z @ (tip - entry))
    if np.linalg.norm(T_base_tip[:3, 2] - z) < 1e-9 and np.linalg.norm(tip - origin) < 1e-9:
        tip_x = T_base_tip[:3, 0]
        return tip, _unit(tip_x - z * (z @ tip_x))
    return origin, x
