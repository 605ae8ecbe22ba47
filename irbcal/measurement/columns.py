"""Columns of tables: read from CSV, Parquet or a DataFrame as text, then checked one by one.

All tables that irbcal reads go through here, so that a refusal always names file, row and column::

    cells, source, _ = columns.read("joints.csv", ["q1_deg", "q2_deg"])
    q = columns.in_si(cells, ["q1_deg", "q2_deg"], source)

``cells`` is a DataFrame of text. Its index holds the rows for messages: the line of a CSV file, the header being
line 1; the position plus one in a Parquet file or a DataFrame, whose first row is row 1.
"""

import csv
import hashlib
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from io import BytesIO, StringIO
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement import plain_csv
from irbcal.names import LONGEST_NAME, fault_of, from_cell
from irbcal.options import shown
from irbcal.reading import STDIN, read_bytes, stdin_bytes
from irbcal.units import DEG, LARGEST_PAYLOAD_KG, MM

JOINTS = [f"q{i}_deg" for i in range(1, 7)]
"""Joint columns of arms with six revolute joints."""
ALL_JOINTS = "q1 …"
"""Stands for the joint columns of any arm among required columns: from joint 1 to the last one in the header."""
POSITION = ["x_mm", "y_mm", "z_mm"]
QUATERNION = ["qw", "qx", "qy", "qz"]
LARGEST_ANGLE_DEG, LARGEST_POSITION_MM, LARGEST_NUMBER = 1e4, 1e6, 1e12
"""Numbers beyond are no joints and lengths of a robot cell; squares of the last can be computed with."""


class ColumnKind(NamedTuple):
    """What a column of numbers holds.

    Attributes
    ----------
    expected : str
        For messages.
    low, high : float
        The smallest and the largest number that make sense.
    unit : float
        What one is in SI units.
    """

    expected: str
    low: float
    high: float
    unit: float = 1.0


def _within(expected: str, most: float, unit: float = 1.0) -> ColumnKind:
    return ColumnKind(expected, -most, most, unit)


DECLARED: Mapping[str, ColumnKind] = {
    r"q[1-9]\d?_deg": _within("a joint angle in degrees", LARGEST_ANGLE_DEG, DEG),
    r"c[1-9]\d?_deg": _within("a programmed joint angle in degrees", LARGEST_ANGLE_DEG, DEG),
    r"q[1-9]\d?_mm": _within("a joint's travel in mm", LARGEST_POSITION_MM, MM),
    r"c[1-9]\d?_mm": _within("a joint's programmed travel in mm", LARGEST_POSITION_MM, MM),
    r"[xyz]_mm": _within("a position within 1 km in mm", LARGEST_POSITION_MM, MM),
    "u95_mm": ColumnKind("an uncertainty above zero in mm", 1e-6, LARGEST_POSITION_MM, MM),
    "payload_kg": ColumnKind(f"a mass from 0 to {LARGEST_PAYLOAD_KG:g} kg", 0.0, LARGEST_PAYLOAD_KG),
    r"payload_[xyz]_mm": _within("a place in the tip link in mm", 1e4, MM),
    r"tau[1-9]\d?_nm": _within("a torque in N m", 1e6),
    ".*_mm": _within(f"a number within ±{LARGEST_POSITION_MM:g}", LARGEST_POSITION_MM, MM),
    ".*_m": _within(f"a number within ±{LARGEST_POSITION_MM:g}", LARGEST_POSITION_MM),
    ".*_deg": _within(f"a number within ±{LARGEST_ANGLE_DEG:g}", LARGEST_ANGLE_DEG, DEG),
    ".*": _within(f"a number within ±{LARGEST_NUMBER:g}", LARGEST_NUMBER),
}
"""Names of columns, as patterns, and what they hold; the first that fits counts."""


@cache
def declared(name: str) -> ColumnKind:
    """What a column holds, by its name."""
    return next(kind for pattern, kind in DECLARED.items() if re.fullmatch(pattern, name))


GIVEN = "given_"
"""Put before the name of a column of the input that was computed, too."""
NAMES = ("pose", "target", "group", "session", "cycle")
"""Columns that are names even where they look like numbers."""
FRAME = "<DataFrame>"
"""What messages call a table that is no file."""

_JOINT = re.compile(r"q([1-9]\d?)_(?:deg|mm)")
_PROGRAMMED = re.compile(r"c([1-9]\d?)_(?:deg|mm)")
_ABSENT = ["", "nan", "<na>", "none"]
_LONGEST_NAME, _MOST_NAMES = 40, 40

