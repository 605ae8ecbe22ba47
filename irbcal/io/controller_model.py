"""Where a controller's world and flange are in a URDF, and what a controller itself computes with.

The makers' public URDFs name the frame in which the controller gives its positions ``base`` and the flange as the
controller counts it ``tool0``. Neither need be the link at an end of the arm: FANUC's world lies at the height of
axis 2, that of Universal Robots is turned by 180 degrees against ``base_link``.

Universal Robots' controllers carry the factory calibration of their arm, others know an edition of the geometry that
is not that of the public URDF. Fake targets in poses must be made with the controller's numbers: it is the controller
that turns them into joints. It counts poses from its own base to its own flange, which measurements do not tell: they
are found from what is the same thing in both models, axis 1 with its zero at one end and the last axis at the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.errors import RobotError
from irbcal.io import joint_origins, urdf, urdf_xml
from irbcal.io.schema import Record
from irbcal.modeling import dhm, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.safe_files import read_bytes
from irbcal.units import MM


class ControllerFrames(NamedTuple):
    """Frames of a controller at an arm's ends."""

    T_base_world: FloatArray
    T_tip_flange: FloatArray
    """Shape (4, 4). Metres; identity where the URDF names no such link."""
    base_known: bool
    flange_known: bool
    """Whether it does."""


def unknown_frames() -> ControllerFrames:
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
        T, T_of_link = np.eye(4), {link: np.eye(4)}
        while link in above and above[link][0] not in T_of_link:
            link, step = above[link]
            T = step @ T
            T_of_link[link] = T
        return T_of_link

    def between(link: str, target: str) -> FloatArray | None:
        ours, theirs = up(link), up(target)
        common = next((name for name in ours if name in theirs), None)
        return None if common is None else frames.inverse(ours[common]) @ theirs[common]

    base, flange = between(base_link, "base"), between(tip_link, "tool0")
    eye = np.eye(4)
    return ControllerFrames(
        eye if base is None else base, eye if flange is None else flange, base is not None, flange is not None
    )


ANOTHER = 30 * MM
"""Median distance from the nominal robot above which a model is of another robot, or counts its joints otherwise."""

SAME_MODEL = 1e-9
"""Difference (metres and entries of rotations) up to which two models are one."""

PARALLEL = 0.1
"""Sine of the angle between neighbouring axes below which these do not tell a frame."""

ITSELF = 0.5
"""A controller nearer to the calibrated robot than this share of the nominal robot's distance corrects itself."""


@dataclass(frozen=True, eq=False)
class ControllerModel(Locked):
    """What a controller computes with."""

    source: str
    """File name."""
    arm: Arm
    """The controller's model, with the names and limits of the nominal arm; its base is the controller's."""
    nominal: Arm
    T_own_base: FloatArray
    T_tip_own: FloatArray
    """Shape (4, 4). The nominal base link in the controller's base, and the controller's flange in the nominal tip
    link.
    """

    def seen_by_it(self, robot: Robot) -> Robot:
        """A calibrated robot whose poses are counted from the controller's base to its flange."""
        T_own_tip = frames.inverse(self.T_tip_own)
        targets = {name: T_own_tip[:3, :3] @ xyz + T_own_tip[:3, 3] for name, xyz in robot.targets.items()}
        rotations = {name: T_own_tip[:3, :3] @ R for name, R in robot.target_rotations.items()}
        base, tip = self.T_own_base @ robot.arm.T_base_0, robot.arm.T_last_tip @ self.T_tip_own
        arm = replace(robot.arm, T_base_0=base, T_last_tip=tip)
        return robot.replace(arm=arm, targets=targets, target_rotations=rotations)

    def in_words(self, robot: Robot, q: FloatArray) -> str:
        """How far it is from the nominal robot and from a calibrated one as it sees that, at joints (n, joints)."""
        if not len(q):
            q = self.nominal.random_joints(200, 0)
        T_arm = self.arm.forward(q)
        nominal, true = (
            float(np.linalg.norm((T - T_arm)[:, :3, 3], axis=1).mean()) / MM
            for T in (self.T_own_base @ self.nominal.forward(q) @ self.T_tip_own, robot.forward(q))
        )
        text = (
            f"the controller computes with {Path(self.source).name}, which is {nominal:.3f} mm (mean) from the nominal "
            f"robot and {true:.3f} mm from the calibrated one; tools and frames are those that this controller knows"
        )
        if true < ITSELF * nominal:
            text += (
                "; it corrects its robot itself, and only the rest is corrected here: such a program is wrong where "
                "that option is switched off"
            )
        return text


