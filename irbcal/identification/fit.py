"""Identification of a level of the error model, from points to a robot with what is known of its certainty.

The covariance is that of least squares, leave-one-out residuals are those of its linear model: in closed form, as
`irbcal.identification.leave_one_out` has them. Other objectives take them from the same linear model at their state.

Choosing a level: which error model do the data support.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal import parallel
from irbcal.arrays import FloatArray, IntArray, group_means, rms
from irbcal.errors import IdentificationError, OptionError, RobotError
from irbcal.identification import least_squares, leave_one_out, minimax, robust
from irbcal.identification.axis_calibration import calibrate_by_axes
from irbcal.identification.choices import (
    LEAST_SQUARES,
    LEVELS,
    METHODS,
    FitMethod,
    Goal,
    Level,
    Objective,
    Parallel,
)
from irbcal.identification.fit_sections import (
    Candidate,
    CorrelatedPair,
    LevelChoice,
    Observability,
    ParameterReport,
    ParameterState,
    identified_in_words,
    reached_in_words,
)
from irbcal.identification.initial_guess import MIN_POSES, first_state
from irbcal.identification.least_squares import HELD, TIED, History, information_of, largest
from irbcal.identification.leave_one_out import closed, rms_length
from irbcal.identification.problem import Problem, State
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.repeats import repeat_groups
from irbcal.measurement.session_blocks import into_one_frame
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty, FitLimits
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import GEOMETRIC, Parameter, level_parameters, levels_of, parameter, thesis_count
from irbcal.modeling.robot import Robot
from irbcal.modeling.stiffness import Stiffness
from irbcal.option_values import Progress, checked
from irbcal.section import in_unit
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM
from irbcal.wording import counted, inflected, joined

DIFFERENCE = 1e-7
"""Of the derivatives of the physical stiffness by A and B, radians."""


THROUGH = "acts only through stiffness_A and stiffness_B: held at the physical guess"
"""Why two of the four physical parameters of the stiffness are held (Nubiola 2011, section 5.4)."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Result):
    """An identified robot and what the identification knows about itself."""

    robot: Robot
    level: Level
    problem: Problem
    solution: least_squares.Solution[State]
    stiffness_guess: Stiffness | None
    """Physical guess that names the stiffness parameters; None for levels without stiffness."""
    method: FitMethod = "least-squares"
    objective: Objective = "rms"
    """How it was identified and what was minimised."""
    least_squares: Fit | None = None
    """The least-squares fit that another objective started from, for comparison."""
    history: History | None = None
    """Course of an iterative method, where it was recorded."""

    @property
    def value(self) -> float | None:
        """The objective reached, metres; None for the root mean square, see `rms`."""
        return None if self.objective == "rms" else self.solution.value

    @property
    def lower_bound(self) -> float | None:
        """Certified: no parameters give less, metres (objective ``max``)."""
        return self.solution.lower_bound

    @property
    def rank(self) -> int:
        """Number of identified combinations, base and targets included."""
        return self.solution.information.rank

    @property
    def other_bases(self) -> dict[str, FloatArray]:
        """Base (4, 4) in the measuring frame of each session but the last one."""
        return dict(zip(self.problem.sessions[:-1], self.solution.state.earlier_bases, strict=True))

    @property
    def parameter_count(self) -> int:
        """Number of parameters as the thesis counts them (Nubiola 2011, section 5.4), targets included."""
        return thesis_count(self.problem.parameters) + self.problem.nuisance - 6

    @property
    def rms(self) -> float:
        """Root mean square distance of the fitted points, metres."""
        residuals = self.problem.residuals(self.solution.state)[: len(self.problem.points)]
        return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))

    def parameters(self) -> list[ParameterReport]:
        """Every parameter with value, unit, standard deviation, state and reason.

        Standard deviations of the base's angles are those of small turns about the base's own axes, those of a
        target frame's angles of small turns about the tip link's.
        """
        return _report(self)

    def undetermined(self) -> list[str]:
        """What is held, in sentences: directions that the data do not show, and what acts through others only.

        As many as `parameter_count` exceeds `rank`.
        """
        stiff = any(p.kind == "stiffness" for p in self.problem.parameters)
        through = [f"stiffness_{name} {THROUGH}" for name in ("L_G1", "m") if stiff]
        return [*(sentence for _, sentence in _held_sentences(self)), *through]

    def observability(self) -> Observability:
        """What the poses can show of the error parameters."""
        information, names = self.solution.information, [p.name for p in self.problem.parameters]
        return Observability(
            singular_values_mm=(information.singular_values / MM).tolist(),
            determined=int(information.determined.sum()),
            indices=information.indices(self.problem.points.poses),
            correlations=[
                CorrelatedPair(first=names[i], second=names[j], coefficient=c) for i, j, c in information.correlations()
            ],
        )

    def report(self) -> Sequence[Paragraph]:
        """Model, poses and what was reached; every parameter with its standard deviation; what is held and why."""
        value = self.rms if self.value is None else self.value
        bound_mm = None if self.lower_bound is None else self.lower_bound / MM
        words = reached_in_words(self.objective, value / MM, bound_mm, self.method)
        headline = (
            f"{self.problem.arm.name}, model {self.level}: "
            f"{identified_in_words(self.rank, self.parameter_count, self.problem.points.poses)} ({words})"
        )
        reports = self.parameters()
        rows = tuple((row.name, row.value, row.std, row.unit, row.state) for row in reports)
        table = Table("Parameters with standard deviations", ("parameter", "value", "±", "unit", "state"), rows, 5)
        held_lines = [f"  held: {sentence}" for sentence in self.undetermined()]
        other = [row for row in reports if row.name.startswith("stiffness_") and row.reason and row.reason != THROUGH]
        held_lines += [f"  {row.name}: {row.reason}" for row in other]
        return (headline, table, *held_lines)

    ROWS, COLUMNS = "parameters", "name value unit std state reason"


