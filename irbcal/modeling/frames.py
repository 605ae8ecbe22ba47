r"""Rigid transforms, and the names of frames in this project.

``T_a_b`` is the place of frame ``b`` in frame ``a``: it maps coordinates in ``b`` to coordinates in ``a``, so that
neighbouring subscripts cancel::

         world ---------------- T_world_base ---------------> base
           |                                                   |
      T_world_target                                       T_base_tip        (joints move the tip in the base)
           |                                                   |
           v                                                   v
         target <--------------- T_tip_target --------------- tip

    T_world_target = T_world_base @ T_base_tip @ T_tip_target
    T_b_a          = inverse(T_a_b)
    p_a            = T_a_b[:3, :3] @ p_b + T_a_b[:3, 3]

``world`` is the frame of the measurements, ``base`` and ``tip`` are links of the URDF (``0`` and ``last`` the first and
the last frame of the DHM chain between them), ``target`` is a reflector on the tool. Rotations are ``R_a_b`` or ``R``,
quaternions have the scalar first (w, x, y, z), metres and radians everywhere. Functions take batches in the leading
axes where their docstrings say so.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray

LEVER = 0.3
"""Metres per radian: a turn counts as the motion of a point this far away."""


def rot_x(angle: float) -> FloatArray:
    """Rotation matrix about x.

    Parameters
    ----------
    angle : float
        Angle in radians.

    Returns
    -------
    ndarray, shape (3, 3)
    """
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rot_y(angle: float) -> FloatArray:
    """Rotation matrix about y, shape (3, 3); angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rot_z(angle: float) -> FloatArray:
    """Rotation matrix about z, shape (3, 3); angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def wrapped(angle: ArrayLike) -> FloatArray:
    """Angles in (-pi, pi] that differ by whole turns, radians."""
    return np.asarray(np.pi - np.mod(np.pi - np.asarray(angle), 2 * np.pi))


def transform(rotation: ArrayLike | None = None, translation: ArrayLike | None = None) -> FloatArray:
    """Homogeneous transform from a rotation (3, 3) and a translation (3,) in metres.

    Returns
    -------
    ndarray, shape (4, 4)
    """
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def inverse(T: ArrayLike) -> FloatArray:
    """Inverse of rigid transforms.

    Parameters
    ----------
    T : ndarray, shape (..., 4, 4)

    Returns
    -------
    ndarray, shape (..., 4, 4)
    """
    T = np.asarray(T, dtype=float)
    out = np.zeros_like(T)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def apply(T: FloatArray, points: FloatArray) -> FloatArray:
    """Map points through one transform.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
    points : ndarray, shape (n, 3)
        Metres.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    return points @ T[:3, :3].T + T[:3, 3]


def from_xyz_angles(values: ArrayLike) -> FloatArray:
    """Transform from the six parameters x, y, z, alpha, beta, gamma (Nubiola 2011, section 3.1.5, eqs. 3.5 and 3.6).

    ``Trans(x, y, z) Rot(x, alpha) Rot(y, beta) Rot(z, gamma)``.

    Parameters
    ----------
    values : array_like, shape (6,)
        Metres and radians.

    Returns
    -------
    ndarray, shape (4, 4)
    """
    x, y, z, alpha, beta, gamma = np.asarray(values, dtype=float)
    return transform(rot_x(alpha) @ rot_y(beta) @ rot_z(gamma), [x, y, z])


def to_xyz_angles(T: FloatArray) -> FloatArray:
    """Six parameters x, y, z, alpha, beta, gamma of a transform (Nubiola 2011, eqs. 3.7, 3.8 and 3.9).

    The cosine of beta is taken positive: ``cos(beta) = +sqrt(1 - A_13^2)``. At ``beta = +-90`` degrees,
    where alpha and gamma turn about the same line, gamma carries the whole turn and alpha is zero.

    Parameters
    ----------
    T : ndarray, shape (4, 4)

    Returns
    -------
    ndarray, shape (6,)
        Metres and radians.
    """
    R = T[:3, :3]
    cos_beta = np.hypot(R[0, 0], R[0, 1])
    alpha = np.arctan2(-R[1, 2], R[2, 2]) if cos_beta > 1e-12 else 0.0
    # with alpha undone the remaining rotation is Rot(y) Rot(z): its middle row gives gamma without division
    R_rest = rot_x(-alpha) @ R
    gamma = np.arctan2(R_rest[1, 0], R_rest[1, 1])
    beta = np.arctan2(R[0, 2], R_rest[2, 2])
    return np.array([*T[:3, 3], alpha, beta, gamma])


