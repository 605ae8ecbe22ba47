"""Lines of text as a table: cells with their lines, titles and units of its columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from typing import Literal, overload

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import in_degrees
from irbcal.measurement.imports.column_map import Column, Dialect
from irbcal.measurement.table_columns import split_cells
from irbcal.measurement.text_files import short, text_lines
from irbcal.wording import first_of

MOST_COLUMNS = 2000
TITLE_MARK = re.compile(r"^\s*(?://|#|%)\s*(?=\w)")
"""A mark of a comment before the titles of columns."""
SIMULATED = re.compile(r"\s*(?://|#|%)\s*SIMULATED\b")
"""A comment by which a text file says that no tracker measured it."""
CANDIDATES = ("\t", ";", "|", ",")
BLANKS = r"\s+"
UNITS = {
    "mm": (
        "mm",
        "millimeter",
        "millimeters",
        "millimetre",
        "millimetres",
        "millimètres",
        "毫米",
        "ミリ",
        "ミリメートル",
    ),
    "m": ("m", "meter", "meters", "metre", "metres", "mètre", "mètres", "米", "メートル"),
    "inch": ("inch", "inches", "in", '"', "zoll", "pouce", "pouces", "pulgada", "pulgadas", "英寸", "インチ"),
    "deg": ("deg", "degree", "degrees", "°", "grad", "degré", "degrés", "gradi", "grados", "度"),
    "rad": ("rad", "radian", "radians", "radiant", "弧度", "ラジアン"),
}
"""Spellings of units in headers."""
UNIT = "|".join(re.escape(text) for texts in UNITS.values() for text in sorted(texts, key=len, reverse=True))
"""Any unit, for regular expressions."""
_DRESSED = re.compile(rf"(?:([^\W\d]\w{{0,20}})\s*=\s*)?([^=]*?)\s*({UNIT})?", re.IGNORECASE)
_WITH_UNIT = re.compile(rf"([+-]?[\d.,']*\d[\d.,]*)(\s+)({UNIT})(?=\s|$)", re.IGNORECASE)
_DIGITS = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?")
_BLANK_UNIT = re.compile(rf"\d[.,]?[^\S\n]+(?:{UNIT})(?:\s|$)", re.IGNORECASE)
AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class TextTable:
    """Cells of a text file; not locked, as it keeps the numbers that it has read once."""

    source: str
    """File name for messages."""
    cells: pd.DataFrame
    """Stripped text, columns 0 … width-1; the index is the line in the file, from 1."""
    names: tuple[str, ...] | None
    """Header, where there is one."""
    header_line: int
    """Line of the header."""
    decimal: str
    """``.``, ``,`` or ``auto``."""
    units: dict[int, str] = field(default_factory=dict)
    """Units that stand in the cells of columns, behind each number."""
    simulated: bool = False
    """Whether a comment says so."""
    _numbers: dict[int, FloatArray] = field(default_factory=dict, init=False)

    @property
    def lines(self) -> IntArray:
        """Line in the file of each row."""
        return self.cells.index.to_numpy()

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.cells.shape[1]

    def label(self, k: int) -> str:
        """Name of column k for messages: from the header, or its number from 1."""
        return self.names[k] if self.names and self.names[k] else str(k + 1)

    def key(self, k: int) -> str | int:
        """Column k as a map names it: by its name, or by its number from 1 where that is not the only such name."""
        name = self.names[k] if self.names else ""
        return name if name and self.names is not None and self.names.count(name) == 1 else k + 1

    def fault(self, sentence: str, row: int, *columns: int) -> MeasurementError:
        """The error that refuses a row, counted from 0; messages name its line and the columns."""
        labels = [self.label(k) for k in columns]
        return MeasurementError(sentence, file=self.source, row=int(self.lines[row]), column=labels or None)

    def header_fault(self, sentence: str, column: str | None = None) -> MeasurementError:
        """The error that refuses the header."""
        return MeasurementError(sentence, file=self.source, row=self.header_line, column=column)

    @cached_property
    def _places(self) -> tuple[dict[str, list[int]], ...]:
        """Places of the header's names in four spellings, from the strictest to the loosest."""
        spellings: tuple[dict[str, list[int]], ...] = ({}, {}, {}, {})
        for k, name in enumerate(self.names or ()):
            bare = without_unit(name)[0]
            for by_spelling, text in zip(
                spellings, (name, _folded(name), _folded(bare), in_degrees(name)), strict=True
            ):
                by_spelling.setdefault(text, []).append(k)
        return spellings

    @overload
    def find(self, column: str | int, use: str, optional: Literal[False] = False) -> int: ...

    @overload
    def find(self, column: str | int, use: str, optional: bool) -> int | None: ...

    def find(self, column: str | int, use: str, optional: bool = False) -> int | None:
        """Index of a column.

        Names are compared as they are, then without regard to case and blanks, then without a unit in brackets; then
        ``q1_rad`` serves for ``q1_deg``.

        Parameters
        ----------
        column : str or int
            Name, or number from 1 (from -1 backwards).
        use : str
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
            raise self.fault(f"expected a column {column} for {use}, found {self.width} columns", 0)
        if self.names is None:
            raise MeasurementError(
                f"expected the number of the column for {use}, as the file has no header (file.header: false), found "
                f"the name {column!r}",
                file=self.source,
            )
        stripped = column.strip()
        for by_spelling, text in zip(self._places, (stripped, _folded(column), _folded(column), stripped), strict=True):
            matches = by_spelling.get(text, [])
            if len(matches) > 1:
                raise self.header_fault(
                    f"expected one column {column!r} for {use}, found {len(matches)}; give its number"
                )
            if matches:
                return matches[0]
        if optional:
            return None
        listed = first_of([short(name) for name in self.names], 40)
        raise self.header_fault(f"there is no column {column!r} for {use}; found {listed}")

    def check_unit(self, k: int, declared: str | None, key: str) -> None:
        """Refuse a unit in the header's brackets that is not the declared one."""
        name = self.names[k] if self.names else ""
        unit = without_unit(name)[1] or self.units.get(k)
        if unit and unit != declared:
            raise self.header_fault(f"expected {key} {declared} as declared in the map, found {unit}", name or None)

    def text(self, k: int) -> pd.Series:
        """Cells of a column, Series of str."""
        return self.cells[k]

    def with_decimal(self, columns: Iterable[int]) -> TextTable:
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
        row, cell = commas.index[0], commas.iloc[0]
        dots = cells[cells.str.contains(".", regex=False)]
        if not dots.empty or commas.str.fullmatch(r"[+-]?\d{1,3}(,\d{3})+").all():
            found = f"{short(cell)!r}" + (
                "" if dots.empty else f" and, in row {dots.index[0]}, {short(dots.iloc[0])!r}"
            )
            advice = "declare file.decimal"
            if not dots.empty:
                advice += " (and file.thousands if the other mark stands in it), or write all numbers alike"
            raise MeasurementError(
                f"expected to see which mark is the decimal one, found {found}; {advice}",
                file=self.source,
                row=int(row),
            )
        return replace(self, decimal=",")

    def parsed(self, k: int) -> FloatArray:
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

    def is_one_of(self, k: int, texts: Collection[str], numbers: Collection[float] = ()) -> BoolArray:
        """Rows of a column that hold one of some texts (in lower case) or one of some numbers, shape (rows,)."""
        values = self.parsed(k)
        matches = np.isin(values, list(numbers)) if numbers else np.zeros(len(values), dtype=bool)
        rows = np.flatnonzero(~np.isfinite(values))  # texts are no numbers
        matches[rows] |= self.cells[k].iloc[rows].str.lower().isin(texts).to_numpy(dtype=bool)
        return matches

    def numbers(self, k: int, expected: str, absent: BoolArray | None = None) -> FloatArray:
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
            cell = self.cells[k].iloc[row]
            mark = "." if self.decimal == "," else ","
            hint = ""
            if re.fullmatch(rf"[+-]?\d+[{mark}]\d+([eE][+-]?\d+)?", cell):
                hint = f"; the map says file.decimal: '{self.decimal}'"
            raise self.fault(f"expected {expected}, found {repr(short(cell)) if cell else 'nothing'}{hint}", row, k)
        return values


