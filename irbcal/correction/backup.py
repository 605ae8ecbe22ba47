"""What a controller's backup says beside its programs, and backups in zip archives.

Where the robot stands in the controller's world: KUKA's ``$ROBROOT`` in ``$machine.dat``, ABB's base frame in
``MOC.cfg``. Whether the controller corrects its robot itself: ``$ABS_ACCUR`` and the ``.pid`` file of KUKA's absolutely
accurate robots (newer controllers use it unless ``$DEACTIVATE_ABS_ACCUR``), a robot calibration in ``MOC.cfg``, the
factory calibration of Universal Robots in ``calibration.conf`` and in the waypoints of ``.urp`` programs.
"""

from __future__ import annotations

import gzip
import re
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from irbcal import safe_files
from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.languages.krl import KUKA, POSE
from irbcal.correction.listing import up_to_next
from irbcal.errors import ProgramError
from irbcal.units import MM

LARGEST_MEMBER = 50_000_000
"""Bytes of a file of a backup that is looked at or unpacked."""
LARGEST_ARCHIVE = 500_000_000
"""Bytes of all files of an archive."""


class Backup(NamedTuple):
    """What a backup says."""

    T_world_base: FloatArray | None = None
    """Shape (4, 4). Where the robot stands in the controller's world, metres; None where they are the same or nothing
    says.
    """
    source: str = ""
    """File that says so."""
    accuracy: str = ""
    """What the controller corrects itself, and the file that says so; empty where nothing says."""


def of_programs(language: str, files: Sequence[Path]) -> Backup:
    """What the backup in which programs lie says.

    Parameters
    ----------
    language : str
        Name of the module of the language.
    files : sequence of Path

    Raises
    ------
    ProgramError
        If several robots stand in different places, so that it is not known which one runs a program.
    """
    readers = {"krl": _kuka, "rapid": _abb, "urscript": _universal_robots}
    return readers[language](files) if language in readers else Backup()


def _text(path: Path) -> str:
    return safe_files.read_bytes(path, ProgramError, limit_bytes=LARGEST_MEMBER).decode("latin-1")


def _roots(files: Iterable[Path], folder: str) -> list[Path]:
    """Folders of a name in which files lie, at any depth."""
    found = [parent for file in files for parent in file.absolute().parents if parent.name.lower() == folder]
    return list(dict.fromkeys(found))


_ROBROOT = re.compile(r"^[ \t]*(?:DECL[ \t]+)?(?:FRAME[ \t]+)?\$ROBROOT[ \t]*=[ \t]*\{([^{}\r\n]*)\}", re.I | re.M)
_ABS_ACCUR = re.compile(r"^[^;\r\n]*\$ABS_ACCUR[ \t]*=[ \t]*(?:TRUE|#ACTIVATED)\b", re.I | re.M)
_DEACTIVATED = re.compile(
    r"^[^;\r\n]*\$(?:DEACTIVATE_ABS_ACCUR[ \t]*=[ \t]*TRUE|ABS_ACCUR[ \t]*=[ \t]*FALSE)\b", re.I | re.M
)
_OF_ROBOT = ("roboter", "ir_spec", "rdc")
"""Folders beside ``KRC`` in archives that hold the files of one robot."""
_COMPONENT = re.compile(r"\b([XYZABC])[ \t]+([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)", re.I)


def _kuka(files: Sequence[Path]) -> Backup:
    backup = Backup()
    for root in _roots(files, "krc"):
        folders = [root, *(path for path in root.parent.glob("*") if path.name.lower() in _OF_ROBOT and path.is_dir())]
        of_robot = sorted(path for folder in folders for path in folder.rglob("*") if path.suffix.lower() == ".pid")
        deactivated = False
        for path in sorted(path for path in root.rglob("$*") if path.suffix.lower() == ".dat" and path.is_file()):
            text = _text(path)
            deactivated |= _DEACTIVATED.search(text) is not None
            if _ABS_ACCUR.search(text):
                backup = backup._replace(accuracy=f"the robot is absolutely accurate ($ABS_ACCUR in {path.name})")
            for match in _ROBROOT.finditer(text):
                values = {name.upper(): float(value) for name, value in _COMPONENT.findall(match[1])}
                if len(values) == len(POSE):
                    backup = _placed(backup, KUKA.frame([values[name.upper()] for name in POSE]), path)
        if of_robot and not deactivated and not backup.accuracy:
            backup = backup._replace(accuracy=f"the robot is absolutely accurate ({of_robot[0].name} is in the backup)")
    for path in files:
        if path.suffix.lower() in (".src", ".sub") and _ABS_ACCUR.search(_text(path)):
            backup = backup._replace(
                accuracy=f"{path.name} switches on that the robot is absolutely accurate ($ABS_ACCUR)"
            )
    return backup


