"""The instruments of the virtual cell, laser tracker and end-effector, and where Nubiola 2011 measured.

The instrument is the one of Nubiola 2011, section 2.2: a tracker that measures one reflector after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, Locked, locked
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.largest_cube import KeepPlaces, largest_cube
from irbcal.units import DEG, MM

IRB1600_CUBE: tuple[FloatArray, float] = (locked(np.array([645.6547, 0.0, 1165.707]) * MM), 650 * MM)
"""Centre in the base link and edge of the ISO cube of the IRB 1600 (Nubiola 2011, section 7.2, Table A I-1), metres."""

IRB1600_P1: FloatArray = locked(np.array([[0.0, -14.0, 14.0, 0.0, 0.0, 0.0]]) * DEG)
"""Joints that bring its tip to the centre of that cube (Nubiola 2011, Table A I-1), radians."""

LARGEST_CORRECTION = 10 * MM
"""Farther from that no calibration takes the tip."""


def has_thesis_cube(arm: Arm) -> bool:
    """Whether an arm is the thesis's IRB 1600, calibrated or not: pose P1 brings its tip to the cube's centre."""
    return arm.six_revolute and bool(
        np.linalg.norm(arm.forward(IRB1600_P1)[0, :3, 3] - IRB1600_CUBE[0]) < LARGEST_CORRECTION
    )


def iso_cube(arm: Arm, keep: KeepPlaces | None = None) -> tuple[FloatArray, float]:
    """The ISO cube of an arm: that of the thesis for the IRB 1600, `largest_cube` for others; centre and edge."""
    return IRB1600_CUBE if has_thesis_cube(arm) else largest_cube(arm, keep)


IRB1600_HEIGHTS: tuple[float, float] = (700 * MM, 1100 * MM)
"""Obstacle limits of Nubiola 2011, section 7.2, in front and at the back, metres."""

FRONT: float = 150 * MM
"""Where the front begins along x of the base link, metres."""


ACCEPTANCE = 30.0 * DEG
"""Largest angle between a reflector's direction and the beam: a corner-cube reflector in a ball returns no more."""


@dataclass(frozen=True, eq=False)
class Tracker(Locked):
    """A laser tracker with a frame of its own."""

    T_tracker_base: FloatArray
    """Shape (4, 4). The robot's base link in the tracker's frame."""

    @property
    def position(self) -> FloatArray:
        """Origin of the tracker in the base link, shape (3,), metres."""
        return frames.inverse(self.T_tracker_base)[:3, 3]

    def moved(self, position: ArrayLike) -> Tracker:
        """The tracker at another place in the base link (metres), its axes as before."""
        T = np.array(self.T_tracker_base)
        T[:3, 3] = -T[:3, :3] @ np.asarray(position, dtype=float)
        return Tracker(T)


def turned_away(
    points: FloatArray, directions: FloatArray, tracker: FloatArray, acceptance: float = ACCEPTANCE
) -> BoolArray:
    """Which reflectors the beam meets outside their acceptance.

    Parameters
    ----------
    points, directions : ndarray, shape (..., 3)
        Places (m) and unit directions of the reflectors.
    tracker : ndarray, shape (3,)
        The tracker, in the same frame.
    acceptance : float
        Radians.

    Returns
    -------
    ndarray of bool, shape (...)
    """
    beam = tracker - points
    return np.sum(beam * directions, axis=-1) < np.cos(acceptance) * np.linalg.norm(beam, axis=-1)


def behind_arm(points: FloatArray, origins: FloatArray, tracker: FloatArray, radius: float) -> BoolArray:
    """Which points the arm hides from the tracker.

    The arm is a row of straight links with round ends between the joints' origins; the link that carries the tool is
    left out, for the reflectors sit beside it.

    Parameters
    ----------
    points : ndarray, shape (n, k, 3)
        Metres.
    origins : ndarray, shape (n, joints + 1, 3)
        Of the base link and the joints, in the same frame.
    tracker : ndarray, shape (3,)
        The tracker.
    radius : float
        Of the links, metres.

    Returns
    -------
    ndarray of bool, shape (n, k)
    """
    hidden = np.zeros(points.shape[:2], dtype=bool)
    beam = tracker - points
    for i in range(origins.shape[1] - 2):
        link = origins[:, i + 1] - origins[:, i]
        if (length := np.linalg.norm(link, axis=1).max(initial=0.0)) > radius:
            near = _distance(points, beam, origins[:, i, None], link[:, None], length)
            hidden |= near < radius
    return hidden


