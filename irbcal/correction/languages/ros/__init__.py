"""ROS: messages of the type trajectory_msgs/JointTrajectory as YAML."""

from irbcal.correction.languages.ros.reader import fingerprint, looks_like, parse, read_for
from irbcal.correction.languages.ros.writing import to_yaml

NAME = "ROS JointTrajectory"
ENDINGS = (".yaml", ".yml")
MAKER = None
ROBOTS = ""
write_moves = None

__all__ = [
    "ENDINGS",
    "MAKER",
    "NAME",
    "ROBOTS",
    "fingerprint",
    "looks_like",
    "parse",
    "read_for",
    "to_yaml",
    "write_moves",
]
