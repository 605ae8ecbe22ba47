"""The convex model of the largest distance: its minimum, and bounds that prove it.

With ``r_j`` a residual and ``Q_j`` its derivative, ``max_j |r_j - Q_j z|`` over ``z`` is a second-order cone program.
`solve` is a primal-dual interior-point method in numpy alone, `solve_with_clarabel` the same by a general solver;
`certificate` turns any approximate multipliers into a true lower bound.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from irbcal.arrays import FloatArray, aligned, row_arithmetic
from irbcal.identification.choices import ConeSolver

MAX_ITERATIONS = 60


def largest(residuals: FloatArray) -> float:
    """Largest distance of residuals (rows, 3) (Nubiola 2011, eqs. 3.35 and 3.36), metres."""
    return float(np.sqrt(np.einsum("jk,jk->j", residuals, residuals).max()))


def certificate(r: FloatArray, Q: FloatArray, w: FloatArray | None = None) -> tuple[FloatArray, float]:
    """A true lower bound of ``max_j |r_j - Q_j z|`` over all ``z`` from approximate multipliers.

    Parameters
    ----------
    r : ndarray, shape (rows, 3)
        Residuals, metres.
    Q : ndarray, shape (3 rows, rank)
        Derivatives with orthonormal columns.
    w : ndarray, shape (rows, 3), optional
        Approximate multipliers; the residuals themselves unless given.

    Returns
    -------
    w : ndarray, shape (rows, 3)
        Multipliers with ``Q^T w = 0`` and ``sum |w_j| = 1``; zeros where there are none.
    bound : float
        Metres.
    """
    if w is None:
        w = r
    else:
        # first move mainly those that carry weight: a change across the residual hardly costs bound there
        share = np.repeat(np.linalg.norm(w, axis=1), 3)
        share = np.maximum(share / max(share.max(), 1e-300), 1e-8)
        w = w.ravel() - share * (Q @ np.linalg.solve(Q.T @ (share[:, None] * Q), Q.T @ w.ravel()))
    w = w.ravel()
    for _ in range(2):  # the second time removes what rounding left
        w = w - Q @ (Q.T @ w)
    w = w.reshape(r.shape)
    total = np.linalg.norm(w, axis=1).sum()
    if not total:
        return np.zeros_like(r), 0.0
    w = w / total
    return w, max(float(np.vdot(w, r)), 0.0)


@row_arithmetic()
def solve(r: FloatArray, Q: FloatArray, tolerance: float = 1e-5) -> tuple[FloatArray, FloatArray]:
    """Minimum of ``max_j |r_j - Q_j z|`` over ``z`` by a primal-dual interior-point method.

    With ``t`` above all distances, ``s_j = (t, r_j - Q_j z)`` lies in the second-order cone, and so does the
    multiplier ``(lambda_j, w_j)``. Both sides have strictly feasible starts, so that every iterate is a bound. Steps
    are those of Mehrotra with the scaling of Nesterov and Todd, in the notation of Vandenberghe, "The CVXOPT linear
    and quadratic cone program solvers" (2010).

    Parameters
    ----------
    r : ndarray, shape (rows, 3)
        Metres.
    Q : ndarray, shape (3 rows, n)
        Orthonormal columns.
    tolerance : float
        Relative gap between minimum and bound at which to stop.

    Returns
    -------
    z : ndarray, shape (n,)
    w : ndarray, shape (rows, 3)
        Multipliers; `certificate` makes a bound of them.
    """
    m, n = len(r), Q.shape[1]
    unit = largest(r)
    r = np.ascontiguousarray(r.T) / unit
    A = np.ascontiguousarray(Q.reshape(m, 3, n).transpose(2, 1, 0))
    flat_A = A.reshape(n, 3 * m)
    x = np.append(np.zeros(n), 1.5)  # z and t of the program
    s, z = np.empty((4, m)), np.zeros((4, m))
    z[0] = 1.0 / m
    for _ in range(MAX_ITERATIONS):
        s[0], s[1:] = x[n], r - (x[:n] @ flat_A).reshape(3, m)
        gap = float(np.vdot(s, z))
        if gap <= tolerance * max(float(x[n]) - gap, tolerance):
            break
        v, beta = _scaling(s, z)
        lam = _scaled(v, beta, z)
        inverse = np.asarray(np.linalg.inv(_normal_matrix(v, beta, A)), dtype=np.float64)
        # what rounding left of the equality constraints; without its correction the multipliers drift
        drift = np.append(flat_A @ z[1:].ravel(), 1.0 - z[0].sum())
        newton = partial(_newton, v, beta, flat_A, inverse, drift)
        _, ds, dz = newton(-lam)
        reach = min(1.0, _to_boundary(lam, ds), _to_boundary(lam, dz))
        right = -_product(lam, lam) - _product(ds, dz)
        right[0] += (1.0 - reach) ** 3 * gap / m
        dx, ds, dz = newton(_quotient(lam, right))
        alpha = min(1.0, 0.99 * min(_to_boundary(lam, ds), _to_boundary(lam, dz)))
        x = x + alpha * dx
        z = z + alpha * _scaled(v, 1.0 / beta, dz, -1.0)
    return unit * x[:n], -z[1:].T


def _normal_matrix(v: FloatArray, beta: FloatArray, A: FloatArray) -> FloatArray:
    """Sum of the scaled cones' normal matrices in (y, t), from derivatives A (n, 3, m).

    Each is ``beta^-2 (2 g g^T - G^T diag(1, -1, -1, -1) G)`` with ``g = G^T (v0, -v1)``.
    """
    n, _, m = A.shape
    stack = aligned(n, 4, m)
    a, scale = stack[:, 3], 1.0 / beta
    np.multiply(A[:, 0], v[1], out=a)
    for k in (1, 2):
        np.add(a, np.multiply(A[:, k], v[k + 1], out=stack[:, 0]), out=a)
    bent = a @ (2.0 * v[0] * scale**2)
    np.multiply(A, scale, out=stack[:, :3])
    np.multiply(a, np.sqrt(2.0) * scale, out=a)
    flat = stack.reshape(n, 4 * m)
    H = np.empty((n + 1, n + 1))
    H[:n, :n] = flat @ flat.T
    H[:n, n] = H[n, :n] = bent
    H[n, n] = np.sum((2.0 * v[0] ** 2 - 1.0) * scale**2)
    return H


def _newton(
    v: FloatArray, beta: FloatArray, flat_A: FloatArray, inverse: FloatArray, drift: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step of (y, t), and of s and z in scaled coordinates, for the right-hand side ``W dz + W^-1 ds = q``."""
    m, n = len(beta), len(flat_A)
    back = _scaled(v, 1.0 / beta, q, -1.0)
    dx = inverse @ (np.append(-(flat_A @ back[1:].ravel()), back[0].sum()) - drift)
    Gdx = np.concatenate([np.full(m, -dx[n]), dx[:n] @ flat_A]).reshape(4, m)
    dz = _scaled(v, 1.0 / beta, Gdx, -1.0) + q
    return dx, q - dz, dz


