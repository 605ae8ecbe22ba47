"""Poses as tables, and any robot by its name: calibration folder, URDF or shipped robot."""

from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.errors import RobotError
from irbcal.files import calibration_folder, urdf
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.units import MM


def open_robot(name, nominal=False, base=None, tip=None):
    """The robot of a calibration folder, of a URDF or shipped with the package.

    Parameters
    ----------
    name : str or Path
    nominal : bool
        The nominal behaviour of a calibration (its base and tool identified with the nominal model).
    base, tip : str, optional
        Link names for a URDF, see `irbcal.files.urdf.read`.

    Returns
    -------
    Robot

    Raises
    ------
    IrbcalError
        If there is no such robot.
    """
    return open_pair(name, nominal, base, tip)[0]


def open_pair(name, nominal=False, base=None, tip=None):
    """As `open_robot`, with the nominal arm that belongs to the robot.

    Returns
    -------
    robot : Robot
    arm : Arm
    """
    if Path(name).is_dir():
        if base or tip:
            raise RobotError(f"{name}: a calibration has its own base and tip link: choose links for a URDF only")
        calibration = calibration_folder.load(name)
        robot = calibration.robot_nominal() if nominal else calibration.robot_calibrated()
        return robot, calibration.arm(calibrated=False)
    arm = urdf.read(name, base, tip).arm
    return Robot(arm), arm


def joint_table(robot, nominal, T_base_tip, near, all_branches=False):
    """Commanded joints for tip poses.

    Parameters
    ----------
    robot : Robot
    nominal : Arm
        Nominal arm of the robot.
    T_base_tip : ndarray, shape (n, 4, 4)
        Tip poses in the base link.
    near : array_like, shape (joints,)
        The branch nearest to these joints is taken, radians (metres for prismatic joints).
    all_branches : bool
        Every branch within the joint limits instead, a row each; of arms with a closed-form inverse.

    Returns
    -------
    DataFrame
        The arm's joint columns (empty where there is no solution), ``note``; with all branches also ``row`` (of the
        input, from 1) and ``branch``.

    Raises
    ------
    RobotError
        If all branches are wanted of an arm without a closed-form inverse; the message says why it has none.
    """
    from irbcal.modeling.inverse import any_arm, calibrated_arm, closed_form

    columns, units = nominal.joint_columns, nominal.joint_units
    if not all_branches and not closed_form.has_closed_form(nominal):
        # with fewer than six joints a pose is met only as well as its file is rounded
        tolerance = 1e-8 if len(columns) < 6 else 1e-10
        found = any_arm.solve(robot, nominal, T_base_tip, near, tolerance, tolerance)
        table = pd.DataFrame(found.joints / units, columns=columns)
        table["note"] = _notes(found)
        return table
    branches = closed_form.branches(nominal, T_base_tip)
    n = len(T_base_tip)
    if not all_branches:
        seed, branch = closed_form.nearest(nominal, branches, near)
        found = calibrated_arm.solve(robot, nominal, T_base_tip, seed=np.where(branch[:, None] >= 0, seed, near))
        table = pd.DataFrame(found.joints / units, columns=columns)
        table["note"] = _notes(found)
        return table
    parts = []
    for k, name in enumerate(closed_form.BRANCH_NAMES):
        joints, inside = closed_form.with_configuration(nominal, branches, np.full(n, k), near)
        rows = np.flatnonzero(inside)
        found = calibrated_arm.solve(robot, nominal, T_base_tip[rows], seed=joints[rows])
        part = pd.DataFrame(found.joints / units, columns=columns)
        part.insert(0, "branch", name)
        part.insert(0, "row", rows + 1)
        part["note"] = _notes(found)
        parts.append(part[found.converged])
    return pd.concat(parts).sort_values("row", kind="stable", ignore_index=True)


def _notes(found):
    from irbcal.modeling.inverse.calibrated_arm import Reason

    notes = np.array([Reason(code).words if code else "" for code in found.reason], dtype=object)
    notes[found.converged & ~found.inside] = "outside the joint limits"
    return notes


def pose_table(robot, q):
    """Tip poses in the base link for commanded joints (n, joints), radians (metres for prismatic joints).

    Returns
    -------
    DataFrame
        ``x_mm, y_mm, z_mm, qw, qx, qy, qz`` (unit quaternion, scalar first, qw not negative).
    """
    T = robot.poses(q)
    values = np.column_stack([T[:, :3, 3] / MM, frames.quaternion_from_matrix(T[:, :3, :3])])
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
