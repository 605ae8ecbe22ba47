"""One call for every way of identifying: method, objective, loss."""

from dataclasses import replace

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import axes, history, least_squares, minimax, nelder_mead, observability, pnorm
from irbcal.identification.choices import LOSSES, METHODS, OBJECTIVES
from irbcal.identification.fit import first_state, fit_of, make_problem
from irbcal.identification.residuals import Problem, State
from irbcal.modeling.parameters import GEOMETRIC, level_parameters, parameter


def identify_by(
    arm,
    points,
    level="34",
    method="least-squares",
    objective="rms",
    power=8.0,
    loss="linear",
    known_targets=None,
    parameters=None,
    watched=None,
):
    """Identify a robot by a chosen method.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    level : str
        Error model; with method ``axes`` all geometric errors are taken from the axes whatever the level.
    method : str
        ``least-squares`` (Gauss-Newton, which the other objectives start from), ``axes`` (directly from one-joint
        moves, Nubiola 2011, section 3.1) or ``nelder-mead`` (as the thesis ran it: objective ``max``, 2,000
        iterations, from the axes' model where the data have one-joint moves, else from the nominal robot).
    objective : str
        ``rms``, ``max`` (eq. 3.35, with a certificate) or ``pnorm``.
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

    Returns
    -------
    Fit

    Raises
    ------
    IdentificationError
        If the data do not allow it or the options contradict one another.
    """
    for value, allowed, what in (
        (method, METHODS, "method"),
        (objective, OBJECTIVES, "objective"),
        (loss, LOSSES, "loss"),
    ):
        if value not in allowed:
            raise IdentificationError(f"unknown {what} {value!r}: choose one of {', '.join(allowed)}")
    if objective != "rms" and loss != "linear":
        raise IdentificationError(f"loss {loss} goes with objective rms, not with {objective}")
    if method != "least-squares" and (objective, loss) not in (("rms", "linear"), ("max", "linear")):
        raise IdentificationError(f"method {method} has its own objective: leave objective and loss at their defaults")
    if method == "axes":
        if parameters is not None and [p.name for p in parameters] != [p.name for p in level_parameters(level, arm)]:
            raise IdentificationError("method axes takes all link geometry from the axes: nothing can be freed or held")
        return _by_axes(arm, points, known_targets)
    problem, guess = make_problem(arm, points, level, known_targets, parameters)
    watched = {
        name: Problem(arm, seen, problem.parameters, problem.joint_map.phases, problem.known)
        for name, seen in (watched or {}).items()
        if seen.target_names == points.target_names
    }
    course = history.History(problem, watched, _measure(method, objective, power))
    first = first_state(problem)
    solution = least_squares.solve(problem, first, record=course.record if objective == "rms" else None)
    base = fit_of(problem, solution, level, guess)
    if method == "nelder-mead":
        return _by_nelder_mead(base, first, known_targets, watched)
    if objective == "rms" and loss == "linear":
        return replace(base, history=course)
    if objective == "max":
        found = minimax.solve(problem, solution, record=course.record)
    elif objective == "pnorm":
        found = pnorm.solve(problem, solution, power, record=course.record)
    else:
        found = pnorm.robust(problem, solution, loss, record=course.record)
        base = replace(base, solution=replace(base.solution, information=found.information))
    bound = found.lower_bound if objective == "max" else None
    value = found.value if objective != "rms" else None
    return _moved(base, found.state, course, objective=objective, value=value, lower_bound=bound)


def _measure(method, objective, power):
    """What the history calls the objective."""
    if method == "nelder-mead" or objective == "max":
        return history.largest
    return history.rms if objective == "rms" else lambda distance: pnorm.norm(distance, power)


def _moved(base, state, course, **changes):
    """A least-squares fit moved to another state; what the data show stays as least squares saw it."""
    solution = replace(base.solution, state=state, rss=base.problem.rss(state))
    found = fit_of(base.problem, solution, base.level, base.stiffness_guess)
    return replace(found, history=course, least_squares=base, **changes)


def _by_nelder_mead(base, first, known_targets, watched):
    """The thesis's search: from the axes' model where there are one-joint moves, else from the nominal robot."""
    problem = base.problem
    start = first
    try:
        found = axes.calibrate_by_axes(problem.arm, problem.points, known_targets=known_targets)
    except IdentificationError:
        pass
    else:
        errors = np.zeros(len(problem.parameters))
        for k, item in enumerate(problem.parameters):
            if item.kind in GEOMETRIC:
                errors[k] = getattr(found.corrections, item.kind)[item.index]
        targets = np.array([found.robot.targets[name] for name in problem.points.target_names])
        start = replace(first, T_world_base=found.robot.T_world_base, targets=targets, errors=errors)
    course = history.History(problem, watched, every=nelder_mead.EVERY)
    found = nelder_mead.solve(problem, start, record=course.record)
    return _moved(base, found.state, course, method="nelder-mead", objective="max", value=found.value)


def _by_axes(arm, points, known_targets):
    """The axes' calibration as a fit: its errors as parameters, its certainty that of the same poses."""
    found = axes.calibrate_by_axes(arm, points, known_targets=known_targets)
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
    solution = least_squares.Solution(state, observability.information(problem, H, rss), rss, 0, [])
    return replace(fit_of(problem, solution, "26", None), method="axes")
