"""Cells of tables: from the bytes of a CSV or Parquet file, or a DataFrame, to columns of numbers and text."""

from __future__ import annotations

import csv
import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from irbcal.arrays import FloatArray, IntArray, LockedDict, NameArray, locked
from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import check_header, in_degrees

_DIGITS = re.compile(r"[-.0-9eE ]*")
LONG_FILE = 1_000_000
"""Bytes from which both cores read."""
IsNumber: TypeAlias = Callable[[str], bool]


@dataclass(frozen=True, eq=False)
class ColumnArrays:
    """Columns of a table as arrays, for which pandas, a third of a second, need not be loaded."""

    columns: Mapping[str, NDArray[Any]]
    """Values of shape (rows,). Numbers, NaN where nothing stands, and texts."""
    index: IntArray
    """Shape (rows,). The rows for messages."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", LockedDict(self.columns))
        object.__setattr__(self, "index", locked(self.index))

    @classmethod
    def of_frame(cls, frame: pd.DataFrame) -> ColumnArrays:
        """Columns of a DataFrame, copied and read-only; the rows are counted from 0."""
        return cls({str(name): locked(frame[name].to_numpy()) for name in frame.columns}, np.arange(len(frame)))

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def to_frame(self) -> pd.DataFrame:
        """The same as a DataFrame of its own."""
        return pd.DataFrame(dict(self.columns), index=self.index)


def cells_of_csv(
    data: bytes, source: str, required: Sequence[str] = (), typed: IsNumber | None = None
) -> pd.DataFrame | ColumnArrays:
    """Cells of a CSV file: text as it stands, blank lines left out; there may be no rows.

    Parameters
    ----------
    data : bytes
    source : str
        File name for messages.
    required : sequence of str
        As for `InputTable.read`.
    typed : callable, optional
        As for `InputTable.read`.

    Returns
    -------
    DataFrame or ColumnArrays
        The index holds the lines of the file. Of a short plain file whose columns are ``typed`` arrays, without pandas.

    Raises
    ------
    MeasurementError
        If it is no such table.
    """
    text = _decoded(data, source)
    names = _header(text, source, required)
    if typed is not None:
        cells_of_short = _plain_cells(text, names, typed) if len(data) < LONG_FILE else None
        if cells_of_short is not None:
            return cells_of_short
        del text  # long files stand in memory once
        plain = parse_plain(data, names, typed)
        if plain is not None:
            return plain
        text = _decoded(data, source)
    filled = "," * (len(names) - 1) + "\n"  # pandas counts the columns in the first line
    text = re.sub(r"\A(?:[ \t]*\r?\n)+", lambda blank: filled * blank[0].count("\n"), text)
    cells = split_cells(text, source)
    cells.index = cells.index + 1  # lines of the file
    cells = cells[(cells != "").any(axis=1)]
    cells = cells.iloc[1:]
    if cells.shape[1] != len(names):
        raise MeasurementError(
            f"expected {len(names)} values in each row as the header has names, found {cells.shape[1]}", file=source
        )
    cells.columns = names
    return cells


def names_of_csv(data: bytes, source: str) -> list[str]:
    """Names of the columns of a CSV file, of which its first line is enough; errors as of `cells_of_csv`."""
    return _header(_decoded(data, source), source, ())


def _header(text: str, source: str, required: Sequence[str]) -> list[str]:
    header = next(match[0] for match in re.finditer(r"[^\r\n]+", text) if match[0].strip())  # as pandas ends lines
    if "," not in header and (";" in header or "\t" in header):
        separators = "semicolons" if ";" in header else "tabs"
        raise MeasurementError(f"expected commas between the columns, found {separators}", file=source, row=1)
    try:
        names = [name.strip() for name in next(csv.reader([header]), [])]
    except csv.Error as error:  # a cell beyond 131,072 characters
        raise MeasurementError(f"expected column names, found what is none: {error}", file=source, row=1) from None
    check_header([in_degrees(name) for name in names], required, source)
    return names


def split_cells(text: str, source: str, rows: Sequence[int] | None = None, **options: Any) -> pd.DataFrame:
    """Cells of a text as text, columns 0 and so on.

    Parameters
    ----------
    text : str
    source : str
        File name for messages.
    rows : sequence of int, optional
        Of the file, for messages: the row of each line; by default the lines count from 1.
    **options
        Of ``pandas.read_csv``.

    Raises
    ------
    MeasurementError
        If a row has more values than the first.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            cells = pd.read_csv(
                StringIO(text),
                dtype=str,
                header=None,
                keep_default_na=False,
                skip_blank_lines=False,
                index_col=False,
                **options,
            )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning) as error:
        match = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if match:
            row = int(match[2]) if rows is None else int(rows[int(match[2]) - 1])
            raise MeasurementError(f"expected {match[1]} values, found {match[3]}", file=source, row=row) from None
        reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
        raise MeasurementError(f"not a table: {reason}", file=source) from None
    return cells.fillna("")


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


def parse_parquet(data: bytes, source: str, required: Sequence[str], typed: IsNumber | None = None) -> pd.DataFrame:
    """Cells of a Parquet file by columns, the index being its rows, from 1; see `InputTable.read`."""
    try:
        table = pd.read_parquet(BytesIO(data))
    except ImportError:
        raise MeasurementError("reading Parquet needs the package pyarrow, which is absent", file=source) from None
    except Exception as error:  # whatever pyarrow raises on a damaged file
        raise MeasurementError(f"not a Parquet file: {error}", file=source) from None
    return cells_of_frame(table, required, source, typed)


