"""All that the report of a calibration shows of its poses, computed in one place from what the calibration holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.errors import IrbcalError
from irbcal.io.schema import Record, Statistics
from irbcal.joint_analysis.residuals import ResidualAnalysis, analyse_residuals
from irbcal.measurement.points import PointSet
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling import frames
from irbcal.plotting.pose_errors import FROM_FEATURE, POSITION, ModelErrors, PoseErrors
from irbcal.units import MM
from irbcal.validation import accuracy, bootstrap
from irbcal.validation.accuracy import coverage
from irbcal.validation.comparing import Pair

MOST_POSES = 3000
"""Poses of a set that are drawn, and that backlash is looked for in; of more, ones drawn at random and the worst."""
WORST = 20


@dataclass(frozen=True, eq=False)
class PoseSet(PoseErrors):
    """One set of poses of a calibration, held out or fitted, with what the report says of it.

    Attributes
    ----------
    comparison : Pair or None
        Nominal against calibrated, pose by pose.
    nearer : float
        Share of the poses that are nearer to the calibrated robot than to the nominal one.
    covers : float
        See `irbcal.validation.accuracy.largest_covers`.
    points : PointSet or None
        None for calibrations that were saved without the measured places.
    direction : ndarray, shape (n, joints), or None
    of : int
        How many poses the set has, of which these are drawn.
    """

    comparison: Pair | None
    nearer: float
    covers: float
    points: PointSet | None
    direction: FloatArray | None
    of: int = 0


@dataclass(frozen=True, eq=False)
class Evidence(Locked):
    """What a calibration's poses say.

    Attributes
    ----------
    sets : tuple of PoseSet
        Held-out poses, if any, and fitted ones.
    joints : ResidualAnalysis or None
        Which terms each joint needs, from all poses; None where it cannot be had.
    joints_note : str
        Why there is none.
    coverage : dict or None
        Whether intervals hold on the held-out poses, see `irbcal.validation.accuracy.coverage`; None where none are
        held out, or nothing is known of intervals.
    """

    sets: tuple[PoseSet, ...]
    joints: ResidualAnalysis | None
    joints_note: str
    coverage: Mapping[str, Any] | None = None


def gather(calibration: Record) -> Evidence:
    """Compute everything that the report shows of a calibration's poses."""
    c = calibration
    sets = []
    for name, heldout, nominal, calibrated in (
        ("held-out", True, c.heldout_nominal, c.heldout),
        ("fitted", False, c.fit_nominal, c.fit),
    ):
        if calibrated is not None and nominal is not None and heldout in c.points.heldout:
            statistics = {"nominal": nominal.all, "calibrated": calibrated.all}
            sets.append(_pose_set(c, name, heldout, statistics))
    return Evidence(tuple(sets), *_joints(c), _coverage(c, sets))


def _coverage(c: Record, sets: list[PoseSet]) -> Mapping[str, Any] | None:
    proof = next((poses.points for poses in sets if poses.proves), None)
    if proof is None or c.model == "nominal":
        return None
    return coverage(c.robot_calibrated(), proof)


T = TypeVar("T")


def _pose_set(c: Record, name: str, heldout: bool, statistics: Mapping[str, Statistics]) -> PoseSet:
    table = c.points
    rows = np.flatnonzero(np.array(table.heldout, dtype=bool) == heldout)

    def column_of(column: list[T]) -> list[T]:
        return [column[k] for k in rows.tolist()]

    points, direction = c.used_points(heldout) or (None, None)
    target = column_of(table.target)
    if points is not None:
        pose, pose_names, groups = points.pose, points.pose_ids.tolist(), points.groups.tolist()
    else:
        pose, pose_names, groups = _runs(column_of(table.pose), column_of(table.group))
    spot = np.arange(len(pose_names)) if points is None else repeat_groups(points)
    errors = {model: np.array(getattr(table, f"{model}_mm"))[rows] * MM for model in statistics}
    per_pose = {model: np.bincount(pose, error) / np.bincount(pose) for model, error in errors.items()}
    gain = per_pose["nominal"] - per_pose["calibrated"]
    nearer = float(np.mean(gain > 0.0))
    robots_named = ("the calibrated robot", "the nominal robot")
    better, worse = robots_named if gain.mean() >= 0.0 else robots_named[::-1]
    compared: Pair | None = Pair.of(better, worse, gain if gain.mean() >= 0.0 else -gain, spot)
    intervals = {model: bootstrap.intervals(errors[model], spot[pose]) for model in statistics if name == "held-out"}
    covers, count = accuracy.largest_covers(len(np.unique(spot))), len(pose_names)
    if points is not None and direction is not None and count > MOST_POSES:
        drawn = _drawn(errors["calibrated"], pose, count)
        shown, keep = drawn[pose], np.flatnonzero(drawn)
        target = [target[k] for k in np.flatnonzero(shown)]
        pose_names, groups = ([column[k] for k in keep] for column in (pose_names, groups))
        errors = {model: values[shown] for model, values in errors.items()}
        per_pose = {model: values[keep] for model, values in per_pose.items()}
        points, direction = points.select(drawn), direction[keep]
        pose = points.pose
    robots = {"nominal": c.robot_nominal(), "calibrated": c.robot_calibrated()}
    if c.model == "nominal":
        del robots["calibrated"]
        compared = None
    T_base_world = frames.inverse(robots["nominal"].T_world_base)
    models = {
        model: ModelErrors(
            statistics[model],
            errors[model],
            per_pose[model],
            intervals.get(model),
            None if points is None else accuracy.error_vectors(robot, points) @ T_base_world[:3, :3].T,
            None if points is None else accuracy.turns(robot, points),
        )
        for model, robot in robots.items()
    }
    seen_at = None if points is None else frames.apply(T_base_world, points.xyz)
    return PoseSet(
        name,
        pose,
        tuple(pose_names),
        tuple(groups),
        tuple(target),
        models,
        seen_at,
        compared,
        nearer,
        covers,
        points,
        direction,
        count,
        what=POSITION if c.features is None else FROM_FEATURE,
    )


def _drawn(error: FloatArray, pose: IntArray, n: int) -> BoolArray:
    """Which of n poses are drawn."""
    drawn = np.isin(np.arange(n), np.random.default_rng(0).permutation(n)[:MOST_POSES])
    drawn[pose[np.argsort(-error, kind="stable")[:WORST]]] = True
    return drawn


def _runs(names: list[str], groups: list[str]) -> tuple[IntArray, list[str], list[str]]:
    """Poses of points in order: a new one begins where the name changes."""
    first = [k for k, name in enumerate(names) if k == 0 or name != names[k - 1]]
    pose = np.zeros(len(names), dtype=int)
    pose[first[1:]] = 1
    return np.cumsum(pose), [names[k] for k in first], [groups[k] for k in first]


def _joints(c: Record) -> tuple[ResidualAnalysis | None, str]:
    """Which terms each joint needs, and why nothing is known of it."""
    used = c.used_points(None)
    if used is None:
        return None, "this calibration was saved without the measured places"
    points, came_from = used
    if points.previous is None or not came_from.any():
        return None, "the order in which these poses were run is not known"
    try:
        return analyse_residuals(c.arm(calibrated=False), points, points.q - points.previous), ""
    except IrbcalError as error:
        return None, str(error)
