"""Programs as CSV: one target in each row, joints or poses of the tip in the base link.

The columns are those of the arm's joints, such as ``q1_deg`` … ``q6_deg``, or ``x_mm``, ``y_mm``, ``z_mm``, ``qw``,
``qx``, ``qy``, ``qz``; their order is free and all other columns are kept. A corrected file bears a column
``irbcal_filtered`` with the fingerprint of the calibration. Errors name the file, the row (line of the file, the header
being line 1) and the column.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from irbcal.correction.program import (
    DECIMALS,
    QUATERNION_DECIMALS,
    QUATERNION_TOLERANCE,
    numbers_from_poses,
    poses_from_numbers,
    read_bytes,
)
from irbcal.errors import MeasurementError, ProgramError
from irbcal.measurement import columns as readers
from irbcal.measurement.columns import JOINTS, POSITION, QUATERNION
from irbcal.units import DEG, MM

POSE = [*POSITION, *QUATERNION]
MARK = "irbcal_filtered"
"""Name of the column that marks a corrected file."""

LARGEST = 1e9
"""Numbers beyond (9E9, …) stand for no place that a robot could reach."""


@dataclass(frozen=True, eq=False)
class TableProgram:
    """A CSV program as read.

    Attributes
    ----------
    source : str
        File name for messages.
    kind : str
        ``joint`` or ``pose``.
    columns : list of str
        Names of the columns with the numbers.
    values : ndarray, shape (n, joints) or (n, 4, 4)
        Joints in radians (metres for prismatic joints), or ``T_base_tip`` in metres; locked.
    rows : ndarray of int, shape (n,)
        Lines in the file.
    table : DataFrame
        All columns in the text of the file.
    newline : str
        Line end of the file.
    byte_order_mark : bool
        Whether the file begins with one.
    fingerprint : str or None
        Of the calibration that this program was already corrected with.
    """

    source: str
    kind: str
    columns: list
    values: np.ndarray
    rows: np.ndarray
    table: pd.DataFrame
    newline: str
    byte_order_mark: bool
    fingerprint: str | None


def read(path, joints=JOINTS):
    """Read a CSV program from a file; see `parse`."""
    return parse(read_bytes(path), str(path), joints)


def parse(data, source="program", joints=JOINTS):
    """Read a CSV program.

    Parameters
    ----------
    data : bytes
        UTF-8 text with commas.
    source : str
        File name for messages.
    joints : list of str
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
        table = readers.parse_csv(data, source)
        kind, columns = _kind(list(table.columns), source, joints)
        if table.empty:
            raise ProgramError(f"{source}: the file has a header but no rows")
        numbers = np.column_stack([_column(table, name, source) for name in columns])
    except MeasurementError as error:
        raise ProgramError(str(error)) from None
    _check_size(numbers, columns, table, source)
    if kind == "pose":
        _check_quaternions(numbers[:, 3:], table.index, source)
        values = poses_from_numbers(numbers)
    else:
        values = numbers * _units(columns)
    values.setflags(write=False)
    marks = [mark for mark in table[MARK].unique() if mark.strip()] if MARK in table.columns else []
    return TableProgram(
        source=source,
        kind=kind,
        columns=columns,
        values=values,
        rows=table.index.to_numpy(),
        table=table,
        newline="\r\n" if b"\r\n" in data else "\n",
        byte_order_mark=data.startswith(b"\xef\xbb\xbf"),
        fingerprint=marks[0].strip() if marks else None,
    )


