"""Outliers and files that do not fit, seen against robots that wrong points cannot bend, before identification."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked, smallest
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import data_entry_errors
from irbcal.identification.choices import Level
from irbcal.identification.fit import identify
from irbcal.identification.outlier_rule import RULE, OutlierRule
from irbcal.identification.problem import Problem, State
from irbcal.measurement.points import TOO_FAR, PointSet, distances
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import default_level, level_parameters
from irbcal.modeling.robot import Robot
from irbcal.units import MM

TRIMMED_TO = 0.6
"""Share of the points whose squares are the least trimmed ones: a robot is fitted to these."""

CONCENTRATION_STEPS = 20
"""How often that share is chosen again at most."""

EQUATIONS = 3.0
"""Equations of that share for each unknown, below which a level is not tried."""

MOST_POSES = 2000
"""Poses that robots are fitted to, while outliers are looked for; of more, ones drawn at random."""


@dataclass(frozen=True, eq=False)
class Outliers(Locked):
    """Points that no robot of this kind could have reached."""

    keep: BoolArray
    """Shape (m,)."""
    distance: FloatArray
    """Shape (m,). From the robot, metres."""
    robot: Robot
    """Fitted to the good points."""
    level: Level
    """At which it was fitted."""


def find_outliers(
    arm: Arm,
    points: PointSet,
    source: str = "the measurements",
    measurements: MeasurementSet | None = None,
    rule: OutlierRule = RULE,
) -> Outliers:
    """Points that no robot of this kind could have reached.

    The nominal robot (base and tool identified) is fitted to the 60 % of the points that it fits best, which up to
    40 % of wrong points cannot bend (least trimmed squares by concentration). Then the same is done with offsets of
    all joints, and with the level that is built for the arm, as far as there are equations enough: a zero of a joint
    that is off by a degree hides an outlier from the nominal robot. A point is an outlier if it is farther from the
    last of these than the rule's limit: 12 times what 30 % of all stay below, and a floor of 5, 2 or 1 mm.

    Parameters
    ----------
    arm : Arm
    points : PointSet
    source : str
        File name for messages.
    measurements : MeasurementSet, optional
        The file, for the number of a row in messages.
    rule : OutlierRule

    Raises
    ------
    MeasurementError
        If the file looks like one data-entry error or two, or a row is lost, see
        `irbcal.identification.data_entry_errors`.
    IdentificationError
        If the robot does not fit the points at all.
    """
    subset = points
    if points.poses > MOST_POSES:
        chosen = np.isin(np.arange(points.poses), np.random.default_rng(0).permutation(points.poses)[:MOST_POSES])
        subset = points.select(chosen)
        if len(np.unique(subset.target)) < len(points.target_names):  # a target that few poses saw
            subset = points
    try:
        robot = least_trimmed_squares(arm, subset)
    except IdentificationError as error:
        _refuse_data_entry_error(arm, points, np.inf, source, measurements)
        raise IdentificationError(str(error), file=source) from None
    distance = distances(robot, points)
    median = np.median(distance)
    if median > TOO_FAR * points.spread():
        _refuse_data_entry_error(arm, points, median, source, measurements)
        raise IdentificationError(
            f"{arm.name} misses the measured points by {median / MM:.3g} mm (median) even with the best base and tool: "
            "wrong robot file, joint order or joint signs, rows that belong to other poses, a left-handed measuring "
            "frame, or a base or tool that moved between the poses?",
            file=source,
        )
    level: Level = "nominal"
    for closer in dict.fromkeys(("offsets", default_level(arm))):
        closer_robot = _closer(arm, subset, distances(robot, subset), closer, rule)
        nearer = None if closer_robot is None else distances(closer_robot, points)
        if closer_robot is not None and nearer is not None and np.median(nearer) < np.median(distance):
            robot, level, distance = closer_robot, closer, nearer
    return Outliers(distance <= rule.distance_limit(distance, level), distance, robot, level)


def _closer(arm: Arm, points: PointSet, distance: FloatArray, level: Level, rule: OutlierRule) -> Robot | None:
    """The robot of a level fitted to the good points; None where there are too few of them."""
    of_a_pose = min(3.0 * len(points) / points.poses, 6.0)
    unknowns = 6 + 3 * len(points.target_names) + len(level_parameters(level, arm))
    if TRIMMED_TO * points.poses * of_a_pose < EQUATIONS * unknowns:
        return None
    try:
        robot = least_trimmed_squares(arm, points, level, distance)
        # what is good by now is more than that share, and gives a better robot
        good = points.take((d := distances(robot, points)) <= rule.distance_limit(d, level)).without_empty_poses()
        better = identify(arm, good.with_seen_targets(), level).robot
    except IdentificationError:
        return None
    return better if set(better.targets) == set(points.target_names) else None


def least_trimmed_squares(
    arm: Arm, points: PointSet, level: Level = "nominal", distance: FloatArray | None = None
) -> Robot:
    """The robot of a level fitted to the part of the points that it fits best.

    Parameters
    ----------
    arm : Arm
    points : PointSet
    level : str
    distance : ndarray, shape (m,), optional
        From a robot to start with, metres.

    Returns
    -------
    Robot
        Fitted to all points where a part of them is too few.

    Raises
    ------
    IdentificationError
        If the data do not allow it.
    """
    of_all = None
    state: State | None = None
    if distance is None:
        of_all = identify(arm, points, level).robot
        distance = distances(of_all, points)
    robot, core = of_all, None
    for _ in range(CONCENTRATION_STEPS):
        new = smallest(distance, TRIMMED_TO)
        if core is not None and state is not None:
            if (new == core).all():
                break
            new, state = _concentration_steps(arm, points, level, state, new)
        core = new
        try:
            fit = identify(arm, points.take(core).without_empty_poses().with_seen_targets(), level, start=state)
        except IdentificationError:  # too few for a part of them: all are needed
            return of_all or identify(arm, points, level).robot
        robot, state = fit.robot, fit.solution.state
        if set(robot.targets) != set(points.target_names):
            return of_all or identify(arm, points, level).robot
        distance = distances(robot, points)
    assert robot is not None
    return robot


def _concentration_steps(
    arm: Arm, points: PointSet, level: Level, state: State, core: BoolArray
) -> tuple[BoolArray, State]:
    """The part of the points that a robot of the level fits best, and that robot, linearised at a state near it."""
    problem = Problem(arm, points, level_parameters(level, arm))
    J, r, at = np.empty((problem.unknowns, 3, problem.rows)), np.empty((3, problem.rows)), problem.arm_at(state)
    for k in range(problem.block_count):
        r[:, problem.rows_of(k)], J[:, :, problem.rows_of(k)] = problem.block(k, at, state)
    columns = np.concatenate([problem.weights * J, (problem.weights * r)[None]])
    core_matrix, core_before, step = np.zeros((len(columns),) * 2), np.zeros_like(core), np.zeros(problem.unknowns)
    for _ in range(CONCENTRATION_STEPS):
        changed, of_pose = core != core_before, points.oriented()
        if not changed.any():
            break
        sign = np.where(core, 1.0, -1.0)  # sums of the part change by those of the points that enter and leave it
        sign = np.tile(np.concatenate([sign[changed], sign[of_pose][changed[of_pose]]]), 3)
        taken = columns[..., np.concatenate([changed, changed[of_pose]])].reshape(len(columns), -1)
        core_matrix += (sign * taken) @ taken.T
        H, size = core_matrix[:-1, :-1].copy(), core_matrix[-1, -1] / (3.0 * (core.sum() + core[of_pose].sum()))
        H += 1e-9 * H.diagonal().max() * np.eye(len(H))  # of what nothing tells, as a target without points
        H[problem.nuisance :, problem.nuisance :] += np.diag(size / problem.scales**2)
        step = np.linalg.solve(H, core_matrix[:-1, -1])
        core_before, core = (
            core,
            smallest(np.linalg.norm((r - np.tensordot(step, J, 1))[:, : len(points)], axis=0), TRIMMED_TO),
        )
    return core, problem.moved(state, step)


def _refuse_data_entry_error(
    arm: Arm, points: PointSet, median: float, source: str, measurements: MeasurementSet | None
) -> None:
    """Name the lost row or the data-entry error that explains why a file does not fit."""
    lost = data_entry_errors.find_lost_row(arm, points)
    if lost is not None:
        raise MeasurementError(lost.in_words(measurements), file=source)
    data_entry_error = data_entry_errors.find_data_entry_error(arm, points, median)
    if data_entry_error is not None:
        raise MeasurementError(data_entry_error.in_words(source), file=source)
