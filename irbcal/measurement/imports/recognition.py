"""Files of other programs understood without a map: which columns are joints, points and names, in which units.

Columns are recognised by the words of their headers, in several languages, and by their values. Nothing is guessed in
silence: units are those that the file declares, or those of the only trial fit that agrees with the robot
(`trial_fit`); what stays open is refused with the key of the map that says it. What is recognised is an `ImportMap`,
so that it can be kept, changed and used again.

::

    recognised = recognise(["points.txt", "joints.csv"], arm)
    reader.understand(recognised.sources, recognised.map, recognised.joints)
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement.columns import POSITION, joint_columns, joint_units
from irbcal.measurement.imports import reader, tables
from irbcal.measurement.imports.column_map import DeclaredColumns, Dialect, ImportMap, pattern_regex, validated
from irbcal.measurement.imports.tables import BLANKS, TextTable, short
from irbcal.measurement.table import REFERENCE_PREFIX
from irbcal.modeling.arm import Arm
from irbcal.units import MM

_WORDS: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("header_words.yaml").read_text(encoding="utf-8"))

_JOINT = re.compile(
    r"(?:(?P<prefix>q|j|a|jt|ax|axis|joint|theta|pos_j|joint_a|achse|gelenk|axe|articulation|eje|asse|giunto|軸|轴|关节|"
    r"関節|第)[ _.\-#]*)?(?P<number>\d{1,2})(?P<suffix>轴|軸|关节|関節)?角?"
)
_MAKERS = (
    ("s", "l", "u", "r", "b", "t"),
    ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
    ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"),
)
"""Joints that have names in place of numbers."""
_AXIS = re.compile(
    r"(?P<before>.*?)[ _.\-]?(?<![a-zA-Z])(?P<axis>[xyzXYZ])(?:pos|coord)?(?:[ _.\-]?(?P<after>\w*))?", re.IGNORECASE
)
_PLAIN = {mark: re.compile(rf"[+-]?(?:\d+(?:\{mark}\d*)?|\{mark}\d+)(?:[eE][+-]?\d+)?") for mark in ".,"}
_DRESSED = {
    mark: re.compile(rf"(?:[^\W\d]\w{{0,20}}\s*=\s*)?{number.pattern}(?:\s*(?:{tables.UNIT}))?", re.IGNORECASE)
    for mark, number in _PLAIN.items()
}
_ANY_NUMBER = r"[+-]?\d[\d.,' ]*(?:[eE][+-]?\d+)?"
_SEPARATORS = ("_", "-", "@", "/", " ", ".", ":")

FEWEST_JOINTS = 4
"""Numbered columns that are joints where the robot is not known, or has as many."""
FEWEST_ROWS = 4
MOST_TARGETS = 20
STILL = 1e-4
"""Metres within which a target that is fixed to the ground is found again and again."""
AGREES = 0.05
"""Share of the points' spread within which a trial fit agrees with a robot."""
CLEARLY = 3.0
"""So many times the best trial fit's residual has the second best, or it stays open which is right."""
SCALE_TOLERANCE = 0.1
SAMPLE = 1000
"""Lines of a file that tell its delimiter and decimal mark: so many first ones, and as many all over it; all of them
where less than half of these are rows."""
COMPUTED = 3e-6
"""Metres within which a nominal robot reaches no measured point."""


def _folded(text: str) -> str:
    """Small letters without accents."""
    if text.isascii():
        return text.lower()
    text = unicodedata.normalize("NFKD", unicodedata.normalize("NFKC", text)).casefold()
    return "".join(letter for letter in text if not unicodedata.combining(letter))


def _any_of(key: str) -> re.Pattern[str]:
    """Any of some words: letters of other scripts may stand beside them, ours may not."""
    words = [_folded(word) for word in _WORDS[key]]
    latin = "|".join(re.escape(word) for word in words if word.isascii())
    return re.compile("|".join([rf"(?<![a-z])(?:{latin})(?![a-z])", *(word for word in words if not word.isascii())]))


_QUALIFIERS = {key: _any_of(key) for key in ("deviation", "nominal", "actual")}
_SETS = {key: {_folded(word) for word in words} for key, words in _WORDS.items()}
_UNIT_LINE = re.compile("|".join(_SETS["units"]))
_KNOWN_WORDS = {word for words in _WORDS.values() for word in words if not word.isascii()}


def _is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number, also as ``X=12.5`` or ``12.5 mm``."""
    if _PLAIN[decimal].fullmatch(cell):
        return True
    return (cell[-1:].isalpha() or cell[-1:] in '°"' or "=" in cell) and bool(_DRESSED[decimal].fullmatch(cell))


def _numbers_in(row: Sequence[str], decimal: str) -> int:
    return sum(_is_number(cell, decimal) for cell in row)


# --- one table: where it stands in its file


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
    return [sheet for part in tables.parts_of(path) if (sheet := _sheet(part)) is not None]


def _sheet(source: str) -> Sheet | None:
    container = source.rpartition("!")[0]
    of_workbook = Path(container).suffix.lower() in tables.WORKBOOKS and not Path(source).exists()
    try:
        encoding = "auto" if of_workbook else tables.encoding_of(tables._bytes(source), _KNOWN_WORDS)
        lines = tables.text_lines(source, encoding)
    except MeasurementError:
        if source == str(tables.file_of(source)):
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
    shapes = Counter(_skeleton(row[0]) for row, count in zip(cells[first:], numeric[first:], strict=True) if count >= 3)
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
            start = _folded(next(cell for cell in row if cell)).strip(" .:")
            if numeric[k] < 3 or start in _SETS["statistics"]:
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
    if _folded(start).strip(" .:") in _SETS["statistics"]:
        return False
    return numeric >= 3 or (_skeleton(row[0]) in shapes and bool(row[0]) and bool(re.search(r"\d", row[0])))


def _skeleton(name: str) -> str:
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
    cells = [[cell.strip() for cell in tables._fields(line, delimiter)] if line.strip() else [] for line in lines]
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
    rows = [line.expandtabs() for line, row in zip(lines, is_row, strict=True) if row]
    length = max(map(len, rows))
    filled = np.zeros(length + 1, dtype=bool)
    for line in rows:
        filled[: len(line)] |= np.array([letter != " " for letter in line])
    ends = np.flatnonzero(filled[:-1] & ~filled[1:]) + 1
    if len(ends) < 3 or len(ends) > max(widths) + 1:
        return None
    begins = np.flatnonzero(filled & ~np.r_[False, filled[:-1]])
    title = next((line.expandtabs() for line in reversed(lines[:first]) if line.strip()), "")
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


# --- its columns


class _Name(NamedTuple):
    """A column's name: as it stands, without unit and qualifier, what it is (actual, nominal …), and its unit."""

    text: str
    bare: str
    kind: str
    unit: str | None


