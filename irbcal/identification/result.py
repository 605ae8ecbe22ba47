"""What an identification found, and what it knows of its own certainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.identification import least_squares
from irbcal.identification.choices import Level, Method, Objective
from irbcal.identification.history import History
from irbcal.identification.observability import HELD, TIED
from irbcal.identification.residuals import Problem
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.parameters import thesis_count
from irbcal.modeling.robot import Robot
from irbcal.modeling.stiffness import Stiffness
from irbcal.summary import Speaks, Table, Told
from irbcal.units import MM, UNIT_OUTSIDE

if TYPE_CHECKING:
    import pandas as pd

ParameterState: TypeAlias = Literal["identified", "tied", "held"]

REACHED = {"rms": "fitted rms", "max": "largest fitted error", "pnorm": "p-norm of the fitted errors"}
"""Objective -> what its value is called."""

DIFFERENCE = 1e-7
"""Of the derivatives of the physical stiffness by A and B, radians."""


THROUGH = "acts only through stiffness_A and stiffness_B: held at the physical guess"
"""Why two of the four physical parameters of the stiffness are held (Nubiola 2011, section 5.4)."""


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
    state: ParameterState
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Speaks):
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
    level: Level
    problem: Problem
    solution: least_squares.Solution
    stiffness_guess: Stiffness | None
    method: Method = "least-squares"
    objective: Objective = "rms"
    value: float | None = None
    lower_bound: float | None = None
    least_squares: Fit | None = None
    history: History | None = None

    def __post_init__(self) -> None:
        lock(self)

    @property
    def rank(self) -> int:
        """Number of identified combinations, base and targets included."""
        return self.solution.information.rank

    @property
    def other_bases(self) -> dict[str, FloatArray]:
        """Base (4, 4) in the measuring frame of each session but the last one."""
        return dict(zip(self.problem.sessions[:-1], self.solution.state.others, strict=True))

    @property
    def parameter_count(self) -> int:
        """Number of parameters as the thesis counts them (Nubiola 2011, section 5.4), targets included."""
        return thesis_count(self.problem.parameters) + self.problem.outer - 6

    @property
    def rms(self) -> float:
        """Root mean square distance of the fitted points, metres."""
        residuals = self.problem.residuals(self.solution.state)[: len(self.problem.points)]
        return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))

    def predicted_covariance(self, q: FloatArray, target: str) -> FloatArray:
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

        Raises
        ------
        RobotError
            If the target is not one of the fit's.
        """
        names = self.problem.points.target_names
        if target not in names:
            raise RobotError(f"unknown target {target!r}: this fit has {', '.join(names)}")
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
        # target frames and bases of other sessions do not move its position: the new problem has no columns for them
        turns = np.arange(problem.outer, self.problem.outer)
        C = np.delete(np.delete(C, turns, axis=0), turns, axis=1)
        J = state.T_world_base[:3, :3] @ J
        return J @ C @ J.transpose(0, 2, 1)

    def parameters(self) -> list[ParameterReport]:
        """Every parameter with value, unit, standard deviation, state and reason.

        Standard deviations of the base's angles are those of small turns about the base's own axes, those of a
        target frame's angles of small turns about the tip link's.

        Returns
        -------
        list of ParameterReport
        """
        return _report(self)

    def held(self) -> list[str]:
        """What is held, in sentences: directions that the data do not show, and what acts through others only.

        As many as `parameter_count` exceeds `rank`.
        """
        stiff = any(p.kind == "stiffness" for p in self.problem.parameters)
        through = [f"stiffness_{name} {THROUGH}" for name in ("L_G1", "m") if stiff]
        return [*(sentence for _, sentence in _held_sentences(self)), *through]

    def told(self) -> Sequence[Told]:
        """Model, poses and what was reached; every parameter with its standard deviation; what is held and why."""
        headline = (
            f"{self.problem.arm.name}, model {self.level}: {self.rank} independent combinations of "
            f"{self.parameter_count} parameters identified from {self.problem.points.poses} poses ({self._reached()})"
        )
        reports = self.parameters()
        rows = tuple((row.name, row.value, row.std, row.unit, row.state) for row in reports)
        table = Table("Parameters with standard deviations", ("parameter", "value", "±", "unit", "state"), rows, 5)
        held = [f"  held: {sentence}" for sentence in self.held()]
        other = [row for row in reports if row.name.startswith("stiffness_") and row.reason and row.reason != THROUGH]
        held += [f"  {row.name}: {row.reason}" for row in other]
        return (headline, table, *held)

    def _reached(self) -> str:
        """What the method reached, in words."""
        value = self.rms if self.value is None else self.value
        text = f"{REACHED[self.objective]} {value / MM:.3f} mm"
        if self.lower_bound is not None:
            text += f", certified: not below {self.lower_bound / MM:.3f} mm with this model"
        return text if self.method == "least-squares" else f"method {self.method}, {text}"

    def to_frame(self) -> pd.DataFrame:
        """The parameters, a row each: name, value, unit, std (NaN where not identified), state and reason."""
        import pandas as pd

        columns = ["name", "value", "unit", "std", "state", "reason"]
        frame = pd.DataFrame([asdict(row) for row in self.parameters()], columns=columns)
        return frame.astype({"value": float, "std": float})


