r"""Residuals of poses that the fit did not see, without fitting again.

With ``a = t / s2`` and the posterior covariance ``C = W' W``, leaving out the rows J_n with residuals e_n gives

    u_n = (I - a J_n' C J_n)^-1 e_n

at the same variances. For a block of poses with more rows than columns the same is solved among the columns:
``u = e + a J' W' (I - a W J J' W')^-1 W J e``.

A direction that the other poses do not determine is *open*: what depends on it cannot be predicted from them, so its
residual is infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray
from irbcal.identification.evidence_maximisation import NOISE, Posterior
from irbcal.identification.linear_model import LinearModel
from irbcal.identification.outlier_rule import RULE, OutlierRule
from irbcal.units import MM

BLOCKS = 5
"""Contiguous blocks of poses in an order."""
OPEN = 1e-6
"""Share of the information about a direction below which, without the poses left out, it is open: rounding decides."""


def residuals(linear: LinearModel, columns: IntArray, fit: Posterior) -> tuple[FloatArray, IntArray, IntArray]:
    """Leave-one-pose-out residuals; repeats of one place (`LinearModel.repeat_group`) are left out together.

    Parameters
    ----------
    linear : LinearModel
    columns : ndarray of int
        Columns of the fit.
    fit : Posterior

    Returns
    -------
    u : ndarray, shape (equations,)
        Millimetres, in the order of `LinearModel.blocks`; infinite where one depends on a direction that is open
        without its pose.
    pose, row : ndarray of int, shape (equations,)
    """
    a = fit.likelihood_power / fit.s2
    repeats = linear.repeat_group
    repeated = np.bincount(repeats)[repeats] > 1
    out, blocks = [], []
    for block in linear.blocks(columns):
        e = block.y - fit.c @ block.J
        repeated_rows = repeated[block.pose]
        whitened = fit.whiten(block.J)
        blocks.append((whitened[:, repeated_rows], e[repeated_rows]))
        out.append((single(whitened, e, block.pose, a), block.pose, block.row))
    u, pose, row = (np.concatenate(arrays) for arrays in zip(*out, strict=True))
    if repeated.any():
        u[repeated[pose]] = _together(blocks, repeats[pose[repeated[pose]]], a)
    return u, pose, row


def _together(blocks: list[tuple[FloatArray, FloatArray]], repeats: IntArray, a: float) -> FloatArray:
    """Residuals (rows,) of poses that are left out with all poses of their place.

    Parameters
    ----------
    blocks : list of (ndarray, ndarray)
        Derivatives ``W J`` (columns, rows) and residuals (rows,), in parts.
    repeats : ndarray of int, shape (rows,)
    a : float
    """
    whitened = np.concatenate([J_block for J_block, _ in blocks], axis=1)
    e = np.concatenate([e_block for _, e_block in blocks])
    u = np.empty_like(e)
    order = np.argsort(repeats, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(repeats[order])) + 1):
        u[rows] = _without(a * (whitened[:, rows].T @ whitened[:, rows]), e[rows])
    return u


def _without(share: FloatArray, e: FloatArray) -> FloatArray:
    """Residuals (…, n) without the rows of a share (…, n, n) of the fit; infinite where one is open."""
    M = np.eye(share.shape[-1]) - share
    if _all_closed(M):
        return np.asarray(np.linalg.solve(M, e[..., None])[..., 0])
    eigenvalues, V = np.linalg.eigh(M)
    u = np.einsum(
        "...rk,...k->...r", V, np.einsum("...rk,...r->...k", V, e) / np.where(eigenvalues < OPEN, np.inf, eigenvalues)
    )
    return np.where(np.einsum("...rk,...k->...r", V * V, (eigenvalues < OPEN) * 1.0) > OPEN, np.inf, u)


def _all_closed(M: FloatArray) -> bool:
    """Whether no direction of symmetric matrices (…, n, n) is open."""
    try:
        np.linalg.cholesky(M - OPEN * np.eye(M.shape[-1]))
    except np.linalg.LinAlgError:
        return False
    return True


def root(covariance: FloatArray) -> FloatArray:
    """Root W of a covariance ``W' W``, shape (columns, columns); singular where directions are held."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray((scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))).T)