IsNumber: TypeAlias = Callable[[str], bool]
TableLike: TypeAlias = str | PathLike[str] | pd.DataFrame
"""A CSV or Parquet file, or a DataFrame with the same columns."""


class Cells(NamedTuple):
    """A table as text.

    Attributes
    ----------
    cells : DataFrame
        Text; the index holds the rows for messages.
    source : str
        File name for messages, `FRAME` for a DataFrame.
    sha256 : str
        Of the file's content; of a DataFrame's, as ``frame.to_csv(index=False)`` writes it.
    """

    cells: pd.DataFrame
    source: str
    sha256: str


def read(table: TableLike, required: Sequence[str], stdin: bool = False, typed: IsNumber | None = None) -> Cells:
    """Read a table as text.

    Parameters
    ----------
    table : str, Path or DataFrame
        CSV, or Parquet where pyarrow is installed, or a DataFrame with the same columns; its index does not matter.
    required : sequence of str
        Columns that must be there; `ALL_JOINTS` stands for those of the joints, however many.
    stdin : bool
        Take the file ``-`` as standard input, as CSV.
    typed : callable, optional
        Tells by its name whether a column is one of numbers. These may then come as numbers, NaN where nothing stands,
        if the file is as plain as it should be: long files are read so in a quarter of the time.

    Returns
    -------
    Cells

    Raises
    ------
    MeasurementError
        If it cannot be read, lacks a column, names one twice or has no rows.
    """
    if not isinstance(table, (str, PathLike, pd.DataFrame)):
        raise MeasurementError(f"expected a file or a DataFrame, found {shown(table)}", parameter="table")
    if isinstance(table, pd.DataFrame):
        cells = _from_frame(table, required, FRAME)
        return Cells(_with_rows(cells, FRAME), FRAME, _digest(_canonical(cells)))
    path = Path(table)
    source = str(path)
    data = _bytes(path, source, stdin)
    if path.suffix != ".parquet":
        return parse(data, source, required, typed)
    return Cells(_with_rows(_parse_parquet(data, source, required), source), source, _digest(data))


def parse(data: bytes, source: str, required: Sequence[str], typed: IsNumber | None = None) -> Cells:
    """As `read`, from the content of a CSV file."""
    return Cells(_with_rows(parse_csv(data, source, required, typed), source), source, _digest(data))


def parse_csv(data: bytes, source: str, required: Sequence[str] = (), typed: IsNumber | None = None) -> pd.DataFrame:
    """Cells of a CSV file: text as it stands, blank lines left out; there may be no rows.

    Parameters
    ----------
    data : bytes
    source : str
        File name for messages.
    required : sequence of str
        As for `read`.
    typed : callable, optional
        As for `read`.

    Returns
    -------
    DataFrame
        The index holds the lines of the file.

    Raises
    ------
    MeasurementError
        If it is no such table.
    """
    text = _decoded(data, source)
    header = next(match[0] for match in re.finditer(r"[^\r\n]+", text) if match[0].strip())  # as pandas ends lines
    if "," not in header and (";" in header or "\t" in header):
        separators = "semicolons" if ";" in header else "tabs"
        raise MeasurementError(f"expected commas between the columns, found {separators}", file=source, row=1)
    try:
        names = [name.strip() for name in next(csv.reader([header]), [])]
    except csv.Error as error:  # a cell beyond 131,072 characters
        raise MeasurementError(f"expected column names, found what is none: {error}", file=source, row=1) from None
    check_header(names, required, source)
    if typed is not None:
        del text  # long files stand in memory once
        plain = plain_csv.parse(data, names, typed)
        if plain is not None:
            return plain
        text = _decoded(data, source)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            cells = pd.read_csv(
                StringIO(text), dtype=str, header=None, keep_default_na=False, skip_blank_lines=False, index_col=False
            )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning) as error:
        reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
        raise MeasurementError(f"not a table with as many values in each row as names: {reason}", file=source) from None
    cells = cells.fillna("")
    cells.index = cells.index + 1  # lines of the file
    cells = cells[(cells != "").any(axis=1)]
    cells = cells.iloc[1:]
    if cells.shape[1] != len(names):
        raise MeasurementError(
            f"expected {len(names)} values in each row as the header has names, found {cells.shape[1]}", file=source
        )
    cells.columns = names
    return cells


