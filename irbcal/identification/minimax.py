r"""The smallest possible largest distance between measured and predicted points, with a proof of how small it can be.

The objective is that of Nubiola 2011, eqs. 3.35 and 3.36: the largest distance over all rows. Around a state
it is replaced by its convex model, with ``A_j`` the derivative of prediction ``j`` along the seen directions::

    model(y) = max_j |r_j - A_j y|

The model's minimum is a second-order cone program. Its step is taken (shortened where the true distances do not
follow), and the model is made again at the new state. The proof comes with it: for any vectors ``w_j`` of three
components with ``sum_j A_j^T w_j = 0`` and ``sum_j |w_j| = 1``, the model is nowhere below ``sum_j w_j . r_j``,
because it is at least ``sum_j w_j . (r_j - A_j y)`` for every ``y``. A state is accepted when such a bound
of the model made at that very state is within the tolerance of the largest distance there.

The bound speaks of the model: of all small moves along directions that the data show. Held directions stay where
least squares left them.

Nelder-Mead on the largest distance, as Nubiola 2011 ran it (sections 3.5, 7.3 and 7.5).

It uses no derivatives and proves nothing: after the thesis' 2,000 iterations it has stopped early, not converged
(`irbcal.identification.minimax` gives the minimum). It is kept so that results can be compared.

It moves all unknowns of the problem: base, targets and every error parameter, held directions included, as the
thesis did. Each unknown is counted in plausible sizes: the error parameters' own, and for base and targets those
of a length and an angle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, row_arithmetic
from irbcal.errors import IdentificationError
from irbcal.identification.least_squares import RecordStep, Solution, distances, largest, line_search, note
from irbcal.identification.problem import Problem, S, State, VectorProblem
from irbcal.units import DEG, MM

CONE_ITERATIONS = 60


def largest_distance(residuals: FloatArray) -> float:
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
def solve_cone(r: FloatArray, Q: FloatArray, tolerance: float = 1e-5) -> tuple[FloatArray, FloatArray]:
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
    unit = largest_distance(r)
    r = np.ascontiguousarray(r.T) / unit
    A = np.ascontiguousarray(Q.reshape(m, 3, n).transpose(2, 1, 0))
    flat_A = A.reshape(n, 3 * m)
    x = np.append(np.zeros(n), 1.5)  # z and t of the program
    s, z = np.empty((4, m)), np.zeros((4, m))
    z[0] = 1.0 / m
    for _ in range(CONE_ITERATIONS):
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
    stack = np.empty((n, 4, m))
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
    scaled = _scaled(v, 1.0 / beta, q, -1.0)
    dx = inverse @ (np.append(-(flat_A @ scaled[1:].ravel()), scaled[0].sum()) - drift)
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
    residual = step[1:] - ((lead + step[0]) / (x[0] + 1.0)) * x[1:]
    reach = ((np.sqrt(_dot(residual, residual)) - lead) / size).max()
    return float(1.0 / reach) if reach > 0 else np.inf


TOLERANCE = 1e-4
"""Accepted gap between largest distance and lower bound, relative."""

FLOOR = 1e-9
"""Metres; a gap below this is closed, whatever the largest distance."""

MOST_POSES, ADDED = 5000, 1000
"""Poses that are solved for at once, and of more how many with the largest distances at first and at a time."""

MAX_ITERATIONS = 50


def solve(
    problem: VectorProblem[S],
    solution: Solution[S],
    start: S | None = None,
    tolerance: float = TOLERANCE,
    record: RecordStep[S] | None = None,
) -> Solution[S]:
    """Minimise the largest distance (Nubiola 2011, eqs. 3.35 and 3.36), with a certificate.

    Parameters
    ----------
    problem : VectorProblem
        All its rows count alike: the uncertainties of the points are not used.
    solution : Solution
        Gives the seen directions and, unless ``start`` is given, the start.
    start : optional
        State of the problem.
    tolerance : float
        Relative gap between largest distance and lower bound to reach.
    record : callable, optional
        Called with (iteration, state) for the start and after each step, see `irbcal.identification.least_squares`.

    Raises
    ------
    IdentificationError
        If the gap cannot be reached.
    """
    state = solution.state if start is None else start
    basis = solution.information.basis()
    r = problem.residuals(state)
    if isinstance(problem, Problem) and len(r) > MOST_POSES and problem.poses > MOST_POSES:
        return _by_parts(problem, solution, state, tolerance, record)
    value = largest_distance(r)
    history: list[float] = []
    note(history, value, state, record)
    w: FloatArray | None = None
    for iteration in range(MAX_ITERATIONS + 1):
        Q, to_columns = _orthonormal(problem.jacobian(state) @ basis, 1e-3 * np.sqrt(np.mean(r**2)))
        # the multipliers of the last model often prove this one too, which saves the solution of one more
        w, bound = certificate(r, Q, w)
        if not _closed(value, bound, tolerance):
            z, w = solve_cone(r, Q, 0.1 * tolerance)
            w, bound = certificate(r, Q, w)
        if _closed(value, bound, tolerance):
            return Solution(
                state,
                solution.information,
                problem.rss(state),
                value,
                iteration,
                tuple(history),
                lower_bound=bound,
                multipliers=w,
            )
        moved = _shortened(problem, state, basis @ (to_columns @ z), value, bound)
        if moved is None:
            break
        state, r = moved
        value = largest_distance(r)
        note(history, value, state, record)
    raise IdentificationError(
        f"the largest distance stopped at {1e3 * value:.6g} mm, where only {1e3 * bound:.6g} mm are proved to be "
        "needed: start from a least-squares fit of the same points or allow a larger tolerance"
    )


def _by_parts(
    problem: Problem, solution: Solution[Any], state: Any, tolerance: float, record: RecordStep[Any] | None
) -> Solution[Any]:
    """The same for many poses: for those with the largest distances, and others as they come to be the largest.

    What some of the points need at least all need at least: the bound of the part is one of the whole.
    """
    points, r_before, iterations = problem.points, problem.residuals(state), 0
    first = largest_distance(r_before)
    rows = np.concatenate([points.pose, points.pose[points.oriented()]])
    chosen = _farthest(r_before, rows, points.poses, np.zeros(points.poses, dtype=bool))
    while True:
        subset = solve(problem.of_poses(chosen), solution, state, tolerance, record)
        state, iterations = subset.state, iterations + subset.iterations
        r = problem.residuals(state)
        value, bound = largest_distance(r), subset.lower_bound or 0.0
        if _closed(value, bound, tolerance) or chosen.sum() > MOST_POSES - ADDED:
            break
        chosen = _farthest(r, rows, points.poses, chosen)
    if not _closed(value, bound, tolerance):
        raise IdentificationError(
            f"the largest distance is {1e3 * value:.6g} mm, but only {1e3 * bound:.6g} mm are proved to be "
            f"needed by the {int(chosen.sum())} poses with the largest ones: allow a larger tolerance"
        )
    multipliers = np.zeros((problem.rows, 3))
    multipliers[chosen[rows]] = subset.multipliers
    return replace(
        subset,
        rss=problem.rss(state),
        value=value,
        iterations=iterations,
        history=(first, *subset.history[1:-1], value),
        multipliers=multipliers,
    )


def _farthest(r: FloatArray, rows: IntArray, n: int, chosen: BoolArray) -> BoolArray:
    """The poses of a part, and those of the others with the largest distances."""
    worst = np.zeros(n)
    np.maximum.at(worst, rows, np.linalg.norm(r, axis=1))
    worst[chosen] = -1.0
    more = chosen.copy()
    more[np.argpartition(-worst, ADDED)[:ADDED]] = True
    return more


def _orthonormal(A: FloatArray, cut: float) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis of the columns and the matrix that brings its coordinates back to theirs.

    Directions along which a whole unit moves all predictions by less than ``cut`` together are not moved: far from
    the least-squares state there may be such among the seen ones. The second time removes what rounding left.
    """
    to_columns: FloatArray = np.eye(A.shape[1])
    for limit in (cut, 0.0):
        squares, V = np.linalg.eigh(A.T @ A)
        keep = squares > limit**2
        turned = V[:, keep] / np.sqrt(squares[keep])
        A, to_columns = A @ turned, to_columns @ turned
    return A, to_columns