def _placed(backup: Backup, T: FloatArray, path: Path) -> Backup:
    """The backup with the place of a robot, which must be the same as that of others."""
    known = np.eye(4) if backup.T_world_base is None else backup.T_world_base
    if backup.source and np.abs(T - known).max() > 1e-9:
        raise ProgramError(
            f"robots stand in different places here and in {backup.source}: correct the programs of one robot in a "
            "folder of their own, with bases and work objects as seen from the robot (--frame)",
            file=path,
        )
    moved = np.abs(T - np.eye(4)).max() > 1e-9
    return backup._replace(T_world_base=T if moved else None, source=str(path))


_CFG_TYPE = re.compile(r"^([A-Z][A-Z0-9_]*):[ \t]*\r?$", re.M)
_CFG_VALUE = re.compile(r"-([A-Za-z]\w*)(?:[ \t]+(\"[^\"\r\n]*\"|[-+]?[\d.][\w.+-]*|[A-Za-z]\w*))?")


def _abb(files: Sequence[Path]) -> Backup:
    backup = Backup()
    for root in _roots(files, "rapid"):
        settings = [path for path in root.parent.glob("*") if path.name.lower() == "syspar" and path.is_dir()]
        for path in sorted(path for folder in settings for path in folder.glob("*") if path.name.lower() == "moc.cfg"):
            for robot in _instances(_text(path), "ROBOT"):
                calibration = robot.get("use_robot_calib", "")
                if calibration and "uncalib" not in calibration.lower():
                    words = f"the robot has a calibration of its maker (use_robot_calib {calibration} in {path.name})"
                    backup = backup._replace(accuracy=words)
                numbers = [robot.get(f"base_frame_pos_{axis}", "0") for axis in "xyz"]
                numbers += [robot.get(f"base_frame_orient_u{k}", "1" if k == 0 else "0") for k in range(4)]
                try:
                    values = np.array([float(number) for number in numbers])
                except ValueError:
                    raise ProgramError(f"the base frame of {robot.get('name')} is not in numbers", file=path) from None
                if problem := notation.Quaternion().problem(values[3:].tolist()):
                    raise ProgramError(f"base frame of {robot.get('name', 'a robot')}: {problem}", file=path)
                T = notation.poses_from_numbers(np.concatenate([values[:3] / MM, values[3:]])[None])[0]
                backup = _placed(backup, T, path)
    return backup


def _instances(text: str, kind: str) -> list[dict[str, str]]:
    """Instances of one type of a configuration file of ABB, their attributes without quotes."""
    types = list(_CFG_TYPE.finditer(text))
    out: list[dict[str, str]] = []
    for found, end in up_to_next(types, len(text)):
        if found[1] == kind:
            for name, value in _CFG_VALUE.findall(text, found.end(), end):
                out += [{}] if name == "name" or not out else []
                out[-1][name] = value.strip('"')
    return out


_LINEARIZED = re.compile(rb"<Kinematics\b[^<>]*\bstatus=\"LINEARIZED\"")
_STATUS = re.compile(r"^[ \t]*calibration_status[ \t]*=[ \t]*2\b", re.M)


def _universal_robots(files: Sequence[Path]) -> Backup:
    for folder in dict.fromkeys(file.parent for file in files):
        for path in sorted(folder.glob("*")):
            if path.name.lower() == "calibration.conf" and _STATUS.search(_text(path)):
                return Backup(accuracy=f"the controller has the robot's factory calibration ({path.name})")
            if path.suffix.lower() == ".urp" and _LINEARIZED.search(unzipped(path)):
                return Backup(accuracy=f"the controller has the robot's factory calibration (waypoints of {path.name})")
    return Backup()