def _held_sentences(fit: Fit) -> list[tuple[list[int], str]]:
    """(indices of the error parameters involved, sentence) for each held direction."""
    information, problem = fit.solution.information, fit.problem
    names = [p.name for p in problem.parameters]
    out = []
    for leading, errors, nuisance in information.held_directions():
        partners = [int(j) for j in np.flatnonzero(np.abs(errors) > 0.05) if j != leading]
        tied = [names[j] for j in partners]
        # base and targets move too: translations and targets against 1 % of a plausible size
        tools = nuisance[6 : problem.earlier_bases_start]
        base_moves = (
            np.abs(np.r_[nuisance[:6], nuisance[problem.earlier_bases_start :]]).max()
            > 0.01 * information.scale[leading]
        )
        if base_moves:
            tied.append("the base")
        if np.abs(tools).max(initial=0.0) > 1e-5:
            tied.append("the targets' coordinates")
        if tied:
            sentence = (
                f"{names[leading]} cannot be separated from {joined(tied)} with these poses: "
                "held at the smallest change"
            )
        else:
            sentence = f"{names[leading]} has no effect on these poses: held at nominal"
        out.append(([leading, *partners], sentence))
    return out


def _report(fit: Fit) -> list[ParameterReport]:
    information, state, names = fit.solution.information, fit.solution.state, fit.problem.points.target_names
    covariance = information.covariance()
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    bases = {"base": state.T_world_base} | {f"base@{session}": T for session, T in fit.other_bases.items()}
    places = {names[j]: state.targets[j] for j in fit.problem.fitted_targets}
    rotations = {names[j]: state.rotations[j] for j in fit.problem.oriented_targets}
    rows = nuisance_reports(bases, places, rotations, covariance, information.nuisance_null)
    b = fit.problem.nuisance
    held_fraction = information.held_fraction()
    sentences = _held_sentences(fit)
    for j, unknown in enumerate(fit.problem.parameters):
        value = state.errors[j]
        reason = "; ".join(text for members, text in sentences if j in members)
        if held_fraction[j] > TIED:
            kind: ParameterState = "held" if held_fraction[j] > HELD else "tied"
            rows.append(ParameterReport.from_si(unknown.name, value, unknown.unit, None, kind, reason))
        else:
            rows.append(ParameterReport.from_si(unknown.name, value, unknown.unit, std[b + j]))
    if fit.stiffness_guess is not None:
        rows += _physical_stiffness(fit, fit.stiffness_guess, covariance[b:, b:])
    return rows


