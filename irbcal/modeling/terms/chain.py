r"""Kinematics with frame terms: every joint's frame makes a small motion before the joint turns.

::

    T(q) = T_base_0 . prod_i [ F_i . Trans(xi_t,i) . Exp(xi_r,i) . Rot_z(theta_i + q_i) . Trans_z(d_i) ] . T_last_tip

``F_i = Rot_x(alpha_i) Trans_x(a_i) Rot_y(beta_i) Trans_y(b_i)`` is the joint's frame in the DHM table; the constants of
the family geometry are errors of that table, so that ``xi`` holds frame terms only. ``q_i`` is the effective joint:
terms about the joint's own axis are in it. Batches of poses, no loop over them; all axes and points in the base link.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import cos, sin

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.cos_sin import cos_sin


@dataclass(frozen=True, eq=False)
class Walk:
    """Axes and origins along the chain."""

    x_before: FloatArray
    o_before: FloatArray
    """Shape (joints, 3, n). What ``alpha`` turns about and ``a`` moves along."""
    y_tilt: FloatArray
    o_tilt: FloatArray
    """Shape (joints, 3, n). What ``beta`` turns about and ``b`` moves along."""
    frame: FloatArray
    """Shape (joints, 3, 3, n). Axes of F_i: what the terms tx, ty, tz move along."""
    turns: FloatArray
    """Shape (joints, 3, 3, n). What the terms rx, ry, rz turn about: the frame's axes times the left Jacobian of
    ``Exp(xi_r)``.
    """
    moved: FloatArray
    """Shape (joints, 3, n). Origin of F_i after the frame's translation: what they turn about."""
    z: FloatArray
    o: FloatArray
    """Shape (joints, 3, n). Axis and origin of the joint itself."""
    tip: FloatArray
    """Shape (4, 3, n). x, y, z axes and origin of the tip."""

    def select(self, pose: IntArray) -> Walk:
        """The chain at some of the poses."""
        return Walk(*(getattr(self, part.name)[..., pose] for part in fields(self)))


def walk(arm: Arm, effective: FloatArray, xi: FloatArray | None = None) -> Walk:
    """Walk the chain.

    Parameters
    ----------
    arm : Arm
        Calibrated: its DHM table holds the constants.
    effective : ndarray, shape (n, joints)
        Effective joints, radians (metres for prismatic joints).
    xi : ndarray, shape (n, joints, 6), optional
        Small motions of the frames in the order of `irbcal.modeling.terms.term.AXES`, radians and metres.
    """
    table = arm.table
    n, joints = effective.shape
    store = {name: np.empty((joints, 3, n)) for name in ("x_before", "o_before", "y_tilt", "o_tilt", "moved", "z", "o")}
    frame, turns = np.empty((joints, 3, 3, n)), np.empty((joints, 3, 3, n))
    x, y, z, o = (np.repeat(arm.T_base_0[:3, k : k + 1], n, axis=1) for k in range(4))
    for i in range(joints):
        store["x_before"][i], store["o_before"][i] = x, o
        o = o + table.a[i] * x
        y, z = _turn(y, z, table.alpha[i])
        store["y_tilt"][i], store["o_tilt"][i] = y, o
        z, x = _turn(z, x, table.beta[i])
        o = o + table.b[i] * y
        frame[i] = x, y, z
        turns[i] = frame[i]
        if xi is not None:
            small = xi[:, i].T
            o = o + small[3] * x + small[4] * y + small[5] * z
            R, J = _exponential(small[:3])
            turns[i] = np.einsum("acn,abn->bcn", frame[i], J)
            x, y, z = np.einsum("acn,abn->bcn", frame[i], R)
        store["moved"][i] = o
        turned, travel = (0.0, effective[:, i]) if table.prismatic[i] else (effective[:, i], 0.0)
        x, y = _turn(x, y, table.theta[i] + turned)
        o = o + (table.d[i] + travel) * z
        store["z"][i], store["o"][i] = z, o
    R, p = arm.T_last_tip[:3, :3], arm.T_last_tip[:3, 3]
    axes = np.stack([x, y, z])
    tip = np.concatenate([np.einsum("acn,ab->bcn", axes, R), [o + np.einsum("acn,a->cn", axes, p)]])
    return Walk(frame=frame, turns=turns, tip=tip, **store)


