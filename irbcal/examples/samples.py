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
from irbcal.correction import languages
from irbcal.correction.language import SampleArm
from irbcal.correction.maker import Maker
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
from irbcal.units import DEG

TEMPLATES = Path(__file__).parent / "templates"
POSES = 60
PULSES = np.array([1341.4, 1341.4, 1341.4, 1000.0, 1000.0, 622.0])
"""Pulses per degree of the invented Yaskawa."""


def urdf_of(arm: SampleArm) -> bytes:
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


def arms() -> list[tuple[SampleArm, Maker]]:
    """The arms of all languages that have samples, and how their controllers write."""
    declared = [(language.sample, language.maker) for language in languages.all_languages()]
    return [(sample, maker) for sample, maker in declared if sample is not None and maker is not None]


def files() -> Iterator[Sample]:
    """Folders of all makers."""
    for arm, maker in arms():
        data = urdf_of(arm) if arm.joints else robots.robot_file(arm.robot_name).read_bytes()
        robot = urdf.from_bytes(data, arm.folder)
        if arm.robot_name == ROBOT:
            yield from _programs(arm, maker, data, robot, "my-robot")
            continue
        name = arm.robot_name or f"{arm.folder}/arm.urdf"
        calibration = f"my-{arm.folder}"
        if arm.joints:
            yield Sample(name, data, f"an arm like those of {arm.folder.upper()}, of invented size")
        cell = shipped_cell(robot.arm, weights.bodies(robot)).with_targets(TARGETS)
        table = measured_table(cell, random_list(cell, POSES, 1))
        command = f"irbcal calibrate {arm.folder}/measured.csv --robot {name} --out {calibration}"
        yield Sample(f"{arm.folder}/measured.csv", csv_bytes(table), f"{POSES} poses", command)
        yield from _programs(arm, maker, data, robot, calibration)


def _programs(arm: SampleArm, maker: Maker, data: bytes, robot: urdf.UrdfArm, calibration: str) -> Iterator[Sample]:
    """The maker's templates, filled in; a line that names a folder goes with the last file in it."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES / arm.folder),
        autoescape=False,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    context = stops(arm, maker, data, robot)
    lines = {
        name: f"irbcal filter {calibration} {arm.folder}/{name} {options.format(**context)}"
        for name, options in arm.tried.items()
    }
    for name in sorted(environment.list_templates(extensions=("j2",)), reverse=True):
        file = name.removesuffix(".j2")
        text = environment.get_template(name).render(context)
        tried = lines.pop(file, None) or lines.pop(file.split("/")[0], "")
        yield Sample(f"{arm.folder}/{file}", text.encode(), "a program" if tried else "goes with a program", tried)


def stops(arm: SampleArm, maker: Maker, data: bytes, robot: urdf.UrdfArm) -> dict[str, Any]:
    """Joints and poses of the stops as a program has them."""
    at = controller_frames(data, arm.folder, robot.arm.base_link, robot.arm.tip_link)
    program = np.array(arm.stops, dtype=float) * DEG
    q = maker.joints(program)
    tool, frame = maker.frame(arm.tool), maker.frame(arm.frame)
    T_world_flange = frames.inverse(at.T_base_world) @ robot.arm.forward(q) @ at.T_tip_flange
    pose = _numbers(maker, T_world_flange[:1])[0]
    return {
        "joints": np.degrees(program),
        "radians": program,
        "poses": _numbers(maker, frames.inverse(frame) @ T_world_flange @ tool),
        "pulses": np.rint(np.degrees(program) * PULSES),
        "where": "=".join(",".join(f"{value:.6g}" for value in row) for row in (arm.stops[0], pose)),
    }


def _numbers(maker: Maker, T: FloatArray) -> FloatArray:
    """Poses as they are written."""
    return maker.numbers(T, np.zeros((len(T), 3 + len(maker.orientation.names))))


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

    SIMULATED = True
    CONTENT = "folder simulated=SIMULATED files"

    def files(self) -> list[dict[str, str]]:
        """The files with what they are and their commands."""
        return [{"file": name, "about": about, "command": self.tried[name]} for name, about in self.about.items()]

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        rows = tuple((name, about) for name, about in self.about.items())
        return [
            f"{len(self.about)} SIMULATED example files in {self.folder}; README.txt there has a command for each",
            Table("Examples", ("file", "what it is"), rows),
        ]


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
    from irbcal.examples import measurements as data

    folder = Path(folder)
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise CalibrationError("expected a new or empty folder for the samples", file=folder)
    sources = (data.tracker_files, data.foreign_files, data.check_files, data.rail_files, data.touched_files, files)
    written = [sample for make in (*sources, data.fleet_files) for sample in make()]
    contents = {folder / sample.path: sample.content for sample in written}
    contents[folder / "README.txt"] = _readme({sample.tried: sample.about for sample in written if sample.tried})
    safe_files.write_set(contents)
    return Samples(folder, {s.path: s.about for s in written}, {s.path: s.tried for s in written})


def _readme(lines: dict[str, str]) -> bytes:
    head = "Examples for irbcal. All data are SIMULATED: no robot was measured.\n"
    head += "The lines work in this folder, in this order.\n\n"
    return (head + "".join(f"# {about}\n{command}\n\n" for command, about in lines.items())).encode()
