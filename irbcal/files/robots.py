"""Files that come with irbcal: nominal robots with their meshes, and the demonstration data."""

import importlib.util
import os
from pathlib import Path

from irbcal.errors import RobotError

_PACKAGE = Path(__file__).parents[1]

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


def package_dirs(*extra):
    """Folders in which ``package://NAME/...`` of a URDF is looked up: NAME is a folder in one of them.

    In this order, each once and only those that exist: the folders given; the shipped robots' own; those of a sourced
    ROS environment (``ROS_PACKAGE_PATH``, and ``share`` below each prefix of ``AMENT_PREFIX_PATH``); the one with the
    robots of example-robot-data, if that is installed.

    Parameters
    ----------
    *extra : str or Path
        Folders that are searched first, such as the one above your own robot's description package.

    Returns
    -------
    list of str
        As Pinocchio takes it, by name:
        ``pin.buildGeomFromUrdf(model, file, pin.GeometryType.VISUAL, package_dirs=package_dirs())``.
        For yourdfpy see `mesh_file`.
    """
    folders = [*map(Path, extra), urdf_folder(), *_ros_folders(), *_example_robots()]
    return list(dict.fromkeys(str(folder.absolute()) for folder in folders if folder.is_dir()))


def _ros_folders():
    for entry in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(entry)
        if (Path(entry) / "package.xml").is_file():  # ROS allows a package itself as an entry
            yield Path(entry).parent
    for entry in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(entry) / "share"


def _example_robots():
    spec = importlib.util.find_spec("example_robot_data")  # finds the package without importing it
    above = Path(spec.origin).parents if spec and spec.origin else ()
    return [folder / "share" for folder in above if (folder / "share" / "example-robot-data").is_dir()]


def mesh_file(fname, folders=None):
    """File that a mesh's ``filename`` in a URDF means.

    Serves yourdfpy as it is: ``yourdfpy.URDF.load(file, filename_handler=mesh_file)``.

    Parameters
    ----------
    fname : str
        ``package://NAME/path``, ``file:///path`` or a plain path.
    folders : sequence of str or Path, optional
        Where packages are; by default `package_dirs`.

    Returns
    -------
    str
        The first such file; ``fname`` unchanged if no folder has it.
    """
    if fname.startswith("file://"):
        return fname.removeprefix("file://")
    if not fname.startswith("package://"):
        return fname
    inside = fname.removeprefix("package://").lstrip("/")
    candidates = (Path(folder) / inside for folder in (package_dirs() if folders is None else folders))
    return str(next((path for path in candidates if path.is_file()), fname))


def demo_file(name):
    """Path of a file of the demonstration data."""
    return _PACKAGE / "data" / name
