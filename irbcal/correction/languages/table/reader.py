"""Programs as CSV: one target in each row, joints or poses of the tip in the base link.

The columns are those of the arm's joints, such as ``q1_deg`` … ``q6_deg``, or ``x_mm``, ``y_mm``, ``z_mm``, ``qw``,
``qx``, ``qy``, ``qz``; their order is free and all other columns are kept. Joints with a column ``time_s`` are one
motion (`irbcal.correction.languages.table.timed`). A corrected file bears a column
``irbcal_filtered`` with the fingerprint of the calibration. Errors name the file, the row (line of the file, the header
being line 1) and the column.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.languages.table import timed
from irbcal.correction.languages.table.program import MARK, TableProgram
from irbcal.correction.notation import QUATERNION_TOLERANCE, poses_from_numbers
from irbcal.correction.program import Given, Kind, read_bytes
from irbcal.errors import MeasurementError, OptionError, ProgramError
from irbcal.measurement import plain_csv
from irbcal.measurement.columns import (
    JOINTS,
    POSITION,
    QUATERNION,
    check_header,
    expected_joint,
    joint_units,
    listed,
    numbers,
    parse_csv,
)
from irbcal.modeling.arm import Arm

if TYPE_CHECKING:
    import pandas as pd

POSE = [*POSITION, *QUATERNION]
"""Columns of poses."""

LARGEST = 1e9
"""Numbers beyond (9E9, …) stand for no place that a robot could reach."""


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a CSV program: its header names joints or positions."""
    header = data[:4096].splitlines()[:1]
    return bool(header) and (b"q1_" in header[0] or b"x_mm" in header[0]) and b"," in header[0]


def read_for(arm: Arm, files: Sequence[Path], given: Given) -> list[TableProgram]:
    """Read CSV programs for an arm; see `irbcal.correction.languages.Language`."""
    for parameter, frames in (("tool", given.tools), ("wobj", given.work_objects)):
        if frames:
            message = "the poses of a CSV program are those of the tip in the base link: there is no frame to give"
            raise OptionError(f"{parameter}: {message}", file=files[0], parameter=parameter)
    programs = [read(path, arm.joint_columns) for path in files]
    return [timed.along_time(one, arm) if timed.has_times(one) else one for one in programs]


def read(path: str | Path, joints: Sequence[str] = JOINTS) -> TableProgram:
    """Read a CSV program from a file; see `parse`."""
    return parse(read_bytes(path), str(path), joints)


def parse(data: bytes, source: str = "program", joints: Sequence[str] = JOINTS) -> TableProgram:
    """Read a CSV program.

    Parameters
    ----------
    data : bytes
        UTF-8 text with commas.
    source : str
        File name for messages.
    joints : sequence of str
        Columns of the arm's joints, ``arm.joint_columns``.

    Returns
    -------
    TableProgram

    Raises
    ------
    ProgramError
        If it does not keep the format.
    """
    try:
        table = parse_csv(data, source, typed=lambda name: False)
        kind, columns = _kind(list(table.columns), source, joints)
        if table.empty:
            raise ProgramError("the file has a header but no rows", file=source)
        written = np.column_stack([_column(table, name, source) for name in columns])
    except MeasurementError as error:
        _refuse(error)
    _check_size(written, columns, table, source)
    if kind == "pose":
        _check_quaternions(written[:, 3:], table.index, source)
    return TableProgram(
        source=source,
        kind=kind,
        columns=columns,
        values=poses_from_numbers(written) if kind == "pose" else written * joint_units(columns),
        rows=table.index.to_numpy(),
        data=data,
        table=table,
        newline="\r\n" if b"\r\n" in data else "\n",
        byte_order_mark=data.startswith(b"\xef\xbb\xbf"),
        fingerprint=_mark_of(table),
    )


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the column that marks a corrected file; None without mark.

    Raises
    ------
    ProgramError
        If this is no CSV file.
    """
    try:
        return _mark_of(parse_csv(data, source))
    except MeasurementError as error:
        _refuse(error)


def _refuse(error: MeasurementError) -> NoReturn:
    """What the reader of measurements refuses is refused as a program, in the same words."""
    refusal = ProgramError(str(error))
    refusal.file, refusal.row, refusal.column = error.file, error.row, error.column
    raise refusal from None


def _mark_of(table: pd.DataFrame) -> str | None:
    marks = [str(mark).strip() for mark in table[MARK].unique() if mark.strip()] if MARK in table.columns else []
    return marks[0] if marks else None


def _kind(names: Sequence[str], source: str, joints: Sequence[str]) -> tuple[Kind, tuple[str, ...]]:
    """Joints or poses and their columns, from the header."""
    kinds: dict[Kind, tuple[str, ...]] = {"joint": tuple(joints), "pose": tuple(POSE)}
    complete = {kind: all(name in names for name in columns) for kind, columns in kinds.items()}
    if all(complete.values()):
        raise ProgramError("expected columns of joints or of poses, found both", file=source, row=1)
    for kind, all_there in complete.items():
        if all_there:
            return kind, kinds[kind]
    for columns in kinds.values():
        metric = [name.replace("_deg", "_rad").replace("_mm", "_m") for name in columns]
        if any(name in names for name in (*columns, *metric)):
            check_header(names, columns, source)
    expected = f"columns {joints[0]} … {joints[-1]} (joints) or {', '.join(POSE)} (poses)"
    raise ProgramError(f"expected {expected}, found {listed(names)}", file=source, row=1)


def _column(table: pd.DataFrame, name: str, source: str) -> FloatArray:
    """Numbers of a column; what is not a plain number is refused by the reader of measurements, in its words."""
    values = plain_csv.floats(table[name])
    if values is not None and np.isfinite(values).all():
        return values
    cells = table[name].to_numpy(dtype=object)
    text = "".join(cells)
    if text.isascii() and "_" not in text:  # float() would take 1_0, and digits of other scripts
        try:
            values = cells.astype(float)
        except ValueError:
            values = np.array([np.nan])
        if np.isfinite(values).all():
            return values
    return numbers(table, name, source, _expected(name))


def _expected(name: str) -> str:
    if name in POSITION:
        return "a position in mm"
    if name in QUATERNION:
        return "a component of a quaternion"
    return expected_joint(name)


def _check_size(written: FloatArray, names: Sequence[str], table: pd.DataFrame, source: str) -> None:
    bad = np.abs(written) > LARGEST
    if bad.any():
        row, column = np.argwhere(bad)[0]
        name = names[column]
        found = repr(table[name].iloc[row].strip())
        message = f"expected a number up to {LARGEST:g}, found {found}"
        raise ProgramError(message, file=source, row=int(table.index[row]), column=name)


def _check_quaternions(quaternions: FloatArray, lines: Sequence[int], source: str) -> None:
    bad = np.abs(np.linalg.norm(quaternions, axis=1) - 1) > QUATERNION_TOLERANCE
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        found = ", ".join(f"{value:g}" for value in quaternions[k])
        message = f"expected a unit quaternion, found {found}"
        raise ProgramError(message, file=source, row=int(lines[k]), column=QUATERNION)
