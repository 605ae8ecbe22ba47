r"""Reweighted fits: p-norms between least squares and the largest distance, and losses that outliers hardly move.

With ``d_j`` the distance of row ``j`` (Nubiola 2011, eq. 3.36) the objective of a p-norm is ``(mean_j d_j^p)^(1/p)``:
the root mean square at p = 2, the largest distance (eq. 3.35) for p to infinity. Of a robust loss, with weighted
distances:

===========  ==========================================================================
loss         definition
===========  ==========================================================================
``soft_l1``  ``sum_j 2 c^2 (sqrt(1 + d_j^2 / c^2) - 1)``
``huber``    ``sum_j d_j^2`` up to ``d_j = c``, ``2 c d_j - c^2`` beyond
===========  ==========================================================================

All derivatives are analytic. Steps are taken along the directions the data show; held directions stay where least
squares left them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError, OptionError
from irbcal.identification import minimax
from irbcal.identification.choices import Goal, RobustLoss
from irbcal.identification.least_squares import (
    RecordStep,
    Solution,
    distances,
    information_of,
    line_search,
    note,
)
from irbcal.identification.problem import S, VectorProblem
from irbcal.option_values import checked

MAX_ITERATIONS = 200
STEP_TOLERANCE = 1e-9
"""Largest step (metres, radians) after which a fit has converged."""

DECREASE_TOLERANCE = 1e-16
"""Expected relative decrease of the p-th powers below which a p-norm fit has converged, too."""


def norm(distance: FloatArray, p: float) -> float:
    """Power mean of distances, ``(mean d^p)^(1/p)``, metres."""
    top = distance.max()
    return float(top * np.mean((distance / top) ** p) ** (1.0 / p)) if top else 0.0


def solve(
    problem: VectorProblem[S], solution: Solution[S], goal: Goal, record: RecordStep[S] | None = None
) -> Solution[S]:
    """Another objective's minimum near that of least squares.

    Parameters
    ----------
    problem, solution, record
        As `irbcal.identification.minimax.solve`.
    goal : Goal
        Not least squares.

    Raises
    ------
    IdentificationError
        If the solver does not converge.
    """
    if goal.objective == "max":
        return minimax.solve(problem, solution, record=record)
    if goal.objective == "pnorm":
        return solve_p_norm(problem, solution, goal.power, record=record)
    assert goal.loss != "linear"
    return solve_loss(problem, solution, goal.loss, record=record)


def solve_p_norm(
    problem: VectorProblem[S],
    solution: Solution[S],
    p: float = 8.0,
    start: S | None = None,
    record: RecordStep[S] | None = None,
) -> Solution[S]:
    """Minimise the p-norm of the distances by Newton steps of its convex model.

    Large p are reached through smaller ones, each twice the last.

    Parameters
    ----------
    problem, solution, start, record
        As `irbcal.identification.minimax.solve`.
    p : float
        At least 2.

    Raises
    ------
    OptionError
        If p is below 2.
    IdentificationError
        If the iteration does not converge.
    """
    if not 2 <= p < np.inf:
        raise OptionError(f"the p of a p-norm must be a number from 2 upwards, not {p:g}", parameter="power")
    state = solution.state if start is None else start
    basis = solution.information.basis()
    stages = [p]
    while stages[0] > 4.0:
        stages.insert(0, max(0.5 * stages[0], 2.0))
    history: list[float] = []
    note(history, norm(distances(problem, state), p), state, record)
    for stage in stages:
        while True:
            if len(history) > MAX_ITERATIONS:
                raise IdentificationError(f"the fit with p = {stage:g} did not converge in {MAX_ITERATIONS} iterations")
            step, weights, decrease = _newton(problem, state, basis, stage)
            last = decrease < (DECREASE_TOLERANCE if stage == p else 1e-4) or np.abs(step).max() < STEP_TOLERANCE
            value = norm(distances(problem, state), stage)
            moved = _lowered(problem, state, step, partial(norm, p=stage), value)
            state = moved or state
            note(history, norm(distances(problem, state), p), state, record)
            if last or not moved:
                break
    rss, count = problem.rss(state), len(history) - 1
    return Solution(state, solution.information, rss, history[-1], count, tuple(history), weights)


def _newton(problem: VectorProblem[S], state: S, basis: FloatArray, p: float) -> tuple[FloatArray, FloatArray, float]:
    """Newton step of ``sum (d / max d)^p`` without the curvature of the residuals, weights, relative decrease."""
    r = problem.residuals(state)
    d = np.sqrt(np.einsum("jk,jk->j", r, r))
    top = d.max()
    if not top:
        return np.zeros(len(basis)), np.ones(len(r)), 0.0
    weights = (d / top) ** (p - 2.0)
    unit = r / np.where(d > 0, d, 1.0)[:, None]
    H, g = np.zeros((basis.shape[1], basis.shape[1])), np.zeros(basis.shape[1])
    for rows, J in problem.jacobian_blocks(state):
        A = (J.reshape(-1, len(basis)) @ basis).reshape(len(rows), 3, -1)
        along = np.einsum("jk,jkn->jn", unit[rows], A)
        stack = np.concatenate([A.transpose(1, 0, 2), np.sqrt(p - 2.0) * along[None]])
        stack = (np.sqrt(weights[rows])[:, None] * stack).reshape(-1, basis.shape[1])
        H += stack.T @ stack
        g += along.T @ (weights[rows] * d[rows])
    y = solved(H, g)
    return basis @ y, weights, float(g @ y / (weights @ d**2))


def solved(H: FloatArray, g: FloatArray) -> FloatArray:
    """Solution of the scaled normal equations with a trace of damping, which shortens no step that matters."""
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    scaled = H / np.outer(size, size)
    return np.linalg.solve(scaled + 1e-12 * np.eye(len(H)), g / size) / size


def _lowered(
    problem: VectorProblem[S], state: S, step: FloatArray, objective: Callable[[FloatArray], float], value: float
) -> S | None:
    """State after as much of the step as does not raise the objective; None where there is none."""
    return line_search(
        lambda share: problem.moved(state, share * step),
        lambda moved, _: objective(distances(problem, moved)) <= value * (1 + 1e-13),
        1e-8,
    )


LOSS_SCALE = 2 * 1.4826
"""Default ``c`` of the robust losses in medians of the distances; 1.4826 medians of the size of a normal variable are
its standard deviation."""

LOSS_FLOOR = 1e-9
"""Smallest default ``c``, metres."""


def _soft_l1(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Loss and its derivative at ``u = d^2 / c^2``."""
    root = np.sqrt(1.0 + u)
    return 2.0 * (root - 1.0), 1.0 / root


