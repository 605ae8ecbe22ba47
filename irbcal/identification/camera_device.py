"""A camera on the arm with boards in the hall, as a device in place of a tracker: what it is, and what it sees.

Sizes and distances are shares of the arm's reach. The camera's centre is where other devices have their ball.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.identification import camera
from irbcal.identification.constraint_kind import with_third
from irbcal.measurement.imaging import Imaging
from irbcal.modeling import frames
from irbcal.units import MM

LENS = (1400.0, 1400.0, 960.0, 600.0, -0.1, 0.06, 0.0, 0.0, 0.0)
SIZE, SQUARES = (1920.0, 1200.0), (8, 6)
"""Pixels of an image, squares of a board."""

SQUARE, NEAR, FAR, ASIDE = 0.02, 0.22, 0.45, 0.15
"""Side of a square, and distances of camera and board, in shares of the reach; where the board is in the image, beside
its middle, in shares of the distance."""

AXES: FloatArray = frames.rotation_from_vector(np.array([0.03, -0.02, 0.4]))
"""Axes of the camera in the tip link: it looks along the tool."""

MARGIN = 25.0
"""Pixels that corners keep from the image's edge: the robot ends somewhere else."""


def imaging(reach: float, noise: float) -> Imaging:
    """Camera and board for an arm; ``noise`` (metres) is that of an image as a whole."""
    known = Imaging(np.array(LENS), (), SQUARES, max(round(SQUARE * reach / MM), 2.0) * MM, SIZE)
    return Imaging(
        known.lens, (), SQUARES, known.square, SIZE, round(1.96 * pixel_noise(known, reach, noise), 4) or 1e-3
    )


def pixel_noise(known: Imaging, reach: float, noise: float) -> float:
    """Standard deviation of a corner in pixels where that of an image as a whole is ``noise``, metres."""
    pixel = 0.5 * (NEAR + FAR) * reach / known.lens[0]
    return float(noise * np.sqrt(len(known.corners)) / pixel)


def board(known: Imaging, middle: FloatArray, normal: FloatArray) -> dict[str, FloatArray]:
    """Unknowns of a board with its middle at a place; as OpenCV has it, z goes into the board."""
    Q = with_third(-np.asarray(normal))
    assert known.squares is not None
    assert known.square is not None
    edges = known.square * np.array([*known.squares, 0.0])
    return {"centre": middle - Q @ (0.5 * edges), "attitude": Q}


def pointers(count: int, reach: float, rng: np.random.Generator, place: FloatArray) -> FloatArray:
    """Places before a camera at ``place`` of the tip link that a board's middle is brought to, (count, 3), tip link."""
    far = reach * rng.uniform(NEAR, FAR, count)
    aside = far[:, None] * rng.uniform(-ASIDE, ASIDE, (count, 2))
    return place + np.column_stack([aside, far]) @ AXES.T


def pixels(
    known: Imaging, own: dict[str, FloatArray], T: FloatArray, place: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where corners are in the image, (n, k, 2), and in camera axes, (n, k, 3), with the tip at T (n, 4, 4)."""
    x = np.column_stack([known.corners, np.zeros(len(known.corners))])
    p = T[:, :3, 3] + T[:, :3, :3] @ place
    y = (own["centre"] + x @ own["attitude"].T - p[:, None]) @ (T[:, :3, :3] @ AXES)
    return camera.project(known.lens, y)[0], y


def visible(known: Imaging, own: dict[str, FloatArray], T: FloatArray, place: FloatArray, cone: float) -> BoolArray:
    """Whether the whole board is in the image and seen from its front within an angle of its normal, (n,)."""
    uv, y = pixels(known, own, T, place)
    inside = ((uv > MARGIN) & (uv < np.array(SIZE) - MARGIN)).all(axis=(1, 2)) & (y[..., 2] > 0.0).all(axis=1)
    into = T[:, :3, :3] @ AXES
    middle = y.mean(axis=1)
    along = np.einsum("nij,nj->ni", into, middle / np.linalg.norm(middle, axis=1)[:, None])
    return np.asarray(inside & (along @ own["attitude"][:, 2] > np.cos(cone)))
