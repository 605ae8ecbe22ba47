"""A camera: pinhole with Brown's distortion, in OpenCV's convention; where a flat board stands before it.

A lens is ``(fx, fy, cx, cy, k1, k2, p1, p2, k3)``. Camera axes: x to the right of the image, y down, z forward.

Corners of a flat board in images: a camera in the hall that sees a board on the tool, or the other way round.

An image tells six numbers of the tool, and its corners repeat them: an image's residuals are what its corners miss,
orthogonally reduced to as many (and as many more as numbers of the lens are fitted). The sum of squares that is
reduced away is what no place of the tool explains. Residuals are in metres: pixels times what a pixel is at the board
(`irbcal.measurement.imaging.per_pixel`), divided by the square root of the corners' count, so that one is the shift of
a whole image.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import FloatArray, rms
from irbcal.distributions import NORMAL_95
from irbcal.identification.observation_kind import (
    Kind,
    Observed,
    PriorValue,
    Residuals,
    Unknown,
    eliminated,
    ones,
)
from irbcal.measurement.features import Feature, FeatureSet
from irbcal.measurement.imaging import FITTED, TARGETS, per_pixel, typical_u95
from irbcal.modeling import frames
from irbcal.units import MM

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


REFERENCES = 40
"""Pictures that the others are compared with to number their corners alike."""


def numbered_alike(rows: FeatureSet, R: FloatArray) -> FeatureSet:
    """Rows whose corners are numbered alike in all pictures, on boards that look the same after half a turn.

    The finder then numbers corners from either end, as the picture shows them. The first picture's numbers stay; each
    other picture's are turned if the board then turns between pictures by the angles that the flange turns by.

    Parameters
    ----------
    rows : FeatureSet
    R : ndarray, shape (m, 3, 3)
        Orientation of the flange at each row, in the base link.
    """
    if rows.corners is None:
        return rows
    corners = rows.corners.copy()
    for name, feature in rows.features.items():
        view = feature.imaging
        if view is None or view.board is None or not view.board.turnable:
            continue
        rows_of_feature = np.flatnonzero(rows.feature == name)
        middle = view.corners.min(axis=0) + view.corners.max(axis=0)
        turned = corners[rows_of_feature]
        turned[:, :, :2] = middle - turned[:, :, :2]
        D = np.stack([boards(view.lens, each)[:, :3, :3] for each in (corners[rows_of_feature], turned)])
        chosen = np.zeros(len(rows_of_feature), dtype=int)
        n = 1
        while n < len(rows_of_feature):  # each picture by those before it, twice as many at a time
            new, references = np.arange(n, min(2 * n, len(rows_of_feature))), np.arange(n)[-REFERENCES:]
            by_flange = _angles(R[rows_of_feature[references]], R[rows_of_feature[new]])
            off = [
                np.abs(_angles(D[chosen[references], references], D[k, new]) - by_flange).sum(axis=0) for k in (0, 1)
            ]
            chosen[new] = off[1] < off[0]
            n += len(new)
        corners[rows_of_feature] = np.where(chosen[:, None, None] == 1, turned, corners[rows_of_feature])
    return replace(rows, corners=corners)


def _angles(A: FloatArray, B: FloatArray) -> FloatArray:
    """Angles between rotations, (len(A), len(B)), radians."""
    trace = np.einsum("aij,bij->ab", A, B)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))


LENS_U95 = (0.02, 0.02, 0.02, 0.02, 0.1, 0.3, 0.01, 0.01, 1.0)
"""How well fitted numbers of a lens are known before: shares of the focal length of those in pixels."""

TOO_FAR = 4.0
"""Times its standard deviation that a corner may miss within an image before lens and board are doubted."""

NO_ROBOT = 1.0 * MM
"""What images may miss in a fit of the robot before they are doubted, metres."""


def lens_of(obs: Observed) -> dict[str, FloatArray]:
    """Numbers of the camera's lens by their names, as they are known beforehand."""
    return {name: np.array([value]) for name, value in zip(FITTED, obs.feature.view.lens, strict=True)}