def check_header(names: Sequence[str], required: Sequence[str], source: str) -> None:
    """Refuse a header that lacks a required column or names one twice.

    Parameters
    ----------
    names : sequence of str
        The columns that are there.
    required : sequence of str
        As for `read`.
    source : str
        File name for messages.

    Raises
    ------
    MeasurementError
        The sentence lists the columns that are there and says whether they seem to have other units.
    """
    row = header_row(source)
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise MeasurementError(f"column {double[0]!r} stands there more than once", file=source, row=row)
    if ALL_JOINTS in required:
        numbered = sorted(int(match[1]) for name in names if (match := _JOINT.fullmatch(name)))
        twice = [k for k in set(numbered) if numbered.count(k) > 1]
        if twice:
            raise MeasurementError(f"joint {twice[0]} stands there in degrees and in mm", file=source, row=row)
        last = numbered[-1] if numbered else len(JOINTS)
        joints = [f"q{k}_deg" for k in range(1, last + 1) if f"q{k}_mm" not in names]
        position = required.index(ALL_JOINTS)
        required = [*required[:position], *joints, *required[position + 1 :]]
    missing = [name for name in required if name not in names]
    if missing:
        hint = ""
        if any(name.removesuffix("_deg") + "_rad" in names for name in missing):
            hint = "; joints are expected in degrees (q1_deg … q6_deg), found radians"
        elif any(name.removesuffix("_mm") + "_m" in names for name in missing):
            hint = "; positions are expected in millimetres (x_mm, y_mm, z_mm), found metres"
        raise MeasurementError(
            f"missing column {', '.join(missing)}; found {listed(names)}{hint}", file=source, row=row
        )


def header_row(source: str) -> int | None:
    """Row of the header for messages: 1 in a file, none in a DataFrame."""
    return None if source == FRAME else 1


def listed(names: Sequence[str]) -> str:
    """Column names for messages: the first ones, long ones cut."""
    return ", ".join(name if len(name) < _LONGEST_NAME else name[:_LONGEST_NAME] + "…" for name in names[:_MOST_NAMES])


def is_joint(name: str) -> bool:
    """Whether a column is one of joints, read or programmed."""
    return bool(_JOINT.fullmatch(name) or _PROGRAMMED.fullmatch(name))


def joint_columns(names: Iterable[str]) -> list[str]:
    """Joint columns among column names, ordered by the joints' numbers; only whole series from joint 1."""
    numbered = {int(match[1]): name for name in names if (match := _JOINT.fullmatch(name))}
    columns: list[str] = []
    while len(columns) + 1 in numbered:
        columns.append(numbered[len(columns) + 1])
    return columns


def commanded(names: Iterable[str], joints: Sequence[str], source: str) -> list[str]:
    """The columns that hold what joints were sent to: programmed joints where there are any, else the joint columns."""
    return [f"c{name[1:]}" for name in joints] if programmed_columns(names, source) else list(joints)


def programmed_columns(names: Iterable[str], source: str) -> list[str]:
    """Columns of programmed joints (``c1_deg`` …) among column names, in the order of the joints; none or all.

    Parameters
    ----------
    names : iterable of str
    source : str
        File name for messages.

    Returns
    -------
    list of str
        Empty where there are none.

    Raises
    ------
    MeasurementError
        If they are not those of the joint columns.
    """
    names = list(names)
    present = [name for name in names if _PROGRAMMED.fullmatch(name)]
    expected = [f"c{name[1:]}" for name in joint_columns(names)]
    if not present or set(present) == set(expected):
        return expected if present else []
    missing = [name for name in expected if name not in present]
    strange = [name for name in present if name not in expected]
    which = f"missing column {', '.join(missing)}" if missing else f"there is a column {strange[0]}"
    joints_text = f"({expected[0]} … {expected[-1]})" if expected else "(there are no joint columns)"
    raise MeasurementError(
        f"{which}: programmed joints are for all joints {joints_text} or for none, found {listed(present)}",
        file=source,
        row=header_row(source),
    )


def joint_units(columns: Iterable[str]) -> FloatArray:
    """What one unit of each joint column is in radians or metres, shape (columns,)."""
    return np.array([declared(name).unit for name in columns])


def numbers(cells: pd.DataFrame, name: str, source: str, expected: str | None = None, lost: bool = False) -> FloatArray:
    """A column as finite numbers within what `declared` says of it.

    Parameters
    ----------
    cells : DataFrame
        Text, as `read` returns it.
    name : str
    source : str
        File name for messages.
    expected : str, optional
        What should stand there, for messages, where the column's name does not tell.
    lost : bool
        Take empty cells as NaN.

    Returns
    -------
    ndarray, shape (rows,)

    Raises
    ------
    MeasurementError
        For the first cell that is no such number.
    """
    kind = declared(name)
    words = expected or kind.expected.partition(" within ±")[0]
    column = cells[name]
    if column.dtype == np.float64:  # read as numbers already, see `irbcal.measurement.plain_csv`
        values, bad = column.to_numpy(), np.zeros(len(column), dtype=bool) if lost else column.isna().to_numpy()
        text = column.astype(str).where(column.notna(), "") if bad.any() else column
    else:
        text = column.str.strip()
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float)
        absent = text.str.lower().isin(_ABSENT).to_numpy()
        bad = np.isinf(values) | np.where(absent, not lost, np.isnan(values))
    if not bad.any():
        bad = (values < kind.low) | (values > kind.high)
        words, text = kind.expected, pd.Series(values)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        cell = text.iloc[k]
        content = f"{cell:g}" if not isinstance(cell, str) else repr(cell) if cell else "nothing"
        raise MeasurementError(
            f"expected {words}{' or nothing' if lost else ''}, found {content}",
            file=source,
            row=int(cells.index[k]),
            column=name,
        )
    return values