def _outside(value: float, unit: str) -> tuple[float, str]:
    """Value in the surface's unit."""
    name, factor = UNIT_OUTSIDE[unit]
    return float(value) / factor, name


def _held_sentences(fit: Fit) -> list[tuple[list[int], str]]:
    """(indices of the error parameters involved, sentence) for each held direction."""
    information, problem = fit.solution.information, fit.problem
    names = [p.name for p in problem.parameters]
    out = []
    for leading, errors, others in information.held_directions():
        partners = [int(j) for j in np.flatnonzero(np.abs(errors) > 0.05) if j != leading]
        tied = [names[j] for j in partners]
        # base and targets move too: translations and targets against 1 % of a plausible size
        tools = others[6 : problem.others]
        base_moves = np.abs(np.r_[others[:6], others[problem.others :]]).max() > 0.01 * information.scale[leading]
        if base_moves:
            tied.append("the base")
        if np.abs(tools).max(initial=0.0) > 1e-5:
            tied.append("the targets' coordinates")
        if tied:
            sentence = (
                f"{names[leading]} cannot be told from {_and(tied)} with these poses: held at the smallest change"
            )
        else:
            sentence = f"{names[leading]} has no effect on these poses: held at nominal"
        out.append(([leading, *partners], sentence))
    return out


