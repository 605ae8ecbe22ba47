"""How the arm came to each measured pose: the stop before, the last move of each joint, what error terms depend on.

They follow from the order of a file, unless the errors show that the robot went in another order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement import repeats
from irbcal.measurement.input_table import without_gaps
from irbcal.measurement.points import PointSet
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion
from irbcal.units import DEG, MM


def motion_of(measurements: MeasurementSet, points: PointSet) -> Motion:
    """Joints, last moves and order of points' poses, from the order of the file that they come from.

    Without programmed joints the file's readings stand for them, and may lag.

    Parameters
    ----------
    measurements : MeasurementSet
        All poses of the file, in the order in which the robot visited them.
    points : PointSet
        Some of its poses.

    Returns
    -------
    Motion
        Time is the number of the pose, the mean number of poses that share a name and joints. The last move is zero
        where the stop before is not known. Inputs such as the payload are the points'.

    Raises
    ------
    MeasurementError
        If several loads were carried and it is not told where which.
    """
    names = measurements.per_pose("pose")
    stop, number = repeats.numbered((names, measurements.joints()), (points.pose_ids.astype(str), points.q))
    size = max(stop.max(initial=-1), number.max(initial=-1)) + 1
    count = np.bincount(stop, minlength=size)
    elapsed = (np.bincount(stop, np.arange(len(stop)), minlength=size) / np.maximum(count, 1))[number]
    known = inputs_of(points, measurements.source)
    return Motion(points.q, points.moves(), elapsed, known, not measurements.programmed)


def times_of(sets: Sequence[PointSet], timed: Sequence[tuple[PointSet, Motion]]) -> list[FloatArray | None]:
    """When poses were measured, from those of which it is known.

    Parameters
    ----------
    sets : sequence of PointSet
        In the order of measuring.
    timed : sequence of (PointSet, Motion)
        Poses with their times.

    Returns
    -------
    list of ndarray, shape (n,), or None
        One for each of ``sets``: poses that are not known lie between their neighbours; None where none is known.
    """
    with_times = [(points, motion.elapsed) for points, motion in timed if motion.elapsed is not None]
    number = repeats.numbered(*(_identities(points) for points in (*sets, *(points for points, _ in with_times))))
    times = np.full(1 + max((numbers_of_set.max(initial=-1) for numbers_of_set in number), default=-1), np.nan)
    for numbers, (_, elapsed) in zip(number[len(sets) :], with_times, strict=True):
        times[numbers] = elapsed
    out: list[FloatArray | None] = []
    for numbers in number[: len(sets)]:
        time = times[numbers]
        rows = np.flatnonzero(np.isfinite(time))
        out.append(np.interp(np.arange(len(time)), rows, time[rows]) if len(rows) else None)
    return out


def _identities(points: PointSet) -> tuple[NameArray, FloatArray]:
    """What tells poses from one another: session and name, and joints."""
    names = points.pose_ids.astype(str).astype(object)
    return names if points.session is None else points.session.astype(str).astype(object) + "\n" + names, points.q


def usual_load(loads: FloatArray | None) -> float | None:
    """The load that most poses carry, of equals the one of the last pose; None where no load is told.

    Parameters
    ----------
    loads : ndarray, shape (n,), or None
        Kg, NaN where not told.
    """
    if loads is None or not np.isfinite(loads).any():
        return None
    finite = loads[np.isfinite(loads)]
    values, count = np.unique(finite, return_counts=True)
    often = values[count == count.max()]
    return float(next(load for load in finite[::-1] if load in often))


def inputs_of(points: PointSet, source: str) -> dict[str, FloatArray]:
    """Inputs of the error model's terms at each pose: `without_gaps`; refusals name the file and the pose."""

    def refuse(bad: BoolArray, column: str, expected: str) -> None:
        if bad.any():
            raise MeasurementError(
                f"pose {points.pose_ids[bad][0]}: expected {expected}, found nothing", file=source, column=column
            )

    return without_gaps(points.inputs, points.q.shape[1], refuse)


def usual_centre(load: FloatArray, centre: FloatArray | None, usual_kg: float | None) -> tuple[float, float, float]:
    """Centre of the payload that counts where none is told: that of the usual load, else of the heaviest."""
    if centre is None:
        return 0.0, 0.0, 0.0
    usual = np.flatnonzero((load == usual_kg) & (load > 0.0))
    x, y, z = centre[usual[-1] if len(usual) else int(np.argmax(load))].tolist()
    return x, y, z


STILL = 2e-3 * DEG
"""Largest change of a joint, whole turns aside, that still counts as standing still."""
SURE = 2.0
"""Standard deviations by which the share of the last moves' effects that errors show must lie below one half."""