def read(path: str | PathLike[str], dialect: Dialect, allowed_short: Collection[str] = ()) -> TextTable:
    """Read a text file.

    Parameters
    ----------
    path : str or Path
    dialect : Dialect
    allowed_short : sequence of str
        Cells (in lower case) that excuse a row for having fewer values than the others.

    Raises
    ------
    MeasurementError
        If the file cannot be read or is no table.
    """
    source = str(path) if dialect.sheet is None else f"{path}!{dialect.sheet}"
    lines = text_lines(source, dialect.encoding)
    unmarked = [(k, text) for k, text in enumerate(lines, 1) if not SIMULATED.match(text)]
    rows = [(k, text) for k, text in unmarked[dialect.skip_rows :] if text.strip()]
    simulated = len(unmarked) < len(lines)
    if dialect.comment:
        rows = [(k, text) for k, text in rows if not text.lstrip().startswith(dialect.comments)]
    titles = dialect.title_rows + dialect.units_row if dialect.header else 0
    if len(rows) < 1 + titles:
        content = "a header and rows" if dialect.header else "rows"
        raise MeasurementError(
            f"expected {content} after {dialect.skip_rows} skipped rows, found {len(rows)} rows", file=source
        )
    separator = _separator(dialect, [text for _, text in rows[:50]])
    if separator == BLANKS or dialect.delimiter == "fixed":
        rows = list(zip((k for k, _ in rows), with_units([text for _, text in rows]), strict=True))
    if dialect.delimiter == "fixed":
        if not dialect.starts:
            raise MeasurementError(
                "expected file.starts, where the columns begin, for file.delimiter: fixed", file=source
            )
        rows = [(k, "\t".join(cut(text, dialect.starts))) for k, text in rows]
        separator = "\t"
    header_line = rows[0][0]
    names = None
    if dialect.header:
        names = _names(rows[:titles], separator, dialect, len(fields_of(rows[titles][1], separator)))
    rows = rows[titles:]
    width = max(len(names or ()), len(fields_of(rows[0][1], separator)))
    if width > MOST_COLUMNS:
        raise MeasurementError(f"expected at most {MOST_COLUMNS} columns, found {width}", file=source, row=rows[0][0])
    lines = [text for _, text in rows]
    cells = _cells(lines, np.array([k for k, _ in rows]), separator, width, source)
    if names is not None:
        names += [""] * (width - len(names))
    _refuse_short_rows(cells, lines, separator, source, allowed_short)
    cells = _named_columns(cells, names, source)
    header = None if names is None else tuple(names[: cells.shape[1]])
    if dialect.thousands:
        cells = cells.map(lambda cell: without_thousands(cell, dialect.thousands, dialect.decimal))
    cells, header, units = _undressed(cells, header)
    if dialect.axis is not None:
        table = TextTable(source, cells, header, header_line, dialect.decimal, units)
        cells, header, units = _in_one_row(table, dialect.axis)
    alone = separator == "," and dialect.decimal == "auto"
    return TextTable(source, cells, header, header_line, "." if alone else dialect.decimal, units, simulated)


