"""Examples: arms as several makers build them, SIMULATED, and the writing of all; what ``irbcal samples`` does.

Each maker has a folder with ``arm.urdf``, ``measured.csv`` and programs, which are the templates of that folder's name:
their stops are given as ``joints`` and as ``poses``, both as the maker's controller counts them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irbcal import safe_files
from irbcal.arrays import FloatArray
from irbcal.correction.languages.fanuc import FANUC
from irbcal.correction.languages.inform import YASKAWA
from irbcal.correction.languages.kawasaki import KAWASAKI
from irbcal.correction.languages.krl import KUKA
from irbcal.correction.languages.urscript import UNIVERSAL_ROBOTS
from irbcal.correction.languages.val3 import STAUBLI
from irbcal.correction.maker import Maker
from irbcal.correction.notation import numbers_from_poses
from irbcal.errors import CalibrationError
from irbcal.examples.measurements import ROBOT, TARGETS, Sample, measured_table
from irbcal.io import robots, urdf
from irbcal.io.controller_model import controller_frames
from irbcal.modeling import frames
from irbcal.names import csv_bytes
from irbcal.simulation import weights
from irbcal.simulation.pose_list import random_list
from irbcal.simulation.shipped_cells import shipped_cell
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import DEG, MM

TEMPLATES = Path(__file__).parent / "templates"
POSES = 60
PULSES = np.array([1341.4, 1341.4, 1341.4, 1000.0, 1000.0, 622.0])
"""Pulses per degree of the invented Yaskawa."""


@dataclass(frozen=True)
class MakerArm:
    """A maker's arm and the stops of its program."""

    folder: str
    maker: Maker | None
    """How its controller counts; None for ABB, whose poses bear quaternions."""
    joints: tuple[tuple[tuple[float, float, float], str], ...]
    """Origin and axis. Of the six joints, metres, in frames parallel to the base at zero joints; empty for an arm with
    a name.
    """
    flange: tuple[float, ...]
    """Place of the tip on the last link, metres, and its roll, pitch, yaw."""
    base: float
    """Height of the controller's world, metres."""
    stops: tuple[tuple[float, ...], ...]
    """Joints of the controller, degrees."""
    tool: tuple[float, ...]
    frame: tuple[float, ...]
    """Six numbers of the tool and of the frame that the program's poses are given in, as its controller writes them."""
    tried: dict[str, str]
    """Program to what its command needs; other files go with them. ``{where}``: joints of the first stop and its pose
    with no tool.
    """
    named: str = ""
    """A robot's name, for arms without joints."""


