r"""Residuals of poses that the fit did not see, without fitting again.

With ``a = t / s2`` and the posterior covariance C, leaving out the rows J_n with residuals e_n gives residuals

    u_n = (I - a J_n C J_n')^-1 e_n

at the same variances. For a whole block of poses the same is solved among the columns:
``u = e + a J (C^-1 - a J'J)^-1 J'e``.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.identification.linearisation import Linearisation
from irbcal.identification.mackay import Posterior

BLOCKS = 5
"""Contiguous blocks of poses in an order."""


def residuals(linear: Linearisation, columns: IntArray, found: Posterior) -> tuple[FloatArray, IntArray]:
    """Leave-one-pose-out residuals.

    Parameters
    ----------
    linear : Linearisation
    columns : ndarray of int
        Columns of the fit.
    found : Posterior

    Returns
    -------
    u : ndarray, shape (rows, 3)
        Millimetres, in the base link, the rows in order of the poses: positions of a pose, then its orientations.
    pose : ndarray of int, shape (rows,)
    """
    a = found.temper / found.s2
    out, poses = [], []
    for block in linear.blocks(columns):
        u = single(block.J, block.y - found.c @ block.J, block.pose, found.covariance, a)
        out.append(u.reshape(-1, 3))
        poses.append(block.pose[::3])
    return np.concatenate(out), np.concatenate(poses)


def single(J: FloatArray, e: FloatArray, pose: IntArray, covariance: FloatArray, a: float) -> FloatArray:
    """Residuals of poses left out one at a time.

    Parameters
    ----------
    J : ndarray, shape (columns, rows)
        Rows of a pose stand side by side.
    e : ndarray, shape (rows,)
        Residuals of the fit.
    pose : ndarray of int, shape (rows,)
    covariance : ndarray, shape (columns, columns)
    a : float
        One over the variance of a row, tempered as the fit was.

    Returns
    -------
    ndarray, shape (rows,)
    """
    CJ = covariance @ J
    first = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])
    count = np.diff(np.r_[first, len(e)])
    u = np.empty_like(e)
    for size in np.unique(count):  # poses with as many rows are solved together
        rows = first[count == size][:, None] + np.arange(size)
        Jn = J[:, rows].transpose(1, 0, 2)
        share = Jn.transpose(0, 2, 1) @ CJ[:, rows].transpose(1, 0, 2)
        u[rows] = np.linalg.solve(np.eye(size) - a * share, e[rows][..., None])[..., 0]
    return u


def block_numbers(poses: int, blocks: int = BLOCKS) -> IntArray:
    """Number of the contiguous block that each pose belongs to, shape (poses,)."""
    return np.arange(poses) * blocks // poses


def block_residuals(
    linear: Linearisation, columns: IntArray, found: Posterior, blocks: int = BLOCKS
) -> tuple[FloatArray, IntArray]:
    """As `residuals`, leaving out contiguous blocks of poses in place of single ones."""
    a = found.temper / found.s2
    poses = linear.motion.q.shape[0]
    number = block_numbers(poses, blocks)
    k = len(columns)
    H, b = np.zeros((blocks, k, k)), np.zeros((blocks, k))
    for block in linear.blocks(columns):
        e = block.y - found.c @ block.J
        for part in np.unique(number[block.pose]):
            mine = number[block.pose] == part
            J = block.J[:, mine]
            H[part] += J @ J.T
            b[part] += J @ e[mine]
    precision = np.linalg.inv(found.covariance)
    shift = np.stack([a * np.linalg.solve(precision - a * H[i], b[i]) for i in range(blocks)])
    out, pose = [], []
    for block in linear.blocks(columns):
        e = block.y - found.c @ block.J
        u = e + np.einsum("kr,rk->r", block.J, shift[number[block.pose]])
        out.append(u.reshape(-1, 3))
        pose.append(block.pose[::3])
    return np.concatenate(out), np.concatenate(pose)


def rms_length(u: FloatArray) -> float:
    """Root mean square length of vectors (rows, 3)."""
    return float(np.sqrt(np.mean(np.sum(u * u, axis=1))))
