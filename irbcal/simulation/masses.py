"""The masses that an arm's joints carry: from the inertials of a URDF, and with a payload."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from lxml import etree
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.io import urdf as urdf_module
from irbcal.io import urdf_xml
from irbcal.modeling import frames


@dataclass(frozen=True, eq=False)
class Bodies:
    """Masses that the joints carry.

    Parameters
    ----------
    mass : array_like, shape (joints,)
        What moves with each joint and not with the next one, kilograms.
    centre : array_like, shape (joints, 3)
        Its centre of mass in the joint's DHM frame, metres.
    """

    mass: FloatArray
    centre: FloatArray

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

        Returns
        -------
        Bodies
        """
        if kilograms == 0.0:
            return self
        mass, centres = self.mass.copy(), self.centre.copy()
        place = T_last_tip[:3, :3] @ np.asarray(centre, dtype=float) + T_last_tip[:3, 3]
        mass[-1] += kilograms
        centres[-1] += kilograms / mass[-1] * (place - centres[-1])
        return Bodies(mass, centres)


def bodies(urdf: urdf_module.UrdfArm) -> Bodies:
    """Masses that each joint of a URDF's chain carries, at zero of all other joints.

    Links on fixed joints count with the link they sit on, and so do branches (a gripper's fingers); links without
    ``inertial`` have no mass.

    Parameters
    ----------
    urdf : UrdfArm

    Returns
    -------
    Bodies

    Raises
    ------
    RobotError
        If a mass or a centre is not a number.
    """
    root, source = urdf.tree.getroot(), urdf.arm.name
    links = {link.get("name"): link for link in root.findall("link")}
    joints = urdf_module._joints(root, source)
    names = list(urdf.arm.joint_names)
    children: dict[str, list[urdf_module._Joint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    mass, centre = np.zeros(len(names)), np.zeros((len(names), 3))
    for i, first in enumerate(urdf.child_links):
        stack = [(first, urdf.T_dhm_link[i + 1])]
        while stack:
            link, T = stack.pop()
            kilograms, place = _inertial(links[link], link, source)
            mass[i] += kilograms
            centre[i] += kilograms * frames.apply(T, place)
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
