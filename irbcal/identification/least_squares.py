"""Least squares by Gauss-Newton with analytic derivatives and rank handling.

The normal equations are summed over blocks of poses (memory does not grow with the data); directions that
the data do not show are held at the smallest change from nominal (`irbcal.identification.observability`).
"""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import observability
from irbcal.identification.residuals import State

STEP_TOLERANCE = 1e-7
"""Largest step (metres, radians) after which the iteration has converged: convergence is at least a factor of
1,000 a step near the minimum, so that what is left after a step of this size is below a nanometre."""

MAX_ITERATIONS = 60


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
    history : list of float
        Root mean square distance (m) after each iteration.
    """

    state: State
    information: observability.Information
    rss: float
    iterations: int
    history: list


def solve(problem, state, record=None):
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
    H, g, rss = problem.normal_equations(state)
    history = [np.sqrt(rss / m)]
    if record:
        record(0, state)
    for iteration in range(1, MAX_ITERATIONS + 1):
        seen = observability.information(problem, H, rss)
        step = _step(seen, g, state)
        size = np.abs(step).max()
        if size < STEP_TOLERANCE:
            moved = problem.moved(state, step)
            return Solution(moved, seen, problem.rss(moved), iteration, history)
        shrink = 1.0
        while True:
            moved = problem.moved(state, shrink * step)
            H, g, new_rss = problem.normal_equations(moved)
            # a step that is lost in rounding, or only puts held directions back, need not lower the sum
            if new_rss <= rss * (1 + 1e-6) or size * shrink < 1e-7:
                break
            shrink *= 0.5
            if shrink < 1e-6:
                break
        state, rss = moved, new_rss
        history.append(np.sqrt(rss / m))
        if record:
            record(iteration, state)
    raise IdentificationError(
        f"the fit did not converge in {MAX_ITERATIONS} iterations (last step {size:.2g}, rms "
        f"{1e3 * history[-1]:.3g} mm): check units, joint order and the robot file, and that neither base "
        "nor tool moved between the poses"
    )


def _step(seen, g, state):
    """Gauss-Newton step of base, targets and error parameters; held directions go back to nominal."""
    b = len(seen.H_nn_inverse)
    known = seen.H_nn_inverse @ g[:b]
    rest = seen.scale * (g[b:] - seen.follow.T @ g[:b])
    V, held = seen.directions[:, seen.seen], seen.directions[:, ~seen.seen]
    errors = V @ ((V.T @ rest) / seen.eigenvalues[seen.seen]) - held @ (held.T @ (state.errors / seen.scale))
    errors = seen.scale * errors
    return np.concatenate([known - seen.follow @ errors, errors])
