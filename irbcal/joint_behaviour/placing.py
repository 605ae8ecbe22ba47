"""Where a robot stands by points of any poses, and which of these no joint could explain."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError
from irbcal.identification import outliers
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.registration import base_on
from irbcal.modeling.robot import Robot
from irbcal.units import MM

FARTHEST = 10 * MM
"""Median miss of the robot above which its residuals say nothing about single joints."""

FEWEST_POSES = 12

FACTOR = 8.0
"""Multiple of the median distance from the robot beyond which no joint explains a point."""


def placed(
    robot: Robot, points: PointSet, step: FloatArray
) -> tuple[Robot, PointSet, FloatArray, tuple[tuple[str, str, float], ...]]:
    """The robot with its base where the points say; points that no joint could explain are left out.

    Parameters
    ----------
    robot : Robot
        With the targets of the points.
    points : PointSet
    step : ndarray, shape (n, joints)
        Of each pose.

    Returns
    -------
    robot : Robot
    points : PointSet
    step : ndarray, shape (n, joints)
        Of the poses that are left.
    excluded : tuple of tuple
        (pose, target, distance in metres) of the points left out.

    Raises
    ------
    IdentificationError
        If the points were not measured on this robot, or there are too few poses.
    """
    excluded: tuple[tuple[str, str, float], ...] = ()
    while True:
        robot = base_on(robot, points)
        off = distances(robot, points)
        median = np.median(off)
        far = off > max(outliers.FLOORS["nominal"], FACTOR * median)
        if not far.any() or median > FARTHEST:
            break
        names = points.names()
        excluded += tuple((str(points.pose_ids[points.pose[k]]), names[k], float(off[k])) for k in np.flatnonzero(far))
        used = np.zeros(points.poses, dtype=bool)
        used[points.pose[~far]] = True
        points, step = points.take(~far).select(used).with_seen_targets(), step[used]
    if median > FARTHEST:
        raise IdentificationError(
            f"{robot.arm.name} misses the points by {median / MM:.4g} mm (median) even with its base placed anew: they "
            "were not measured on this robot with this tool"
        )
    if points.poses < FEWEST_POSES:
        raise IdentificationError(
            f"{points.poses} poses are too few to look for effects of single joints: at least {FEWEST_POSES} are needed"
        )
    return robot, points, step, excluded