def _dot(x: FloatArray, y: FloatArray) -> FloatArray:
    """Scalar product column by column."""
    return np.asarray(np.add.reduce(x * y, axis=0))


def _cone_norm(x: FloatArray) -> FloatArray:
    """Root of ``x0^2 - |x1|^2``, written so that it stays positive near the cone's boundary."""
    length = np.sqrt(_dot(x[1:], x[1:]))
    return np.sqrt(np.maximum((x[0] - length) * (x[0] + length), 1e-300))


def _scaling(s: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Point and size of the scaling ``W`` of Nesterov and Todd: ``W z = W^-1 s``."""
    size_s, size_z = _cone_norm(s), _cone_norm(z)
    s, z = s / size_s, z / size_z
    v = s - z
    v[0] += 2.0 * z[0]
    return v / np.sqrt(2.0 + 2.0 * _dot(s, z)), np.sqrt(size_s / size_z)


def _scaled(v: FloatArray, beta: FloatArray, x: FloatArray, sign: float = 1.0) -> FloatArray:
    """``W x``; its inverse with sign -1 and 1/beta."""
    dot = sign * _dot(v[1:], x[1:])
    out = np.empty_like(x)
    out[0] = v[0] * x[0] + dot
    out[1:] = x[1:] + (sign * x[0] + dot * sign / (1.0 + v[0])) * v[1:]
    out *= beta
    return out


def _product(x: FloatArray, y: FloatArray) -> FloatArray:
    """Jordan product of the second-order cone, column by column."""
    out = x[0] * y + y[0] * x
    out[0] = _dot(x, y)
    return out


def _quotient(x: FloatArray, b: FloatArray) -> FloatArray:
    """The ``y`` with ``_product(x, y) = b``."""
    first = (x[0] * b[0] - _dot(x[1:], b[1:])) / _cone_norm(x) ** 2
    out = (b - first * x) / x[0]
    out[0] = first
    return out


def _to_boundary(x: FloatArray, step: FloatArray) -> float:
    """Largest factor by which all columns may be stepped inside the cone."""
    size = _cone_norm(x)
    x = x / size
    lead = x[0] * step[0] - _dot(x[1:], step[1:])
    rest = step[1:] - ((lead + step[0]) / (x[0] + 1.0)) * x[1:]
    reach = ((np.sqrt(_dot(rest, rest)) - lead) / size).max()
    return float(1.0 / reach) if reach > 0 else np.inf


def solve_with_clarabel(r: FloatArray, Q: FloatArray, tolerance: float = 1e-5) -> tuple[FloatArray, FloatArray]:
    """As `solve`, by the general solver clarabel, which has to be installed."""
    import clarabel
    from scipy import sparse

    m, n = len(r), Q.shape[1]
    unit = largest(r)
    G = np.zeros((m, 4, n + 1))
    G[:, 0, n] = -1.0
    G[:, 1:, :n] = Q.reshape(m, 3, n)
    h = np.column_stack([np.zeros(m), r / unit]).ravel()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = min(tolerance, 1e-8)
    cones = [clarabel.SecondOrderConeT(4)] * m
    objective = np.append(np.zeros(n), 1.0)
    program = (sparse.csc_matrix((n + 1, n + 1)), objective, sparse.csc_matrix(G.reshape(4 * m, n + 1)), h, cones)
    found = clarabel.DefaultSolver(*program, settings).solve()
    return unit * np.array(found.x)[:n], -np.array(found.z).reshape(m, 4)[:, 1:]


SOLVERS: dict[ConeSolver, Callable[[FloatArray, FloatArray, float], tuple[FloatArray, FloatArray]]] = {
    "numpy": solve,
    "clarabel": solve_with_clarabel,
}
