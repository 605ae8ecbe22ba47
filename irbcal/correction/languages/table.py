"""Programs as CSV or Parquet: one target in each row, joints or poses of the tip in the base link.

The columns are those of the arm's joints, such as ``q1_deg`` … ``q6_deg`` (or ``q1_rad`` …), or ``x_mm``, ``y_mm``,
``z_mm``, ``qw``, ``qx``, ``qy``, ``qz``; their order is free and all other columns are kept. Joints with a column
``time_s`` are one motion (`irbcal.correction.languages.table`). A corrected file bears a column
``irbcal_filtered`` with the fingerprint of the calibration. Errors name the file, the row (of CSV the line of the file,
the header being line 1) and the column.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.correction.language import Language
from irbcal.correction.loads import Load
from irbcal.correction.notation import (
    DECIMALS,
    QUATERNION_DECIMALS,
    numbers_from_poses,
)
from irbcal.correction.program import (
    ControllerSetup,
    Corrections,
    Note,
    Program,
    Stop,
    TargetKind,
    WantedTargets,
    read_bytes,
)
from irbcal.errors import MeasurementError, OptionError, ProgramError, RobotError
from irbcal.measurement.column_names import (
    JOINTS,
    POSE,
    QUATERNION,
    check_header,
    joint_units,
    listed,
)
from irbcal.measurement.input_table import InputTable
from irbcal.measurement.table_columns import cells_of_csv, parse_parquet
from irbcal.modeling.arm import Arm
from irbcal.modeling.coupling import from_controller, to_controller
from irbcal.modeling.trajectory import ENDS, Trajectory
from irbcal.units import DEG

MARK = "irbcal_filtered"
"""Name of the column that marks a corrected file."""
PARQUET = b"PAR1"
"""What a Parquet file begins with."""


@dataclass(frozen=True, eq=False, repr=False)
class TableProgram(Locked, Program):
    """A CSV or Parquet program as read."""

    source: str
    """File name for messages."""
    kind: TargetKind
    """``joint`` or ``pose``."""
    columns: tuple[str, ...]
    """Names of the columns with the numbers."""
    values: FloatArray
    """Shape (n, joints) or (n, 4, 4). Joints in radians (metres for prismatic joints), or ``T_base_tip`` in metres;
    locked.
    """
    rows: IntArray
    """Shape (n,). Lines in the file."""
    data: bytes
    """The file."""
    table: InputTable
    """All columns in the text of the file; of Parquet those with the numbers as such."""
    newline: str
    """Line end of the file."""
    byte_order_mark: bool
    """Whether the file begins with one."""
    fingerprint: str | None
    """Of the calibration that this program was already corrected with."""
    notes: tuple[Note, ...]
    """None."""
    coupling: FloatArray | None = field(default=None, kw_only=True)
    """Shape (joints, joints). How the controller counts joints, see `irbcal.modeling.coupling`."""

    def wanted_targets(self) -> list[WantedTargets]:
        """All rows."""
        names = tuple(f"row {row}" for row in self.rows.tolist())
        values = from_controller(self.values, self.coupling) if self.kind == "joint" else self.values
        return [WantedTargets(self.kind, np.arange(len(names)), names, self.rows, values, loads=self._loads())]

    def _loads(self) -> tuple[tuple[Load], ...]:
        """What each row says that the robot carries (``payload_kg``, ``payload_x_mm`` …); empty where none does."""
        try:
            inputs = self.table.inputs(len(self.columns))
        except MeasurementError as error:
            _refuse(error)
        if "payload_kg" not in inputs:
            return ()
        centres = inputs["payload_centre"].tolist() if "payload_centre" in inputs else [None] * len(self.table)
        loads = zip(inputs["payload_kg"].tolist(), centres, strict=True)
        return tuple((Load(mass, at and tuple(at)),) for mass, at in loads)

    def stops(self) -> list[Stop]:
        """A row a stop, in the order of the file."""
        return [Stop(row, k, k - 1 if k else None) for k, row in enumerate(self.rows.tolist())]

    def with_fake_targets(self, corrections: Corrections, fingerprint: str | None) -> dict[str, bytes]:
        """The table with the joints or poses of the rows that are corrected, marked in a column."""
        ((_, fake),) = corrections
        values = to_controller(fake.q, self.coupling) if self.kind == "joint" else fake.T_fake
        return {self.source: with_values(self, values, fingerprint, fake.ok) if fake.ok.any() else self.data}


def with_values(
    program: TableProgram,
    values: ArrayLike,
    fingerprint: str | None = None,
    rows: ArrayLike | None = None,
    more: Mapping[str, FloatArray] | None = None,
) -> bytes:
    """Bytes of the program with new values; all other columns keep their text, in Parquet their content and type.

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
    more : dict of str to ndarray, shape (n,), optional
        Numbers of other columns that are new, too, in the units of the file.

    Raises
    ------
    ValueError
        If a value is not finite, not rigid or of the wrong shape.
    """
    new = np.asarray(values, dtype=float)
    n = len(program.table)
    chosen = np.ones(n, dtype=bool) if rows is None else np.asarray(rows, dtype=bool)
    if new.shape != program.values.shape or chosen.shape != (n,) or not np.isfinite(new[chosen]).all():
        raise ValueError(f"expected finite values of shape {program.values.shape}")
    if program.kind == "pose":
        near = program.table.si(QUATERNION)
        numbers = numbers_from_poses(new[chosen], near[chosen])
    else:
        numbers = new[chosen] / joint_units(program.columns)
    changed = dict(zip(program.columns, numbers.T, strict=True))
    changed |= {name: column[chosen] for name, column in (more or {}).items()}
    if program.data.startswith(PARQUET):
        return _as_parquet(program, changed, fingerprint, chosen)
    columns = []
    for name in program.table.names:
        if name == MARK and fingerprint is not None:
            continue
        text = np.asarray(program.table.content[name], dtype=object)
        column = _new_column(name, changed[name], text, chosen) if name in changed else ("%s", _quoted(text))
        columns.append((_quoted(np.array([name], dtype=object))[0], *column))
    if fingerprint is not None:
        columns.append((MARK, "%s", _quoted(np.where(chosen, fingerprint, "").astype(object))))
    flat = np.empty((n, len(columns)), dtype=object)
    for k, (_, _, cells) in enumerate(columns):
        flat[:, k] = cells
    body = (",".join(form for _, form, _ in columns) + program.newline) * n % tuple(flat.ravel())
    head = ",".join(name for name, _, _ in columns) + program.newline
    return (head + body).encode("utf-8-sig" if program.byte_order_mark else "utf-8")


def _as_parquet(
    program: TableProgram, changed: Mapping[str, FloatArray], fingerprint: str | None, chosen: BoolArray
) -> bytes:
    """A Parquet program with new values for the chosen rows, the numbers those that CSV would hold."""
    import pyarrow as pa
    from pyarrow import parquet

    content = parquet.read_table(BytesIO(program.data))
    for name, values in changed.items():
        column = np.array(program.table.content[name], dtype=float)
        column[chosen] = np.round(values, _decimals(name)) + 0.0
        k = [written.strip() for written in content.column_names].index(name)
        content = content.set_column(k, content.column_names[k], pa.array(column))
    if fingerprint is not None:
        marks = pa.array([fingerprint if mark else None for mark in chosen.tolist()], pa.string())
        content = content.drop_columns([name for name in content.column_names if name == MARK])
        content = content.append_column(MARK, marks)
    out = BytesIO()
    parquet.write_table(content, out)
    return out.getvalue()


def rows_from(data: bytes, first: int) -> bytes:
    """A table without its first rows."""
    if data.startswith(PARQUET):
        from pyarrow import parquet

        out = BytesIO()
        parquet.write_table(parquet.read_table(BytesIO(data))[first:], out, compression="none")
        return out.getvalue()
    header, *_, rows = data.split(b"\n", first + 1)
    return header + b"\n" + rows


class TableWriter:
    """Writes tables of the same columns into a file, one below the other.

    Parameters
    ----------
    stream : BinaryIO
    """

    def __init__(self, stream: BinaryIO) -> None:
        self.stream = stream
        self._parquet: Any = None
        self._begun = False

    def append(self, data: bytes) -> None:
        """Write the rows of a table that is small enough for memory."""
        if data.startswith(PARQUET):
            from pyarrow import parquet

            rows = parquet.read_table(BytesIO(data))
            self._parquet = self._parquet or parquet.ParquetWriter(self.stream, rows.schema)
            self._parquet.write_table(rows)
        else:
            self.stream.write(data.partition(b"\n")[2] if self._begun else data)
        self._begun = True

    def begin_with(self, path: Path) -> None:
        """Write all rows of a file first."""
        with open(path, "rb") as stream:
            if stream.read(len(PARQUET)) == PARQUET:
                from pyarrow import parquet

                file = parquet.ParquetFile(stream)
                self._parquet = parquet.ParquetWriter(self.stream, file.schema_arrow)
                for group in range(file.num_row_groups):
                    self._parquet.write_table(file.read_row_group(group))
            else:
                stream.seek(0)
                shutil.copyfileobj(stream, self.stream)
        self._begun = True

    def close(self) -> None:
        """Write the end of the file."""
        if self._parquet is not None:
            self._parquet.close()
        self.stream.flush()


def _decimals(name: str) -> int:
    return QUATERNION_DECIMALS if name in QUATERNION else DECIMALS + 2 * ("_rad" in name)


def _new_column(name: str, values: FloatArray, text: NameArray, chosen: BoolArray) -> tuple[str, NameArray]:
    """Format and cells of a column with new values for the chosen rows."""
    decimals = _decimals(name)
    form = f"%.{decimals}f"
    rounded = np.round(values, decimals) + 0.0  # no negative zero
    if chosen.all():
        return form, rounded.astype(object)
    cells = text.copy()
    cells[chosen] = [form % value for value in rounded.tolist()]
    return "%s", _quoted(cells)


def _quoted(cells: NameArray) -> NameArray:
    """Cells with the quotation marks that CSV asks for."""
    joined = "\x00".join(cells)
    if not any(char in joined for char in ',"\r\n'):
        return cells
    return np.array(
        ['"' + cell.replace('"', '""') + '"' if any(char in cell for char in ',"\r\n') else cell for cell in cells],
        dtype=object,
    )


TIME = "time_s"


@dataclass(frozen=True, eq=False, repr=False)
class TimedTable(TableProgram):
    """A CSV trajectory as read; see `irbcal.correction.trajectories.Timed`."""

    arm: Arm
    motion: Trajectory
    """In joints as the controller counts them."""
    commands: Trajectory | None = None
    """Speeds and accelerations to write, in the arm's joints."""

    @property
    def trajectory(self) -> Trajectory:
        """The motion in joints of the arm."""
        return _counted(self.motion, self.arm.from_controller(np.eye(len(self.columns))).T)

    def with_motion(self, commands: Trajectory) -> TimedTable:
        """The program with speeds and accelerations to write."""
        return replace(self, commands=commands)

    def with_fake_targets(self, corrections: Corrections, fingerprint: str | None) -> dict[str, bytes]:
        """The table with the joints of the commands, their speeds and accelerations, marked in a column."""
        ((_, fake),) = corrections
        if not fake.ok.all() or self.commands is None:
            return {self.source: self.data}
        counted = _counted(self.commands, self.arm.to_controller(np.eye(len(self.columns))).T)
        frame = counted.to_frame()
        names = _as_written([name for name in frame.columns if name[0] in "va"], self.table.names)
        more = {name: frame[of].to_numpy() * (1.0 if name == of else DEG) for of, name in names.items()}
        return {self.source: with_values(self, to_controller(fake.q, self.coupling), fingerprint, more=more)}


