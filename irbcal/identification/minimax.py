r"""The smallest possible largest distance between measured and predicted points, with a proof of how small it can be.

The objective is that of Nubiola 2011, eqs. 3.35 and 3.36: the largest distance over all rows. Around a state
it is replaced by its convex model, with ``A_j`` the derivative of prediction ``j`` along the seen directions::

    model(y) = max_j |r_j - A_j y|

The model's minimum is a second-order cone program. Its step is taken (shortened where the true distances do not
follow), and the model is made anew at the new state. The proof comes with it: for any vectors ``w_j`` of three
components with ``sum_j A_j^T w_j = 0`` and ``sum_j |w_j| = 1``, the model is nowhere below ``sum_j w_j . r_j``,
because it is at least ``sum_j w_j . (r_j - A_j y)`` for every ``y``. A state is accepted when such a bound
of the model made at that very state is within the tolerance of the largest distance there.

The bound speaks of the model: of all small moves along directions that the data show. Held directions stay where
least squares left them.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification.observability import Information
from irbcal.identification.residuals import State

TOLERANCE = 1e-4
"""Accepted gap between largest distance and lower bound, relative."""

FLOOR = 1e-9
"""Metres; a gap below this is closed, whatever the largest distance."""

MAX_ITERATIONS = 50
MAX_CONE_ITERATIONS = 60
SUPPORT = 1e-3
"""Share of all multipliers above which a row counts as carrying weight."""


@dataclass(frozen=True, eq=False)
class Minimax:
    """Outcome of a minimax fit.

    Attributes
    ----------
    state : State
    information : Information
        Of the least-squares fit: the directions along which the state was moved.
    value : float
        Largest distance at ``state``, metres.
    lower_bound : float
        No small move along the seen directions brings the largest distance below this, metres.
    gap : float
        ``(value - lower_bound) / value``; 0 where the value is 0.
    iterations : int
        Convex models solved.
    history : list of float
        Largest distance at the start and after each iteration, metres.
    support : ndarray of int
        Rows that carry weight in the bound, in rising order.
    multipliers : ndarray, shape (rows, 3)
        The vectors ``w_j`` that prove the bound.
    """

    state: State
    information: Information
    value: float
    lower_bound: float
    gap: float
    iterations: int
    history: list
    support: np.ndarray
    multipliers: np.ndarray


def solve(problem, solution, start=None, tolerance=TOLERANCE, inner="numpy", record=None):
    """Minimise the largest distance (Nubiola 2011, eq. 3.35), with a certificate.

    Parameters
    ----------
    problem : Problem
        All its rows count alike: the uncertainties of the points are not used.
    solution : least_squares.Solution
        Gives the seen directions and, unless ``start`` is given, the start.
    start : State, optional
    tolerance : float
        Relative gap between largest distance and lower bound to reach.
    inner : str
        Solver of the convex models: ``numpy`` (`cone_program`) or ``clarabel``.
    record : callable, optional
        Called with (iteration, state) for the start and after each step, see `irbcal.identification.history`.

    Returns
    -------
    Minimax

    Raises
    ------
    IdentificationError
        If the gap cannot be reached or there is no such solver.
    """
    solvers = {"numpy": cone_program, "clarabel": cone_program_clarabel}
    if inner not in solvers:
        raise IdentificationError(f"unknown solver {inner!r} of the convex models: choose one of {', '.join(solvers)}")
    state = solution.state if start is None else start
    basis = solution.information.basis()
    r = problem.residuals(state)
    value = largest(r)
    history, w = [value], None
    if record:
        record(0, state)
    for iteration in range(MAX_ITERATIONS + 1):
        Q, back = _orthonormal(problem.jacobian(state) @ basis, 1e-3 * np.sqrt(np.mean(r**2)))
        # the multipliers of the last model often prove this one too, which saves the solution of one more
        w, bound = certificate(r, Q, w)
        if not _closed(value, bound, tolerance):
            z, w = solvers[inner](r, Q, 0.1 * tolerance)
            w, bound = certificate(r, Q, w)
        if _closed(value, bound, tolerance):
            gap = max(value - bound, 0.0) / value if value else 0.0
            support = np.flatnonzero(np.linalg.norm(w, axis=1) > SUPPORT)
            return Minimax(state, solution.information, value, bound, gap, iteration, history, support, w)
        state, r, moved = _shortened(problem, state, basis @ (back @ z), value, bound)
        if not moved:
            break
        value = largest(r)
        history.append(value)
        if record:
            record(iteration + 1, state)
    raise IdentificationError(
        f"the largest distance stopped at {1e3 * value:.6g} mm, where only {1e3 * bound:.6g} mm are proved to be "
        "needed: start from a least-squares fit of the same points or allow a larger tolerance"
    )


def largest(residuals):
    """Largest distance of residuals (rows, 3), metres."""
    return float(np.sqrt(np.einsum("jk,jk->j", residuals, residuals).max()))


def certificate(r, Q, w=None):
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


def _orthonormal(A, cut):
    """Orthonormal basis of the columns and the matrix that brings its coordinates back to theirs.

    Directions along which a whole unit moves all predictions by less than ``cut`` together are not moved: far from
    the least-squares state there may be such among the seen ones.
    """
    Q, R = np.linalg.qr(A)
    U, size, Vt = np.linalg.svd(R)
    keep = size > cut
    return Q @ U[:, keep], Vt[keep].T / size[keep]


def _closed(value, bound, tolerance):
    return value - bound <= max(tolerance * value, FLOOR)


def _shortened(problem, state, step, value, bound):
    """State and residuals after as much of the step as makes the true largest distance follow its model."""
    size = 1.0
    while size > 1e-6:
        moved = problem.moved(state, size * step)
        r = problem.residuals(moved)
        if largest(r) <= value - 0.1 * size * (value - bound):
            return moved, r, True
        size *= 0.5
    return state, problem.residuals(state), False


def cone_program(r, Q, tolerance=1e-5):
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
    A = np.ascontiguousarray(Q.reshape(m, 3, n).transpose(1, 0, 2))
    flat_A, stack = A.reshape(3 * m, n), np.empty((4, m, n))
    y, t = np.zeros(n), 1.5
    s, z = np.empty((4, m)), np.zeros((4, m))
    z[0] = 1.0 / m
    for _ in range(MAX_CONE_ITERATIONS):
        s[0], s[1:] = t, r - (flat_A @ y).reshape(3, m)
        gap = np.vdot(s, z)
        if gap <= tolerance * max(t - gap, tolerance):
            break
        v, beta = _scaling(s, z)
        lam = _scaled(v, beta, z)
        # sum of the scaled cones' normal matrices: beta^-2 (2 g g^T - G^T diag(1, -1, -1, -1) G), g = G^T (v0, -v1)
        a = np.einsum("kj,kjn->jn", v[1:], A)
        np.divide(A, beta[:, None], out=stack[:3])
        np.multiply(a, (np.sqrt(2.0) / beta)[:, None], out=stack[3])
        flat = stack.reshape(4 * m, n)
        H = np.empty((n + 1, n + 1))
        H[:n, :n] = flat.T @ flat
        H[:n, n] = H[n, :n] = (2.0 * v[0] / beta**2) @ a
        H[n, n] = np.sum((2.0 * v[0] ** 2 - 1.0) / beta**2)
        inverse = np.linalg.inv(H)
        # what rounding left of the equality constraints; without its correction the multipliers drift
        drift = np.append(z[1:].ravel() @ flat_A, 1.0 - z[0].sum())

        def newton(q, v=v, beta=beta, inverse=inverse, drift=drift):
            """Step of (y, t), and of s and z in scaled coordinates, for the right-hand side ``W dz + W^-1 ds = q``."""
            back = _scaled(v, 1.0 / beta, q, -1.0)
            dx = inverse @ (np.append(-(back[1:].ravel() @ flat_A), back[0].sum()) - drift)
            Gdx = np.concatenate([np.full(m, -dx[n]), flat_A @ dx[:n]]).reshape(4, m)
            dz = _scaled(v, 1.0 / beta, Gdx, -1.0) + q
            return dx, q - dz, dz

        _, ds, dz = newton(-lam)
        alpha = min(1.0, _to_boundary(lam, ds), _to_boundary(lam, dz))
        right = -_product(lam, lam) - _product(ds, dz)
        right[0] += (1.0 - alpha) ** 3 * gap / m
        dx, ds, dz = newton(_quotient(lam, right))
        alpha = min(1.0, 0.99 * min(_to_boundary(lam, ds), _to_boundary(lam, dz)))
        y, t = y + alpha * dx[:n], t + alpha * dx[n]
        z = z + alpha * _scaled(v, 1.0 / beta, dz, -1.0)
    return unit * y, -z[1:].T


def _dot(x, y):
    return np.einsum("kj,kj->j", x, y)


def _cone_norm(x):
    """Root of ``x0^2 - |x1|^2``, written so that it stays positive near the cone's boundary."""
    length = np.sqrt(_dot(x[1:], x[1:]))
    return np.sqrt(np.maximum((x[0] - length) * (x[0] + length), 1e-300))


