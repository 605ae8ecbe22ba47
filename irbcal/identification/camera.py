"""A camera: pinhole with Brown's distortion, in OpenCV's convention; where a flat board stands before it.

A lens is ``(fx, fy, cx, cy, k1, k2, p1, p2, k3)``. Camera axes: x to the right of the image, y down, z forward.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling import frames

NEAREST = 1e-3
"""Depth below which a point counts as that far in front of the camera, metres: images tell of nothing behind it."""

UNDISTORTED = 1e-13
"""Step of normalised coordinates below which a corner is undistorted."""


def project(lens: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where points in camera axes are in the image, with derivatives.

    Parameters
    ----------
    lens : ndarray, shape (9,)
    y : ndarray, shape (..., 3)
        Metres.

    Returns
    -------
    uv : ndarray, shape (..., 2)
        Pixels.
    by_point : ndarray, shape (..., 2, 3)
    by_lens : ndarray, shape (..., 2, 9)
    """
    z = np.maximum(y[..., 2], NEAREST)
    x, v = y[..., 0] / z, y[..., 1] / z
    there, J, by_distortion = _distorted(lens, x, v)
    focal = lens[:2]
    uv = focal * there + lens[2:4]
    by_point = np.empty((*x.shape, 2, 3))
    by_point[..., :2] = focal[:, None] * J / z[..., None, None]
    by_point[..., 2] = -(by_point[..., 0] * x[..., None] + by_point[..., 1] * v[..., None])
    by_lens = np.zeros((*x.shape, 2, 9))
    by_lens[..., 0, 0], by_lens[..., 1, 1] = there[..., 0], there[..., 1]
    by_lens[..., 0, 2] = by_lens[..., 1, 3] = 1.0
    by_lens[..., 4:] = focal[:, None] * by_distortion
    return uv, by_point, by_lens


def _distorted(lens: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normalised coordinates after distortion (..., 2), and derivatives by them (..., 2, 2) and k1 … k3 (..., 2, 5)."""
    k1, k2, p1, p2, k3 = lens[4:]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d r2, times 2
    there = np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )
    J = np.empty((*x.shape, 2, 2))
    J[..., 0, 0] = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    J[..., 0, 1] = J[..., 1, 0] = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    J[..., 1, 1] = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    by = np.stack(
        [
            np.stack([x * r2, x * r2 * r2, 2.0 * x * y, r2 + 2.0 * x * x, x * r2**3], axis=-1),
            np.stack([y * r2, y * r2 * r2, r2 + 2.0 * y * y, 2.0 * x * y, y * r2**3], axis=-1),
        ],
        axis=-2,
    )
    return there, J, by


def undistorted(lens: FloatArray, uv: FloatArray) -> FloatArray:
    """Normalised coordinates (..., 2) of places in the image, by Newton steps."""
    there = (uv - lens[2:4]) / lens[:2]
    x = there.copy()
    for _ in range(20):
        found, J, _ = _distorted(lens, x[..., 0], x[..., 1])
        e = there - found
        det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
        det = np.where(np.abs(det) < 1e-3, 1e-3, det)  # a lens that folds over is not followed
        step = np.stack(
            [
                (J[..., 1, 1] * e[..., 0] - J[..., 0, 1] * e[..., 1]) / det,
                (J[..., 0, 0] * e[..., 1] - J[..., 1, 0] * e[..., 0]) / det,
            ],
            axis=-1,
        )
        x = x + step
        if np.nanmax(np.abs(step), initial=0.0) < UNDISTORTED:
            break
    return np.asarray(x)


def boards(lens: FloatArray, corners: FloatArray) -> FloatArray:
    """Pose of a flat board in camera axes, image by image, from its homography (Zhang 2000).

    Parameters
    ----------
    lens : ndarray, shape (9,)
    corners : ndarray, shape (m, n, 5)
        See `irbcal.measurement.imaging.Images`; at least four corners an image.

    Returns
    -------
    ndarray, shape (m, 4, 4)
    """
    out = np.tile(np.eye(4), (len(corners), 1, 1))
    for k, image in enumerate(corners):
        image = image[np.isfinite(image[:, 2])]
        H = _homography(image[:, :2], undistorted(lens, image[:, 2:4]))
        H = H * (np.sign(H[2, 2] + H[2, :2] @ image[:, :2].mean(axis=0)) or 1.0)  # the board is in front
        scale = 0.5 * (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1]))
        a, b, t = H.T / scale
        out[k, :3, :3] = frames.nearest_rotation(np.column_stack([a, b, np.cross(a, b)]))
        out[k, :3, 3] = t
    return out


def _homography(xy: FloatArray, uv: FloatArray) -> FloatArray:
    """The homography (3, 3) from places on a plane to their images, by the direct linear transformation."""
    A, B = (_normaliser(one) for one in (xy, uv))
    p = xy @ A[:2, :2].T + A[:2, 2]
    q = uv @ B[:2, :2].T + B[:2, 2]
    one, none = np.ones((len(p), 1)), np.zeros((len(p), 3))
    h = np.hstack([p, one])
    rows = np.vstack([np.hstack([h, none, -q[:, :1] * h]), np.hstack([none, h, -q[:, 1:] * h])])
    H = np.linalg.svd(rows)[2][8].reshape(3, 3)
    return np.asarray(np.linalg.inv(B) @ H @ A)


def _normaliser(points: FloatArray) -> FloatArray:
    """Brings points (n, 2) about the origin, root mean square distance of a coordinate 1."""
    middle = points.mean(axis=0)
    s = 1.0 / max(float(np.sqrt(np.mean((points - middle) ** 2))), 1e-15)
    return np.array([[s, 0.0, -s * middle[0]], [0.0, s, -s * middle[1]], [0.0, 0.0, 1.0]])


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
    A = np.asarray(frames.nearest_rotation(A * (np.sign(np.linalg.det(A)) or 1.0)))
    return A, np.asarray(frames.nearest_rotation((R @ A @ D.transpose(0, 2, 1)).mean(axis=0)))
