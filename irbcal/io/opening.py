"""The doors: `open_robot` for robots, nominal or calibrated, `open_calibration` for what a calibration says.

By whatever names them: a robot's name, a file, a folder, or what was opened before.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Protocol, TypeAlias, Union

import numpy as np

from irbcal.arrays import Locked
from irbcal.errors import CalibrationError, RobotError
from irbcal.io import calibration_folder, robots, urdf
from irbcal.io.calibration_folder import JSON_NAME, URDF_NAME
from irbcal.io.schema import Record
from irbcal.io.urdf import UrdfArm
from irbcal.modeling.arm import Arm
from irbcal.modeling.coupling import in_words
from irbcal.modeling.robot import Robot
from irbcal.option_values import excerpt
from irbcal.safe_files import PREFIX

SAME_ROBOT = 1e-9
"""Metres and radians within which two nominal robots are the same: one put together again, or of two calibrations."""


MOST_REMEMBERED, LARGEST_REMEMBERED = 8, 2**25
"""Folders, and bytes of one, that stay open: as long as every byte is as it was checked, they are not checked again."""


class HoldsRecord(Protocol):
    """A result that holds the content of a ``calibration.json``."""

    @property
    def record(self) -> Record:
        """The content."""
        ...


CalibrationLike: TypeAlias = str | Path | Record | HoldsRecord
"""Whatever names a calibration: its folder, its record, or a result that holds one."""


def open_calibration(calibration: CalibrationLike) -> Record:
    """A calibration by whatever names it: folder, record, or a result that holds one.

    Raises
    ------
    CalibrationError
        As `irbcal.io.calibration_folder.read`, or if it is nothing of that kind.
    """
    if isinstance(calibration, Record):
        return calibration
    if isinstance(calibration, (str, PathLike)):
        record = _open_folder(calibration_folder.folder_of(calibration), False).record
    else:
        record = getattr(calibration, "record", None)
    if not isinstance(record, Record):
        raise CalibrationError(
            f"expected a calibration folder or a loaded calibration, found {excerpt(calibration)}",
            parameter="calibration",
        )
    return record


def calibration_at(robot: object) -> Path | None:
    """The folder of the calibration that a path stands for: itself, its record or its URDF.

    None where it is the name of a robot, though there may be a calibration called like it.
    """
    if not isinstance(robot, (str, PathLike)) or robots.named_robot(os.fspath(robot)) is not None:
        return None
    folder = calibration_folder.folder_of(robot)
    return folder if (folder / JSON_NAME).is_file() else None


def _is_calibration(path: Path, nominal: bool) -> bool:
    """Whether a path is opened as a calibration: a folder is, whole or not.

    A folder called like a shipped robot is one only if it has parts of a calibration and ``nominal`` is false.
    """
    if not path.is_dir() or robots.named_robot(path) is None:
        return path.is_dir()
    parts = (file.name in (JSON_NAME, URDF_NAME) or file.name.startswith(PREFIX) for file in path.iterdir())
    return not nominal and any(parts)


RobotLike: TypeAlias = Union[str, Path, Record, HoldsRecord, "Opened"]
"""Whatever names a robot: calibration folder, loaded calibration, path of a URDF, name of a shipped robot, `Opened`."""


_opened_folders: dict[tuple[str, str, bool, tuple[tuple[str, bytes], ...] | None], Opened] = {}


@dataclass(frozen=True, eq=False, repr=False)
class Opened(Locked):
    """A robot, and what it was opened from.

    A loaded calibration knows neither its folder nor its URDF: they are None unless the robot is a shipped one, of
    which the URDF can be made again.
    """

    name: str
    """The path or the shipped robot's file; of a loaded calibration its robot's name."""
    robot: Robot
    """Of a calibration its behaviour, calibrated or, if that was asked for, nominal; the nominal robot of a URDF."""
    nominal: Arm
    """The nominal arm that belongs to it."""
    record: Record | None
    """The calibration; None for a URDF."""
    folder: Path | None
    """The calibration's folder, or the one in which the URDF lies."""
    urdf: UrdfArm | None
    """The URDF with the geometry of `robot`."""
    urdf_bytes: bytes | None
    """The same as a document."""

    def __repr__(self) -> str:
        return f"<Opened {self.name}: {'URDF' if self.record is None else 'calibration'}, {self.robot!r}>"

    @property
    def mesh_folders(self) -> list[str]:
        """Folders that a calibration remembers its meshes by."""
        return [] if self.record is None else list(self.record.mesh_folders or ())

    @property
    def file(self) -> Path:
        """The robot's file; of a calibration folder the URDF in it."""
        return Path(self.name) if self.record is None or self.folder is None else self.folder / URDF_NAME

    @property
    def source(self) -> tuple[str, str]:
        """Name and SHA-256 of the nominal robot's URDF."""
        if self.record is not None:
            return self.record.robot.urdf, self.record.robot.urdf_sha256
        return self.file.name, hashlib.sha256(self.urdf_bytes or b"").hexdigest()

    @cached_property
    def nominal_urdf(self) -> UrdfArm:
        """The URDF with the geometry of `nominal`; that of a calibration is without its mark.

        Raises
        ------
        CalibrationError
            If a loaded calibration has no URDF, or its joint origins from before do not give its nominal robot.
        """
        if self.record is None and self.urdf is not None:
            return self.urdf
        if self.record is None or self.urdf_bytes is None:
            raise CalibrationError(f"{self.name}: a loaded calibration has no URDF: give its folder", parameter="robot")
        nominal = _arm_of(urdf.without_mark(_with_nominal_origins(self.urdf_bytes, self.record)), self.record)
        q = self.nominal.random_joints(20, 0)
        if np.abs(nominal.arm.forward(q) - self.nominal.forward(q)).max() > SAME_ROBOT:
            raise CalibrationError(
                "the joint origins from before the calibration do not give its nominal robot",
                file=None if self.folder is None else self.folder / JSON_NAME,
            )
        return replace(nominal, arm=replace(nominal.arm, name=self.nominal.name, coupling=self.nominal.coupling))


