"""Arms by their makers' names, from one table of lengths: ``kuka/kr16-2``.

``irbcal/data/arms.csv`` has a row an arm: lengths, limits, speeds, and the public repository that each number was read
from. `MAKERS` says what a maker's arms share: how joints are counted and named, where zero is, how the flange lies.
The two make a URDF of plain shapes; no file or mesh of a source is in it.

Lengths of arms with a spherical wrist are named as by M. Brandstötter, A. Angerer, M. Hofbaur, *An Analytical Solution
of the Inverse Kinematics Problem of Industrial Serial Manipulators with an Ortho-parallel Basis and a Spherical Wrist*
(2014): ``c1`` to ``c4`` along the arm, ``a1`` forward at joint 2, ``a2`` down at joint 4, ``b`` sideways at joint 3.
Two are added: ``a3`` down at joint 6, ``w`` sideways at joint 5. Those of Universal Robots are the Denavit-Hartenberg
parameters ``d1 a2 a3 d4 d5 d6``.
"""

from __future__ import annotations

import csv
import os
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from irbcal import overwriting, safe_files
from irbcal.arrays import FloatArray
from irbcal.modeling import frames
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.io.urdf_xml import XmlElement

TABLE = Path(__file__).parents[1] / "data" / "arms.csv"
LICENCES = {
    "Kawasaki-Robotics/khi_robot": "BSD",
    "RobotComponents": "GPL-3.0-or-later",
    "UniversalRobots/Universal_Robots_ROS2_Description": "BSD",
    "kroshu/kuka_robot_descriptions": "BSD",
    "ros-industrial/abb": "BSD or Apache-2.0",
    "ros-industrial/fanuc": "BSD",
    "ros-industrial/kuka_experimental": "BSD or Apache-2.0",
    "ros-industrial/motoman": "BSD",
    "ros-industrial/staubli_experimental": "Apache-2.0",
    "ros-industrial/universal_robot": "BSD",
}
"""Licences of the sources, as their packages say; the table has numbers of them only."""

Vector: TypeAlias = tuple[float, float, float]
_NAMED_REACH = re.compile(r"/(\d\.\d+)$|^KR \d+ R(\d{3,4})\b")
X, Y, Z = np.eye(3)
LEVEL: Vector = (1.0, 0.0, 0.0)
UP: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class MakerConventions:
    """What the arms of a maker share."""

    title: str
    signs: tuple[int, ...]
    """+1 where the controller counts a joint about up (1), left (2, 3, 5) or forward along the forearm (4, 6)."""
    joints: tuple[str, ...] = tuple(f"joint_{i}" for i in range(1, 7))
    upper: Vector = UP
    forearm: Vector = LEVEL
    """Directions at zero joints, x forward."""
    flange: Vector = (0.0, 90.0, 0.0)
    """Roll, pitch and yaw of the flange in the base at zero joints, degrees."""
    front: float = 0.0
    """Yaw of the arm's front in the base, degrees."""
    coupling: str | None = None
    """How the pendant counts, see `irbcal.modeling.coupling`."""


_UR = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_BACKWARDS = (1, 1, -1, -1, -1, -1)
MAKERS = {
    "abb": MakerConventions("ABB", (1, 1, 1, 1, 1, 1)),
    "fanuc": MakerConventions("FANUC", _BACKWARDS, flange=(180.0, -90.0, 0.0), coupling="3+2"),
    "kawasaki": MakerConventions(
        "Kawasaki",
        (-1, 1, -1, 1, -1, 1),
        tuple(f"joint{i}" for i in range(1, 7)),
        forearm=UP,
        flange=(0.0, 0.0, 0.0),
        front=90.0,
    ),
    "kuka": MakerConventions("KUKA", (-1, 1, 1, -1, 1, -1), tuple(f"joint_a{i}" for i in range(1, 7)), upper=LEVEL),
    "staubli": MakerConventions("Stäubli", (1, 1, 1, 1, 1, 1), forearm=UP, flange=(0.0, 0.0, 0.0)),
    "ur": MakerConventions("Universal Robots", (1, 1, 1, 1, 1, 1), tuple(f"{name}_joint" for name in _UR)),
    "yaskawa": MakerConventions(
        "Yaskawa",
        _BACKWARDS,
        ("joint_1_s", "joint_2_l", "joint_3_u", "joint_4_r", "joint_5_b", "joint_6_t"),
        flange=(180.0, -90.0, 0.0),
    ),
}
"""Conventions by the first half of an arm's name."""


