"""What the columns of dropped tables mean: in words that a page offers, and as changes of the map of an import.

It is what ``irbcal import`` understands; what a user chooses goes to its ``--set``.
"""

from __future__ import annotations

import asyncio
import json
import pickle
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from irbcal.app import steps
from irbcal.app.project import Project
from irbcal.errors import IrbcalError, MeasurementError
from irbcal.io.imported_files import recognised
from irbcal.io.opening import open_robot
from irbcal.measurement.imports.column_map import OWN_COLUMNS, DeclaredColumns, changed, validated
from irbcal.measurement.imports.column_roles import likely_roles
from irbcal.measurement.imports.reader import Imported, joints_of_program
from irbcal.measurement.imports.recognition import NOT_USED, columns_of
from irbcal.measurement.imports.sheets import Sheet, sheets
from irbcal.measurement.imports.tables import TextTable
from irbcal.measurement.table import names_reference
from irbcal.wording import counted

ROLE_TITLES = {"pose": "pose", "target": "target", "name": "pose and target"}
"""Columns of names, by their keys of the map."""
SAMPLES = 3
"""Rows that are shown of a column."""
SMALL_FILE = 1_000_000
"""Bytes of files that are read in a thread of the server: reading larger ones would hold it up."""
CHILD = (
    "import sys; from irbcal.app import columns, project; from pathlib import Path; import pickle; "
    "sys.stdout.buffer.write(pickle.dumps(columns.understood(project.Project(Path(sys.argv[1])))))"
)
"""What a process of its own does with files that are not small."""


@dataclass(frozen=True)
class TableColumns:
    """The columns of a table."""

    source: str
    keys: tuple[str | int, ...]
    """The columns as a map names them."""
    samples: tuple[str, ...]
    """The first cells of each."""
    meanings: tuple[str, ...]
    """What each means, one of `choices`."""


@dataclass(frozen=True)
class Understanding:
    """What is understood of the dropped files."""

    sentence: str
    """How many poses and targets there are."""
    complaint: str
    """Why they are refused; empty where they are not."""
    notes: tuple[str, ...]
    tables: tuple[TableColumns, ...]
    joints: int
    """How many a robot has."""
    units: Mapping[str, str]
    """In use, by their keys of the map."""
    rows: list[dict[str, Any]]
    """The first rows as they are understood."""


def understood(project: Project) -> Understanding:
    """What ``irbcal import`` understands of a project's files, with what the user said."""
    files = [str(project.folder / name) for name in project.files("data")]
    said = steps.sets(project.choices().get("data", {}))[1::2]
    imported, complaint, arm, declared, all_sheets = None, "", None, None, list[Sheet]()
    try:
        if project.robot:
            known = project.folder / project.robot
            arm = open_robot(known if known.exists() else project.robot, nominal=True).nominal
        columns = changed("{}", "--set", [text for text in said if text.startswith("columns.")]).get("columns")
        declared = validated(DeclaredColumns, columns, "--set columns") if columns else None
        all_sheets = [sheet for name in files if joints_of_program(name) is None for sheet in sheets(name)]
        imported = recognised(files, arm, set_=said)
        imported.csv()
    except (IrbcalError, OSError) as error:
        complaint = str(error).replace(f"{project.folder}/", "")
    dof = None if arm is None else len(arm.joint_names)
    tables: dict[tuple[str | int, ...], TableColumns] = {}
    for sheet in all_sheets:
        if imported is None:
            answers = likely_roles(sheet, dof, declared)
            of_table = _table(sheet.table, [columns_of(sheet, answers[0])] if answers else [])
            typed = project.choices().get("data", {}).get("words", {}).get(of_table.source, [])
            of_table = replace(of_table, meanings=tuple(typed)) if len(typed) == len(of_table.meanings) else of_table
        else:
            of_table = _table(sheet.table, _columns(imported))
        tables.setdefault(of_table.keys, of_table)
    if imported is None:
        return Understanding("", complaint, (), tuple(tables.values()), dof or 6, {}, [])
    names = list(imported.targets)
    still = sum(names_reference(name) for name in names)
    lost = int(imported.lost.sum())
    moving = len(names) - still
    parts = [f"{imported.poses} poses", counted(moving, "target moves", "targets move")]
    parts += [f"{counted(still, 'stands', 'stand')} still", *([f"lost points: {lost}"] if lost else [])]
    sentence = ", ".join(parts)
    units = {"lengths": imported.map.units.lengths, "joints": imported.map.units.joints}
    declared_units = {f"units.{key}": value for key, value in units.items() if isinstance(value, str)}
    joints = len([name for name in imported.table.columns if name.startswith("q") and name[1:2].isdigit()])
    return Understanding(
        f"{sentence}.", complaint, imported.notes, tuple(tables.values()), dof or joints, declared_units,
        [row | {"source": Path(row["source"]).name} for row in imported.first_rows(SAMPLES)],
    )  # fmt: skip


async def reading(project: Project) -> Understanding:
    """The same beside a server that goes on meanwhile; who cancels it ends the process that reads."""
    sizes = sum((project.folder / name).stat().st_size for name in project.files("data"))
    if sizes <= SMALL_FILE:
        return await asyncio.to_thread(understood, project)
    command = (sys.executable, "-c", CHILD, str(project.folder))
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    try:
        content, _ = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        complaint = (
            f"reading the files ended with exit code {process.returncode}: too large for this computer's memory?"
        )
        return Understanding("", complaint, (), (), 6, {}, [])
    answer: Understanding = pickle.loads(content)
    return answer