def cells_of_frame(
    table: pd.DataFrame, required: Sequence[str], source: str, typed: IsNumber | None = None
) -> pd.DataFrame:
    """Cells of a DataFrame: numbers as text that reads back to the same, nothing for what is missing.

    Columns of numbers that are ``typed`` stay numbers.
    """
    header = [str(name).strip() for name in table.columns]
    check_header([in_degrees(name) for name in header], required, source)
    columns = [table.iloc[:, k] for k in range(len(header))]
    cells = [
        column.to_numpy(dtype=float)
        if typed is not None and typed(name) and column.dtype == np.float64
        else _texts(column)
        for name, column in zip(header, columns, strict=True)
    ]
    return pd.DataFrame(dict(zip(header, cells, strict=True)), index=range(1, len(table) + 1))


def _texts(column: pd.Series) -> NameArray:
    """Cells of a column as text; of numbers in a sixth of the time that pandas takes."""
    if column.dtype not in (np.float64, np.int64):
        return np.asarray(column.astype(str).where(column.notna(), "").to_numpy(dtype=object))
    return np.array([str(x) if x == x else "" for x in column.tolist()], dtype=object)


def lines_are_rows(data: bytes) -> bool:
    """Whether every line of a CSV file ends a row: as lines end, and outside of quotes; of whole lines."""
    if data.count(b"\r") != data.count(b"\r\n"):
        return False
    if b'"' not in data:
        return True
    text = np.frombuffer(data, np.uint8)
    quotes = np.flatnonzero(text == ord('"'))
    before = np.searchsorted(quotes, np.flatnonzero(text == ord("\n")))
    return not ((before % 2).any() or len(quotes) % 2)


def _plain_cells(text: str, names: Sequence[str], typed: IsNumber) -> ColumnArrays | None:
    """Cells of a short plain file as `parse_plain` reads them, without pandas and pyarrow; None for any other file."""
    lines = text.replace("\r\n", "\n").removesuffix("\n").split("\n")
    rows = [line.split(",") for line in lines]
    whole = all(len(row) == len(names) and any(row) for row in rows)
    if '"' in text or "\r" in text.replace("\r\n", "") or not whole or [name.strip() for name in rows[0]] != names:
        return None
    columns: dict[str, NDArray[Any]] = {}
    for name, cells in zip(names, zip(*rows[1:], strict=True), strict=False):
        columns[name] = np.array(cells, dtype=object)
        if typed(name):
            if not _DIGITS.fullmatch("".join(cells)):
                return None
            try:
                columns[name] = np.array([float(cell) if cell else math.nan for cell in cells])
            except ValueError:
                return None
            if np.isinf(columns[name]).any():
                return None
        columns[name].setflags(write=False)
    return ColumnArrays(columns, np.arange(2, len(rows) + 1)) if columns else None


def parse_plain(data: bytes, names: Sequence[str], typed: Callable[[str], bool]) -> pd.DataFrame | None:
    """Cells of a plain CSV file, read fast; any other is read cell by cell, which can say what is wrong where.

    A file is plain where no quoted cell holds the end of a line, no line is blank and all numbers are numbers.

    Parameters
    ----------
    data : bytes
    names : sequence of str
        Of the columns, as the first line has them.
    typed : callable
        Tells by its name whether a column is one of numbers.

    Returns
    -------
    DataFrame or None
        Numbers, NaN where nothing stands, and text; the index holds the lines of the file. None for a file that is not
        plain, or without pyarrow.
    """
    if not lines_are_rows(data):
        return None
    try:
        import pyarrow as pa
        from pyarrow import compute
        from pyarrow import csv as arrow_csv
    except ImportError:
        return None
    numbers = {name for name in names if typed(name)}
    start = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    rows = data.count(b"\n") - data.endswith(b"\n")
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(pa.py_buffer(data).slice(start)),
            arrow_csv.ReadOptions(use_threads=len(data) > LONG_FILE, column_names=list(names), skip_rows=1),
            arrow_csv.ParseOptions(quote_char='"'),
            arrow_csv.ConvertOptions(
                column_types={name: pa.float64() if name in numbers else pa.string() for name in names},
                null_values=[""],
            ),
        )
    except pa.ArrowInvalid:
        return None
    if table.num_rows != rows:  # blank lines
        return None
    columns: dict[str, Any] = {}
    empty = np.ones(rows, dtype=bool)
    text = pd.StringDtype("pyarrow", na_value=np.nan)
    for name in names:
        column = table.column(name)
        columns[name] = column.to_numpy() if name in numbers else pd.array(column, dtype=text)
        if name not in numbers:
            if empty.any():
                empty &= compute.equal(column, "").to_numpy()
        else:
            empty &= np.isnan(columns[name])
            if np.isinf(columns[name]).any() or np.isnan(columns[name]).sum() != column.null_count:  # "nan" as text
                return None
    if empty.any():  # a line of commas is no row
        return None
    return pd.DataFrame(columns, index=pd.RangeIndex(2, rows + 2), copy=False)


def floats(text: pd.Series | NDArray[Any]) -> FloatArray | None:
    """Numbers of a column of text that pyarrow holds; None where it does not, or a cell is no plain number."""
    to_arrow = getattr(getattr(text, "array", None), "__arrow_array__", None)
    if to_arrow is None or not isinstance(text.dtype, pd.StringDtype) or text.dtype.storage != "pyarrow":
        return None
    import pyarrow as pa

    try:
        return np.asarray(to_arrow().cast(pa.float64()))
    except pa.ArrowInvalid:
        return None