def with_units(lines: Sequence[str]) -> Sequence[str]:
    """Lines in which units follow their numbers without a blank; all else stays where it is."""
    if _BLANK_UNIT.search("\n".join(lines)) is None:
        return lines
    return [_WITH_UNIT.sub(r"\2\1\3", line) for line in lines]


def without_thousands(cell: str, mark: str, decimal: str) -> str:
    """A number without marks between its thousands, ``1,234.5``; other cells as they are."""
    point = "," if decimal == "," else "."
    bare = cell.replace("\u2019", "'")
    if mark not in bare or mark == point:
        return cell
    dressed = _DRESSED.fullmatch(bare)
    number = dressed[2] if dressed else bare
    if re.fullmatch(rf"[+-]?\d{{1,3}}(?:{re.escape(mark)}\d{{3}})+(?:{re.escape(point)}\d*)?", number):
        return bare.replace(number, number.replace(mark, ""))
    return cell


def _undressed(
    cells: pd.DataFrame, names: tuple[str, ...] | None
) -> tuple[pd.DataFrame, tuple[str, ...] | None, dict[int, str]]:
    """Cells without the name and the unit that stand in each cell of a column; names and units."""
    units: dict[int, str] = {}
    titles = [""] * cells.shape[1]
    undressed: dict[int, pd.Series] = {}
    for k in range(cells.shape[1]):
        column = cells[k]
        parted = [match for cell in column.iloc[:50] if (match := _DRESSED.fullmatch(cell))]
        if not any((match[1] or match[3]) and _DIGITS.fullmatch(match[2]) for match in parted):
            continue
        pieces = column.str.extract(f"^(?:{_DRESSED.pattern})$", flags=re.IGNORECASE).fillna("")
        is_number = pieces[1].str.fullmatch(_DIGITS).to_numpy(dtype=bool)
        counts = is_number & ~column.isin(["0", "0.0", "0,0"]).to_numpy()  # marks of lost points
        names_of, units_of = (set(pieces.loc[counts, group].str.casefold()) for group in (0, 2))
        if len(names_of) != 1 or len(units_of) != 1 or names_of | units_of == {""}:
            continue
        titles[k], unit = (pieces.loc[counts, group].iloc[0] for group in (0, 2))
        if names is not None and titles[k]:
            continue
        dressed = is_number | (pieces[0].str.casefold().isin(names_of).to_numpy() & bool(titles[k]))
        if unit:
            units[k] = str(unit_of(unit))
        undressed[k] = column.where(~dressed, pieces[1])
    if undressed:
        cells = cells.copy()
        for k, column in undressed.items():
            cells[k] = column
    return cells, tuple(titles) if names is None and any(titles) else names, units


