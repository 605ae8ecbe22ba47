"""How well a saved calibration knows where the robot is, as far as the scatter of its parameters goes."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.schema import Record
from irbcal.modeling.robot import Robot


def position_std(
    calibration: Record, q: FloatArray, target: str | None = None, robot: Robot | None = None
) -> FloatArray:
    """Standard deviations of predicted positions, from those of the identified parameters.

    Held combinations add nothing, and what the model cannot describe (backlash, ...) is not in it: for that see
    `irbcal.modeling.robot.Robot.predict`.

    Parameters
    ----------
    calibration : Record
    q : ndarray, shape (n, joints)
        Commanded joints, radians.
    target : str, optional
        A reflector, in the measuring frame; by default the tip in the base link.
    robot : Robot, optional
        The calibrated robot, where it carries another payload than the calibration's usual one.

    Returns
    -------
    ndarray, shape (n, 3)
        Of x, y and z, metres.
    """
    robot = calibration.robot_calibrated() if robot is None else robot
    assert robot.certainty is not None
    position = np.zeros(3) if target is None else robot.targets[target]
    load = robot.joint_map.load(len(q))
    _, covariance, _ = robot.certainty.positions(robot.walk, q, None, position, target, robot.T_world_base, load)
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
