"""Touches out of robot programs: taught points at which the tip of a tool touched something.

A table of touches (`irbcal.cell.cell_frames`) names such points in the column ``target``, in place of joints::

    frame,name,point,tool,target

The joints are those to which the controller moves for the target: by its own model, with the tool and work object of
the move, in the posture of the target.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import TOOL, WORK_OBJECT
from irbcal.correction.corrected_targets import meant_joints
from irbcal.correction.filter import OpenedPrograms, read_programs
from irbcal.correction.program import refuse_filtered
from irbcal.correction.text_program import TextProgram
from irbcal.errors import OptionError
from irbcal.io.opening import CalibrationLike
from irbcal.measurement.columns import InputTable, TableLike, joint_units

LISTED = 6
"""Names of targets that a message lists."""


class ProgramTouches(NamedTuple):
    """Touches whose joints come from programs.

    Attributes
    ----------
    table : DataFrame
        For `irbcal.cell_frames`, with joints in place of targets; the rows have the numbers that they have in the file.
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        What the controller has for tools and work objects of the table, as far as programs or caller say, by names in
        lower case: tools in the tip link, work objects in the base link, metres.
    """

    table: pd.DataFrame
    tools: dict[str, FloatArray]
    work_objects: dict[str, FloatArray]


class _Point(NamedTuple):
    """A target of a program; its joints as the controller shows them, radians, or why there are none."""

    name: str
    place: str
    q: FloatArray
    reason: str
    tool: str


def program_touches(
    calibration: CalibrationLike,
    touches: TableLike,
    program: str | Path | Sequence[str | Path],
    *,
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    pulses: Sequence[float] | None = None,
    controller_model: str | Path | None = None,
    where: tuple[ArrayLike, ArrayLike] | None = None,
) -> ProgramTouches:
    """Touches whose joints are those of taught points of robot programs.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
    touches : str, Path or DataFrame
        Touches, a row each, with a column ``target``: the name of a taught point. A row without one has joints. Without
        a ``tool`` a work object was touched with the tool of the point's move.
    program : str, Path or sequence of these
        Programs or position lists with these points, of one language.
    tool, wobj : dict of str to ndarray, shape (4, 4), optional
        See `irbcal.correct`.
    pulses : sequence of float, optional
        See `irbcal.correct`.
    controller_model : str or Path, optional
        See `irbcal.correct`.
    where : tuple, optional
        See `irbcal.correct`.

    Raises
    ------
    MeasurementError
        If the table cannot be read, or names a point that the programs do not have or that tells no joints.
    ProgramError
        If a program cannot be read, holds fake targets, or needs a frame that is not known.

    Examples
    --------
    >>> found = program_touches("my-robot", "touches.csv", "job.mod")  # doctest: +SKIP
    >>> cell_frames("my-robot", found.table, tool=found.tools, wobj=found.work_objects)  # doctest: +SKIP
    """
    given = [program] if isinstance(program, (str, os.PathLike)) else [*program]
    if not given:
        raise OptionError("program: expected a file, found none", parameter="program")
    rows = InputTable.read(touches, ["frame", "name", "point", "target"])
    cells = rows.cells
    opened = read_programs(calibration, given, tool, wobj, pulses, controller_model, where)
    points = _points(opened)
    names = [*opened.nominal.joint_columns]
    table = cells.drop(columns="target").assign(**{name: cells.get(name, "") for name in names})
    table["tool"] = table["tool"].astype(str) if "tool" in table else ""
    written = {name.lower(): name for name in table["name"].astype(str).str.strip()}
    for k, (row, text) in enumerate(zip(cells.index, rows.texts("target"), strict=True)):
        if text:
            point = _point(points, text, given, rows, k)
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


def _points(opened: OpenedPrograms) -> dict[str, list[_Point]]:
    """All targets of programs by their names in lower case; those that name their file, by both."""
    points: list[_Point] = []
    shown = opened.nominal.to_controller
    for program in opened.programs:
        refuse_filtered(program)
        joints: dict[int, tuple[FloatArray, str]] = {}
        for batch, q, reasons in meant_joints(program, opened.nominal, opened.setup.own_model):
            joints |= dict(zip(batch.numbers.tolist(), zip(shown(q), map(str, reasons), strict=True), strict=True))
            if not isinstance(program, TextProgram):
                numbered = zip(batch.names, batch.numbers.tolist(), batch.lines.tolist(), strict=True)
                points += [
                    _Point(name, f"line {line} of {Path(program.source).name}", *joints[k], "")
                    for name, k, line in numbered
                ]
        if not isinstance(program, TextProgram):
            continue
        for number, target in enumerate(program.targets):
            q, reason = joints.get(number, (target.value, target.reason))
            if target.kind == "joint" and not target.conflicts and number not in joints:  # not used, and known
                q = target.value if program.joints_of_urdf else opened.nominal.from_controller(target.value[None])[0]
                q, reason = shown(q[None])[0], ""
            tool = (target.uses[0].tool or "") if target.uses else ""
            file = Path(program.listing.parts[program.listing.part(target.start)].name).name
            points.append(_Point(target.name, f"line {target.line} of {file}", q, reason, tool))
    out: dict[str, list[_Point]] = {}
    for point in points:
        for name in dict.fromkeys((point.name.lower(), point.name.lower().partition(" of ")[0])):
            out.setdefault(name, []).append(point)
    return out


def _point(
    points: Mapping[str, list[_Point]], name: str, programs: Sequence[str | Path], rows: InputTable, row: int
) -> _Point:
    """The one target of a name, with joints."""
    named = points.get(name.lower(), [])
    if not named:
        every = [*dict.fromkeys(point.name for same in points.values() for point in same)]
        known = ", ".join(every[:LISTED]) + (" …" if len(every) > LISTED else "")
        files = ", ".join(Path(path).name for path in programs)
        fault = f"expected a point of {files}, such as {known or 'none'}, found {name!r}"
    elif len(named) > 1:
        fault = f"{name} stands in {' and in '.join(point.place for point in named)}: name one of these programs only"
    elif named[0].reason:
        fault = f"the joints of {name} ({named[0].place}) are not known: {named[0].reason}"
    else:
        return named[0]
    raise rows.fault(fault, row, "target")
