"""One identification from start to finish: level in, robot and parameter report out."""

from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import least_squares, start
from irbcal.identification.residuals import Problem
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.joint_map import Stiffness
from irbcal.modeling.parameters import level_parameters, thesis_count
from irbcal.modeling.robot import Robot
from irbcal.units import UNIT_OUTSIDE

MIN_POSES = 3
HELD, TIED = 0.99, 0.01
"""Share of a parameter in held directions above which it counts as held, and as tied."""


@dataclass(frozen=True)
class ParameterReport:
    """One parameter as it is reported.

    Attributes
    ----------
    name : str
    value, std : float
        At the surface's unit; ``std`` is None where the parameter was not identified by itself.
    unit : str
    state : str
        ``identified``, ``tied`` (only a combination with others was seen) or ``held``.
    reason : str
        Why it is not simply identified, in words; empty otherwise.
    """

    name: str
    value: float
    unit: str
    std: float | None
    state: str
    reason: str


@dataclass(frozen=True, eq=False)
class Fit:
    """An identified robot and what the identification knows about itself.

    Attributes
    ----------
    robot : Robot
    level : str
    problem : Problem
    solution : Solution
    stiffness_guess : Stiffness or None
        Physical guess that names the stiffness parameters; None for levels without stiffness.
    method, objective : str
        How it was identified and what was minimised.
    value : float or None
        The objective reached, metres; None for the root mean square, see `rms`.
    lower_bound : float or None
        Certified: no parameters give less, metres (objective ``max``).
    least_squares : Fit or None
        The least-squares fit that another objective started from, for comparison.
    history : History or None
        Course of an iterative method, where it was recorded.
    """

    robot: Robot
    level: str
    problem: Problem
    solution: least_squares.Solution
    stiffness_guess: Stiffness | None
    method: str = "least-squares"
    objective: str = "rms"
    value: float | None = None
    lower_bound: float | None = None
    least_squares: "Fit | None" = None
    history: object = None

    @property
    def rank(self):
        """Number of identified combinations, base and targets included."""
        return self.solution.information.rank

    @property
    def parameter_count(self):
        """Number of parameters as the thesis counts them, targets included."""
        return thesis_count(self.problem.parameters) + self.problem.outer - 6

    @property
    def rms(self):
        """Root mean square distance of the fitted points, metres."""
        residuals = self.problem.residuals(self.solution.state)[: len(self.problem.points)]
        return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))

    def predicted_covariance(self, q, target):
        """Covariance of a predicted reflector position from the identified parameters' uncertainty.

        Held combinations add nothing, and what the model cannot describe is not in it.

        Parameters
        ----------
        q : ndarray, shape (n, 6)
            Commanded joints, radians.
        target : str
            One of the fit's targets.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            In the measuring frame, m^2.
        """
        names = self.problem.points.target_names
        n = len(q)
        there = PointSet(
            q, np.arange(n), np.full(n, names.index(target)), np.zeros((n, 3)), names, np.arange(n), np.full(n, "")
        )
        state = self.solution.state
        problem = Problem(
            self.problem.arm, there, self.problem.parameters, self.problem.joint_map.phases, self.problem.known
        )
        J = problem.jacobian(state).reshape(n, 3, -1)
        C = self.solution.information.covariance()
        # orientations of target frames do not move its position: the new problem has no columns for them
        turns = np.arange(problem.outer, self.problem.outer)
        C = np.delete(np.delete(C, turns, axis=0), turns, axis=1)
        J = state.T_world_base[:3, :3] @ J
        return J @ C @ J.transpose(0, 2, 1)

    def parameters(self):
        """Every parameter with value, unit, standard deviation, state and reason.

        Standard deviations of the base's angles are those of small turns about the base's own axes, those of a
        target frame's angles of small turns about the tip link's.

        Returns
        -------
        list of ParameterReport
        """
        return _report(self)

    def held(self):
        """The held combinations in sentences, one for each direction the data do not show."""
        return [sentence for _, sentence in _held_sentences(self)]


