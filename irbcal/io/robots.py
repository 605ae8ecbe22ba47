"""Robots by name, and the files that come with irbcal: nominal robots with their meshes, the demonstration data."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from unicodedata import normalize

from irbcal.errors import OptionError, RobotError
from irbcal.io import catalogue
from irbcal.option_values import excerpt
from irbcal.safe_files import path_of_uri
from irbcal.summary import Paragraph, Result, Table

_PACKAGE = Path(__file__).parents[1]
SHIPPED = "irbcal"
EXAMPLES = "example-robot-data"
"""The package that holds other makers' robots."""
DETAILED = 8
"""Robots in a list that says where the numbers of each come from."""
CATALOGUE = "catalogue"
"""Arms that irbcal makes from its table of lengths."""
DESCRIPTIONS = "robot_descriptions"
"""A package that fetches many more, each when it is first used."""


@dataclass(frozen=True)
class NamedRobot:
    """A robot that is known by a short name."""

    name: str
    file: str
    """URDF in ``urdf/`` of irbcal, or in ``robots`` of example-robot-data."""
    description: str
    """The robot in words."""
    source: str = EXAMPLES
    """``irbcal``, ``catalogue`` (see `irbcal.io.catalogue`), ``example-robot-data`` or ``robot_descriptions``."""
    base_link: str | None = None
    tip_link: str | None = None
    """Ends of the arm where its URDF leaves them open."""
    numbers: str = ""
    """Public repository that an arm of the catalogue has its numbers from, with its licence."""
    unconfirmed: str = ""
    """What that repository leaves in doubt."""

    def path(self) -> Path:
        """The URDF.

        Raises
        ------
        RobotError
            If the package that holds it is not installed.
        """
        if self.source == CATALOGUE:
            return catalogue.arms()[self.name].path()
        if self.source == DESCRIPTIONS:
            return _described(self.file)
        if self.source != EXAMPLES:
            return urdf_folder() / self.file
        path = next((folder / EXAMPLES / "robots" / self.file for folder in _example_robots()), None)
        if path is None or not path.is_file():
            raise RobotError(f"the robot {self.name} is in the package {EXAMPLES}, which is not installed here")
        return path


NAMED_ROBOTS = (
    NamedRobot("irb1600", "irbcal_description/urdf/irb1600_6_145.urdf", "ABB IRB 1600-6/1.45", "irbcal"),
    NamedRobot("irb120", "irbcal_description/urdf/irb120_3_058.urdf", "ABB IRB 120-3/0.58", "irbcal"),
    NamedRobot("ur3", "ur_description/urdf/ur3_robot.urdf", "Universal Robots UR3"),
    NamedRobot("ur5", "ur_description/urdf/ur5_robot.urdf", "Universal Robots UR5"),
    NamedRobot("ur10", "ur_description/urdf/ur10_robot.urdf", "Universal Robots UR10"),
    NamedRobot("panda", "panda_description/urdf/panda.urdf", "Franka Emika Panda", tip_link="panda_link8"),
    NamedRobot("xarm7", "xarm_description/urdf/xarm7.urdf", "UFACTORY xArm 7", tip_link="link7"),
    NamedRobot(
        "kinova", "kinova_description/robots/kinova.urdf", "Kinova JACO j2s6s200", tip_link="j2s6s200_end_effector"
    ),
    NamedRobot("z1", "z1_description/urdf/z1.urdf", "Unitree Z1", tip_link="link06"),
)
"""Robots by name; a line more makes one more robot."""

ROBOTS = {robot.name: robot.file for robot in NAMED_ROBOTS if robot.source != EXAMPLES}
"""Short names of the shipped robots, and their files."""