def _and(words: Sequence[str]) -> str:
    """Words in a list with "and" before the last."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


class _Rows:
    """The report as it grows; values and standard deviations come in SI units."""

    def __init__(self) -> None:
        self.reports: list[ParameterReport] = []

    def add(
        self,
        name: str,
        value: float,
        unit: str,
        std: float | None,
        state: ParameterState = "identified",
        reason: str = "",
    ) -> None:
        value, outside = _outside(value, unit)
        std = None if std is None else _outside(std, unit)[0]
        self.reports.append(ParameterReport(name, value, outside, std, state, reason))


def _report(fit: Fit) -> list[ParameterReport]:
    information = fit.solution.information
    covariance = information.covariance()
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rows = _Rows()
    _add_outer(fit, covariance, std, rows)
    b = fit.problem.outer
    held = information.held_fraction()
    sentences = _held_sentences(fit)
    for j, parameter in enumerate(fit.problem.parameters):
        value = fit.solution.state.errors[j]
        reason = "; ".join(text for members, text in sentences if j in members)
        if held[j] > HELD:
            rows.add(parameter.name, value, parameter.unit, None, "held", reason)
        elif held[j] > TIED:
            rows.add(parameter.name, value, parameter.unit, None, "tied", reason)
        else:
            rows.add(parameter.name, value, parameter.unit, std[b + j])
    if fit.stiffness_guess is not None:
        _add_physical_stiffness(fit, fit.stiffness_guess, covariance[b:, b:], rows)
    return rows.reports


def _add_outer(fit: Fit, covariance: FloatArray, std: FloatArray, rows: _Rows) -> None:
    """Base and targets, which have no nominal values."""
    information, state = fit.solution.information, fit.solution.state
    hidden = np.linalg.norm(information.outer_null, axis=1) if information.outer_null.shape[1] else np.zeros(len(std))
    reason = "base and tool cannot be told apart in all ways: all axes of this arm are parallel"

    def add(name: str, value: float, unit: str, deviation: float, share: float) -> None:
        if share <= TIED:
            rows.add(name, value, unit, deviation)
        else:
            rows.add(name, value, unit, None, "tied", reason)

    def _of_angles(R: FloatArray, outside: bool, at: int) -> tuple[FloatArray, FloatArray]:
        """Standard deviations and hidden shares of the angles of a frame, from those of a rotation vector."""
        D, part = frames.angles_derivative(R, outside), slice(at, at + 3)
        hidden_part = np.linalg.norm(D @ information.outer_null[part], axis=1) / np.linalg.norm(D, axis=1)
        return np.sqrt(np.maximum(np.diag(D @ covariance[part, part] @ D.T), 0.0)), hidden_part

    def add_base(label: str, T: FloatArray, at: int) -> None:
        part = slice(at + 3, at + 6)
        moved = T[:3, :3] @ covariance[part, part] @ T[:3, :3].T
        moved_hidden = np.linalg.norm(T[:3, :3] @ information.outer_null[part], axis=1)
        base = frames.to_xyz_angles(T)
        turned, turned_hidden = _of_angles(T[:3, :3], False, at)
        for k, name in enumerate("xyz"):
            add(f"{label}_{name}", base[k], "m", np.sqrt(moved[k, k]), moved_hidden[k])
        for k, name in enumerate(("rx", "ry", "rz")):
            add(f"{label}_{name}", base[3 + k], "rad", turned[k], turned_hidden[k])

    add_base("base", state.T_world_base, 0)
    names, b = fit.problem.points.target_names, 6
    for j in fit.problem.free:
        for k in range(3):
            add(f"target_{names[j]}_{'xyz'[k]}", state.targets[j, k], "m", std[b + k], hidden[b + k])
        b += 3
    for j in fit.problem.framed:
        angles = frames.to_xyz_angles(frames.transform(state.rotations[j]))[3:]
        turned, turned_hidden = _of_angles(state.rotations[j], True, b)
        for k in range(3):
            add(f"target_{names[j]}_r{'xyz'[k]}", angles[k], "rad", turned[k], turned_hidden[k])
        b += 3
    for session, T in fit.other_bases.items():
        add_base(f"base@{session}", T, b)
        b += 6


def _add_physical_stiffness(fit: Fit, guess: Stiffness, covariance: FloatArray, rows: _Rows) -> None:
    """The four named parameters of Nubiola 2011, section 5.3: two follow from A and B, two stay at their guess."""
    kinds = [p.kind for p in fit.problem.parameters]
    pair = [j for j, kind in enumerate(kinds) if kind == "stiffness"]
    A, B = fit.solution.state.errors[pair]
    found = guess.with_coefficients(A, B)
    if found is None:
        reason = "no physical stiffness gives these A and B: the joint map uses A and B themselves"
        for name, unit in (("delta_L", "m"), ("L_G2", "m"), ("L_G1", "m"), ("m", "1")):
            rows.add(f"stiffness_{name}", getattr(guess, name), unit, None, "held", reason)
        return
    C = covariance[np.ix_(pair, pair)]
    steps = ((DIFFERENCE, 0.0), (-DIFFERENCE, 0.0), (0.0, DIFFERENCE), (0.0, -DIFFERENCE))
    around = [guess.with_coefficients(A + a, B + b) for a, b in steps]
    for name in ("delta_L", "L_G2"):
        value = getattr(found, name)
        if None in around:
            rows.add(f"stiffness_{name}", value, "m", None, "held", "at the edge of what stiffness can be")
            continue
        values = [getattr(item, name) for item in around]
        gradient = np.array([values[0] - values[1], values[2] - values[3]]) / (2 * DIFFERENCE)
        reason = "from stiffness_A and stiffness_B with L_G1 and m at their guess"
        if name == "L_G2":  # as wrong as these guesses, whatever the data say
            rows.add(f"stiffness_{name}", value, "m", None, "tied", reason)
            continue
        rows.add(f"stiffness_{name}", value, "m", float(np.sqrt(gradient @ C @ gradient)), "identified", reason)
    for name, unit in (("L_G1", "m"), ("m", "1")):
        rows.add(f"stiffness_{name}", getattr(found, name), unit, None, "held", THROUGH)
