"""The cell as a URDF: the calibrated robot on its track, positioners, tools and work objects."""

from __future__ import annotations

import copy

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.cell import external_axes
from irbcal.cell.cell_file import CellFile
from irbcal.errors import RobotError
from irbcal.io import urdf, urdf_xml
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.cell_graph import BASE, FLOOR


def with_cell(data: bytes, arm: Arm, cell: CellFile) -> bytes:
    """The URDF of a robot with the true tools, work objects and external axes of its cell.

    A joint of a URDF has an axis and no scale: the value of ``e1`` … is the true travel, position times the length of
    its screw; that a track turns its carriage or a table moves along its axis is left out. Limits are those of the
    touches.

    Parameters
    ----------
    data : bytes
        Of the calibrated robot.
    arm : Arm
        Its base and tip link.
    cell : CellFile

    Returns
    -------
    bytes
    """
    from lxml import etree

    robot = urdf.from_bytes(data, f"URDF of {arm.name}", arm.base_link, arm.tip_link)
    tree = copy.deepcopy(robot.tree)
    root = tree.getroot()
    used_names = {element.get("name") for element in root.iter("link", "joint")}
    links: dict[str, tuple[str, FloatArray]] = {BASE: (arm.base_link, np.eye(4))}
    if external_axes.root(cell.axes) == FLOOR:
        floor = _free("floor", used_names)
        links = {FLOOR: (floor, np.eye(4))}
        root.insert(0, etree.Element("link", name=floor))
    e = np.array([touch.axis_positions for touch in cell.touches]).reshape(len(cell.touches), -1)
    for k, (axis, edge) in enumerate(zip(cell.axes, external_axes.edges(cell.axes, e), strict=True)):
        w, v = axis.screw[:3], axis.screw[3:]
        along = v if axis.slides else w
        scale = float(np.linalg.norm(along))
        place = np.zeros(3) if axis.slides else frames.cross(w, v) / scale**2
        parent, T_parent = links[edge.parent]
        link = _free(f"{axis.name}_link", used_names)
        joint = urdf_xml.add_joint(
            root, parent, link, T_parent @ frames.transform(None, place), _free(axis.name, used_names)
        )
        joint.set("type", "prismatic" if axis.slides else "revolute")
        etree.SubElement(joint, "axis", xyz=urdf_xml.text_of(along / scale))
        lower, upper = (format(float(limit(e[:, k])) * scale, ".9g") for limit in (np.min, np.max))
        etree.SubElement(joint, "limit", lower=lower, upper=upper, effort="0", velocity="0")
        links[edge.child] = link, frames.transform(None, -place)
        if edge.child == BASE:
            if arm.joints_up:
                raise RobotError(f"a track needs a base that stands: {arm.base_link} moves with {arm.joint_names[0]}")
            T_root = links[BASE][1] @ frames.inverse(robot.T_root_base)
            urdf_xml.add_joint(root, link, robot.root_link, T_root, new_link=None)
            links[BASE] = arm.base_link, np.eye(4)
    for title, named in (("tool", cell.tools), ("work_object", cell.work_objects)):
        for name, frame in named.items():
            stand = external_axes.stand(cell.axes, name)
            parent, T_parent = (arm.tip_link, np.eye(4)) if title == "tool" else links[stand]
            link = _free(f"{title}_{name}", used_names)
            urdf_xml.add_joint(root, parent, link, T_parent @ frame.T_true)
    return urdf_xml.serialised(tree)


def _free(name: str, taken: set[str | None]) -> str:
    """The name, or with a number where link or joint have it."""
    out = next(text for text in (name, *(f"{name}_{k}" for k in range(2, 1000))) if text not in taken)
    taken.add(out)
    return out