def _closed(value: float, bound: float, tolerance: float) -> bool:
    """Whether the gap between largest distance and lower bound is small enough."""
    return value - bound <= max(tolerance * value, FLOOR)


def _shortened(
    problem: VectorProblem[S], state: S, step: FloatArray, value: float, bound: float
) -> tuple[S, FloatArray] | None:
    """State and residuals after as much of the step as makes the true largest distance follow its model."""

    def trial(share: float) -> tuple[S, FloatArray]:
        moved = problem.moved(state, share * step)
        return moved, problem.residuals(moved)

    return line_search(trial, lambda new, s: largest_distance(new[1]) <= value - 0.1 * s * (value - bound), 1e-6)


ITERATIONS = 2000
"""Iterations of a run (Nubiola 2011, section 7.5)."""

RECORD_EVERY = 10
"""Iterations between two records (Nubiola 2011, section 7.5)."""

LENGTH, ANGLE = 5 * MM, 0.5 * DEG
"""Plausible sizes of the unknowns of base and targets, metres and radians."""

SIMPLEX = 0.05
"""Edge of the first simplex along each unknown, in plausible sizes: 0.25 mm and 0.025 degrees."""


def plausible_sizes(problem: Problem) -> FloatArray:
    """Plausible size of every unknown, shape (unknowns,), metres and radians."""
    return np.concatenate([np.where(problem.turns, ANGLE, LENGTH), problem.scales])