def _in_one_row(table: TextTable, axis: Column) -> tuple[pd.DataFrame, tuple[str, ...] | None, dict[int, str]]:
    """Three rows of a point, one an axis, as one; columns that are the same in all three stand there once."""
    at = table.find(axis, "the axis")
    said = table.cells[at].str.casefold().to_numpy()
    if len(said) % 3 or not (said.reshape(-1, 3) == AXES).all():
        wrong = np.flatnonzero(said != np.resize(AXES, len(said)))
        row = int(wrong[0]) if len(wrong) else len(said) - 1
        raise table.fault(
            f"expected the axis {AXES[row % 3].upper()}, found {short(table.cells[at].iloc[row])!r}", row, at
        )
    columns: list[pd.Series] = []
    names: list[str] = []
    units: dict[int, str] = {}
    for k in range(table.width):
        three = [table.cells[k].iloc[j::3].to_numpy() for j in range(3)]
        if k == at:
            continue
        same = all((three[0] == other).all() for other in three[1:])
        for j in range(1 if same else 3):
            if k in table.units:
                units[len(columns)] = table.units[k]
            columns.append(pd.Series(three[j], index=table.cells.index[::3]))
            bare, unit = without_unit(table.label(k))
            title = f"{bare} {AXES[j].upper()}" + (f" [{unit}]" if unit else "")
            names.append(table.label(k) if same else title)
    return pd.concat(dict(enumerate(columns)), axis=1), tuple(names), units


def titles_of(text: str, separator: str, width: int) -> list[str]:
    """Names of columns in a line; where blanks separate them and stand in them, two part them if that fits better."""
    text = TITLE_MARK.sub("", text)
    names = [name.strip() for name in fields_of(text, separator)]
    if separator == BLANKS and len(names) != width:
        parted = re.split(r"\s{2,}", text.strip())
        names = parted if len(parted) == width else names
    return names


def _names(rows: Sequence[tuple[int, str]], separator: str, dialect: Dialect, width: int) -> list[str]:
    """Names of the columns: titles one above the other, and units in brackets."""
    cells = [titles_of(line, separator, width) for _, line in rows]
    units = cells.pop() if dialect.units_row else []
    width = max(map(len, cells))
    cells = [row + [""] * (width - len(row)) for row in cells]
    for upper in cells[:-1]:  # a title above others holds until the next one
        for k in range(1, width):
            upper[k] = upper[k] or (upper[k - 1] if cells[-1][k] else "")
    names = [" ".join(dict.fromkeys(text for text in column if text)) for column in zip(*cells, strict=True)]
    for k, unit in enumerate(units[:width]):
        unit = unit.strip("[]() ")
        if unit and unit_of(unit) and without_unit(names[k])[1] is None:
            names[k] = f"{names[k]} [{unit}]"
    return names