def _scaling(s, z):
    """Point and size of the scaling ``W`` of Nesterov and Todd: ``W z = W^-1 s``."""
    size_s, size_z = _cone_norm(s), _cone_norm(z)
    s, z = s / size_s, z / size_z
    v = s - z
    v[0] += 2.0 * z[0]
    return v / np.sqrt(2.0 + 2.0 * _dot(s, z)), np.sqrt(size_s / size_z)


def _scaled(v, beta, x, sign=1.0):
    """``W x``; its inverse with sign -1 and 1/beta."""
    dot = sign * _dot(v[1:], x[1:])
    out = np.empty_like(x)
    out[0] = v[0] * x[0] + dot
    out[1:] = x[1:] + (sign * x[0] + dot * sign / (1.0 + v[0])) * v[1:]
    out *= beta
    return out


def _product(x, y):
    """Jordan product of the second-order cone, column by column."""
    out = x[0] * y + y[0] * x
    out[0] = _dot(x, y)
    return out


def _quotient(x, b):
    """The ``y`` with ``_product(x, y) = b``."""
    first = (x[0] * b[0] - _dot(x[1:], b[1:])) / _cone_norm(x) ** 2
    out = (b - first * x) / x[0]
    out[0] = first
    return out


def _to_boundary(x, step):
    """Largest factor by which all columns may be stepped inside the cone."""
    size = _cone_norm(x)
    x = x / size
    lead = x[0] * step[0] - _dot(x[1:], step[1:])
    rest = step[1:] - ((lead + step[0]) / (x[0] + 1.0)) * x[1:]
    reach = ((np.sqrt(_dot(rest, rest)) - lead) / size).max()
    return 1.0 / reach if reach > 0 else np.inf


def cone_program_clarabel(r, Q, tolerance=1e-5):
    """As `cone_program`, by the general solver clarabel, which has to be installed."""
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
