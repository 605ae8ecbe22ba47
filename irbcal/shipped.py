"""Files that come with irbcal: nominal robots and the demonstration data."""

from pathlib import Path

from irbcal.errors import RobotError

_PACKAGE = Path(__file__).parent

ROBOTS = {"irb1600": "irb1600_6_145.urdf", "irb120": "irb120_3_058.urdf"}
"""Short names of the shipped robots."""


def urdf_folder():
    """Folder of the shipped URDF files, in a wheel or in a checkout."""
    inside = _PACKAGE / "urdf"
    return inside if inside.is_dir() else _PACKAGE.parent / "urdf"


def robot_file(robot):
    """Path of a robot file.

    Parameters
    ----------
    robot : str or Path
        A path to a URDF, or a shipped robot's name (with or without its variant and ending).

    Returns
    -------
    Path

    Raises
    ------
    RobotError
        If there is no such file; the sentence lists the shipped robots.
    """
    path = Path(robot)
    if path.is_file():
        return path
    if path.exists():
        raise RobotError(f"{path}: expected a URDF file, found {'a folder' if path.is_dir() else 'something else'}")
    wanted = str(robot).lower()
    for short, name in ROBOTS.items():
        if wanted in (short, name, name.removesuffix(".urdf")):
            return urdf_folder() / name
    raise RobotError(f"robot file {str(robot)!r} does not exist; shipped robots are {', '.join(ROBOTS)}")


def demo_file(name):
    """Path of a file of the demonstration data."""
    return _PACKAGE / "data" / name