def last_moves(q: ArrayLike, groups: NameArray | None = None) -> FloatArray:
    """Last move of each joint before each pose.

    A joint that stands still keeps its last move: it still leans to the side it came from. The first pose and the first
    pose of each group follow a move that the file does not tell.

    Parameters
    ----------
    q : array_like, shape (n, joints)
        Joints in the order in which the robot visited them, radians.
    groups : ndarray of str, shape (n,), optional

    Returns
    -------
    ndarray, shape (n, joints)
        Radians, NaN where unknown.
    """
    q = np.asarray(q, dtype=float)
    change = np.vstack([np.full((min(len(q), 1), q.shape[1]), np.nan), np.diff(q, axis=0)])
    if groups is not None and len(q):
        change[np.r_[True, groups[1:] != groups[:-1]]] = np.nan
    moves_seen = ~(np.abs(change) <= STILL)
    last = np.maximum.accumulate(np.where(moves_seen, np.arange(len(q))[:, None], 0), axis=0)
    return np.take_along_axis(change, last, axis=0)


def previous_stops(q: FloatArray, pose: IntArray, groups: NameArray) -> FloatArray:
    """The stop before each pose, from the order of a file's rows.

    Where the robot stands still from one pose to the next (`STILL`), the next one is a repeat: it has the stop before
    of the first, because its joints still lean to the side they came from.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
        Joints of each pose, radians (metres for prismatic joints).
    pose : ndarray of int, shape (rows,)
        Pose of each row, in the order of the file.
    groups : ndarray of str, shape (rows,)
        Group of each row.

    Returns
    -------
    ndarray, shape (n, joints)
        NaN rows where it is not known: for the first pose of the file and of each stretch of a group, and for poses
        that stand in several places of the file behind different poses.
    """
    first = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])  # of each stretch of rows of one pose
    stops, stop_groups = pose[first], groups[first]
    previous = np.full((len(stops), q.shape[1]), np.nan)
    same_group = np.r_[False, stop_groups[1:] == stop_groups[:-1]]
    previous[same_group] = q[stops[np.flatnonzero(same_group) - 1]]
    repeat = same_group & (np.abs(previous - q[stops]) <= STILL).all(axis=1)
    previous = previous[np.maximum.accumulate(np.where(repeat, 0, np.arange(len(stops))))]
    out = np.full(q.shape, np.nan)
    out[stops[::-1]] = previous[::-1]  # the first stretch of each pose
    unlike = (previous != out[stops]).any(axis=1)
    out[stops[unlike]] = np.nan
    return out


def shown_share(robot: Robot, points: PointSet) -> tuple[float, float]:
    """How much of what a robot's joint map says of the last moves the measured points show.

    One where the stops before are right: the regression of the errors at unknown last moves on the difference that the
    moves make. Below one half, the moves make the errors larger. A shuffled file of poses all over the workspace still
    shows about one half: a joint far to one side mostly comes from the other.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        Not those of its fit.

    Returns
    -------
    share, std : float
        The standard deviation is that of independent poses; infinite where the moves make no difference.
    """
    without = replace(points, previous=None).predicted(robot)
    d = points.predicted(robot) - without
    e = points.xyz - without
    size = float(np.sum(d * d))
    if not size > 0.0:
        return 0.0, np.inf
    share = float(np.sum(d * e)) / size
    residual = np.bincount(points.pose, np.sum(d * (e - share * d), axis=1), points.poses)
    return share, float(np.linalg.norm(residual)) / size


def with_last_moves(robot: Robot, points: PointSet) -> tuple[PointSet, list[str]]:
    """Points with their stops before, unless the errors contradict the order of the file; and a note.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    points : PointSet
        Not those of its fit.

    Returns
    -------
    points : PointSet
        Without stops before where the order of the file is not that of the robot's way.
    notes : list of str
        Nothing where the robot's joint map does not depend on last moves.
    """
    if not robot.joint_map.has_history or not len(points):
        return points, []
    count = points.known_moves
    if not count:
        return points, [
            "The calibration knows what the last move of each joint changes, but the moves before these poses are "
            "not known: errors are those of unknown last moves."
        ]
    share, std = shown_share(robot, points)
    without = replace(points, previous=None)
    if share + SURE * std < 0.5:
        return without, [
            "The order of the file is not the order of measuring: the errors show "
            f"{share:.0%} of what the last moves by the file's order would change. Last moves are taken as unknown."
        ]
    means = [np.linalg.norm(p.xyz - p.predicted(robot), axis=1).mean() / MM for p in (points, without)]
    return points, [
        f"The order of the file tells the last move before {count} of {points.poses} poses, and the calibrated robot's "
        f"errors are those with it: {means[0]:.3f} mm mean; with last moves unknown it would be {means[1]:.3f} mm."
    ]