def cut(line: str, starts: Sequence[int]) -> list[str]:
    """Cells of a line of fixed columns."""
    line = line.expandtabs()
    return [line[start:end].strip() for start, end in zip(starts, [*starts[1:], None], strict=True)]


def unit_of(text: str) -> str | None:
    """A unit by one of its spellings."""
    return next((unit for unit, spellings in UNITS.items() if text.casefold() in spellings), None)


def _separator(dialect: Dialect, lines: Sequence[str]) -> str:
    if dialect.delimiter != "auto":
        return {"tab": "\t", "space": BLANKS}.get(dialect.delimiter, dialect.delimiter)
    for mark in CANDIDATES:  # half of the lines will do: a lost point may be one word alone
        if 2 * sum(mark in text for text in lines) > len(lines) and not (mark == "," and dialect.decimal == ","):
            return BLANKS if mark == "\t" and _blanks_too(lines) else mark
    return BLANKS if 2 * sum(len(text.split()) > 1 for text in lines) > len(lines) else ","


def _blanks_too(lines: Sequence[str]) -> bool:
    """Whether blanks separate as tabs do: only then have all lines as many values."""
    by_tabs, by_both = (
        {len(cells) for cells in split} for split in ([x.split("\t") for x in lines], [x.split() for x in lines])
    )
    return len(by_tabs) > 1 and len(by_both) == 1


def fields_of(line: str, separator: str) -> list[str]:
    """Cells of a line."""
    if separator == BLANKS:
        line, separator = " ".join(line.split()), " "
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:  # a cell beyond 131,072 characters
        raise MeasurementError(f"not a table: {error}") from None


def _cells(lines: Sequence[str], numbers: IntArray, separator: str, width: int, source: str) -> pd.DataFrame:
    """Cells of lines as a table whose index is the lines' numbers."""
    first = (" " if separator == BLANKS else separator).join(map(str, range(width)))  # sets the width
    text = "\n".join([first, *lines])
    cells = split_cells(text, source, [0, *numbers], sep=separator, skipinitialspace=True).iloc[1:]
    if len(cells) != len(numbers):
        raise MeasurementError(
            "expected quotes to end in the row where they begin, found some that do not", file=source
        )
    cells.index = numbers
    if re.search(r"[^\S\n]", text):
        for k in cells.columns:
            cells[k] = cells[k].str.strip()
    return cells


def _refuse_short_rows(
    cells: pd.DataFrame, lines: Sequence[str], separator: str, source: str, excuses: Collection[str]
) -> None:
    """Refuse rows with fewer values than the others, but for lost points: a shift of columns must not pass for one."""
    width = cells.shape[1]
    for row in np.flatnonzero((cells.iloc[:, -1] == "").to_numpy()).tolist():
        count = len(fields_of(lines[row], separator))
        if count < width and not any(cell.lower() in excuses for cell in cells.iloc[row]):
            raise MeasurementError(
                f"expected {width} values, found {count} (lines before the table are left out by "
                "file.skip_rows, others by file.comment)",
                file=source,
                row=int(cells.index[row]),
            )


def _named_columns(cells: pd.DataFrame, names: Sequence[str] | None, source: str) -> pd.DataFrame:
    """Cells without empty columns at the end that have no name, as separators at the lines' ends make them."""
    width = cells.shape[1]
    while width > 1 and not (names and names[width - 1]) and (cells[width - 1] == "").all():
        width -= 1
    if names is not None and not names[width - 1]:
        row = cells.index[(cells[width - 1] != "").to_numpy()][0]
        raise MeasurementError(
            f"expected {width - 1} values as the header has names, found more", file=source, row=int(row)
        )
    return cells.iloc[:, :width]


def _folded(name: str) -> str:
    return " ".join(name.casefold().split())


def without_unit(name: str) -> tuple[str, str | None]:
    """A header's name without a unit in brackets at its end, and the unit if it is a known one."""
    match = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]", name[:200])
    if not match:
        return name, None
    return match[1], unit_of(match[2])
