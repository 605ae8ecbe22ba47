"""Foreign text files: bytes to cells, with the line in the file kept for every row."""

import csv
import re
import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError

LARGEST_FILE = 200 * 10**6
"""Bytes of a file."""
MOST_COLUMNS = 2000
CODECS = {"auto": "utf-8", "utf-8": "utf-8", "utf-16": "utf-16", "latin-1": "latin-1", "cp1252": "cp1252"}
MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
CANDIDATES = ("\t", ";", "|", ",")
BLANKS = r"\s+"
UNITS = {
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "inch": ("inch", "inches", "in", '"'),
    "deg": ("deg", "degree", "degrees", "°"),
    "rad": ("rad", "radian", "radians"),
}
"""Spellings of units in headers."""


@dataclass(frozen=True, eq=False)
class TextTable:
    """Cells of a text file.

    Attributes
    ----------
    source : str
        File name for messages.
    cells : DataFrame
        Stripped text, columns 0 … width-1; the index is the line in the file, from 1.
    names : list of str or None
        Header, where there is one.
    header_line : int
        Line of the header.
    decimal : str
        ``.``, ``,`` or ``auto``.
    """

    source: str
    cells: pd.DataFrame
    names: list | None
    header_line: int
    decimal: str
    _numbers: dict = field(default_factory=dict, init=False)

    @property
    def lines(self):
        """Line in the file of each row."""
        return self.cells.index.to_numpy()

    @property
    def width(self):
        """Number of columns."""
        return self.cells.shape[1]

    def label(self, k):
        """Name of column k for messages: from the header, or its number from 1."""
        return self.names[k] if self.names and self.names[k] else str(k + 1)

    @cached_property
    def _places(self):
        """Places of the header's names in three spellings, from the strictest to the loosest."""
        spellings = ({}, {}, {})
        for k, name in enumerate(self.names or ()):
            bare = _without_unit(name)[0]
            for found, text in zip(spellings, (name, _folded(name), _folded(bare)), strict=True):
                found.setdefault(text, []).append(k)
        return spellings

    def find(self, column, what, optional=False):
        """Index of a column.

        Names are compared as they are, then without regard to case and blanks, then without a unit in brackets.

        Parameters
        ----------
        column : str or int
            Name, or number from 1 (from -1 backwards).
        what : str
            What it is for, in messages.
        optional : bool
            Return None where there is no such column.

        Raises
        ------
        MeasurementError
            If it is not there, or there more than once.
        """
        if isinstance(column, int):
            k = column - 1 if column > 0 else self.width + column
            if 0 <= k < self.width:
                return k
            if optional:
                return None
            raise MeasurementError(
                f"{self.source}: row {self.lines[0]}: expected a column {column} for {what}, found {self.width} columns"
            )
        if self.names is None:
            raise MeasurementError(
                f"{self.source}: expected the number of the column for {what}, as the file has no header "
                f"(file.header: false), found the name {column!r}"
            )
        for found, text in zip(self._places, (column.strip(), _folded(column), _folded(column)), strict=True):
            places = found.get(text, [])
            if len(places) > 1:
                raise MeasurementError(
                    f"{self.source}: row {self.header_line}: expected one column {column!r} for {what}, found "
                    f"{len(places)}; give its number"
                )
            if places:
                return places[0]
        if optional:
            return None
        found = ", ".join(short(name) for name in self.names[:40])
        raise MeasurementError(
            f"{self.source}: row {self.header_line}: there is no column {column!r} for {what}; found {found}"
        )

    def check_unit(self, k, declared, key):
        """Refuse a unit in the header's brackets that is not the declared one."""
        unit = _without_unit(self.names[k])[1] if self.names else None
        if unit and unit != declared:
            raise MeasurementError(
                f"{self.source}: row {self.header_line}, column {self.names[k]}: expected {key} {declared} as declared "
                f"in the map, found {unit}"
            )

    def text(self, k):
        """Cells of a column, Series of str."""
        return self.cells[k]

    def with_decimal(self, columns):
        """The same with the decimal mark settled from the cells of some columns that hold numbers.

        Raises
        ------
        MeasurementError
            If commas could be decimal marks or separate thousands.
        """
        if self.decimal != "auto":
            return self
        cells = pd.concat([self.cells[k] for k in columns])
        commas = cells[cells.str.contains(",", regex=False)]
        if commas.empty:
            return replace(self, decimal=".")
        line, found = commas.index[0], commas.iloc[0]
        dots = cells.str.contains(".", regex=False).any()
        if dots or commas.str.fullmatch(r"[+-]?\d{1,3}(,\d{3})+").all():
            raise MeasurementError(
                f"{self.source}: row {line}: expected to see which mark is the decimal one, found {short(found)!r}"
                f"{' and dots in other cells' if dots else ''}; declare file.decimal"
            )
        return replace(self, decimal=",")

    def parsed(self, k):
        """A column as numbers, NaN where there is none, shape (rows,)."""
        if k not in self._numbers:
            text = self.cells[k]
            if self.decimal == ",":  # on the whole column at once: no cell holds a line's end
                joined = "\n".join(text.to_numpy(dtype=object))
                if "." in joined:
                    joined = re.sub(r"[^\n]*\.[^\n]*", "?", joined)
                text = pd.Series(joined.replace(",", ".").split("\n"), dtype=object)
            self._numbers[k] = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float)
        return self._numbers[k]

    def is_one_of(self, k, texts, numbers=()):
        """Rows of a column that hold one of some texts (in lower case) or one of some numbers, shape (rows,)."""
        values = self.parsed(k)
        found = np.isin(values, list(numbers)) if numbers else np.zeros(len(values), dtype=bool)
        rows = np.flatnonzero(~np.isfinite(values))  # texts are no numbers
        found[rows] |= self.cells[k].iloc[rows].str.lower().isin(texts).to_numpy(dtype=bool)
        return found

    def numbers(self, k, expected, absent=None):
        """A column as numbers.

        Parameters
        ----------
        k : int
        expected : str
            What should stand there, for messages.
        absent : ndarray of bool, shape (rows,), optional
            Rows that may hold anything; they become NaN. By default none.

        Raises
        ------
        MeasurementError
            The sentence names file, row and column.
        """
        values = self.parsed(k).copy()
        bad = ~np.isfinite(values)
        if absent is not None:
            bad &= ~absent
            values[absent] = np.nan
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            found = self.cells[k].iloc[row]
            other = "." if self.decimal == "," else ","
            hint = ""
            if re.fullmatch(rf"[+-]?\d+[{other}]\d+([eE][+-]?\d+)?", found):
                hint = f"; the map says file.decimal: '{self.decimal}'"
            raise MeasurementError(
                f"{self.source}: row {self.lines[row]}, column {self.label(k)}: expected {expected}, found "
                f"{repr(short(found)) if found else 'nothing'}{hint}"
            )
        return values