def angles_derivative(R: FloatArray, outside: bool = False) -> FloatArray:
    """Derivative of the three angles of `to_xyz_angles` by a small turn, by central differences.

    Parameters
    ----------
    R : ndarray, shape (3, 3)
    outside : bool
        The turn is a rotation vector in the outer frame, ``exp(v) R``; otherwise in the inner one, ``R exp(v)``.

    Returns
    -------
    ndarray, shape (3, 3)
    """
    step = 1e-6

    def angles(v: FloatArray) -> FloatArray:
        turn = rotation_from_vector(v)
        return to_xyz_angles(transform(turn @ R if outside else R @ turn))[3:]

    pairs = [(angles(v), angles(-v)) for v in step * np.eye(3)]
    return np.array([wrapped(plus - minus) for plus, minus in pairs]).T / (2 * step)


def from_three_points(p_1: ArrayLike, p_2: ArrayLike, p_3: ArrayLike) -> FloatArray:
    """Frame from three measured points (Nubiola 2011, section 3.3, Figure 3.4).

    Its axes are those of eqs. 3.13, 3.14, 3.15, 3.16 and 3.17, its origin that of eqs. 3.18 and 3.19.

    Parameters
    ----------
    p_1, p_2 : array_like, shape (3,)
        Points on the x axis, the second one further along it; metres.
    p_3 : array_like, shape (3,)
        A point on the positive y axis: the origin is its foot on the x axis.

    Returns
    -------
    ndarray, shape (4, 4)
        The frame in the points' coordinates.

    Raises
    ------
    ValueError
        If the points lie on a line.
    """
    first, second, third = (np.asarray(p, dtype=float) for p in (p_1, p_2, p_3))
    v_2, v_3 = second - first, third - first
    normal = cross(v_2, v_3)
    if np.linalg.norm(normal) <= 1e-6 * np.linalg.norm(v_2) * np.maximum(np.linalg.norm(v_3), 1e-12):
        raise ValueError("three points on a line do not make a frame")
    x = v_2 / np.linalg.norm(v_2)
    z = normal / np.linalg.norm(normal)
    origin = first + (v_2 @ v_3) / (v_2 @ v_2) * v_2
    return transform(np.column_stack([x, cross(z, x), z]), origin)


def rpy_from_matrix(R: FloatArray) -> FloatArray:
    """URDF roll, pitch, yaw (``R = Rz(yaw) Ry(pitch) Rx(roll)``), exact through the gimbal lock.

    Yaw is taken first; roll then comes from the rotation with that yaw undone, so that whatever yaw is
    at ``pitch = +-90`` degrees, the three angles together give ``R`` back to rounding.

    Parameters
    ----------
    R : ndarray, shape (3, 3)

    Returns
    -------
    ndarray, shape (3,)
        Radians.
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    R_rest = rot_z(-yaw) @ R
    return np.array([np.arctan2(-R_rest[1, 2], R_rest[1, 1]), np.arctan2(-R_rest[2, 0], R_rest[0, 0]), yaw])


def matrix_from_rpy(rpy: ArrayLike) -> FloatArray:
    """Rotation matrix (3, 3) from URDF roll, pitch, yaw in radians."""
    roll, pitch, yaw = np.asarray(rpy, dtype=float)
    return rot_z(yaw) @ rot_y(pitch) @ rot_x(roll)


def quaternion_from_matrix(R: ArrayLike) -> FloatArray:
    """Unit quaternions of rotation matrices.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 4)
        w, x, y, z: the scalar first, and its first number that is not zero positive. NaN where a matrix is not finite.
    """
    R = np.asarray(R, dtype=float)
    finite = np.isfinite(R).all(axis=(-2, -1))[..., None]
    R = np.where(finite[..., None], R, np.eye(3))
    xx, yy, zz = (R[..., k, k] for k in range(3))
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, xz, yz = R[..., 1, 0] + R[..., 0, 1], R[..., 0, 2] + R[..., 2, 0], R[..., 2, 1] + R[..., 1, 2]
    # 4 q q^T: each row is the quaternion times one of its numbers, of which the largest is best
    rows = np.array(
        [
            [1.0 + xx + yy + zz, wx, wy, wz],
            [wx, 1.0 + xx - yy - zz, xy, xz],
            [wy, xy, 1.0 - xx + yy - zz, yz],
            [wz, xz, yz, 1.0 - xx - yy + zz],
        ]
    )
    rows = np.moveaxis(rows, (0, 1), (-2, -1))
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    first = np.take_along_axis(q, np.argmax(q != 0.0, axis=-1)[..., None], axis=-1)
    q = np.where(first < 0.0, -q, q) + 0.0
    return np.where(finite, q, np.nan)


def matrix_from_quaternion(q: ArrayLike) -> FloatArray:
    """Rotation matrices of quaternions.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        w, x, y, z: the scalar first; of any length but zero, they are brought to length one.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        NaN where a quaternion is not finite.

    Raises
    ------
    ValueError
        If a quaternion has length zero.
    """
    q = np.asarray(q, dtype=float)
    finite = np.isfinite(q).all(axis=-1)[..., None]
    q = np.where(finite, q, 1.0)
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    if (length == 0.0).any():
        raise ValueError("a quaternion of length zero is no rotation")
    w, x, y, z = np.moveaxis(q / length, -1, 0)
    rows = np.array(
        [
            [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
    return np.where(finite[..., None], np.moveaxis(rows, (0, 1), (-2, -1)), np.nan)


def rotation_from_vector(vector: ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues)."""
    v = np.asarray(vector, dtype=float)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    K = cross_matrix(v)
    angle = np.sqrt(x * x + y * y + z * z)[..., None, None]
    half = np.sinc(angle / (2 * np.pi))  # sin(angle/2) / (angle/2)
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half * half * (K @ K)