def nelder_mead(
    problem: Problem,
    solution: Solution[State],
    start: State | None = None,
    iterations: int = ITERATIONS,
    objective: Callable[[FloatArray], float] = largest,
    record: RecordStep[State] | None = None,
) -> Solution[State]:
    """Search for a smaller objective without derivatives (Nubiola 2011, sections 3.5 and 7.3).

    Parameters
    ----------
    problem, solution, start
        As `solve`.
    iterations : int
        All of them are used: there is no other end.
    objective : callable
        From distances (rows,) to metres; the largest distance (eq. 3.35) unless given.
    record : callable, optional
        Called with (iteration, state) for the start and every ten iterations, see
        `irbcal.identification.least_squares`.
    """
    from scipy.optimize import minimize

    scale, begin = plausible_sizes(problem), solution.state if start is None else start

    def state_at(x: FloatArray) -> State:
        return problem.moved(begin, scale * x)

    def function(x: FloatArray) -> float:
        return objective(distances(problem, state_at(x)))

    history = [function(np.zeros(len(scale)))]
    count = 0
    if record:
        record(0, begin)

    def callback(intermediate_result: Any) -> None:
        nonlocal count
        count += 1
        if count % RECORD_EVERY == 0:
            history.append(float(intermediate_result.fun))
            if record:
                record(count, state_at(intermediate_result.x))

    first = np.vstack([np.zeros(len(scale)), SIMPLEX * np.eye(len(scale))])
    # scipy counts the first simplex as an iteration
    options = {"maxiter": iterations + 1, "xatol": 0.0, "fatol": 0.0, "initial_simplex": first}
    result = minimize(function, first[0], method="Nelder-Mead", callback=callback, options=options)
    state, evaluations = state_at(result.x), int(result.nfev) + 1
    information, rss = solution.information, problem.rss(state)
    return Solution(state, information, rss, float(result.fun), count, tuple(history), evaluations=evaluations)
