"""MuJoCo: the calibrated robot as MJCF with its meshes in a folder, joint ranges and reflectors, to the last digit.

MuJoCo's own reading of a URDF would do, but what it writes has fewer digits. Its configurations are *effective* joints:
the module beside the model makes them of commanded ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal import literals
from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.exporting.robot_numbers import ExportFiles
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import UrdfWithMeshes, description, joint_map_module, urdf_with_meshes
from irbcal.io.meshes import as_obj
from irbcal.io.urdf_xml import XmlElement
from irbcal.modeling import frames

DESCRIPTION = "MuJoCo: MJCF with meshes in a folder, joint ranges and reflectors"
NEXT_STEP = "python -m mujoco.viewer --mjcf {folder}/{word}.xml     # its joints are effective joints"
HINGES = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}
SHAPES = ("box", "sphere", "cylinder", "capsule")
LEAST_MASS, LEAST_INERTIA = 1e-6, 1e-12
"""Kilograms and kg m^2 of links whose URDF tells none: MuJoCo moves nothing that has none."""


def files(source: Source) -> ExportFiles:
    """The model, its meshes and the joint map."""
    package = urdf_with_meshes(
        source, lambda path: (".stl", path.read_bytes()) if path.suffix.lower() == ".stl" else as_obj(path)
    )
    made = {f"{source.numbers.identifier}.xml": mjcf(source, package)}
    return ExportFiles(made | package.meshes | joint_map_module(source), package.notes)


def mjcf(source: Source, package: UrdfWithMeshes) -> bytes:
    """The model as MJCF.

    Raises
    ------
    RobotError
        If the URDF has joints that MJCF cannot have.
    """
    from lxml import etree

    numbers, root = source.numbers, package.tree.getroot()
    top = etree.Element("mujoco", model=numbers.identifier)
    top.append(etree.Comment(literals.xml_comment("; ".join([description(source), *package.notes]))))
    bounds = {"boundmass": repr(LEAST_MASS), "boundinertia": repr(LEAST_INERTIA)}
    etree.SubElement(top, "compiler", angle="radian", autolimits="true", inertiafromgeom="false", **bounds)
    asset, world = etree.SubElement(top, "asset"), etree.SubElement(top, "worldbody")
    links = {link.get("name"): link for link in root.findall("link")}
    joints = root.findall("joint")
    below: dict[str, list[XmlElement]] = {name: [] for name in links}
    for joint in joints:
        below[joint.find("parent").get("link")].append(joint)
    children = {joint.find("child").get("link") for joint in joints}
    (base,) = (name for name in links if name not in children)
    assets: dict[tuple[str, str], str] = {}
    todo: list[tuple[XmlElement, str, XmlElement | None]] = [(world, base, None)]
    while todo:
        above, name, joint = todo.pop(0)
        body = world  # a root link of this name is MuJoCo's own
        if joint is not None or name != "world":
            body = etree.SubElement(above, "body", name=name, **({} if joint is None else _place(joint)))
        if joint is not None and joint.get("type") != "fixed":
            _joint(body, joint)
        if body is not world:
            _inertial(body, links[name])
        for kind, group in (("visual", "2"), ("collision", "3")):
            for shape in links[name].findall(kind):
                _geom(body, shape, kind, group, assets)
        if name == numbers.tip_link:
            for target, point in source.robot.targets.items():
                if f"target_{target}" not in links:
                    etree.SubElement(body, "site", name=f"target_{target}", pos=_text(point), size="0.005")
        todo += [(body, child.find("child").get("link"), child) for child in below[name]]
    for (file, scale), name in assets.items():
        etree.SubElement(asset, "mesh", name=name, file=file, **({"scale": scale} if scale else {}))
    _mimics(top, joints)
    data: bytes = etree.tostring(top, xml_declaration=True, encoding="utf-8", pretty_print=True)
    return data


def _text(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


def _numbers(element: XmlElement | None, attribute: str, default: str) -> FloatArray:
    text = default if element is None else element.get(attribute, default)
    return np.array([float(word) for word in text.split()])


def _place(element: XmlElement) -> dict[str, str]:
    """Place and attitude of an element's origin."""
    origin = element.find("origin")
    R = frames.matrix_from_rpy(_numbers(origin, "rpy", "0 0 0"))
    return {
        "pos": _text(_numbers(origin, "xyz", "0 0 0")),
        "quat": _text(np.asarray(frames.quaternion_from_matrix(R))),
    }


