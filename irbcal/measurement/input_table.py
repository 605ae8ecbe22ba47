"""Tables of input: CSV, Parquet, a workbook or a DataFrame, whose columns are checked as they are asked for.

All tables that irbcal reads go through `InputTable`, so that a refusal always names file, row and column::

    table = InputTable.read("joints.csv", ["q1_deg", "q2_deg"])
    q = table.si(["q1_deg", "q2_deg"])

A table is text. The rows of messages are the lines of a CSV file, the header being line 1; in a Parquet file or a
DataFrame the position plus one, so that the first row is row 1.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray, coded
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import text_files
from irbcal.measurement.column_names import (
    FRAME,
    JOINTS,
    NAMES,
    PAYLOAD,
    PAYLOAD_CENTRE,
    POSE,
    POSITION,
    QUATERNION,
    all_or_none,
    check_header,
    commanded,
    declared,
    header_row,
    in_degrees,
    input_columns,
    listed,
)
from irbcal.measurement.table_columns import ColumnArrays, IsNumber, cells_of_csv, cells_of_frame, floats, parse_parquet
from irbcal.modeling import frames
from irbcal.modeling.terms import inputs
from irbcal.names import LONGEST_NAME, cell, fault_of, from_cell
from irbcal.option_values import excerpt
from irbcal.overwriting import NOT_SIMULATED
from irbcal.safe_files import STDIN, read_bytes, stdin_bytes
from irbcal.units import DEG, MM

GIVEN = "given_"
"""Put before the name of a column of the input that was computed, too."""
UNIT_LENGTH = 2e-3
"""How far the length of a quaternion may be from one, as its digits are rounded."""
_ABSENT = ["", "nan", "<na>", "none"]
TableLike: TypeAlias = "str | PathLike[str] | pd.DataFrame"
"""A CSV (``a.csv``, ``a.csv.gz``) or Parquet file, a workbook (``book.xlsx``, ``book.xlsx!Sheet2``), or a DataFrame
with the same columns."""


class TextRow(dict[str, str]):
    """Cells of a row of a table by their columns, and where it stands, for messages."""

    def __init__(self, cells: Mapping[str, str], source: str, row: int) -> None:
        super().__init__(cells)
        self.source, self.row = source, row

    def fault(self, sentence: str, column: str | None = None) -> MeasurementError:
        """The error that refuses it."""
        return MeasurementError(sentence, file=self.source, row=self.row, column=column)


@dataclass(frozen=True, eq=False)
class InputTable:
    """A table as text, whose columns are checked as they are asked for."""

    content: pd.DataFrame | ColumnArrays
    """Text, or numbers where a plain file has them; the index holds the rows for messages."""
    source: str = FRAME
    """File name for messages, `FRAME` for a DataFrame."""
    sha256: str = ""
    """Of the file's content; of a DataFrame's, as ``frame.to_csv(index=False)`` writes it."""

    @property
    def cells(self) -> pd.DataFrame:
        """The content as a DataFrame."""
        return self.content.to_frame() if isinstance(self.content, ColumnArrays) else self.content

    @classmethod
    def read(
        cls,
        table: TableLike,
        required: Sequence[str] = (),
        known: Sequence[str] | None = None,
        *,
        stdin: bool = False,
        typed: IsNumber | None = None,
    ) -> InputTable:
        """Read a table.

        Parameters
        ----------
        table : str, Path or DataFrame
            CSV (`text_files.with_commas` says which), a workbook's sheet, Parquet where pyarrow is installed, or a
            DataFrame with the same columns; its index does not matter.
        required : sequence of str
            Columns that must be there; `ALL_JOINTS` stands for those of the joints, however many.
        known : sequence of str, optional
            All columns that may be there; any unless given.
        stdin : bool
            Take the file ``-`` as standard input, as CSV.
        typed : callable, optional
            Tells by its name whether a column is one of numbers. These may then come as numbers, NaN where nothing
            stands, if the file is as plain as it should be: long files are read so in a quarter of the time.

        Raises
        ------
        MeasurementError
            If it cannot be read, lacks a column, has one that is not known or is named twice, or has no rows.
        """
        if not isinstance(table, (str, PathLike)):
            if not isinstance(table, pd.DataFrame):
                raise MeasurementError(f"expected a file or a DataFrame, found {excerpt(table)}", parameter="table")
            cells = cells_of_frame(table, required, FRAME)
            digest = _digest(str(cells.to_csv(index=False, lineterminator="\n")).encode())
            return cls(cells, FRAME, digest)._with_rows(known)
        source = str(Path(table))
        is_stdin = stdin and source == STDIN
        data = stdin_bytes(MeasurementError) if is_stdin else text_files.table_bytes(source)
        if not data.strip():
            raise MeasurementError("the file is empty, expected a header and rows", file=source)
        if Path(source).suffix == ".parquet":
            return cls(parse_parquet(data, source, required, typed), source, _digest(data))._with_rows(known)
        rows = cls.parse(data, source, required, known, typed)
        if text_files.is_workbook(source) or Path(source).suffix == ".gz":
            rows = replace(rows, sha256=_digest(read_bytes(text_files.file_of(source), MeasurementError)))
        return rows

    @classmethod
    def of_frame(cls, frame: pd.DataFrame, source: str, required: Sequence[str], typed: IsNumber) -> InputTable:
        """As `read`, from rows of a Parquet file."""
        return cls(cells_of_frame(frame, required, source, typed), source)._with_rows(None)

    @classmethod
    def parse(
        cls,
        data: bytes,
        source: str,
        required: Sequence[str] = (),
        known: Sequence[str] | None = None,
        typed: IsNumber | None = None,
    ) -> InputTable:
        """As `read`, from the content of a CSV file."""
        text = text_files.with_commas(data, source)
        return cls(cells_of_csv(text, source, required, typed), source, _digest(data))._with_rows(known)

    def in_degrees(self) -> InputTable:
        """The same table with joints that come in radians (``q1_rad``) as columns of degrees (``q1_deg``)."""
        if all(in_degrees(name) == name for name in self.names):
            return self
        columns: dict[str, pd.Series] = {}
        for name in self.names:
            column = self.cells[name]
            if in_degrees(name) != name:
                degrees = pd.to_numeric(column, errors="coerce") / DEG
                # text as the other cells are; what is no number stays as it stands, for messages
                column = column.where(degrees.isna(), degrees.map(repr)).astype(object)
            columns[in_degrees(name)] = column
        return replace(self, content=pd.DataFrame(columns))

    def _with_rows(self, known: Sequence[str] | None) -> InputTable:
        table = self.in_degrees()
        if table is not self:
            return table._with_rows(known)
        if known is not None:
            check_header(self.names, (), self.source, known)
        if not len(self):
            raise self.fault(f"the {'table' if self.source == FRAME else 'file'} has a header but no rows")
        return self

    def __len__(self) -> int:
        return len(self.content)

    def __contains__(self, name: str) -> bool:
        return name in self.content.columns

    def __getitem__(self, rows: BoolArray | IntArray) -> InputTable:
        """Some of the rows: a mask, or positions from 0."""
        return InputTable(self.cells.iloc[np.flatnonzero(rows) if rows.dtype == bool else rows], self.source)

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [str(name) for name in self.content.columns]

    @property
    def listed(self) -> str:
        """Names of the columns for messages."""
        return listed(self.names)

    @property
    def rows(self) -> IntArray:
        """The rows for messages, shape (rows,)."""
        return np.asarray(self.content.index)

    @property
    def simulated(self) -> bool:
        """Whether the table says so itself: any value but ``no`` in a column ``simulated``."""
        return "simulated" in self and any(text.lower() not in NOT_SIMULATED for text in self.texts("simulated"))

    # --- refusals

    def fault(
        self, sentence: str, row: int | None = None, column: str | Sequence[str] | None = None
    ) -> MeasurementError:
        """The error that refuses the table, or the row at a position from 0, with the place for the message."""
        at = None if row is None else int(self.content.index[row])
        return MeasurementError(sentence, file=self.source, row=at, column=column)

    def header_fault(self, sentence: str, parameter: str | None = None) -> MeasurementError:
        """The error that refuses the header."""
        return MeasurementError(sentence, file=self.source, row=header_row(self.source), parameter=parameter)

    def refuse(self, bad: BoolArray | pd.Series, column: str, expected: str) -> None:
        """Refuse the first of the rows that are marked as bad.

        Raises
        ------
        MeasurementError
            The sentence says what was expected in the column and what stands there.
        """
        bad = np.asarray(bad)
        if bad.any():
            k = int(np.argmax(bad))
            cell = np.asarray(self.content[column])[k]
            content = f"{cell:g}" if not isinstance(cell, str) else repr(cell.strip()) if cell.strip() else "nothing"
            raise self.fault(f"expected {expected}, found {content}", k, column)

    # --- columns

    def numbers(self, name: str, lost: bool = False, expected: str | None = None) -> FloatArray:
        """A column as finite numbers within what `declared` says of it, shape (rows,), in the column's unit.

        Parameters
        ----------
        name : str
        lost : bool
            Take empty cells as NaN.
        expected : str, optional
            What should stand there, for messages, where the column's name does not tell.

        Raises
        ------
        MeasurementError
            For the first cell that is no such number.
        """
        kind, or_nothing = declared(name), " or nothing" if lost else ""
        column = self.content[name]
        if column.dtype == np.float64:  # read as numbers already
            values = np.asarray(column)
            if not lost and np.isnan(values).any():
                row = int(np.argmax(np.isnan(values)))
                raise self.fault(f"expected {expected or kind.noun}, found nothing", row, name)
        elif (plain := floats(column)) is not None and np.isfinite(plain).all():
            values = plain
        else:
            text = self.cells[name].str.strip()
            values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float)
            bad = ~np.isfinite(values)
            if lost and bad.any():
                bad &= ~text.str.lower().isin(_ABSENT).to_numpy()
            self.refuse(bad, name, f"{expected or kind.noun}{or_nothing}")
        bad = (values < kind.low) | (values > kind.high)
        if bad.any():
            k = int(np.argmax(bad))
            raise self.fault(f"expected {kind.expected}{or_nothing}, found {values[k]:g}", k, name)
        return values

    def si(self, name: str | Sequence[str], lost: bool = False) -> FloatArray:
        """A column as `numbers` in SI units, shape (rows,); several side by side, shape (rows, columns)."""
        if isinstance(name, str):
            return self.numbers(name, lost) * declared(name).unit
        return np.column_stack([self.si(column, lost) for column in name])

    def optional(self, name: str) -> FloatArray:
        """A column as `si`; NaN where nothing stands, or there is no such column."""
        return self.si(name, lost=True) if name in self else np.full(len(self), np.nan)

    def either(self, *names: str) -> str:
        """The one of some columns that is there.

        Raises
        ------
        MeasurementError
            If there is none of them, or more than one.
        """
        present = [name for name in names if name in self]
        if len(present) != 1:
            content = f"both {' and '.join(present)}" if present else self.listed
            raise self.header_fault(f"expected a column {' or '.join(names)}, found {content}")
        return present[0]

    def ascending(self, name: str) -> FloatArray:
        """A column as `si` whose numbers grow from row to row."""
        values = self.si(name)
        self.refuse(np.diff(values, prepend=-np.inf) <= 0, name, "a later time than in the row before")
        return values

    def texts(self, name: str, absent: str = "") -> NameArray:
        """A column of names, which may be empty, shape (rows,); ``absent`` in all rows where there is no such column.

        Raises
        ------
        MeasurementError
            For the first name that would act on a terminal or a page instead of being shown there.
        """
        if name not in self:
            return np.full(len(self), absent, dtype=object)
        if isinstance(self.content, ColumnArrays):
            codes, written = coded(self.content[name])
        else:
            codes, written = pd.factorize(self.cells[name].astype(str))
        different = [from_cell(str(text).strip()) for text in written]
        if fault_of(" ".join(different), math.inf) or max(map(len, different)) > LONGEST_NAME:
            for k, text in enumerate(different):
                fault = fault_of(text)
                if fault is not None:
                    raise self.fault(fault, int(np.argmax(codes == k)), name)
        return np.array([*different, None], dtype=object)[codes]

    def as_written(self, name: str) -> NDArray[Any]:
        """A column that nothing is known of: equal texts are one object."""
        column = np.asarray(self.content[name])
        if column.dtype != object:
            return column
        code, texts = coded(column)
        return np.array([*texts, None], dtype=object)[code]

    def filled(self, name: str) -> NameArray:
        """A column of names as `texts`, with one in every row."""
        values = self.texts(name)
        self.refuse(values == "", name, "a name")
        return values

    def choice(self, name: str, choices: Sequence[str], absent: str = "") -> NameArray:
        """A column of words, each one of some, small letters; ``absent`` where there is no such column."""
        words = np.array([text.lower() for text in self.texts(name, absent)], dtype=object)
        if name in self:
            self.refuse(np.array([word not in choices for word in words]), name, ", ".join(choices))
        return words

    def refuse_repeats(self, name: str, values: Sequence[str] | NameArray) -> None:
        """Refuse the second row with the same name in a column."""
        twice = np.flatnonzero(pd.Series(values, dtype=object).duplicated())
        if len(twice):
            raise self.fault(f"{values[twice[0]]!r} stands there more than once", int(twice[0]), name)

    # --- columns that belong together

    def lost(self) -> BoolArray:
        """Rows of lost points, shape (rows,): those whose position has a gap or is exactly 0,0,0."""
        return lost_points(self.si(POSITION, lost=True))

    def measured(self) -> InputTable:
        """The rows whose points are not lost.

        Raises
        ------
        MeasurementError
            If all are.
        """
        check_header(self.names, POSITION, self.source)
        lost = self.lost()
        if lost.all():
            raise self.fault("every point is lost")
        return self[~lost]

    def quaternions(self, names: Sequence[str] = QUATERNION) -> FloatArray | None:
        """Unit quaternions, scalar first, shape (rows, 4), NaN where there is none; None without such columns.

        Raises
        ------
        MeasurementError
            For the first that is neither whole and of length 1 nor absent, or if only some of the columns are there.
        """
        if not all_or_none(self.names, names, self.source, f"an orientation needs {', '.join(names)}"):
            return None
        q = self.si(names, lost=True)
        length, absent = np.linalg.norm(q, axis=1), np.isnan(q).all(axis=1)
        bad = np.flatnonzero(~absent & ~(np.abs(length - 1) <= UNIT_LENGTH))
        if len(bad):
            content = ", ".join(f"{value:g}" for value in q[bad[0]])
            raise self.fault(f"expected a unit quaternion or nothing, found {content}", int(bad[0]), names)
        return q / length[:, None]

    def rotations(self, lost: bool = False) -> FloatArray | None:
        """Orientations, shape (rows, 3, 3); None without such columns.

        Where a row has none they are NaN if ``lost``, else there are none at all.
        """
        q = self.quaternions()
        return None if q is None or (np.isnan(q).any() and not lost) else frames.matrix_from_quaternion(q)

    def poses(self, prefix: str = "") -> FloatArray:
        """Poses, shape (rows, 4, 4), metres, from the columns ``x_mm`` … ``qz`` whose names begin so."""
        position, quaternion = ([f"{prefix}{name}" for name in names] for names in (POSITION, QUATERNION))
        q = self.quaternions(quaternion)
        assert q is not None, "the columns are required"
        self.refuse(np.isnan(q).any(axis=1), quaternion[0], "a unit quaternion")
        T = np.tile(np.eye(4), (len(self), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = frames.matrix_from_quaternion(q), self.si(position)
        return T

    def joints(self, names: Sequence[str] = JOINTS) -> FloatArray:
        """Joints, shape (rows, joints), radians (metres from columns in mm).

        Parameters
        ----------
        names : sequence of str
            The columns, ``arm.joint_columns``. Where there are programmed joints beside them (``c1_deg`` …), these are
            taken.
        """
        return self.si(commanded(self.names, names, self.source))

    def one_row_a_pose(self, joints: Sequence[str]) -> tuple[InputTable, pd.Series | None]:
        """The first row of each pose of a table with a row for each of its targets, such as a plan for the tracker.

        Parameters
        ----------
        joints : sequence of str
            The columns of joints, ``arm.joint_columns``.

        Returns
        -------
        table : InputTable
        targets : Series of str or None
            Of each row of it, with blanks between them. None: the table has no columns ``pose`` and ``target``.

        Raises
        ------
        MeasurementError
            If two rows of a pose have other joints.
        """
        if not {"pose", "target"} <= set(self.names):
            return self, None
        keys = [self.cells[name].str.strip() for name in ("pose", "cycle") if name in self]
        joints = commanded(self.names, joints, self.source)
        first = self.cells[joints].groupby(keys, sort=False).transform("first")
        for name in joints:
            differs = (self.cells[name] != first[name]).to_numpy()
            expected = first[name].iloc[int(np.argmax(differs))]
            self.refuse(differs, name, f"the joints of the pose's first row ({expected})")
        targets = self.cells["target"].str.strip().groupby(keys, sort=False).transform(" ".join)
        single = ~pd.concat(keys, axis=1).duplicated().to_numpy(dtype=bool)
        return self[single], targets[single]

    def inputs(self, joints: int) -> dict[str, FloatArray]:
        """Inputs of the error model's terms at each row, of an arm with so many joints: see `without_gaps`."""
        names = {quantity: input_columns(quantity, self.names, self.source) for quantity in inputs().values()}
        told = {
            quantity.name: quantity.from_columns([self.numbers(name, quantity.per_pose) for name in names[quantity]])
            for quantity in names
            if names[quantity] and not quantity.on_request
        }
        return without_gaps(told, joints, self.refuse)


