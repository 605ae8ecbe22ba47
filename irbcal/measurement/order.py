"""Whether the order of a file is the order in which the robot went to its poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.measurement.points import PointSet
from irbcal.modeling.robot import Robot
from irbcal.units import MM

SURE = 2.0
"""Standard deviations by which the share of the last moves' effects that errors show must lie below one half."""


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