def with_values(program, values, fingerprint=None, rows=None):
    """Bytes of the program with new values; all other columns keep their text.

    Parameters
    ----------
    program : TableProgram
    values : ndarray, shape (n, joints) or (n, 4, 4)
        Joints in radians (metres for prismatic joints), or ``T_base_tip`` in metres.
    fingerprint : str, optional
        Of the calibration, for the column that marks a corrected file; without it there is none.
    rows : ndarray of bool, shape (n,), optional
        Rows that get their new values, the others keep their text (their new values may be NaN) and get no mark;
        all by default.

    Returns
    -------
    bytes

    Raises
    ------
    ValueError
        If a value is not finite, not rigid or of the wrong shape.
    """
    values = np.asarray(values, dtype=float)
    n = len(program.table)
    rows = np.ones(n, dtype=bool) if rows is None else np.asarray(rows, dtype=bool)
    if values.shape != program.values.shape or rows.shape != (n,) or not np.isfinite(values[rows]).all():
        raise ValueError(f"expected finite values of shape {program.values.shape}")
    if program.kind == "pose":
        near = np.column_stack([_column(program.table, name, program.source) for name in QUATERNION])
        numbers = numbers_from_poses(values[rows], near[rows])
    else:
        numbers = values[rows] / _units(program.columns)
    decimals = [QUATERNION_DECIMALS if name in QUATERNION else DECIMALS for name in program.columns]
    new = dict(zip(program.columns, zip(numbers.T, decimals, strict=True), strict=True))
    cells, formats, names = [], [], []
    for name in program.table.columns:
        names.append(_quoted(np.array([name], dtype=object))[0])
        if name == MARK and fingerprint is not None:
            names.pop()
        elif name not in new:
            cells.append(_quoted(program.table[name].to_numpy(dtype=object)))
            formats.append("%s")
        elif rows.all():
            column, decimals = new[name]
            cells.append((np.round(column, decimals) + 0.0).astype(object))  # + 0.0: no negative zero
            formats.append(f"%.{decimals}f")
        else:
            column, decimals = new[name]
            text = program.table[name].to_numpy(dtype=object, copy=True)
            text[rows] = [f"{value:.{decimals}f}" for value in (np.round(column, decimals) + 0.0).tolist()]
            cells.append(_quoted(text))
            formats.append("%s")
    if fingerprint is not None:
        names.append(MARK)
        cells.append(_quoted(np.where(rows, fingerprint, "").astype(object)))
        formats.append("%s")
    flat = np.empty((n, len(cells)), dtype=object)
    for k, column in enumerate(cells):
        flat[:, k] = column
    body = (",".join(formats) + program.newline) * n % tuple(flat.ravel())
    text = ",".join(names) + program.newline + body
    return text.encode("utf-8-sig" if program.byte_order_mark else "utf-8")


def _units(columns):
    return np.array([MM if name.endswith("_mm") else DEG for name in columns])


def _kind(names, source, joints):
    """Joints or poses and their columns, from the header."""
    kinds = {"joint": list(joints), "pose": POSE}
    complete = {kind: all(name in names for name in columns) for kind, columns in kinds.items()}
    if all(complete.values()):
        raise ProgramError(f"{source}: row 1: expected columns of joints or of poses, found both")
    for kind, found in complete.items():
        if found:
            return kind, kinds[kind]
    for columns in kinds.values():
        metric = [name.replace("_deg", "_rad").replace("_mm", "_m") for name in columns]
        if any(name in names for name in (*columns, *metric)):
            readers.check_header(names, columns, source)
    found = ", ".join(name if len(name) < 40 else name[:40] + "…" for name in names[:40])
    raise ProgramError(
        f"{source}: row 1: expected columns {joints[0]} … {joints[-1]} (joints) or x_mm, y_mm, z_mm, qw, qx, qy, qz "
        f"(poses), found {found}"
    )


def _column(table, name, source):
    """Numbers of a column; what is not a plain number is refused by the reader of measurements, in its words."""
    cells = table[name].to_numpy(dtype=object)
    text = "".join(cells)
    if text.isascii() and "_" not in text:  # float() would take 1_0, and digits of other scripts
        try:
            values = cells.astype(float)
        except ValueError:
            values = np.array([np.nan])
        if np.isfinite(values).all():
            return values
    return readers.numbers(table, name, source, _expected(name))


def _expected(name):
    if name in POSITION:
        return "a position in mm"
    if name in QUATERNION:
        return "a component of a quaternion"
    return "a joint's travel in mm" if name.endswith("_mm") else "a joint angle in degrees"


def _check_size(numbers, names, table, source):
    bad = np.abs(numbers) > LARGEST
    if bad.any():
        row, column = np.argwhere(bad)[0]
        name, line = names[column], table.index[row]
        found = repr(table[name].iloc[row].strip())
        raise ProgramError(f"{source}: row {line}, column {name}: expected a number up to {LARGEST:g}, found {found}")


def _check_quaternions(quaternions, lines, source):
    bad = np.abs(np.linalg.norm(quaternions, axis=1) - 1) > QUATERNION_TOLERANCE
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        found = ", ".join(f"{value:g}" for value in quaternions[k])
        raise ProgramError(
            f"{source}: row {lines[k]}, columns qw, qx, qy, qz: expected a unit quaternion, found {found}"
        )


def _quoted(cells):
    """Cells with the quotation marks that CSV asks for."""
    joined = "\x00".join(cells)
    if not any(char in joined for char in ',"\r\n'):
        return cells
    return np.array(
        ['"' + cell.replace('"', '""') + '"' if any(char in cell for char in ',"\r\n') else cell for cell in cells],
        dtype=object,
    )