@dataclass(frozen=True, repr=False)
class RobotList(Result):
    """The robots that are known by name: ``robots()["irb1600"]``, ``"ur5" in robots()``, ``for robot in robots()``."""

    robots: tuple[NamedRobot, ...]

    def __len__(self) -> int:
        return len(self.robots)

    def __iter__(self) -> Iterator[NamedRobot]:
        return iter(self.robots)

    def __contains__(self, robot: object) -> bool:
        return robot in self.robots or any(item.name == robot for item in self.robots)

    def __getitem__(self, name: str) -> NamedRobot:
        for robot_item in self.robots:
            if robot_item.name == name:
                return robot_item
        raise OptionError.unknown("name", name, [entry.name for entry in self.robots])

    def report(self) -> Sequence[Paragraph]:
        """What ``irbcal robots`` prints."""
        rows = tuple((robot.name, robot.description, robot.unconfirmed) for robot in self.robots)
        few = self.robots if len(rows) <= DETAILED else ()
        return [
            Table(f"{len(rows)} robots by name (--robot NAME)", ("name", "robot", "unconfirmed"), rows),
            *(f"{robot.name}: numbers from {robot.numbers or robot.source}" for robot in few),
            "Compare lengths, limits and joint signs with your controller before you measure",
            "Any other robot: --robot FILE.urdf, or --robot 'FILE.xacro ARGUMENT:=VALUE'",
        ]

    def headline(self) -> str:
        """The names."""
        return ", ".join(robot.name for robot in self.robots)

    ROWS, COLUMNS = "robots", "name file description source base_link tip_link numbers unconfirmed"


def robots(maker: str | None = None, search: str | None = None) -> RobotList:
    """Robots that can be named instead of a URDF file.

    They ship with irbcal, are made from its catalogue of arms, or come with example-robot-data and robot_descriptions.

    Parameters
    ----------
    maker : str, optional
        Those of a maker, such as fanuc.
    search : str, optional
        Those whose name or model is like this; typing errors are forgiven.

    Raises
    ------
    OptionError
        If there is none.
    """
    present = [robot for robot in NAMED_ROBOTS if robot.source != EXAMPLES or any(_example_robots())]
    listed: list[NamedRobot] = [*present, *_catalogued(), *_descriptions()]
    if maker is not None:
        makers = sorted({_plain(robot.description)[0] for robot in listed})
        wanted = get_close_matches(_plain(maker)[0] if _plain(maker) else "", makers, n=1, cutoff=0.7)
        listed = [robot for robot in listed if _plain(robot.description)[0] in wanted]
        if not listed:
            raise OptionError(f"maker: expected one of {', '.join(makers)}, found {excerpt(maker)}", parameter="maker")
    if search is not None:
        listed = like(search, listed)
        if not listed:
            raise OptionError(f"search: no robot is called like {excerpt(search)}", parameter="search")
    return RobotList(tuple(listed))


def _plain(text: str) -> list[str]:
    """Words of a name without case, accents and signs."""
    letters = normalize("NFKD", text.lower()).encode("ascii", "ignore").decode()
    return re.findall(r"[a-z0-9]+", letters)


def like(name: str, listed: Sequence[NamedRobot]) -> list[NamedRobot]:
    """Robots that are called like a name, the likeliest first: those that contain it, else those that resemble it."""
    searched = "".join(_plain(name))
    keys = {robot: ("".join(_plain(robot.name)), "".join(_plain(robot.description))) for robot in listed}
    if not searched:
        return []
    holding = [robot for robot, texts in keys.items() if any(searched in text for text in texts)]
    if holding:
        return holding
    by_text: dict[str, NamedRobot] = {}
    for robot, texts in keys.items():
        for text in (*texts, "".join(_plain(robot.name.partition("/")[2]))):
            by_text.setdefault(text, robot)
    return list(dict.fromkeys(by_text[text] for text in get_close_matches(searched, by_text, n=5, cutoff=0.75)))


@cache
def _catalogued() -> tuple[NamedRobot, ...]:
    """The arms of the catalogue."""
    return tuple(
        NamedRobot(
            name,
            f"{name}.urdf",
            f"{arm.maker.title} {arm.model}",
            CATALOGUE,
            numbers=f"{arm.source} ({arm.licence})",
            unconfirmed=arm.unconfirmed,
        )
        for name, arm in catalogue.arms().items()
    )


def entries_of_file(file: str) -> Iterator[NamedRobot]:
    """Robots by name whose URDF has this file name."""
    return (robot for robot in (*NAMED_ROBOTS, *_catalogued()) if Path(robot.file).name == file)


def _descriptions() -> tuple[NamedRobot, ...]:
    """The arms of robot_descriptions that have a URDF; none unless that package is installed."""
    try:
        from robot_descriptions._descriptions import DESCRIPTIONS as listed  # type: ignore[import-not-found,unused-ignore]

        return tuple(
            NamedRobot(name, name, " ".join(filter(None, (entry.maker, entry.robot))), DESCRIPTIONS)
            for name, entry in sorted(listed.items())
            if entry.has_urdf and "arm" in entry.tags
        )
    except (ImportError, AttributeError):  # not installed, or a version that lists its robots otherwise
        return ()