class Image(Kind):
    """Corners of a board on the tool, seen by a camera in the hall; the tool's point is the board's origin."""

    name, size, shown_as = "image", 6, "camera"
    needs: ClassVar[tuple[str, ...]] = ("corners",)
    metric, spread = True, True
    unknowns: ClassVar[Mapping[str, Unknown]] = {
        "centre": Unknown("place"),
        "attitude": Unknown("turn", unit="rad"),
        "axes": Unknown("turn", owner="target", unit="rad"),
        **{name: Unknown("number", unit="px" if k < 4 else "") for k, name in enumerate(FITTED)},
    }

    @property
    def on_tool(self) -> bool:
        """Whether it is the camera that the tool carries."""
        return TARGETS[self.name] == "camera"

    def fixed(self, feature: Feature) -> dict[str, FloatArray]:
        """Numbers of the lens that are not fitted."""
        view = feature.view
        return {name: view.lens[k : k + 1] for k, name in enumerate(FITTED) if name not in view.fit}

    def priors(self, feature: Feature) -> dict[str, PriorValue]:
        """What the features' file says of the numbers that are."""
        view = feature.view
        return {
            name: PriorValue(view.lens[k : k + 1], LENS_U95[k] * (float(view.lens[0]) if k < 4 else 1.0))
            for k, name in enumerate(FITTED)
            if name in view.fit
        }

    def scale_of(self, feature: Feature) -> str:
        """The board's squares."""
        board = feature.view.board
        return f"squares of {board.pitch / MM:.6g} mm" if board else "places of the corners on the board"

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """What corners miss, image by image; see the module."""
        view, corners = obs.feature.view, obs.in_image()
        lens = np.array([values[name][0] for name in FITTED])
        is_seen = np.isfinite(corners[:, :, 2])
        x = np.where(is_seen[..., None], camera_positions(corners), 0.0)
        by_p, by_turn, uv, by_lens = self._corner_derivatives(obs, values, x, lens)
        m, n = is_seen.shape
        count = is_seen.sum(axis=1)
        pixel = per_pixel(corners)
        typical = typical_u95(corners)
        w = np.where(is_seen, typical[:, None] / np.where(is_seen, corners[:, :, 4], 1.0), 0.0)
        w *= (pixel / np.sqrt(count))[:, None]
        e = np.where(is_seen[..., None], corners[:, :, 2:4] - uv, 0.0)
        fitted = [k for k, name in enumerate(FITTED) if name in view.fit]
        A: FloatArray = (
            np.concatenate([by_p, by_turn, by_lens[..., fitted], e[..., None]], axis=3) * w[:, :, None, None]
        )
        A = A.reshape(m, 2 * n, A.shape[3])
        k = A.shape[2] - 1
        if 2 * n <= k:
            A = np.concatenate([A, np.zeros((m, k + 1 - 2 * n, k + 1))], axis=1)
        A = np.asarray(np.linalg.qr(A, mode="r"))[:, :k]
        A = A * np.where(np.diagonal(A, axis1=1, axis2=2) < 0.0, -1.0, 1.0)[:, :, None]
        point, turn, r = A[:, :, :3], A[:, :, 3:6], A[:, :, k]
        by = {
            "centre": -point,
            "attitude": point @ frames.cross_matrix(obs.p - values["centre"]) - turn,
            "axes": turn @ obs.R,
        }
        by |= {FITTED[at]: A[:, :, [6 + column]] for column, at in enumerate(fitted)}
        size = pixel * np.sqrt((e**2).sum(axis=(1, 2)) / count)
        return Residuals(r, point, by, turn, size)

    def doubt(self, obs: Observed, misses: Residuals) -> str:
        """Corners that no place of camera and board explains, or no robot: a lens or a board that is another."""
        assert misses.size is not None
        corners = obs.in_image()
        count = np.isfinite(corners[:, :, 2]).sum(axis=1)
        expected = float(np.nanmedian(corners[:, :, 4])) / NORMAL_95
        spare = np.maximum(2 * count - misses.r.shape[1], 1)
        residual = np.maximum(misses.size**2 - (misses.r**2).sum(axis=1), 0.0) * count / spare
        pixel = per_pixel(corners)
        within, overall = (float(np.median(np.sqrt(squares) / pixel)) for squares in (residual, misses.size**2 / 2.0))
        if within < TOO_FAR * expected and (np.median(misses.size) < NO_ROBOT or overall < TOO_FAR * expected):
            return ""
        problem = f"{within:.2f} px from where any place of camera and board has them"
        if within < TOO_FAR * expected:
            problem = f"{overall:.1f} px ({np.median(misses.size) / MM:.1f} mm) from where any robot like this has them"
        return (
            f"Corners of {obs.feature.name} are {problem} ({expected:.2f} px expected): lens or board are not what was "
            "said of them, or joints and images do not belong together; give the camera's distortion, or fit: fx fy cx "
            "cy k1."
        )

    def _corner_derivatives(
        self, obs: Observed, values: Mapping[str, FloatArray], x: FloatArray, lens: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Derivatives of corners (m, n, 2, 3) by the tool's point and its turn, where they are, and by the lens."""
        m, n = x.shape[:2]
        on_tool = x @ (obs.R @ values["axes"]).transpose(0, 2, 1)
        F = values["attitude"]
        uv, P, by_lens = project(lens, (obs.p[:, None] - values["centre"] + on_tool) @ F)
        by_p = P @ F.T
        by_turn = -by_p @ frames.cross_matrix(on_tool.reshape(-1, 3)).reshape(m, n, 3, 3)
        return by_p, by_turn, uv, by_lens

    def poses(self, obs: Observed) -> FloatArray:
        """The frame on the tool in that in the hall, image by image, (m, 4, 4); closed form."""
        T = boards(obs.feature.view.lens, obs.in_image())
        if not self.on_tool:
            return T
        R = T[:, :3, :3].transpose(0, 2, 1)
        out = np.tile(np.eye(4), (len(T), 1, 1))
        out[:, :3, :3], out[:, :3, 3] = R, -np.einsum("mij,mj->mi", R, T[:, :3, 3])
        return out

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """From the board's pose in each image; the axes on the tool from ``R_i A = F D_i`` where they are not known."""
        D = self.poses(obs)
        A = obs.known_values.get("axes")
        if A is None:
            rotations = frames.hand_eye(obs.R, D[:, :3, :3])
            A = np.eye(3) if rotations is None else rotations[0]
        F = np.asarray(frames.nearest_rotation((obs.R @ A @ D[:, :3, :3].transpose(0, 2, 1)).mean(axis=0)))
        return {"axes": A, "attitude": F, "centre": (obs.p - D[:, :3, 3] @ F.T).mean(axis=0), **lens_of(obs)}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``R t - c = F d - p``, which is linear once the rotations are known."""
        D = self.poses(obs)
        rotations = frames.hand_eye(obs.R, D[:, :3, :3])
        if rotations is None:
            return None
        return eliminated(obs.R, [-ones(len(D))], D[:, :3, 3] @ rotations[1].T - obs.p)


class ImageOnTool(Image):
    """Corners of a board in the hall, seen by a camera on the tool; the tool's point is the camera's centre."""

    name, shown_as = "image-on-tool", "board"
    unknowns: ClassVar[Mapping[str, Unknown]] = {
        name: Unknown(item.shape, "target" if name in FITTED else item.owner, item.unit)
        for name, item in Image.unknowns.items()
    }

    def _corner_derivatives(
        self, obs: Observed, values: Mapping[str, FloatArray], x: FloatArray, lens: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        m, n = x.shape[:2]
        ray = x @ values["attitude"].T + values["centre"] - obs.p[:, None]
        M = obs.R @ values["axes"]
        uv, P, by_lens = project(lens, ray @ M)
        by_p = -P @ M.transpose(0, 2, 1)[:, None]
        by_turn = -by_p @ frames.cross_matrix(ray.reshape(-1, 3)).reshape(m, n, 3, 3)
        return by_p, by_turn, uv, by_lens
