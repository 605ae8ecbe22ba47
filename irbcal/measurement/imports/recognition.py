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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement import text_files
from irbcal.measurement.column_names import POSITION, joint_columns, spherical
from irbcal.measurement.imports import reader
from irbcal.measurement.imports.column_map import OWN_COLUMNS, DeclaredColumns, ImportMap, validated
from irbcal.measurement.imports.column_roles import (
    ANY_NUMBER,
    Roles,
    column_place,
    likely_roles,
    with_declared_units,
)
from irbcal.measurement.imports.point_names import PointLabels, last_number, point_labels
from irbcal.measurement.imports.sheets import Sheet, sheets
from irbcal.measurement.imports.tables import TextTable
from irbcal.measurement.imports.trial_fit import SCALE_TOLERANCE, TrialFit, fit_of_table, still_targets
from irbcal.measurement.table import REFERENCE_PREFIX, names_reference
from irbcal.measurement.text_files import short
from irbcal.modeling.arm import Arm
from irbcal.units import MM
from irbcal.wording import first_of

CLEARLY = 3.0
"""So many times the best trial fit's residual has the second best, or it stays open which is right."""

COMPUTED = 3e-6
"""Metres within which a nominal robot reaches no measured point."""

NOT_USED, AS_NAMED = "not used", "as named"
"""What a column holds that is left out, and where the meaning of one comes from that bears irbcal's own name."""


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


class _RecognisedTable(NamedTuple):
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
        Files with points, and optionally one with joints: recognised, workbooks, archives, programs.
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
        if reader.joints_of_program(path) is not None:
            programs.append(str(path))
            continue
        of_file = sheets(path)
        if not of_file:
            unread.append(str(path))
        for sheet in of_file:
            answers = likely_roles(sheet, dof, columns)
            understood.append((sheet, [with_declared_units(roles, declared or {}) for roles in answers]))
    if columns is not None and understood:
        named = columns.position.values() if isinstance(columns.position, dict) else [columns.position or []]
        for key in [*(columns.joints or []), *(key for three in named for key in three)]:
            if all(column_place(sheet.table, key) is None for sheet, _ in understood):
                understood[0][0].table.find(key, "what is declared")
    both, points, only_joints = [], [], []
    measured_elsewhere = any(roles.positions and not roles.computed for _, answers in understood for roles in answers)
    for sheet, answers in understood:
        for roles in answers:
            if roles.computed and roles.joints and measured_elsewhere:
                roles = replace(roles, positions={})
            if joints is not None and text_files.file_of(sheet.source) == Path(joints):
                if roles.joints:
                    only_joints.append(_RecognisedTable(sheet, roles))
            elif roles.joints and roles.positions:
                both.append(_RecognisedTable(sheet, roles))
            elif roles.positions:
                points.append(_RecognisedTable(sheet, roles))
            elif roles.joints:
                only_joints.append(_RecognisedTable(sheet, roles))
    source = str(paths[0])
    if unread:
        raise MeasurementError("expected a table of numbers or a program with joints, found none", file=unread[0])
    recognised = _chosen(list(_candidates(both, points, only_joints, programs, source)), arm, source)
    used = {*recognised.sources, recognised.joints}
    unused = [name for name in [*(sheet.source for sheet, _ in understood), *programs] if name not in used]
    return replace(recognised, notes=(*recognised.notes, *(f"{name} is not used" for name in unused)))


class _Interpretation(NamedTuple):
    """One way to understand the files."""

    values: dict[str, Any]
    sources: tuple[str, ...]
    joints: str | None
    points: tuple[_RecognisedTable, ...]
    joints_table: _RecognisedTable | None
    joint_unit: str | None
    length_unit: str | None


