"""How sure a free frequency is: the interval of all frequencies that explain the angles about as well as the best.

A series on less than a turn, or with harmonics that others can stand in for, is far from linear in its frequency: an
interval from derivatives at the best one holds the truth too seldom. The likelihood-ratio interval does not assume
that: a frequency belongs to it unless an F test against the best one refuses it, amplitudes fitted anew for each.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.joint_behaviour.terms import fourier_columns, quantile

LEAST = 0.05
"""Smallest frequency that is looked at, periods per turn: below it a series is a constant and a slope."""

WIDER = 1.6
"""Factor of the steps by which the end of the interval is looked for."""


def interval(
    x: FloatArray,
    y: FloatArray,
    covariance: FloatArray,
    beside: FloatArray,
    order: int,
    tried: FloatArray,
    best: float,
    freedom: int,
) -> tuple[float, float, float]:
    """The best frequency of a series and its 95 % interval by likelihood ratio.

    Parameters
    ----------
    x, y : ndarray, shape (r,)
        Joint angles and angular errors, radians.
    covariance : ndarray, shape (r, r)
        Of ``y``.
    beside : ndarray, shape (r, k)
        Columns that are fitted beside the series, such as its constant.
    order : int
    tried : ndarray
        Frequencies among which the best was looked for, periods per turn, ascending.
    best : float
        Near the best.
    freedom : int
        Degrees of freedom of the scale of ``covariance``.

    Returns
    -------
    found, low, high : float
        Periods per turn. Where nothing refuses the smallest frequency, ``low`` is 0; ``high`` ends at the largest that
        the steps between the angles allow.
    """
    from scipy.optimize import brentq, minimize_scalar

    root = np.linalg.cholesky(covariance)
    z, Z = np.linalg.solve(root, y), np.linalg.solve(root, beside)

    def misfit(f: float) -> float:
        M = np.column_stack([Z, np.linalg.solve(root, fourier_columns(x, order, f))])
        Q, R = np.linalg.qr(M)
        size = np.abs(np.diag(R))
        Q = Q[:, size > 1e-9 * size.max()]
        left = z - Q @ (Q.T @ z)
        return float(left @ left)

    step, highest = float(tried[1] - tried[0]), float(max(tried[-1], best))
    bounds = (max(LEAST, best - 0.5 * step), min(highest, best + 0.5 * step))
    nearest = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    found = float(nearest.x) if nearest.fun <= misfit(best) else best
    limit = misfit(found) + quantile(freedom) ** 2

    def over(f: float) -> float:
        return misfit(f) - limit

    accepted = [float(f) for f in tried if over(f) <= 0.0]
    for ratio in sorted({k / m for k in range(1, order + 1) for m in range(1, order + 1)} - {1.0}):
        near = ratio * found  # harmonics of the one may be those of the other
        ends = (max(LEAST, near - 0.5 * step), min(highest, near + 0.5 * step))
        if ends[0] < ends[1]:
            other = minimize_scalar(misfit, bounds=ends, method="bounded", options={"xatol": 1e-7})
            accepted += [float(other.x)] if other.fun <= limit else []
    low, high = min([found, *accepted]), max([found, *accepted])
    first = _scale(misfit, found, limit, step)
    return found, _end(over, low, -first, LEAST, brentq), _end(over, high, first, highest, brentq)


def _scale(misfit: Callable[[float], float], found: float, limit: float, step: float) -> float:
    """A step that is of the size of the interval, from the curvature at the best frequency."""
    h = 1e-3 * step
    bend = (misfit(found + h) + misfit(found - h) - 2 * misfit(found)) / h**2
    return min(step, np.sqrt(2 * (limit - misfit(found)) / bend) / 2) if bend > 0 else step


def _end(over: Callable[[float], float], start: float, step: float, last: float, root: Callable[..., float]) -> float:
    """Where an accepted frequency's interval ends in the direction of a step, at last at ``last`` (below: 0)."""
    inner = start
    while True:
        outer = inner + step
        if (outer - last) * step >= 0:
            return (0.0 if step < 0 else last) if over(last) <= 0 else float(root(over, inner, last, xtol=1e-9))
        if over(outer) > 0:
            return float(root(over, inner, outer, xtol=1e-9))
        inner, step = outer, WIDER * step
