"""Where tables stand in files of other programs: encoding, delimiter, marks of numbers, titles, units, other lines."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement import text_files
from irbcal.measurement.imports import tables
from irbcal.measurement.imports.column_map import Dialect, validated
from irbcal.measurement.imports.header_words import KNOWN_WORDS, WORD_SETS, folded
from irbcal.measurement.imports.tables import BLANKS, TextTable

_PLAIN = {mark: re.compile(rf"[+-]?(?:\d+(?:\{mark}\d*)?|\{mark}\d+)(?:[eE][+-]?\d+)?") for mark in ".,"}

_DRESSED = {
    mark: re.compile(rf"(?:[^\W\d]\w{{0,20}}\s*=\s*)?{number.pattern}(?:\s*(?:{tables.UNIT}))?", re.IGNORECASE)
    for mark, number in _PLAIN.items()
}

FEWEST_ROWS = 4

SAMPLE = 1000
"""Lines of a file that tell its delimiter and decimal mark: so many first ones, and as many all over it; all of them
where less than half of these are rows."""


def _is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number, also as ``X=12.5`` or ``12.5 mm``."""
    if _PLAIN[decimal].fullmatch(cell):
        return True
    return (cell[-1:].isalpha() or cell[-1:] in '°"' or "=" in cell) and bool(_DRESSED[decimal].fullmatch(cell))


def _numbers_in(row: Sequence[str], decimal: str) -> int:
    return sum(_is_number(cell, decimal) for cell in row)


@dataclass(frozen=True)
class Sheet:
    """One table of a file."""

    source: str
    layout: dict[str, Any]
    """`Dialect` as keys and values."""
    table: TextTable
    preamble: tuple[str, ...]
    """Lines before it."""
    left_out: tuple[str, ...]
    """Lines in and behind it that are none of its rows."""


def sheets(path: str | PathLike[str]) -> list[Sheet]:
    """The tables of a file, of a workbook's sheets, of an archive's files; what is no table is left out."""
    return [sheet for part in text_files.parts_of(path) if (sheet := _sheet(part)) is not None]


def _sheet(source: str) -> Sheet | None:
    container = source.rpartition("!")[0]
    of_workbook = Path(container).suffix.lower() in text_files.WORKBOOKS and not Path(source).exists()
    try:
        encoding = "auto" if of_workbook else text_files.encoding_of(text_files.source_bytes(source), KNOWN_WORDS)
        lines = [line for line in text_files.text_lines(source, encoding) if not tables.SIMULATED.match(line)]
    except MeasurementError:
        if source == str(text_files.file_of(source)):
            raise
        return None  # a picture in an archive
    layout: dict[str, Any] = {} if encoding in ("auto", "utf-8", "utf-8-sig", "utf-16") else {"encoding": encoding}
    cutting = _cutting(lines, of_workbook)
    if cutting is None:
        return None
    cells, layout_of_cells, width = cutting
    layout |= layout_of_cells
    if layout["delimiter"] == "space":  # titles may hold blanks
        cells = [
            tables.titles_of(line, BLANKS, width) if len(row) > width else row
            for line, row in zip(lines, cells, strict=True)
        ]
    decimal = layout["decimal"]
    texts = [[cell for cell in row if not _is_number(cell, decimal)] for row in cells]
    numeric = [len(row) - len(others) for row, others in zip(cells, texts, strict=True)]
    first = _first_row(cells, numeric, width)
    shapes = Counter(
        without_digits(row[0]) for row, count in zip(cells[first:], numeric[first:], strict=True) if count >= 3
    )
    is_row = [_is_row(row, width, count, shapes) for row, count in zip(cells, numeric, strict=True)]
    header, titles, units = _header(cells, first, width)
    no_rows = _no_rows(cells, numeric, is_row, first)
    marks = {_mark(cells[k], lines[k]) for k in no_rows}
    rows = [lines[k].lstrip() for k in range(first, len(cells)) if is_row[k]]
    marks = {mark for mark in marks if not any(row.startswith(mark) for row in rows)}
    layout["skip_rows"] = header if titles else first
    layout["header"] = bool(titles)
    layout |= {"title_rows": titles} if titles > 1 else {}
    layout |= {"units_row": True} if units else {}
    layout |= {"comment": sorted(marks)} if marks else {}
    comments = [lines[k].strip() for k in range(layout["skip_rows"]) if lines[k].strip()]
    # what stands in columns of numbers in place of them excuses a short row
    excuses = sorted({cell.lower() for row in texts[first:] for cell in row})[:200]
    table = tables.read(source, validated(Dialect, layout, source), excuses)
    axis = next((k for k in range(table.width) if _names_axes(table.cells[k].str.casefold())), None)
    if axis is not None:
        layout["axis"] = table.key(axis)
        table = tables.read(source, validated(Dialect, layout, source), excuses)
    return Sheet(source, layout, table, tuple(comments), tuple(lines[k].strip() for k in no_rows))