def _candidates(
    full: Sequence[_RecognisedTable],
    points: Sequence[_RecognisedTable],
    only_joints: Sequence[_RecognisedTable],
    programs: Sequence[str],
    source: str,
) -> Iterator[_Interpretation]:
    if full:
        complete = list(dict.fromkeys(table.sheet.source for table in full))
        columns = [_base_values(table)["columns"] for table in full]
        if len(complete) > 1 and any(of_table != columns[0] for of_table in columns[1:]):
            raise MeasurementError(
                "expected one table with joints and points, or several with the same columns, found "
                f"{first_of(complete, 5)}: import them one by one",
                file=source,
            )
        layout = _common_layout(full) if len(complete) > 1 else None
        readings = [reading for table in full if table.sheet.source == complete[0] for reading in _together(table)]
        if not readings:
            text, joints = full[0].sheet.table, full[0].roles.joints
            lost = np.argwhere(~np.isfinite(np.column_stack([text.parsed(k) for k in joints])))
            if not len(lost):
                raise MeasurementError(
                    "there are joints and points, but no column says which target a row is: call it target, or name a "
                    "map (irbcal import --as)",
                    file=source,
                )
            row, k = lost[0]
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
    joint_sources: list[tuple[str, _RecognisedTable | None]] = [(table.sheet.source, table) for table in only_joints]
    joint_sources += [(program, None) for program in programs]
    if not points:
        hint = spherical([name for table in only_joints for name in table.sheet.table.names or ()])
        raise MeasurementError(f"expected columns of points (X, Y, Z), found none{hint}", file=source)
    if not joint_sources:
        raise MeasurementError(
            "this is a file of points only: give the file with the robot's joints, too (a table or a program), among "
            "the files or by --joints",
            file=source,
            parameter="joints",
        )
    if len({name for name, _ in joint_sources}) > 1:
        names = first_of([name for name, _ in joint_sources], 5)
        raise MeasurementError(f"expected one file with joints, found {names}: name it with --joints", file=source)
    for name, joints_table in joint_sources:
        yield from _apart(points, name, joints_table)


def columns_of(sheet: Sheet, roles: Roles) -> dict[str, Any]:
    """Columns of numbers, and those that bear the names of a measurement file's, as keys and values of a map."""
    columns: dict[str, Any] = {}
    triples = {name: [sheet.table.key(k) for k in three] for name, three in roles.positions.items()}
    columns["position"] = triples.get(None, triples)
    if roles.joints:
        columns["joints"] = [sheet.table.key(k) for k in roles.joints]
    if roles.programmed:
        columns["programmed"] = [sheet.table.key(k) for k in roles.programmed]
    named = {name: sheet.table.key(k) for name, k in roles.named.items()}
    columns |= {key: named.pop(name) for key, name in OWN_COLUMNS.items() if name in named}
    return columns | ({"keep": named} if named else {})


def _base_values(table: _RecognisedTable) -> dict[str, Any]:
    """File and columns of numbers as keys and values of a map."""
    sheet, roles = table
    columns = columns_of(sheet, roles)
    markers = sorted({cell for three in roles.positions.values() for k in three for cell in _marks(sheet.table, k)})
    return {"file": sheet.layout, "columns": columns} | ({"lost": {"markers": markers}} if markers else {})


def _marks(table: TextTable, k: int) -> list[str]:
    """Texts that stand in a column of positions in place of numbers; numbers written otherwise are refused."""
    lost = ~np.isfinite(table.parsed(k))
    texts = table.text(k)[lost]
    numbers = texts[texts.str.fullmatch(ANY_NUMBER)]
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


def _put_labels(values: dict[str, Any], labels: PointLabels) -> dict[str, Any]:
    columns = values["columns"] | {key: labels.keys[key] for key in ("pose", "target", "name") if key in labels.keys}
    out = values | {"columns": columns}
    if "names" in labels.keys:
        out["names"] = labels.keys["names"]
    if "fixed" in labels.keys:
        out["fixed"] = {"target": labels.keys["fixed"]}
    return out


def _together(table: _RecognisedTable) -> Iterator[_Interpretation]:
    """Joints and points in one table."""
    sheet, roles = table
    text = sheet.table
    q = np.column_stack([text.parsed(k) for k in roles.joints])
    if not np.isfinite(q).all():
        return
    runs = 1 + int((np.abs(np.diff(q, axis=0)).max(axis=1) > reader.SAME_JOINTS).sum())
    base = _base_values(table)
    for labels in point_labels(sheet, roles, runs if None in roles.positions else None):
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
        yield _Interpretation(values, (sheet.source,), None, (table,), None, roles.joint_unit, roles.length_unit)


