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

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import cone_program, least_squares
from irbcal.identification.choices import ConeSolver
from irbcal.identification.cone_program import certificate, largest
from irbcal.identification.observability import Information
from irbcal.identification.residuals import Problem, State
from irbcal.options import checked

TOLERANCE = 1e-4
"""Accepted gap between largest distance and lower bound, relative."""

FLOOR = 1e-9
"""Metres; a gap below this is closed, whatever the largest distance."""

MOST_POSES, ADDED = 5000, 1000
"""Poses that are solved for at once, and of more how many with the largest distances at first and at a time."""

MAX_ITERATIONS = 50
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
    history : tuple of float
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
    history: tuple[float, ...]
    support: IntArray
    multipliers: FloatArray

    def __post_init__(self) -> None:
        lock(self)


def solve(
    problem: Problem,
    solution: least_squares.Solution,
    start: State | None = None,
    tolerance: float = TOLERANCE,
    inner: ConeSolver = "numpy",
    record: least_squares.Record | None = None,
) -> Minimax:
    """Minimise the largest distance (Nubiola 2011, eqs. 3.35 and 3.36), with a certificate.

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
        Solver of the convex models: ``numpy`` (`irbcal.identification.cone_program`) or ``clarabel``.
    record : callable, optional
        Called with (iteration, state) for the start and after each step, see `irbcal.identification.history`.

    Returns
    -------
    Minimax

    Raises
    ------
    IdentificationError
        If the gap cannot be reached.
    OptionError
        If there is no such solver.
    """
    solver = cone_program.SOLVERS[checked("inner", inner, tuple(cone_program.SOLVERS))]
    state = solution.state if start is None else start
    basis = solution.information.basis()
    r = problem.residuals(state)
    if len(r) > MOST_POSES and problem.points.poses > MOST_POSES:
        return _by_parts(problem, solution, state, tolerance, inner, record)
    value = largest(r)
    history = [value]
    w: FloatArray | None = None
    if record:
        record(0, state)
    for iteration in range(MAX_ITERATIONS + 1):
        Q, back = _orthonormal(problem.jacobian(state) @ basis, 1e-3 * np.sqrt(np.mean(r**2)))
        # the multipliers of the last model often prove this one too, which saves the solution of one more
        w, bound = certificate(r, Q, w)
        if not _closed(value, bound, tolerance):
            z, w = solver(r, Q, 0.1 * tolerance)
            w, bound = certificate(r, Q, w)
        if _closed(value, bound, tolerance):
            gap = max(value - bound, 0.0) / value if value else 0.0
            support = np.flatnonzero(np.linalg.norm(w, axis=1) > SUPPORT)
            return Minimax(state, solution.information, value, bound, gap, iteration, tuple(history), support, w)
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


def _by_parts(
    problem: Problem,
    solution: least_squares.Solution,
    state: State,
    tolerance: float,
    inner: ConeSolver,
    record: least_squares.Record | None,
) -> Minimax:
    """The same for many poses: for those with the largest distances, and others as they come to be the largest.

    What some of the points need at least all need at least: the bound of the part is one of the whole.
    """
    points, before, iterations = problem.points, problem.residuals(state), 0
    first = largest(before)
    rows = np.concatenate([points.pose, points.pose[points.oriented()]])
    mine = _farthest(before, rows, points.poses, np.zeros(points.poses, dtype=bool))
    while True:
        part = solve(problem.of_poses(mine), solution, state, tolerance, inner, record)
        state, iterations = part.state, iterations + part.iterations
        r = problem.residuals(state)
        value = largest(r)
        if _closed(value, part.lower_bound, tolerance) or mine.sum() > MOST_POSES - ADDED:
            break
        mine = _farthest(r, rows, points.poses, mine)
    if not _closed(value, part.lower_bound, tolerance):
        raise IdentificationError(
            f"the largest distance is {1e3 * value:.6g} mm, but only {1e3 * part.lower_bound:.6g} mm are proved to be "
            f"needed by the {int(mine.sum())} poses with the largest ones: allow a larger tolerance"
        )
    multipliers = np.zeros((problem.rows, 3))
    multipliers[mine[rows]] = part.multipliers
    gap = max(value - part.lower_bound, 0.0) / value if value else 0.0
    support = np.flatnonzero(np.linalg.norm(multipliers, axis=1) > SUPPORT)
    return replace(
        part,
        value=value,
        gap=gap,
        iterations=iterations,
        history=(first, *part.history[1:-1], value),
        support=support,
        multipliers=multipliers,
    )


def _farthest(r: FloatArray, rows: IntArray, n: int, mine: BoolArray) -> BoolArray:
    """The poses of a part, and those of the others with the largest distances."""
    worst = np.zeros(n)
    np.maximum.at(worst, rows, np.linalg.norm(r, axis=1))
    worst[mine] = -1.0
    more = mine.copy()
    more[np.argpartition(-worst, ADDED)[:ADDED]] = True
    return more


def _orthonormal(A: FloatArray, cut: float) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis of the columns and the matrix that brings its coordinates back to theirs.

    Directions along which a whole unit moves all predictions by less than ``cut`` together are not moved: far from
    the least-squares state there may be such among the seen ones. The second time removes what rounding left.
    """
    back: FloatArray = np.eye(A.shape[1])
    for limit in (cut, 0.0):
        squares, V = np.linalg.eigh(A.T @ A)
        keep = squares > limit**2
        turned = V[:, keep] / np.sqrt(squares[keep])
        A, back = A @ turned, back @ turned
    return A, back


def _closed(value: float, bound: float, tolerance: float) -> bool:
    """Whether the gap between largest distance and lower bound is small enough."""
    return value - bound <= max(tolerance * value, FLOOR)


def _shortened(
    problem: Problem, state: State, step: FloatArray, value: float, bound: float
) -> tuple[State, FloatArray, bool]:
    """State and residuals after as much of the step as makes the true largest distance follow its model."""
    size = 1.0
    while size > 1e-6:
        moved = problem.moved(state, size * step)
        r = problem.residuals(moved)
        if largest(r) <= value - 0.1 * size * (value - bound):
            return moved, r, True
        size *= 0.5
    return state, problem.residuals(state), False
