"""Nelder-Mead on the largest distance, as Nubiola 2011 ran it (sections 3.5, 7.3 and 7.5).

It uses no derivatives and proves nothing: after the thesis' 2,000 iterations it has stopped early, not converged
(`irbcal.identification.minimax` gives the minimum). It is kept so that results can be compared.

It moves all unknowns of the problem: base, targets and every error parameter, held directions included, as the
thesis did. Each unknown is counted in plausible sizes: the error parameters' own, and for base and targets those
of a length and an angle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.identification.history import distances, largest
from irbcal.identification.least_squares import Record
from irbcal.identification.residuals import Problem, State
from irbcal.units import DEG, MM

ITERATIONS = 2000
"""Iterations of a run (Nubiola 2011, section 7.5)."""

EVERY = 10
"""Iterations between two records (Nubiola 2011, section 7.5)."""

LENGTH, ANGLE = 5 * MM, 0.5 * DEG
"""Plausible sizes of the unknowns of base and targets, metres and radians."""

SIMPLEX = 0.05
"""Edge of the first simplex along each unknown, in plausible sizes: 0.25 mm and 0.025 degrees."""


@dataclass(frozen=True, eq=False)
class NelderMead:
    """Outcome of a Nelder-Mead search.

    Attributes
    ----------
    state : State
    value : float
        Objective at ``state``, metres.
    iterations, evaluations : int
    history : tuple of float
        Objective at the start and every ten iterations, metres.
    """

    state: State
    value: float
    iterations: int
    evaluations: int
    history: tuple[float, ...]

    def __post_init__(self) -> None:
        lock(self)


def sizes(problem: Problem) -> FloatArray:
    """Plausible size of every unknown, shape (unknowns,), metres and radians."""
    base = [ANGLE] * 3 + [LENGTH] * 3
    targets = [LENGTH] * (3 * len(problem.free)) + [ANGLE] * (3 * len(problem.framed))
    return np.array(base + targets + [p.scale for p in problem.parameters])


def solve(
    problem: Problem,
    start: State,
    iterations: int = ITERATIONS,
    simplex: float = SIMPLEX,
    objective: Callable[[FloatArray], float] = largest,
    record: Record | None = None,
) -> NelderMead:
    """Search for a smaller objective without derivatives (Nubiola 2011, sections 3.5 and 7.3).

    Parameters
    ----------
    problem : Problem
    start : State
    iterations : int
        All of them are used: there is no other end.
    simplex : float
        Edge of the first simplex, in plausible sizes.
    objective : callable
        From distances (rows,) to metres; the largest distance (eq. 3.35) unless given.
    record : callable, optional
        Called with (iteration, state) for the start and every ten iterations, see
        `irbcal.identification.history`.

    Returns
    -------
    NelderMead
    """
    from scipy.optimize import minimize

    scale = sizes(problem)

    def state_at(x: FloatArray) -> State:
        return problem.moved(start, scale * x)

    def function(x: FloatArray) -> float:
        return objective(distances(problem, state_at(x)))

    history = [function(np.zeros(len(scale)))]
    count = 0
    if record:
        record(0, start)

    def callback(intermediate_result: Any) -> None:
        nonlocal count
        count += 1
        if count % EVERY == 0:
            history.append(float(intermediate_result.fun))
            if record:
                record(count, state_at(intermediate_result.x))

    first = np.vstack([np.zeros(len(scale)), simplex * np.eye(len(scale))])
    # scipy counts the first simplex as an iteration
    options = {"maxiter": iterations + 1, "xatol": 0.0, "fatol": 0.0, "initial_simplex": first}
    found = minimize(function, first[0], method="Nelder-Mead", callback=callback, options=options)
    return NelderMead(state_at(found.x), float(found.fun), count, int(found.nfev) + 1, tuple(history))
