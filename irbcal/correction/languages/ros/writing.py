"""Trajectories as YAML that ROS takes: trajectory_msgs/JointTrajectory."""

from __future__ import annotations

import numpy as np

from irbcal.correction.languages.ros.program import DECIMALS
from irbcal.modeling.trajectory import Trajectory


def to_yaml(trajectory: Trajectory, frame_id: str = "") -> str:
    """A trajectory as the YAML of a message.

    Parameters
    ----------
    trajectory : Trajectory
        Times count from its own zero.
    frame_id : str
        Of the header.

    Returns
    -------
    str
        Radians and metres.
    """
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", f"  frame_id: '{frame_id}'", "joint_names:"]
    lines += [f"- {name}" for name in trajectory.names]
    lines.append("points:")
    columns = {"positions": trajectory.q, "velocities": trajectory.dq, "accelerations": trajectory.ddq}
    for k, time in enumerate(trajectory.times):
        sign = "- "
        for kind, values in columns.items():
            row = "" if values is None else ", ".join(f"{x:.{DECIMALS}f}" for x in np.round(values[k], DECIMALS) + 0.0)
            lines.append(f"{sign}{kind}: [{row}]")
            sign = "  "
        nano = round(float(time) * 1e9)
        lines += ["  effort: []", f"  time_from_start: {{sec: {nano // 10**9}, nanosec: {nano % 10**9}}}"]
    return "\n".join(lines) + "\n"