def _columns(imported: Imported) -> list[Mapping[str, Any]]:
    """The columns of a map in use, and of its file of joints."""
    of_joints = imported.map.joints_file
    return [part.model_dump() for part in (imported.map.columns, of_joints and of_joints.columns) if part]


def _table(table: TextTable, meanings: Sequence[Mapping[str, Any]]) -> TableColumns:
    """A table with what its columns mean."""
    handed_on = table.names is not None and any(columns.get("others") for columns in meanings)
    words = [table.label(k) if handed_on else NOT_USED for k in range(table.width)]
    for columns in meanings:
        position = columns.get("position") or {}
        of_targets = position if isinstance(position, dict) else {"": position}
        uses = {f"{axis} of {target}" if target else axis: key
                for target, three in of_targets.items() for axis, key in zip("xyz", three, strict=True)}  # fmt: skip
        uses |= {f"joint {k}": key for k, key in enumerate(columns.get("joints") or [], 1)}
        uses |= {f"programmed joint {k}": key for k, key in enumerate(columns.get("programmed") or [], 1)}
        for key, word in ROLE_TITLES.items():
            value = columns.get(key)
            uses |= dict.fromkeys([word], value[0] if isinstance(value, list) and value else value)
        uses |= {name: columns.get(key) for key, name in OWN_COLUMNS.items()} | (columns.get("keep") or {})
        for word, key in uses.items():
            k = None if key in (None, []) or (table.names is None and isinstance(key, str)) else _find(table, key)
            if k is not None:
                words[k] = word
    cells = [", ".join(table.cells[k].head(SAMPLES)) for k in range(table.width)]
    keys = tuple(table.key(k) for k in range(table.width))
    return TableColumns(Path(table.source).name, keys, tuple(cells), tuple(words))


def _find(table: TextTable, key: str | int) -> int | None:
    try:
        return table.find(key, "", optional=True)
    except MeasurementError:  # two of this name
        return None


def choices(words: Sequence[str], joints: int) -> list[str]:
    """What a column may mean: what is in use, and a target more."""
    targets = list(dict.fromkeys(word[5:] for word in words if word[:5] in ("x of ", "y of ", "z of ")))
    more = next(name for k in range(1, len(targets) + 2) if (name := f"smr{k}") not in targets)
    of_targets = [f"{axis} of {target}" for target in [*targets, more] for axis in "xyz"]
    offered = [NOT_USED, *(f"joint {k}" for k in range(1, joints + 1)), *of_targets, *"xyz", *ROLE_TITLES.values()]
    return list(dict.fromkeys([*offered, *words]))


def chosen(words: Sequence[str], k: int, word: str, joints: int) -> list[str]:
    """What columns mean once one has been given another meaning.

    Who had it gets the old one of this column. The first of several (joint 1, x) is followed by the others, as far as
    these are nowhere and the columns behind it are free.
    """
    out = list(words)
    if word != NOT_USED and word in out:
        out[out.index(word)] = words[k]
    out[k] = word
    followers = []
    if word == "joint 1":
        followers = [f"joint {n}" for n in range(2, joints + 1)]
    elif word == "x" or word.startswith("x of "):
        followers = [axis + word[1:] for axis in "yz"]
    behind = out[k + 1 : k + 1 + len(followers)]
    if len(behind) == len(followers) and set(behind) == {NOT_USED} and not set(followers) & set(out):
        out[k + 1 : k + 1 + len(followers)] = followers
    return out


def changes(tables: Sequence[tuple[Sequence[str | int], Sequence[str]]], joints: int) -> tuple[dict[str, str], str]:
    """Keys and words of tables as changes of the map, in JSON by their keys, and what is missing in a sentence."""
    uses = {word: key for keys, words in tables for key, word in zip(keys, words, strict=True) if word != NOT_USED}
    out: dict[str, Any] = {}
    missing = []
    numbers = sorted(int(word[6:]) for word in uses if word.startswith("joint "))
    if numbers:
        missing += [f"joint {k}" for k in range(1, max(joints, *numbers) + 1) if k not in numbers]
        out["columns.joints"] = [uses[f"joint {k}"] for k in numbers]
    targets = dict.fromkeys(word[5:] for word in uses if word[:5] in ("x of ", "y of ", "z of "))
    position: dict[str, list[str | int]] = {}
    for target in [*targets, *([""] if {*"xyz"} & set(uses) else [])]:
        three = [f"{axis} of {target}" if target else axis for axis in "xyz"]
        missing += [word for word in three if word not in uses]
        position[target] = [uses[word] for word in three if word in uses]
    if "" in position and len(position) > 1:
        missing.append("the target of x, y and z")
    if position:
        out["columns.position"] = position.get("", position)
    for key, word in ROLE_TITLES.items():
        if word in uses:
            out[f"columns.{key}"] = [uses[word]] if key == "name" else uses[word]
    sentence = f"Still missing: {', '.join(missing)}." if missing else ""
    return ({} if missing else {key: json.dumps(value, ensure_ascii=False) for key, value in out.items()}), sentence
