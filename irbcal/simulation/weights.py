"""What a virtual arm carries, and how it gives way: masses from a URDF, and weight as terms of the error model.

The gravity torque about an axis ``a`` of joint ``j`` is ``9.81 sum_k a . (R_k V_k x g^)``, with ``V_k`` the first
moment of what joint ``j`` carries as constant vectors of the links on the way (`moments`). So a joint, or a frame, that
gives way in proportion to its torque does what the error model's levers say (`irbcal.modeling.terms.gravity`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from lxml import etree
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.io import urdf as urdf_module
from irbcal.io import urdf_xml
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.gravity import VECTORS
from irbcal.modeling.terms.payload import STANDARD_GRAVITY
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermModel

Amounts: TypeAlias = list[tuple[Term, float]]
"""Terms of the error model and their coefficients, in the terms' units."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Masses that the joints carry."""

    mass: FloatArray
    """Shape (joints,). What moves with each joint and not with the next one, kilograms."""
    centre: FloatArray
    """Shape (joints, 3). Its centre of mass in the joint's DHM frame, metres."""

    def __post_init__(self) -> None:
        for name in ("mass", "centre"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        lock(self)

    def with_payload(self, kilograms: float, centre: ArrayLike, T_last_tip: FloatArray) -> Bodies:
        """The bodies with a payload on the tip link.

        Parameters
        ----------
        kilograms : float
        centre : array_like, shape (3,)
            In the tip link, metres.
        T_last_tip : ndarray, shape (4, 4)
            Tip link in the last DHM frame.
        """
        if kilograms == 0.0:
            return self
        mass, centres = self.mass.copy(), self.centre.copy()
        position = T_last_tip[:3, :3] @ np.asarray(centre, dtype=float) + T_last_tip[:3, 3]
        mass[-1] += kilograms
        centres[-1] += kilograms / mass[-1] * (position - centres[-1])
        return Bodies(mass, centres)


def bodies(urdf: urdf_module.UrdfArm) -> Bodies:
    """Masses that each joint of a URDF's chain carries, at zero of all other joints.

    Links on fixed joints count with the link they sit on, and so do branches (a gripper's fingers); links without
    ``inertial`` have no mass.

    Raises
    ------
    RobotError
        If a mass or a centre is not a number.
    """
    root, source = urdf.tree.getroot(), urdf.arm.name
    links = {link.get("name"): link for link in root.findall("link")}
    joints = urdf_module._joints(root, source)
    names = list(urdf.arm.joint_names)
    children: dict[str, list[urdf_module.JointElement]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    mass, centre = np.zeros(len(names)), np.zeros((len(names), 3))
    for i, first in enumerate(urdf.child_links):
        stack = [(first, urdf.T_dhm_link[i + 1])]
        while stack:
            link, T = stack.pop()
            kilograms, position = _inertial(links[link], link, source)
            mass[i] += kilograms
            centre[i] += kilograms * frames.apply(T, position)
            stack += [
                (joint.child, T @ joint.T_parent_joint) for joint in children.get(link, []) if joint.name not in names
            ]
    return Bodies(mass, centre / np.where(mass > 0, mass, 1.0)[:, None])


def _inertial(link: etree._Element, name: str, source: str) -> tuple[float, FloatArray]:
    """Mass and centre of mass of a link element."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3)
    mass = inertial.find("mass")
    text = "0" if mass is None else mass.get("value", "0")
    kilograms = urdf_xml.numbers(text, 1, f"link {name!r}, mass", source)[0]
    return kilograms, urdf_xml.origin(inertial, f"link {name!r}, inertial", source)[:3, 3]


def frame_rotations(arm: Arm) -> FloatArray:
    """Axes of each joint's frame, before it turns, in the link before it, shape (joints, 3, 3); columns x, y, z."""
    table = arm.table
    ca, sa, cb, sb = np.cos(table.alpha), np.sin(table.alpha), np.cos(table.beta), np.sin(table.beta)
    zero = np.zeros_like(ca)
    rows = [[cb, zero, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]]
    return np.moveaxis(np.array(rows), -1, 0)


def moments(arm: Arm, bodies: Bodies) -> FloatArray:
    """First moment of all that a joint carries, a constant vector of each link on the way there, shape (joints, 3).

    With ``V_k`` of link k in its axes, what joint j carries has the moment ``sum_{k >= j} R_k V_k`` about its origin,
    kg m; prismatic joints after the first stand at zero.
    """
    table, beyond = arm.table, np.cumsum(bodies.mass[::-1])[::-1]
    out = np.array(bodies.mass[:, None] * bodies.centre)
    R = frame_rotations(arm)
    for k in range(len(out) - 1):
        step = table.a[k + 1] * np.array([1.0, 0.0, 0.0])
        step = step + table.b[k + 1] * np.array([0.0, np.cos(table.alpha[k + 1]), np.sin(table.alpha[k + 1])])
        out[k] += beyond[k + 1] * (step + table.d[k + 1] * R[k + 1, :, 2])
    return out


def weight_terms(arm: Arm, bodies: Bodies, compliance: Mapping[str, ArrayLike]) -> Amounts:
    """How revolute joints and their frames give way under weight: levers of the families gravity and bending.

    Parameters
    ----------
    arm : Arm
    bodies : Bodies
        With the payload.
    compliance : mapping of str to array_like, shape (joints,)
        Axis (``rx``, ``ry``, ``rz``) -> rad/Nm of each joint about it.

    Nothing gives way where the base link moves: gravity has no fixed direction in it.
    """
    if arm.joints_up:
        return []
    V = moments(arm, bodies)
    beyond = np.cumsum(bodies.mass[::-1])[::-1]
    out: Amounts = []
    for axis, values in compliance.items():
        family = "gravity" if axis == "rz" else "bending"
        soft = np.asarray(values, dtype=float)
        for j in np.flatnonzero((soft != 0.0) & ~arm.table.prismatic):
            lever = np.array(V)
            lever[j, 2] += beyond[j] * arm.table.d[j]  # about the frame's origin: nothing for the joint's own axis
            out += [
                (
                    Term(int(j), axis, "gravity", 1.0, family, family, "rad", {"link": k + 1, "vector": VECTORS[b]}),
                    float(STANDARD_GRAVITY * soft[j] * lever[k, b]),
                )
                for k in range(j, len(V))
                for b in range(3)
                if lever[k, b]
            ]
    return out


def torques(arm: Arm, bodies: Bodies, q: FloatArray, axis: str = "rz") -> FloatArray:
    """Gravity torques about an axis of each revolute joint's frame before it turns, zero for prismatic joints.

    Parameters
    ----------
    arm : Arm
    bodies : Bodies
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    axis : str
        ``rx``, ``ry`` or ``rz``: the joint's own.

    Returns
    -------
    ndarray, shape (n, joints)
        Derivative of the potential energy by a turn about the axis, N m.
    """
    amounts = weight_terms(arm, bodies, {axis: np.ones(len(arm.joint_names))})
    values = TermModel(arm, [term for term, _ in amounts]).values(Motion(q))
    out = np.zeros(q.shape)
    for (term, lever), value in zip(amounts, values, strict=True):
        out[:, term.joint] -= lever * value
    return out
