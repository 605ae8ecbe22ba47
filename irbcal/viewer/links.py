"""A robot's links and joints as they are drawn, read from its URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.io.urdf import UrdfArm
from irbcal.io.urdf_xml import XmlElement
from irbcal.modeling import frames

Kind: TypeAlias = Literal["fixed", "revolute", "prismatic"]

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Link(Locked):
    """A link and the joint that carries it.

    Attributes
    ----------
    name : str
    parent : int
        Place of the parent link in the list; -1 for the root.
    T_parent_joint : ndarray, shape (4, 4)
    kind : str
        ``fixed``, ``revolute`` (continuous ones too) or ``prismatic``.
    axis : ndarray, shape (3,)
    joint : int
        Which of the arm's joints moves it; -1 for none.
    factor, offset : float
        Joint value is ``factor * q[joint] + offset`` (mimic joints).
    """

    name: str
    parent: int
    T_parent_joint: FloatArray
    kind: Kind = "fixed"
    axis: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    joint: int = -1
    factor: float = 1.0
    offset: float = 0.0


def links(urdf: UrdfArm) -> tuple[Link, ...]:
    """All links of a robot, parents first.

    Returns
    -------
    tuple of Link
        The first is the root; joints that are not the arm's own stand at zero.
    """
    index = {name: k for k, name in enumerate(urdf.arm.joint_names)}
    by_parent: dict[str, list[XmlElement]] = {}
    for element in urdf.tree.getroot().findall("joint"):
        by_parent.setdefault(element.find("parent").get("link"), []).append(element)
    out = [Link(urdf.root_link, -1, np.eye(4))]
    for number, link in enumerate(out):  # the list grows while it is walked
        for element in by_parent.get(link.name, ()):
            out.append(_link(element, number, index))
    return tuple(out)


def _link(element: XmlElement, parent: int, index: Mapping[str, int]) -> Link:
    kind = element.get("type")
    name = element.get("name")
    axis = element.find("axis")
    along = vector((axis.get("xyz") if axis is not None else None) or "1 0 0", 3)
    joint, factor, offset = index.get(name, -1), 1.0, 0.0
    mimic = element.find("mimic")
    if mimic is not None and joint < 0:
        joint = index.get(mimic.get("joint"), -1)
        try:
            factor = float(vector(mimic.get("multiplier") or "1", 1)[0])
            offset = float(vector(mimic.get("offset") or "0", 1)[0])
        except ValueError:
            joint = -1  # a mimic that makes no sense stands still
    if kind not in MOVING:
        kind = "fixed"
    return Link(
        element.find("child").get("link"),
        parent,
        origin(element),
        "prismatic" if kind == "prismatic" else "fixed" if kind == "fixed" else "revolute",
        along / (np.linalg.norm(along) or 1.0),
        joint,
        factor,
        offset,
    )


def place(tree: Sequence[Link], q: ArrayLike, T_base_root: FloatArray | None = None) -> FloatArray:
    """Places of all links for one set of effective joints, as the page computes them.

    Parameters
    ----------
    tree : sequence of Link
    q : ndarray, shape (joints,)
        Effective joint values, radians or metres.
    T_base_root : ndarray, shape (4, 4), optional

    Returns
    -------
    ndarray, shape (links, 4, 4)
    """
    joints = np.asarray(q, dtype=float)
    out: list[FloatArray] = []
    for link in tree:
        value = (link.factor * joints[link.joint] if link.joint >= 0 else 0.0) + link.offset
        T = link.T_parent_joint
        if link.kind == "revolute":
            T = T @ frames.transform(frames.rotation_from_vector(value * link.axis))
        elif link.kind == "prismatic":
            T = T @ frames.transform(None, link.axis * value)
        T_parent = out[link.parent] if link.parent >= 0 else (np.eye(4) if T_base_root is None else T_base_root)
        out.append(T_parent @ T)
    return np.array(out)


def reach(tree: Sequence[Link]) -> float:
    """Length of the longest chain of joint origins, metres: the scale of the robot."""
    lengths: list[float] = []
    for link in tree:
        length = lengths[link.parent] if link.parent >= 0 else 0.0
        lengths.append(length + float(np.linalg.norm(link.T_parent_joint[:3, 3])))
    return max(max(lengths), 0.1)


def vector(text: str | None, count: int) -> FloatArray:
    """So many finite numbers of a URDF's text; ValueError for anything else."""
    values = np.array([float(word) for word in (text or "").split()])
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"expected {count} numbers, found {text!r}")
    return values


def origin(element: XmlElement) -> FloatArray:
    """The ``origin`` in an element of a URDF; identity without one."""
    child = element.find("origin")
    if child is None:
        return np.eye(4)
    return frames.transform(
        frames.matrix_from_rpy(vector(child.get("rpy") or "0 0 0", 3)), vector(child.get("xyz") or "0 0 0", 3)
    )
