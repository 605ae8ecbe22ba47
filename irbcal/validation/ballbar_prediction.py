"""What a ballbar is expected to show: radial errors of a circle that the robot runs (Nubiola 2011, annex VI).

The controller runs the circle with its nominal model; the calibrated model tells where the tool truly goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.paths import Circle, Reversal, joint_history, reversals
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.validation.ballbar_circle import TiltedCircle
from irbcal.validation.ballbar_trace import Trace, trace_of_points

SAMPLES = 720
"""Places on a circle at which errors are predicted."""


@dataclass(frozen=True, eq=False, repr=False)
class BallbarPrediction:
    """What a ballbar is expected to show.

    Attributes
    ----------
    uncorrected : Trace
        Path of the controller's nominal model, run by the calibrated robot.
    corrected : Trace or None
        Path through fake targets, run by the calibrated robot.
    arcs : int
        Circular moves of the corrected path.
    reversals : tuple of Reversal
        Joints that turn back (Tables A VI-1, A VI-2 and A VI-3); places are fractions of the path.
    q : ndarray, shape (n, 6)
        Joint history (Figures A VI-2, A VI-5 and A VI-8), radians.
    """

    uncorrected: Trace
    corrected: Trace | None
    arcs: int
    reversals: tuple[Reversal, ...]
    q: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    def __repr__(self) -> str:
        fake = "no fake targets" if self.corrected is None else f"fake targets in {self.arcs} arcs"
        return f"<Prediction: {len(self.q)} places on the circle, {fake}, {len(self.reversals)} reversals>"


def predict(
    path: TiltedCircle,
    robot: Robot,
    nominal: Arm,
    q_center: FloatArray,
    arcs: int = 6,
    T_tip_tcp: FloatArray | None = None,
    samples: int = SAMPLES,
) -> BallbarPrediction:
    """Radial errors of a circular path that the nominal controller runs, without and with fake targets (annex VI).

    Parameters
    ----------
    path : TiltedCircle
        See `irbcal.validation.ballbar_circle.circle`.
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    q_center : ndarray, shape (6,)
        Joints that tell the configuration, radians.
    arcs : int
        Circular moves of the corrected path, two or more; 0: only the uncorrected one.
    T_tip_tcp : ndarray, shape (4, 4), optional
    samples : int

    Returns
    -------
    Prediction

    Raises
    ------
    RobotError
        If the robot does not reach every place, or a target cannot be corrected.
    """
    s = np.arange(samples) / samples
    q = joint_history(path, nominal, q_center, s, T_tip_tcp)
    tcp = np.eye(4) if T_tip_tcp is None else T_tip_tcp
    uncorrected = trace_of_points(path, (robot.poses(q) @ tcp)[:, :3, 3])
    corrected = None
    if arcs:
        corrected = trace_of_points(path, _corrected_points(path, robot, nominal, q_center, arcs, tcp, samples))
    return BallbarPrediction(uncorrected, corrected, arcs, tuple(_reversals(q, s)), q)


def _reversals(q: FloatArray, s: FloatArray) -> Sequence[Reversal]:
    """Joint reversals of a closed path, its seam included."""
    step = s[1] - s[0]
    if np.abs(q[0] - q[-1]).max() > 10 * np.abs(np.diff(q, axis=0)).max():
        return reversals(q, s)  # a joint that turned as a whole does not come back
    return reversals(np.vstack([q, q[:2]]), np.append(s, s[-1] + step * np.array([1, 2])))


def _corrected_points(
    path: TiltedCircle,
    robot: Robot,
    nominal: Arm,
    q_center: FloatArray,
    arcs: int,
    T_tip_tcp: FloatArray,
    samples: int,
) -> FloatArray:
    """Where the tool truly goes between fake targets: the controller runs its own arcs between them."""
    if arcs < 2:
        raise RobotError("a whole circle takes two arcs or more: the ends of one would be the same point")
    s = np.linspace(0.0, 1.0, 2 * arcs + 1)
    wanted = correct_joints(robot, nominal, joint_history(path, nominal, q_center, s, T_tip_tcp))
    if not wanted.ok.all():
        k = int(np.flatnonzero(~wanted.ok)[0])
        raise RobotError(f"point {k + 1} of {len(s)} of the circle cannot be corrected: {wanted.reason[k]}")
    fake = wanted.T_fake @ T_tip_tcp
    inside = np.arange(max(2, -(-samples // arcs))) / max(2, -(-samples // arcs))
    points = []
    for k in range(arcs):
        move = Circle.through(fake[2 * k], fake[2 * k + 1, :3, 3], fake[2 * k + 2])
        q = joint_history(move, nominal, wanted.q[2 * k], inside, T_tip_tcp)
        points.append((robot.poses(q) @ T_tip_tcp)[:, :3, 3])
    return np.concatenate(points)