@dataclass(frozen=True)
class Roles:
    """What the columns of a table hold, as numbers from 0."""

    joints: tuple[int, ...] = ()
    programmed: tuple[int, ...] = ()
    positions: Mapping[str | None, tuple[int, ...]] = field(default_factory=dict)
    """Three for each target; None: the target stands elsewhere in the row."""
    labels: Mapping[int, str] = field(default_factory=dict)
    """Columns of names, and what they seem to name: pose, target, name or nothing."""
    joint_unit: str | None = None
    length_unit: str | None = None
    """As the header or the lines before it declare them."""
    computed: bool = False
    """The positions are called as those that a controller computes."""


def _parsed(text: str) -> _Name:
    """A header's name without its unit (in brackets, behind an underscore or a blank) and its qualifier."""
    bare, unit = tables._without_unit(text)
    if unit is None:
        start, mark, end = re.sub(r"[ /,]+(?=\S+$)", "_", text).rpartition("_")
        if mark and end not in ("in", "In") and tables.unit_of(end):
            bare, unit = text[: len(start)], tables.unit_of(end)
    bare = unicodedata.normalize("NFKC", bare)
    kind = ""
    for name, words in _QUALIFIERS.items():
        match = words.search(_folded(bare)) if len(_folded(bare)) == len(bare) else words.search(bare.casefold())
        if match and (rest := (bare[: match.start()] + bare[match.end() :]).strip(" _.-:/()[]")):
            if _folded(match[0]) == "nom" and not _AXIS.fullmatch(rest) and not _JOINT.fullmatch(_folded(rest)):
                continue
            bare, kind = rest, kind or name
    return _Name(text, bare.strip(" _.-:"), kind, unit)


def _roles(sheet: Sheet, dof: int | None) -> Iterator[Roles]:
    """What the columns may hold: one answer by their names, several by their values where they have none."""
    table = sheet.table
    numeric = _numeric(table)
    declared = _declared_units(sheet.preamble)
    if table.names is None:
        yield from _roles_by_values(table, numeric, dof, declared)
        return
    names = [_parsed(name) for name in table.names]
    fewest = FEWEST_JOINTS if dof is None else min(dof, FEWEST_JOINTS)
    joints = _joints_of(names, numeric, ("actual", ""), fewest)
    programmed = _joints_of(names, numeric, ("nominal",), fewest)
    if not joints:
        joints, programmed = programmed, ()
    positions, computed = _positions_of(names, numeric, {*joints, *programmed})
    used = {*joints, *programmed, *(k for three in positions.values() for k in three)}
    labels = {}
    for k, name in enumerate(names):
        words = {_folded(name.text), _folded(name.bare)}
        hint = next((hint for hint in ("pose", "target", "name") if words & _SETS[hint]), "")
        if k not in used and (hint or not numeric[k]):
            labels[k] = hint
    units = {names[k].unit or table.units.get(k) for k in joints} - {None}
    lengths = {names[k].unit or table.units.get(k) for three in positions.values() for k in three} - {None}
    if len(units) > 1 or len(lengths) > 1:
        return
    yield Roles(
        joints,
        programmed if len(programmed) == len(joints) else (),
        positions,
        labels,
        next(iter(units), declared.get("joints")),
        next(iter(lengths), declared.get("lengths")),
        computed,
    )


def _numeric(table: TextTable) -> list[bool]:
    """Columns in which numbers stand, or marks of lost points beside them."""
    return [bool(np.isfinite(table.parsed(k)).mean() >= 0.5) for k in range(table.width)]


def _declared_units(lines: Sequence[str]) -> dict[str, str]:
    """Units that lines before a table declare."""
    out: dict[str, str] = {}
    for line in lines:
        text = _folded(line)
        match = _UNIT_LINE.search(text)
        if not match:
            continue
        for word in re.findall(r'[^\W\d_]+|°|"', unicodedata.normalize("NFKC", line)[match.end() :]):
            unit = tables.unit_of(word)
            if unit:
                out.setdefault("joints" if unit in ("deg", "rad") else "lengths", unit)
    return out


def _joints_of(names: Sequence[_Name], numeric: Sequence[bool], kinds: Sequence[str], fewest: int) -> tuple[int, ...]:
    """Columns of the joints from the first to the last; none where there are none, or fewer than the fewest."""
    for kind in kinds:
        by_prefix: dict[str, dict[int, int]] = {}
        for k, name in enumerate(names):
            match = _JOINT.fullmatch(_folded(name.bare))
            if match and name.kind == kind and numeric[k] and (match["prefix"] or match["suffix"]):
                prefix = f"{match['prefix']} {match['suffix']}"
                by_prefix.setdefault(prefix, {}).setdefault(int(match["number"]), k)
        for by_number in sorted(by_prefix.values(), key=len, reverse=True):
            first = 0 if 0 in by_number and len(by_number) not in by_number else 1
            count = next(n for n in itertools.count() if first + n not in by_number)
            if count >= fewest:
                return tuple(by_number[first + n] for n in range(count))
        by_name = {_folded(name.bare): k for k, name in enumerate(names) if name.kind == kind}
        for maker in _MAKERS:
            if set(maker) <= set(by_name):
                return tuple(by_name[name] for name in maker)
    return ()


def _positions_of(
    names: Sequence[_Name], numeric: Sequence[bool], used: set[int]
) -> tuple[dict[str | None, tuple[int, ...]], bool]:
    """Columns of the measured positions by target, None for one target in a row; whether a controller computed them."""
    by_label: dict[tuple[str, str, int], dict[str, int]] = {}
    again: Counter[tuple[str, str, str]] = Counter()
    for k, name in enumerate(names):
        match = _AXIS.fullmatch(name.bare)
        if match and k not in used and numeric[k] and name.kind != "deviation":
            label = "_".join(part for part in (match["before"].strip(" _.-:"), match["after"] or "") if part)
            label = _bare_label(label)
            axis = match["axis"].lower()
            times = again[name.kind, label, axis]  # X Y Z X Y Z: as many targets
            again[name.kind, label, axis] += 1
            by_label.setdefault((name.kind, label, times), {})[axis] = k
    whole = {key: tuple(axes[a] for a in "xyz") for key, axes in by_label.items() if len(axes) == 3}
    whole = {
        key: three for key, three in whole.items() if not _SETS["beside"] & set(re.split(r"[ _.\-]+", _folded(key[1])))
    }
    kinds = {kind for kind, _, _ in whole}
    kind = next((kind for kind in ("actual", "") if kind in kinds), None)
    repeated = {label for kind_of, label, times in whole if kind_of == kind and times}
    of_kind = {
        f"{label}{times + 1}" if label in repeated else label: three
        for (kind_of, label, times), three in whole.items()
        if kind_of == kind
    }
    computed = bool(of_kind) and all(_folded(label) in _SETS["controller"] for label in of_kind)
    if any(_folded(label) not in _SETS["controller"] for label in of_kind):
        of_kind = {label: three for label, three in of_kind.items() if _folded(label) not in _SETS["controller"]}
    single = next((label for label in of_kind if _folded(label) in _SETS["single"]), None)
    if single is not None:
        return {None: of_kind[single]}, computed
    return {f"smr{label}" if label.isdigit() else label: three for label, three in of_kind.items()}, computed


