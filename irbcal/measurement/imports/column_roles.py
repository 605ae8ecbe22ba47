"""What the columns of a table hold: joints, positions, names, and in which units, by words of headers and by values."""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from irbcal.measurement.column_names import input_of
from irbcal.measurement.imports import source_file, tables
from irbcal.measurement.imports.column_map import OWN_COLUMNS, DeclaredColumns
from irbcal.measurement.imports.header_words import QUALIFIERS, UNIT_WORDS, WORD_SETS, folded
from irbcal.measurement.imports.sheets import Sheet
from irbcal.measurement.imports.tables import TextTable
from irbcal.measurement.table import GOALS

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

ANY_NUMBER = r"[+-]?\d[\d.,' ]*(?:[eE][+-]?\d+)?"

FEWEST_JOINTS = 4
"""Numbered columns that are joints where the robot is not known, or has as many."""


class _Header(NamedTuple):
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
    named: Mapping[str, int] = field(default_factory=dict)
    """Columns that bear the names of a measurement file's, and mean the same."""


def _parsed(text: str) -> _Header:
    """A header's name without its unit (in brackets, behind an underscore or a blank) and its qualifier."""
    bare, unit = tables.without_unit(text)
    if unit is None:
        start, mark, end = re.sub(r"[ /,]+(?=\S+$)", "_", text).rpartition("_")
        if mark and end not in ("in", "In") and tables.unit_of(end):
            bare, unit = text[: len(start)], tables.unit_of(end)
    bare = unicodedata.normalize("NFKC", bare)
    kind = ""
    for name, pattern in QUALIFIERS.items():
        match = pattern.search(folded(bare)) if len(folded(bare)) == len(bare) else pattern.search(bare.casefold())
        if match and (remainder := (bare[: match.start()] + bare[match.end() :]).strip(" _.-:/()[]")):
            if folded(match[0]) == "nom" and not _AXIS.fullmatch(remainder) and not _JOINT.fullmatch(folded(remainder)):
                continue
            bare, kind = remainder, kind or name
    return _Header(text, bare.strip(" _.-:"), kind, unit)


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
    named = {own: k for k, text in enumerate(table.names) if (own := _own_name(text)) and k not in joints}
    positions, computed = _positions_of(names, numeric, {*joints, *programmed, *named.values()})
    assigned = {*joints, *programmed, *named.values(), *(k for three in positions.values() for k in three)}
    labels = {}
    for k, name in enumerate(names):
        words = {folded(name.text), folded(name.bare)}
        hint = next((hint for hint in ("pose", "target", "name") if words & WORD_SETS[hint]), "")
        if k not in assigned and (hint or not numeric[k]):
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
        named,
    )


def _own_name(text: str) -> str | None:
    """The name of an input, time, group or the like of a measurement file that a header is; None for others."""
    if folded(text) == "simulated":
        return "simulated"
    return text if text in (*OWN_COLUMNS.values(), *GOALS) or input_of(text) else None


def _numeric(table: TextTable) -> list[bool]:
    """Columns in which numbers stand, or marks of lost points beside them."""
    return [bool(np.isfinite(table.parsed(k)).mean() >= 0.5) for k in range(table.width)]


def _declared_units(lines: Sequence[str]) -> dict[str, str]:
    """Units that lines before a table declare."""
    out: dict[str, str] = {}
    for line in lines:
        text = folded(line)
        match = UNIT_WORDS.search(text)
        if not match:
            continue
        for word in re.findall(r'[^\W\d_]+|°|"', unicodedata.normalize("NFKC", line)[match.end() :]):
            unit = tables.unit_of(word)
            if unit:
                out.setdefault("joints" if unit in ("deg", "rad") else "lengths", unit)
    return out


def _joints_of(names: Sequence[_Header], numeric: Sequence[bool], kinds: Sequence[str], fewest: int) -> tuple[int, ...]:
    """Columns of the joints from the first to the last; none where there are none, or fewer than the fewest."""
    for kind in kinds:
        by_prefix: dict[str, dict[int, int]] = {}
        for k, name in enumerate(names):
            match = _JOINT.fullmatch(folded(name.bare))
            if match and name.kind == kind and numeric[k] and (match["prefix"] or match["suffix"]):
                prefix = f"{match['prefix']} {match['suffix']}"
                by_prefix.setdefault(prefix, {}).setdefault(int(match["number"]), k)
        for by_number in sorted(by_prefix.values(), key=len, reverse=True):
            first = 0 if 0 in by_number and len(by_number) not in by_number else 1
            count = next(n for n in itertools.count() if first + n not in by_number)
            if count >= fewest:
                return tuple(by_number[first + n] for n in range(count))
        by_name = {folded(name.bare): k for k, name in enumerate(names) if name.kind == kind}
        for maker in _MAKERS:
            if set(maker) <= set(by_name):
                return tuple(by_name[name] for name in maker)
    return ()