def _distance(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray, length: float) -> FloatArray:
    """Distance between segments p + s u and q + t v, with s and t from 0 to 1, by Lumelsky's order of clipping."""
    w = p - q
    a, b, c = (np.sum(x * y, axis=-1) for x, y in ((u, u), (u, v), (v, v)))
    d, e = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    c = np.maximum(c, (1e-9 * length) ** 2)
    denominator = a * c - b * b
    s = np.clip(np.where(denominator > 1e-12 * a * c, (b * e - c * d) / np.maximum(denominator, 1e-300), 0.0), 0, 1)
    t = np.clip((b * s + e) / c, 0.0, 1.0)
    s = np.clip((b * t - d) / a, 0.0, 1.0)
    return np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)


TABLE_3_1 = {
    # target: CAD, real (Nubiola 2011, Table 3.1), in tool0, mm
    "smr1": ((-87.300, 87.300, 109.480), (-87.370, 87.202, 110.020)),
    "smr2": ((84.300, 84.300, 109.480), (84.419, 84.260, 109.928)),
    "smr3": ((85.800, -85.800, 109.480), (85.990, -85.788, 109.959)),
    "smr4": ((-86.300, -86.300, 109.480), (-86.207, -86.339, 110.039)),
    "smr5": ((-59.500, 59.500, 56.800), (-59.465, 59.477, 57.489)),
    "smr6": ((63.500, 63.500, 56.800), (63.460, 63.527, 57.407)),
    "smr7": ((62.000, -62.000, 56.800), (62.071, -61.982, 57.408)),
    "smr8": ((-63.000, -63.000, 56.800), (-62.918, -63.055, 57.454)),
    "smr9": ((0.000, 0.000, 109.480), (0.049, -0.032, 109.974)),
}
"""The nine targets of Nubiola 2011, Table 3.1 (Nubiola 2011, section 3.4.4): 1 to 4 and 9 on the front (1.5 inch),
5 to 8 on the back (0.5 inch)."""

PAYLOAD_KG = 3.0
"""The tool with its nine reflectors (Nubiola 2011, section 3.4.1: 1.8 kg and 1.2 kg)."""

PAYLOAD_CENTRE = (0.0, 0.0, 75.0 * MM)
"""Centre of mass in tool0, given for tool, reflectors and eight discs (Nubiola 2011, section 3.4.1); used for every
payload."""


@dataclass(frozen=True, eq=False)
class EndEffector(Locked):
    """A rigid tool with reflectors."""

    names: tuple[str, ...]
    cad: FloatArray
    real: FloatArray
    """Shape (k, 3). Places in the tip link as drawn and as they are, metres."""
    direction: FloatArray
    """Shape (k, 3). Unit vectors in the tip link: where each reflector looks."""
    payload_kg: float
    payload_centre: FloatArray
    """Shape (3,). Centre of mass in the tip link, metres."""

    def only(self, names: Sequence[str]) -> EndEffector:
        """The same tool measured at these targets."""
        rows = [self.names.index(name) for name in names]
        return replace(
            self, names=tuple(names), cad=self.cad[rows], real=self.real[rows], direction=self.direction[rows]
        )


def thesis_tool(look: ArrayLike, scale: float = 1.0, payload_kg: float = PAYLOAD_KG) -> EndEffector:
    """The end-effector of Nubiola 2011, section 3.4.1, with the targets of Nubiola 2011, Table 3.1.

    Parameters
    ----------
    look : array_like, shape (3,)
        Where the front reflectors look, in the tip link; those on the back look the other way along the tool's axis.
        The nests let a reflector be turned, and the thesis does so by hand (Nubiola 2011, section
        7.1).
    scale : float
        Size against the thesis's tool: smaller arms carry a smaller one.
    payload_kg : float
    """
    front = np.asarray(look, dtype=float) / np.linalg.norm(look)
    rear = front * [1.0, 1.0, -1.0]
    cad, real = (scale * MM * np.array([pair[k] for pair in TABLE_3_1.values()]) for k in (0, 1))
    direction = np.array([rear if name in ("smr5", "smr6", "smr7", "smr8") else front for name in TABLE_3_1])
    return EndEffector(
        tuple(TABLE_3_1), cad, real, direction, payload_kg, scale * np.asarray(PAYLOAD_CENTRE, dtype=float)
    )
