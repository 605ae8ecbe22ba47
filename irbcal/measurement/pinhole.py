"""A camera: pinhole with Brown's distortion, in OpenCV's convention; where a board stands before it.

A lens is ``(fx, fy, cx, cy, k1, k2, p1, p2, k3)``. Camera axes: x to the right of the image, y down, z forward.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, rms
from irbcal.modeling import frames

NEAREST = 1e-3
"""Depth below which a point counts as that far in front of the camera, metres: images tell of nothing behind it."""

FLAT = 0.02
"""Share of their spread across their plane, below which corners are in one."""

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
    xy = y[..., :2] / z[..., None]
    x, v = xy[..., 0], xy[..., 1]
    distorted, J = _distorted(lens, x, v)
    focal, r2 = lens[:2], x * x + v * v
    uv = focal * distorted + lens[2:4]
    by_point = np.empty((*x.shape, 2, 3))
    by_point[..., :2] = focal[:, None] * J / z[..., None, None]
    by_point[..., 2] = -(by_point[..., 0] * x[..., None] + by_point[..., 1] * v[..., None])
    by_lens = np.zeros((*x.shape, 2, 9))
    by_lens[..., 0, 0], by_lens[..., 1, 1] = distorted[..., 0], distorted[..., 1]
    by_lens[..., 0, 2] = by_lens[..., 1, 3] = 1.0
    by_lens[..., 4], by_lens[..., 5], by_lens[..., 8] = (xy * power[..., None] for power in (r2, r2 * r2, r2**3))
    by_lens[..., 0, 6] = by_lens[..., 1, 7] = 2.0 * x * v
    by_lens[..., 1, 6], by_lens[..., 0, 7] = r2 + 2.0 * v * v, r2 + 2.0 * x * x
    by_lens[..., 4:] *= focal[:, None]
    return uv, by_point, by_lens


def _distorted(lens: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normalised coordinates after distortion (..., 2), and derivatives by those before (..., 2, 2)."""
    k1, k2, p1, p2, k3 = lens[4:]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d r2, times 2
    distorted = np.stack(
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
    return distorted, J


def undistorted(lens: FloatArray, uv: FloatArray) -> FloatArray:
    """Normalised coordinates (..., 2) of places in the image, by Newton steps."""
    target = (uv - lens[2:4]) / lens[:2]
    x = target.copy()
    for _ in range(20):
        distorted, J = _distorted(lens, x[..., 0], x[..., 1])
        e = target - distorted
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
    """Pose of a board in camera axes, image by image, from its homography (Zhang 2000).

    Of a body whose corners are not in one plane from the direct linear transformation, of which six tell.

    Parameters
    ----------
    lens : ndarray, shape (9,)
    corners : ndarray, shape (m, n, 5 or 6)
        See `irbcal.measurement.imaging.Images`; at least four corners an image.

    Returns
    -------
    ndarray, shape (m, 4, 4)
    """
    out, rays = np.tile(np.eye(4), (len(corners), 1, 1)), undistorted(lens, corners[..., 2:4])
    for k, image in enumerate(corners):
        measured = np.isfinite(image[:, 2])
        xyz, uv = camera_positions(image[measured]), rays[k, measured]
        middle, T_plane = xyz.mean(axis=0), np.eye(4)
        if xyz[:, 2].any():
            _, spread, V = np.linalg.svd(xyz - middle)
            if spread[2] > FLAT * spread[0] and len(xyz) >= 6:
                out[k] = _resection(xyz, uv)
                continue
            T_plane = frames.transform(np.column_stack([V[0], V[1], frames.cross(V[0], V[1])]), middle)
            xyz = (xyz - middle) @ T_plane[:3, :3]
        H = _homography(xyz[:, :2], uv)
        H = H * (np.sign(H[2, 2] + H[2, :2] @ xyz[:, :2].mean(axis=0)) or 1.0)  # the board is in front
        scale = 0.5 * (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1]))
        a, b, t = H.T / scale
        T = frames.transform(frames.nearest_rotation(np.column_stack([a, b, frames.cross(a, b)])), t)
        out[k] = T @ frames.inverse(T_plane)
    return out


def camera_positions(corners: FloatArray) -> FloatArray:
    """Where corners (..., 5 or 6) are in the axes of their board or body, (..., 3), metres."""
    z = corners[..., 5:] if corners.shape[-1] > 5 else np.zeros((*corners.shape[:-1], 1))
    return np.concatenate([corners[..., :2], z], axis=-1)


def _resection(xyz: FloatArray, uv: FloatArray) -> FloatArray:
    """Pose of points (n, 3) in the axes of a camera that has them at normalised coordinates (n, 2), n >= 6."""
    middle = xyz.mean(axis=0)
    size = float(np.abs(xyz - middle).max())
    p = np.column_stack([(xyz - middle) / size, np.ones(len(xyz))])
    none = np.zeros_like(p)
    rows = np.vstack([np.hstack([p, none, -uv[:, :1] * p]), np.hstack([none, p, -uv[:, 1:] * p])])
    P = np.linalg.svd(rows)[2][11].reshape(3, 4)
    factor = np.cbrt(np.linalg.det(P[:, :3])) or 1.0
    R = frames.nearest_rotation(P[:, :3] / factor)
    return frames.transform(R, size * P[:, 3] / factor - R @ middle)


def _homography(xy: FloatArray, uv: FloatArray) -> FloatArray:
    """The homography (3, 3) from places on a plane to their images, by the direct linear transformation."""
    A, B = (_normaliser(points) for points in (xy, uv))
    p = xy @ A[:2, :2].T + A[:2, 2]
    q = uv @ B[:2, :2].T + B[:2, 2]
    column, none = np.ones((len(p), 1)), np.zeros((len(p), 3))
    h = np.hstack([p, column])
    rows = np.vstack([np.hstack([h, none, -q[:, :1] * h]), np.hstack([none, h, -q[:, 1:] * h])])
    H = np.linalg.svd(rows)[2][8].reshape(3, 3)
    return np.asarray(np.linalg.inv(B) @ H @ A)


def _normaliser(points: FloatArray) -> FloatArray:
    """Brings points (n, 2) about the origin, root mean square distance of a coordinate 1."""
    middle = points.mean(axis=0)
    s = 1.0 / max(rms(points - middle), 1e-15)
    return np.array([[s, 0.0, -s * middle[0]], [0.0, s, -s * middle[1]], [0.0, 0.0, 1.0]])
