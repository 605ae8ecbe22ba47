"""A measuring plan as data: which poses in which order, when, what was counted, and what it promises."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.identification.least_squares import HELD, ROUNDING, TIED, information_of
from irbcal.modeling import frames
from irbcal.planning import route
from irbcal.planning.exchange import DesignComparison
from irbcal.planning.information import Model
from irbcal.planning.scene import Scene
from irbcal.planning.sources import Tally
from irbcal.planning.wish import READINGS_S, Wish
from irbcal.units import UNIT_OUTSIDE


@dataclass(frozen=True)
class Predicted:
    """Predicted standard deviation of one error parameter.

    Attributes
    ----------
    name, unit : str
    std : float or None
        In the unit of the surface; None where the poses do not show the parameter by itself.
    state : str
        ``identified``, ``tied`` or ``held``, as in a calibration.
    """

    name: str
    unit: str
    std: float | None
    state: str


@dataclass(frozen=True, eq=False, repr=False)
class PlanPrediction(Locked):
    """What a plan promises, from the noise of the points alone: errors that no model describes are not in it.

    Attributes
    ----------
    model : Model
        With the reflectors that the plan measures.
    parameters : tuple of Predicted
    covariance : ndarray, shape (unknowns, unknowns)
        Of base, targets and error parameters, SI units; held combinations add nothing.
    """

    model: Model
    parameters: tuple[Predicted, ...]
    covariance: FloatArray

    def __repr__(self) -> str:
        single = sum(parameter.state == "identified" for parameter in self.parameters)
        return f"<Prediction: {single} of {len(self.parameters)} parameters identified by themselves>"

    def position_std(self, q: FloatArray, target: str) -> FloatArray:
        """Standard deviations of a reflector's predicted positions: root of the summed variances of x, y and z.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        target : str
            One that the plan measures.

        Returns
        -------
        ndarray, shape (n,)
            Metres.
        """
        index = self.model.targets.names.index(target)
        problem, state = self.model.problem(q, self.model.one(len(q), index))
        J = problem.jacobian(state)
        return np.sqrt(np.sum((J @ self.covariance) * J, axis=1).reshape(-1, 3).sum(axis=1))


def predict(model: Model, q: FloatArray, visible: BoolArray) -> PlanPrediction:
    """Standard deviations that a plan promises.

    Parameters
    ----------
    model : Model
    q : ndarray, shape (n, joints)
    visible : ndarray of bool, shape (n, k)
        Reflectors measured in each pose; those that no pose has are left out.

    Raises
    ------
    IdentificationError
        If the poses cannot determine base and targets, or are too few.
    """
    model, visible = model.measuring(visible)
    problem, state = model.problem(q, visible)
    H, _, _ = problem.normal_equations(state)
    information = information_of(problem, H, model.noise**2)
    solid = information.eigenvalues > ROUNDING * information.eigenvalues.max(initial=0.0)
    information = replace(information, sigma=model.noise, seen=solid & (information.eigenvalues > model.noise**2))
    covariance = information.covariance()
    std = np.sqrt(np.diag(covariance)[problem.outer :])
    out: list[Predicted] = []
    for parameter, value, share in zip(model.parameters, std, information.held_fraction(), strict=True):
        unit, factor = UNIT_OUTSIDE[parameter.unit]
        name = "held" if share > HELD else "tied" if share > TIED else "identified"
        out.append(Predicted(parameter.name, unit, float(value / factor) if name == "identified" else None, name))
    return PlanPrediction(model, tuple(out), covariance)


def stops(
    scene: Scene, wish: Wish, q: FloatArray, measured: BoolArray, start: FloatArray, over_home: BoolArray
) -> FloatArray:
    """When the robot stands still in each pose, seconds from the start, shape (n,).

    Moves are as quick as the slowest joint, or as the tip (Nubiola 2011, section 7.1: 500 mm/s, four seconds of rest).
    """
    q_before = np.concatenate([start[None], q[:-1]])
    home = np.broadcast_to(start, q.shape)
    direct = move_times(scene, wish, q_before, q)
    around = move_times(scene, wish, q_before, home) + move_times(scene, wish, home, q)
    hold = wish.hold_s(measured)
    times: FloatArray = np.cumsum(np.where(over_home, around, direct) + np.concatenate([[0.0], hold[:-1]]))
    return times


def move_times(scene: Scene, wish: Wish, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Seconds of each move, shape (m,)."""
    q_between, starts = route.between(q_from, q_to, scene.setting.arm.table.prismatic)
    tip = scene.setting.places(q_between)[0]
    pieces = np.append(np.linalg.norm(np.diff(tip, axis=0), axis=1), 0.0)
    pieces[starts[1:] - 1] = 0.0
    by_joint = route.move_times(q_from, q_to, scene.joint_speed)
    return np.maximum(by_joint, np.add.reduceat(pieces, starts) / wish.speed)


@dataclass(frozen=True, eq=False, repr=False)
class PlannedPoses(Locked):
    """Poses to measure, in their order, and what they promise.

    Attributes
    ----------
    scene : Scene
    wish : Wish
    q : ndarray, shape (n, joints)
        Commanded joints in the order of the run, radians (metres for prismatic joints).
    asked : ndarray of bool, shape (n, k)
        Reflectors measured in each pose.
    groups : ndarray of str, shape (n,)
    over_home : ndarray of bool, shape (n,)
        Poses to which the robot goes over its home joints, for the direct way is not free.
    tallies : dict of str to Tally
        Of each source of poses.
    prediction : PlanPrediction
    position_std : dict of str to ndarray
        Standard deviations of the first measured reflector's predicted position in ``cube`` and ``range``, metres.
    stops : ndarray, shape (n,)
        When the robot stands still in each pose, seconds from the start.
    comparison : DesignComparison or None
        Of optimal poses with random ones.
    notes : tuple of str
    """

    scene: Scene
    wish: Wish
    q: FloatArray
    asked: BoolArray
    groups: NameArray
    over_home: BoolArray
    tallies: dict[str, Tally]
    prediction: PlanPrediction
    position_std: dict[str, FloatArray]
    stops: FloatArray
    comparison: DesignComparison | None
    notes: tuple[str, ...]

    @property
    def hold_s(self) -> FloatArray:
        """Seconds of standing still in each pose: the wait and the readings, shape (n,)."""
        return self.wish.hold_s(self.asked)

    @property
    def duration_s(self) -> float:
        """Of the whole run, an estimate."""
        return float(self.stops[-1] + self.hold_s[-1])

    def expected(self) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Pose and reflector of each measurement, its place in the frame of the expected coordinates, and its time.

        Returns
        -------
        pose, target : ndarray of int, shape (m,)
        xyz : ndarray, shape (m, 3)
            Metres.
        time_s : ndarray, shape (m,)
        """
        pose, target = np.nonzero(self.asked)
        _, points, _ = self.scene.setting.places(self.q)
        number = (np.cumsum(self.asked, axis=1) - 1)[pose, target]
        time = self.stops[pose] + self.wish.wait_s + READINGS_S * number
        return pose, target, frames.apply(self.scene.T_world_base, points[pose, target]), time