def without_gaps(
    inputs_read: Mapping[str, FloatArray], joints: int, refuse: Callable[[BoolArray, str, str], None]
) -> dict[str, FloatArray]:
    """Inputs of the error model's terms (NaN where not told) without gaps: the usual values, or the one mass told.

    ``refuse`` refuses the first of marked rows, and says in which column what was expected.
    """
    load = inputs_read.get("payload_kg", np.zeros(0))
    gaps = ~np.isfinite(load)
    masses = np.unique(load[~gaps])
    if not len(masses):
        inputs_read = {name: values for name, values in inputs_read.items() if not name.startswith("payload")}
    elif len(masses) > 1:
        carried = f"{masses[0]:g} to {masses[-1]:g} kg"
        refuse(gaps, PAYLOAD, f"a mass, others carry {carried}: write 0 for a bare flange")
    if "payload_centre" in inputs_read:
        lost = np.isnan(inputs_read["payload_centre"]).any(axis=1)
        refuse(lost & (np.where(gaps, masses[0], load) > 0.0), PAYLOAD_CENTRE[0], "the place of the payload")
    usual = {"payload_kg": masses[0]} if len(masses) else {}
    return {
        name: inputs()[name].filled(values, (len(values), joints), usual.get(name))
        for name, values in inputs_read.items()
    }