TURN = float(np.pi / 2)
KUKA_ARM = MakerArm(
    "kuka",
    KUKA,
    (
        ((0, 0, 0.4), "0 0 -1"),
        ((0.025, 0, 0), "0 1 0"),
        ((0.45, 0, 0), "0 1 0"),
        ((0.42, 0, 0.035), "-1 0 0"),
        ((0, 0, 0), "0 1 0"),
        ((0, 0, 0), "-1 0 0"),
    ),
    (0.08, 0, 0, 0, TURN, 0),
    0.0,
    ((10, -80, 100, 20, 40, 30), (-25, -95, 110, -15, 50, -40), (30, -70, 80, 10, -35, 60)),
    (0, 0, 150, 0, 0, 0),
    (400, 0, 200, 0, 0, 0),
    {"job.src": "--out kuka-job --tool 3=0,0,150,0,0,0 --frame 1=400,0,200,0,0,0"},
)
FANUC_ARM = MakerArm(
    "fanuc",
    FANUC,
    (
        ((0, 0, 0.35), "0 0 1"),
        ((0.06, 0, 0), "0 1 0"),
        ((0, 0, 0.34), "0 -1 0"),
        ((0, 0, 0.03), "-1 0 0"),
        ((0.33, 0, 0), "0 -1 0"),
        ((0.085, 0, 0), "-1 0 0"),
    ),
    (0, 0, 0, 2 * TURN, -TURN, 0),
    0.35,
    ((10, 5, -10, 20, -40, 30), (-25, 15, 5, -15, -50, -40), (30, -10, -15, 10, -35, 60)),
    (0, 0, 150, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
    {"job.ls": "--out fanuc-job.ls --tool 1=0,0,150,0,0,0"},
)
YASKAWA_ARM = MakerArm(
    "yaskawa",
    YASKAWA,
    (
        ((0, 0, 0.35), "0 0 1"),
        ((0.05, 0, 0), "0 1 0"),
        ((0, 0, 0.36), "0 -1 0"),
        ((0.35, 0, 0.045), "-1 0 0"),
        ((0, 0, 0), "0 -1 0"),
        ((0, 0, 0), "-1 0 0"),
    ),
    (0.08, 0, 0, 2 * TURN, -TURN, 0),
    0.35,
    ((10, 5, -10, 20, -40, 30), (-25, 15, 5, -15, -50, -40), (30, -10, -15, 10, -35, 60)),
    (0, 0, 150, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
    {
        "JOB.JBI": "--out YASKAWA.JBI --pulses 1341.4,1341.4,1341.4,1000,1000,622 --tool 1=0,0,150,0,0,0",
    },
)
STAUBLI_ARM = MakerArm(
    "staubli",
    STAUBLI,
    (
        ((0, 0, 0.5), "0 0 1"),
        ((0.14, 0, 0), "0 1 0"),
        ((0, 0, 0.8), "0 1 0"),
        ((0, 0, 0), "0 0 1"),
        ((0, 0, 0.6), "0 1 0"),
        ((0, 0, 0.1), "0 0 1"),
    ),
    (0, 0, 0, 0, 0, 0),
    0.5,
    ((10, 20, 80, 20, 40, 30), (-25, 10, 95, -15, 50, -40), (30, 30, 70, 10, 35, 60)),
    (0, 0, 150, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
    {"application": "--out staubli-job"},
)
KAWASAKI_ARM = MakerArm(
    "kawasaki",
    KAWASAKI,
    (
        ((0, 0, 0.36), "0 0 -1"),
        ((0, 0, 0), "-1 0 0"),
        ((0, 0, 0.36), "1 0 0"),
        ((0, 0, 0.09), "0 0 1"),
        ((0, 0, 0.28), "1 0 0"),
        ((0, 0, 0.08), "0 0 1"),
    ),
    (0, 0, 0, 0, 0, 0),
    0.36,
    ((20, 30, -80, 15, 60, 10), (10, 20, -70, 15, 50, -30), (-15, 35, -60, -20, 45, 20)),
    (0, 0, 150, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
    {"job.as": "--out kawasaki-job.as --where {where}"},
)
UR_ARM = MakerArm(
    "universal",
    UNIVERSAL_ROBOTS,
    (),
    (),
    0.0,
    ((10, -80, 100, -110, -90, 30), (-25, -95, 110, -100, -80, -40), (30, -70, 80, -90, -100, 60)),
    (0, 0, 0.15, 0, 0, 0),
    (0, 0, 0, 0, 0, 0),
    {"job.script": "--out ur-job.script --tool active=0,0,0.15,0,0,0"},
    "ur10",
)
ABB_ARM = MakerArm(
    "abb",
    None,
    (),
    (),
    0.0,
    ((10, -10, 20, 15, 40, -30), (-20, 15, 5, -30, 35, 60), (35, 25, -30, 10, 50, -80)),
    (0, 0, 150, 0, 0, 0),
    (800, 0, 400, 0, 0, 0),
    {"job.mod": "--out job_calibrated.mod", "backup": "--out abb-job"},
    ROBOT,
)
ARMS = (ABB_ARM, KUKA_ARM, FANUC_ARM, YASKAWA_ARM, STAUBLI_ARM, KAWASAKI_ARM, UR_ARM)


def urdf_of(arm: MakerArm) -> bytes:
    """The URDF of an arm that is given by its joints."""
    from lxml import etree

    robot = etree.Element("robot", name=f"{arm.folder}_like_arm_of_no_maker")
    etree.SubElement(robot, "link", name="base_link")
    for k, (xyz, axis) in enumerate(arm.joints, start=1):
        parent = "base_link" if k == 1 else f"link_{k - 1}"
        joint = _joint(robot, f"joint_{k}", parent, f"link_{k}", (*xyz, 0, 0, 0))
        joint.set("type", "revolute")
        etree.SubElement(joint, "axis", xyz=axis)
        limit = np.radians(170.0 if k in (1, 4, 6) else 130.0)
        etree.SubElement(joint, "limit", lower=f"{-limit:.6f}", upper=f"{limit:.6f}", effort="100", velocity="3")
    _joint(robot, "flange", "link_6", "tool0", arm.flange)
    _joint(robot, "world", "base_link", "base", (0, 0, arm.base, 0, 0, 0))
    return bytes(etree.tostring(robot, pretty_print=True, xml_declaration=True, encoding="utf-8"))


def _joint(robot: Any, name: str, parent: str, child: str, at: tuple[float, ...]) -> Any:
    """A fixed joint and its child link."""
    from lxml import etree

    etree.SubElement(robot, "link", name=child)
    joint = etree.SubElement(robot, "joint", name=name, type="fixed")
    xyz, rpy = (" ".join(f"{value:.12g}" for value in triple) for triple in (at[:3], at[3:]))
    etree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)
    return joint


def files() -> Iterator[Sample]:
    """Folders of all makers."""
    for arm in ARMS:
        data = urdf_of(arm) if arm.joints else robots.robot_file(arm.named).read_bytes()
        robot = urdf.from_bytes(data, arm.folder)
        if arm.named == ROBOT:
            yield from _programs(arm, data, robot, "my-robot")
            continue
        name = arm.named or f"{arm.folder}/arm.urdf"
        calibration = f"my-{arm.folder}"
        if arm.joints:
            yield Sample(name, data, f"an arm like those of {arm.folder.upper()}, of invented size")
        cell = shipped_cell(robot.arm, weights.bodies(robot)).with_targets(TARGETS)
        table = measured_table(cell, random_list(cell, POSES, 1))
        command = f"irbcal calibrate {arm.folder}/measured.csv --robot {name} --out {calibration}"
        yield Sample(f"{arm.folder}/measured.csv", csv_bytes(table), f"{POSES} poses", command)
        yield from _programs(arm, data, robot, calibration)


def _programs(arm: MakerArm, data: bytes, robot: urdf.UrdfArm, calibration: str) -> Iterator[Sample]:
    """The maker's templates, filled in; a line that names a folder goes with the last file in it."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES / arm.folder),
        autoescape=False,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    context = stops(arm, data, robot)
    lines = {
        name: f"irbcal filter {calibration} {arm.folder}/{name} {options.format(**context)}"
        for name, options in arm.tried.items()
    }
    for name in sorted(environment.list_templates(extensions=("j2",)), reverse=True):
        file = name.removesuffix(".j2")
        text = environment.get_template(name).render(context)
        tried = lines.pop(file, None) or lines.pop(file.split("/")[0], "")
        yield Sample(f"{arm.folder}/{file}", text.encode(), "a program" if tried else "goes with a program", tried)


def stops(arm: MakerArm, data: bytes, robot: urdf.UrdfArm) -> dict[str, Any]:
    """Joints and poses of the stops as a program has them."""
    at = controller_frames(data, arm.folder, robot.arm.base_link, robot.arm.tip_link)
    program = np.array(arm.stops, dtype=float) * DEG
    q = program if arm.maker is None else arm.maker.joints(program)
    tool, frame = (_frame(arm.maker, numbers) for numbers in (arm.tool, arm.frame))
    T_world_flange = frames.inverse(at.T_base_world) @ robot.arm.forward(q) @ at.T_tip_flange
    pose = _numbers(arm.maker, T_world_flange[:1])[0]
    return {
        "joints": np.degrees(program),
        "radians": program,
        "poses": _numbers(arm.maker, frames.inverse(frame) @ T_world_flange @ tool),
        "pulses": np.rint(np.degrees(program) * PULSES),
        "where": "=".join(",".join(f"{value:.6g}" for value in row) for row in (arm.stops[0], pose)),
    }


def _numbers(maker: Maker | None, T: FloatArray) -> FloatArray:
    """Poses as they are written."""
    return numbers_from_poses(T) if maker is None else maker.numbers(T, np.zeros((len(T), 6)))


def _frame(maker: Maker | None, numbers: tuple[float, ...]) -> FloatArray:
    if maker is None:
        return frames.transform(np.eye(3), np.array(numbers[:3]) * MM)
    return maker.poses(np.array([numbers]))[0]


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Result):
    """Example files that were written: SIMULATED.

    Attributes
    ----------
    folder : Path
    about : dict of str to str
        Files in the folder, and what they are.
    tried : dict of str to str
        Files, and the command that reads them.
    """

    folder: Path
    about: dict[str, str]
    tried: dict[str, str]

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        rows = tuple((name, about) for name, about in self.about.items())
        return [
            f"{len(self.about)} SIMULATED example files in {self.folder}; README.txt there has a command for each",
            Table("Examples", ("file", "what it is"), rows),
        ]

    def to_dict(self) -> dict[str, Any]:
        """The files with their commands, ready for JSON."""
        files = [{"file": name, "about": about, "command": self.tried[name]} for name, about in self.about.items()]
        return {"folder": str(self.folder), "simulated": True, "files": files}


def samples(folder: str | Path = "irbcal-samples") -> Samples:
    """Write a small example input for every command and every import preset, all SIMULATED.

    Parameters
    ----------
    folder : str or Path
        New or empty.

    Raises
    ------
    CalibrationError
        If there is something in the folder, or it cannot be written.

    Examples
    --------
    >>> irbcal.samples("try-irbcal")  # doctest: +SKIP
    """
    from irbcal.examples import measurements as of

    folder = Path(folder)
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise CalibrationError("expected a new or empty folder for the samples", file=folder)
    sources = (of.tracker_files, of.foreign_files, of.check_files, of.rail_files, of.touched_files, files)
    written = [sample for make in (*sources, of.fleet_files) for sample in make()]
    contents = {folder / sample.path: sample.content for sample in written}
    contents[folder / "README.txt"] = _readme({sample.tried: sample.about for sample in written if sample.tried})
    safe_files.write_set(contents)
    return Samples(folder, {s.path: s.about for s in written}, {s.path: s.tried for s in written})


def _readme(lines: dict[str, str]) -> bytes:
    head = "Examples for irbcal. All data are SIMULATED: no robot was measured.\n"
    head += "The lines work in this folder, in this order.\n\n"
    return (head + "".join(f"# {about}\n{command}\n\n" for command, about in lines.items())).encode()