@dataclass(frozen=True, eq=False)
class LeftOutSolution:
    """A fit without a block of its rows."""

    shift: FloatArray
    """Shape (columns,). Of the coefficients, with the sign by which residuals grow."""
    is_open: FloatArray
    """Shape (columns, directions). Directions that are open, in lengths by which the rows left out share them as unit
    vectors do.
    """

    @staticmethod
    def per_pose(W: FloatArray, information: Sequence[FloatArray], b: Sequence[FloatArray]) -> list[LeftOutSolution]:
        """Fits without one block each.

        Parameters
        ----------
        W : ndarray, shape (columns, columns)
            Root of the covariance ``W' W`` of the fit with all rows.
        information : sequence of ndarray, shape (columns, columns)
            Of each block, ``a J J'``.
        b : sequence of ndarray, shape (columns,)
            ``a J e`` with the residuals of the fit.
        """
        out = []
        for H, right in zip(information, b, strict=True):
            M = np.eye(len(W)) - W @ H @ W.T
            if _all_closed(M):
                out.append(LeftOutSolution(W.T @ np.linalg.solve(M, W @ right), np.zeros((len(W), 0))))
                continue
            eigenvalues, V = np.linalg.eigh(M)
            shift = V @ ((V.T @ (W @ right)) / np.where(eigenvalues < OPEN, np.inf, eigenvalues))
            out.append(LeftOutSolution(W.T @ shift, W.T @ V[:, eigenvalues < OPEN]))
        return out

    def residuals(self, J: FloatArray, e: FloatArray, a: float) -> FloatArray:
        """Residuals (rows,) of rows left out, from derivatives (columns, rows); infinite where they are open."""
        return np.where(a * np.sum((J.T @ self.is_open) ** 2, axis=1) > OPEN, np.inf, e + self.shift @ J)


def single(whitened: FloatArray, e: FloatArray, pose: IntArray, a: float) -> FloatArray:
    """Residuals of poses left out one at a time.

    Parameters
    ----------
    whitened : ndarray, shape (columns, rows)
        Derivatives ``W J``; rows of a pose stand side by side.
    e : ndarray, shape (rows,)
        Residuals of the fit.
    pose : ndarray of int, shape (rows,)
    a : float
        One over the variance of a row, times its power in the fit.

    Returns
    -------
    ndarray, shape (rows,)
        Infinite where a row depends on a direction that is open without its pose.
    """
    first = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])
    count = np.diff(np.r_[first, len(e)])
    u = np.empty_like(e)
    for size in np.unique(count):  # poses with as many rows are solved together
        rows = first[count == size][:, None] + np.arange(size)
        of_poses = whitened[:, rows].transpose(1, 0, 2)
        u[rows] = _without(a * (of_poses.transpose(0, 2, 1) @ of_poses), e[rows])
    return u


def block_numbers(repeats: IntArray, session: NameArray | None, blocks: int = BLOCKS) -> IntArray:
    """Number of the contiguous block that each pose belongs to, in the order of the poses, repeats together.

    Each session is cut by itself: without all poses of one its base would be anywhere.
    """
    _, first, rank = np.unique(repeats, return_index=True, return_inverse=True)
    number = np.zeros(len(first), dtype=int)
    block = np.zeros(len(first), dtype=int) if session is None else np.unique(session[first], return_inverse=True)[1]
    for k in range(int(block.max(initial=-1)) + 1):
        of_session = np.flatnonzero(block == k)
        number[of_session] = np.arange(len(of_session)) * blocks // len(of_session)
    return number[rank]


def block_residuals(linear: LinearModel, columns: IntArray, fit: Posterior, blocks: int = BLOCKS) -> FloatArray:
    """As `residuals`, leaving out contiguous blocks of poses in place of single ones, shape (equations,)."""
    a = fit.likelihood_power / fit.s2
    number = block_numbers(linear.repeat_group, linear.session, blocks)
    k = len(columns)
    if 3 * len(linear.target) <= k * blocks:  # solved among the rows, of which there are fewer
        row_blocks = [
            (fit.whiten(block.J), block.y - fit.c @ block.J, number[block.pose]) for block in linear.blocks(columns)
        ]
        return _together(
            [block[:2] for block in row_blocks], np.concatenate([numbers for *_, numbers in row_blocks]), a
        )
    H, b = np.zeros((blocks, k, k)), np.zeros((blocks, k))
    for block in linear.blocks(columns):
        e = block.y - fit.c @ block.J
        for block_number in np.unique(number[block.pose]):
            rows = number[block.pose] == block_number
            J = block.J[:, rows]
            H[block_number] += a * (J @ J.T)
            b[block_number] += a * (J @ e[rows])
    without = LeftOutSolution.per_pose(fit.whitened, list(H), list(b))
    out = []
    for block in linear.blocks(columns):
        e = block.y - fit.c @ block.J
        out.append(np.empty_like(e))
        for block_number in np.unique(number[block.pose]):
            rows = number[block.pose] == block_number
            out[-1][rows] = without[block_number].residuals(block.J[:, rows], e[rows], a)
    return np.concatenate(out)