def _apart(
    points: Sequence[_RecognisedTable], joints: str, joints_table: _RecognisedTable | None
) -> Iterator[_Interpretation]:
    """Points in files of their own, joints in another."""
    if joints_table is None:
        program = reader.joints_of_program(joints)
        assert program is not None
        count = len(program)
        names_of_joints = program["pose"].tolist() if "pose" in program.columns else None
        joint_values: dict[str, Any] = {}
    else:
        sheet, roles = joints_table
        count = len(sheet.table.cells)
        labels = next(point_labels(sheet, roles, None))
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
    for labels in point_labels(first.sheet, first.roles, None if len(points) > 1 else count):
        values = _put_labels(base, labels) | joint_values
        if len(points) > 1 and "fixed" in labels.keys:  # a file for each target
            values.pop("fixed")
            values["file_name"] = "{target}"
        elif None in first.roles.positions and "target" in labels.keys and "pose" not in labels.keys:
            values["pose_by"] = "target"
        for join in _joins(labels.poses, names_of_joints, count):
            yield _Interpretation(
                values | {"join": join}, sources, joints, tuple(points), joints_table, unit, length_unit
            )


def _common_layout(points: Sequence[_RecognisedTable]) -> dict[str, Any]:
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
        numbers, numbers_of_joints = ([last_number(name) for name in values] for values in (set(names), of_joints))
        if (
            None not in numbers
            and len(set(numbers)) == len(numbers)
            and len(set(numbers_of_joints)) == len(numbers_of_joints)
            and set(numbers) <= set(numbers_of_joints)
        ):
            yield "number"
    if names is None or len(set(names)) == count:
        yield "order"


def _units(candidate: _Interpretation, arm: Arm | None) -> Iterator[tuple[dict[str, Any], str]]:
    """Units of joints and lengths that may be: those declared, else each."""
    slides = None if arm is None else arm.table.prismatic
    for joint_unit in [candidate.joint_unit] if candidate.joint_unit else ["deg", "rad"]:
        length = candidate.length_unit or "mm"
        joints: Any = joint_unit
        if slides is not None and slides.any():
            joints = [length if slide else joint_unit for slide in slides]
        values = dict(candidate.values)
        units: dict[str, Any] = {"lengths": length} | ({"time": "s"} if "time" in values["columns"] else {})
        if candidate.joints is None:
            units["joints"] = joints
        elif candidate.joints_table is not None:
            values["joints_file"] = values["joints_file"] | {"units": {"joints": joints}}
        elif joint_unit != "deg":
            continue  # literals of a program have their unit
        yield values | {"units": units, "trust_units": True}, joint_unit


class _Understood(NamedTuple):
    candidate: _Interpretation
    values: dict[str, Any]
    table: pd.DataFrame
    fit: TrialFit | None
    joint_unit: str


def _chosen(candidates: Sequence[_Interpretation], arm: Arm | None, source: str) -> Recognised:
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
            fit = None if arm is None else fit_of_table(arm, imported.table)
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
    advice = (
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
                f"expected the unit of the joints to be declared, found no unit in the file: {advice} declare it with "
                f"--set {key}=deg (or rad)",
                file=source,
                parameter="units.joints",
            )
    if not candidate.length_unit:
        raise MeasurementError(
            f"expected the unit of the positions to be declared, found no unit in the file: {advice} declare it with "
            "--set units.lengths=mm (or m, inch)",
            file=source,
            parameter="units.lengths",
        )
    rivals = [rival for rival in understood[1:] if rival.candidate is not candidate and not _same(entry, rival)]
    if rivals and entry.values.get("join") != "name":
        raise MeasurementError(
            f"expected one way to understand the files, found two, {_shown(entry)}, and {_shown(rivals[0])}: {advice} "
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
    still = [name for name in still_targets(imported.table) if not names_reference(name)]
    moving = [
        str(name)
        for name in imported.table["target"].unique()
        if names_reference(str(name)) and name not in still_targets(imported.table)
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


def _columns_in_words(table: _RecognisedTable, values: Mapping[str, Any]) -> list[tuple[str, str, str]]:
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
    out |= {k: (name, AS_NAMED) for name, k in roles.named.items() if roles.positions or reader.says_of_poses(name)}
    columns = (
        values["columns"] | values.get("joints_file", {}).get("columns", {})
        if not roles.positions
        else values["columns"]
    )
    for key in ("pose", "target", "name"):
        column_names = columns.get(key)
        for column in column_names if isinstance(column_names, list) else [column_names]:
            for k in range(sheet.table.width):
                if column is not None and sheet.table.key(k) == column:
                    text = " ".join(values.get("names", [])) if key == "name" else key
                    out.setdefault(k, (text, ""))
    return [(sheet.table.label(k), *out.get(k, (NOT_USED, ""))) for k in range(sheet.table.width)]