def _first_row(cells: Sequence[Sequence[str]], numeric: Sequence[int], width: int) -> int:
    """The first row with about as many numbers as the others have; a row of targets' numbers is a title."""
    counts = [count for row, count in zip(cells, numeric, strict=True) if len(row) == width and count >= 3]
    fewest = max(3.0, 0.5 * float(np.median(counts)))
    filled = [k for k, row in enumerate(cells) if any(row)]
    is_full = [len(cells[k]) == width and numeric[k] >= fewest for k in filled]
    # titles follow a row of targets' numbers
    return next(k for k, row, after in zip(filled, is_full, [*is_full[1:], True], strict=True) if row and after)


def _no_rows(cells: Sequence[Sequence[str]], numeric: Sequence[int], is_row: Sequence[bool], first: int) -> list[int]:
    """Lines in and behind a table that are left out; rows with too many values or too few are refused by its reader."""
    out = []
    for k, row in enumerate(cells[first + 1 :], first + 1):
        if any(row) and not is_row[k]:
            start = folded(next(cell for cell in row if cell)).strip(" .:")
            if numeric[k] < 3 or start in WORD_SETS["statistics"]:
                out.append(k)
    return out


def _mark(row: Sequence[str], line: str) -> str:
    """How a line that is no row begins."""
    return (re.split(r"\d", next(cell for cell in row if cell))[0].strip() or line.strip())[:100]


def _names_axes(column: pd.Series) -> bool:
    """Whether the cells of a column say x, y and z in turn: three rows a point."""
    count = len(column)
    return count >= 3 * FEWEST_ROWS and count % 3 == 0 and bool((column == np.resize(tables.AXES, count)).all())


def _is_row(row: Sequence[str], width: int, numeric: int, shapes: Counter[str]) -> bool:
    """Whether cells are a row of the table: neither a title that comes again, nor statistics, nor a footer."""
    if len(row) != width or not any(row):
        return False
    start = next(cell for cell in row if cell)
    if folded(start).strip(" .:") in WORD_SETS["statistics"]:
        return False
    return numeric >= 3 or (without_digits(row[0]) in shapes and bool(row[0]) and bool(re.search(r"\d", row[0])))


def without_digits(name: str) -> str:
    """A name with ``#`` for each run of digits: names that differ in them alone are alike."""
    return re.sub(r"\d+", "#", name)