def short(text, most=40):
    """A cell for messages."""
    return text if len(text) <= most else text[:most] + "…"


def read(path, dialect, allowed_short=()):
    """Read a text file.

    Parameters
    ----------
    path : str or Path
    dialect : Dialect
    allowed_short : sequence of str
        Cells (in lower case) that excuse a row for having fewer values than the others.

    Returns
    -------
    TextTable

    Raises
    ------
    MeasurementError
        If the file cannot be read or is no table.
    """
    source = str(path)
    lines = _decode(_bytes(Path(path), source), dialect.encoding, source)
    rows = [(k, line) for k, line in enumerate(lines, 1) if k > dialect.skip_rows and line.strip()]
    if dialect.comment:
        rows = [(k, line) for k, line in rows if not line.lstrip().startswith(dialect.comment)]
    if len(rows) < 1 + dialect.header:
        what = "a header and rows" if dialect.header else "rows"
        raise MeasurementError(
            f"{source}: expected {what} after {dialect.skip_rows} skipped rows, found {len(rows)} rows"
        )
    separator = _separator(dialect, [line for _, line in rows[:50]])
    names = None
    header_line = rows[0][0]
    if dialect.header:
        names = [name.strip() for name in _fields(rows[0][1], separator)]
        rows = rows[1:]
    width = max(len(names or ()), len(_fields(rows[0][1], separator)))
    if width > MOST_COLUMNS:
        raise MeasurementError(f"{source}: row {rows[0][0]}: expected at most {MOST_COLUMNS} columns, found {width}")
    lines = [line for _, line in rows]
    cells = _cells(lines, np.array([k for k, _ in rows]), separator, width, source)
    if names is not None:
        names += [""] * (width - len(names))
    _refuse_short_rows(cells, lines, separator, source, allowed_short)
    cells = _named_columns(cells, names, source)
    if names is not None:
        names = names[: cells.shape[1]]
    return TextTable(source, cells, names, header_line, "." if separator == "," else dialect.decimal)