def check_one_payload(option: bool, column: bool) -> None:
    """Refuse a payload that an option gives for all rows of a table that has a column of them."""
    if option and column:
        raise OptionError("payload: the table gives it (payload_kg): leave it out", parameter="payload")


def column_names(table: object) -> list[str]:
    """Names of the columns of a file or a DataFrame, as they stand in its header; none where it cannot be read."""
    try:
        if isinstance(table, pd.DataFrame) or Path(str(table)).suffix == ".parquet":
            frame = table if isinstance(table, pd.DataFrame) else pd.read_parquet(str(table))
            return [str(name).strip() for name in frame.columns]
        return text_files.header_of(text_files.table_bytes(str(table)))[0]
    except Exception:  # whatever is wrong with the file, its reader says it better
        return []


def read_targets(table: TableLike) -> dict[str, FloatArray]:
    """Read known reflector positions with columns ``target``, ``x_mm``, ``y_mm``, ``z_mm``.

    Returns
    -------
    dict of str to ndarray, shape (3,)
        Positions in the tip link, metres.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    rows = InputTable.read(table, ["target", *POSITION])
    names = rows.texts("target")
    rows.refuse_repeats("target", names)
    return dict(zip(names, rows.si(POSITION), strict=True))


def distinct(names: NameArray) -> list[str]:
    """Different names in the order of their first rows."""
    return [str(name) for name in dict.fromkeys(names)]


def poses_to_frame(T: FloatArray) -> pd.DataFrame:
    """Poses (n, 4, 4), metres, as a table with the columns `POSE` (unit quaternion, scalar first, qw >= 0)."""
    return pd.DataFrame(np.column_stack([T[:, :3, 3] / MM, frames.quaternion_from_matrix(T[:, :3, :3])]), columns=POSE)


def lost_points(xyz: FloatArray) -> BoolArray:
    """Which positions, shape (rows, 3), stand for a lost point: those with a gap, and exactly 0,0,0."""
    return np.isnan(xyz).any(axis=1) | (xyz == 0.0).all(axis=1)


def with_input_columns(
    inputs: pd.DataFrame | None, computed: pd.DataFrame, as_written: bool = False, row: IntArray | None = None
) -> pd.DataFrame:
    """Columns of an input, then those computed for its rows.

    Parameters
    ----------
    inputs : DataFrame or None
        The input's cells, texts as they stand in a file; None: there are none.
    computed : DataFrame
        What was computed.
    as_written : bool
        Leave the texts as they are; else columns in which nothing but numbers stands are numbers.
    row : ndarray of int, shape (computed rows,), optional
        The input's row, from 0, of each computed row; the same number unless given.

    Returns
    -------
    DataFrame
        Columns of the input whose names are taken are called ``given_NAME``.
    """
    if inputs is None:
        return computed
    columns_in = (inputs if as_written else _numbers_where_possible(inputs)).reset_index(drop=True)
    if row is not None:
        columns_in = columns_in.iloc[row].reset_index(drop=True)
    names_used = {*map(str, inputs.columns), *map(str, computed.columns)}
    names: dict[str, str] = {}
    for name in map(str, columns_in.columns):
        new = name
        while (new != name and new in names_used) or new in computed.columns:
            new = GIVEN + new
        names_used.add(new)
        names[name] = new
    return pd.concat([columns_in.rename(columns=names), computed.reset_index(drop=True)], axis=1)


def with_extra_columns(computed: pd.DataFrame, extra: Mapping[str, NameArray]) -> pd.DataFrame:
    """What was computed, then columns of its rows that were only carried along: texts, names as `with_input_columns`.

    No name begins like a formula: these tables are opened in a spreadsheet.
    """
    inputs = pd.DataFrame({cell(name): texts for name, texts in extra.items()}, index=computed.index)
    both = with_input_columns(inputs, computed, as_written=True)
    return both[[*computed.columns, *both.columns.drop(computed.columns)]]


def _numbers_where_possible(cells: pd.DataFrame) -> pd.DataFrame:
    """Texts of a file with the columns as numbers in which finite numbers (or nothing) stand alone; not names."""
    out = {}
    for name in cells.columns:
        text = cells[name].str.strip()
        values = pd.to_numeric(text.where(text != ""), errors="coerce")
        finite = values.notna() & ~np.isinf(values)
        number = name not in NAMES and finite.any() and (finite | (text == "")).all()
        out[name] = values.astype(float) if number else cells[name]
    return pd.DataFrame(out, index=cells.index)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
