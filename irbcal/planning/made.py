"""A measuring plan as data: which poses in which order, when, and what was counted and predicted on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.modeling import frames
from irbcal.planning.exchange import DesignComparison
from irbcal.planning.prediction import PlanPrediction
from irbcal.planning.scene import Scene
from irbcal.planning.sources import Tally
from irbcal.planning.wish import READINGS_S, Wish


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