def _bytes(path, source):
    try:
        if path.is_dir():
            raise MeasurementError(f"{source}: expected a file, found a folder")
        with open(path, "rb") as stream:
            data = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise MeasurementError(f"{source}: there is no such file") from None
    except (OSError, ValueError) as error:
        raise MeasurementError(f"{source}: cannot read this file: {getattr(error, 'strerror', error)}") from None
    if len(data) > LARGEST_FILE:
        raise MeasurementError(f"{source}: expected a file of at most {LARGEST_FILE // 10**6} MB, found more")
    if not data.strip():
        raise MeasurementError(f"{source}: the file is empty, expected rows")
    return data


def _decode(data, encoding, source):
    """Lines of a file."""
    codec = next((codec for mark, codec in MARKS if data.startswith(mark)), CODECS[encoding])
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        name = codec.removesuffix("-sig")
        hint = "; older Windows programs write latin-1 or cp1252" if codec == "utf-8" else ""
        raise MeasurementError(
            f"{source}: row {line}: expected text in {name} (file.encoding), found other bytes{hint}"
        ) from None
    strange = re.search(r"[\x00-\x08\x0e-\x1f]", text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        raise MeasurementError(f"{source}: row {line}: expected a text file, found binary data")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _separator(dialect, lines):
    if dialect.delimiter != "auto":
        return {"tab": "\t", "space": BLANKS}.get(dialect.delimiter, dialect.delimiter)
    for mark in CANDIDATES:  # half of the lines will do: a lost point may be one word alone
        if 2 * sum(mark in line for line in lines) > len(lines) and not (mark == "," and dialect.decimal == ","):
            return mark
    return BLANKS if 2 * sum(len(line.split()) > 1 for line in lines) > len(lines) else ","


def _fields(line, separator):
    if separator == BLANKS:
        line, separator = " ".join(line.split()), " "
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def _cells(lines, numbers, separator, width, source):
    """Cells of lines as a table whose index is the lines' numbers."""
    first = (" " if separator == BLANKS else separator).join(map(str, range(width)))  # sets the width
    text = "\n".join([first, *lines])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            cells = pd.read_csv(
                StringIO(text),
                sep=separator,
                header=None,
                dtype=str,
                keep_default_na=False,
                skip_blank_lines=False,
                skipinitialspace=True,
                index_col=False,
            ).iloc[1:]
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found:
            row = numbers[int(found[2]) - 2]
            raise MeasurementError(f"{source}: row {row}: expected {found[1]} values, found {found[3]}") from None
        reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
        raise MeasurementError(f"{source}: not a table: {reason}") from None
    if len(cells) != len(numbers):
        raise MeasurementError(f"{source}: expected quotes to end in the row where they begin, found some that do not")
    cells.index = numbers
    cells = cells.fillna("")
    if re.search(r"[^\S\n]", text):
        for k in cells.columns:
            cells[k] = cells[k].str.strip()
    return cells


def _refuse_short_rows(cells, lines, separator, source, excuses):
    """Refuse rows with fewer values than the others, but for lost points: a shift of columns must not pass for one."""
    width = cells.shape[1]
    for row in np.flatnonzero((cells.iloc[:, -1] == "").to_numpy()):
        found = len(_fields(lines[row], separator))
        if found < width and not any(cell.lower() in excuses for cell in cells.iloc[row]):
            raise MeasurementError(f"{source}: row {cells.index[row]}: expected {width} values, found {found}")


def _named_columns(cells, names, source):
    """Cells without empty columns at the end that have no name, as separators at the lines' ends make them."""
    width = cells.shape[1]
    while width > 1 and not (names and names[width - 1]) and (cells[width - 1] == "").all():
        width -= 1
    if names is not None and not names[width - 1]:
        line = cells.index[(cells[width - 1] != "").to_numpy()][0]
        raise MeasurementError(f"{source}: row {line}: expected {width - 1} values as the header has names, found more")
    return cells.iloc[:, :width]


def _folded(name):
    return " ".join(name.casefold().split())


def _without_unit(name):
    """A header's name without a unit in brackets at its end, and the unit if it is a known one."""
    found = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]", name[:200])
    if not found:
        return name, None
    spelled = found[2].casefold()
    return found[1], next((unit for unit, spellings in UNITS.items() if spelled in spellings), None)
