"""All that the report of a calibration shows of its poses, computed in one place from what the calibration holds."""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.joint_behaviour import approach as joint_approach
from irbcal.measurement.points import PointSet, rotation_distances
from irbcal.modeling import frames
from irbcal.units import MM
from irbcal.validation import accuracy, bootstrap, comparison

QUANTILES = 200
"""Ordered errors that a normal quantile plot shows at most, the largest `TAIL` always."""

TAIL = 20


@dataclass(frozen=True, eq=False)
class Model:
    """Errors of one model on one set of poses.

    Attributes
    ----------
    statistics : Statistics
        Of all points, as the calibration holds them.
    distance : ndarray, shape (m,)
        Of each point, metres.
    per_pose : ndarray, shape (n,)
        Mean distance of each pose's points, metres.
    intervals : dict or None
        See `irbcal.validation.bootstrap.intervals`.
    vector : ndarray, shape (m, 3), or None
        Measured minus predicted place of each point along the axes of the base link, metres.
    rotation : ndarray, shape (m,), or None
        Angle between measured and predicted target frame, radians, NaN where there is none.
    """

    statistics: object
    distance: np.ndarray
    per_pose: np.ndarray
    intervals: dict | None
    vector: np.ndarray | None
    rotation: np.ndarray | None

    def mean_vector(self, pose):
        """Mean error vector of each pose, shape (n, 3), metres."""
        return _mean_by(pose, self.vector)


@dataclass(frozen=True, eq=False)
class PoseSet:
    """One set of poses, held out or fitted, as the models see it.

    Attributes
    ----------
    name : str
        ``held-out`` or ``fitted``.
    pose : ndarray of int, shape (m,)
        Which pose each point belongs to.
    pose_names, groups : list of str, one for each pose
    target : list of str, one for each point
    models : dict of str to Model
        ``nominal`` and, but for the level of that name, ``calibrated``.
    comparison : Comparison or None
        Nominal against calibrated, pose by pose.
    covers : float
        See `irbcal.validation.accuracy.largest_covers`.
    points : PointSet or None
        None for calibrations that were saved without the measured places.
    direction : ndarray, shape (n, joints), or None
    place : ndarray, shape (m, 3), or None
        Measured place of each point in the base link, metres.
    """

    name: str
    pose: np.ndarray
    pose_names: list
    groups: list
    target: list
    models: dict
    comparison: object
    covers: float
    points: PointSet | None
    direction: np.ndarray | None
    place: np.ndarray | None

    @property
    def proves(self):
        """Whether the fit never saw these poses."""
        return self.name == "held-out"

    def mean_place(self):
        """Mean measured place of each pose's points in the base link, shape (n, 3), metres."""
        return _mean_by(self.pose, self.place)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a calibration's poses say.

    Attributes
    ----------
    sets : list of PoseSet
        Held-out poses, if any, and fitted ones.
    approach : Approach or None
        From the set with the better claim; None where it cannot be had.
    approach_name : str
        Name of that set.
    approach_note : str
        Why there is none.
    """

    sets: list
    approach: joint_approach.Approach | None
    approach_name: str
    approach_note: str


def gather(calibration):
    """Compute everything that the report shows of a calibration's poses.

    Parameters
    ----------
    calibration : Record

    Returns
    -------
    Evidence
    """
    c = calibration
    sets = []
    for name, heldout, nominal, calibrated in (
        ("held-out", True, c.heldout_nominal, c.heldout),
        ("fitted", False, c.fit_nominal, c.fit),
    ):
        if calibrated is not None and heldout in c.points.heldout:
            statistics = {"nominal": nominal.all, "calibrated": calibrated.all}
            sets.append(_pose_set(c, name, heldout, statistics))
    return Evidence(sets, *_approach(c, sets[0]))


def normal_quantiles(distance):
    """Ordered values against the quantiles of the normal distribution (Blom's places), thinned but for the ends.

    Parameters
    ----------
    distance : ndarray, shape (m,)

    Returns
    -------
    quantile, value : ndarray, shape (k,)
    """
    from scipy.special import ndtri

    value = np.sort(distance)
    n = len(value)
    rank = np.arange(n)
    step = max(1, -(-n // QUANTILES))
    shown = (rank % step == 0) | (rank >= n - TAIL)
    return ndtri((rank[shown] + 0.625) / (n + 0.25)), value[shown]


def _mean_by(pose, values):
    count = np.bincount(pose)
    return np.column_stack([np.bincount(pose, column) / count for column in values.T])


def _pose_set(c, name, heldout, statistics):
    table = c.points
    rows = [k for k, value in enumerate(table.heldout) if value == heldout]

    def of(column):
        return [column[k] for k in rows]

    points, direction = c.used_points(heldout) or (None, None)
    target = of(table.target)
    if points is not None:
        pose, pose_names, groups = points.pose, points.pose_ids.tolist(), points.groups.tolist()
    else:
        pose, pose_names, groups = _runs(of(table.pose), of(table.group))
    errors = {model: np.array(of(getattr(table, f"{model}_mm"))) * MM for model in statistics}
    compared = comparison.compare(errors["nominal"], errors["calibrated"], pose, np.array(pose_names, dtype=object))
    per_pose = {"nominal": compared.first, "calibrated": compared.second}
    robots = {"nominal": c.robot_nominal(), "calibrated": c.robot_calibrated()}
    if c.model == "nominal":
        del robots["calibrated"]
        compared = None
    T_base_world = frames.inverse(robots["nominal"].T_world_base)
    models = {
        model: Model(
            statistics[model],
            errors[model],
            per_pose[model],
            bootstrap.intervals(errors[model], pose) if name == "held-out" else None,
            None if points is None else accuracy.error_vectors(robot, points) @ T_base_world[:3, :3].T,
            None if points is None else _turns(robot, points),
        )
        for model, robot in robots.items()
    }
    place = None if points is None else frames.apply(T_base_world, points.xyz)
    covers = accuracy.largest_covers(len(pose_names))
    return PoseSet(name, pose, pose_names, groups, target, models, compared, covers, points, direction, place)


def _runs(names, groups):
    """Poses of points in order: a new one begins where the name changes."""
    first = [k for k, name in enumerate(names) if k == 0 or name != names[k - 1]]
    pose = np.zeros(len(names), dtype=int)
    pose[first[1:]] = 1
    return np.cumsum(pose), [names[k] for k in first], [groups[k] for k in first]


def _turns(robot, points):
    """Orientation error of each point, NaN where there is none; None where no point has one."""
    known = points.oriented() & np.isin(points.names().astype(str), list(robot.target_rotations))
    if not known.any():
        return None
    out = np.full(len(points), np.nan)
    out[known] = rotation_distances(robot, points)
    return out


def _approach(c, chosen):
    """Approach, name of its set, and why there is none."""
    if chosen.points is None:
        return None, chosen.name, "this calibration was saved without the measured places"
    if not chosen.direction.any():
        return None, chosen.name, "the order in which these poses were run is not known"
    robot = c.robot_nominal() if c.model == "nominal" else c.robot_calibrated()
    try:
        found = joint_approach.analyse(robot, chosen.points, chosen.direction)
    except IdentificationError as error:
        return None, chosen.name, str(error)
    if not np.isfinite(found.angle).any():
        return None, chosen.name, "no joint was reached from both sides"
    return found, chosen.name, ""
