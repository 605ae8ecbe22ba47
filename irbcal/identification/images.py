"""Corners of a board in images: a camera in the hall that sees a board on the tool, or the other way round.

An image tells six numbers of the tool, and its corners repeat them: an image's residuals are what its corners miss,
orthogonally reduced to as many (and as many more as numbers of the lens are fitted). The sum of squares that is
reduced away is what no place of the tool explains. Residuals are in metres: pixels times what a pixel is at the board
(`irbcal.measurement.imaging.per_pixel`), divided by the square root of the corners' count, so that one is the shift of
a whole image.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from irbcal.arrays import FloatArray
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
from irbcal.measurement.features import Feature
from irbcal.measurement.imaging import FITTED, TARGETS, per_pixel, typical_u95
from irbcal.measurement.pinhole import boards, camera_positions, project
from irbcal.modeling import frames
from irbcal.units import MM

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
