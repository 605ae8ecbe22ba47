"""Cornering of ISO 9283:1998: corner round-off CR and cornering overshoot CO.

The formulas are those of public descriptions of the standard; the standard itself was not at hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.units import DEG

SHARP = 40.0 * DEG
"""Turn of the commanded path at one of its points that makes it a corner; less belongs to a curve told by points."""

STRAIGHT = 1.0 * DEG
"""A leg after a corner goes on as long as the commanded path turns less than this from its first direction."""


@dataclass(frozen=True, eq=False)
class Corner:
    """How the cycles go round one corner of the commanded path.

    Attributes
    ----------
    place : ndarray, shape (3,)
        Commanded, metres.
    way : float
        Of the corner on the commanded path, metres.
    turn : float
        Of the commanded path, radians.
    round_off : ndarray, shape (cycles,)
        Smallest distance of each cycle's path from the corner, metres.
    overshoot : ndarray, shape (cycles,)
        Largest distance from the second leg after the corner was passed, on the side to which the first leg points;
        0 where the path does not go there; metres.
    """

    place: FloatArray
    way: float
    turn: float
    round_off: FloatArray
    overshoot: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def CR(self) -> float:
        """Corner round-off: largest over the cycles, metres."""
        return float(self.round_off.max())

    @property
    def CO(self) -> float:
        """Cornering overshoot: largest over the cycles, metres."""
        return float(self.overshoot.max())


def cornering(paths: Sequence[FloatArray], commanded: FloatArray) -> tuple[Corner, ...]:
    """Round-off and overshoot at each corner of the commanded path.

    Paths are taken as straight between their samples. The overshoot is looked for from the sample nearest to the corner
    until the middle of the second leg is reached.

    Parameters
    ----------
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, in order, metres.

    Returns
    -------
    tuple of Corner
        In the order of the path; empty where it has no corner.
    """
    steps = np.diff(commanded, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = steps / lengths[:, None]
    turn = np.arccos(np.clip(np.sum(along[1:] * along[:-1], axis=1), -1.0, 1.0))
    way = np.cumsum(lengths)
    out = []
    for k in np.flatnonzero(turn > SHARP):
        first, second, place = along[k], along[k + 1], commanded[k + 1]
        straight = np.sum(along[k + 1 :] * second, axis=1) > np.cos(STRAIGHT)
        leg = float(lengths[k + 1 :][np.cumprod(straight).astype(bool)].sum())
        found = [(_nearest(path, place), _overshoot(path, place, first, second, leg)) for path in paths]
        round_off, overshoot = np.array(found).T
        out.append(Corner(place, float(way[k]), float(turn[k]), round_off, overshoot))
    return tuple(out)


def _nearest(path: FloatArray, place: FloatArray) -> float:
    """Smallest distance of a polyline from a place."""
    start, step = path[:-1] - place, np.diff(path, axis=0)
    size = np.maximum(np.sum(step**2, axis=1), 1e-300)
    t = np.clip(-np.sum(start * step, axis=1) / size, 0.0, 1.0)
    return float(np.linalg.norm(start + t[:, None] * step, axis=1).min())


def _overshoot(path: FloatArray, place: FloatArray, first: FloatArray, second: FloatArray, leg: float) -> float:
    """Largest distance from the second leg beyond the corner."""
    arms = path - place
    arms = arms[int(np.argmin(np.linalg.norm(arms, axis=1))) :]
    forward = arms @ second
    passed = np.flatnonzero(forward > 0.5 * leg)
    arms, forward = (part[: passed[0] if len(passed) else None] for part in (arms, forward))
    beside = arms - forward[:, None] * second
    beyond = beside @ (first - (first @ second) * second) > 0
    return float(np.linalg.norm(beside[beyond], axis=1).max(initial=0.0))