def _counted(trajectory: Trajectory, turned: FloatArray) -> Trajectory:
    """The trajectory in joints that count otherwise: ``q @ turned.T``."""
    q, dq, ddq = (None if v is None else v @ turned.T for v in (trajectory.q, trajectory.dq, trajectory.ddq))
    assert q is not None
    return replace(trajectory, q=q, dq=dq, ddq=ddq, lean=None)


def has_times(program: TableProgram) -> bool:
    """Whether the rows of a table are joints over time."""
    return program.kind == "joint" and TIME in program.table


def along_time(program: TableProgram, arm: Arm) -> TimedTable:
    """A table of joints and times as a motion.

    Raises
    ------
    ProgramError
        If times do not grow, or columns of speeds or accelerations are not whole.
    """
    table, source = program.table, program.source
    columns_in_time = dict[str, FloatArray]()
    try:
        times = table.numbers(TIME, expected="a time in seconds")
        for letter, end in ENDS[1:]:
            columns = [f"{letter}{name[1:]}{end}" for name in arm.joint_columns]
            names = _as_written(columns, table.names)
            if any(name in table for name in names.values()):
                check_header(table.names, list(names.values()), source)
                as_written = np.array([name == of for of, name in names.items()])
                units = np.where(as_written, arm.joint_units, 1.0)
                columns_in_time[letter] = table.si(list(names.values())) * units
    except MeasurementError as error:
        _refuse(error)
    still = np.flatnonzero(np.diff(times) <= 0.0)
    if len(still):
        k = int(still[0]) + 1
        message = f"times of a trajectory grow, found {times[k]:g} s after {times[k - 1]:g} s"
        raise ProgramError(message, file=source, row=int(program.rows[k]), column=TIME)
    try:
        derivatives = columns_in_time.get("v"), columns_in_time.get("a")
        motion = Trajectory(times, program.values, *derivatives, arm.joint_names, arm.table.prismatic)
    except RobotError as error:
        raise ProgramError(str(error), file=source) from None
    return TimedTable(**{f.name: getattr(program, f.name) for f in fields(TableProgram)}, arm=arm, motion=motion)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a table of targets: its header names joints or positions."""
    if data.startswith(PARQUET):
        return any(name in data[-65536:] for name in (b"q1_", b"x_mm"))
    header = data[:4096].splitlines()[:1]
    return bool(header) and (b"q1_" in header[0] or b"x_mm" in header[0]) and b"," in header[0]


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[TableProgram]:
    """Read tables of targets for an arm; see `irbcal.correction.languages.Language`."""
    for parameter, frames in (("tool", setup.tools), ("wobj", setup.work_objects)):
        if frames:
            message = "the poses of a table are those of the tip in the base link: there is no frame to give"
            raise OptionError(f"{parameter}: {message}", file=files[0], parameter=parameter)
    programs = [read(path, arm) for path in files]
    return [along_time(program, arm) if has_times(program) else program for program in programs]


def read(path: str | Path, arm: Arm | None = None) -> TableProgram:
    """Read a CSV or Parquet program from a file; see `parse`."""
    return parse(read_bytes(path), str(path), arm)


def parse(data: bytes, source: str = "program", arm: Arm | None = None) -> TableProgram:
    """Read a CSV or Parquet program.

    Parameters
    ----------
    data : bytes
        UTF-8 text with commas, or a Parquet file.
    source : str
        File name for messages.
    arm : Arm, optional
        Whose joints they are; of six revolute ones unless given.

    Raises
    ------
    ProgramError
        If it does not keep the format.
    """
    try:
        table = _parsed(data, source)
        kind, columns = _kind(table.names, source, JOINTS if arm is None else arm.joint_columns)
        if not len(table):
            raise ProgramError("the file has a header but no rows", file=source)
        values = table.poses() if kind == "pose" else table.si(columns)
    except MeasurementError as error:
        _refuse(error)
    return TableProgram(
        source=source,
        kind=kind,
        columns=columns,
        values=values,
        rows=table.rows,
        data=data,
        table=table,
        newline="\r\n" if b"\r\n" in data else "\n",
        byte_order_mark=data.startswith(b"\xef\xbb\xbf"),
        fingerprint=_mark_of(table),
        notes=(),
        coupling=None if arm is None else arm.coupling,
    )


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the column that marks a corrected file; None without mark.

    Raises
    ------
    ProgramError
        If this is no CSV or Parquet file.
    """
    try:
        return _mark_of(_parsed(data, source))
    except MeasurementError as error:
        _refuse(error)