def in_si(cells: pd.DataFrame, names: Sequence[str], source: str, lost: bool = False) -> FloatArray:
    """Columns as `numbers`, side by side in SI units, shape (rows, columns)."""
    return np.column_stack([numbers(cells, name, source, lost=lost) * declared(name).unit for name in names])


def names(cells: pd.DataFrame, name: str, source: str) -> Any:
    """A column of names, an array of str of shape (rows,); every row must have one that can be shown.

    Raises
    ------
    MeasurementError
        For the first cell that is none.
    """
    codes, written = pd.factorize(cells[name].astype(str))
    unlike = [from_cell(str(name).strip()) for name in written]
    values = np.array([*unlike, None], dtype=object)[codes]
    if all(unlike) and max(map(len, unlike)) <= LONGEST_NAME and fault_of(" ".join(unlike), math.inf) is None:
        return values
    for k, value in enumerate(unlike):
        fault = "expected a name, found nothing" if value == "" else fault_of(value)
        if fault is not None:
            row = cells.index[codes == k][0]
            raise MeasurementError(fault, file=source, row=int(row), column=name)
    return values


def refuse_unfit_names(values: pd.Series, name: str, source: str) -> None:
    """Names go to terminals, tables and pages: what would act there instead of being shown is refused.

    Parameters
    ----------
    values : Series of str
        The index holds the rows for messages.
    name : str
        The column.
    source : str
        File name for messages.

    Raises
    ------
    MeasurementError
        For the first such name.
    """
    for value in values.unique():
        fault = fault_of(value)
        if fault is not None:
            row = values.index[values == value][0]
            raise MeasurementError(fault, file=source, row=int(row), column=name)


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
    row : ndarray of int, shape (rows of found,), optional
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


# --- where the cells come from ------------------------------------------------------------------------------


def _bytes(path: Path, source: str, stdin: bool) -> bytes:
    data = stdin_bytes(MeasurementError) if stdin and source == STDIN else read_bytes(path, MeasurementError)
    if not data.strip():
        raise MeasurementError("the file is empty, expected a header and rows", file=source)
    return data


def _decoded(data: bytes, source: str) -> str:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        raise MeasurementError("expected UTF-8 text, found other bytes", file=source, row=row) from None
    if not text.strip():
        raise MeasurementError("the file is empty, expected a header and rows", file=source)
    if "\x00" in text:
        raise MeasurementError("expected a text file with commas, found binary data", file=source)
    return text


def _parse_parquet(data: bytes, source: str, required: Sequence[str]) -> pd.DataFrame:
    try:
        table = pd.read_parquet(BytesIO(data))
    except ImportError:
        raise MeasurementError("reading Parquet needs the package pyarrow, which is absent", file=source) from None
    except Exception as error:  # whatever pyarrow raises on a damaged file
        raise MeasurementError(f"not a Parquet file: {error}", file=source) from None
    return _from_frame(table, required, source)


def _from_frame(table: pd.DataFrame, required: Sequence[str], source: str) -> pd.DataFrame:
    """Cells of a DataFrame: numbers as text that reads back to the same, nothing for what is missing."""
    header = [str(name).strip() for name in table.columns]
    check_header(header, required, source)
    columns = [table.iloc[:, k] for k in range(len(header))]
    text = [column.astype(str).where(column.notna(), "").to_numpy(dtype=object) for column in columns]
    return pd.DataFrame(dict(zip(header, text, strict=True)), index=range(1, len(table) + 1), dtype=object)


def _canonical(cells: pd.DataFrame) -> bytes:
    return str(cells.to_csv(index=False, lineterminator="\n")).encode()


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _with_rows(cells: pd.DataFrame, source: str) -> pd.DataFrame:
    if cells.empty:
        source_kind = "table" if source == FRAME else "file"
        raise MeasurementError(f"the {source_kind} has a header but no rows", file=source)
    return cells
