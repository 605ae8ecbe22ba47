"""Files of trajectories, in and out: CSV with times, and ROS JointTrajectory as YAML."""

from __future__ import annotations

from pathlib import Path

from irbcal.atomic import write_set
from irbcal.correction.languages import ros, table
from irbcal.correction.program import read_bytes
from irbcal.errors import OptionError, ProgramError
from irbcal.io.opening import RobotLike, open_robot
from irbcal.modeling.trajectory import Trajectory


def read_trajectory(path: str | Path, robot: RobotLike) -> Trajectory:
    """Read a trajectory.

    Parameters
    ----------
    path : str or Path
        CSV with ``time_s``, ``q1_deg`` …, and where given ``v1_deg_s`` … and ``a1_deg_s2`` …; or a ROS
        JointTrajectory as YAML, whose joints are found by their names.
    robot : str, Path, Record, a result that holds one, or Opened
        Whose joints they are: calibration folder, URDF or name, see `irbcal.forward_kinematics`.

    Returns
    -------
    Trajectory
        Joints of the arm, radians (metres for prismatic joints).

    Raises
    ------
    ProgramError
        If the file holds none, times do not grow, joints are missing or numbers are not finite.
    """
    arm = open_robot(robot).nominal
    if Path(path).suffix.lower() in ros.ENDINGS:
        return ros.parse(arm, read_bytes(path), str(path)).trajectory
    program = table.read(path, arm.joint_columns)
    if not table.has_times(program):
        raise ProgramError(f"expected a column {table.TIME} beside the joints", file=path, row=1)
    return table.along_time(program, arm).trajectory


def write_trajectory(trajectory: Trajectory, path: str | Path) -> Path:
    """Write a trajectory: as YAML for ROS where the name ends so, else as CSV.

    Parameters
    ----------
    trajectory : Trajectory
    path : str or Path
        Ending with .yaml, .yml or .csv.

    Returns
    -------
    Path
    """
    path = Path(path)
    if path.suffix.lower() in ros.ENDINGS:
        text = ros.to_yaml(trajectory)
    elif path.suffix.lower() == ".csv":
        text = trajectory.to_frame().to_csv(index=False, float_format="%.12g")
    else:
        raise OptionError(f"path: expected a name that ends with .yaml or .csv, found {path.name}", parameter="path")
    write_set({path: text.encode("utf-8")})
    return path
