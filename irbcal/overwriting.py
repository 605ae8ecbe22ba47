"""What may be written over: no input; no earlier calibration and no file of others unless that is asked for."""

from __future__ import annotations

import csv
import filecmp
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeAlias

from irbcal.errors import CalibrationError, OptionError

Paths: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str] | None] | None"
"""One path, several, or none."""


CALIBRATION_FILES = (
    *("calibrated.urdf", "joint_origins.yaml", "calibration.json", "calibration.points.npz", "calibration.poses.npz"),
    "report.html",
)
PLAN_FILES = (
    *("plan.csv", "poses.csv", "plan.json", "plan.html"),
    *("plan.mod", "plan.src", "plan.ls", "plan.script", "plan.pjx", "plan.dtx", "start.pgx", "PLAN.JBI", "plan.pg"),
)
FOLDER_FILES = (*CALIBRATION_FILES, *PLAN_FILES)
"""Files that commands write into folders that they are given."""
WRITTEN_BY: dict[str, tuple[str, ...]] = {"plan": PLAN_FILES, "export": ()}
"""Of these commands those that may be inputs; export looks at all that it writes by itself."""
MARK = b"irbcal"
"""Stands in what irbcal writes, but for tables."""
TYPED, READINGS = re.compile(r"q\d+_\w+|[xyz]_mm|value_\w+|feature|frame"), re.compile(r"[xyz]_mm|value_\w+")
"""Columns of tables that are written by hand, and those of them that are filled in when it is measured."""
OPTIONAL = {"payload_kg"}
"""Columns that irbcal writes into its tables where a load is named."""
COMPUTED = re.compile(r"expected_|\w+_before|nominal_|calibrated_|wait_s")
"""Beginnings of columns in tables that irbcal alone writes, whatever others they have."""
NOT_SIMULATED = ("", "no", "0", "false", "nan")
"""Cells of a column ``simulated`` in rows that were measured."""
LONGEST_LOOK = 1_000_000
"""Bytes at the beginning and at the end of a file in which its mark is looked for."""
REPLACING: ContextVar[bool] = ContextVar("replacing", default=False)
"""Whether ``--force`` was given."""


def refuse_overwriting(outputs: Mapping[str, Paths], *inputs: object, command: str | None = None) -> None:
    """Refuse outputs that are inputs, or each other, by whatever name: links and hard links are the same file.

    Parameters
    ----------
    outputs : dict of str to path or paths
        By the options that name them; a folder stands for `FOLDER_FILES` in it.
    *inputs
        What is read: paths, sequences of them, folders (with `FOLDER_FILES` in them); anything else, such as a table
        in memory or None, is no file.
    command : str, optional
        What writes: of those in `WRITTEN_BY` it is known which files of a folder it writes, and that it reads those of
        calibrations.

    Raises
    ------
    OptionError
        If two outputs are the same file.
    CalibrationError
        If an output is an input.
    """
    outputs_by_option = [(option, path) for option, paths in outputs.items() for path in _paths(paths)]
    option_of: dict[str, str] = {}
    for option, path in outputs_by_option:
        real = os.path.realpath(path)
        if not os.path.isdir(path) and option_of.setdefault(real, option) != option:
            raise OptionError(
                f"{option}: expected another file than that of {option_of[real]}, found {path}", parameter=option
            )
    names_written = WRITTEN_BY.get(command or "", FOLDER_FILES)
    names_read = FOLDER_FILES if names_written is FOLDER_FILES else CALIBRATION_FILES
    read = [file for value in inputs for path in _paths(value) for file in _files(path, names_read)]
    for option, path in outputs_by_option:
        for written in _files(path, names_written):
            if any(_same(written, file) for file in read):
                raise CalibrationError(
                    "this is the file to read from: name another one to write", file=written, parameter=option
                )


def refuse_replacing(folder: Path, force: bool = False) -> None:
    """Refuse a folder that holds a calibration already: what moves a robot today must not be gone by one slip.

    Parameters
    ----------
    folder : Path
        That a calibration will be written to.
    force : bool
        Replace it all the same.

    Raises
    ------
    CalibrationError
        If there is one, and it is not to be replaced.
    """
    if not force and os.path.lexists(folder / "calibration.json"):
        raise CalibrationError(
            "there is a calibration in this folder already: name another folder, or replace it with --force "
            "(in Python overwrite=True)",
            file=folder,
            parameter="out",
        )


def _paths(value: object) -> list[Path]:
    if isinstance(value, (str, os.PathLike)):
        return [Path(value)]
    if isinstance(value, (list, tuple, set, frozenset)):
        return [path for item in value for path in _paths(item)]
    return []


def _files(path: Path, names: Sequence[str]) -> list[Path]:
    return [path / name for name in names] if os.path.isdir(path) else [path]


def _same(first: Path, second: Path) -> bool:
    """Whether two names are one file that exists."""
    try:
        return os.path.samefile(first, second)
    except (OSError, ValueError):
        return False


@contextmanager
def replacing(force: bool = True) -> Iterator[None]:
    """Let files be replaced that irbcal did not write: what ``--force`` does."""
    token = REPLACING.set(force)
    try:
        yield
    finally:
        REPLACING.reset(token)


def may_replace(path: Path, other: Path) -> bool:
    """Whether a file is as irbcal writes it where it writes the other one; see `irbcal.safe_files.write_set`."""
    if path.stat().st_size == 0 or filecmp.cmp(path, other, shallow=False):
        return True
    old, new = _ends(path), _ends(other)
    if MARK in old and MARK in new:
        return True
    columns = [content.partition(b"\n")[0].decode("utf-8", "replace").strip().split(",") for content in (old, new)]
    if all("simulated" in names for names in columns) and _is_simulated(path) and _is_simulated(other):
        return True
    if path.suffix.lower() != ".csv":
        return False
    if any(map(COMPUTED.match, columns[0])):
        return {*columns[0]} - OPTIONAL <= {*columns[1]}
    if columns[0] != columns[1]:
        return False
    if not any(map(TYPED.fullmatch, columns[1])):
        return True
    readings = {*filter(READINGS.fullmatch, columns[1])}
    filled = _filled(path)
    return bool(readings) and not readings & filled and filled <= _filled(other)


def _filled(table: Path) -> set[str]:
    """Columns with a value in any row; cells beyond the header are a column without a name."""
    return {name for row in _rows(table) for name, value in row.items() if value}


def _is_simulated(table: Path) -> bool:
    """Whether every row says so."""
    return not any((row.get("simulated") or "").lower() in NOT_SIMULATED for row in _rows(table))


def _rows(table: Path) -> Iterator[dict[str, Any]]:
    """Rows of a CSV file; where it is none, a row that irbcal does not write."""
    with open(table, encoding="utf-8", errors="replace", newline="") as file:
        try:
            yield from csv.DictReader(file, restkey="")
        except csv.Error:
            yield {"": "no table"}


def _ends(path: Path) -> bytes:
    """The content of a file, of a long one its beginning and its end."""
    with open(path, "rb") as file:
        start = file.read(LONGEST_LOOK)
        file.seek(max(len(start), os.fstat(file.fileno()).st_size - LONGEST_LOOK))
        return start + file.read()