def _bare_label(label: str) -> str:
    """A target's name without words that say what a position is, such as those above its columns."""
    words = re.split(r"([ _]+)", label)
    while len(words) > 1 and _folded(words[0]) in _SETS["beside_names"]:
        words = words[2:]
    while len(words) > 1 and _folded(words[-1]) in _SETS["beside_names"]:
        words = words[:-2]
    return "".join(words)


def _roles_by_values(
    table: TextTable, numeric: Sequence[bool], dof: int | None, declared: Mapping[str, str]
) -> Iterator[Roles]:
    """What columns without names may hold; a trial fit tells which."""
    labels = {k: "" for k in range(table.width) if not numeric[k]}
    columns = [k for k in range(table.width) if numeric[k]]
    in_cells = {"joints" if unit in tables.ANGLE_DEG else "lengths": unit for unit in table.units.values()}
    units = in_cells.get("joints", declared.get("joints")), in_cells.get("lengths", declared.get("lengths"))
    if len(columns) == 3:
        yield Roles((), (), {None: tuple(columns)}, labels, *units)
        return
    for leading in (0, 1) if len(columns) > (dof or 99) else ():
        names = labels | dict.fromkeys(columns[:leading], "pose")
        rest = columns[leading:]
        assert dof is not None
        targets, odd = divmod(len(rest) - dof, 3)
        if odd or targets < 0 or (leading and not _counts(table, columns[0])):
            continue
        for joints, points in ((rest[:dof], rest[dof:]), (rest[len(rest) - dof :], rest[: len(rest) - dof])):
            triples = [tuple(points[3 * k : 3 * k + 3]) for k in range(targets)]
            positions: dict[str | None, tuple[int, ...]] = {f"smr{k}": three for k, three in enumerate(triples, 1)}
            yield Roles(tuple(joints), (), {None: triples[0]} if targets == 1 else positions, names, *units)
            if not targets:
                break
    if dof is not None and len(columns) == dof:
        yield Roles(tuple(columns), (), {}, labels, *units)


def _counts(table: TextTable, k: int) -> bool:
    """Whether a column counts rows or poses."""
    values = table.parsed(k)
    return bool(np.isfinite(values).all() and (values == np.round(values)).all() and (np.diff(values) >= 0).all())


# --- names of points


class _Labels(NamedTuple):
    """Keys of the map that name poses and targets, and the poses that they give (none: None)."""

    keys: dict[str, Any]
    poses: list[str] | None


def _labels(sheet: Sheet, roles: Roles, poses: int | None) -> Iterator[_Labels]:
    """How the rows of a table are named, the likeliest first; ``poses`` where their number is known."""
    table = sheet.table
    text = {k: table.text(k).tolist() for k in roles.labels}
    text = {k: values for k, values in text.items() if len(set(values)) > 1 or len(values) == 1}
    of_one = None in roles.positions or not roles.positions
    count = len(table.cells)
    column = {k: table.key(k) for k in text}
    hinted = {hint: [k for k in text if roles.labels[k] == hint] for hint in ("pose", "target", "name", "")}
    pose = next((k for k in hinted["pose"] if poses is None or len(set(text[k])) == poses), None)
    if not of_one or not roles.positions:  # targets have columns of their own, or there are none
        for k in [*hinted["pose"], *hinted["name"], *hinted[""]]:
            if len(set(text[k])) == count and all(text[k]):
                yield _Labels({"pose": column[k]}, text[k])
                return
        yield _Labels({}, None)
        return
    names = [*hinted["target"], *hinted["name"], *hinted[""], *(k for k in hinted["pose"] if k != pose)]
    for k in names:
        different = len(set(text[k]))
        if pose is not None and k != pose and all(text[k]) and 1 < different <= MOST_TARGETS:
            pairs = len(set(zip(text[pose], text[k], strict=True)))
            if pairs >= 0.98 * count:
                yield _Labels({"target": column[k], "pose": column[pose]}, text[pose])
    for k in names:
        if not all(text[k]):
            continue
        patterns = _patterns(text[k], poses)
        if patterns is not None:
            regexes = [re.compile(pattern_regex(pattern)) for pattern in patterns]
            matches = [next(match for regex in regexes if (match := regex.fullmatch(name))) for name in text[k]]
            yield _Labels({"name": [column[k]], "names": patterns}, [match["pose"] for match in matches])
    for k in names:
        counts = Counter(text[k])
        if all(text[k]) and 1 < len(counts) <= MOST_TARGETS and 2 * len(counts) <= count:
            yield _Labels({"target": column[k]}, None)
    for k in [*hinted["pose"], *names]:
        if len(set(text[k])) == count and all(text[k]):
            yield _Labels({"pose": column[k], "fixed": "smr1"}, text[k])
    if poses is None or poses == count:
        yield _Labels({"fixed": "smr1"}, None)


def _patterns(names: Sequence[str], poses: int | None) -> list[str] | None:
    """Patterns that take names of points apart into poses and targets; None where there are none."""
    prefix = ""
    parts = [name.split("::") for name in names]
    if len({len(row) for row in parts}) == 1:
        while len(parts[0]) > 1 and len({row[0] for row in parts}) == 1:
            prefix += "{ignore}::"
            parts = [row[1:] for row in parts]
        if len(parts[0]) == 2:
            both = [list(column) for column in zip(*parts, strict=True)]
            if _quality(both[0], both[1], poses) is not None and len(set(both[1])) < len(set(both[0])):
                return [f"{prefix}{{pose}}::{{target}}"]
    tails = ["::".join(row) for row in parts]
    single = _best_pattern(tails, poses)
    if single is not None:
        return [prefix + single]
    by_shape: dict[str, list[str]] = {}
    for name in tails:
        by_shape.setdefault(_skeleton(name), []).append(name)
    patterns = [_lettered(of_shape) for of_shape in by_shape.values()]
    if len(patterns) > 10 or any(pattern is None for pattern in patterns):
        return None
    regexes = [re.compile(pattern_regex(str(pattern))) for pattern in patterns]
    matches = [next((match for regex in regexes if (match := regex.fullmatch(name))), None) for name in tails]
    if any(match is None for match in matches):
        return None
    poses_of = [_last_number(match["pose"]) for match in matches if match]
    pairs = set(zip(poses_of, [match["target"] for match in matches if match], strict=True))
    if len(pairs) < 0.98 * len(names) or len({target for _, target in pairs}) > MOST_TARGETS:
        return None
    return [prefix + str(pattern) for pattern in dict.fromkeys(patterns)]