def identify(arm, points, level="34", known_targets=None, parameters=None):
    """Identify base, targets and the error parameters of a level by least squares.

    No first guess is needed: base and targets come in closed form from the nominal arm, and the fit starts
    from there with analytic derivatives.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    level : str
        ``nominal``, ``11``, ``16``, ``26``, ``34`` (Nubiola 2011, section 5.4), ``34b``, or for any serial arm
        ``offsets`` or ``placement``.
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
    """
    problem, guess = make_problem(arm, points, level, known_targets, parameters)
    solution = least_squares.solve(problem, first_state(problem))
    return fit_of(problem, solution, level, guess)


def make_problem(arm, points, level="34", known_targets=None, parameters=None):
    """The problem of a level, refused with a sentence where the data are too few.

    Returns
    -------
    problem : Problem
    guess : Stiffness or None
        Physical guess that names the stiffness parameters, for levels that have them.
    """
    parameters = level_parameters(level, arm) if parameters is None else tuple(parameters)
    guess, phases = None, (0.0, np.pi / 2)
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


def _poses_missing(problem, spare):
    """How many more poses like these give one equation to spare."""
    per_pose = 3 * problem.rows / problem.points.poses
    return int(np.ceil((1 - spare) / per_pose))


def fit_of(problem, solution, level, guess):
    """The robot that a solution describes, with what the fit knows of itself."""
    arm, joint_map = problem.model(solution.state)
    names = problem.points.target_names
    targets = dict(zip(names, solution.state.targets, strict=True))
    rotations = {names[k]: solution.state.rotations[k] for k in problem.framed}
    robot = Robot(arm, joint_map, solution.state.T_world_base, targets, rotations)
    return Fit(robot, level, problem, solution, guess)


def first_state(problem):
    """Closed form; where the data leave it open, the best of a turn of nominal fits."""
    state, spread = start.closed_form(problem)
    if spread > 1e-5:
        return state
    nominal = Problem(problem.arm, problem.points, (), known_targets=problem.known)
    first, _ = start.closed_form(nominal)
    best, failure = None, None
    for candidate in [first, *start.turned_starts(nominal, first)]:
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


def _outside(value, unit):
    """Value in the surface's unit."""
    name, factor = UNIT_OUTSIDE[unit]
    return float(value) / factor, name


def _held_sentences(fit):
    """(indices of the error parameters involved, sentence) for each held direction."""
    information, problem = fit.solution.information, fit.problem
    names = [p.name for p in problem.parameters]
    out = []
    for leading, errors, others in information.held_directions():
        partners = [j for j in np.flatnonzero(np.abs(errors) > 0.05) if j != leading]
        tied = [names[j] for j in partners]
        # base and targets move too: translations and targets against 1 % of a plausible size
        base_moves = np.abs(others[:6]).max() > 0.01 * information.scale[leading]
        if base_moves:
            tied.append("the base")
        if np.abs(others[6:]).max(initial=0.0) > 1e-5:
            tied.append("the targets' coordinates")
        if tied:
            sentence = (
                f"{names[leading]} cannot be told from {_and(tied)} with these poses: held at the smallest change"
            )
        else:
            sentence = f"{names[leading]} has no effect on these poses: held at nominal"
        out.append(([leading, *partners], sentence))
    return out


