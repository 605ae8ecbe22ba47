"""The nominal robot of whatever names one: a URDF, a robot's name, or a calibration with the robot it began from."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from irbcal.errors import CalibrationError, RobotError
from irbcal.files import calibration_folder, urdf, urdf_xml
from irbcal.files.calibration_folder import JSON_NAME, URDF_NAME, Saved
from irbcal.files.urdf import UrdfArm
from irbcal.modeling.coupling import in_words

SAME = 1e-9
"""Metres and radians within which a nominal robot put together again is the one that the calibration began from."""


def calibration_at(robot: object) -> Saved | None:
    """The calibration that a robot's name stands for: its folder, or its URDF with ``calibration.json`` beside it.

    Raises
    ------
    CalibrationError
        If there is one that cannot be read.
    """
    if not isinstance(robot, (str, os.PathLike)):
        return None
    path = Path(robot)
    if path.name in (JSON_NAME, URDF_NAME) and path.is_file():
        path = path.parent
    return calibration_folder.read(path) if path.is_dir() and (path / JSON_NAME).is_file() else None


def nominal_of(saved: Saved) -> UrdfArm:
    """The robot that a calibration began from: its URDF with the joint origins from before.

    Raises
    ------
    CalibrationError
        If that is not the robot of ``calibration.json``.
    """
    section, arm = saved.record.robot, saved.record.arm(calibrated=False)
    data = _unmarked(saved.nominal_urdf())
    found = urdf.from_bytes(data, str(saved.folder / URDF_NAME), section.base_link, section.tip_link)
    q = arm.random_joints(20, 0)
    if np.abs(found.arm.forward(q) - arm.forward(q)).max() > SAME:
        raise CalibrationError(
            "the joint origins from before the calibration do not give its nominal robot", file=saved.folder / JSON_NAME
        )
    return replace(found, arm=replace(found.arm, name=arm.name, coupling=arm.coupling))


def _unmarked(data: bytes) -> bytes:
    """A URDF without the fingerprint of a calibration."""
    tree = urdf_xml.parse(data, URDF_NAME)
    root = tree.getroot()
    for element in root.findall(urdf.FINGERPRINT_TAG):
        root.remove(element)
    return urdf_xml.serialised(tree)


def read_nominal(
    robot: str | Path, base: str | None = None, tip: str | None = None, coupling: str | None = None
) -> UrdfArm:
    """As `irbcal.files.urdf.read`, and the nominal robot of a calibration.

    Raises
    ------
    RobotError
        If the robot is refused, or links or a coupling are chosen for a calibration, which has its own.
    CalibrationError
        If a calibration cannot be read.
    """
    saved = calibration_at(robot)
    if saved is None:
        return urdf.read(robot, base, tip, coupling)
    section = saved.record.robot
    for parameter, given, own in (
        ("base_link", base, section.base_link),
        ("tip_link", tip, section.tip_link),
        ("coupling", coupling, "none" if section.coupling is None else in_words(np.array(section.coupling))),
    ):
        if given not in (None, own):
            raise RobotError(f"{robot}: a calibration has its own {parameter}", parameter=parameter)
    return nominal_of(saved)