def _described(module: str) -> Path:
    """The URDF of an arm of robot_descriptions, which that package fetches when it is first asked for."""
    from importlib import import_module

    try:
        return Path(str(import_module(f"{DESCRIPTIONS}.{module}").URDF_PATH))
    except Exception as error:  # whatever keeps that package from fetching it
        reason = " ".join(str(error).split())[:300]
        raise RobotError(f"{DESCRIPTIONS} could not give {module}: {reason}", parameter="robot") from None


def urdf_folder() -> Path:
    """Folder of the shipped URDF files, in a wheel or in a checkout."""
    inside = _PACKAGE / "urdf"
    return inside if inside.is_dir() else _PACKAGE.parent / "urdf"


def named_robot(robot: str | Path) -> NamedRobot | None:
    """The robot of a name (shipped ones also with their variant and ending), unless there is a file of that name."""
    if not isinstance(robot, (str, os.PathLike)):
        raise RobotError(f"expected the path of a URDF or a robot's name, found {excerpt(robot)}", parameter="robot")
    if Path(xacro_arguments(robot)[0]).is_file():
        return None
    name = str(robot).lower()
    for entry in (*NAMED_ROBOTS, *_catalogued(), *(_descriptions() if name.endswith("_description") else ())):
        if name == entry.name or (
            entry.source == SHIPPED and name.removesuffix(".urdf") + ".urdf" == Path(entry.file).name
        ):
            return entry
    return None


_ARGUMENT = re.compile(r"\s+(\w+):=(\S*)")


def xacro_arguments(robot: str | Path) -> tuple[str | Path, dict[str, str]]:
    """A robot without the arguments of its xacro file, and these: ``ur.urdf.xacro ur_type:=ur5e name:=ur``."""
    if ":=" not in str(robot):
        return robot, {}
    return _ARGUMENT.sub("", str(robot)), dict(_ARGUMENT.findall(str(robot)))


def robot_file(robot: str | Path) -> Path:
    """Path of a robot file.

    Parameters
    ----------
    robot : str or Path
        A path to a URDF or a xacro file, arguments of which may follow, or a robot's name, see `robots`.

    Raises
    ------
    RobotError
        If there is no such file; the sentence lists the names.
    """
    robot = xacro_arguments(robot)[0]
    path = Path(robot)
    if path.is_file():
        return path
    entry = named_robot(robot)
    if entry is not None:  # though there may be a folder of that name, such as that of its calibration
        return entry.path()
    if (path / "calibration.json").is_file():
        raise RobotError(
            f"this is a calibration, expected a URDF: {path / 'calibrated.urdf'} is its geometry alone, without its "
            "joint map",
            file=path,
            parameter="robot",
        )
    if path.exists():
        raise RobotError(f"expected a URDF file, found {'a folder' if path.is_dir() else 'something else'}", file=path)
    similar = ", ".join(item.name for item in like(str(robot), [*NAMED_ROBOTS, *_catalogued()])[:5])
    names = ", ".join(item.name for item in NAMED_ROBOTS)
    other = f"robots by name like it are {similar}" if similar else f"robots by name are {names}"
    raise RobotError(f"robot file {str(robot)!r} does not exist; {other}; irbcal robots lists all", parameter="robot")


def package_dirs(*extra: str | Path) -> list[str]:
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


def _ros_folders() -> Iterator[Path]:
    for entry in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(entry)
        if (Path(entry) / "package.xml").is_file():  # ROS allows a package itself as an entry
            yield Path(entry).parent
    for entry in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(entry) / "share"


def _example_robots() -> Iterator[Path]:
    """The ``share`` folder of example-robot-data, if it is installed: the package has files only, no Python module."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        files = distribution(EXAMPLES)
    except PackageNotFoundError:
        return
    share = Path(str(files.locate_file("cmeel.prefix"))) / "share"
    if (share / EXAMPLES).is_dir():
        yield share


def mesh_file(fname: str, folders: Sequence[str | Path] | None = None) -> str:
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
        return path_of_uri(fname)
    if not fname.startswith("package://"):
        return fname
    inside = fname.removeprefix("package://").lstrip("/")
    candidates = (Path(folder) / inside for folder in (package_dirs() if folders is None else folders))
    return str(next((path for path in candidates if path.is_file()), fname))


def demo_file(name: str) -> Path:
    """Path of a file of the demonstration data."""
    return _PACKAGE / "data" / name