@dataclass(frozen=True)
class CatalogueArm:
    """A row of the table."""

    name: str
    model: str
    """``kuka/kr16-2`` and ``KR 16-2``."""
    lengths: dict[str, float]
    """By name, metres."""
    limits: tuple[tuple[float, float], ...]
    """Degrees, of the URDF's joints."""
    speeds: tuple[float, ...]
    """Degrees per second; empty where the source has none."""
    source: str
    """Public repository of the numbers."""
    note: str
    """What the source says otherwise than of arms of the same family."""

    @property
    def maker(self) -> MakerConventions:
        """Its maker's conventions."""
        return MAKERS[self.name.partition("/")[0]]

    @property
    def licence(self) -> str:
        """Licence of the source."""
        return LICENCES[self.source]

    @property
    def unconfirmed(self) -> str:
        """What is in doubt: the note, missing speeds, lengths whose reach is 1 % off the one in the model's name."""
        doubts = [self.note] if self.note else []
        if not self.speeds:
            doubts.append("speeds: the source has none")
        reach_in_name, reach = _NAMED_REACH.search(self.model), self.reach
        if reach_in_name is not None and reach is not None:
            metres = float(reach_in_name[1]) if reach_in_name[1] else float(reach_in_name[2]) * MM
            if abs(reach - metres) > 0.01 * metres:
                doubts.append(f"lengths: the wrist reaches {reach:.3f} m, the name says {metres:g} m")
        return "; ".join(doubts)

    @property
    def reach(self) -> float | None:
        """Largest distance of the wrist from the axis of joint 1, metres; None of arms without a spherical wrist."""
        if "d1" in self.lengths:
            return None
        a1, a2, c2, c3 = (self.lengths.get(name, 0.0) for name in ("a1", "a2", "c2", "c3"))
        return a1 + c2 + float(np.hypot(c3, a2))

    def chain(self) -> list[tuple[FloatArray, FloatArray]]:
        """Frame of each joint in the one before, shape (4, 4), and its axis there; last the tip's frame."""
        return _parallel_axes(self.lengths) if "d1" in self.lengths else _spherical_wrist(self.maker, self.lengths)

    def urdf(self) -> bytes:
        """The arm as a URDF of cylinders."""
        from lxml import etree

        from irbcal.io import urdf_xml

        chain = self.chain()
        root = etree.Element("robot", name=re.sub(r"\W+", "_", self.name))
        said = f" {self.maker.title} {self.model}: numbers of {self.source} ({self.licence}), shapes of irbcal"
        note = f"; unconfirmed: {self.unconfirmed}" if self.unconfirmed else ""
        root.append(etree.Comment(f"{said}{note} ".replace("--", "-")))
        links = ["base_link", *(f"link_{i}" for i in range(1, len(chain))), "tool0"]
        thickness = 0.05 * float(sum(np.linalg.norm(T[:3, 3]) for T, _ in chain[2:5]))
        for number, link in enumerate(links):
            element = etree.SubElement(root, "link", name=link)
            if number < len(chain):
                _draw(element, chain[number][0][:3, 3], thickness * (1.4 - 0.15 * number))
        speeds = self.speeds or (0.0,) * len(self.limits)
        for number, ((T, axis), name) in enumerate(zip(chain, (*self.maker.joints, "flange"), strict=True)):
            moving = number < len(self.limits)
            joint = etree.SubElement(root, "joint", name=name, type="revolute" if moving else "fixed")
            etree.SubElement(joint, "parent", link=links[number])
            etree.SubElement(joint, "child", link=links[number + 1])
            urdf_xml.set_origin(joint, T)
            if moving:
                etree.SubElement(joint, "axis", xyz=urdf_xml.text_of(axis))
                lower, upper = (repr(float(side * DEG)) for side in self.limits[number])
                speed = repr(float(speeds[number] * DEG))
                etree.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity=speed)
        etree.indent(root, "  ")
        return bytes(urdf_xml.serialised(etree.ElementTree(root)))

    def path(self) -> Path:
        """The URDF as a file in the user's cache, written where it is not there yet, with the coupling beside it.

        Raises
        ------
        CalibrationError
            If the cache cannot be written.
        """
        file = cache_folder() / f"{self.name}.urdf"
        content = {file: self.urdf()}
        if self.maker.coupling is not None:
            content[file.with_suffix(".coupling.yaml")] = f"coupling: {self.maker.coupling}\n".encode()
        if not all(path.is_file() and path.read_bytes() == data for path, data in content.items()):
            with overwriting.replacing():
                safe_files.write_set(content)
        return file


