"""Foreign files: text, workbooks and archives to cells with their lines, and columns understood by a map.

What stands in a workbook or an archive is addressed by the file's name, ``!`` and the name inside: ``a.xlsx!Sheet1``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import BytesIO, StringIO
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn, TypeAlias, overload

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement.columns import POSITION, QUATERNION, in_degrees, split_cells
from irbcal.measurement.imports.column_map import RESERVED, Column, Dialect, ImportMap, pattern_regex
from irbcal.safe_files import read_bytes, zip_archive, zip_member
from irbcal.units import DEG, MM

LARGEST_FILE = 200 * 10**6
"""Bytes of a file."""
MOST_COLUMNS = 2000
MOST_MEMBERS = 1000
"""Files of an archive, sheets of a workbook."""
WORKBOOKS, ARCHIVES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), (".zip",)
MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
OLDER_CODECS = ("cp1252", "gbk", "shift_jis", "euc_kr", "big5", "cp1251", "cp1250")
"""Encodings of files of older programs, the likelier first."""
TITLE_MARK = re.compile(r"^\s*(?://|#|%)\s*(?=\w)")
"""A mark of a comment before the titles of columns."""
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
_COMMA_NUMBER = re.compile(r"[+-]?(?:\d+|\d{1,3}(?:\.\d{3})+),\d+")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
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
            bare = _without_unit(name)[0]
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
        listed = ", ".join(short(name) for name in self.names[:40])
        raise self.header_fault(f"there is no column {column!r} for {use}; found {listed}")

    def check_unit(self, k: int, declared: str | None, key: str) -> None:
        """Refuse a unit in the header's brackets that is not the declared one."""
        name = self.names[k] if self.names else ""
        unit = _without_unit(name)[1] or self.units.get(k)
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


def short(text: str, limit: int = 40) -> str:
    """A cell for messages."""
    return text if len(text) <= limit else text[:limit] + "…"


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
    rows = [(k, line) for k, line in enumerate(lines, 1) if k > dialect.skip_rows and line.strip()]
    if dialect.comment:
        rows = [(k, line) for k, line in rows if not line.lstrip().startswith(dialect.comments)]
    titles = dialect.title_rows + dialect.units_row if dialect.header else 0
    if len(rows) < 1 + titles:
        content = "a header and rows" if dialect.header else "rows"
        raise MeasurementError(
            f"expected {content} after {dialect.skip_rows} skipped rows, found {len(rows)} rows", file=source
        )
    separator = _separator(dialect, [line for _, line in rows[:50]])
    if separator == BLANKS or dialect.delimiter == "fixed":
        rows = list(zip((k for k, _ in rows), with_units([line for _, line in rows]), strict=True))
    if dialect.delimiter == "fixed":
        if not dialect.starts:
            raise MeasurementError(
                "expected file.starts, where the columns begin, for file.delimiter: fixed", file=source
            )
        rows = [(k, "\t".join(cut(line, dialect.starts))) for k, line in rows]
        separator = "\t"
    header_line = rows[0][0]
    names = None
    if dialect.header:
        names = _names(rows[:titles], separator, dialect, len(_fields(rows[titles][1], separator)))
    rows = rows[titles:]
    width = max(len(names or ()), len(_fields(rows[0][1], separator)))
    if width > MOST_COLUMNS:
        raise MeasurementError(f"expected at most {MOST_COLUMNS} columns, found {width}", file=source, row=rows[0][0])
    lines = [line for _, line in rows]
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
    return TextTable(source, cells, header, header_line, "." if alone else dialect.decimal, units)


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
        parts = column.str.extract(f"^(?:{_DRESSED.pattern})$", flags=re.IGNORECASE).fillna("")
        is_number = parts[1].str.fullmatch(_DIGITS).to_numpy(dtype=bool)
        counts = is_number & ~column.isin(["0", "0.0", "0,0"]).to_numpy()  # marks of lost points
        names_of, units_of = (set(parts.loc[counts, part].str.casefold()) for part in (0, 2))
        if len(names_of) != 1 or len(units_of) != 1 or names_of | units_of == {""}:
            continue
        titles[k], unit = (parts.loc[counts, part].iloc[0] for part in (0, 2))
        if names is not None and titles[k]:
            continue
        dressed = is_number | (parts[0].str.casefold().isin(names_of).to_numpy() & bool(titles[k]))
        if unit:
            units[k] = str(unit_of(unit))
        undressed[k] = column.where(~dressed, parts[1])
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
            bare, unit = _without_unit(table.label(k))
            title = f"{bare} {AXES[j].upper()}" + (f" [{unit}]" if unit else "")
            names.append(table.label(k) if same else title)
    return pd.concat(dict(enumerate(columns)), axis=1), tuple(names), units


