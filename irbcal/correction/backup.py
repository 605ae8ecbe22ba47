"""What a controller's backup says beside its programs, and backups in zip archives.

Where the robot stands in the controller's world, and whether the controller corrects its robot itself: each language
that knows says where its backups have it.
"""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from irbcal import safe_files
from irbcal.arrays import FloatArray
from irbcal.errors import ProgramError

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


def text_of(path: Path) -> str:
    """Content of a file of a backup."""
    return safe_files.read_bytes(path, ProgramError, limit_bytes=LARGEST_MEMBER).decode("latin-1")


def files_named(folder: Path, name: str) -> list[Path]:
    """Files of a folder whose name is this one in lower case."""
    return sorted(path for path in folder.glob("*") if path.name.lower() == name)


def folders_named(files: Iterable[Path], folder: str) -> list[Path]:
    """Folders of a name in which files lie, at any depth."""
    found = [parent for file in files for parent in file.absolute().parents if parent.name.lower() == folder]
    return list(dict.fromkeys(found))


def placed(backup: Backup, T: FloatArray, path: Path) -> Backup:
    """The backup with the place of a robot.

    Raises
    ------
    ProgramError
        If others stand in another one, so that it is not known which robot runs a program.
    """
    known = np.eye(4) if backup.T_world_base is None else backup.T_world_base
    if backup.source and np.abs(T - known).max() > 1e-9:
        raise ProgramError(
            f"robots stand in different places here and in {backup.source}: correct the programs of one robot in a "
            "folder of their own, with bases and work objects as seen from the robot (--frame)",
            file=path,
        )
    moved = np.abs(T - np.eye(4)).max() > 1e-9
    return backup._replace(T_world_base=T if moved else None, source=str(path))


def unzipped(path: Path) -> bytes:
    """Content of a file that is compressed by gzip; empty where it is not, or is too large."""
    data = safe_files.read_bytes(path, ProgramError, limit_bytes=LARGEST_MEMBER)
    try:
        return safe_files.gzip_content(data, path, ProgramError, LARGEST_MEMBER)
    except ProgramError:
        return b""


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

    def with_archives(self, name: str) -> str:
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
            target = Path(folder).resolve() / str(k)
            target.mkdir()
            for info, data in _members(path):
                file = target / info.filename.replace("\\", "/")
                try:
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_bytes(data)
                except (OSError, ValueError) as fault:
                    words = safe_files.words_of(fault)
                    raise ProgramError(f"{info.filename!r} of the archive: {words}", file=path) from None
            out.programs.append(target)
            out.archives[target] = path
        try:
            yield out
        except ProgramError as refusal:
            if refusal.args and out.archives:
                refusal.args = (out.with_archives(str(refusal)), *refusal.args[1:])
                refusal.file = None if refusal.file is None else out.with_archives(refusal.file)
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