def nuisance_reports(
    bases: Mapping[str, FloatArray],
    target_positions: Mapping[str, FloatArray],
    rotations: Mapping[str, FloatArray],
    covariance: FloatArray,
    null: FloatArray | None = None,
) -> list[ParameterReport]:
    """Base and targets, which have no nominal values, with their standard deviations.

    Parameters
    ----------
    bases : dict of str to ndarray, shape (4, 4)
        The base first, then those of other sessions.
    target_positions, rotations : dict of str to ndarray, shape (3,), (3, 3)
        Identified places of targets, and target frames, in the tip link.
    covariance : ndarray
        Of base (turn, shift in the base link), places, frames (turns in the tip link), other bases, then others; SI.
    null : ndarray, shape (nuisance unknowns, k), optional
        Directions that no pose of the arm can show, unit vectors.
    """
    out: list[ParameterReport] = []
    reason = "base and tool cannot be separated completely: all axes of this arm are parallel"

    def add(names: Sequence[str], values: FloatArray, unit: str, D: FloatArray, at: int) -> None:
        """Three numbers, and their derivative (3, 3) by the columns from ``at`` on."""
        columns = slice(at, at + 3)
        std = np.sqrt(np.maximum(np.diagonal(D @ covariance[columns, columns] @ D.T), 0.0))
        hidden = np.zeros(3)
        if null is not None and null.shape[1]:
            hidden = np.linalg.norm(D @ null[columns], axis=1) / np.linalg.norm(D, axis=1)
        for name, value, deviation, share in zip(names, values, std, hidden, strict=True):
            tied = share > TIED
            report = (None, "tied", reason) if tied else (deviation, "identified", "")
            out.append(ParameterReport.from_si(name, value, unit, *report))

    def add_base(label: str, at: int) -> None:
        T = bases[label]
        numbers = frames.to_xyz_angles(T)
        add([f"{label}_{axis}" for axis in "xyz"], numbers[:3], "m", T[:3, :3], at + 3)
        turn = frames.angles_derivative(T[:3, :3], False)
        add([f"{label}_r{axis}" for axis in "xyz"], numbers[3:], "rad", turn, at)

    first, *others = bases
    add_base(first, 0)
    at = 6
    for name, place in target_positions.items():
        add([f"target_{name}_{axis}" for axis in "xyz"], place, "m", np.eye(3), at)
        at += 3
    for name, R in rotations.items():
        angles = frames.to_xyz_angles(frames.transform(R))[3:]
        add([f"target_{name}_r{axis}" for axis in "xyz"], angles, "rad", frames.angles_derivative(R, True), at)
        at += 3
    for label in others:
        add_base(label, at)
        at += 6
    return out


def _physical_stiffness(fit: Fit, guess: Stiffness, covariance: FloatArray) -> list[ParameterReport]:
    """The four named parameters of Nubiola 2011, section 5.3: two follow from A and B, two stay at their guess."""
    kinds = [p.kind for p in fit.problem.parameters]
    pair = [j for j, kind in enumerate(kinds) if kind == "stiffness"]
    A, B = fit.solution.state.errors[pair]
    linear_fit = guess.with_coefficients(A, B)
    units = {"delta_L": "m", "L_G2": "m", "L_G1": "m", "m": "1"}

    def reported(name: str, std: float | None, state: ParameterState, reason: str) -> ParameterReport:
        value = getattr(linear_fit or guess, name)
        return ParameterReport.from_si(f"stiffness_{name}", value, units[name], std, state, reason)

    if linear_fit is None:
        reason = "no physical stiffness gives these A and B: the joint map uses A and B themselves"
        return [reported(name, None, "held", reason) for name in units]
    steps = ((DIFFERENCE, 0.0), (-DIFFERENCE, 0.0), (0.0, DIFFERENCE), (0.0, -DIFFERENCE))
    around = [guess.with_coefficients(A + a, B + b) for a, b in steps]
    fixed = [reported(name, None, "held", THROUGH) for name in ("L_G1", "m")]
    if None in around:
        return [
            *(reported(name, None, "held", "at the edge of what stiffness can be") for name in ("delta_L", "L_G2")),
            *fixed,
        ]
    ends = [stiffness.delta_L for stiffness in around if stiffness is not None]
    gradient = np.array([ends[0] - ends[1], ends[2] - ends[3]]) / (2 * DIFFERENCE)
    std = float(np.sqrt(gradient @ covariance[np.ix_(pair, pair)] @ gradient))
    reason = "from stiffness_A and stiffness_B with L_G1 and m at their guess"
    # L_G2 is as wrong as these guesses, whatever the data say
    return [reported("delta_L", std, "identified", reason), reported("L_G2", None, "tied", reason), *fixed]