def _cutting(lines: Sequence[str], of_workbook: bool) -> tuple[list[list[str]], dict[str, Any], int] | None:
    """Cells of lines by the delimiter and decimal mark that give most numbers, how they were cut, and their number."""
    spaced = tables.with_units(lines)
    drawn = sorted({*range(min(len(lines), SAMPLE)), *range(0, len(lines), max(len(lines) // SAMPLE, 1))})
    best = _best_marks(lines, spaced, drawn, of_workbook)
    if best is None or 2 * best[0] < len(drawn):  # a table in a long log
        best = _best_marks(lines, spaced, range(len(lines)), of_workbook)
    if best is None:
        return None
    _, delimiter, thousands, decimal, width = best
    cells = _cut(spaced if delimiter == BLANKS else lines, delimiter, thousands, decimal)
    if sum(len(row) == width for row in cells) < FEWEST_ROWS:
        return None
    layout: dict[str, Any] = {"delimiter": {BLANKS: "space", "\t": "tab"}.get(delimiter, delimiter), "decimal": decimal}
    layout |= {"thousands": thousands} if thousands else {}
    if delimiter == BLANKS:
        fixed = _fixed(spaced, cells, decimal)
        if fixed is not None:
            cells = [tables.cut(line, fixed) if line.strip() else [] for line in spaced]
            cells = [[tables.without_thousands(cell, thousands, decimal) for cell in row] for row in cells]
            layout |= {"delimiter": "fixed", "starts": fixed}
            width = len(fixed)
    return cells, layout, width


def _best_marks(
    lines: Sequence[str], spaced: Sequence[str], drawn: Sequence[int], of_workbook: bool
) -> tuple[int, str, str, str, int] | None:
    """Rows, delimiter, marks of thousands and decimals, and cells of a row that give most numbers in drawn lines."""
    best: tuple[int, int, str, str, str, int] | None = None
    marks = _marks_of_numbers("\n".join(lines))
    for delimiter in ("\t",) if of_workbook else ("\t", ";", "|", ",", BLANKS):
        if delimiter != BLANKS and not any(delimiter in line for line in lines):
            continue
        of_delimiter = spaced if delimiter == BLANKS else lines
        for thousands, decimal in marks:
            cells = _cut([of_delimiter[k] for k in drawn], delimiter, thousands, decimal)
            counts = [_numbers_in(row, decimal) for row in cells]
            widths = Counter(len(row) for row, count in zip(cells, counts, strict=True) if count >= 3)
            if not widths:
                continue
            width, rows = widths.most_common(1)[0]
            score = sum(count for row, count in zip(cells, counts, strict=True) if len(row) == width and count >= 3)
            if best is None or score > best[0]:
                best = score, rows, delimiter, thousands, decimal, width
    return None if best is None else best[1:]


def _cut(lines: Sequence[str], delimiter: str, thousands: str, decimal: str) -> list[list[str]]:
    """Cells of lines, without marks of thousands."""
    cells = [[cell.strip() for cell in tables.fields_of(line, delimiter)] if line.strip() else [] for line in lines]
    if thousands:
        return [[tables.without_thousands(cell, thousands, decimal) for cell in row] for row in cells]
    return cells


def _marks_of_numbers(text: str) -> list[tuple[str, str]]:
    """Marks of thousands (none: empty) and of decimals that numbers may have; the former where one proves it."""
    of_thousands = (  # each begins with its mark, which a search finds fast among digits
        ("'", ".", r"['\u2019](?<=\d.)\d{3}(?!\d)"),
        ("'", ",", r"['\u2019](?<=\d.)\d{3}(?!\d)"),
        (",", ".", r",(?<=\d.)\d{3}\.\d"),
        (".", ",", r"\.(?<=\d.)\d{3},\d"),
    )
    proven = [(mark, decimal) for mark, decimal, proof in of_thousands if re.search(proof, text)]
    return [("", "."), ("", ","), *proven]


def _fixed(lines: Sequence[str], cells: Sequence[Sequence[str]], decimal: str) -> list[int] | None:
    """Where columns of fixed width begin; None where blanks between the cells separate them as well."""
    is_row = [_numbers_in(row, decimal) >= 3 for row in cells]
    first, last = is_row.index(True), len(is_row) - 1 - is_row[::-1].index(True)
    widths = {len(row) for row in cells[first : last + 1] if row}
    if len(widths) == 1:
        return None
    rows = [text.expandtabs() for text, row in zip(lines, is_row, strict=True) if row]
    length = max(map(len, rows))
    filled = np.zeros(length + 1, dtype=bool)
    for text in rows:
        filled[: len(text)] |= np.array([letter != " " for letter in text])
    ends = np.flatnonzero(filled[:-1] & ~filled[1:]) + 1
    if len(ends) < 3 or len(ends) > max(widths) + 1:
        return None
    begins = np.flatnonzero(filled & ~np.r_[False, filled[:-1]])
    title = next((text.expandtabs() for text in reversed(lines[:first]) if text.strip()), "")
    starts = [0]
    for end, begin in zip(ends[:-1].tolist(), begins[1:].tolist(), strict=True):  # where no title is cut
        starts.append(next((k for k in range(end, begin) if not title[k - 1 : k].strip()), begin))
    return starts


COMMENTS = ("//", "#", "%", "!", "*")
"""What lines begin with that other programs write for people."""


def _header(cells: Sequence[Sequence[str]], first: int, width: int) -> tuple[int, int, bool]:
    """Line of the first title (from 0), the number of rows of titles, and whether a row of units follows."""
    titles, units, top = 0, False, first
    for k in range(first - 1, -1, -1):
        row = [cell for cell in cells[k] if cell]
        if not row:
            if titles or units:
                break
            continue
        if not titles and not units and all(_is_unit(cell) for cell in row):
            units, top = True, k
        elif not titles and len(row) >= max(2, (min(width, len(cells[first])) + 1) // 2) and len(cells[k]) <= width + 1:
            numbers = _numbers_in(row, ".")
            remark = row[0].startswith(COMMENTS) and len(row) < width  # a comment with commas, not a row of titles
            if remark or numbers > len(row) // 2 or any(cell.endswith((":", "\uff1a")) for cell in row):
                break
            titles, top = 1, k
        elif 1 <= titles < 5 and len(row) >= 2 and len(cells[k]) <= width + 1 and _repeats(cells[top]):
            titles, top = titles + 1, k
        else:
            break
    return (top, titles, units) if titles else (first, 0, False)


def _repeats(row: Sequence[str]) -> bool:
    names = [cell for cell in row if cell]
    return len(set(names)) < len(names)


def _is_unit(text: str) -> bool:
    return tables.unit_of(text.strip("[]() ")) is not None or text.strip("[]() -") == ""
