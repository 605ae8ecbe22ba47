"""One call for every way of identifying: method, objective, loss."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError, OptionError
from irbcal.identification import history, least_squares, minimax, nelder_mead, observability, pnorm, robust
from irbcal.identification.axis_calibration import calibrate_by_axes
from irbcal.identification.choices import (
    LEVELS,
    LOSSES,
    OBJECTIVES,
    Level,
    Loss,
    Method,
    MethodOrAlias,
    Objective,
    Parallel,
    method_of,
)
from irbcal.identification.fit import first_state, fit_of, make_problem
from irbcal.identification.residuals import Problem, State
from irbcal.identification.result import Fit
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import GEOMETRIC, Parameter, level_parameters, parameter
from irbcal.options import checked


def identify_by(
    arm: Arm,
    points: PointSet,
    level: Level = "34",
    method: MethodOrAlias = "least-squares",
    objective: Objective = "rms",
    power: float = 8.0,
    loss: Loss = "linear",
    known_targets: Mapping[str, ArrayLike] | None = None,
    parameters: Sequence[Parameter] | None = None,
    watched: Mapping[str, PointSet] | None = None,
    parallel: Parallel = "hayati",
) -> Fit:
    """Identify a robot by a chosen method (Nubiola 2011, section 7.3).

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    level : str
        Error model; with method ``circles`` all geometric errors are taken from the axes whatever the level.
    method : str
        ``least-squares`` (Gauss-Newton, which the other objectives start from), ``circles`` (directly from one-joint
        moves, section 3.1; also known as ``axes``) or ``nelder-mead`` (as the thesis ran it: objective ``max``,
        2,000 iterations, from the axes' model where the data have one-joint moves, else from the nominal robot).
    objective : str
        ``rms``, ``max`` (eqs. 3.35 and 3.36, with a certificate) or ``pnorm``.
    power : float
        Of ``pnorm``, at least 2.
    loss : str
        ``linear``, or ``soft_l1`` and ``huber``, which gross errors move less; with objective ``rms``.
    known_targets : dict of str to array_like, shape (3,), optional
        Targets whose places in the tip link are known, metres.
    parameters : sequence of Parameter, optional
        Error parameters in place of the level's own.
    watched : dict of str to PointSet, optional
        Points that take no part in the fit; their errors go into the history.
    parallel : str
        With method ``circles``: ``hayati`` keeps the tilt of nearly parallel axes, ``forced`` gives them one direction
        (section 3.1.3).

    Returns
    -------
    Fit

    Raises
    ------
    IdentificationError
        If the data do not allow it.
    OptionError
        If an option has no such value or options contradict one another.
    """
    method = method_of(method)
    _check(level, method, objective, loss)
    if method == "circles":
        if parameters is not None and [p.name for p in parameters] != [p.name for p in level_parameters(level, arm)]:
            raise OptionError(
                "method circles takes all link geometry from the axes: nothing can be freed or held",
                parameter="parameters",
            )
        return _by_circles(arm, points, known_targets, parallel)
    problem, guess = make_problem(arm, points, level, known_targets, parameters)
    followed = {
        name: Problem(arm, seen, problem.parameters, problem.joint_map.phases, problem.known, sessions=problem.sessions)
        for name, seen in (watched or {}).items()
        if seen.target_names == points.target_names
    }
    course = history.History(problem, followed, _measure(method, objective, power))
    first = first_state(problem)
    solution = least_squares.solve(problem, first, record=course.record if objective == "rms" else None)
    base = fit_of(problem, solution, level, guess)
    if method == "nelder-mead":
        return _by_nelder_mead(base, first, known_targets, followed)
    if objective == "max":
        least = minimax.solve(problem, solution, record=course.record)
        return _moved(base, least.state, course, objective=objective, value=least.value, lower_bound=least.lower_bound)
    if objective == "pnorm":
        between = pnorm.solve(problem, solution, power, record=course.record)
        return _moved(base, between.state, course, objective=objective, value=between.value)
    if loss == "linear":
        return replace(base, history=course)
    found = robust.solve(problem, solution, loss, record=course.record)
    base = replace(base, solution=replace(base.solution, information=found.information))
    return _moved(base, found.state, course)


def _check(level: Level, method: Method, objective: Objective, loss: Loss) -> None:
    """Refuse options that do not exist or contradict one another."""
    checked("level", level, LEVELS)
    checked("objective", objective, OBJECTIVES)
    checked("loss", loss, LOSSES)
    if objective != "rms" and loss != "linear":
        raise OptionError(f"loss {loss} goes with objective rms, not with {objective}", parameter="loss")
    if method != "least-squares" and (objective, loss) not in (("rms", "linear"), ("max", "linear")):
        raise OptionError(
            f"method {method} has its own objective: leave objective and loss at their defaults", parameter="method"
        )


def _measure(method: Method, objective: Objective, power: float) -> Callable[[FloatArray], float]:
    """What the history calls the objective."""
    if method == "nelder-mead" or objective == "max":
        return history.largest
    return history.rms if objective == "rms" else partial(pnorm.norm, p=power)


def _moved(base: Fit, state: State, course: history.History, **changes: Any) -> Fit:
    """A least-squares fit moved to another state; what the data show stays as least squares saw it."""
    solution = replace(base.solution, state=state, rss=base.problem.rss(state))
    found = fit_of(base.problem, solution, base.level, base.stiffness_guess)
    return replace(found, history=course, least_squares=base, **changes)


def _by_nelder_mead(
    base: Fit, first: State, known_targets: Mapping[str, ArrayLike] | None, watched: Mapping[str, Problem]
) -> Fit:
    """The search of Nubiola 2011, section 7.3.

    It starts from the axes' model where there are one-joint moves, else from the nominal robot.
    """
    problem = base.problem
    start = first
    try:
        direct = calibrate_by_axes(problem.arm, problem.points, known_targets=known_targets)
    except IdentificationError:
        pass
    else:
        errors = np.zeros(len(problem.parameters))
        for k, item in enumerate(problem.parameters):
            if item.kind in GEOMETRIC:
                errors[k] = getattr(direct.corrections, item.kind)[item.index]
        targets = np.array([direct.robot.targets[name] for name in problem.points.target_names])
        start = replace(first, T_world_base=direct.robot.T_world_base, targets=targets, errors=errors)
    course = history.History(problem, watched, every=nelder_mead.EVERY)
    found = nelder_mead.solve(problem, start, record=course.record)
    return _moved(base, found.state, course, method="nelder-mead", objective="max", value=found.value)


def _by_circles(
    arm: Arm, points: PointSet, known_targets: Mapping[str, ArrayLike] | None, parallel: Parallel = "hayati"
) -> Fit:
    """The calibration from the axes (Nubiola 2011, sections 3.1 and 5.4.4) as a fit.

    Its errors are the parameters; its certainty is that of the same poses.
    """
    found = calibrate_by_axes(arm, points, parallel, known_targets=known_targets)
    table, nominal = found.robot.table, arm.table
    chosen, errors = [], []
    for i in range(1, 6):
        for kind in GEOMETRIC:
            error = getattr(table, kind)[i] - getattr(nominal, kind)[i]
            if kind not in ("beta", "b") or error != 0.0:
                chosen.append(parameter(f"delta_{kind}{i + 1}"))
                errors.append(error)
    problem, _ = make_problem(arm, found.axes.moves, "26", known_targets, chosen)
    targets = np.array([found.robot.targets[name] for name in problem.points.target_names])
    state = State(found.robot.T_world_base, targets, np.array(errors))
    H, _, rss = problem.normal_equations(state)
    solution = least_squares.Solution(state, observability.information(problem, H, rss), rss, 0, ())
    return replace(fit_of(problem, solution, "26", None), method="circles")