def controller_kinematics(path: str | Path, record: Record, calibrated_urdf: bytes | None) -> ControllerModel:
    """Read what a controller computes with.

    Parameters
    ----------
    path : str or Path
        A URDF, or joint origins in the layout of ``ur_description``'s calibration files (YAML).
    record : Record
        The calibration, for the nominal robot and the names of its links.
    calibrated_urdf : bytes or None
        Its URDF, into which joint origins are put; None where it is not at hand.

    Raises
    ------
    RobotError
        If the file cannot be read, is the calibration's own, or is of another robot.
    """
    source, data = str(path), read_bytes(path, RobotError)
    nominal = record.arm(calibrated=False)
    if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        data = _with_origins(joint_origins.read(data, source), record, calibrated_urdf, source)
    parsed = urdf.from_bytes(data, source, nominal.base_link, nominal.tip_link).arm
    if not np.array_equal(parsed.table.prismatic, nominal.table.prismatic):
        raise RobotError(
            f"expected the {nominal.joints_in_words} of {nominal.name}, found {parsed.joints_in_words}",
            file=source,
            parameter="controller_model",
        )
    arm = replace(parsed, joint_names=nominal.joint_names, lower=nominal.lower, upper=nominal.upper)
    arm = replace(arm, coupling=nominal.coupling)
    q = nominal.random_joints(200, 0)
    if np.abs(arm.forward(q) - record.arm().forward(q)).max() < SAME_MODEL:
        raise RobotError(
            "this is the calibrated robot itself, and no controller computes with it: expected the controller's own "
            "model (irbcal controller writes it from poses that the controller reports)",
            file=source,
            parameter="controller_model",
        )
    (base, tip), (base_nominal, tip_nominal) = (_ends(arm_or_nominal, source) for arm_or_nominal in (arm, nominal))
    T_own_base, T_tip_own = base @ frames.inverse(base_nominal), tip_nominal @ frames.inverse(tip)
    apart = arm.forward(q) - T_own_base @ nominal.forward(q) @ T_tip_own
    far = float(np.median(np.linalg.norm(apart[:, :3, 3], axis=1)))
    if far > ANOTHER:
        raise RobotError(
            f"its poses are {far / MM:.3g} mm (median) from those of {nominal.name}: another robot, other zeros of the "
            "joints, or links whose frames lie elsewhere than those of the calibrated URDF",
            file=source,
            parameter="controller_model",
        )
    return ControllerModel(source, arm, nominal, T_own_base, T_tip_own)


def _with_origins(
    origins: Mapping[str, FloatArray], record: Record, calibrated_urdf: bytes | None, source: str
) -> bytes:
    """The calibration's URDF with other joint origins."""
    if calibrated_urdf is None:
        raise RobotError(
            "joint origins need the URDF that they are for: name the calibration by its folder", file=source
        )
    links = {origin.link: origin.joint for origin in record.joint_origins}
    return urdf.with_joint_origins(calibrated_urdf, joint_origins.by_joint(origins, links, source))


def _ends(arm: Arm, source: str) -> tuple[FloatArray, FloatArray]:
    """What axis 1 tells of the base, in the base link, and the last axis of the tip, in it, at zero joints."""
    chain = dhm.chain_frames(arm.table, arm.table.offsets[:, None], arm.T_base_0)
    z, o = np.asarray(chain.z)[:, :, 0], np.asarray(chain.o)[:, :, 0]
    axis_frames = []
    for axis, beside in ((0, 1), (-1, -2)):
        across = frames.cross(z[axis], z[beside])
        if arm.table.prismatic[[axis, beside]].any() or np.linalg.norm(across) < PARALLEL:
            raise RobotError(
                f"the {'first' if axis == 0 else 'last'} two axes of {arm.name} are parallel or do not turn: they do "
                "not tell where the ends of another model are",
                file=source,
                parameter="controller_model",
            )
        along = frames.cross(z[beside], across) @ (o[beside] - o[axis]) / (across @ across)
        y = z[beside] - z[axis] * (z[axis] @ z[beside])
        y = y / np.linalg.norm(y)
        R = np.column_stack([frames.cross(y, z[axis]), y, z[axis]])
        axis_frames.append(frames.transform(R, o[axis] + along * z[axis]))
    return axis_frames[0], frames.inverse(arm.forward(np.zeros((1, len(z))))[0]) @ axis_frames[1]
