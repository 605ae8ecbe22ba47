"""One identification from start to finish: points and a level in, a robot with its certainty out."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.errors import IdentificationError
from irbcal.identification import least_squares, start
from irbcal.identification.choices import LEVELS, Level
from irbcal.identification.residuals import Problem, State
from irbcal.identification.result import Fit
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import Parameter, level_parameters
from irbcal.modeling.robot import Robot
from irbcal.modeling.stiffness import Stiffness
from irbcal.options import checked

MIN_POSES = 3
"""Poses without which not even base and tool are looked for."""

SPREAD, CLEAR = 1e-5, 1e-3
"""Ratios of singular values below which the closed form leaves the start open, and above which it is believed."""
NEAR = 0.02
"""In between it is believed where the nominal robot then fits to so much of how far the points lie apart."""


def identify(
    arm: Arm,
    points: PointSet,
    level: Level = "34",
    known_targets: Mapping[str, ArrayLike] | None = None,
    parameters: Sequence[Parameter] | None = None,
) -> Fit:
    """Identify base, targets and the error parameters of a level by least squares.

    No first guess is needed: base and targets come in closed form from the nominal arm, and the fit starts
    from there with analytic derivatives.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    level : str
        ``nominal``, ``11``, ``16``, ``26``, ``34`` (Nubiola 2011, sections 5.4.1, 5.4.2, 5.4.3, 5.4.4 and 5.4.5),
        ``34b``, or for any serial arm ``offsets`` or ``placement``.
    known_targets : dict of str to array_like, shape (3,), optional
        Targets whose places in the tip link are known (from a CMM), metres.
    parameters : sequence of Parameter, optional
        Error parameters in place of the level's own.

    Returns
    -------
    Fit

    Raises
    ------
    IdentificationError
        If the data do not allow it.
    OptionError
        If there is no such level.
    """
    problem, guess = make_problem(arm, points, level, known_targets, parameters)
    solution = least_squares.solve(problem, first_state(problem))
    return fit_of(problem, solution, level, guess)


def make_problem(
    arm: Arm,
    points: PointSet,
    level: Level = "34",
    known_targets: Mapping[str, ArrayLike] | None = None,
    parameters: Sequence[Parameter] | None = None,
) -> tuple[Problem, Stiffness | None]:
    """The problem of a level (Nubiola 2011, section 5.4), refused with a sentence where the data are too few.

    Parameters
    ----------
    arm, points, level, known_targets, parameters
        As `identify`.

    Returns
    -------
    problem : Problem
    guess : Stiffness or None
        Physical guess that names the stiffness parameters (section 5.3), for levels that have them.
    """
    checked("level", level, LEVELS)
    parameters = level_parameters(level, arm) if parameters is None else tuple(parameters)
    guess: Stiffness | None = None
    phases: ArrayLike = (0.0, np.pi / 2)
    if any(p.kind == "stiffness" for p in parameters):
        phases, guess = arm.stiffness_geometry()
    if points.poses < MIN_POSES:
        raise IdentificationError(
            f"{points.poses} pose{'s' if points.poses != 1 else ''} cannot determine a robot: "
            f"at least {MIN_POSES} are needed for base and tool alone, 20 or more for a calibration"
        )
    problem = Problem(arm, points, parameters, phases, known_targets)
    spare = 3 * problem.rows - problem.unknowns
    if spare < 1:
        raise IdentificationError(
            f"{len(points)} points of {points.poses} poses give {3 * problem.rows} equations for the "
            f"{problem.unknowns} unknowns of level {level} with {len(points.target_names)} targets: measure at least "
            f"{_poses_missing(problem, spare)} more poses or choose a smaller model"
        )
    return problem, guess


def _poses_missing(problem: Problem, spare: int) -> int:
    """How many more poses like these give one equation to spare."""
    per_pose = 3 * problem.rows / problem.points.poses
    return int(np.ceil((1 - spare) / per_pose))


def fit_of(problem: Problem, solution: least_squares.Solution, level: Level, guess: Stiffness | None) -> Fit:
    """The robot that a solution describes, with what the fit knows of itself."""
    arm, thesis = problem.model(solution.state)
    names = problem.points.target_names
    targets = dict(zip(names, solution.state.targets, strict=True))
    rotations = {names[k]: solution.state.rotations[k] for k in problem.framed}
    robot = Robot(arm, thesis.joint_map(problem.arm), solution.state.T_world_base, targets, rotations)
    return Fit(robot, level, problem, solution, guess)


def first_state(problem: Problem) -> State:
    """Closed form, each session by itself; where the data leave it open, the best of a turn of nominal fits."""
    if len(problem.sessions) > 1:
        return _first_of_sessions(problem)
    state, spread = start.closed_form(problem)
    turned = start.hand_eye(problem)
    if spread > CLEAR:
        if turned is None:
            return state
        return min((state, turned), key=lambda one: float(np.sum(problem.residuals(one) ** 2)))
    nominal = Problem(problem.arm, problem.points, (), known_targets=problem.known)
    first, _ = start.closed_form(nominal)
    best: least_squares.Solution | None = None
    failure = IdentificationError("no start was found")
    shown = start.hand_eye(nominal)
    apart = float(((problem.points.xyz - problem.points.xyz.mean(axis=0)) ** 2).sum())
    own = [first] if shown is None else [first, shown]
    turns = start.turned_starts(nominal, first, fitted=spread > SPREAD)
    for number, candidate in enumerate(itertools.chain(own, turns)):
        if number == len(own) and spread > SPREAD and best is not None and best.rss < NEAR**2 * apart:
            break
        try:
            solution = least_squares.solve(nominal, candidate)
        except IdentificationError as error:
            failure = error
            continue
        if best is None or solution.rss < best.rss:
            best = solution
    if best is None:
        raise failure
    return replace(best.state, errors=np.zeros(len(problem.parameters)))


def _first_of_sessions(problem: Problem) -> State:
    """Base and targets of each session from its own points; a target of several sessions from the last of them."""
    points = problem.points
    assert points.session is not None
    targets, bases = np.zeros((len(points.target_names), 3)), []
    rotations = np.tile(np.eye(3), (len(targets), 1, 1))
    for name in problem.sessions:
        own = replace(points.select(points.session == name), session=None).with_seen_targets()
        if own.poses < MIN_POSES:
            raise IdentificationError(
                f"{own.poses} poses of session {name} cannot determine its base and tool: at least {MIN_POSES} are "
                "needed"
            )
        found = first_state(Problem(problem.arm, own, (), known_targets=problem.known))
        places = [points.target_names.index(target) for target in own.target_names]
        targets[places], rotations[places] = found.targets, found.rotations
        bases.append(found.T_world_base)
    return State(bases[-1], targets, np.zeros(len(problem.parameters)), rotations, np.array(bases[:-1]))
