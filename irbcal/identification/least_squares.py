"""Least squares by Gauss-Newton with analytic derivatives and rank handling.

The normal equations are summed over blocks of poses (memory does not grow with the data); directions that
the data do not show are held at the smallest change from nominal (`irbcal.identification.observability`).

What the data show is judged by the residuals of the moment, so that near the noise a direction may come and go: once
seen it moves, and moved it is not seen. Where the objective no longer falls, the held directions are therefore frozen:
what is left is an ordinary least-squares problem with fewer unknowns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import observability
from irbcal.identification.problem import Problem, State

STEP_TOLERANCE = 1e-7
"""Largest step (metres, radians) after which the iteration has converged: convergence is at least a factor of
1,000 a step near the minimum, so that what is left after a step of this size is below a nanometre."""

CHORD = 1e-5
"""Step (metres, radians) after which derivatives are taken once as they were before it. They have changed by as large a
share, and that share of what noise lets a parameter vary is missed: less than 1e-4 of its standard deviation."""

MAX_ITERATIONS = 60
"""Iterations, counted anew when directions are frozen."""

PATIENCE = 5
"""Iterations without progress after which the held directions are frozen."""

PROGRESS = 1e-3
"""Relative fall of the sum of squares that counts as progress."""

DECREASE_TOLERANCE = 1e-8
"""Expected fall of the sum of squares, in variances of one coordinate, below which a fit with frozen directions has
converged, too: no combination of parameters is farther from the minimum than 1e-4 of its standard deviation."""

Record = Callable[[int, State], None]
"""Called with iteration and state."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Outcome of a fit.

    Attributes
    ----------
    state : State
    information : Information
    rss : float
        Sum of squared residuals at ``state``, m^2.
    iterations : int
    history : tuple of float
        Root mean square distance (m) after each iteration.
    """

    state: State
    information: observability.Information
    rss: float
    iterations: int
    history: tuple[float, ...]

    def __post_init__(self) -> None:
        lock(self)


def solve(problem: Problem, state: State, record: Record | None = None) -> Solution:
    """Minimise the sum of squared distances from a start.

    Parameters
    ----------
    problem : Problem
    state : State
        Start; its errors are normally zero.
    record : callable, optional
        Called with (iteration, state) for the start and after each step, see `irbcal.identification.history`.

    Returns
    -------
    Solution

    Raises
    ------
    IdentificationError
        If base and tool are not determined, equations are too few or the iteration does not converge.
    """
    m = len(problem.points)
    slopes: list[FloatArray] = []
    H, g, rss = problem.normal_equations(state, slopes=slopes)
    sums = [rss]
    ranks: list[int] = []
    held: FloatArray | None = None
    looked: tuple[FloatArray, FloatArray | None, observability.Information] | None = None
    last = MAX_ITERATIONS
    if record:
        record(0, state)
    iteration = 0
    while iteration < last:
        iteration += 1
        if held is None and _stands_still(sums):
            held = observability.information(problem, H, rss).weakest(min(ranks[-PATIENCE:]))
            last = iteration + MAX_ITERATIONS
            state = _put_back(problem, observability.information(problem, H, rss, held), state)
            H, g, rss = problem.normal_equations(state, slopes=(slopes := []))
        if looked and looked[0] is H and looked[1] is held:
            seen = observability.judged_again(problem, looked[2], rss, held)
        else:
            seen = observability.information(problem, H, rss, held)
        looked = H, held, seen
        ranks.append(seen.rank)
        step = _step(seen, g, state)
        size = np.abs(step).max()
        if size < STEP_TOLERANCE or (held is not None and g @ step < DECREASE_TOLERANCE * seen.sigma**2):
            # the sum is a parabola over so short a step
            left = max(rss - float(step @ (2.0 * g - H @ step)), 0.0)
            return Solution(problem.moved(state, step), seen, left, iteration, tuple(np.sqrt(np.array(sums) / m)))
        shrink = 1.0
        while True:
            moved = problem.moved(state, shrink * step)
            if slopes and size * shrink < CHORD:
                g, new_rss = problem.gradient_near(moved, slopes)
                slopes = []
            else:
                H, g, new_rss = problem.normal_equations(moved, slopes=(slopes := []))
            # a step that is lost in rounding, or only puts held directions back, need not lower the sum
            if new_rss <= rss * (1 + 1e-6) or size * shrink < 1e-7:
                break
            shrink *= 0.5
            if shrink < 1e-6:
                break
        state, rss = moved, new_rss
        sums.append(rss)
        if record:
            record(iteration, state)
    raise IdentificationError(
        f"the fit did not converge in {iteration} iterations (last step {size:.2g}, rms "
        f"{1e3 * np.sqrt(rss / m):.3g} mm): check units, joint order and the robot file, and that neither base "
        "nor tool moved between the poses"
    )


def _stands_still(sums: list[float]) -> bool:
    """Whether the sum of squares has made no progress of late, although the fit has not converged."""
    return len(sums) > 2 * PATIENCE and min(sums[-PATIENCE:]) > (1 - PROGRESS) * min(sums[:-PATIENCE])


def _put_back(problem: Problem, seen: observability.Information, state: State) -> State:
    """The state with held directions at nominal; base and targets follow."""
    return problem.moved(state, _step(seen, np.zeros(problem.unknowns), state))


def _step(seen: observability.Information, g: FloatArray, state: State) -> FloatArray:
    """Gauss-Newton step of base, targets and error parameters; held directions go back to nominal."""
    b = len(seen.H_nn_inverse)
    known = seen.H_nn_inverse @ g[:b]
    rest = seen.scale * (g[b:] - seen.follow.T @ g[:b])
    V, held = seen.directions[:, seen.seen], seen.directions[:, ~seen.seen]
    errors = V @ ((V.T @ rest) / seen.eigenvalues[seen.seen]) - held @ (held.T @ (state.errors / seen.scale))
    errors = seen.scale * errors
    return np.concatenate([known - seen.follow @ errors, errors])