def _best_pattern(names: Sequence[str], poses: int | None) -> str | None:
    best: tuple[float, str] | None = None
    for separator, pose_first in itertools.product(_SEPARATORS, (True, False)):
        if not all(separator in name for name in names):
            continue
        halves = [name.rpartition(separator) for name in names]
        left, right = [half[0] for half in halves], [half[2] for half in halves]
        quality = _quality(left, right, poses) if pose_first else _quality(right, left, poses)
        if quality is not None and (best is None or quality > best[0]):
            first, second = ("pose", "target") if pose_first else ("target", "pose")
            best = quality, f"{{{first}}}{separator}{{{second}}}"
    return None if best is None else best[1]


def _quality(poses: Sequence[str], targets: Sequence[str], known: int | None) -> float | None:
    """How completely two parts of names are poses and targets, 1 at best; None where they are not."""
    if not all(poses) or not all(targets):
        return None
    n_poses, n_targets = len(set(poses)), len(set(targets))
    pairs = len(set(zip(poses, targets, strict=True)))
    complete = len(poses) / (n_poses * n_targets)
    if n_targets > min(MOST_TARGETS, n_poses) or pairs < 0.98 * len(poses) or complete < 0.5:
        return None
    if n_targets == 1 and n_poses < len(poses):
        return None
    return complete - (0.2 if known is not None and n_poses > known else 0.0) - (0.3 if n_targets == 1 else 0.0)


def _lettered(names: Sequence[str]) -> str | None:
    """Pattern of names of one shape, such as P12K1: two parts of letters and digits."""
    matches = [re.fullmatch(r"(\D*?)(\d+)([_\-@/ .:]?)(\D*?)(\d+)", name) for name in names]
    if not matches or any(match is None for match in matches):
        return None
    first, second = ({match[group] for match in matches if match} for group in (2, 5))
    start, _, mark, middle, _ = matches[0].groups() if matches[0] else ("", "", "", "", "")
    if not mark and not middle:
        return None
    pose_first = len(first) >= len(second)
    fields = ("pose", "target") if pose_first else ("target", "pose")
    texts = [
        f"{{{name}={letters}}}" if letters else f"{{{name}}}"
        for name, letters in zip(fields, (start, middle), strict=True)
    ]
    return mark.join(texts)


def _last_number(name: str) -> int | None:
    numbers = re.findall(r"\d+", name)
    return int(numbers[-1]) if numbers else None


# --- the trial fit


class TrialFit(NamedTuple):
    """How well a robot explains points."""

    residual: float
    """Typical distance (m) of the middle of all points."""
    spread: float
    """Root mean square distance of the points from their mean, m."""
    scale: float
    """Metres that a metre of the file is."""
    rows: int
    """Points."""

    @property
    def share(self) -> float:
        """Residual over spread."""
        return self.residual / self.spread if self.spread > 0.0 else np.inf

    @property
    def agrees(self) -> bool:
        """Whether the robot explains them, but for the unit of length."""
        return self.share < AGREES


