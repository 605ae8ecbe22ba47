"""ROS 2: an ament package with the calibrated robot as URDF and as xacro macro, its meshes and its joint origins.

For descriptions that take joint origins from YAML, as ``ur_description`` does, ``config/joint_origins.yaml`` alone is
enough; all others are replaced by the macro, whose joints are placed by the calibration.
"""

from __future__ import annotations

import re

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.exporting.robot_numbers import ExportFiles
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import PACKAGE, description, joint_map_module, urdf_with_meshes
from irbcal.io import joint_origins, urdf_xml
from irbcal.io.schema import Record
from irbcal.literals import xacro, xml_comment
from irbcal.measurement.imaging import TARGETS
from irbcal.modeling import frames
from irbcal.units import DEG, MM

DESCRIPTION = "ROS 2: an ament package with URDF, xacro macro, meshes and joint origins"
NEXT_STEP = (
    "xacro {folder}/urdf/{word}_calibrated.urdf.xacro     # or copy the folder into your workspace: docs/ros2.md"
)
XACRO = "http://www.ros.org/wiki/xacro"
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name} NONE)
find_package(ament_cmake REQUIRED)
install(DIRECTORY {folders} DESTINATION share/${{PROJECT_NAME}})
ament_package()
"""
BUILT = """
  <buildtool_depend>ament_cmake</buildtool_depend>
  <exec_depend>xacro</exec_depend>
  <export>
    <build_type>ament_cmake</build_type>
  </export>"""
"""What colcon needs in a package's description."""
TOP = """<?xml version="1.0" encoding="utf-8"?>
<!--{comment}-->
<robot xmlns:xacro="{xacro}" name="{robot}">
  <xacro:arg name="prefix" default=""/>
  <xacro:include filename="{name}_macro.xacro"/>
  <xacro:{name} prefix="$(arg prefix)"/>
</robot>
"""
MACRO = """<?xml version="1.0" encoding="utf-8"?>
<!--{comment}-->
<robot xmlns:xacro="{xacro}">
  <xacro:macro name="{name}" params="prefix">
{elements}
  </xacro:macro>
</robot>
"""
NAME_ATTRIBUTES = {
    "joint": ("name",),
    "link": ("name", "link"),
    "parent": ("link",),
    "child": ("link",),
    "mimic": ("joint",),
}
"""Attributes that hold names of links and joints."""


def _cameras_and_boards(record: Record) -> list[tuple[str, str, FloatArray]]:
    """Name of the link, parent and place of each camera and board; a camera looks along its z, as optical frames do."""
    out = []
    _, places, turns = record.placement.base_and_targets()
    for row in [] if record.features is None else record.features.features:
        if row.kind not in TARGETS:
            continue
        if row.target in places and row.target in turns:
            T = frames.transform(turns[row.target], places[row.target])
            out.append((re.sub(r"\W", "_", row.target), record.robot.tip_link, T))
        if {"centre", "attitude"} <= set(row.fitted):
            place = np.r_[np.array(row.fitted["centre"]) * MM, np.array(row.fitted["attitude"]) * DEG]
            out.append((re.sub(r"\W", "_", row.name), record.robot.base_link, frames.from_xyz_angles(place)))
    return out


def files(source: Source) -> ExportFiles:
    """The package and the joint map."""
    from xml.sax.saxutils import escape

    from lxml import etree

    package = urdf_with_meshes(source, lambda path: (path.suffix, path.read_bytes()))
    name = f"{source.numbers.identifier}_calibrated"
    root = package.in_package(name)
    links = {element.get("name") for element in root.iter("link")}
    for device, parent, T in [] if source.record is None else _cameras_and_boards(source.record):
        if device not in links:
            urdf_xml.add_joint(root, parent, device, T)
            links.add(device)
    said = description(source)
    values = {"name": name, "what": escape(said), "comment": xml_comment(xacro(said)), "xacro": XACRO}
    contents = {f"urdf/{name}.urdf": urdf_xml.serialised(package.tree)}
    for element in list(root.iter()):
        if isinstance(element.tag, str) and element.tag.startswith(f"{{{XACRO}}}"):
            raise RobotError(f"xacro would carry out {element.tag.rpartition('}')[2]}", file="calibrated.urdf")
        element.text, element.tail = (text and xacro(text) for text in (element.text, element.tail))
        if isinstance(element.tag, str):
            for attribute, value in element.attrib.items():
                element.set(attribute, xacro(value))
            for attribute in NAME_ATTRIBUTES.get(element.tag, ()):
                if element.get(attribute) is not None:
                    element.set(attribute, "${prefix}" + element.get(attribute))
    elements = [etree.tostring(element, encoding="unicode", with_tail=False) for element in root]
    macro = MACRO.format(**values, elements="\n".join(f"  {element}" for element in elements))
    folders = ["urdf", *(["meshes"] if package.meshes else []), *(["config"] if source.record else [])]
    contents |= {
        "package.xml": PACKAGE.format(**values, more=BUILT).encode(),
        "CMakeLists.txt": CMAKE.format(name=name, folders=" ".join(folders)).encode(),
        f"urdf/{name}_macro.xacro": macro.encode(),
        f"urdf/{name}.urdf.xacro": TOP.format(
            **values, robot=escape(xacro(root.get("name", name)), {'"': "&quot;"})
        ).encode(),
    }
    if source.record is not None:
        contents["config/joint_origins.yaml"] = joint_origins.to_yaml(source.record).encode()
    return ExportFiles(contents | package.meshes | joint_map_module(source), package.notes)
