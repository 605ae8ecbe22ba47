"""Residuals of each joint against its angle and the direction it came from, with the backlash they show.

The part of `irbcal.joint_behaviour.residuals` that every calibration report has; ``irbcal axes`` does the rest.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.joint_behaviour import residuals as joint_residuals
from irbcal.joint_behaviour.terms import judged
from irbcal.measurement.points import PointSet
from irbcal.modeling.robot import Robot

MOST_BINS, FEWEST_BINS = 10, 2
FEWEST_IN_BIN = 5


@dataclass(frozen=True, eq=False)
class Approach:
    """What the residuals say of each joint's direction of approach.

    Attributes
    ----------
    robot : Robot
        With its base where these points say.
    points : PointSet
    direction : ndarray, shape (n, joints)
        1: reached from below, -1: from above, 0: not known.
    terms : tuple of Term
        Backlash by joint, see `irbcal.joint_behaviour.terms`.
    angle : ndarray, shape (n, joints)
        Residual about each joint with the backlash left in, radians (metres where it slides); NaN where unknown.
    """

    robot: Robot
    points: PointSet
    direction: np.ndarray
    terms: tuple
    angle: np.ndarray

    def by_angle(self, joint, sign):
        """Means over bins of one joint's angle, of poses reached from one side.

        Parameters
        ----------
        joint : int
            Counted from 0.
        sign : float
            1: from below, -1: from above.

        Returns
        -------
        ndarray, shape (bins, 3)
            Middle of the bin, mean residual and half-width of its 95 % interval, radians; bins of fewer than
            `FEWEST_IN_BIN` poses are left out.
        """
        q, angle = self.points.q[:, joint], self.angle[:, joint]
        have = np.isfinite(angle)
        bins = int(np.clip(have.sum() / (3 * FEWEST_IN_BIN), FEWEST_BINS, MOST_BINS))
        edges = np.unique(np.quantile(q[have], np.linspace(0, 1, bins + 1)))
        here = have & (self.direction[:, joint] == sign)
        which = np.digitize(q[here], edges[1:-1])
        rows = []
        for k in range(len(edges) - 1):
            inside = angle[here][which == k]
            if len(inside) >= FEWEST_IN_BIN:
                half = 1.96 * inside.std(ddof=1) / np.sqrt(len(inside))
                rows.append((q[here][which == k].mean(), inside.mean(), half))
        return np.array(rows).reshape(-1, 3)


def analyse(robot, points, direction):
    """Backlash and angular residuals of all joints, from any poses.

    Parameters
    ----------
    robot : Robot
        Calibrated, or nominal with base and targets.
    points : PointSet
    direction : ndarray, shape (n, joints)
        Sign of the last move of each joint, 0 where it is not known.

    Returns
    -------
    Approach

    Raises
    ------
    IdentificationError
        If there are too few poses or the robot is not that of the points.
    """
    step = np.asarray(direction, dtype=float)[np.isin(np.arange(points.poses), points.pose)]
    robot, points, step, _ = joint_residuals.placed(robot, points.without_empty_poses(), step)
    terms, _, _, angle = joint_residuals.backlash_terms(joint_residuals.Linearised(robot, points, step))
    return Approach(robot, points, np.sign(step), tuple(judged(terms)), angle)
