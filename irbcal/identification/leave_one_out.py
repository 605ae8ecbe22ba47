r"""Residuals of poses that the fit did not see, without fitting again.

With ``a = t / s2`` and the posterior covariance C, leaving out the rows J_n with residuals e_n gives residuals

    u_n = (I - a J_n C J_n')^-1 e_n

at the same variances. For a whole block of poses the same is solved among the columns:
``u = e + a J (C^-1 - a J'J)^-1 J'e``.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray
from irbcal.identification.linearisation import Linearisation
from irbcal.identification.mackay import Posterior
from irbcal.measurement.places import places

BLOCKS = 5
"""Contiguous blocks of poses in an order."""


def residuals(linear: Linearisation, columns: IntArray, found: Posterior) -> tuple[FloatArray, IntArray]:
    """Leave-one-pose-out residuals; repeats of one place (`irbcal.measurement.places.places`) are left out together.

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
    place = places(linear.problem.points)
    repeated = np.bincount(place)[place] > 1
    out, poses, kept = [], [], []
    for block in linear.blocks(columns):
        e = block.y - found.c @ block.J
        u = single(block.J, e, block.pose, found.covariance, a)
        mine = repeated[block.pose]
        kept.append((block.J[:, mine], e[mine]))
        out.append(u.reshape(-1, 3))
        poses.append(block.pose[::3])
    u, pose = np.concatenate(out), np.concatenate(poses)
    if repeated.any():
        u[repeated[pose]] = _together(kept, place[pose[repeated[pose]]], found)
    return u, pose


def _together(kept: list[tuple[FloatArray, FloatArray]], place: IntArray, found: Posterior) -> FloatArray:
    """Residuals (rows, 3) of poses that are left out with all poses of their place.

    Parameters
    ----------
    kept : list of (ndarray, ndarray)
        Derivatives (columns, 3 rows) and residuals (3 rows,), in parts.
    place : ndarray of int, shape (rows,)
    found : Posterior
    """
    a = found.temper / found.s2
    J, e = np.concatenate([part for part, _ in kept], axis=1), np.concatenate([part for _, part in kept])
    u = np.empty_like(e)
    of_row = np.repeat(place, 3)
    order = np.argsort(of_row, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(of_row[order])) + 1):
        share = J[:, rows].T @ (found.covariance @ J[:, rows])
        u[rows] = np.linalg.solve(np.eye(len(rows)) - a * share, e[rows])
    return u.reshape(-1, 3)


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


def block_numbers(place: IntArray, session: NameArray | None, blocks: int = BLOCKS) -> IntArray:
    """Number of the contiguous block that each pose belongs to, in the order of the poses, repeats together.

    Each session is cut by itself: without all poses of one its base would be anywhere.
    """
    _, first, rank = np.unique(place, return_index=True, return_inverse=True)
    number = np.zeros(len(first), dtype=int)
    own = np.zeros(len(first), dtype=int) if session is None else np.unique(session[first], return_inverse=True)[1]
    for k in range(int(own.max(initial=-1)) + 1):
        mine = np.flatnonzero(own == k)
        number[mine] = np.arange(len(mine)) * blocks // len(mine)
    return number[rank]


def block_residuals(
    linear: Linearisation, columns: IntArray, found: Posterior, blocks: int = BLOCKS
) -> tuple[FloatArray, IntArray]:
    """As `residuals`, leaving out contiguous blocks of poses in place of single ones."""
    a = found.temper / found.s2
    points = linear.problem.points
    number = block_numbers(places(points), points.session, blocks)
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
