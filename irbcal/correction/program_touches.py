"""Touches out of robot programs: taught points at which the tip of a tool touched something; touches to make.

A table of touches (`irbcal.cell_frames`) names such points in the column ``target``, in place of joints::

    frame,name,point,tool,target

The joints are those to which the controller moves for the target: by its own model, with the tool and work object of
the move, in the posture of the target.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import TOOL, WORK_OBJECT
from irbcal.cell.touch_rows import LEAST_SIDES
from irbcal.cell.touches import TAUGHT
from irbcal.correction.backup import unpacked
from irbcal.correction.cell_options import CellOptions
from irbcal.correction.corrected_targets import meant_joints
from irbcal.correction.opened_programs import OpenedPrograms, read_programs
from irbcal.correction.program import refuse_filtered
from irbcal.correction.program_options import ProgramOptions
from irbcal.correction.text_program import TextProgram
from irbcal.correction.true_frames import ROUNDING
from irbcal.declared_options import takes_fields_of
from irbcal.measurement.column_names import joint_units
from irbcal.measurement.input_table import InputTable, poses_to_frame
from irbcal.summary import Paragraph, Result, Table
from irbcal.wording import first_of

LISTED = 6
"""Names of targets that a message lists."""


class ProgramTouches(NamedTuple):
    """Touches whose joints come from programs."""

    table: pd.DataFrame
    """For `irbcal.cell_frames`, with joints in place of targets; the rows have the numbers that they have in the file.
    """
    tools: dict[str, FloatArray]
    work_objects: dict[str, FloatArray]
    """Values of shape (4, 4). What the controller has for tools and work objects of the table, as far as programs or
    caller say, by names in lower case: tools in the tip link, work objects in the base link, metres.
    """


class FrameInPrograms(NamedTuple):
    """A tool or work object that moves of programs use."""

    frame: str
    name: str
    """``tool`` or ``work_object``, and its name in lower case."""
    tool: str
    """A tool that its targets are moved to with."""
    targets: int
    """Poses that are moved to with it."""
    T: FloatArray | None
    """Shape (4, 4). What the controller has, in the tip link or the base link, metres; None where the programs do not
    say.
    """


@dataclass(frozen=True, eq=False, repr=False)
class NeededTouches(Result):
    """Tools and work objects of programs, and which touches would make them true.

    Attributes
    ----------
    frames : tuple of FrameInPrograms
        The most used first; flange and robot base themselves are none.
    joint_columns : tuple of str
        Names of the arm's joints in tables.
    """

    frames: tuple[FrameInPrograms, ...]
    joint_columns: tuple[str, ...]

    CONTENT = "frames=to_frame"

    def report(self) -> list[Paragraph]:
        """Tools, work objects and the touches that show them."""
        if not self.frames:
            return ["The programs use no tool and no work object but the flange and the robot base"]
        table = Table.from_frame("Tools and work objects", self.to_frame().drop(columns="tool"))
        sides = f"{LEAST_SIDES} sides or more, turned about different axes"
        return [
            table,
            f"tool: bring its tip to one place that stays (point socket) from {sides}",
            "work_object: bring the tip of the tool to its origin, a point x on +x and a point xy in its xy plane, "
            f"or to {LEAST_SIDES} points or more whose coordinates are known (x_mm, y_mm, z_mm)",
        ]

    def to_frame(self) -> pd.DataFrame:
        """A row for each frame: ``frame``, ``name``, ``tool``, ``targets``, ``x_mm`` … ``qz`` of the controller."""
        T = np.array([np.full((4, 4), np.nan) if f.T is None else f.T for f in self.frames]).reshape(-1, 4, 4)
        rows = [(f.frame, f.name, f.tool, f.targets) for f in self.frames]
        return pd.DataFrame(rows, columns=["frame", "name", "tool", "targets"]).join(poses_to_frame(T))

    def touches(self) -> pd.DataFrame:
        """The touches to make, a row each, for `irbcal.cell_frames`: joints are to be filled in."""
        rows = []
        for frame in self.frames:
            points = ["socket"] * (LEAST_SIDES + 1) if frame.frame == TOOL else TAUGHT
            rows += [(frame.frame, frame.name, point, frame.tool) for point in points]
        table = pd.DataFrame(rows, columns=["frame", "name", "point", "tool"])
        return table.assign(**dict.fromkeys(self.joint_columns, ""))


@takes_fields_of(ProgramOptions)
def needed_touches(options: ProgramOptions) -> NeededTouches:
    """Tools and work objects that robot programs use, and which touches would make them true.

    Raises
    ------
    ProgramError
        If no program can be read.

    Examples
    --------
    >>> needed_touches("my-robot", "backup.zip").touches().to_csv("touches.csv")  # doctest: +SKIP
    """
    with unpacked(options.programs) as files:
        opened = read_programs(options, files.programs)
    ends, counts = opened.setup.controller, Counter[tuple[str, str]]()
    xyz_of_point: dict[tuple[str, str], FloatArray] = {}
    used_with: dict[tuple[str, str], str] = {}
    for read in opened.programs:
        if not isinstance(read, TextProgram):
            continue
        xyz_of_point |= {(TOOL, name): T for name, T in read.tools.items()}
        xyz_of_point |= {(WORK_OBJECT, name): T for name, T in read.work_objects.items()}
        for target in read.targets:
            uses = {(use.tool, use.work_object) for use in target.uses if target.kind == "pose"}
            for tool_name, work_object in uses:
                for key in ((TOOL, tool_name), (WORK_OBJECT, work_object)):
                    if key[1] is not None:
                        counts[key[0], key[1]] += 1
                        used_with.setdefault((key[0], key[1]), tool_name or "")
    null = {TOOL: ends.T_tip_flange, WORK_OBJECT: ends.T_base_world}
    frames = []
    for key, count in counts.most_common():
        T = xyz_of_point.get(key)
        off = [np.abs(T - T_null).max() for T_null in (null[key[0]], np.eye(4)) if T is not None]
        if min(off, default=np.inf) > ROUNDING and key[1] != "null":
            frames.append(FrameInPrograms(*key, used_with[key], count, T))
    return NeededTouches(tuple(frames), tuple(opened.nominal.joint_columns))


class _TouchedTarget(NamedTuple):
    """A target of a program; its joints as the controller shows them, radians, or why there are none."""

    name: str
    line_in_words: str
    q: FloatArray
    reason: str
    tool: str


def with_joints(options: CellOptions) -> ProgramTouches:
    """Touches whose joints are those of taught points of robot programs; errors as of `irbcal.cell_frames`."""
    files = [*map(Path, options.programs)]
    rows = InputTable.read(options.touches, ["frame", "name", "point", "target"])
    cells = rows.cells
    with unpacked(options.programs) as unpacked_files:
        opened = read_programs(options, unpacked_files.programs)
    points = _points(opened)
    names = [*opened.nominal.joint_columns]
    table = cells.drop(columns="target").assign(**{name: cells.get(name, "") for name in names})
    table["tool"] = table["tool"].astype(str) if "tool" in table else ""
    written = {name.lower(): name for name in table["name"].astype(str).str.strip()}
    for k, (row, text) in enumerate(zip(cells.index, rows.texts("target"), strict=True)):
        if text:
            point = _point(points, text, files, rows, k)
            table.loc[row, names] = (point.q / joint_units(names)).astype(str)
            if table.loc[row, "frame"] == WORK_OBJECT and not str(table.loc[row, "tool"]).strip():
                table.loc[row, "tool"] = written.get(point.tool, point.tool)
    ends = opened.setup.controller
    of_frame = {frame: set(table["name"][table["frame"] == frame].str.lower()) for frame in (TOOL, WORK_OBJECT)}
    tools = {name: ends.T_tip_flange @ T for name, T in opened.setup.tools.items()}
    work_objects = {name: ends.T_base_world @ T for name, T in opened.setup.work_objects.items()}
    for program_read in opened.programs:
        if isinstance(program_read, TextProgram):
            tools |= program_read.tools
            work_objects |= program_read.work_objects
    return ProgramTouches(
        table,
        {name: T for name, T in tools.items() if name in of_frame[TOOL]},
        {name: T for name, T in work_objects.items() if name in of_frame[WORK_OBJECT]},
    )


def _points(opened: OpenedPrograms) -> dict[str, list[_TouchedTarget]]:
    """All targets of programs by their names in lower case; those that name their file, by both."""
    points: list[_TouchedTarget] = []
    shown = opened.nominal.to_controller
    for program in opened.programs:
        refuse_filtered(program)
        joints: dict[int, tuple[FloatArray, str]] = {}
        for batch, q, reasons in meant_joints(program, opened.nominal, opened.setup.controller_arm):
            joints |= dict(zip(batch.numbers.tolist(), zip(shown(q), map(str, reasons), strict=True), strict=True))
            if not isinstance(program, TextProgram):
                numbered = zip(batch.names, batch.numbers.tolist(), batch.lines.tolist(), strict=True)
                points += [
                    _TouchedTarget(name, f"line {line} of {Path(program.source).name}", *joints[k], "")
                    for name, k, line in numbered
                ]
        if not isinstance(program, TextProgram):
            continue
        for number, target in enumerate(program.targets):
            q, reason = joints.get(number, (target.value, target.reason))
            if target.kind == "joint" and not target.conflicts and number not in joints:  # not used, and known
                q, reason = shown(target.value[None])[0], ""
            tool = (target.uses[0].tool or "") if target.uses else ""
            file = Path(program.listing.files[program.listing.file_at(target.start)].name).name
            points.append(_TouchedTarget(target.name, f"line {target.line} of {file}", q, reason, tool))
    out: dict[str, list[_TouchedTarget]] = {}
    for point in points:
        for name in dict.fromkeys((point.name.lower(), point.name.lower().partition(" of ")[0])):
            out.setdefault(name, []).append(point)
    return out


def _point(
    points: Mapping[str, list[_TouchedTarget]], name: str, programs: Sequence[Path], rows: InputTable, row: int
) -> _TouchedTarget:
    """The one target of a name, with joints."""
    candidates = points.get(name.lower(), [])
    if not candidates:
        every = [*dict.fromkeys(point.name for same in points.values() for point in same)]
        files = ", ".join(path.name for path in programs)
        fault = f"expected a point of {files}, such as {first_of(every, LISTED) or 'none'}, found {name!r}"
    elif len(candidates) > 1:
        lines = " and in ".join(point.line_in_words for point in candidates)
        fault = f"{name} stands in {lines}: name one of these programs only"
    elif candidates[0].reason:
        fault = f"the joints of {name} ({candidates[0].line_in_words}) are not known: {candidates[0].reason}"
    else:
        return candidates[0]
    raise rows.fault(fault, row, "target")