def cache_folder() -> Path:
    """Folder of the URDFs that were made from the table."""
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(home) if home else Path.home() / ".cache") / "irbcal" / "robots"


@cache
def arms() -> dict[str, CatalogueArm]:
    """The table's arms by name."""
    with open(TABLE, encoding="utf-8", newline="") as stream:
        return {row["name"]: _of_row(row) for row in csv.DictReader(stream)}


def _of_row(row: dict[str, str]) -> CatalogueArm:
    lengths = {name: float(value) * MM for name, value in (item.split("=") for item in row["lengths_mm"].split())}
    sides = [[float(side) for side in item.split(":")] for item in row["limits_deg"].split()]
    limits = tuple((side[0], side[1]) if len(side) == 2 else (-side[0], side[0]) for side in sides)
    speeds = tuple(map(float, row["speeds_deg_s"].split()))
    return CatalogueArm(row["name"], row["model"], lengths, limits, speeds, row["source"], row["note"])


def _spherical_wrist(maker: MakerConventions, lengths: dict[str, float]) -> list[tuple[FloatArray, FloatArray]]:
    def along(name: str) -> float:
        return lengths.get(name, 0.0)

    upper, forearm = np.array(maker.upper), np.array(maker.forearm)
    above = frames.cross(forearm, Y)  # up at a level forearm, back at an upright one
    steps = [
        along("c1") * Z,
        along("a1") * X,
        along("c2") * upper + along("b") * Y,
        -along("a2") * above,
        along("c3") * forearm + along("w") * Y,
        -along("a3") * above,
        along("c4") * forearm,
    ]
    R = frames.rot_z(maker.front * DEG)
    axes = [sign * axis for sign, axis in zip(maker.signs, (Z, Y, Y, forearm, Y, forearm), strict=True)]
    chain = [(frames.transform(None, R @ step), R @ axis) for step, axis in zip(steps, [*axes, Z], strict=True)]
    roll, pitch, yaw = (angle * DEG for angle in maker.flange)
    chain[-1] = (
        frames.transform(frames.rot_z(yaw) @ frames.rot_y(pitch) @ frames.rot_x(roll), chain[-1][0][:3, 3]),
        Z,
    )
    return chain


def _parallel_axes(lengths: dict[str, float]) -> list[tuple[FloatArray, FloatArray]]:
    """Universal Robots: ``Rot(z, q) Trans(z, d) Trans(x, a) Rot(x, alpha)``, each step before the next joint."""
    d = [lengths.get(f"d{i}", 0.0) for i in range(1, 7)]
    a = [lengths.get(f"a{i}", 0.0) for i in range(1, 7)]
    alpha = [90.0, 0.0, 0.0, 90.0, -90.0, 0.0]
    steps = [frames.transform(frames.rot_x(alpha[i] * DEG), [a[i], 0.0, d[i]]) for i in range(6)]
    return [(step, Z) for step in [np.eye(4), *steps]]


def _draw(link: XmlElement, to: FloatArray, radius: float) -> None:
    """A cylinder from the link's origin to the next joint, and a ball on the latter."""
    from lxml import etree

    from irbcal.io import urdf_xml

    length = float(np.linalg.norm(to))
    if length < 1e-6:
        return
    visual = etree.SubElement(link, "visual")
    direction = to / length
    pitch, yaw = np.arccos(np.clip(direction[2], -1.0, 1.0)), np.arctan2(direction[1], direction[0])
    etree.SubElement(visual, "origin", xyz=urdf_xml.text_of(to / 2), rpy=urdf_xml.text_of(np.array([0.0, pitch, yaw])))
    geometry = etree.SubElement(visual, "geometry")
    etree.SubElement(geometry, "cylinder", radius=f"{radius:.4f}", length=f"{length:.6f}")
    joint = etree.SubElement(link, "visual")
    etree.SubElement(joint, "origin", xyz=urdf_xml.text_of(to), rpy="0 0 0")
    etree.SubElement(etree.SubElement(joint, "geometry"), "sphere", radius=f"{1.15 * radius:.4f}")