def _huber(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Loss and its derivative at ``u = d^2 / c^2``."""
    root = np.sqrt(np.maximum(u, 1.0))
    return np.where(u <= 1.0, u, 2.0 * root - 1.0), 1.0 / root


LOSSES: dict[RobustLoss, Callable[[FloatArray], tuple[FloatArray, FloatArray]]] = {"soft_l1": _soft_l1, "huber": _huber}


def solve_loss(
    problem: VectorProblem[S],
    solution: Solution[S],
    loss: RobustLoss = "soft_l1",
    scale: float | None = None,
    record: RecordStep[S] | None = None,
) -> Solution[S]:
    """Minimise a robust loss of the distances by iteratively reweighted Gauss-Newton.

    The distances are multiplied by the rows' weights (`Problem.weights`) as in least squares. Outliers spoil what
    least squares says of the scale and of the directions that the data show, so both are looked at again with
    the robust fit: the default scale follows the median of its distances down, directions are added, and the
    fit goes on.

    Parameters
    ----------
    problem : VectorProblem
    solution : Solution
        Gives the seen directions, the default scale and the start.
    loss : str
        ``soft_l1`` or ``huber``.
    scale : float, optional
        ``c``, metres; unless given, `LOSS_SCALE` medians of the distances, first those of least squares.
    record : callable, optional
        Called with (iteration, state) for the start and after each step.

    Raises
    ------
    OptionError
        If there is no such loss or the scale is not positive.
    IdentificationError
        If the iteration does not converge.
    """
    function = LOSSES[checked("loss", loss, tuple(LOSSES))]
    c = _default_scale(problem, solution.state) if scale is None else scale
    if not 0 < c < np.inf:
        raise OptionError(
            f"the scale of a robust loss must be a positive number of metres, not {c:g}", parameter="scale"
        )
    state, information = solution.state, solution.information

    def mean_loss(distance: FloatArray) -> float:  # with the scale of the moment
        return float(c * np.sqrt(np.mean(function((problem.weights * distance / c) ** 2)[0])))

    history: list[float] = []
    note(history, mean_loss(distances(problem, state)), state, record)
    while len(history) <= MAX_ITERATIONS:
        basis = information.basis()
        weights = function((problem.weights * distances(problem, state) / c) ** 2)[1]
        H, g, rss = problem.normal_equations(state, problem.weights * np.sqrt(weights))
        step = basis @ solved(basis.T @ H @ basis, basis.T @ g)
        size = np.abs(step).max()
        moved = _lowered(problem, state, step, mean_loss, history[-1])
        state = moved or state
        note(history, mean_loss(distances(problem, state)), state, record)
        if size < STEP_TOLERANCE or not moved:
            again = information_of(problem, H, rss)
            smaller = _default_scale(problem, state) if scale is None else c
            if again.rank <= information.rank and smaller > 0.9 * c:
                rss, count = problem.rss(state), len(history) - 1
                return Solution(state, information, rss, history[-1], count, tuple(history), weights, c)
            if again.rank > information.rank:
                information = again
            if smaller < 0.9 * c:
                c = smaller
                history[-1] = mean_loss(distances(problem, state))
    raise IdentificationError(f"the fit with the loss {loss} did not converge in {MAX_ITERATIONS} iterations")


def _default_scale(problem: VectorProblem[S], state: S) -> float:
    """Scale of a robust loss from the median of a state's weighted distances, metres."""
    return max(LOSS_SCALE * float(np.median(problem.weights * distances(problem, state))), LOSS_FLOOR)