def titles_of(line: str, separator: str, width: int) -> list[str]:
    """Names of columns in a line; where blanks separate them and stand in them, two part them if that fits better."""
    line = TITLE_MARK.sub("", line)
    names = [name.strip() for name in _fields(line, separator)]
    if separator == BLANKS and len(names) != width:
        parted = re.split(r"\s{2,}", line.strip())
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
        if unit and unit_of(unit) and _without_unit(names[k])[1] is None:
            names[k] = f"{names[k]} [{unit}]"
    return names


def cut(line: str, starts: Sequence[int]) -> list[str]:
    """Cells of a line of fixed columns."""
    line = line.expandtabs()
    return [line[start:end].strip() for start, end in zip(starts, [*starts[1:], None], strict=True)]


def unit_of(text: str) -> str | None:
    """A unit by one of its spellings."""
    return next((unit for unit, spellings in UNITS.items() if text.casefold() in spellings), None)


def parts_of(path: str | PathLike[str]) -> list[str]:
    """What a file holds, as sources: the sheets of a workbook, the files of an archive; else the file itself.

    Raises
    ------
    MeasurementError
        If it cannot be read.
    """
    source = str(path)
    suffix = Path(source).suffix.lower()
    if suffix in WORKBOOKS:
        return [f"{source}!{name}" for name in _workbook(_bytes(source), source).sheet_names]
    if suffix in ARCHIVES:
        archive = zip_archive(_bytes(source), source, MeasurementError, LARGEST_FILE)
        members = [name for name in archive.namelist() if not name.endswith("/")]
        if len(members) > MOST_MEMBERS:
            raise MeasurementError(f"expected at most {MOST_MEMBERS} files, found {len(members)}", file=source)
        return [part for name in members for part in parts_of(f"{source}!{name}")]
    return [source]


def file_of(source: str | PathLike[str]) -> Path:
    """The file in which a source stands."""
    text = str(source)
    while "!" in text and not Path(text).exists():
        text = text.rpartition("!")[0]
    return Path(text if Path(text).exists() else str(source))


def text_lines(source: str, encoding: str = "auto") -> list[str]:
    """Lines of a text file; rows of a workbook's sheet with tabs between their cells.

    Raises
    ------
    MeasurementError
        If it cannot be read.
    """
    container, mark, sheet = source.rpartition("!")
    if mark and Path(container).suffix.lower() in WORKBOOKS and not Path(source).exists():
        return _sheet_lines(_workbook(_bytes(container), container), sheet, container)
    parts = [] if Path(source).suffix.lower() not in (*WORKBOOKS, *ARCHIVES) else parts_of(source)
    if len(parts) == 1:
        return text_lines(parts[0], encoding)
    if parts:
        names = ", ".join(short(part.rpartition("!")[2]) for part in parts[:20])
        raise MeasurementError(f"expected file.sheet, which names one of {names}", file=source)
    return _decode(_bytes(source), encoding, source)


def _workbook(data: bytes, source: str) -> Any:
    from python_calamine import CalamineError, CalamineWorkbook

    if data.startswith(b"PK"):
        zip_archive(data, source, MeasurementError, LARGEST_FILE)  # its size
    try:
        return CalamineWorkbook.from_filelike(BytesIO(data))
    except (CalamineError, ValueError, OSError) as error:
        raise MeasurementError(f"not a workbook: {' '.join(str(error).split())}", file=source) from None