def _turn(first: FloatArray, second: FloatArray, angle: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Axes (first, second) turned towards one another."""
    c, s = (cos(angle), sin(angle)) if isinstance(angle, float) else cos_sin(angle)
    return c * first + s * second, c * second - s * first


def _exponential(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations of rotation vectors (3, n) and their left Jacobians, both of shape (3, 3, n)."""
    x, y, z = vector
    zero = np.zeros_like(x)
    K = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    K2 = np.einsum("abn,bcn->acn", K, K)
    angle = np.sqrt(x * x + y * y + z * z)
    first = np.sinc(angle / np.pi)  # sin(angle) / angle
    half = np.sinc(angle / (2 * np.pi))
    second = 0.5 * half * half  # (1 - cos(angle)) / angle^2
    with np.errstate(invalid="ignore", divide="ignore"):
        third = np.where(angle < 1e-2, 1 / 6 - angle**2 / 120, (1.0 - first) / angle**2)
    eye = np.eye(3)[:, :, None]
    return eye + first * K + second * K2, eye + second * K + third * K2


def poses(path: Walk) -> FloatArray:
    """Tip poses in the base link, shape (n, 4, 4)."""
    out = np.zeros((path.tip.shape[-1], 4, 4))
    out[:, :3] = path.tip.transpose(2, 1, 0)
    out[:, 3, 3] = 1.0
    return out


def derivative(path: dhm.ChainFrames | Walk, k: int, p: FloatArray | None = None, constant: bool = False) -> FloatArray:
    """Derivative of points of the tool by motion number k of `irbcal.modeling.terms.term.AXES` of each joint's frame.

    Parameters
    ----------
    path : ChainFrames or Walk
        At n poses.
    k : int
    p : ndarray, shape (3, n) or (3, t, n), optional
        Points in the base link, metres. Without: by the tip's rotation vector.
    constant : bool
        By the constants of the geometry, which are errors of the DHM table, in place of the terms.

    Returns
    -------
    ndarray, shape (joints, 3, n) or (joints, 3, t, n)
        Metres or radians, per radian or metre; of a shift t is 1.
    """
    axis, origin = axis_and_origin(path, k, constant)
    if p is None:
        return axis if k < 3 else np.zeros_like(axis)
    shape = (*axis.shape[:2], *(1,) * (p.ndim - 2), axis.shape[2])
    axis = axis.reshape(shape)
    if k >= 3:
        return axis
    arm = p - origin.reshape(shape)
    out = np.empty_like(arm)
    for i in range(3):  # their cross product, which numpy's function takes long to prepare
        np.multiply(axis[:, i - 2], arm[:, i - 1], out=out[:, i])
        out[:, i] -= axis[:, i - 1] * arm[:, i - 2]
    return out


def by_joints(path: dhm.ChainFrames | Walk, arm: Arm, p: FloatArray | None = None) -> FloatArray:
    """Derivative of points (3, n), or of the tip's rotation vector, by the effective joints, shape (joints, 3, n)."""
    slides = arm.table.prismatic[:, None, None]
    return np.where(slides, derivative(path, 5, p, True), derivative(path, 2, p, True))


def axis_and_origin(path: dhm.ChainFrames | Walk, k: int, constant: bool) -> tuple[FloatArray, FloatArray]:
    """Axis and origin of motion number k of each joint's frame, each of shape (joints, 3, n)."""
    if constant or not isinstance(path, Walk):
        pairs = ((path.x_before, path.o_before), (path.y_tilt, path.o_tilt), (path.z, path.o))
        return pairs[k % 3]
    return (path.turns[:, k], path.moved) if k < 3 else (path.frame[:, k - 3], path.moved)
