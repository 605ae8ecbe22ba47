r"""Fits that gross outliers hardly move: robust losses of the distances.

With ``d_j`` the weighted distance of row ``j``:

===========  ==========================================================================
loss         definition
===========  ==========================================================================
``soft_l1``  ``sum_j 2 c^2 (sqrt(1 + d_j^2 / c^2) - 1)``
``huber``    ``sum_j d_j^2`` up to ``d_j = c``, ``2 c d_j - c^2`` beyond
===========  ==========================================================================

Steps are taken along the directions the data show; held directions stay where least squares left them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError, OptionError
from irbcal.identification import least_squares, observability
from irbcal.identification.choices import RobustLoss
from irbcal.identification.history import distances
from irbcal.identification.pnorm import line_search, solved
from irbcal.identification.residuals import Problem, State
from irbcal.options import checked

MAX_ITERATIONS = 200
STEP_TOLERANCE = 1e-9
"""Largest step (metres, radians) after which a fit has converged."""

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
        Root of the mean loss at ``state``, metres.
    iterations : int
    history : tuple of float
        Objective at the start and after each iteration, metres.
    weights : ndarray, shape (rows,)
        What each row's squared distance counts in the last step, at most 1.
    scale : float
        ``c`` of the loss, metres.
    """

    state: State
    information: observability.Information
    value: float
    iterations: int
    history: tuple[float, ...]
    weights: FloatArray
    scale: float

    def __post_init__(self) -> None:
        lock(self)


def _soft_l1(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Loss and its derivative at ``u = d^2 / c^2``."""
    root = np.sqrt(1.0 + u)
    return 2.0 * (root - 1.0), 1.0 / root


def _huber(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Loss and its derivative at ``u = d^2 / c^2``."""
    root = np.sqrt(np.maximum(u, 1.0))
    return np.where(u <= 1.0, u, 2.0 * root - 1.0), 1.0 / root


LOSSES: dict[RobustLoss, Callable[[FloatArray], tuple[FloatArray, FloatArray]]] = {"soft_l1": _soft_l1, "huber": _huber}


def solve(
    problem: Problem,
    solution: least_squares.Solution,
    loss: RobustLoss = "soft_l1",
    scale: float | None = None,
    start: State | None = None,
    record: least_squares.Record | None = None,
) -> Solution:
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
    state, information = solution.state if start is None else start, solution.information

    def mean_loss(distance: FloatArray) -> float:  # with the scale of the moment
        return float(c * np.sqrt(np.mean(function((problem.weights * distance / c) ** 2)[0])))

    history = [mean_loss(distances(problem, state))]
    if record:
        record(0, state)
    while len(history) <= MAX_ITERATIONS:
        basis = information.basis()
        weights = function((problem.weights * distances(problem, state) / c) ** 2)[1]
        H, g, rss = problem.normal_equations(state, problem.weights * np.sqrt(weights))
        step = basis @ solved(basis.T @ H @ basis, basis.T @ g)
        size = np.abs(step).max()
        state, moved = line_search(problem, state, step, mean_loss, history[-1])
        history.append(mean_loss(distances(problem, state)))
        if record:
            record(len(history) - 1, state)
        if size < STEP_TOLERANCE or not moved:
            again = observability.information(problem, H, rss)
            smaller = _default_scale(problem, state) if scale is None else c
            if again.rank <= information.rank and smaller > 0.9 * c:
                return Solution(state, information, history[-1], len(history) - 1, tuple(history), weights, c)
            if again.rank > information.rank:
                information = again
            if smaller < 0.9 * c:
                c = smaller
                history[-1] = mean_loss(distances(problem, state))
    raise IdentificationError(f"the fit with the loss {loss} did not converge in {MAX_ITERATIONS} iterations")


def _default_scale(problem: Problem, state: State) -> float:
    """Scale of a robust loss from the median of a state's weighted distances, metres."""
    return max(SCALE * float(np.median(problem.weights * distances(problem, state))), FLOOR)
