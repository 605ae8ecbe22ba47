"""The calibration folder: ``calibrated.urdf``, ``joint_origins.yaml``, ``calibration.json`` and ``report.html``.

Points and poses of a large calibration are Parquet files beside ``calibration.json``, which has their hashes: many
points as JSON are large and slow. What is read is the same: one schema, sections `points` and `poses`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import ValidationError

from irbcal.atomic import recover, write_together
from irbcal.errors import CalibrationError
from irbcal.io import integrity, joint_origins
from irbcal.io.integrity import contradictions, refuse_absurd
from irbcal.io.schema import Record, Seal
from irbcal.names import comment
from irbcal.reading import read_bytes
from irbcal.section import Section

MOST_POINTS = 30_000
"""Points that stand in ``calibration.json`` at most."""
SCHEMA = "irbcal-calibration-1"
TABLE_FILES = {"points": "calibration.points.parquet", "poses": "calibration.poses.parquet"}
SIGN_COLUMN = "came_from"
"""A column of characters."""


def without_tables(record: Record) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What stands in ``calibration.json``, and the files beside it.

    Returns
    -------
    document : dict
        For JSON, without its seal.
    files : dict of str to bytes
        Empty where there are few points, or pyarrow is not installed.
    """
    if len(record.points.pose) <= MOST_POINTS or not _pyarrow():
        return record.model_dump(mode="json"), {}
    files = {file: _parquet(getattr(record, name)) for name, file in TABLE_FILES.items()}
    references = {name: _reference(file, files[file]) for name, file in TABLE_FILES.items()}
    document = record.model_dump(mode="json", exclude=set(TABLE_FILES)) | references
    return document, files


