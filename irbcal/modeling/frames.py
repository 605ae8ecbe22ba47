r"""Rigid transforms.

``T_a_b`` maps coordinates in frame ``b`` to coordinates in frame ``a``, so subscripts cancel::

    T_a_c = T_a_b @ T_b_c          p_a = T_a_b[:3, :3] @ p_b + T_a_b[:3, 3]

Everything is in metres and radians and takes batches in the leading axes.
"""

import numpy as np


def rot_x(angle):
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


def rot_y(angle):
    """Rotation matrix about y, shape (3, 3); angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rot_z(angle):
    """Rotation matrix about z, shape (3, 3); angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def transform(rotation=None, translation=None):
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


def inverse(T):
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


def apply(T, points):
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


def from_xyz_angles(values):
    """Transform from the six parameters x, y, z, alpha, beta, gamma (Nubiola 2011, eq. 3.5).

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


def to_xyz_angles(T):
    """Six parameters x, y, z, alpha, beta, gamma of a transform (Nubiola 2011, eqs. 3.7 to 3.9).

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
    rest = rot_x(-alpha) @ R
    gamma = np.arctan2(rest[1, 0], rest[1, 1])
    beta = np.arctan2(R[0, 2], rest[2, 2])
    return np.array([*T[:3, 3], alpha, beta, gamma])


def from_three_points(p_1, p_2, p_3):
    """Frame from three measured points (Nubiola 2011, eqs. 3.13 to 3.19).

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
    p_1, p_2, p_3 = (np.asarray(p, dtype=float) for p in (p_1, p_2, p_3))
    v_2, v_3 = p_2 - p_1, p_3 - p_1
    normal = np.cross(v_2, v_3)
    if np.linalg.norm(normal) <= 1e-6 * np.linalg.norm(v_2) * max(np.linalg.norm(v_3), 1e-12):
        raise ValueError("three points on a line do not make a frame")
    x = v_2 / np.linalg.norm(v_2)
    z = normal / np.linalg.norm(normal)
    origin = p_1 + (v_2 @ v_3) / (v_2 @ v_2) * v_2
    return transform(np.column_stack([x, np.cross(z, x), z]), origin)


def rpy_from_matrix(R):
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
    rest = rot_z(-yaw) @ R
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])


def matrix_from_rpy(rpy):
    """Rotation matrix (3, 3) from URDF roll, pitch, yaw in radians."""
    roll, pitch, yaw = np.asarray(rpy, dtype=float)
    return rot_z(yaw) @ rot_y(pitch) @ rot_x(roll)


def rotation_from_vector(vector):
    """Rotation matrix (3, 3) of a rotation vector (3,) in radians (Rodrigues)."""
    x, y, z = vector
    angle = np.sqrt(x * x + y * y + z * z)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    half = np.sinc(angle / (2 * np.pi))  # sin(angle/2) / (angle/2)
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half * half * (K @ K)


def rotation_distance(R_1, R_2):
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


def nearest_rotation(M):
    """Rotation nearest to a matrix in the Frobenius norm.

    Parameters
    ----------
    M : ndarray, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    U, _, Vt = np.linalg.svd(M)
    sign = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def rigid_fit(points_b, points_a):
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