def _and(words):
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def _report(fit):
    information, state = fit.solution.information, fit.solution.state
    covariance = information.covariance()
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = []

    def add(name, value, unit, deviation, state_name="identified", reason=""):
        value, outside = _outside(value, unit)
        deviation = None if deviation is None else _outside(deviation, unit)[0]
        rows.append(ParameterReport(name, value, outside, deviation, state_name, reason))

    hidden = np.linalg.norm(information.outer_null, axis=1) if information.outer_null.shape[1] else np.zeros(len(std))
    outer = "base and tool cannot be told apart in all ways: all axes of this arm are parallel"

    def add_outer(name, value, unit, deviation, share):
        free = share <= TIED
        add(name, value, unit, deviation if free else None, *(() if free else ("tied", outer)))

    T = state.T_world_base
    moved = T[:3, :3] @ covariance[3:6, 3:6] @ T[:3, :3].T
    moved_hidden = np.linalg.norm(T[:3, :3] @ information.outer_null[3:6], axis=1)
    base = frames.to_xyz_angles(T)
    for k, name in enumerate("xyz"):
        add_outer(f"base_{name}", base[k], "m", np.sqrt(moved[k, k]), moved_hidden[k])
    for k, name in enumerate(("rx", "ry", "rz")):
        add_outer(f"base_{name}", base[3 + k], "rad", std[k], hidden[k])
    names, b = fit.problem.points.target_names, 6
    for j in fit.problem.free:
        for k in range(3):
            add_outer(f"target_{names[j]}_{'xyz'[k]}", state.targets[j, k], "m", std[b + k], hidden[b + k])
        b += 3
    for j in fit.problem.framed:
        angles = frames.to_xyz_angles(frames.transform(state.rotations[j]))[3:]
        for k in range(3):
            add_outer(f"target_{names[j]}_r{'xyz'[k]}", angles[k], "rad", std[b + k], hidden[b + k])
        b += 3
    held = information.held_fraction()
    sentences = _held_sentences(fit)
    for j, parameter in enumerate(fit.problem.parameters):
        reason = "; ".join(text for members, text in sentences if j in members)
        if held[j] > HELD:
            add(parameter.name, state.errors[j], parameter.unit, None, "held", reason)
        elif held[j] > TIED:
            add(parameter.name, state.errors[j], parameter.unit, None, "tied", reason)
        else:
            add(parameter.name, state.errors[j], parameter.unit, std[b + j])
    if fit.stiffness_guess is not None:
        _add_physical_stiffness(fit, covariance[b:, b:], add)
    return rows


def _add_physical_stiffness(fit, covariance, add):
    """The four named parameters of section 5.3: two follow from A and B, two stay at their guess."""
    guess = fit.stiffness_guess
    kinds = [p.kind for p in fit.problem.parameters]
    pair = [j for j, kind in enumerate(kinds) if kind == "stiffness"]
    A, B = fit.solution.state.errors[pair]
    found = guess.with_coefficients(A, B)
    physical = "acts only through stiffness_A and stiffness_B: held at the physical guess"
    if found is None:
        reason = "no physical stiffness gives these A and B: the joint map uses A and B themselves"
        for name, unit in (("delta_L", "m"), ("L_G2", "m"), ("L_G1", "m"), ("m", "1")):
            add(f"stiffness_{name}", getattr(guess, name), unit, None, "held", reason)
        return
    C = covariance[np.ix_(pair, pair)]
    around = [guess.with_coefficients(A + a, B + b) for a, b in ((1e-7, 0), (-1e-7, 0), (0, 1e-7), (0, -1e-7))]
    for name in ("delta_L", "L_G2"):
        if None in around:  # at the edge of what stiffness can be
            add(f"stiffness_{name}", getattr(found, name), "m", None, "held", "at the edge of what stiffness can be")
            continue
        values = [getattr(item, name) for item in around]
        gradient = np.array([values[0] - values[1], values[2] - values[3]]) / 2e-7
        deviation = float(np.sqrt(gradient @ C @ gradient))
        add(
            f"stiffness_{name}",
            getattr(found, name),
            "m",
            deviation,
            "identified",
            "from stiffness_A and stiffness_B with L_G1 and m at their guess",
        )
    for name, unit in (("L_G1", "m"), ("m", "1")):
        add(f"stiffness_{name}", getattr(found, name), unit, None, "held", physical)