def _parsed(data: bytes, source: str) -> InputTable:
    """Cells of a file; numbers of a Parquet file as such."""
    if data.startswith(PARQUET) or source.endswith(".parquet"):
        return InputTable(parse_parquet(data, source, (), lambda name: True), source)
    return InputTable(cells_of_csv(data, source, typed=lambda name: False), source)


def _refuse(error: MeasurementError) -> NoReturn:
    """What the reader of measurements refuses is refused as a program, in the same words."""
    raise ProgramError(error.message, file=error.file, row=error.row, column=error.column) from None


def _mark_of(table: InputTable) -> str | None:
    marks = [mark.strip() for mark in dict.fromkeys(table.content[MARK]) if mark.strip()] if MARK in table else []
    return marks[0] if marks else None


def _as_written(names: Sequence[str], header: Sequence[str]) -> dict[str, str]:
    """Columns of degrees (``q1_deg``, ``v1_deg_s``) and what a header has for them, such as ``q1_rad``."""
    radians = {name: name.replace("_deg", "_rad") for name in names}
    return {name: radians[name] if radians[name] in header else name for name in names}


def _kind(names: Sequence[str], source: str, joints: Sequence[str]) -> tuple[TargetKind, tuple[str, ...]]:
    """Joints or poses and their columns, from the header."""
    kinds: dict[TargetKind, tuple[str, ...]] = {
        "joint": tuple(_as_written(joints, names).values()),
        "pose": tuple(POSE),
    }
    complete = {kind: all(name in names for name in columns) for kind, columns in kinds.items()}
    if all(complete.values()):
        raise ProgramError("expected columns of joints or of poses, found both", file=source, row=1)
    for kind, all_there in complete.items():
        if all_there:
            return kind, kinds[kind]
    for columns in kinds.values():
        metric = [name.replace("_mm", "_m") for name in columns]
        if any(name in names for name in (*columns, *metric)):
            check_header(names, columns, source)
    expected = f"columns {joints[0]} … {joints[-1]} (joints) or {', '.join(POSE)} (poses)"
    raise ProgramError(f"expected {expected}, found {listed(names)}", file=source, row=1)


ENDINGS = (".csv", ".parquet")


LANGUAGE = Language(
    name="CSV",
    endings=ENDINGS,
    looks_like=looks_like,
    reader=read_for,
    fingerprint=fingerprint,
)
