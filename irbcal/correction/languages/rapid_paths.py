"""Points that are put into straight and circular moves of RAPID, so that a tool keeps to its path."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, locked
from irbcal.correction.languages.rapid_reader import ABSENT, Arg, Literal, MoveInstruction, Reader
from irbcal.correction.listing import Edit, Span
from irbcal.correction.maker import ConfData, configuration_of
from irbcal.correction.notation import DECIMALS, QUATERNION_DECIMALS, number_text, numbers_from_poses
from irbcal.correction.paths import CutPath, PathMove
from irbcal.correction.targets import Target
from irbcal.modeling import frames
from irbcal.units import MM

EXACT = frozenset(["MoveJ", "MoveL", "MoveAbsJ", "MoveC"])
"""Moves that do nothing else on their way."""


class InOrder(NamedTuple):
    """A move in the order of the text: the targets of its points, and the move before with its target, where known."""

    move: MoveInstruction
    ends: list[Literal | None]
    previous: tuple[MoveInstruction, Target] | None


ZONES = {"fine": 0.0, "z0": 0.3 * MM} | {f"z{n}": n * MM for n in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
"""Predefined zones and their radii, metres."""

KEPT_ARGUMENTS = ("v", "tload")
"""Optional arguments that each piece takes, too, behind the speed and at the end."""
OF_THE_END = ("z", "inpos")
"""Optional arguments that belong to the end of the move."""

_HERE = locked(np.eye(4))

_STRAIGHT = re.compile("(?:Move|Trigg|Search)[LC]")


class PathText(NamedTuple):
    """Where a move stands, and of what a piece of it is made."""

    at: int
    """Begin of the instruction."""
    via: Span | None
    """The argument that names the point on the circle."""
    ending: str
    """Of a piece, behind its points."""
    work_object: str | None
    tool: str | None
    """Names in lower case."""


def paths(
    reader: Reader, in_order: Sequence[InOrder], targets: Sequence[Target], tools: Mapping[str, FloatArray]
) -> tuple[tuple[PathMove, PathText], ...]:
    """The straight and circular moves of a module in the order of its text."""
    numbers = {id(target): k for k, target in enumerate(targets)}
    return tuple(_path(reader, step, numbers, tools) for step in in_order if _STRAIGHT.match(step.move.name))


def _path(
    reader: Reader, step: InOrder, numbers: Mapping[int, int], tools: Mapping[str, FloatArray]
) -> tuple[PathMove, PathText]:
    move, ends, previous_move = step
    circular = len(ends) > 1
    position = reader.line(move.start), reader.listing.column(move.start)
    uses = [use for end in ends if end is not None for use in end.uses if (use.line, use.column) == position]
    use = uses[0] if uses else None
    tool, work_object = (None, None) if use is None else (use.tool, use.work_object)
    T = tools.get(tool or "")
    name = f"{move.name} {move.points[-1][1].text}"
    zones = [
        _zone(reader, instruction) for instruction in ([] if previous_move is None else [previous_move[0]]) + [move]
    ]
    start = None if previous_move is None else previous_move[1]
    reason = _doubt(reader, move, T, zones, [target for target in (start, *ends) if target is not None])
    reason = "the robot holds the part" if use is not None and use.part_on_robot else reason
    text = reader.text
    speed, tool_arg = move.args[len(move.points)], move.tool
    v, load = (move.options.get(option) for option in KEPT_ARGUMENTS)
    arguments = text[speed.start : speed.end] + ("" if v is None else f"\\V:={text[v.start : v.end]}")
    arguments += f",z0,{text[tool_arg.start : tool_arg.end]}"
    if move.work_object is not None:
        arguments += f"\\WObj:={text[move.work_object.start : move.work_object.end]}"
    arguments += "" if load is None else f"\\TLoad:={text[load.start : load.end]}"
    if re.search(r"[\r\n!]", arguments):
        reason = reason or "an argument goes over several lines"
    via = (move.points[0][1].start, move.points[0][1].end) if circular else None
    radii = tuple(0.0 if zone is None else zone for zone in zones)
    path = PathMove(
        position[0],
        name,
        None if start is None else numbers[id(start)],
        numbers[id(ends[0])] if circular and ends[0] is not None else None,
        numbers[id(ends[-1])] if None not in ends else None,
        _HERE if T is None else T,
        (radii[0], radii[-1]),
        reason,
    )
    return path, PathText(move.start, via, arguments, work_object, tool)


_ONE_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")


def _doubt(
    reader: Reader,
    move: MoveInstruction,
    T: FloatArray | None,
    zones: Sequence[float | None],
    targets: Sequence[Target],
) -> str:
    """Why no points can be put into a move; empty where they can."""
    if move.name not in EXACT:
        return f"no points are put into {move.name}: what it does on its way belongs to a place on the path"
    unsupported = [option for option in move.options if option not in ("wobj", "tool", *KEPT_ARGUMENTS, *OF_THE_END)]
    if unsupported:
        return f"no points are put into a move with \\{unsupported[0]}: it would mean something else for each piece"
    if T is None:
        return "its tool is not known"
    if None in zones:
        return "a zone is not one of the predefined ones (fine, z0 … z200), or the move before is not MoveJ, MoveL, …"
    if "z0" in reader.data or any("z0" in scope for scope in reader.scopes):
        return "the module has its own z0"
    poses = [target for target in targets if target.kind == "pose"]
    if len({target.configuration.cfx if isinstance(target.configuration, ConfData) else None for target in poses}) > 1:
        return "its points have different cfx"
    if any(target.configuration is None for target in poses):
        return "a configuration is computed"
    return "" if all(_no_axes(target.external) for target in targets) else "there are external axes"


@functools.lru_cache(maxsize=256)
def _no_axes(external: str) -> bool:
    """Whether the external axes of a target are all absent."""
    values = re.sub(r"\s", "", external).lower().strip("[]").split(",")
    return all(_ONE_NUMBER.fullmatch(value) and abs(float(value)) >= ABSENT for value in values)


def _zone(reader: Reader, move: MoveInstruction) -> float | None:
    """Radius of the zone at the end of a move, metres; None where it is not known."""
    position = len(move.points) + 1
    if move.name not in EXACT or "z" in move.options or len(move.args) <= position:
        return None
    zone: Arg = move.args[position]
    name = reader.text[zone.start : zone.end].lower()
    if reader.lookup(move.scope, name) is not None:  # the module's own
        return None
    return ZONES.get(name)


def insertions(
    text: str,
    moves: Sequence[tuple[PathMove, PathText]],
    cuts: Sequence[CutPath],
    targets: Sequence[Target],
    work_objects: Mapping[str, FloatArray],
) -> tuple[list[Edit], list[Span]]:
    """Text of the points that are put into moves, and the spans of arguments that they replace."""
    edits: list[Edit] = []
    replaced: list[Span] = []
    newline = "\r\n" if "\r\n" in text else "\n" if "\n" in text or "\r" not in text else "\r"
    for (move, path_text), cut in zip(moves, cuts, strict=True):
        if not len(cut.q) or move.to is None:
            continue
        to = targets[move.to]
        points = _points(cut, to, work_objects[path_text.work_object or ""])
        line_start = max(text.rfind("\n", 0, path_text.at), text.rfind("\r", 0, path_text.at)) + 1
        indent = text[line_start : path_text.at]
        gap = newline + indent if not indent.strip(" \t\ufeff") else " "
        if path_text.via is None:
            pieces = [f"MoveL {point},{path_text.ending};{gap}" for point in points]
        else:
            pairs = zip(points[:-1:2], points[1::2], strict=True)
            pieces = [f"MoveC {via},{end},{path_text.ending};{gap}" for via, end in pairs]
            edits.append((*path_text.via, points[-1]))
            replaced.append(path_text.via)
        edits.append((path_text.at, path_text.at, "".join(pieces)))
    return edits, replaced


def _points(cut: CutPath, to: Target, T_base_wobj: FloatArray) -> list[str]:
    """Literals of the points of a cut."""
    T = frames.inverse(T_base_wobj) @ cut.T_fake @ cut.move.T_tip_tcp
    near = np.array(to.written[3:])[None].repeat(len(T), axis=0)
    assert isinstance(to.configuration, ConfData)
    confs = [configuration_of(q, to.configuration.cfx) for q in cut.q]
    return [robtarget(row, conf, to) for row, conf in zip(numbers_from_poses(T, near), confs, strict=True)]


def robtarget(numbers: Sequence[float], conf: ConfData, like: Target) -> str:
    """A literal with the external axes of another target."""
    xyz = ",".join(number_text(value, DECIMALS) for value in numbers[:3])
    turn = ",".join(number_text(value, QUATERNION_DECIMALS) for value in numbers[3:])
    external = re.sub(r"\s", "", like.external)
    return f"[[{xyz}],[{turn}],[{','.join(map(str, conf))}],{external}]"