def _joint(body: XmlElement, joint: XmlElement) -> None:
    from lxml import etree

    kind = joint.get("type")
    if kind not in HINGES:
        raise RobotError(f"joint {joint.get('name')} is {kind}: MJCF is written for hinges and slides", parameter="as")
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    more = {}
    if kind != "continuous" and limit is not None:
        more["range"] = _text([float(limit.get(side, "0")) for side in ("lower", "upper")])
    for ours, theirs in (("damping", "damping"), ("friction", "frictionloss")):
        if dynamics is not None and float(dynamics.get(ours, "0")) > 0.0:
            more[theirs] = _text([float(dynamics.get(ours))])
    axis = _text(_numbers(joint.find("axis"), "xyz", "1 0 0"))
    etree.SubElement(body, "joint", name=joint.get("name"), type=HINGES[kind], axis=axis, **more)


def _inertial(body: XmlElement, link: XmlElement) -> None:
    from lxml import etree

    inertial = link.find("inertial")
    if inertial is None or inertial.find("mass") is None:
        return
    origin, tensor = _place(inertial), inertial.find("inertia")
    ixx, ixy, ixz, iyy, iyz, izz = (
        0.0 if tensor is None else float(tensor.get(name, "0")) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    principal, axes = np.linalg.eigh(np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))
    principal = np.maximum(principal, LEAST_INERTIA)
    principal[2] = min(principal[2], principal[0] + principal[1])  # what a body of masses can have at most
    axes = axes * np.sign(np.linalg.det(axes))
    R = frames.matrix_from_rpy(_numbers(inertial.find("origin"), "rpy", "0 0 0")) @ axes
    mass = max(float(inertial.find("mass").get("value", "0")), LEAST_MASS)
    quat = _text(np.asarray(frames.quaternion_from_matrix(R)))
    etree.SubElement(body, "inertial", pos=origin["pos"], quat=quat, mass=repr(mass), diaginertia=_text(principal))


def _geom(body: XmlElement, shape: XmlElement, kind: str, group: str, assets: dict[tuple[str, str], str]) -> None:
    from lxml import etree

    geometry = shape.find("geometry")
    if geometry is None or not len(geometry):
        return
    form = geometry[0]
    attributes = {"group": group, **_place(shape)}
    if kind == "visual":
        attributes |= {"contype": "0", "conaffinity": "0"}
        colour = shape.find("material/color")
        if colour is not None:
            attributes["rgba"] = colour.get("rgba")
    if form.tag == "mesh":
        scale = form.get("scale", "")
        key = (form.get("filename"), "" if scale in ("1 1 1", "1.0 1.0 1.0") else scale)
        attributes |= {"type": "mesh", "mesh": assets.setdefault(key, f"mesh_{len(assets) + 1}")}
    elif form.tag in SHAPES:
        attributes |= {"type": form.tag, "size": _size(form)}
    else:
        return
    etree.SubElement(body, "geom", **attributes)


def _size(form: XmlElement) -> str:
    """Size of a simple shape as MuJoCo writes it: halves."""
    if form.tag == "box":
        return _text(_numbers(form, "size", "0 0 0") / 2)
    halves = [] if form.tag == "sphere" else [float(form.get("length")) / 2]
    return _text([float(form.get("radius")), *halves])


def _mimics(top: XmlElement, joints: Sequence[XmlElement]) -> None:
    """Joints that follow others, such as fingers."""
    from lxml import etree

    followers = [joint for joint in joints if joint.find("mimic") is not None]
    if not followers:
        return
    equality = etree.SubElement(top, "equality")
    for joint in followers:
        mimic = joint.find("mimic")
        rule = [float(mimic.get("offset", "0")), float(mimic.get("multiplier", "1")), 0.0, 0.0, 0.0]
        etree.SubElement(equality, "joint", joint1=joint.get("name"), joint2=mimic.get("joint"), polycoef=_text(rule))