def _positions_of(
    names: Sequence[_Header], numeric: Sequence[bool], assigned: set[int]
) -> tuple[dict[str | None, tuple[int, ...]], bool]:
    """Columns of the measured positions by target, None for one target in a row; whether a controller computed them."""
    by_label: dict[tuple[str, str, int], dict[str, int]] = {}
    again: Counter[tuple[str, str, str]] = Counter()
    for k, name in enumerate(names):
        match = _AXIS.fullmatch(name.bare)
        if match and k not in assigned and numeric[k] and name.kind != "deviation":
            label = "_".join(part for part in (match["before"].strip(" _.-:"), match["after"] or "") if part)
            label = _bare_label(label)
            axis = match["axis"].lower()
            times = again[name.kind, label, axis]  # X Y Z X Y Z: as many targets
            again[name.kind, label, axis] += 1
            by_label.setdefault((name.kind, label, times), {})[axis] = k
    triples = {key: tuple(axes[a] for a in "xyz") for key, axes in by_label.items() if len(axes) == 3}
    triples = {
        key: three
        for key, three in triples.items()
        if not WORD_SETS["beside"] & set(re.split(r"[ _.\-]+", folded(key[1])))
    }
    kinds = {kind for kind, _, _ in triples}
    kind = next((kind for kind in ("actual", "") if kind in kinds), None)
    repeated = {label for kind_of, label, times in triples if kind_of == kind and times}
    of_kind = {
        f"{label}{times + 1}" if label in repeated else label: three
        for (kind_of, label, times), three in triples.items()
        if kind_of == kind
    }
    computed = bool(of_kind) and all(folded(label) in WORD_SETS["controller"] for label in of_kind)
    if any(folded(label) not in WORD_SETS["controller"] for label in of_kind):
        of_kind = {label: three for label, three in of_kind.items() if folded(label) not in WORD_SETS["controller"]}
    single = next((label for label in of_kind if folded(label) in WORD_SETS["single"]), None)
    if single is not None:
        return {None: of_kind[single]}, computed
    return {f"smr{label}" if label.isdigit() else label: three for label, three in of_kind.items()}, computed


def _bare_label(label: str) -> str:
    """A target's name without words that say what a position is, such as those above its columns."""
    tokens = re.split(r"([ _]+)", label)
    while len(tokens) > 1 and folded(tokens[0]) in WORD_SETS["beside_names"]:
        tokens = tokens[2:]
    while len(tokens) > 1 and folded(tokens[-1]) in WORD_SETS["beside_names"]:
        tokens = tokens[:-2]
    return "".join(tokens)


def _roles_by_values(
    table: TextTable, numeric: Sequence[bool], dof: int | None, declared: Mapping[str, str]
) -> Iterator[Roles]:
    """What columns without names may hold; a trial fit tells which."""
    labels = {k: "" for k in range(table.width) if not numeric[k]}
    columns = [k for k in range(table.width) if numeric[k]]
    in_cells = {"joints" if unit in source_file.ANGLE_DEG else "lengths": unit for unit in table.units.values()}
    units = in_cells.get("joints", declared.get("joints")), in_cells.get("lengths", declared.get("lengths"))
    if len(columns) == 3:
        yield Roles((), (), {None: tuple(columns)}, labels, *units)
        return
    for leading in (0, 1) if len(columns) > (dof or 99) else ():
        names = labels | dict.fromkeys(columns[:leading], "pose")
        free = columns[leading:]
        assert dof is not None
        targets, odd = divmod(len(free) - dof, 3)
        if odd or targets < 0 or (leading and not _counts(table, columns[0])):
            continue
        for joints, points in ((free[:dof], free[dof:]), (free[len(free) - dof :], free[: len(free) - dof])):
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
        out = [column_place(table, key) for key in keys]
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
    assigned = {*roles.joints, *roles.programmed, *(k for three in roles.positions.values() for k in three)}
    kept = {k: hint for k, hint in roles.labels.items() if k not in assigned and hint not in declared}
    labels = kept | {k: hint for hint, places_of in declared.items() for k in places_of}
    as_named = {name: k for name, k in roles.named.items() if k not in assigned and k not in labels}
    return replace(roles, labels=labels, named=as_named)


def column_place(table: TextTable, key: str | int) -> int | None:
    """Where a table has a column; None where it has not."""
    return None if table.names is None and isinstance(key, str) else table.find(key, "what is declared", optional=True)


def _hints(columns: DeclaredColumns) -> dict[str, Any]:
    values = {"pose": columns.pose, "target": columns.target, "name": columns.name}
    return {hint: keys for hint, keys in values.items() if keys is not None}


def _unit(table: TextTable, columns: Sequence[int]) -> str | None:
    """The unit that the header or the cells of columns declare; None for none, or several."""
    units = {(_parsed(table.names[k]).unit if table.names else None) or table.units.get(k) for k in columns} - {None}
    return next(iter(units)) if len(units) == 1 else None


def with_declared_units(roles: Roles, declared: Mapping[str, str]) -> Roles:
    """Roles with the units that lines before the table declare, where its columns declare none."""
    return replace(
        roles,
        joint_unit=declared.get("joints", roles.joint_unit),
        length_unit=declared.get("lengths", roles.length_unit),
    )
