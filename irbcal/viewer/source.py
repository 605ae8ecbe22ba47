"""What a view is opened on: a calibration, a URDF or a shipped robot, with the documents that it is drawn from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from irbcal.errors import CalibrationError
from irbcal.files import calibration_folder, robots, urdf
from irbcal.files.calibration_folder import CalibrationLike, opened
from irbcal.files.schema import Record
from irbcal.files.urdf import UrdfArm
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class Source:
    """A robot to look at.

    Attributes
    ----------
    name : str
        For messages.
    title : str
    record : Record or None
        The calibration; None for a robot as such.
    robot : Robot
        Predicts.
    ghost : Robot or None
        The nominal robot of a calibration.
    nominal : Arm
    urdf : UrdfArm
        The document that the robot is drawn from.
    ghost_urdf : UrdfArm or None
        The one for the nominal robot.
    folder : Path
        Where relative names of meshes start.
    """

    name: str
    title: str
    record: Record | None
    robot: Robot
    ghost: Robot | None
    nominal: Arm
    urdf: UrdfArm
    ghost_urdf: UrdfArm | None
    folder: Path


def open_source(source: CalibrationLike, base_link: str | None = None, tip_link: str | None = None) -> Source:
    """Open whatever a view is asked for.

    Parameters
    ----------
    source : str, Path, Record or a result that holds one
        Calibration folder or calibration, URDF, or a shipped robot's name.
    base_link, tip_link : str, optional
        Link names, for a URDF.

    Raises
    ------
    RobotError
        If there is no such robot, or its URDF cannot be used.
    CalibrationError
        If a calibration cannot be read, or does not hold the robot's looks.
    """
    if not isinstance(source, (str, Path)):
        record = opened(source)
        return _calibration("this calibration", record, *_documents(record))
    if Path(source).is_dir():
        saved = calibration_folder.read(source)
        return _calibration(str(source), saved.record, saved.urdf, saved.nominal_urdf(), Path(source))
    path = robots.robot_file(source)
    read = urdf.read(path, base_link, tip_link)
    return Source(str(source), read.arm.name, None, Robot(read.arm), None, read.arm, read, None, path.parent)


def _documents(record: Record) -> tuple[bytes, bytes, Path]:
    """URDFs of a calibration whose folder is not known: those of a shipped robot can be made again."""
    for name in robots.ROBOTS:
        path = robots.robot_file(name)
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() == record.robot.urdf_sha256:
            read = urdf.from_bytes(data, str(path), record.robot.base_link, record.robot.tip_link)
            return urdf.to_bytes(read, record.arm()), data, path.parent
    raise CalibrationError(
        f"this calibration of {record.robot.name} does not hold the robot's looks: give its folder in its place"
    )


def _calibration(name: str, record: Record, text: bytes, nominal_text: bytes, folder: Path) -> Source:
    section = record.robot
    own, nominal = (
        urdf.from_bytes(data, f"{which} URDF of {section.name}", section.base_link, section.tip_link)
        for which, data in (("calibrated", text), ("nominal", nominal_text))
    )
    return Source(
        name=name,
        title=f"{section.name}, model {record.model}",
        record=record,
        robot=record.robot_calibrated(),
        ghost=record.robot_nominal(),
        nominal=record.arm(calibrated=False),
        urdf=own,
        ghost_urdf=nominal,
        folder=folder,
    )
