"""Bootstrap intervals: how much the statistics would change with other poses of the same kind.

Whole poses are drawn again with replacement, because the points of one pose share its error. Intervals of mean,
sigma, mean + 3 sigma and rms are bias-corrected and accelerated (BCa; Efron 1987), with the acceleration from leaving
out one pose at a time; those of percentiles are plain percentile intervals, since leaving out one pose says nothing
about a percentile. There is none for the maximum: no resample can exceed it, see
`irbcal.validation.accuracy.largest_covers`.

Of more than `MOST_POSES` poses as many are drawn at random; intervals of n of N poses are narrowed by the root of n / N
(Bickel, Goetze, van Zwet 1997, "Resampling fewer than n observations").
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal import parallel
from irbcal.arrays import BoolArray, FloatArray, IntArray, locked
from irbcal.chance import normal_below, normal_quantile
from irbcal.units import MM
from irbcal.validation.accuracy import PERCENTILES

RESAMPLES = 2000
LEVEL = 0.95
FEWEST_POSES = 10
"""Poses below which intervals would be far too narrow: none are given then."""

MOMENTS = ("mean_mm", "sigma_mm", "mean_plus_3sigma_mm", "rms_mm")
MOST_POSES = 2000
"""Poses that resamples are made of at most."""
BLOCK = 4_000_000
"""Numbers that are worked on at a time, in each thread."""
NUMBER_S = 1e-8
"""Seconds that a point takes in a resample."""


def draws(poses: int, resamples: int = RESAMPLES, seed: int = 0) -> Iterator[NDArray[np.int32]]:
    """How often each pose is in each resample.

    Returns
    -------
    iterator of ndarray of int, shape (block, poses)
        Blocks of resamples; the same for the same seed whatever their size.
    """
    rng = np.random.default_rng(seed)
    step = max(1, BLOCK // poses)
    for start in range(0, resamples, step):
        k = min(step, resamples - start)
        picked = rng.integers(poses, size=(k, poses))
        picked += poses * np.arange(k)[:, None]
        yield np.bincount(picked.ravel(), minlength=k * poses).reshape(k, poses).astype(np.int32)


@lru_cache(maxsize=1)
def _kept_draws(poses: int, resamples: int, seed: int) -> tuple[NDArray[np.int32], ...]:
    """`draws`, which several targets and models of the same poses share."""
    return locked([*draws(poses, resamples, seed)])


def intervals(
    distance: ArrayLike, pose: ArrayLike, resamples: int = RESAMPLES, seed: int = 0, level: float = LEVEL
) -> dict[str, list[float]] | None:
    """Bootstrap intervals of the statistics of distances.

    Parameters
    ----------
    distance : ndarray, shape (m,)
        Metres.
    pose : ndarray, shape (m,)
        Pose of each distance.
    resamples, seed : int
    level : float

    Returns
    -------
    dict of str to [float, float], or None
        Low and high ends in mm for the keys of `MOMENTS` and ``p50_mm`` and so on; None for fewer than `FEWEST_POSES`
        poses.
    """
    row = np.unique(np.asarray(pose), return_inverse=True)[1].ravel()
    n = int(row.max(initial=-1)) + 1
    if n < FEWEST_POSES:
        return None
    d = np.asarray(distance, dtype=float) / MM
    if n > MOST_POSES:
        drawn = _some(n, seed)[row]
        ends_of = intervals(distance_of_part := d[drawn] * MM, row[drawn], resamples, seed, level)
        assert ends_of is not None
        near, whole = _statistics(distance_of_part / MM, row[drawn]), _statistics(d, row)
        return {name: _narrowed(ends, near[name], whole[name], n) for name, ends in ends_of.items()}
    sums = _Sums.of(d, row, n)
    order = np.argsort(d, kind="stable")
    step = max(1, BLOCK // len(d))

    def of_block(count: NDArray[np.int32]) -> tuple[FloatArray, FloatArray]:
        blocks = [_percentiles(d[order], count[k : k + step], row[order]) for k in range(0, len(count), step)]
        return sums.moments(*(count @ s for s in sums.by_pose)), np.concatenate(blocks, axis=1)

    counts = _kept_draws(n, resamples, seed) if n * resamples <= BLOCK else draws(n, resamples, seed)
    blocks = list(parallel.threads(of_block, counts, NUMBER_S * resamples * len(d)))
    moments, quantiles = (np.concatenate(arrays, axis=1) for arrays in zip(*blocks, strict=True))
    total = [s.sum() for s in sums.by_pose]
    estimate = sums.moments(*total)
    left_out = sums.moments(*(t - s for t, s in zip(total, sums.by_pose, strict=True)))
    out = {
        name: bca(replicates, value, jackknife, level)
        for name, replicates, value, jackknife in zip(MOMENTS, moments, estimate, left_out, strict=True)
    }
    ends = 100 * np.array([0.5 - level / 2, 0.5 + level / 2])
    for p, replicates in zip(PERCENTILES, quantiles, strict=True):
        out[f"p{p}_mm"] = np.percentile(replicates, ends).tolist()
    return out


def difference(
    values: ArrayLike, resamples: int = RESAMPLES, seed: int = 0, level: float = LEVEL
) -> list[float] | None:
    """BCa interval of the mean of one value for each pose; None for fewer than `FEWEST_POSES`.

    Parameters
    ----------
    values : ndarray, shape (n,)
    resamples, seed : int
    level : float

    Returns
    -------
    [float, float] or None
        In the unit of the values.
    """
    v = np.asarray(values, dtype=float)
    n = len(v)
    if n < FEWEST_POSES:
        return None
    if n > MOST_POSES:
        drawn = v[_some(n, seed)]
        ends = difference(drawn, resamples, seed, level)
        return None if ends is None else _narrowed(ends, float(drawn.mean()), float(v.mean()), n)
    counts = _kept_draws(n, resamples, seed) if n * resamples <= BLOCK else draws(n, resamples, seed)
    replicates = np.concatenate([count @ v / n for count in counts])
    return bca(replicates, v.mean(), (v.sum() - v) / (n - 1), level)


def bca(replicates: FloatArray, estimate: float, jackknife: FloatArray, level: float = LEVEL) -> list[float]:
    """Bias-corrected and accelerated interval (Efron 1987).

    Parameters
    ----------
    replicates : ndarray, shape (resamples,)
        The statistic of each resample.
    estimate : float
        That of the data.
    jackknife : ndarray, shape (n,)
        That of the data without one pose each.
    level : float
    """
    count = len(replicates)
    share = (np.sum(replicates < estimate) + 0.5 * np.sum(replicates == estimate)) / count
    bias = normal_quantile(np.clip(share, 0.5 / count, 1 - 0.5 / count))
    u = jackknife.mean() - jackknife
    spread = np.sum(u**2)
    acceleration = np.sum(u**3) / (6 * spread**1.5) if spread > 0 else 0.0
    z = bias + normal_quantile([0.5 - level / 2, 0.5 + level / 2])
    ends = normal_below(bias + z / (1 - acceleration * z))
    return np.percentile(replicates, 100 * ends).tolist()


def _some(n: int, seed: int) -> BoolArray:
    """Which of n poses stand for all."""
    return np.isin(np.arange(n), np.random.default_rng(seed).permutation(n)[:MOST_POSES])


def _narrowed(ends: list[float], near: float, total: float, n: int) -> list[float]:
    """The interval of n poses from that of `MOST_POSES` of them, with the statistic of the part and of all."""
    return [total + (end - near) * float(np.sqrt(MOST_POSES / n)) for end in ends]


def _statistics(d: FloatArray, row: IntArray) -> dict[str, float]:
    """The statistics that have intervals, mm."""
    used = np.unique(row, return_inverse=True)[1].ravel()
    sums = _Sums.of(d, used, int(used.max()) + 1)
    moments = sums.moments(*(s.sum() for s in sums.by_pose))
    return {
        **dict(zip(MOMENTS, moments.tolist(), strict=True)),
        **{f"p{p}_mm": float(np.percentile(d, p)) for p in PERCENTILES},
    }


class _Sums:
    """Sums over each pose, from which moments of any resample follow."""

    def __init__(self, shift: float, by_pose: list[FloatArray]) -> None:
        self.shift, self.by_pose = shift, by_pose

    @classmethod
    def of(cls, d: FloatArray, pose: IntArray, n: int) -> _Sums:
        shift = float(d.mean())  # keeps the digits of sigma
        offset = d - shift
        return cls(shift, [np.bincount(pose, w, n).astype(float) for w in (np.ones_like(d), offset, offset**2)])

    def moments(self, s0: FloatArray, s1: FloatArray, s2: FloatArray) -> FloatArray:
        """`MOMENTS` from count, sum and sum of squares of the shifted distances, shape (4, ...)."""
        mean = s1 / s0
        variance = np.maximum(s2 - s1 * mean, 0.0)
        sigma = np.sqrt(variance / np.maximum(s0 - 1, 1))
        mean = mean + self.shift
        return np.array([mean, sigma, mean + 3 * sigma, np.sqrt(variance / s0 + mean**2)])


def _percentiles(d: FloatArray, count: NDArray[np.int32], pose: IntArray) -> FloatArray:
    """Linear percentiles of resamples, shape (percentiles, k).

    Parameters
    ----------
    d : ndarray, shape (m,)
        Sorted values.
    count : ndarray of int, shape (k, poses)
        How often each pose is in each resample.
    pose : ndarray of int, shape (m,)
        Pose of each value.
    """
    m, width = len(d), max(1, int(np.sqrt(len(d))))
    chunks = -(-m // width)
    in_part = np.zeros((count.shape[1], chunks), dtype=np.float32)  # values of each pose in stretches of sorted ones
    np.add.at(in_part, (pose, np.arange(m) // width), 1.0)
    until = np.cumsum(np.rint(count.astype(np.float32) @ in_part).astype(np.int32), axis=1)
    last = until[:, -1:] - 1
    rank = last * (np.array(PERCENTILES) / 100)
    low = np.floor(rank)
    ranks = np.hstack([low, np.minimum(low + 1, last)]).astype(np.int32)
    row = np.arange(len(count))[:, None]
    chunk = (until[:, None, :] <= ranks[:, :, None]).sum(axis=2)
    count_below = np.where(chunk > 0, until[row, chunk - 1], 0)
    within = chunk[:, :, None] * width + np.arange(width)
    inside = within < m
    counts = count[row[:, :, None], pose[np.minimum(within, m - 1)]] * inside
    ends = d[chunk * width + (count_below[:, :, None] + np.cumsum(counts, axis=2) <= ranks[:, :, None]).sum(axis=2)]
    first, second = np.hsplit(ends, 2)
    return (first + (rank - low) * (second - first)).T