def open_robot(
    robot: RobotLike,
    *,
    nominal: bool = False,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> Opened:
    """The robot of a calibration, of a URDF or shipped with the package.

    Parameters
    ----------
    robot : str, Path, Record, a result that holds one, or Opened
        Calibration folder, loaded calibration, path of a URDF, or name of a shipped robot (``irb1600``, ``irb120``);
        one that is opened already is returned as it is.
    nominal : bool
        The nominal behaviour of a calibration (its base and tool identified with the nominal model). A robot's name
        then means that robot, though there may be a calibration called like it.
    base_link, tip_link, coupling, package_dirs
        Of a URDF, as `irbcal.read_urdf` takes them; a calibration has its own.

    Raises
    ------
    CalibrationError
        If a calibration folder is not a whole calibration.
    RobotError
        If there is no such file or robot, the URDF cannot be used, or other links or another coupling are chosen for a
        calibration.
    """
    if isinstance(robot, Opened):
        if nominal or base_link or tip_link or coupling is not None:
            raise RobotError(f"{robot.name}: this robot is open: choose its behaviour and links when it is opened")
        return robot
    path = calibration_folder.folder_of(robot) if isinstance(robot, (str, PathLike)) else None
    if path is not None and not _is_calibration(path, nominal):
        read = urdf.read(path, base_link, tip_link, coupling, package_dirs)
        file, data = robots.robot_file(path), urdf.source_bytes(path, package_dirs)
        return Opened(str(file), Robot(read.arm), read.arm, None, file.parent, read, data)
    if path is None and not isinstance(getattr(robot, "record", robot), Record):
        raise RobotError(
            f"expected a robot (URDF, name, calibration folder or loaded calibration), found {excerpt(robot)}",
            parameter="robot",
        )
    opened = _open_record(robot, nominal) if path is None else _open_folder(path, nominal)
    assert opened.record is not None
    section = opened.record.robot
    for parameter, value, stored in (
        ("base_link", base_link, section.base_link),
        ("tip_link", tip_link, section.tip_link),
        ("coupling", coupling, "none" if section.coupling is None else in_words(np.array(section.coupling))),
    ):
        if value not in (None, stored):
            raise RobotError(
                f"{opened.name}: a calibration has its own {parameter}: give one for a URDF only", parameter=parameter
            )
    return opened


def _open_record(calibration: CalibrationLike, nominal: bool) -> Opened:
    """The robot of a calibration that is open."""
    record = open_calibration(calibration)
    folder, text = getattr(calibration, "folder", None), getattr(calibration, "urdf", None)
    if text is None:
        folder, text = _shipped(record)
    return _opened_from_record(record.robot.name, record, folder, text, nominal)


def _open_folder(path: Path, nominal: bool) -> Opened:
    """The robot of a calibration folder; what was opened is remembered while the folder's content stays as it is."""
    content = calibration_folder.contents(path)
    key = (str(path), os.getcwd(), nominal, content)
    if content is not None and key in _opened_folders:
        return _opened_folders[key]
    saved = calibration_folder.read(path)
    opened = _opened_from_record(str(path), saved.record, saved.folder, saved.urdf, nominal)
    if content is not None and calibration_folder.contents(path) == content:
        if sum(len(data) for _, data in content) <= LARGEST_REMEMBERED:
            _opened_folders[key] = opened
        while len(_opened_folders) > MOST_REMEMBERED:
            _opened_folders.pop(next(iter(_opened_folders)), None)
    return opened


def _opened_from_record(name: str, record: Record, folder: Path | None, text: bytes | None, nominal: bool) -> Opened:
    if nominal and text is not None:
        text = _with_nominal_origins(text, record)
    return Opened(
        name=name,
        robot=record.robot_nominal() if nominal else record.robot_calibrated(),
        nominal=record.arm(calibrated=False),
        record=record,
        folder=folder,
        urdf=None if text is None else _arm_of(text, record),
        urdf_bytes=text,
    )


def _with_nominal_origins(data: bytes, record: Record) -> bytes:
    return urdf.with_joint_origins(data, {origin.joint: origin.nominal.transform() for origin in record.joint_origins})


def _arm_of(data: bytes, record: Record) -> UrdfArm:
    """The arm of a calibration's URDF."""
    section = record.robot
    return urdf.from_bytes(data, f"URDF of {section.name}", section.base_link, section.tip_link)


def _shipped(record: Record) -> tuple[Path | None, bytes | None]:
    """Folder and calibrated URDF of a loaded calibration, of a shipped robot."""
    for name in robots.ROBOTS:
        path = robots.robot_file(name)
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() == record.robot.urdf_sha256:
            return path.parent, urdf.to_bytes(_arm_of(data, record), record.arm())
    return None, None
