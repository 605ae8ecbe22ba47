"""Path velocity of ISO 9283:1998: accuracy AV, repeatability RV and fluctuation FV.

The formulas are those of public descriptions of the standard; the standard itself was not at hand. Velocities are
judged on the middle half of the commanded path, away from starting and stopping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import MeasurementError

CENTRAL = (0.25, 0.75)
"""Part of the commanded path, as shares of its length, on which velocities are judged."""

BLOCK = 2_000_000
"""Numbers that are worked on at a time."""


@dataclass(frozen=True, eq=False)
class PathVelocity:
    """Velocities of several cycles along one path.

    Attributes
    ----------
    mean, lowest, highest : ndarray, shape (cycles,)
        Of each cycle's velocities, m/s.
    commanded : float or None
        Commanded velocity, m/s.
    """

    mean: FloatArray
    lowest: FloatArray
    highest: FloatArray
    commanded: float | None

    def __post_init__(self) -> None:
        lock(self)

    @property
    def AV(self) -> float | None:
        """Velocity accuracy: mean over the cycles against the commanded one, a share of it; None without a command."""
        return None if self.commanded is None else float(self.mean.mean() / self.commanded - 1.0)

    @property
    def RV(self) -> float | None:
        """Velocity repeatability: 3 S of the cycles' means (n - 1), a share of the commanded one; None without it."""
        return None if self.commanded is None else float(3 * self.mean.std(ddof=1) / self.commanded)

    @property
    def FV(self) -> float:
        """Velocity fluctuation: largest difference of highest and lowest velocity in a cycle, m/s."""
        return float((self.highest - self.lowest).max())


def path_velocity(
    times: Sequence[FloatArray],
    paths: Sequence[FloatArray],
    commanded: FloatArray,
    velocity: float | None = None,
    window: float = 0.0,
) -> PathVelocity:
    """Velocities on the middle half of a path.

    Parameters
    ----------
    times : sequence of ndarray, shape (k,)
        Of the samples, seconds, ascending.
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, metres.
    velocity : float, optional
        Commanded velocity, m/s.
    window : float
        Velocities are slopes of straight lines through the samples of so many seconds; 0: between neighbours. Noise of
        the samples counts in full in the fluctuation: 0.02 mm at 1 kHz are some 30 mm/s between neighbours.

    Returns
    -------
    PathVelocity

    Raises
    ------
    MeasurementError
        If there are fewer than two cycles or a cycle has fewer than two velocities there.
    """
    if len(paths) < 2:
        raise MeasurementError("velocity accuracy and repeatability need two cycles or more")
    found = []
    for number, (time, path) in enumerate(zip(times, paths, strict=True), 1):
        share = way_along(path, commanded)
        if window > 0:
            speed = _slopes(time, path, window)
        else:
            speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / np.diff(time)
            share = 0.5 * (share[1:] + share[:-1])
        speed = speed[(share >= CENTRAL[0]) & (share <= CENTRAL[1]) & np.isfinite(speed)]
        if len(speed) < 2:
            raise MeasurementError(f"cycle {number} has fewer than two velocities on the middle half of the path")
        found.append((speed.mean(), speed.min(), speed.max()))
    mean, lowest, highest = np.array(found).T
    return PathVelocity(mean, lowest, highest, velocity)


def way_along(path: FloatArray, commanded: FloatArray) -> FloatArray:
    """Where on a commanded path samples are nearest to it, shape (k,): share of its length."""
    start, step = commanded[:-1], np.diff(commanded, axis=0)
    size = np.sum(step**2, axis=1)
    length = np.sqrt(size)
    before = np.concatenate([[0.0], np.cumsum(length)])
    out = np.empty(len(path))
    rows = max(1, BLOCK // len(step))
    for first in range(0, len(path), rows):
        part = path[first : first + rows]
        t = np.clip(np.einsum("kmj,mj->km", part[:, None] - start, step) / np.maximum(size, 1e-300), 0.0, 1.0)
        off = np.linalg.norm(part[:, None] - start - t[..., None] * step, axis=2)
        best = np.argmin(off, axis=1)
        out[first : first + rows] = before[best] + t[np.arange(len(part)), best] * length[best]
    return out / before[-1]


def _slopes(time: FloatArray, path: FloatArray, window: float) -> FloatArray:
    """Velocity at each sample by the straight line through those around it, m/s; NaN where there is no other."""
    t, p = time - time.mean(), path - path.mean(axis=0)
    low = np.searchsorted(time, time - 0.5 * window)
    high = np.searchsorted(time, time + 0.5 * window, side="right")

    def total(values: FloatArray) -> FloatArray:
        sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        return np.asarray(sums[high] - sums[low])

    n, st = (high - low).astype(float), total(t)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (total(t[:, None] * p) - st[:, None] * total(p) / n[:, None]) / (total(t * t) - st**2 / n)[:, None]
    return np.where(n > 1, np.linalg.norm(slope, axis=1), np.nan)