def unzipped(path: Path) -> bytes:
    """Content of a file that is compressed by gzip; empty where it is not, or is too large."""
    data = safe_files.read_bytes(path, ProgramError, limit_bytes=LARGEST_MEMBER)
    try:
        with gzip.GzipFile(fileobj=BytesIO(data)) as stream:
            content = stream.read(LARGEST_MEMBER + 1)
    except (OSError, EOFError, zlib.error):
        return b""
    return content if len(content) <= LARGEST_MEMBER else b""


def _members(path: Path) -> list[tuple[zipfile.ZipInfo, bytes]]:
    """Files of an archive.

    Raises
    ------
    ProgramError
        If it is none, is too large, encrypted or damaged, or has files that would lie outside of its folder.
    """
    data = safe_files.read_bytes(path, ProgramError, limit_bytes=LARGEST_ARCHIVE)
    out: list[tuple[zipfile.ZipInfo, bytes]] = []
    with safe_files.zip_archive(data, path, ProgramError, LARGEST_ARCHIVE) as archive:
        for info in archive.infolist():
            if info.is_dir():
                continue
            if not _stays_inside(info):
                raise ProgramError(f"{info.filename!r} of the archive would lie outside of its folder", file=path)
            out.append((info, safe_files.zip_member(archive, info, path, ProgramError)))
    return out


def _stays_inside(info: zipfile.ZipInfo) -> bool:
    """Whether a file of an archive is a plain one that lies in its folder."""
    place = PurePosixPath(info.filename.replace("\\", "/"))
    link = info.external_attr >> 16 & 0o170000 == 0o120000
    return not (place.is_absolute() or ".." in place.parts or re.match(r"[A-Za-z]:", info.filename) or link)


class Unpacked(NamedTuple):
    """Programs whose archives are unpacked."""

    programs: list[Path]
    """Files and folders, those of archives among them."""
    archives: dict[Path, Path]
    """The archives by the folders of their files."""

    def shown(self, name: str) -> str:
        """A text that names files, with those of archives as ``archive.zip!file``."""
        for folder, archive in self.archives.items():
            name = name.replace(f"{folder}/", f"{archive}!")
        return name


@contextmanager
def unpacked(programs: Sequence[str | Path]) -> Iterator[Unpacked]:
    """Programs with the files of zip archives in folders, which are gone afterwards; other programs are as they were.

    Raises
    ------
    ProgramError
        If an archive cannot be read; one that comes from within names the files of archives.
    """
    with tempfile.TemporaryDirectory(prefix="irbcal-") as folder:
        out = Unpacked([], {})
        for k, path in enumerate(map(Path, programs)):
            if path.suffix.lower() != ".zip" or not path.is_file():
                out.programs.append(path)
                continue
            place = Path(folder).resolve() / str(k)
            place.mkdir()
            for info, data in _members(path):
                file = place / info.filename.replace("\\", "/")
                try:
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_bytes(data)
                except (OSError, ValueError) as fault:
                    words = safe_files.words_of(fault)
                    raise ProgramError(f"{info.filename!r} of the archive: {words}", file=path) from None
            out.programs.append(place)
            out.archives[place] = path
        try:
            yield out
        except ProgramError as refusal:
            if refusal.args and out.archives:
                refusal.args = (out.shown(str(refusal)), *refusal.args[1:])
                refusal.file = None if refusal.file is None else out.shown(refusal.file)
            raise


def packed(archive: Path, files: Mapping[str, bytes]) -> bytes:
    """An archive with new contents of some of its files, by their names in it, and new files; all else is as it was."""
    out, more = BytesIO(), dict(files)
    with zipfile.ZipFile(out, "w") as new:
        for info, data in _members(archive):
            new.writestr(info, more.pop(info.filename.replace("\\", "/"), data), info.compress_type)
        for name, data in more.items():
            new.writestr(name, data, zipfile.ZIP_DEFLATED)
    return out.getvalue()
