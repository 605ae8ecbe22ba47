"""Residuals of each joint against its angle and the direction it came from, with the backlash they show.

The part of `irbcal.joint_behaviour.residuals` that every calibration report has; ``irbcal joints`` does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.joint_behaviour.linearised import Linearised
from irbcal.joint_behaviour.placing import placed
from irbcal.joint_behaviour.residuals import backlash_terms
from irbcal.joint_behaviour.terms import Term, judged
from irbcal.measurement.points import PointSet
from irbcal.modeling.robot import Robot
from irbcal.summary import Speaks, Told

MOST_BINS, FEWEST_BINS = 10, 2
FEWEST_IN_BIN = 5


@dataclass(frozen=True, eq=False, repr=False)
class Approach(Speaks):
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
    direction: FloatArray
    terms: tuple[Term, ...]
    angle: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """Backlash of each joint, in a sentence for each."""
        return [sentence for term in self.terms for sentence in term.told()]

    def headline(self) -> str:
        """The joints whose backlash was seen."""
        seen = ", ".join(str(term.joint) for term in self.terms if term.seen) or "none"
        return f"backlash by {self.points.poses} poses, seen of joints: {seen}"

    def by_angle(self, joint: int, sign: float) -> FloatArray:
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


def analyse(robot: Robot, points: PointSet, direction: ArrayLike) -> Approach:
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
    robot, points, step, _ = placed(robot, points.without_empty_poses(), step)
    terms, _, _, angle = backlash_terms(Linearised(robot, points, step))
    return Approach(robot, points, np.sign(step), tuple(judged(terms)), angle)