def _sheet_lines(workbook: Any, sheet: str, source: str) -> list[str]:
    if sheet not in workbook.sheet_names:
        raise MeasurementError(
            f"expected a sheet of {', '.join(map(short, workbook.sheet_names[:20]))}, found {short(sheet)!r}",
            file=source,
        )
    text = StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    cells = workbook.get_sheet_by_name(sheet).to_python(skip_empty_area=False)
    flat = [cell for row in cells for cell in row]
    commas = [cell.strip() for cell in flat if isinstance(cell, str) and _COMMA_NUMBER.fullmatch(cell.strip())]
    # beside numbers, a text such as 1234,5 is a number, too; 1,234 alone could be thousands
    as_numbers = any(type(cell) in (int, float) for cell in flat) and not all(map(_THOUSANDS.fullmatch, commas))
    for row in cells:
        texts = [" ".join(_cell_text(cell).split()) for cell in row]
        if as_numbers:
            texts = [t.replace(".", "").replace(",", ".") if _COMMA_NUMBER.fullmatch(t) else t for t in texts]
        writer.writerow(texts)
    return text.getvalue().split("\n")


def _cell_text(cell: Any) -> str:
    """A workbook's cell: numbers as Python writes them, whole ones without a point."""
    if isinstance(cell, float) and not isinstance(cell, bool):
        return str(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    return str(cell)


def _bytes(source: str) -> bytes:
    """Content of a file, or of one in an archive."""
    container, mark, member = source.rpartition("!")
    if mark and not Path(source).exists() and Path(container.rpartition("!")[0] or container).suffix:
        archive = zip_archive(_bytes(container), container, MeasurementError, LARGEST_FILE)
        data = zip_member(archive, member, source, MeasurementError)
    else:
        data = read_bytes(Path(source), MeasurementError, limit_bytes=LARGEST_FILE)
    if not data.strip():
        raise MeasurementError("the file is empty, expected rows", file=source)
    return data


def encoding_of(data: bytes, words: Collection[str] = ()) -> str:
    """The encoding of a text: what a mark says, UTF-16 by its zeros, UTF-8, else the likeliest of older ones.

    Parameters
    ----------
    data : bytes
    words : collection of str
        Words that are likely; the encoding in which most of them stand is taken.
    """
    codec = next((codec for mark, codec in MARKS if data.startswith(mark)), None)
    if codec is not None:
        return codec
    start = data[:100_000]
    zeros = np.frombuffer(start[: len(start) // 2 * 2], dtype=np.uint8).reshape(-1, 2) == 0
    if len(zeros) and zeros.any():
        share = zeros.mean(axis=0)
        return "utf-16-le" if share[1] > share[0] else "utf-16-be"
    try:
        data.decode("utf-8")
        return "utf-8"
    except UnicodeDecodeError:
        pass
    counts: dict[str, int] = {}
    for codec in OLDER_CODECS:
        try:
            text = data.decode(codec).casefold()
        except UnicodeDecodeError:
            continue
        counts[codec] = sum(word in text for word in words if not word.isascii())
    best = max(counts, key=lambda codec: counts[codec], default="latin-1")
    if counts.get(best):
        return best
    from charset_normalizer import from_bytes

    match = from_bytes(start, cp_isolation=list(counts) or None).best()
    return best if match is None else str(match.encoding)


def _decode(data: bytes, encoding: str, source: str) -> list[str]:
    """Lines of a file."""
    marked = next((codec for mark, codec in MARKS if data.startswith(mark)), None)
    codec = marked or ("utf-8" if encoding == "auto" else encoding)
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        name = codec.removesuffix("-sig")
        hint = "; older Windows programs write latin-1 or cp1252" if codec == "utf-8" else ""
        raise MeasurementError(
            f"expected text in {name} (file.encoding), found other bytes{hint}", file=source, row=line
        ) from None
    strange = re.search(r"[\x00-\x08\x0e-\x1f]", text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        raise MeasurementError("expected a text file, found binary data", file=source, row=line)
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _separator(dialect: Dialect, lines: Sequence[str]) -> str:
    if dialect.delimiter != "auto":
        return {"tab": "\t", "space": BLANKS}.get(dialect.delimiter, dialect.delimiter)
    for mark in CANDIDATES:  # half of the lines will do: a lost point may be one word alone
        if 2 * sum(mark in line for line in lines) > len(lines) and not (mark == "," and dialect.decimal == ","):
            return BLANKS if mark == "\t" and _blanks_too(lines) else mark
    return BLANKS if 2 * sum(len(line.split()) > 1 for line in lines) > len(lines) else ","


def _blanks_too(lines: Sequence[str]) -> bool:
    """Whether blanks separate as tabs do: only then have all lines as many values."""
    by_tabs, by_both = (
        {len(cells) for cells in split} for split in ([x.split("\t") for x in lines], [x.split() for x in lines])
    )
    return len(by_tabs) > 1 and len(by_both) == 1


def _fields(line: str, separator: str) -> list[str]:
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
        count = len(_fields(lines[row], separator))
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


def _without_unit(name: str) -> tuple[str, str | None]:
    """A header's name without a unit in brackets at its end, and the unit if it is a known one."""
    match = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]", name[:200])
    if not match:
        return name, None
    return match[1], unit_of(match[2])


LENGTH_MM = {"mm": 1.0, "m": 1.0 / MM, "inch": 25.4}
"""Millimetres of a length unit."""
ANGLE_DEG = {"deg": 1.0, "rad": 1.0 / DEG}
"""Degrees of an angle unit."""
TIME_S = {"s": 1.0, "ms": 1e-3}
ALWAYS_LOST = ("", "nan", "none", "null")
"""Cells that hold no number, in lower case."""
LONGEST_NAME = 100
"""Characters of a name that is taken apart."""
EXTRAS = {"u95": "u95_mm", "payload": "payload_kg"}
ROW, SOURCE = " row", " source"
"""Where each row comes from; no column of a file begins with a blank."""

_COMPACT = re.compile(r"^(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)[.,]?(\d{0,6})$")
"""A time stamp without marks: 20200714163904, with or without parts of a second."""


def _spaced(stamp: re.Match[str]) -> str:
    """A time stamp with marks."""
    year, month, day, hour, minute, second, fraction = stamp.groups()
    return f"{year}-{month}-{day} {hour}:{minute}:{second}{f'.{fraction}' if fraction else ''}"


Values: TypeAlias = dict[str, Any]
"""Columns of the output by name: arrays, or one value for all rows."""


class Declared(NamedTuple):
    """Units of a file as the map declares them; those of what the file does not hold do not matter."""

    lengths: str
    joints: str | Sequence[str]
    time: str


def declared_units(import_map: ImportMap, source: str) -> Declared:
    """Units that the map declares.

    Raises
    ------
    MeasurementError
        If it leaves open one that is needed.
    """
    columns, units = import_map.columns, import_map.units
    if units.lengths is None:
        undeclared(source, "the unit of the positions", "units.lengths=mm", "m or inch")
    if columns.joints and units.joints is None:
        undeclared(source, "the unit of the joints", "units.joints=deg", "rad, or a list with a unit for each joint")
    if columns.time is not None and units.time is None:
        undeclared(source, "the unit of the time", "units.time=s", "ms or iso")
    return Declared(units.lengths, units.joints or (), units.time or "")


class SourceFile:
    """One source file, understood column by column.

    Parameters
    ----------
    text : TextTable
    import_map : ImportMap
    targets_elsewhere : bool
        The joints file says what was measured.

    Raises
    ------
    MeasurementError
        If the file lacks a column of the map, holds something else in it, or needs what the map does not declare.
    """

    def __init__(self, text: TextTable, import_map: ImportMap, targets_elsewhere: bool = False) -> None:
        self.targets_elsewhere = targets_elsewhere
        self.map, self.units = import_map, declared_units(import_map, text.source)
        columns = import_map.columns
        triples: dict[str | None, Sequence[Column]] = {}
        if isinstance(columns.position, dict):
            triples.update(columns.position)
        else:
            triples[None] = columns.position
        self.positions = [[text.find(name, "the position") for name in triple] for triple in triples.values()]
        self.target_names = list(triples)
        self.joints = [text.find(name, f"joint {k}") for k, name in enumerate(columns.joints or (), 1)]
        self.programmed = self._programmed(text)
        numeric = [k for position in (self.joints, self.programmed, *self.positions) for k in position]
        double = [text.label(k) for k in numeric if numeric.count(k) > 1]
        if double:
            raise MeasurementError(
                f"columns: expected each column of joints and positions once, found {double[0]!r} again",
                file=text.source,
            )
        self.taken = set(numeric)
        self.table = text
        self.orientation = self._several(columns.orientation, "orientation")
        self.table = text.with_decimal([*numeric, *(self.orientation or ())])
        self.source = text.source
        self.file_fields = self._from_file_name()
        """What the file's name says (target, group, pose, cycle)."""

    def _programmed(self, text: TextTable) -> list[int]:
        """Places of the programmed joints; none where the map has none, or the file where they are optional."""
        columns, optional = self.map.columns.programmed or (), self._optional("programmed")
        indices = [text.find(name, f"programmed joint {k}", optional) for k, name in enumerate(columns, 1)]
        present = [k for k in indices if k is not None]
        return present if len(present) == len(indices) else []

    def frame(self, number: int) -> pd.DataFrame:
        """Rows of the output; ``number`` poses were counted before this file."""
        rows = len(self.table.cells)
        shared: Values = {
            SOURCE: self.source,
            ROW: self.table.lines,
            "pose": (np.arange(rows) + number + 1).astype(str),
        }
        shared |= self._names()
        shared |= self._joint_values() | self._extras()
        frames = []
        for name, columns in zip(self.target_names, self.positions, strict=True):
            target = {"target": name} if name is not None else {}
            frames.append(pd.DataFrame(shared | target | self._pose_values(columns), index=range(rows)))
        # targets that share a row stay together
        return pd.concat(frames).sort_index(kind="stable") if len(frames) > 1 else frames[0]

    def _optional(self, key: str) -> bool:
        return key in self.map.columns.optional

    def _one(self, column: Column | None, key: str) -> int | None:
        """Place of a column, None if there is none; an optional one that is taken for another purpose is not there."""
        if column is None:
            return None
        k = self.table.find(column, f"the {key}", self._optional(key))
        if k in self.taken and self._optional(key):
            return None
        return k

    def _several(self, columns: Sequence[Column] | None, key: str) -> list[int] | None:
        if columns is None:
            return None
        indices = [self.table.find(column, f"the {key}", self._optional(key)) for column in columns]
        present = [k for k in indices if k is not None]
        if len(present) < len(indices) or (self._optional(key) and self.taken.intersection(present)):
            return None
        _check_orientation(self.map, self.table.source, len(present))
        self.taken |= set(present)
        return present

    def _from_file_name(self) -> dict[str, str]:
        pattern = self.map.file_name
        if pattern is None:
            return {}
        stem = Path(self.source).stem
        return take_apart(pd.Series([stem]), [pattern], self.source).iloc[0].to_dict()

    def _names(self) -> Values:
        """Pose, target, group and cycle as columns or names say."""
        columns, fixed = self.map.columns, {"target": self.map.fixed.target, "group": self.map.fixed.group}
        out: Values = {name: value for name, value in fixed.items() if value is not None} | self.file_fields
        if columns.name:
            columns_text = [self.table.text(self.table.find(name, "the name")) for name in columns.name]
            joined = columns_text[0].str.cat(columns_text[1:], sep="::") if len(columns_text) > 1 else columns_text[0]
            fields = take_apart(joined, self.map.names, self.source, self.table.lines)
            out |= {name: fields[name].to_numpy() for name in fields.columns}
        for key in ("pose", "target", "group", "cycle"):
            k = self._one(getattr(columns, key), key)
            if k is not None:
                out[key] = self._full(k, key) if key in ("pose", "target") else self.table.text(k).to_numpy()
        if "target" not in out and self.target_names == [None] and not self.targets_elsewhere:
            undeclared(self.source, "the target", "fixed.target=smr1", "another name")
        return out

    def _full(self, k: int, key: str) -> NDArray[Any]:
        """A column in which every row must have a name."""
        text = self.table.text(k)
        if (text == "").any():
            row = int(np.flatnonzero(text == "")[0])
            raise self.table.fault(f"expected the name of a {key}, found nothing", row, k)
        return text.to_numpy()

    def _joint_values(self) -> dict[str, FloatArray]:
        if not self.joints:
            return {}
        values = joint_values(self.table, self.joints, self.units.joints)
        return values | joint_values(self.table, self.programmed, self.units.joints, "c") if self.programmed else values

    def _pose_values(self, columns: Sequence[int]) -> dict[str, FloatArray]:
        """Position and orientation of one target, NaN where lost."""
        out: dict[str, FloatArray] = {}
        unit = self.units.lengths
        empty = [self._is_marker(k) for k in columns]
        lost = np.any(empty, axis=0) | self._bad_status()
        for name, k, gap in zip(POSITION, columns, empty, strict=True):
            self.table.check_unit(k, unit, "lengths in")
            absent = gap | lost if self.map.lost.status else gap
            values = self.table.numbers(k, f"a position in {unit} or a mark of a lost point", absent)
            out[name] = values * LENGTH_MM[unit]
        lost |= np.all([values == 0.0 for values in out.values()], axis=0)
        for values in out.values():
            values[lost] = np.nan
        if self.orientation is not None:
            quaternion = self._quaternions(self.orientation, lost)
            out |= dict(zip(QUATERNION, quaternion.T, strict=True))
        return out

    def _is_marker(self, k: int) -> BoolArray:
        """Rows whose cell in a column says that the point is lost, as text or as number."""
        markers = self.map.lost.markers
        numbers = [float(value) for value in markers if not isinstance(value, str)]
        return self.table.is_one_of(k, [*ALWAYS_LOST, *self.map.lost_texts], numbers)

    def _bad_status(self) -> BoolArray:
        status = self.map.lost.status
        if status is None:
            return np.zeros(len(self.table.cells), dtype=bool)
        text = self.table.text(self.table.find(status.column, "the status"))
        return ~text.str.lower().isin([str(value).strip().lower() for value in status.good]).to_numpy()

    def _quaternions(self, columns: Sequence[int], lost: BoolArray) -> FloatArray:
        """Unit quaternions, scalar first, shape (rows, 4); NaN where lost or absent."""
        from scipy.spatial.transform import Rotation

        convention = self.map.orientation
        absent = np.any([self._is_marker(k) for k in columns], axis=0) | lost
        angles = "rad" if convention.kind == "ur" else self.map.units.angles
        if convention.kind not in ("quaternion", "matrix"):
            for k in columns:
                self.table.check_unit(k, angles, "angles in")
        numbers = {"quaternion": "a quaternion's number", "matrix": "a number of a rotation matrix"}
        expected = numbers.get(convention.kind or "", f"an angle in {angles}")
        values = np.column_stack([self.table.numbers(k, expected, absent) for k in columns])
        out = np.full((len(values), 4), np.nan)
        have = ~absent
        if not have.any():
            return out
        values = values[have]
        if convention.kind == "matrix":
            rotation = Rotation.from_matrix(self._rotations(columns, values.reshape(-1, 3, 3), np.flatnonzero(have)))
        elif convention.kind == "quaternion":
            self._check_unit_length(columns, values, np.flatnonzero(have))
            rotation = Rotation.from_quat(values if convention.scalar == "last" else np.roll(values, -1, axis=1))
        else:
            radians = values * (ANGLE_DEG[angles or "rad"] * DEG)
            if convention.kind == "euler":
                axes = convention.axes or ""
                rotation = Rotation.from_euler(axes.upper() if convention.about == "moving" else axes, radians)
            else:
                rotation = Rotation.from_rotvec(radians)
        if convention.maps == "tracker-to-target":
            rotation = rotation.inv()
        out[have] = np.roll(rotation.as_quat(canonical=True), 1, axis=1)
        return out

    def _rotations(self, columns: Sequence[int], values: FloatArray, rows: IntArray) -> FloatArray:
        """Rotation matrices as read, (n, 3, 3), refused where they are none."""
        off = np.abs(values @ values.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        bad = (off > 2e-3) | (np.linalg.det(values) < 0)
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            problem = (
                "a left-handed one"
                if off[k] <= 2e-3
                else f"rows that are no unit vectors at right angles ({off[k]:.2g})"
            )
            raise self.table.fault(f"expected a rotation matrix, found {problem}", rows[k], *columns)
        return values

    def _check_unit_length(self, columns: Sequence[int], values: FloatArray, rows: IntArray) -> None:
        norm = np.linalg.norm(values, axis=1)
        bad = np.abs(norm - 1.0) > 1e-3
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            numbers = ", ".join(f"{value:g}" for value in values[k])
            raise self.table.fault(f"expected a unit quaternion, found {numbers}", rows[k], *columns)

    def _extras(self) -> Values:
        """Uncertainty, payload, time and the columns that are kept."""
        columns = self.map.columns
        fixed = {"u95_mm": self.map.fixed.u95_mm, "payload_kg": self.map.fixed.payload_kg}
        out: Values = {name: value for name, value in fixed.items() if value is not None}
        for key, name in EXTRAS.items():
            k = self._one(getattr(columns, key), key)
            if k is not None:
                values = self.table.numbers(k, "a number or nothing", self._is_marker(k))
                if key == "u95":
                    self.table.check_unit(k, self.units.lengths, "lengths in")
                    values = values * LENGTH_MM[self.units.lengths]
                out[name] = values
        k = self._one(columns.time, "time")
        if k is not None:
            out["time_s"] = self._time(k)
        for name, column in columns.keep.items():
            out[name] = self._kept(self.table.find(column, name))
        if columns.others and self.table.names:
            used = self.taken | self._used()
            names = enumerate(self.table.names)
            out |= {name: self._kept(k) for k, name in names if k not in used and name and name not in RESERVED}
        return out

    def _used(self) -> set[int]:
        """Places of all columns that the map names beside those of numbers."""
        columns, status = self.map.columns, self.map.lost.status
        keys = [getattr(columns, key) for key in ("pose", "target", "group", "cycle", "time", "u95", "payload")]
        keys += [*(columns.name or ()), *columns.keep.values(), *([] if status is None else [status.column])]
        indices = (self.table.find(column, "a use", True) for column in keys if column is not None)
        return {k for k in indices if k is not None}

    def _time(self, k: int) -> FloatArray:
        text, unit = self.table.text(k), self.units.time
        absent = self.table.is_one_of(k, ALWAYS_LOST)
        if unit != "iso":
            return self.table.numbers(k, f"a time in {unit} or nothing", absent) * TIME_S[unit]
        text = text.str.replace(_COMPACT, _spaced, regex=True)
        when = pd.to_datetime(text.where(~absent), errors="coerce", format="ISO8601", utc=True)
        bad = when.isna().to_numpy() & ~absent
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            expected = "a time such as 2024-05-31 14:03:07.5 or nothing"
            raise self.table.fault(f"expected {expected}, found {short(text.iloc[row])!r}", row, k)
        return (when - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy()

    def _kept(self, k: int) -> NDArray[Any]:
        """A column handed on: numbers with a decimal point if all its cells are numbers, else the text."""
        text = self.table.text(k)
        try:
            return self.table.numbers(k, "a number", (text == "").to_numpy())
        except MeasurementError:
            return text.to_numpy()


def take_apart(names: pd.Series, patterns: Sequence[str], source: str, rows: IntArray | None = None) -> pd.DataFrame:
    """Fields of names by the first pattern that fits all of them, else each name by the first that fits it.

    Parameters
    ----------
    names : Series of str
    patterns : sequence of str
        Such as ``{pose}_{target}``.
    source : str
        File name for messages.
    rows : ndarray of int, optional
        Rows of the names for messages; without them the name is the file's own.

    Returns
    -------
    DataFrame
        A column for each field.

    Raises
    ------
    MeasurementError
        For a name that no pattern fits or that is too long.
    """

    def refusal(k: int, expected: str) -> MeasurementError:
        name, row = short(names.iloc[k]), None if rows is None else int(rows[k])
        return MeasurementError(
            f"{'file name: ' if rows is None else ''}expected {expected}, found {name!r}", file=source, row=row
        )

    names = names.astype(object)
    long = (names.str.len() > LONGEST_NAME).to_numpy(dtype=bool)
    worst = int(long.argmax())
    if long.any():
        raise refusal(worst, f"a name of at most {LONGEST_NAME} characters")
    regexes = [re.compile(pattern_regex(pattern)) for pattern in patterns]
    fits = np.column_stack([names.str.fullmatch(regex).to_numpy(dtype=bool) for regex in regexes])
    if not fits.any(axis=1).all():
        raise refusal(int(np.flatnonzero(~fits.any(axis=1))[0]), f"a name such as {' or '.join(patterns)}")
    all_fit = fits.all(axis=0)
    chosen = np.full(len(names), int(all_fit.argmax())) if all_fit.any() else fits.argmax(axis=1)
    parts = []
    for k in np.unique(chosen):
        fields_read = names[chosen == k].str.extract(regexes[k])
        by_number = {number: name for name, number in regexes[k].groupindex.items()}
        fields_read.columns = [by_number.get(number) for number in range(1, regexes[k].groups + 1)]
        parts.append(fields_read[list(by_number.values())])
    return pd.concat(parts).loc[names.index]


def joint_values(
    text: TextTable, columns: Sequence[int], units: str | Sequence[str], letter: str = "q"
) -> dict[str, FloatArray]:
    """Joint columns of a file in degrees and mm, dict of name to values; those of programmed joints begin with c."""
    units = [units] * len(columns) if isinstance(units, str) else units
    if len(units) != len(columns):
        raise MeasurementError(
            f"units.joints: expected one unit or {len(columns)}, one for each joint, found {len(units)}",
            file=text.source,
        )
    out = {}
    for number, (k, unit) in enumerate(zip(columns, units, strict=True), 1):
        if text.names and in_degrees(text.names[k]) != text.names[k]:  # q1_rad says its unit itself
            unit = "rad"
        text.check_unit(k, unit, "joints in")
        turns = unit in ANGLE_DEG
        quantity = "a joint angle" if turns else "a joint's travel"
        factor = ANGLE_DEG[unit] if turns else LENGTH_MM[unit]
        out[f"{letter}{number}_{'deg' if turns else 'mm'}"] = text.numbers(k, f"{quantity} in {unit}") * factor
    return out


def _check_orientation(import_map: ImportMap, source: str, count: int) -> None:
    """Refuse an orientation whose convention is not declared."""
    convention = import_map.orientation
    title = "the orientation"
    if convention.kind is None:
        undeclared(
            source,
            f"what the {count} orientation columns mean",
            "orientation.kind=euler",
            "quaternion, rotation-vector, ur or matrix; --set columns.orientation=null leaves them out",
        )
    if convention.kind == "quaternion" and convention.scalar is None:
        undeclared(source, f"{title}'s order of numbers", "orientation.scalar=first", "last")
    if convention.kind == "euler" and convention.axes is None:
        undeclared(source, f"{title}'s order of turns", "orientation.axes=xyz", "another order")
    if convention.kind == "euler" and convention.about is None:
        undeclared(source, f"{title}'s axes", "orientation.about=moving", "fixed")
    if convention.kind in ("euler", "rotation-vector") and import_map.units.angles is None:
        undeclared(source, f"{title}'s unit", "units.angles=deg", "rad")
    count_expected = {"quaternion": 4, "matrix": 9}.get(convention.kind or "", 3)
    if count != count_expected:
        raise MeasurementError(
            f"columns.orientation: expected {count_expected} columns for {convention.kind}, found {count}", file=source
        )


def undeclared(source: str, subject: str, example: str, choices: str) -> NoReturn:
    """Refuse what the map leaves open, with an example of how to say it."""
    raise MeasurementError(
        f"expected {subject} to be declared in the map (--set {example}; or {choices}), found nothing: "
        "it is not guessed",
        file=source,
        parameter=example.partition("=")[0],
    )
