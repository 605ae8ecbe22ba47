"""Whether poses in the order of measuring are of one piece: equations of each pose, the best cut, and chance.

A model that is fitted to all poses may change a little; what counts is by how much residuals become smaller where it
may change otherwise before and after a cut, and whether poses in a random order would do the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, IntArray

SHORTEST = 8
"""Poses before and after a change at least."""
SHUFFLES = 200
"""Random orders that are tried; none may explain as much."""
BLOCKS = 40
"""Blocks of neighbouring poses that are shuffled together: a program's neighbours have similar errors."""


class PoseSums(NamedTuple):
    """Normal equations of a small change of the model for each of n poses."""

    H: FloatArray
    """Shape (n, p, p)."""
    g: FloatArray
    """Shape (n, p)."""
    yy: FloatArray
    """Shape (n,). Squares, m^2."""

    @property
    def unknowns(self) -> int:
        """Their number."""
        return self.H.shape[1]

    def ordered(self, order: IntArray) -> PoseSums:
        """The same of the poses in another order."""
        return PoseSums(self.H[order], self.g[order], self.yy[order])

    def rss(self, ridge: float) -> float:
        """Sum of squares where one change is allowed to all poses."""
        return float(self.yy.sum() - explained(self.H.sum(axis=0)[None], self.g.sum(axis=0)[None], ridge)[0])

    def best_cut(self, cuts: IntArray, ridge: float) -> tuple[float, int]:
        """Least sum of squares where poses before and after a cut may change otherwise, and the first pose after it."""
        H, g = np.cumsum(self.H, axis=0), np.cumsum(self.g, axis=0)
        before_H, before_g = H[cuts - 1], g[cuts - 1]
        gain = explained(before_H, before_g, ridge) + explained(H[-1] - before_H, g[-1] - before_g, ridge)
        best = int(np.argmax(gain))
        return float(self.yy.sum() - gain[best]), int(cuts[best])


def pose_sums(J: FloatArray, r: FloatArray, pose: IntArray, n: int) -> PoseSums:
    """Normal equations of each of n poses.

    Parameters
    ----------
    J : ndarray, shape (m, 3, p)
        Derivatives of points.
    r : ndarray, shape (m, 3)
        Their residuals, metres.
    pose : ndarray of int, shape (m,)
        From 0 to n - 1.
    n : int
    """
    p = J.shape[2]
    H, g, yy = np.zeros((n, p, p)), np.zeros((n, p)), np.zeros(n)
    count = np.bincount(pose, minlength=n)
    order = np.argsort(pose, kind="stable")
    of_ordered = count[pose[order]]
    for size in np.unique(of_ordered):  # poses with so many points each
        poses, points = np.flatnonzero(count == size), order[of_ordered == size]
        rows, residuals = J[points].reshape(len(poses), -1, p), r[points].reshape(len(poses), -1)
        H[poses] = rows.swapaxes(1, 2) @ rows
        g[poses] = (rows.swapaxes(1, 2) @ residuals[..., None])[..., 0]
        yy[poses] = (residuals**2).sum(axis=1)
    return PoseSums(H, g, yy)


def explained(H: FloatArray, g: FloatArray, ridge: float) -> FloatArray:
    """Squares, shape (k,), that free changes take away, of those that the data show; H (k, p, p), g (k, p)."""
    return np.einsum("ka,ka->k", g, np.linalg.solve(H + ridge * np.eye(H.shape[-1]), g[..., None])[..., 0])


def beyond_chance(n: int, rss: float, least: Callable[[IntArray], float], seed: int) -> bool:
    """Whether no random order of n poses makes residuals as small; ``least`` gives an order's sum of squares."""
    return all(least(order) > rss for order in _random_orders(n, seed))


def _random_orders(n: int, seed: int) -> Iterator[IntArray]:
    """Orders of n poses by which chance is judged: blocks of neighbours, whose errors are alike, stay together."""
    rng, blocks = np.random.default_rng(seed), np.array_split(np.arange(n), min(n, BLOCKS))
    for _ in range(SHUFFLES):
        yield np.concatenate([blocks[k] for k in rng.permutation(len(blocks))])
