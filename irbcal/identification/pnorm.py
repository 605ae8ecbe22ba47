r"""Fits between least squares and the largest distance, and fits that gross outliers hardly move.

With ``d_j`` the distance of row ``j`` (Nubiola 2011, eq. 3.36):

===========  ==========================================================================
objective    definition
===========  ==========================================================================
p-norm       ``(mean_j d_j^p)^(1/p)``: root mean square at p = 2, largest distance (eq. 3.35) for p to infinity
``soft_l1``  ``sum_j 2 c^2 (sqrt(1 + d_j^2 / c^2) - 1)``
``huber``    ``sum_j d_j^2`` up to ``d_j = c``, ``2 c d_j - c^2`` beyond
===========  ==========================================================================

All derivatives are analytic. Steps are taken along the directions the data show; held directions stay where
least squares left them.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import observability
from irbcal.identification.history import distances
from irbcal.identification.residuals import State

MAX_ITERATIONS = 200
STEP_TOLERANCE = 1e-9
"""Largest step (metres, radians) after which a fit has converged."""

DECREASE_TOLERANCE = 1e-16
"""Expected relative decrease of the p-th powers below which a p-norm fit has converged, too."""

SCALE = 2 * 1.4826
"""Default ``c`` of the robust losses in medians of the distances; 1.4826 medians of the size of a normal variable are
its standard deviation."""

FLOOR = 1e-9
"""Smallest default ``c``, metres."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Outcome of a fit.

    Attributes
    ----------
    state : State
    information : Information
        The directions along which the state was moved.
    value : float
        Objective at ``state``, metres: the p-norm, or the root of the mean robust loss.
    iterations : int
    history : list of float
        Objective at the start and after each iteration, metres. In a p-norm fit the first stages have a smaller p;
        all values are of the p asked for.
    weights : ndarray, shape (rows,)
        What each row's squared distance counts in the last step, at most 1.
    scale : float or None
        ``c`` of a robust loss, metres.
    """

    state: State
    information: observability.Information
    value: float
    iterations: int
    history: list
    weights: np.ndarray
    scale: float | None = None


def norm(distance, p):
    """Power mean of distances, ``(mean d^p)^(1/p)``, metres."""
    top = distance.max()
    return float(top * np.mean((distance / top) ** p) ** (1.0 / p)) if top else 0.0


def solve(problem, solution, p=8.0, start=None, record=None):
    """Minimise the p-norm of the distances by Newton steps of its convex model.

    Large p are reached through smaller ones, each twice the last.

    Parameters
    ----------
    problem : Problem
        All its rows count alike: the uncertainties of the points are not used.
    solution : least_squares.Solution
        Gives the seen directions and, unless ``start`` is given, the start.
    p : float
        At least 2.
    start : State, optional
    record : callable, optional
        Called with (iteration, state) for the start and after each step, see `irbcal.identification.history`.

    Returns
    -------
    Solution

    Raises
    ------
    IdentificationError
        If p is below 2 or the iteration does not converge.
    """
    if not 2 <= p < np.inf:
        raise IdentificationError(f"the p of a p-norm must be a number from 2 upwards, not {p:g}")
    state = solution.state if start is None else start
    basis = solution.information.basis()
    stages = [p]
    while stages[0] > 4.0:
        stages.insert(0, max(0.5 * stages[0], 2.0))
    history = [norm(distances(problem, state), p)]
    if record:
        record(0, state)
    for stage in stages:
        while True:
            if len(history) > MAX_ITERATIONS:
                raise IdentificationError(f"the fit with p = {stage:g} did not converge in {MAX_ITERATIONS} iterations")
            step, weights, decrease = _newton(problem, state, basis, stage)
            last = decrease < (DECREASE_TOLERANCE if stage == p else 1e-4) or np.abs(step).max() < STEP_TOLERANCE
            value = norm(distances(problem, state), stage)
            state, moved = _line_search(problem, state, step, lambda d, q=stage: norm(d, q), value)
            history.append(norm(distances(problem, state), p))
            if record:
                record(len(history) - 1, state)
            if last or not moved:
                break
    return Solution(state, solution.information, history[-1], len(history) - 1, history, weights)


def _newton(problem, state, basis, p):
    """Newton step of ``sum (d / max d)^p`` without the curvature of the residuals, weights, relative decrease."""
    r = problem.residuals(state)
    d = np.sqrt(np.einsum("jk,jk->j", r, r))
    top = d.max()
    if not top:
        return np.zeros(len(basis)), np.ones(len(r)), 0.0
    weights = (d / top) ** (p - 2.0)
    A = (problem.jacobian(state) @ basis).reshape(len(r), 3, -1)
    along = np.einsum("jk,jkn->jn", r / np.where(d > 0, d, 1.0)[:, None], A)
    stack = np.concatenate([A.transpose(1, 0, 2), np.sqrt(p - 2.0) * along[None]])
    stack = (np.sqrt(weights)[:, None] * stack).reshape(-1, basis.shape[1])
    g = along.T @ (weights * d)
    y = _solved(stack.T @ stack, g)
    return basis @ y, weights, float(g @ y / (weights @ d**2))


def _solved(H, g):
    """Solution of the scaled normal equations with a trace of damping, which shortens no step that matters."""
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    scaled = H / np.outer(size, size)
    return np.linalg.solve(scaled + 1e-12 * np.eye(len(H)), g / size) / size


def _line_search(problem, state, step, objective, value):
    """State after as much of the step as does not raise the objective, and whether there was any."""
    size = 1.0
    while size > 1e-8:
        moved = problem.moved(state, size * step)
        if objective(distances(problem, moved)) <= value * (1 + 1e-13):
            return moved, True
        size *= 0.5
    return state, False


def _soft_l1(u):
    """Loss and its derivative at ``u = d^2 / c^2``."""
    root = np.sqrt(1.0 + u)
    return 2.0 * (root - 1.0), 1.0 / root


def _huber(u):
    root = np.sqrt(np.maximum(u, 1.0))
    return np.where(u <= 1.0, u, 2.0 * root - 1.0), 1.0 / root


LOSSES = {"soft_l1": _soft_l1, "huber": _huber}


def robust(problem, solution, loss="soft_l1", scale=None, start=None, record=None):
    """Minimise a robust loss of the distances by iteratively reweighted Gauss-Newton.

    The distances are multiplied by the rows' weights (`Problem.weights`) as in least squares. Outliers spoil what
    least squares says of the scale and of the directions that the data show, so both are looked at again with
    the robust fit: the default scale follows the median of its distances down, directions are added, and the
    fit goes on.

    Parameters
    ----------
    problem : Problem
    solution : least_squares.Solution
        Gives the seen directions, the default scale and, unless ``start`` is given, the start.
    loss : str
        ``soft_l1`` or ``huber``.
    scale : float, optional
        ``c``, metres; unless given, `SCALE` medians of the distances, first those of least squares.
    start : State, optional
    record : callable, optional
        Called with (iteration, state) for the start and after each step.

    Returns
    -------
    Solution

    Raises
    ------
    IdentificationError
        If there is no such loss, the scale is not positive or the iteration does not converge.
    """
    if loss not in LOSSES:
        raise IdentificationError(f"unknown loss {loss!r}: choose one of {', '.join(LOSSES)}")
    c = _default_scale(problem, solution.state) if scale is None else scale
    if not 0 < c < np.inf:
        raise IdentificationError(f"the scale of a robust loss must be a positive number of metres, not {c:g}")
    state, information = solution.state if start is None else start, solution.information

    def mean_loss(distance):  # with the scale of the moment
        return c * np.sqrt(np.mean(LOSSES[loss]((problem.weights * distance / c) ** 2)[0]))

    history = [float(mean_loss(distances(problem, state)))]
    if record:
        record(0, state)
    while len(history) <= MAX_ITERATIONS:
        basis = information.basis()
        weights = LOSSES[loss]((problem.weights * distances(problem, state) / c) ** 2)[1]
        H, g, rss = problem.normal_equations(state, problem.weights * np.sqrt(weights))
        step = basis @ _solved(basis.T @ H @ basis, basis.T @ g)
        size = np.abs(step).max()
        state, moved = _line_search(problem, state, step, mean_loss, history[-1])
        history.append(float(mean_loss(distances(problem, state))))
        if record:
            record(len(history) - 1, state)
        if size < STEP_TOLERANCE or not moved:
            again = observability.information(problem, H, rss)
            smaller = _default_scale(problem, state) if scale is None else c
            if again.rank <= information.rank and smaller > 0.9 * c:
                return Solution(state, information, history[-1], len(history) - 1, history, weights, c)
            if again.rank > information.rank:
                information = again
            if smaller < 0.9 * c:
                c = smaller
                history[-1] = float(mean_loss(distances(problem, state)))
    raise IdentificationError(f"the fit with the loss {loss} did not converge in {MAX_ITERATIONS} iterations")


def _default_scale(problem, state):
    """Scale of a robust loss from the median of a state's weighted distances, metres."""
    return max(SCALE * float(np.median(problem.weights * distances(problem, state))), FLOOR)