SMALLEST = 10.0 * NOISE
"""Length below which no measurement is an outlier, millimetres."""


def outliers(linear: LinearModel, e: FloatArray, u: FloatArray, row: IntArray, rule: OutlierRule = RULE) -> FloatArray:
    """Measurements that contradict all others: how far they are from where the others put them.

    They are judged by the root of the product of the fit's residual e and the left-out one u: unlike u it does not grow
    where the others hardly determine a pose, and unlike e it does not vanish where a point draws the fit to itself.
    Wrong points spoil the fit at others: of those beyond the rule's limit only those count that reach half of the
    largest.

    Parameters
    ----------
    linear : LinearModel
    e, u : ndarray, shape (equations,)
        Residuals of the average, and left-out residuals; where they are infinite nothing is said of a point.
    row : ndarray of int, shape (equations,)
        Which measurement each is of.
    rule : OutlierRule

    Returns
    -------
    ndarray, shape (measurements,)
        Millimetres; zero for good ones.
    """
    mask = (row >= 0) & np.isfinite(u)
    mask[mask] = linear.target[row[mask]] >= 0
    square, distance = (np.bincount(row[mask], (x * u)[mask], len(linear.target)) for x in (e, u))
    length = np.sqrt(np.maximum(square, 0.0))
    numbers = np.bincount(row[mask], minlength=len(length))
    if not numbers.any():
        return np.zeros(len(length))
    median = float(np.median(length[numbers > 0]))
    limit = np.maximum(rule.contradiction_factor(numbers) * median, max(SMALLEST, 0.5 * float(length.max())))
    return np.where(length > limit, np.sqrt(distance), 0.0)


LEVERAGE, PASSED = 8.0, 0.1
"""A pose is a leverage point if all others put it farther away than so many medians, and the fit passes it within that
share of the distance. Of an IRB 120 with 15 to 100 poses drawn at random the farthest is 1.8 to 5.3 medians away; a
good pose far from 20 to 60 others 5.4 to 13.5, and 28 to 59 if it is 2 mm off."""


def leverage_pose(e: FloatArray, u: FloatArray, pose: IntArray) -> tuple[int, float] | None:
    """The pose that draws the fit to itself and that no other pose can check.

    Parameters
    ----------
    e, u : ndarray, shape (equations,)
        Residuals of the fit, and left-out residuals, millimetres.
    pose : ndarray of int, shape (equations,)

    Returns
    -------
    (int, float) or None
        The pose, and how far it is from where all others put it, root mean square of its points, metres.
    """
    poses, number = np.unique(pose, return_inverse=True)
    with np.errstate(invalid="ignore"):
        passed, left_out = (np.sqrt(3.0 * np.bincount(number, x * x) / np.bincount(number)) for x in (e, u))
    farthest = int(np.argmax(left_out))
    if not np.isfinite(left_out).all() or left_out[farthest] < LEVERAGE * np.median(left_out):
        return None
    return (
        (int(poses[farthest]), float(left_out[farthest]) * MM)
        if passed[farthest] < PASSED * left_out[farthest]
        else None
    )


def lengths(linear: LinearModel, u: FloatArray, pose: IntArray, row: IntArray) -> dict[str, float | None]:
    """Root mean square length of left-out residuals of each target and of all together (``""``), metres.

    A residual of one equation tells one direction; the others are taken for as large. None where one is infinite:
    without its pose a direction that it depends on is open. Where a direction of each pose was projected out, what all
    its points have in common shows in two of three coordinates only; the third is as large.
    """
    measured = row >= 0
    measured[measured] = linear.target[row[measured]] >= 0
    target, square = linear.target[row[measured]], u[measured] ** 2
    if linear.projected:
        pose_of_point = pose[measured][::3]
        total = [np.bincount(pose_of_point, u[measured][k::3], pose_of_point.max() + 1) for k in range(3)]
        common = np.sum(np.square(total), axis=0) / np.maximum(np.bincount(pose_of_point), 1) ** 2
        square = square + np.repeat(common[pose_of_point] / 6.0, 3)
    figures = {"": square} | {name: square[target == k] for k, name in enumerate(linear.target_names)}
    return {name: closed(float(np.sqrt(3.0 * squares.mean())) * MM) for name, squares in figures.items()}


def rms_length(u: FloatArray) -> float:
    """Root mean square length of vectors (rows, 3)."""
    return float(np.sqrt(np.mean(np.sum(u * u, axis=1))))


def closed(length: float) -> float | None:
    """A root mean square length; None where it is infinite, because a residual depends on an open direction."""
    return length if np.isfinite(length) else None
