"""A single point in a camera's picture, with its depth or without: a ball of light, a marker's middle, a depth camera.

The camera is in the hall and the point on the tool (``pixel``, ``depth``), or the other way round (``…-on-tool``). The
lens is that of `irbcal.measurement.pinhole`; depth is the coordinate along the camera's z axis. What a point misses
in the picture counts as what it would miss one metre away, and depth in proportion to what is known of both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification.images import Image, ImageOnTool, lens_of
from irbcal.identification.observation_kind import (
    Observed,
    Residuals,
    Unknown,
    eliminated,
    ones,
    rotation,
)
from irbcal.measurement.features import Feature
from irbcal.measurement.imaging import FITTED
from irbcal.measurement.pinhole import project, undistorted
from irbcal.modeling import frames
from irbcal.units import MM

DEPTH_U95 = 5.0 * MM
"""Uncertainty of a depth whose feature says none, metres."""
AXES, BEST = 500, 3
"""Axes of a camera that are tried for a start, and how many of them are improved."""
FEWEST_CORNERS, MOST_ROWS = 8, 60
"""Rows that such a start needs, and takes."""


class Pixel(Image):
    """A point on the tool, seen by a camera in the hall."""

    name, size, metric = "pixel", 2, False
    outward: ClassVar[float] = 1.0
    """Sign of the way from the camera to the point in that from the feature to the tool's point."""
    unknowns: ClassVar[Mapping[str, Unknown]] = {k: v for k, v in Image.unknowns.items() if k != "axes"}

    def scale_of(self, feature: Feature) -> str:
        """None: a picture of one point tells no length; a depth is named by its kind."""
        return "depths" if self.size == 3 else ""

    def doubt(self, obs: Observed, misses: Residuals) -> str:
        """Nothing: one point does not tell the lens."""
        return ""

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """Pixels at a metre, and depth where it is measured."""
        view, uv = obs.feature.view, obs.in_image()[:, 0, 2:4]
        lens = np.array([values[name][0] for name in FITTED])
        y, by_p, by_turn, by_own = self._before_camera(obs, values)
        seen, P, by_lens = project(lens, y)
        scale = 1.0 / view.lens[0]
        e = uv - seen
        W = scale * P
        r, by_number = scale * e, scale * by_lens
        deep = np.zeros(len(y))
        if self.size == 3:
            weight = scale * view.u95 / (obs.feature.u95 or DEPTH_U95)
            deep = obs.value - y[:, 2]
            W = np.concatenate([W, np.tile([[[0.0, 0.0, weight]]], (len(y), 1, 1))], axis=1)
            r = np.column_stack([r, weight * deep])
            by_number = np.concatenate([by_number, np.zeros((len(y), 1, 9))], axis=1)
        by = {name: W @ slope for name, slope in by_own.items()}
        by |= {name: by_number[:, :, [k]] for k, name in enumerate(FITTED) if name in view.fit}
        across = scale * np.maximum(y[:, 2], 0.0) * np.linalg.norm(e, axis=1)
        return Residuals(r, W @ by_p, by, None if by_turn is None else W @ by_turn, np.hypot(across, deep))

    def _before_camera(
        self, obs: Observed, values: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray | None, dict[str, FloatArray]]:
        """The point in camera axes (m, 3); derivatives by the tool's point, its turn and the unknowns."""
        F = values["attitude"]
        off = obs.p - values["centre"]
        Ft = np.tile(F.T, (len(off), 1, 1))
        return off @ F, Ft, None, {"centre": -Ft, "attitude": Ft @ frames.cross_matrix(off)}

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Depths: ``y = F' (p - c)``, which is linear; else by the directions of all rays."""
        if self.size == 3:
            y = np.hstack([_points(obs), np.ones((len(obs.p), 1))])
            x = np.linalg.lstsq(y, obs.p, rcond=1e-12)[0]
            return {"attitude": rotation(x[:3].T), "centre": x[3], **lens_of(obs)}
        F, _, centre = self._turned(obs, False)
        return {"attitude": F, "centre": centre, **lens_of(obs)}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """Depths: ``R t - c - F y = -p``, which is linear; else by the directions of all rays."""
        if self.size == 3:
            all_of = np.einsum("ij,mk->mijk", np.eye(3), _points(obs)).reshape(len(obs.p), 3, 9)
            return eliminated(obs.R, [-ones(len(obs.p)), -all_of], -obs.p)
        return (self._turned(obs, True)[1], len(obs.p) * 1e-3 * np.eye(3)) if len(obs.p) >= FEWEST_CORNERS else None

    def _rays(self, R: FloatArray, ray: FloatArray, A: FloatArray) -> FloatArray:
        """Unit vectors from the camera to the point, (m, 3), from those in its axes, where these are A."""
        return np.asarray(ray @ A.T)

    def _turned(self, obs: Observed, with_tool: bool, fixed_value: FloatArray | None = None) -> tuple[FloatArray, ...]:
        """Axes of the camera, the tool's point in the tip (none without ``with_tool``), and the place of the feature.

        At given axes point and place are linear. The axes are searched among many, and the best ones improved.
        """
        from scipy.optimize import least_squares
        from scipy.spatial.transform import Rotation

        step = max(len(obs.p) // MOST_ROWS, 1)
        obs = replace(obs, p=obs.p[::step], R=obs.R[::step], corners=obs.in_image()[::step], value=obs.value[::step])
        m, ray = len(obs.p), _normalised(obs)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)

        def solved(A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            d = self._rays(obs.R, ray, A)
            normal_plane = np.eye(3) - d[:, :, None] * d[:, None]
            columns = np.concatenate(
                [normal_plane @ obs.R, -normal_plane] if with_tool else [-normal_plane], axis=2
            ).reshape(3 * m, -1)
            x = np.linalg.lstsq(columns, -(normal_plane @ obs.p[..., None]).ravel(), rcond=1e-9)[0]
            t = x[:3] if with_tool else np.zeros(3)
            way = self.outward * (obs.p + obs.R @ t - x[-3:])
            return t, x[-3:], (way / np.maximum(np.linalg.norm(way, axis=1), 1e-9)[:, None] - d).ravel()

        if fixed_value is None:
            starts = sorted(Rotation.random(AXES, random_state=0).as_matrix(), key=lambda A: np.sum(solved(A)[2] ** 2))
            tried = [
                least_squares(lambda w, A=A: solved(frames.rotation_from_vector(w) @ A)[2], np.zeros(3))
                for A in starts[:BEST]
            ]
            best = min(range(BEST), key=lambda k: float(tried[k].cost))
            fixed_value = frames.rotation_from_vector(tried[best].x) @ starts[best]
        return fixed_value, *solved(fixed_value)[:2]


class PixelOnTool(Pixel):
    """A point in the hall, seen by a camera on the tool, whose centre is the tool's point."""

    name, shown_as, outward = "pixel-on-tool", "light", -1.0
    unknowns: ClassVar[Mapping[str, Unknown]] = {k: v for k, v in ImageOnTool.unknowns.items() if k != "attitude"}

    def _before_camera(
        self, obs: Observed, values: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray | None, dict[str, FloatArray]]:
        M = (obs.R @ values["axes"]).transpose(0, 2, 1)
        ray = values["centre"] - obs.p
        y = np.einsum("mij,mj->mi", M, ray)
        At = np.tile(values["axes"].T, (len(y), 1, 1))
        local = np.einsum("mji,mj->mi", obs.R, ray)
        return y, -M, M @ frames.cross_matrix(ray), {"centre": M, "axes": At @ frames.cross_matrix(local)}

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Depths: ``c - R A y = p``, which is linear; else by the directions of all rays."""
        A = obs.known_values.get("axes")
        if self.size == 3 and A is None:
            m = len(obs.p)
            columns = np.concatenate(
                [ones(m), -np.einsum("mij,mk->mijk", obs.R, _points(obs)).reshape(m, 3, 9)], axis=2
            )
            x = np.linalg.lstsq(columns.reshape(3 * m, 12), obs.p.ravel(), rcond=1e-12)[0]
            return {"axes": rotation(x[3:].reshape(3, 3)), "centre": x[:3], **lens_of(obs)}
        A, _, centre = self._turned(obs, False, A)
        return {"axes": A, "centre": centre, **lens_of(obs)}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """Depths: ``R t + R A y - c = -p``, which is linear; else by the directions of all rays."""
        if self.size == 3:
            all_of = np.einsum("mij,mk->mijk", obs.R, _points(obs)).reshape(len(obs.p), 3, 9)
            return eliminated(obs.R, [all_of, -ones(len(obs.p))], -obs.p)
        return super().tool(obs)

    def _rays(self, R: FloatArray, ray: FloatArray, A: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("mij,mj->mi", R, ray @ A.T))


class Depth(Pixel):
    """A point on the tool, seen by a depth camera in the hall."""

    name, size, metric, needs = "depth", 3, True, ("corners", "value")


class DepthOnTool(PixelOnTool):
    """A point in the hall, seen by a depth camera on the tool."""

    name, size, metric, needs = "depth-on-tool", 3, True, ("corners", "value")


def _normalised(obs: Observed) -> FloatArray:
    """The points at depth one, (m, 3)."""
    xy = undistorted(obs.feature.view.lens, obs.in_image()[:, 0, 2:4])
    return np.column_stack([xy, np.ones(len(xy))])


def _points(obs: Observed) -> FloatArray:
    """Points in camera axes, (m, 3), where depths are measured."""
    return _normalised(obs) * obs.value[:, None]