def identify(
    arm: Arm,
    points: PointSet,
    level: Level = "34",
    known_targets: Mapping[str, ArrayLike] | None = None,
    parameters: Sequence[Parameter] | None = None,
    start: State | None = None,
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
    start : State, optional
        Of a fit to nearly the same points, which spares the first guess.

    Raises
    ------
    IdentificationError
        If the data do not allow it.
    OptionError
        If there is no such level.
    """
    problem, guess = make_problem(arm, points, level, known_targets, parameters)
    solution = least_squares.solve(problem, first_state(problem) if start is None else start)
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
    if any(p.kind == "stiffness" for p in parameters):
        guess = arm.stiffness_geometry()[1]
    if points.poses < MIN_POSES:
        raise IdentificationError(
            f"{counted(points.poses, 'pose')} cannot determine a robot: "
            f"at least {MIN_POSES} are needed for base and tool alone, 20 or more for a calibration"
        )
    problem = Problem(arm, points, parameters, known_targets)
    spare = 3 * problem.rows - problem.unknowns
    if spare < 1:
        missing = int(np.ceil((1 - spare) * points.poses / (3 * problem.rows)))
        raise IdentificationError(
            f"{len(points)} points of {points.poses} poses give {3 * problem.rows} equations for the "
            f"{problem.unknowns} unknowns of level {level} with {len(points.target_names)} targets: measure at least "
            f"{missing} more poses or choose a smaller model"
        )
    return problem, guess


def fit_of(problem: Problem, solution: least_squares.Solution[State], level: Level, guess: Stiffness | None) -> Fit:
    """The robot that a solution describes, with what the fit knows of itself."""
    arm, terms = problem.model(solution.state)
    names = problem.points.target_names
    targets = dict(zip(names, solution.state.targets, strict=True))
    rotations = {names[k]: solution.state.rotations[k] for k in problem.oriented_targets}
    robot = Robot(arm, JointMap(terms), solution.state.T_world_base, targets, rotations)
    return Fit(robot, level, problem, solution, guess)


def identify_by(
    arm: Arm,
    points: PointSet,
    level: Level = "34",
    method: FitMethod = "least-squares",
    goal: Goal = LEAST_SQUARES,
    known_targets: Mapping[str, ArrayLike] | None = None,
    parameters: Sequence[Parameter] | None = None,
    watched: Mapping[str, PointSet] | None = None,
    parallel: Parallel = "hayati",
) -> Fit:
    """Identify a robot by a chosen method (Nubiola 2011, section 7.3).

    Parameters
    ----------
    arm, points, known_targets, parameters
        As `identify`.
    level : str
        Error model; with method ``circles`` all geometric errors are taken from the axes whatever the level.
    method : str
        ``least-squares`` (Gauss-Newton, which the other objectives start from), ``circles`` (directly from one-joint
        moves, section 3.1) or ``nelder-mead`` (as the thesis ran it: objective ``max``,
        2,000 iterations, from the axes' model where the data have one-joint moves, else from the nominal robot).
    goal : Goal
        What to make small, with method ``least-squares``.
    watched : dict of str to PointSet, optional
        Points that take no part in the fit; their errors go into the history.
    parallel : str
        With method ``circles``: ``hayati`` keeps the tilt of nearly parallel axes, ``forced`` gives them one direction
        (section 3.1.3).

    Raises
    ------
    IdentificationError
        If the data do not allow it.
    OptionError
        If an option has no such value or options contradict one another.
    """
    checked("method", method, METHODS)
    checked("level", level, LEVELS)
    if method != "least-squares" and goal not in (LEAST_SQUARES, Goal("max")):
        raise OptionError(
            f"method {method} has its own objective: leave objective and loss at their defaults", parameter="method"
        )
    if method == "circles":
        if parameters is not None and [p.name for p in parameters] != [p.name for p in level_parameters(level, arm)]:
            raise OptionError(
                "method circles takes all link geometry from the axes: nothing can be freed or held",
                parameter="parameters",
            )
        return _by_circles(arm, points, known_targets, parallel)
    problem, guess = make_problem(arm, points, level, known_targets, parameters)
    followed = {
        name: Problem(arm, seen, problem.parameters, problem.known_targets, sessions=problem.sessions)
        for name, seen in (watched or {}).items()
        if seen.target_names == points.target_names
    }
    largest_error = method == "nelder-mead" or goal.objective == "max"
    between = partial(robust.norm, p=goal.power) if goal.objective == "pnorm" else rms
    course = History(problem, followed, largest if largest_error else between)
    first = first_state(problem)
    solution = least_squares.solve(problem, first, record=course.record if goal.objective == "rms" else None)
    base = fit_of(problem, solution, level, guess)
    if method == "nelder-mead":
        return _by_nelder_mead(base, first, known_targets, followed)
    if goal.least_squares:
        return replace(base, history=course)
    return _moved(base, robust.solve(problem, solution, goal, course.record), course, objective=goal.objective)


def _moved(base: Fit, solution: least_squares.Solution[State], course: History, **changes: Any) -> Fit:
    """The fit of another objective, with the least-squares fit that it started from."""
    return replace(
        fit_of(base.problem, solution, base.level, base.stiffness_guess), history=course, least_squares=base, **changes
    )


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
        for k, unknown in enumerate(problem.parameters):
            if unknown.kind in GEOMETRIC:
                errors[k] = getattr(direct.corrections, unknown.kind)[unknown.index]
        targets = np.array([direct.robot.targets[name] for name in problem.points.target_names])
        start = replace(first, T_world_base=direct.robot.T_world_base, targets=targets, errors=errors)
    course = History(problem, watched, every=minimax.RECORD_EVERY)
    polished = minimax.nelder_mead(problem, base.solution, start, record=course.record)
    return _moved(base, polished, course, method="nelder-mead", objective="max")


def _by_circles(
    arm: Arm, points: PointSet, known_targets: Mapping[str, ArrayLike] | None, parallel: Parallel = "hayati"
) -> Fit:
    """The calibration from the axes (Nubiola 2011, sections 3.1 and 5.4.4) as a fit.

    Its errors are the parameters; its certainty is that of the same poses.
    """
    by_axes = calibrate_by_axes(arm, points, parallel, known_targets=known_targets)
    table, nominal = by_axes.robot.table, arm.table
    chosen, errors = [], []
    for i in range(1, 6):
        for kind in GEOMETRIC:
            error = getattr(table, kind)[i] - getattr(nominal, kind)[i]
            if kind not in ("beta", "b") or error != 0.0:
                chosen.append(parameter(f"delta_{kind}{i + 1}"))
                errors.append(error)
    problem, _ = make_problem(arm, by_axes.axes.moves, "26", known_targets, chosen)
    targets = np.array([by_axes.robot.targets[name] for name in problem.points.target_names])
    state = State(by_axes.robot.T_world_base, targets, np.array(errors))
    H, _, rss = problem.normal_equations(state)
    rms = float(np.sqrt(rss / len(problem.points)))
    solution = least_squares.Solution(state, information_of(problem, H, rss), rss, rms, 0)
    return replace(fit_of(problem, solution, "26", None), method="circles")


MOST_PLACES = 5000
"""Places whose poses are left out to see how well the others foretell them."""


def certainty_of(fit: Fit) -> Certainty:
    """Covariance, leave-one-out errors and joint ranges of a fit."""
    problem, points = fit.problem, fit.problem.points
    covariance = fit.solution.information.covariance()
    u = leave_one_out_residuals(fit, covariance)
    names = points.target_names
    return Certainty(
        nominal=problem.arm,
        terms=problem.terms,
        covariance=covariance,
        fitted_targets=tuple(names[k] for k in problem.fitted_targets),
        coefficients=fit.solution.state.errors,
        limits=FitLimits(
            leave_one_out_mm=in_unit(of_targets(u[0], u[2]), MM),
            leave_fifths_out_mm=in_unit(of_targets(u[1], u[2]), MM),
            ranges=[points.q.min(axis=0).tolist(), points.q.max(axis=0).tolist()],
            measurement_noise_mm=points.distance_noise() / MM,
        ),
    )


def leave_one_out_residuals(fit: Fit, covariance: FloatArray) -> tuple[FloatArray, FloatArray, PointSet]:
    """Leave-one-pose-out and leave-a-fifth-out residuals, both of shape (points, 3), metres, and whose they are.

    Repeats of one pose (`irbcal.measurement.repeats.repeat_groups`) are left out together. Infinite where what is left
    does not determine a direction that a residual depends on. Of more than `MOST_PLACES` places
    those drawn at random tell; a fifth of them stands for a fifth of all.
    """
    problem, state = fit.problem, fit.solution.state
    points, place_of = problem.points, repeat_groups(problem.points)
    count = int(place_of.max(initial=-1)) + 1
    sampled = np.ones(count, dtype=bool)
    if count > MOST_PLACES:
        sampled = np.isin(np.arange(count), np.random.default_rng(0).permutation(count)[:MOST_PLACES])
        problem = problem.of_poses(sampled[place_of])
        points, place_of = problem.points, place_of[sampled[place_of]]
    weights = np.repeat(problem.weights, 3)
    J = problem.jacobian(state) * weights[:, None]
    e = problem.residuals(state).ravel() * weights
    pose = np.concatenate([points.pose, points.pose[points.oriented()]])
    number, place_of = leave_one_out.block_numbers(place_of, points.session)[pose], place_of[pose]
    order = np.argsort(place_of, kind="stable")
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    back = np.argsort(order)[: len(points)]
    J, e, a = np.ascontiguousarray(J[rows].T), e[rows], fit.solution.information.sigma**-2.0
    W = leave_one_out.root(covariance)
    single = leave_one_out.single(W @ J, e, np.repeat(place_of[order], 3), a)
    blocks = np.repeat(number[order], 3)
    several, share = e.copy(), a * count / int(sampled.sum())
    masks = [blocks == block for block in np.unique(blocks)]
    information = [share * (J[:, rows_of] @ J[:, rows_of].T) for rows_of in masks]
    right = [share * (J[:, rows_of] @ e[rows_of]) for rows_of in masks]
    for rows_of, without in zip(masks, leave_one_out.LeftOutSolution.per_pose(W, information, right), strict=True):
        several[rows_of] = without.residuals(J[:, rows_of], e[rows_of], share)
    each = problem.weights[: len(points), None]
    return single.reshape(-1, 3)[back] / each, several.reshape(-1, 3)[back] / each, points


def of_targets(u: FloatArray, points: PointSet) -> dict[str, float | None]:
    """Root mean square length of residuals (points, 3) of each target and of all (``""``); None where one is open."""
    out = {"": closed(rms_length(u))}
    for k, name in enumerate(points.target_names):
        if (points.target == k).any():
            out[name] = closed(rms_length(u[points.target == k]))
    return out


FOLDS = 5
"""Parts of the cross-validation."""
FIT_S = 1e-5
"""Seconds that a point takes in a fit."""


def pose_errors(
    arm: Arm,
    points: PointSet,
    level: Level,
    folds: IntArray,
    known_targets: Mapping[str, ArrayLike] | None = None,
) -> FloatArray:
    """Mean distance of each pose under a model fitted to the other folds, shape (n,), metres."""
    errors = np.full(points.poses, np.nan)

    def leave_out(fold: int) -> None:
        out = folds == fold
        fitted = identify(arm, points.select(~out), level, known_targets)
        held_out = into_one_frame(points.select(out), fitted.robot.T_world_base, fitted.other_bases)
        distance = distances(fitted.robot, held_out)
        errors[out] = group_means(distance, held_out.pose, held_out.poses)

    for _ in parallel.threads(leave_out, range(folds.max() + 1), FIT_S * len(points) * (folds.max() + 1)):
        pass
    return errors


def choose_level(
    arm: Arm,
    points: PointSet,
    seed: int = 0,
    levels: Sequence[Level] | None = None,
    progress: Progress | None = None,
    known_targets: Mapping[str, ArrayLike] | None = None,
) -> LevelChoice:
    """Compare levels by cross-validation over poses and choose one.

    Going from small to large, a level replaces the one chosen so far only if it is better, pose by pose, by more
    than the standard error of that difference. Repeats of one place are one pose here.

    Parameters
    ----------
    arm : Arm
    points : PointSet
        Poses of the fit; held-out poses take no part.
    seed : int
        Of the division into five folds.
    levels : sequence of str, optional
        From small to large; all that the arm has unless given.
    progress : callable, optional
        Called with a text for each level.
    known_targets : dict of str to array_like, shape (3,), optional
        See `irbcal.identification.fit.identify`.

    Raises
    ------
    IdentificationError
        If not even the smallest level can be fitted.
    OptionError
        If there is no such level.
    """
    place_of = repeat_groups(points)
    places = int(place_of.max(initial=-1)) + 1
    folds = np.random.default_rng(seed).permutation(np.arange(places) % FOLDS)[place_of]
    compared = [checked("levels", level, LEVELS) for level in (levels_of(arm) if levels is None else levels)]
    table: list[Candidate] = []
    chosen, best = compared[0], np.zeros(0)
    for level in compared:
        if progress:
            progress(f"cross-validating model {level}")
        try:
            errors = group_means(pose_errors(arm, points, level, folds, known_targets), place_of)
        except (IdentificationError, RobotError) as error:
            if not table:
                raise
            refusal = Candidate(
                level=level, mean_mm=None, gain_mm=None, gain_std_mm=None, chosen=False, refused=str(error)
            )
            table.append(refusal)
            continue
        mean = float(errors.mean() / MM)
        better, gain, deviation = True, None, None
        if table:
            difference = (best - errors) / MM
            gain = float(difference.mean())
            deviation = float(difference.std(ddof=1) / np.sqrt(len(difference)))
            better = gain > deviation
        if better:
            chosen, best = level, errors
        table.append(Candidate(level=level, mean_mm=mean, gain_mm=gain, gain_std_mm=deviation, chosen=better))
    return LevelChoice(level=chosen, table=tuple(table), explanation=_explain(chosen, table, places))


def _explain(chosen: Level, table: Sequence[Candidate], poses: int) -> str:
    """Two sentences on the choice."""
    row = next(candidate for candidate in table if candidate.level == chosen)
    first = f"Model {chosen} has a cross-validated mean error of {row.mean_mm:.3f} mm over {poses} poses"
    if row.gain_mm is not None:
        first += f", {row.gain_mm:.3f} ± {row.gain_std_mm:.3f} mm better than the smaller model before it"
    larger = [candidate for candidate in table[table.index(row) + 1 :] if not candidate.refused]
    if larger:
        second = f"{_listed(larger)} not better by more than the standard error of the difference."
    else:
        second = "No larger model could be compared."
    return f"{first}. {second}"


def _listed(candidates: Sequence[Candidate]) -> str:
    """Levels as the subject of a sentence."""
    names = " and ".join(candidate.level for candidate in candidates)
    return f"The larger {inflected(len(candidates), f'model {names} is', f'models {names} are')}"