def trial_fit(arm: Arm, q: FloatArray, pose: IntArray, target: IntArray, points: FloatArray) -> TrialFit | None:
    """Fit base and tool of a nominal robot to measured points by linear least squares, with a free unit of length.

    With the tip pose ``T_base_tip = (R_i, t_i)`` and an affine map ``A x + c`` from tracker to base, a target ``p_k``
    on the tool has ``A x_ik + c - R_i p_k = t_i``: linear in all unknowns. A is a rotation times the unit of length, so
    that ``det(A)^(1/3)`` is that unit, and a fit that needs a mirror or a shear contradicts the file. Points beyond
    five times the median residual are left out twice.

    Parameters
    ----------
    arm : Arm
    q : ndarray, shape (poses, joints)
        Joints as the controller counts them, radians and metres.
    pose, target : ndarray of int, shape (rows,)
        Numbers from 0.
    points : ndarray, shape (rows, 3)
        Measured positions, in any unit.

    Returns
    -------
    TrialFit or None
        None: too few points, or points from which base and tool cannot be told apart.
    """
    count = int(target.max(initial=0)) + 1
    unknowns = 12 + 3 * count
    if 3 * len(points) < 1.5 * unknowns:
        return None
    T = arm.forward(arm.from_controller(q))[pose]
    centre = points.mean(axis=0)
    spread = float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean()))
    if spread <= 0.0:
        return None
    x = (points - centre) / spread
    rows = np.zeros((len(points), 3, unknowns))
    for axis in range(3):
        rows[:, axis, 3 * axis : 3 * axis + 3] = x
        rows[:, axis, 9 + axis] = 1.0
    for k in range(count):
        rows[target == k, :, 12 + 3 * k : 15 + 3 * k] = -T[target == k, :3, :3]
    left, right = rows, T[:, :3, 3]
    solution: FloatArray = np.zeros(unknowns)
    residual: FloatArray = np.zeros(len(points))
    used: BoolArray = np.ones(len(points), dtype=bool)
    for _ in range(3):
        flat = left[used].reshape(-1, unknowns)
        solution = np.asarray(np.linalg.lstsq(flat, right[used].ravel(), rcond=1e-10)[0], dtype=np.float64)
        residual = np.asarray(np.linalg.norm(left @ solution - right, axis=1))
        used = np.asarray(residual <= max(5.0 * float(np.median(residual)), 1e-6))
        if 3 * used.sum() < 1.5 * unknowns:
            return None
    A = solution[:9].reshape(3, 3) / spread
    size = float(np.cbrt(np.linalg.det(A)))
    values = np.linalg.svd(A, compute_uv=False)
    spread_base = float(np.sqrt(((right - right.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if size <= 0.0 or np.ptp(values) > 2 * SCALE_TOLERANCE * size:
        return TrialFit(spread_base, spread_base, abs(size), len(points))
    return TrialFit(float(np.median(residual)), spread_base, size, len(points))


def _fit_of(arm: Arm, frame: pd.DataFrame) -> TrialFit | None:
    """`trial_fit` of an imported table."""
    have = frame[frame["x_mm"].notna()]
    names = joint_columns(have.columns)
    if len(names) != len(arm.joint_names):
        return None
    points, moving = have[POSITION].to_numpy() * MM, np.ones(len(have), dtype=bool)
    targets = have["target"].to_numpy()
    for name in _fixed_to_ground(have, None):
        moving &= targets != name
    if moving.sum() < 6:
        return None
    joints = have[names].to_numpy()[moving] * joint_units(names)
    number, pose = np.unique(joints, axis=0, return_inverse=True)
    return trial_fit(arm, number, pose.ravel(), pd.factorize(targets[moving])[0], points[moving])


def still_targets(frame: pd.DataFrame) -> list[str]:
    """Targets that do not move while others do: nine points of ten lie within `STILL` of their median."""
    return _fixed_to_ground(frame, STILL)


def _fixed_to_ground(frame: pd.DataFrame, limit: float | None) -> list[str]:
    """As `still_targets`; without a limit, as the unit of length is open, those that hardly move beside the others."""
    reach = {}
    for name, group in frame.groupby("target", sort=False):
        xyz = group[POSITION].to_numpy() * MM
        xyz = xyz[np.isfinite(xyz).all(axis=1)]
        if len(xyz) >= 3:
            reach[str(name)] = float(np.quantile(np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1), 0.9))
    largest = max(reach.values(), default=0.0)
    limit = 0.01 * largest if limit is None else limit
    return [name for name, distance in reach.items() if distance <= limit] if largest > 100 * limit / 2 else []


# --- all files together


@dataclass(frozen=True)
class Recognised:
    """Files that were understood."""

    map: ImportMap
    sources: tuple[str, ...]
    """Files with points, as `irbcal.measurement.imports.reader.understand` takes them."""
    joints: str | None
    """File with the joints."""
    columns: tuple[tuple[str, str, str], ...] = ()
    """Column, what it holds, its unit and where that comes from."""
    notes: tuple[str, ...] = ()
    """What was left out, and by what the units are proven, in sentences."""
    imported: reader.Imported | None = None
    """What the map makes of the files, where that is known already."""


class _Table(NamedTuple):
    """A table and what its columns hold."""

    sheet: Sheet
    roles: Roles


def recognise(
    paths: Sequence[str | PathLike[str]],
    arm: Arm | None = None,
    joints: str | PathLike[str] | None = None,
    declared: Mapping[str, str] | None = None,
    columns: DeclaredColumns | None = None,
) -> Recognised:
    """Understand files without a map.

    Parameters
    ----------
    paths : sequence of str or Path
        Files with points, and at will one with joints: recognised, workbooks, archives, programs.
    arm : Arm, optional
        The nominal robot: a trial fit proves units and columns.
    joints : str or Path, optional
        The file with joints, where it is to be no other.
    declared : dict of str to str, optional
        Units of ``joints`` and ``lengths``, whatever the files say.
    columns : DeclaredColumns, optional
        What columns mean, whatever their names say; the rest is recognised.

    Raises
    ------
    MeasurementError
        If they are not understood, or can be understood in several ways; the sentence names what is open.
    """
    dof = None if arm is None else len(arm.joint_names)
    programs, understood, unread = [], [], []
    for path in [*paths, *([] if joints is None else [joints])]:
        if reader.read(path) is not None:
            programs.append(str(path))
            continue
        of_file = sheets(path)
        if not of_file:
            unread.append(str(path))
        for sheet in of_file:
            answers = likely_roles(sheet, dof, columns)
            understood.append((sheet, [_with_units(roles, declared or {}) for roles in answers]))
    if columns is not None and understood:
        named = columns.position.values() if isinstance(columns.position, dict) else [columns.position or []]
        for key in [*(columns.joints or []), *(key for three in named for key in three)]:
            if all(_place(sheet.table, key) is None for sheet, _ in understood):
                understood[0][0].table.find(key, "what is declared")
    both, points, only_joints = [], [], []
    measured_elsewhere = any(roles.positions and not roles.computed for _, answers in understood for roles in answers)
    for sheet, answers in understood:
        for roles in answers:
            if roles.computed and roles.joints and measured_elsewhere:
                roles = replace(roles, positions={})
            if joints is not None and tables.file_of(sheet.source) == Path(joints):
                if roles.joints:
                    only_joints.append(_Table(sheet, roles))
            elif roles.joints and roles.positions:
                both.append(_Table(sheet, roles))
            elif roles.positions:
                points.append(_Table(sheet, roles))
            elif roles.joints:
                only_joints.append(_Table(sheet, roles))
    source = str(paths[0])
    if unread:
        raise MeasurementError("expected a table of numbers or a program with joints, found none", file=unread[0])
    recognised = _chosen(list(_candidates(both, points, only_joints, programs, source)), arm, source)
    used = {*recognised.sources, recognised.joints}
    unused = [name for name in [*(sheet.source for sheet, _ in understood), *programs] if name not in used]
    return replace(recognised, notes=(*recognised.notes, *(f"{name} is not used" for name in unused)))


def likely_roles(sheet: Sheet, dof: int | None, columns: DeclaredColumns | None = None) -> list[Roles]:
    """What the columns of a table may hold, the likeliest first; those that are declared hold what is said."""
    answers = list(_roles(sheet, dof))
    if columns is None:
        return answers
    return [_as_declared(sheet, roles, columns) for roles in answers or [Roles()]]


def _as_declared(sheet: Sheet, roles: Roles, columns: DeclaredColumns) -> Roles:
    """The roles of a table with what is declared of columns that it has."""
    table, units = sheet.table, _declared_units(sheet.preamble)

    def places(keys: Sequence[str | int]) -> tuple[int, ...]:
        out = [_place(table, key) for key in keys]
        return () if None in out else tuple(k for k in out if k is not None)

    joints = places(columns.joints or ())
    named = columns.position if isinstance(columns.position, dict) else {None: columns.position or []}
    positions = {target: three for target, keys in named.items() if (three := places(keys))}
    if set(joints) & {k for three in positions.values() for k in three}:
        return roles  # columns by numbers, of another table
    if joints:
        others = {target: three for target, three in roles.positions.items() if not set(three) & set(joints)}
        roles = replace(roles, joints=joints, programmed=(), positions=others)
        roles = replace(roles, joint_unit=_unit(table, joints) or units.get("joints"))
    if positions:
        taken = {k for three in positions.values() for k in three}
        unit = _unit(table, sorted(taken)) or units.get("lengths")
        roles = replace(roles, positions=positions, length_unit=unit, computed=False)
        if taken & {*roles.joints, *roles.programmed}:
            roles = replace(roles, joints=(), programmed=())
    declared = {hint: places(keys if isinstance(keys, list) else [keys]) for hint, keys in _hints(columns).items()}
    used = {*roles.joints, *roles.programmed, *(k for three in roles.positions.values() for k in three)}
    kept = {k: hint for k, hint in roles.labels.items() if k not in used and hint not in declared}
    return replace(roles, labels=kept | {k: hint for hint, places_of in declared.items() for k in places_of})


def _place(table: TextTable, key: str | int) -> int | None:
    """Where a table has a column; None where it has not."""
    return None if table.names is None and isinstance(key, str) else table.find(key, "what is declared", optional=True)


def _hints(columns: DeclaredColumns) -> dict[str, Any]:
    values = {"pose": columns.pose, "target": columns.target, "name": columns.name}
    return {hint: keys for hint, keys in values.items() if keys is not None}


def _unit(table: TextTable, columns: Sequence[int]) -> str | None:
    """The unit that the header or the cells of columns declare; None for none, or several."""
    units = {(_parsed(table.names[k]).unit if table.names else None) or table.units.get(k) for k in columns} - {None}
    return next(iter(units)) if len(units) == 1 else None


def _with_units(roles: Roles, declared: Mapping[str, str]) -> Roles:
    return replace(
        roles,
        joint_unit=declared.get("joints", roles.joint_unit),
        length_unit=declared.get("lengths", roles.length_unit),
    )


class _Reading(NamedTuple):
    """One way to understand the files."""

    values: dict[str, Any]
    sources: tuple[str, ...]
    joints: str | None
    points: tuple[_Table, ...]
    joints_table: _Table | None
    joint_unit: str | None
    length_unit: str | None


def _candidates(
    both: Sequence[_Table],
    points: Sequence[_Table],
    only_joints: Sequence[_Table],
    programs: Sequence[str],
    source: str,
) -> Iterator[_Reading]:
    if both:
        complete = list(dict.fromkeys(table.sheet.source for table in both))
        columns = [_base_values(table)["columns"] for table in both]
        if len(complete) > 1 and any(of_table != columns[0] for of_table in columns[1:]):
            raise MeasurementError(
                "expected one table with joints and points, or several with the same columns, found "
                f"{', '.join(complete[:5])}: import them one by one",
                file=source,
            )
        layout = _common_layout(both) if len(complete) > 1 else None
        readings = [reading for table in both if table.sheet.source == complete[0] for reading in _together(table)]
        if not readings:
            text, joints = both[0].sheet.table, both[0].roles.joints
            row, k = np.argwhere(~np.isfinite(np.column_stack([text.parsed(k) for k in joints])))[0]
            cell = text.text(joints[k]).iloc[row]
            raise text.fault(
                f"expected a joint in each row, as a number such as 12{text.decimal}5, found "
                + (repr(short(cell)) if cell else "nothing"),
                row,
                joints[k],
            )
        for reading in readings:
            values = reading.values | ({} if layout is None else {"file": layout})
            yield reading._replace(values=values, sources=tuple(complete))
        return
    joint_sources: list[tuple[str, _Table | None]] = [(table.sheet.source, table) for table in only_joints]
    joint_sources += [(program, None) for program in programs]
    if not points:
        raise MeasurementError("expected columns of points (X, Y, Z), found none", file=source)
    if not joint_sources:
        raise MeasurementError(
            "this is a file of points only: expected a file with the robot's joints, too (a table or a program; "
            "--joints FILE, or among the files), found none",
            file=source,
            parameter="joints",
        )
    if len({name for name, _ in joint_sources}) > 1:
        names = ", ".join(name for name, _ in joint_sources[:5])
        raise MeasurementError(f"expected one file with joints, found {names}: name it with --joints", file=source)
    for name, joints_table in joint_sources:
        yield from _apart(points, name, joints_table)


def columns_of(sheet: Sheet, roles: Roles) -> dict[str, Any]:
    """Columns of numbers as keys and values of a map."""
    columns: dict[str, Any] = {}
    triples = {name: [sheet.table.key(k) for k in three] for name, three in roles.positions.items()}
    columns["position"] = triples.get(None, triples)
    if roles.joints:
        columns["joints"] = [sheet.table.key(k) for k in roles.joints]
    if roles.programmed:
        columns["programmed"] = [sheet.table.key(k) for k in roles.programmed]
    return columns


def _base_values(table: _Table) -> dict[str, Any]:
    """File and columns of numbers as keys and values of a map."""
    sheet, roles = table
    columns = columns_of(sheet, roles)
    names = {_folded(name): name for name in sheet.table.names or ()}
    if "simulated" in names:
        columns["keep"] = {"simulated": names["simulated"]}
    markers = sorted({cell for three in roles.positions.values() for k in three for cell in _marks(sheet.table, k)})
    return {"file": sheet.layout, "columns": columns} | ({"lost": {"markers": markers}} if markers else {})


def _marks(table: TextTable, k: int) -> list[str]:
    """Texts that stand in a column of positions in place of numbers; numbers written otherwise are refused."""
    lost = ~np.isfinite(table.parsed(k))
    texts = table.text(k)[lost]
    numbers = texts[texts.str.fullmatch(_ANY_NUMBER)]
    if len(numbers):
        row = int(np.flatnonzero(table.lines == numbers.index[0])[0])
        mark = "comma" if table.decimal == "," else "point"
        raise table.fault(
            f"expected a number with a decimal {mark} as in other rows, found {short(numbers.iloc[0])!r}; write all "
            "numbers of the column alike",
            row,
            k,
        )
    return [text for text in texts.unique().tolist() if text and text.lower() not in ("nan", "none")][:50]


def _put_labels(values: dict[str, Any], labels: _Labels) -> dict[str, Any]:
    columns = values["columns"] | {key: labels.keys[key] for key in ("pose", "target", "name") if key in labels.keys}
    out = values | {"columns": columns}
    if "names" in labels.keys:
        out["names"] = labels.keys["names"]
    if "fixed" in labels.keys:
        out["fixed"] = {"target": labels.keys["fixed"]}
    return out


def _together(table: _Table) -> Iterator[_Reading]:
    """Joints and points in one table."""
    sheet, roles = table
    text = sheet.table
    q = np.column_stack([text.parsed(k) for k in roles.joints])
    if not np.isfinite(q).all():
        return
    runs = 1 + int((np.abs(np.diff(q, axis=0)).max(axis=1) > reader.SAME_JOINTS).sum())
    base = _base_values(table)
    for labels in _labels(sheet, roles, runs if None in roles.positions else None):
        values = _put_labels(base, labels)
        if labels.poses is not None:
            frame = pd.DataFrame(q).groupby(pd.Series(labels.poses), sort=False)
            one = bool((frame.max() - frame.min()).to_numpy().max() <= reader.SAME_JOINTS)
            if not one or frame.ngroups != len(np.unique(q, axis=0)):
                values["columns"].pop("pose", None)
                values["names"] = [pattern.replace("{pose", "{ignore") for pattern in values.get("names", [])]
                values["pose_by"] = "joints"
        else:
            values["pose_by"] = "joints"
        if not values.get("names"):
            values.pop("names", None)
        yield _Reading(values, (sheet.source,), None, (table,), None, roles.joint_unit, roles.length_unit)


def _apart(points: Sequence[_Table], joints: str, joints_table: _Table | None) -> Iterator[_Reading]:
    """Points in files of their own, joints in another."""
    if joints_table is None:
        program = reader.read(joints)
        assert program is not None
        count = len(program)
        names_of_joints = program["pose"].tolist() if "pose" in program.columns else None
        joint_values: dict[str, Any] = {}
    else:
        sheet, roles = joints_table
        count = len(sheet.table.cells)
        labels = next(_labels(sheet, roles, None))
        names_of_joints = labels.poses
        columns: dict[str, Any] = {"joints": [sheet.table.key(k) for k in roles.joints]}
        if roles.programmed:
            columns["programmed"] = [sheet.table.key(k) for k in roles.programmed]
        if "pose" in labels.keys:
            columns["pose"] = labels.keys["pose"]
        joint_values = {"joints_file": {"file": sheet.layout, "columns": columns, "units": {}}}
    unit = None if joints_table is None else joints_table.roles.joint_unit
    sources = tuple(table.sheet.source for table in points)
    first = points[0]
    base = _base_values(first)
    if len(points) > 1:
        if any(_base_values(table)["columns"] != base["columns"] for table in points[1:]):
            raise MeasurementError(
                f"expected files of points with the same columns, found others than those of {sources[0]}: import them "
                "one by one",
                file=sources[1],
            )
        base["file"] = _common_layout(points)
        markers = sorted({mark for table in points for mark in _base_values(table).get("lost", {}).get("markers", [])})
        if markers:
            base["lost"] = {"markers": markers}
    lengths = {table.roles.length_unit for table in points} - {None}
    length_unit = next(iter(lengths)) if len(lengths) == 1 else None
    for labels in _labels(first.sheet, first.roles, None if len(points) > 1 else count):
        values = _put_labels(base, labels) | joint_values
        if len(points) > 1 and "fixed" in labels.keys:  # a file for each target
            values.pop("fixed")
            values["file_name"] = "{target}"
        elif None in first.roles.positions and "target" in labels.keys and "pose" not in labels.keys:
            values["pose_by"] = "target"
        for join in _joins(labels.poses, names_of_joints, count):
            yield _Reading(values | {"join": join}, sources, joints, tuple(points), joints_table, unit, length_unit)


def _common_layout(points: Sequence[_Table]) -> dict[str, Any]:
    """The layout of files of one kind: lines that one of them leaves out are left out of all."""
    layouts = [table.sheet.layout for table in points]
    comments = sorted({mark for layout in layouts for mark in layout.get("comment", [])})
    common = layouts[0] | ({"comment": comments} if comments else {})
    for layout, table in zip(layouts, points, strict=True):
        if {**layout, "comment": comments} != {**common, "comment": comments}:
            raise MeasurementError(
                f"expected a file laid out as {points[0].sheet.source}, found another layout: import it on its own",
                file=table.sheet.source,
            )
    return common


def _joins(names: Sequence[str] | None, of_joints: Sequence[str] | None, count: int) -> Iterator[str]:
    """How points and joints may belong together."""
    if names is not None and of_joints is not None:
        if set(names) <= set(of_joints):
            yield "name"
            return
        numbers, numbers_of_joints = ([_last_number(name) for name in values] for values in (set(names), of_joints))
        if (
            None not in numbers
            and len(set(numbers)) == len(numbers)
            and len(set(numbers_of_joints)) == len(numbers_of_joints)
            and set(numbers) <= set(numbers_of_joints)
        ):
            yield "number"
    if names is None or len(set(names)) == count:
        yield "order"


def _units(candidate: _Reading, arm: Arm | None) -> Iterator[tuple[dict[str, Any], str]]:
    """Units of joints and lengths that may be: those declared, else each."""
    slides = None if arm is None else arm.table.prismatic
    for joint_unit in [candidate.joint_unit] if candidate.joint_unit else ["deg", "rad"]:
        length = candidate.length_unit or "mm"
        joints: Any = joint_unit
        if slides is not None and slides.any():
            joints = [length if slide else joint_unit for slide in slides]
        values = dict(candidate.values)
        units: dict[str, Any] = {"lengths": length}
        if candidate.joints is None:
            units["joints"] = joints
        elif candidate.joints_table is not None:
            values["joints_file"] = values["joints_file"] | {"units": {"joints": joints}}
        elif joint_unit != "deg":
            continue  # literals of a program have their unit
        yield values | {"units": units, "trust_units": True}, joint_unit


class _Understood(NamedTuple):
    candidate: _Reading
    values: dict[str, Any]
    table: pd.DataFrame
    fit: TrialFit | None
    joint_unit: str


def _chosen(candidates: Sequence[_Reading], arm: Arm | None, source: str) -> Recognised:
    """The only candidate that a trial fit agrees with, or that leaves nothing open."""
    understood: list[_Understood] = []
    refusal: MeasurementError | None = None
    for candidate in candidates:
        for values, joint_unit in _units(candidate, arm):
            try:
                import_map = validated(ImportMap, values, source)
                imported = reader.understand(candidate.sources, import_map, candidate.joints)
            except MeasurementError as error:
                refusal = refusal or error
                continue
            fit = None if arm is None else _fit_of(arm, imported.table)
            understood.append(_Understood(candidate, values, imported.table, fit, joint_unit))
    if not understood:
        raise refusal or MeasurementError(
            "expected rows with joints and points of named targets, found none that can be told apart: say with --as "
            "MAP.yaml what the columns are",
            file=source,
        )
    tried = [entry for entry in understood if entry.fit is not None]
    if not tried:
        return _declared(understood, arm, source)
    tried.sort(key=lambda entry: entry.fit.share if entry.fit else np.inf)
    best = tried[0]
    assert best.fit is not None
    if not best.fit.agrees:
        raise MeasurementError(
            f"expected joints and points of {arm.name if arm else 'the robot'}, found none that agree with it: the "
            f"trial fit of its base and tool misses the points by {best.fit.residual / MM:.0f} mm (columns "
            f"{_shown(best)}): check the robot, signs and zeros of its joints (joints.signs, joints.offsets_deg of a "
            "map)",
            file=source,
        )
    if best.fit.residual < COMPUTED:
        raise MeasurementError(
            "expected measured positions, found ones that the nominal robot reaches to "
            f"{best.fit.residual / MM:.4f} mm: a controller computed them, no tracker measured them (a map "
            "reads them all the same: --as)",
            file=source,
        )
    rivals = [
        entry
        for entry in tried[1:]
        if entry.fit and entry.fit.share < CLEARLY * best.fit.share + 1e-4 and not _same(best, entry)
    ]
    if rivals:
        raise MeasurementError(
            f"expected one way to understand the columns, found two that agree with the robot: {_shown(best)}, and "
            f"{_shown(rivals[0])}: say it with --as MAP.yaml or --set",
            file=source,
        )
    return _proven(best, arm)


def _same(one: _Understood, other: _Understood) -> bool:
    """Whether two ways give the same poses of the same points, whatever they are called."""
    names = [*joint_columns(one.table.columns), *POSITION]
    if set(names) - set(other.table.columns) or len(one.table) != len(other.table):
        return False
    a, b = (entry.table.sort_values(names)[names].to_numpy() for entry in (one, other))
    return bool(np.allclose(a, b, rtol=0, atol=1e-9, equal_nan=True))


def _shown(entry: _Understood) -> str:
    columns = entry.values.get("joints_file", entry.values)["columns"].get("joints", "the program's literals")
    return f"joints {columns} in {entry.joint_unit}, points {entry.values['columns']['position']}"[:300]


def _declared(understood: Sequence[_Understood], arm: Arm | None, source: str) -> Recognised:
    """Without a trial fit: the only way, if its units are declared."""
    entry = understood[0]
    candidate = entry.candidate
    program = candidate.joints is not None and candidate.joints_table is None
    why = (
        "name the robot (--robot), whose trial fit proves it, or"
        if arm is None
        else "there are too few points to prove it:"
    )
    if not candidate.joint_unit and not program:
        names = joint_columns(entry.table.columns)
        largest = float(entry.table[names].abs().to_numpy().max())
        if largest <= np.degrees(reader.MOST_TURNS) and entry.joint_unit == "deg" and largest <= reader.MOST_TURNS:
            key = "units.joints" if candidate.joints is None else "joints_file.units.joints"
            raise MeasurementError(
                f"expected the unit of the joints to be declared, found no unit in the file: {why} declare it with "
                f"--set {key}=deg (or rad)",
                file=source,
                parameter="units.joints",
            )
    if not candidate.length_unit:
        raise MeasurementError(
            f"expected the unit of the positions to be declared, found no unit in the file: {why} declare it with "
            "--set units.lengths=mm (or m, inch)",
            file=source,
            parameter="units.lengths",
        )
    others = [other for other in understood[1:] if other.candidate is not candidate and not _same(entry, other)]
    if others and entry.values.get("join") != "name":
        raise MeasurementError(
            f"expected one way to understand the files, found two, {_shown(entry)}, and {_shown(others[0])}: {why} "
            "say it in a map",
            file=source,
        )
    return _finished(
        entry,
        entry.values,
        ["No trial fit checked this: " + ("no robot was named" if arm is None else "too few points")],
    )


def _proven(best: _Understood, arm: Arm | None) -> Recognised:
    """The best way with the unit of length that the fit proves."""
    fit, candidate = best.fit, best.candidate
    assert fit is not None
    assert arm is not None
    assumed = best.values["units"]["lengths"]
    sizes = {"mm": 1e-3, "m": 1.0, "inch": 0.0254}
    unit = next(
        (name for name, size in sizes.items() if abs(sizes[assumed] * fit.scale / size - 1) <= SCALE_TOLERANCE), None
    )
    source = candidate.sources[0]
    if unit is None:
        raise MeasurementError(
            f"expected positions in mm, m or inch, found that one of the file is {sizes[assumed] * fit.scale:.4g} m by "
            f"the trial fit of {arm.name}",
            file=source,
        )
    if candidate.length_unit and unit != candidate.length_unit:
        raise MeasurementError(
            f"expected positions in {candidate.length_unit} as the file declares, found {unit} by the trial fit of "
            f"{arm.name}: declare the right one with --set units.lengths={unit}",
            file=source,
        )
    values = best.values | {"units": best.values["units"] | {"lengths": unit}}
    notes = [
        f"A trial fit of {arm.name} with unknown base and tool misses the points by {fit.residual / MM:.2f} mm"
        + ("" if candidate.length_unit and candidate.joint_unit else ", with no other unit")
    ]
    return _finished(best, values, notes)


def _finished(entry: _Understood, values: dict[str, Any], notes: list[str]) -> Recognised:
    """The map with targets that stand still as references, and what was understood in words."""
    candidate = entry.candidate
    source = candidate.sources[0]
    plain = {key: value for key, value in values.items() if key != "trust_units"}
    try:
        imported = reader.understand(candidate.sources, validated(ImportMap, plain, source), candidate.joints)
        values = plain
    except MeasurementError:  # units that are proven although the numbers look like others
        imported = reader.understand(candidate.sources, validated(ImportMap, values, source), candidate.joints)
    still = [name for name in still_targets(imported.table) if not name.lower().startswith(REFERENCE_PREFIX)]
    moving = [
        str(name)
        for name in imported.table["target"].unique()
        if str(name).lower().startswith(REFERENCE_PREFIX) and name not in still_targets(imported.table)
    ]
    rename = {name: f"{REFERENCE_PREFIX}_{name}" for name in still}
    if len(still_targets(imported.table)) or len(moving) < imported.table["target"].nunique():
        rename |= {name: f"smr_{name}" for name in moving if _moves(imported.table, name)}
    if rename:
        values = values | {"rename": rename}
        notes += [f"{name} stands still: it is a reference, {new}" for name, new in rename.items() if name in still]
        notes += [
            f"{name} moves with the robot: it is no reference, {new}"
            for name, new in rename.items()
            if name not in still
        ]
    for table in [*candidate.points, *([] if candidate.joints_table is None else [candidate.joints_table])]:
        for line in table.sheet.left_out[:3]:
            notes.append(f"{table.sheet.source}: a line that is no row is left out: {short(line)!r}")
    columns = [row for table in candidate.points[:1] for row in _columns_in_words(table, values)]
    if candidate.joints_table is not None:
        columns += _columns_in_words(candidate.joints_table, values)
    elif candidate.joints is not None:
        columns.append((Path(candidate.joints).name, "joints, as literals of a program", "of its language"))
    import_map = validated(ImportMap, values, source)
    known = None if rename else imported
    return Recognised(import_map, candidate.sources, candidate.joints, tuple(columns), tuple(notes), known)


def _moves(table: pd.DataFrame, name: str) -> bool:
    xyz = table.loc[table["target"] == name, POSITION].to_numpy() * MM
    xyz = xyz[np.isfinite(xyz).all(axis=1)]
    return len(xyz) >= 3 and float(np.quantile(np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1), 0.5)) > 0.02


def _columns_in_words(table: _Table, values: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Columns of a table, what they hold, and in which unit."""
    sheet, roles = table
    units = values["units"]
    joint_unit = units.get("joints") or values.get("joints_file", {}).get("units", {}).get("joints", "")
    out: dict[int, tuple[str, str]] = {}
    for number, k in enumerate(roles.joints, 1):
        unit = joint_unit[number - 1] if isinstance(joint_unit, list) else joint_unit
        out[k] = f"joint {number}", f"{unit}, {'declared' if roles.joint_unit else 'by the fit'}"
    for number, k in enumerate(roles.programmed, 1):
        out[k] = f"programmed joint {number}", str(joint_unit)
    for target, three in roles.positions.items():
        for axis, k in zip("xyz", three, strict=True):
            text = f"{axis} of {target}" if target else axis
            out[k] = text, f"{units['lengths']}, {'declared' if roles.length_unit else 'by the fit'}"
    columns = (
        values["columns"] | values.get("joints_file", {}).get("columns", {})
        if not roles.positions
        else values["columns"]
    )
    for key in ("pose", "target", "name"):
        named = columns.get(key)
        for column in named if isinstance(named, list) else [named]:
            for k in range(sheet.table.width):
                if column is not None and sheet.table.key(k) == column:
                    text = " ".join(values.get("names", [])) if key == "name" else key
                    out.setdefault(k, (text, ""))
    return [(sheet.table.label(k), *out.get(k, ("not used", ""))) for k in range(sheet.table.width)]
