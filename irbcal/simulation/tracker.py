"""The laser tracker of the virtual cell: where it stands, and which reflectors it can see.

The instrument is the one of Nubiola 2011, section 2.2: a tracker that measures one reflector after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.modeling import frames
from irbcal.units import DEG

ACCEPTANCE = 30.0 * DEG
"""Largest angle between a reflector's direction and the beam: a corner-cube reflector in a ball returns no more."""


@dataclass(frozen=True, eq=False)
class Tracker(Locked):
    """A laser tracker with a frame of its own.

    Parameters
    ----------
    T_tracker_base : ndarray, shape (4, 4)
        The robot's base link in the tracker's frame.
    """

    T_tracker_base: FloatArray

    @property
    def place(self) -> FloatArray:
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
