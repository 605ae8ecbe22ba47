"""Poses as tables, and any robot by its name: calibration folder, URDF or shipped robot."""

from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.errors import RobotError
from irbcal.export import calibration_file, urdf
from irbcal.modeling.robot import Robot
from irbcal.units import MM


def open_robot(name, nominal=False):
    """The robot of a calibration folder, of a URDF or shipped with the package.

    Parameters
    ----------
    name : str or Path
    nominal : bool
        The nominal behaviour of a calibration (its base and tool identified with the nominal model).

    Returns
    -------
    Robot

    Raises
    ------
    IrbcalError
        If there is no such robot.
    """
    if Path(name).is_dir():
        calibration = calibration_file.load(name)
        return calibration.robot_nominal() if nominal else calibration.robot_calibrated()
    return Robot(urdf.read(name).arm)


def pose_table(robot, q):
    """Tip poses in the base link for commanded joints (n, 6) in radians.

    Returns
    -------
    DataFrame
        ``x_mm, y_mm, z_mm, qw, qx, qy, qz`` (unit quaternion, scalar first, qw not negative).
    """
    from scipy.spatial.transform import Rotation

    T = robot.poses(q)
    xyzw = Rotation.from_matrix(T[:, :3, :3]).as_quat(canonical=True)
    values = np.column_stack([T[:, :3, 3] / MM, xyzw[:, 3], xyzw[:, :3]])
    return pd.DataFrame(values, columns=["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"])


def target_table(robot, q, target):
    """Positions of one reflector in the measuring frame, columns ``x_mm, y_mm, z_mm``.

    Raises
    ------
    RobotError
        If the robot has no such target.
    """
    if not robot.targets:
        raise RobotError("a URDF has no reflectors: name a calibration folder to predict a target's position")
    return pd.DataFrame(robot.points(q, target) / MM, columns=["x_mm", "y_mm", "z_mm"])
