"""Where a controller's world and flange are in a URDF.

The makers' public URDFs name the frame in which the controller gives its positions ``base`` and the flange as the
controller counts it ``tool0``. Neither need be the link at an end of the arm: FANUC's world lies at the height of
axis 2, that of Universal Robots is turned by 180 degrees against ``base_link``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.files import urdf_xml
from irbcal.modeling import frames


class ControllerFrames(NamedTuple):
    """Frames of a controller at an arm's ends.

    Attributes
    ----------
    T_base_world, T_tip_flange : ndarray, shape (4, 4)
        Metres; identity where the URDF names no such link.
    base_known, flange_known : bool
        Whether it does.
    """

    T_base_world: FloatArray
    T_tip_flange: FloatArray
    base_known: bool
    flange_known: bool


def unknown() -> ControllerFrames:
    """The frames of an arm without URDF: its own ends."""
    return ControllerFrames(np.eye(4), np.eye(4), False, False)


def controller_frames(data: bytes, source: str, base_link: str, tip_link: str) -> ControllerFrames:
    """The frames of a URDF.

    Parameters
    ----------
    data : bytes
        Of the URDF.
    source : str
        Its name for messages.
    base_link, tip_link : str
        Ends of the arm.

    Raises
    ------
    RobotError
        If the URDF cannot be read.
    """
    root = urdf_xml.parse(data, source).getroot()
    above: dict[str, tuple[str, FloatArray]] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if joint.get("type") != "fixed" or parent is None or child is None:
            continue
        origin = joint.find("origin")
        xyz, rpy = ((origin.get(key) or "0 0 0") if origin is not None else "0 0 0" for key in ("xyz", "rpy"))
        R = frames.matrix_from_rpy([float(value) for value in rpy.split()])
        above[str(child.get("link"))] = str(parent.get("link")), frames.transform(R, [float(v) for v in xyz.split()])

    def up(link: str) -> dict[str, FloatArray]:
        """All links that are fixed above a link, with its pose in them."""
        T, seen = np.eye(4), {link: np.eye(4)}
        while link in above and above[link][0] not in seen:
            link, step = above[link]
            T = step @ T
            seen[link] = T
        return seen

    def between(link: str, other: str) -> FloatArray | None:
        ours, theirs = up(link), up(other)
        common = next((name for name in ours if name in theirs), None)
        return None if common is None else frames.inverse(ours[common]) @ theirs[common]

    base, flange = between(base_link, "base"), between(tip_link, "tool0")
    eye = np.eye(4)
    return ControllerFrames(
        eye if base is None else base, eye if flange is None else flange, base is not None, flange is not None
    )