def rotation_from_one(vector: ArrayLike) -> FloatArray:
    """As `rotation_from_vector`, to rounding, of one vector (3,): in a fifth of the time."""
    x, y, z = np.asarray(vector, dtype=float).tolist()
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    along = math.sin(angle) / angle if angle > 0.0 else 1.0
    half = math.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + along * K + 0.5 * half * half * (K @ K))


def cross_matrix(v: FloatArray) -> FloatArray:
    """Matrices (..., 3, 3) of vectors (..., 3) with ``cross_matrix(v) w = v x w``."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def by_motion(p: FloatArray) -> FloatArray:
    """Derivatives (3 m, 6) of points (m, 3) by a turn and a shift of all of them together."""
    return np.concatenate([-cross_matrix(p), np.broadcast_to(np.eye(3), (len(p), 3, 3))], axis=2).reshape(-1, 6)


def cross(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Vector products (..., 3) of vectors (..., 3), as `numpy.cross`: of two vectors alone in a tenth of its time."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.ndim == b.ndim == 1:
        (x, y, z), (u, v, w) = a.tolist(), b.tolist()
        return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
    p, q, r = a[..., 0], a[..., 1], a[..., 2]
    s, t, e = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([q * e - r * t, r * s - p * e, p * t - q * s], axis=-1)


def with_third(axis: FloatArray) -> FloatArray:
    """A rotation whose third column is a unit vector."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    x = cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(axis, x), axis])


def vector_from_rotation(R: ArrayLike) -> FloatArray:
    """Rotation vectors (..., 3), radians, of rotation matrices (..., 3, 3): the inverse of `rotation_from_vector`.

    Angles are between 0 and pi.
    """
    q = quaternion_from_matrix(R)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0) * q[..., 1:]


def rotation_distance(R_1: ArrayLike, R_2: ArrayLike) -> FloatArray:
    """Angle of the relative rotation, accurate down to rounding.

    Parameters
    ----------
    R_1, R_2 : ndarray, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (...)
        Radians, from ``|R_1 - R_2|_F = 2 sqrt(2) sin(angle / 2)``.
    """
    chord = np.linalg.norm(np.asarray(R_1) - np.asarray(R_2), axis=(-2, -1))
    return 2.0 * np.arcsin(np.clip(chord / np.sqrt(8.0), 0.0, 1.0))


def nearest_rotation(M: ArrayLike) -> FloatArray:
    """Rotation nearest to a matrix in the Frobenius norm.

    Parameters
    ----------
    M : ndarray, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    U, _, Vt = np.linalg.svd(np.asarray(M, dtype=float))
    sign = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def hand_eye(R: FloatArray, D: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Rotations A and F with ``R_i A = F D_i`` (Shah 2013, by the Kronecker product); None where they are open.

    Parameters
    ----------
    R, D : ndarray, shape (m, 3, 3)

    Returns
    -------
    (A, F) or None
        None where all turns are about one axis.
    """
    K = np.einsum("mij,mkl->ikjl", D, R).reshape(9, 9)  # sum of kron(D_i, R_i): (D (x) R) vec A = vec F
    _, s, Vt = np.linalg.svd(K)
    if len(R) < 3 or s[0] - s[1] < 1e-6 * s[0]:
        return None
    A = Vt[0].reshape(3, 3).T  # vec stacks columns
    A = nearest_rotation(A * (np.sign(np.linalg.det(A)) or 1.0))
    return A, nearest_rotation((R @ A @ D.transpose(0, 2, 1)).mean(axis=0))


def rigid_fit(points_b: FloatArray, points_a: FloatArray) -> FloatArray:
    """Least-squares transforms that map points in ``b`` onto points in ``a`` (Kabsch).

    Parameters
    ----------
    points_b : ndarray, shape (..., k, 3)
    points_a : ndarray, shape (..., k, 3)
        Metres; at least three points, not on a line.

    Returns
    -------
    ndarray, shape (..., 4, 4)
        ``T_a_b``.
    """
    mean_b = points_b.mean(axis=-2, keepdims=True)
    mean_a = points_a.mean(axis=-2, keepdims=True)
    cross = np.swapaxes(points_a - mean_a, -1, -2) @ (points_b - mean_b)
    R = nearest_rotation(cross)
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = mean_a[..., 0, :] - np.einsum("...ij,...j->...i", R, mean_b[..., 0, :])
    T[..., 3, 3] = 1.0
    return T