def with_tables(document: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """The content of a ``calibration.json`` with the tables that stand beside it.

    Parameters
    ----------
    document : dict
        As JSON has it.
    folder : Path

    Raises
    ------
    CalibrationError
        If a table is missing, is not the one that the file names, or cannot be read.
    """
    if not _beside(document):
        return document
    return dict(document) | {name: _read_table(document.get(name), folder, file) for name, file in TABLE_FILES.items()}


def _beside(document: Any) -> bool:
    """Whether tables stand in files of their own."""
    points = document.get("points") if isinstance(document, dict) else None
    return isinstance(points, dict) and "file" in points


def _reference(name: str, content: bytes) -> dict[str, str]:
    return {"file": name, "sha256": hashlib.sha256(content).hexdigest()}


def _pyarrow() -> bool:
    from importlib.util import find_spec

    return find_spec("pyarrow") is not None


def _parquet(table: Section) -> bytes:
    """A section of columns as Parquet; columns for each joint are numbered."""
    import pyarrow as pa
    from pyarrow import parquet

    columns: dict[str, Any] = {}
    for name, values in table:
        if name == SIGN_COLUMN or (values and isinstance(values[0], list)):
            columns |= {f"{name}.{k}": pa.array(list(column)) for k, column in enumerate(values)}
        elif values:
            columns[name] = pa.array(values)
    buffer = BytesIO()
    names = [name for name, column in columns.items() if not pa.types.is_floating(column.type)]
    parquet.write_table(pa.table(columns), buffer, compression="zstd", use_dictionary=names)
    return buffer.getvalue()


def _read_table(reference: Any, folder: Path, name: str) -> dict[str, list[Any]]:
    """The columns of a table, as JSON would have them."""
    content = read_bytes(folder / name, CalibrationError)
    if reference != _reference(name, content):
        raise CalibrationError("this is not the table that calibration.json was written with", file=folder / name)
    try:
        from pyarrow import parquet
    except ImportError:
        raise CalibrationError(
            "reading Parquet needs the package pyarrow, which is absent", file=folder / name
        ) from None
    try:
        table = parquet.read_table(BytesIO(content))
    except Exception as error:  # whatever pyarrow raises on a damaged file
        raise CalibrationError(f"this is no Parquet file: {error}", file=folder / name) from None
    del content
    columns: dict[str, list[Any]] = {}
    for label in table.column_names:
        column_name, dot, _ = label.partition(".")
        values = _values(table.column(label))
        if not dot:
            columns[column_name] = values
        else:
            columns.setdefault(column_name, []).append("".join(values) if column_name == SIGN_COLUMN else values)
    return columns


def _values(column: Any) -> list[Any]:
    """The values of a column; those of text share their words, of which a long table has few."""
    import pyarrow as pa

    if not pa.types.is_string(column.type):
        return column.to_pylist()
    coded = column.combine_chunks().dictionary_encode()
    values = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
    return values[coded.indices.fill_null(len(values) - 1).to_numpy()].tolist()


URDF_NAME, JSON_NAME, REPORT_NAME = "calibrated.urdf", "calibration.json", "report.html"
ORIGINS_NAME = "joint_origins.yaml"
NOT_ONE = "not a calibration folder: "
SIGNATURE_NAME = "signature.json"
NAMES = (URDF_NAME, ORIGINS_NAME, JSON_NAME, REPORT_NAME)
MOVING_FILES = (URDF_NAME, ORIGINS_NAME)
"""By which robots move: looked at whenever a folder is opened."""
NO_SEAL = "calibration.json has no seal"


@dataclass(frozen=True, repr=False)
class Saved:
    """A calibration folder as read, once.

    Attributes
    ----------
    folder : Path
    record : Record
        Content of ``calibration.json``.
    urdf : bytes
        Content of ``calibrated.urdf``.
    """

    folder: Path
    record: Record
    urdf: bytes

    def __repr__(self) -> str:
        return f"<Saved {self.folder}: {self.record!r}>"


def write(folder: str | Path, record: Record, urdf_bytes: bytes, report: str) -> None:
    """Write a calibration folder: all its files, or none; what `read` would refuse is not written.

    Parameters
    ----------
    folder : str or Path
        Made if absent; other files in it are left alone.
    record : Record
    urdf_bytes : bytes
        The corrected URDF.
    report : str
        The page for people.

    Raises
    ------
    CalibrationError
        If the folder cannot be written, or could not be read again.
    """
    document, tables = without_tables(record)
    files = {
        URDF_NAME: urdf_bytes,
        ORIGINS_NAME: joint_origins.to_yaml(record).encode("utf-8"),
        REPORT_NAME: report.encode("utf-8"),
        **tables,
    }
    files[JSON_NAME] = _text(integrity.sealed(document, integrity.hashes(files)))
    _refuse_unreadable(files, Path(folder))
    write_together(folder, files)
    for name in {*TABLE_FILES.values(), SIGNATURE_NAME} - set(files):  # of a calibration that was here before
        (Path(folder) / name).unlink(missing_ok=True)


def with_page(folder: str | Path, page: bytes) -> dict[str, bytes]:
    """The files to write for a new ``report.html``: the page, and ``calibration.json`` whose seal lists it.

    Raises
    ------
    CalibrationError
        As `read`: what was changed is not sealed again.
    """
    read(folder)
    content = _read(folder_of(folder))[1]
    listed = content[integrity.KEY]["files"] | integrity.hashes({REPORT_NAME: page})
    return {REPORT_NAME: page, JSON_NAME: _text(integrity.sealed(content, listed))}


def _refuse_unreadable(files: Mapping[str, bytes], folder: Path) -> None:
    """Read files as they would stand in a folder; an earlier calibration there is still whole."""
    with TemporaryDirectory(prefix="irbcal-") as draft:
        for name, content in files.items():
            (Path(draft) / name).write_bytes(content)
        try:
            read(draft)
        except CalibrationError as error:
            reason = str(error).removeprefix(f"{error.file}: ")
            raise CalibrationError(
                f"not written, because no command could open it: {reason}", file=folder, parameter=error.parameter
            ) from None


def _text(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode("utf-8")


def folder_of(path: str | os.PathLike[str]) -> Path:
    """The folder that is meant by a path: of its ``calibration.json``, too."""
    path = Path(path)
    return path.parent if path.name == JSON_NAME and not path.is_dir() else path


def read(folder: str | Path) -> Saved:
    """Read a calibration folder.

    Parameters
    ----------
    folder : str or Path
        The folder, or the ``calibration.json`` in it.

    Raises
    ------
    CalibrationError
        If a file is missing or damaged, a number is absurd, or what robots move by is not as irbcal sealed it.
    """
    folder = folder_of(folder)
    recover(folder)
    saved, content = _read(folder)
    moving = [name for name in MOVING_FILES if os.path.lexists(folder / name)]
    if _changed_files(folder, saved.record, moving):
        recover(folder)  # somebody is writing it just now: the lock waits until all files are new
        saved, content = _read(folder)
    if saved.record.seal is None:
        raise CalibrationError(
            f"{NO_SEAL}: a file of unknown origin must not move a robot (irbcal verify FOLDER --reseal WHY seals it)",
            file=folder / JSON_NAME,
        )
    changed = [*integrity.broken(content), *_changed_files(folder, saved.record, moving)]
    if changed:
        raise CalibrationError(
            f"{', '.join(changed)} {'was' if len(changed) == 1 else 'were'} changed after irbcal wrote it: a damaged "
            "file must not move a robot (irbcal verify FOLDER tells more, --reseal accepts a deliberate change)",
            file=folder / JSON_NAME,
        )
    against = _contradictions(saved)  # a seal can be renewed by whoever can write the file
    if against:
        raise CalibrationError("; ".join(against), file=folder / JSON_NAME)
    return saved


def contents(folder: str | Path) -> tuple[tuple[str, bytes], ...] | None:
    """Names and bytes of all files that `read` looks at; None where one of them cannot be read.

    Folders with equal contents give the same calibration.
    """
    folder = folder_of(folder)
    recover(folder)
    names = [name for name in (JSON_NAME, URDF_NAME, ORIGINS_NAME, *TABLE_FILES.values()) if (folder / name).exists()]
    try:
        return tuple((name, read_bytes(folder / name, CalibrationError)) for name in names)
    except CalibrationError:
        return None


@dataclass(frozen=True)
class FolderCheck:
    """What `checked` finds in a calibration folder.

    Attributes
    ----------
    record : Record
    differences : tuple of str
        What is not as it was written, or contradicts itself: a part of a sentence each.
    files : tuple of str
        Those that are as they were written.
    unlisted : tuple of str
        Files in the folder that the seal does not list: nothing is known of them.
    """

    record: Record
    differences: tuple[str, ...]
    files: tuple[str, ...]
    unlisted: tuple[str, ...]


def checked(folder: str | Path) -> FolderCheck:
    """Look at every part and every file of a calibration folder.

    Raises
    ------
    CalibrationError
        If it is no calibration folder.
    """
    folder = folder_of(folder)
    saved, content = _read(folder)
    section = saved.record.seal
    if section is None:
        differences, listed, changed = [NO_SEAL], {}, {}
    else:
        listed = section.files
        changed = _changed_files(folder, saved.record, dict.fromkeys((*listed, *MOVING_FILES)))
        differences = [f"{name} was changed after it was written" for name in integrity.broken(content)]
        differences += [f"{name} {how}" for name, how in changed.items()]
    return FolderCheck(
        saved.record,
        (*differences, *_contradictions(saved)),
        tuple(name for name in (JSON_NAME, *listed) if name not in changed),
        _unlisted(folder, listed),
    )


def _unlisted(folder: Path, listed: Iterable[str]) -> tuple[str, ...]:
    """Files in a folder that a seal does not list."""
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    return tuple(name for name in names if name not in {JSON_NAME, SIGNATURE_NAME, *listed})


def _contradictions(saved: Saved) -> list[str]:
    try:
        origins = read_bytes(saved.folder / ORIGINS_NAME, CalibrationError)
    except CalibrationError:
        origins = None
    return contradictions(saved.record, saved.urdf, origins)


def _changed_files(folder: Path, record: Record, names: Iterable[str]) -> dict[str, str]:
    """Files that are not as the seal lists them, with what is wrong."""
    listed = {} if record.seal is None else record.seal.files
    changes = {}
    for name in names:
        if name not in listed:
            changes[name] = "is not listed in the seal"
            continue
        try:
            content = read_bytes(folder / name, CalibrationError)
        except CalibrationError:
            changes[name] = "cannot be read" if os.path.lexists(folder / name) else "is missing"
            continue
        if hashlib.sha256(content).hexdigest() != listed[name]:
            changes[name] = "was changed after it was written"
    return changes


def reseal(folder: str | Path, reason: str) -> FolderCheck:
    """Accept deliberate changes of a ``calibration.json``.

    Parameters
    ----------
    folder : str or Path
    reason : str
        One line for its history.

    Returns
    -------
    FolderCheck
        Of the folder as it is written; it is not read again.

    Raises
    ------
    CalibrationError
        If there is nothing to accept, or what it says now contradicts itself.
    """
    folder = folder_of(folder)
    saved, content = _read(folder)
    against = _contradictions(saved)
    if against:
        raise CalibrationError(f"this cannot be accepted: {'; '.join(against)}", file=folder / JSON_NAME)
    names = {*NAMES, *TABLE_FILES.values()} - {JSON_NAME}
    files = {name: read_bytes(folder / name, CalibrationError) for name in names if (folder / name).is_file()}
    document = integrity.resealed(content, integrity.hashes(files), comment(reason))
    write_together(folder, {JSON_NAME: _text(document)})
    sealed = saved.record.model_copy(update={integrity.KEY: Seal.model_validate(document[integrity.KEY])})
    return FolderCheck(sealed, (), (JSON_NAME, *sorted(files)), _unlisted(folder, files))


def _read(folder: Path) -> tuple[Saved, dict[str, Any]]:
    """A folder as it is, and the content of its ``calibration.json`` as JSON has it."""
    json_path, urdf_path = folder / JSON_NAME, folder / URDF_NAME
    try:
        data = read_bytes(json_path, CalibrationError, prefix=NOT_ONE)
        content, large = _content(data)
        record = Record.model_validate(with_tables(content, folder)) if large else Record.model_validate_json(data)
        urdf_bytes = read_bytes(urdf_path, CalibrationError, prefix=NOT_ONE)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(key) for key in first["loc"]) or "the file"
        raise CalibrationError(f"{where}: {first['msg']}", file=json_path, parameter=where) from None
    tables = {name: dict(getattr(record, name)) for name in TABLE_FILES}
    refuse_absurd(record.model_dump(exclude={integrity.KEY, *TABLE_FILES}) | tables, json_path)
    return Saved(folder, record, urdf_bytes), content


def _content(data: bytes) -> tuple[dict[str, Any], bool]:
    """A ``calibration.json`` as JSON has it, and whether it has tables beside it."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return {}, False
    return content, _beside(content)
