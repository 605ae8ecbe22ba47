"""Refusing to write over what a command reads, over its own other outputs, and over an earlier calibration."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

from irbcal.errors import CalibrationError, OptionError

Paths: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str] | None] | None"
"""One path, several, or none."""


FOLDER_FILES = (
    "calibrated.urdf",
    "joint_origins.yaml",
    "calibration.json",
    "calibration.points.parquet",
    "calibration.poses.parquet",
    "report.html",
    "plan.csv",
    "poses.csv",
    "plan.json",
    "plan.mod",
    "plan.src",
    "plan.ls",
    "plan.script",
    "plan.pjx",
    "plan.dtx",
    "start.pgx",
    "PLAN.JBI",
    "plan.pg",
    "plan.html",
)
"""Files that commands write into folders that they are given."""


def refuse_overwriting(outputs: Mapping[str, Paths], *inputs: object) -> None:
    """Refuse outputs that are inputs, or each other, by whatever name: links and hard links are the same file.

    Parameters
    ----------
    outputs : dict of str to path or paths
        By the options that name them; a folder stands for `FOLDER_FILES` in it.
    *inputs
        What is read: paths, sequences of them, folders (with `FOLDER_FILES` in them); anything else, such as a table
        in memory or None, is no file.

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
    read = [file for value in inputs for path in _paths(value) for file in _files(path)]
    for option, path in outputs_by_option:
        for written in _files(path):
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
            "there is a calibration in this folder already: name another folder, or replace it with --force",
            file=folder,
            parameter="out",
        )


def _paths(value: object) -> list[Path]:
    if isinstance(value, (str, os.PathLike)):
        return [Path(value)]
    if isinstance(value, (list, tuple, set, frozenset)):
        return [path for item in value for path in _paths(item)]
    return []


def _files(path: Path) -> list[Path]:
    return [path / name for name in FOLDER_FILES] if os.path.isdir(path) else [path]


def _same(first: Path, second: Path) -> bool:
    """Whether two names are one file that exists."""
    try:
        return os.path.samefile(first, second)
    except (OSError, ValueError):
        return False
