"""Straight and circular moves of a RAPID module, and the text of moves that are put between them.

Points are put only into ``MoveL`` and ``MoveC`` whose stop before is known, and whose arguments mean the same for each
piece: a speed, a predefined zone, tool and work object. Pieces are joined with ``z0``, so that the robot does not stop.
"""

from __future__ import annotations

import bisect
import functools
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, locked
from irbcal.correction.configurations import ConfData, configuration_of
from irbcal.correction.cutting import CutPath, PathMove
from irbcal.correction.languages.rapid.parts import ABSENT, Arg, Literal, Move
from irbcal.correction.languages.rapid.syntax import EXACT, PATTERNS, Reader
from irbcal.correction.listing import Edit, Span
from irbcal.correction.notation import DECIMALS, QUATERNION_DECIMALS, number_text, numbers_from_poses
from irbcal.correction.text_program import Target
from irbcal.modeling import frames
from irbcal.units import MM

ZONES = {"fine": 0.0, "z0": 0.3 * MM} | {f"z{n}": n * MM for n in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
"""Predefined zones and their radii, metres."""

KEPT = ("v", "tload")
"""Optional arguments that each piece takes, too, behind the speed and at the end."""
OF_THE_END = ("z", "inpos")
"""Optional arguments that belong to the end of the move."""

_HERE = locked(np.eye(4))

_STRAIGHT = re.compile("(?:Move|Trigg|Search)[LC]")

Points = Sequence[tuple[Move, list[tuple[list[Literal], bool]]]]


class PathText(NamedTuple):
    """Where a move stands, and of what a piece of it is made.

    Attributes
    ----------
    at : int
        Begin of the instruction.
    via : (int, int) or None
        The argument that names the point on the circle.
    rest : str
        Of a piece, behind its points.
    work_object, tool : str or None
        Names in lower case.
    """

    at: int
    via: Span | None
    rest: str
    work_object: str | None
    tool: str | None


def paths(
    reader: Reader,
    goals: Points,
    numbers: Mapping[int, int],
    targets: Sequence[Target],
    tools: Mapping[str, FloatArray],
    places: Sequence[int],
) -> tuple[tuple[PathMove, PathText], ...]:
    """The straight and circular moves of a module in the order of its text; arguments as for `order.stops`."""
    out = []
    before: tuple[Move, int] | None = None
    last = 0
    for move, points in sorted(goals, key=lambda goal: goal[0].start):
        if bisect.bisect_left(places, move.start) > bisect.bisect_left(places, last):
            before = None
        last = move.start
        ends = [numbers[id(found[0])] if len(found) == 1 and not computed else None for found, computed in points]
        if _STRAIGHT.match(move.name):
            out.append(_path(reader, move, ends, before, targets, tools))
        known = bool(ends) and ends[-1] is not None and not move.name.startswith("Search")
        before = (move, ends[-1]) if known and ends[-1] is not None else None
    return tuple(out)


def _path(
    reader: Reader,
    move: Move,
    ends: Sequence[int | None],
    before: tuple[Move, int] | None,
    targets: Sequence[Target],
    tools: Mapping[str, FloatArray],
) -> tuple[PathMove, PathText]:
    circular = len(ends) > 1
    here = reader.line(move.start), reader.column(move.start)
    uses = [use for k in ends if k is not None for use in targets[k].uses if (use.line, use.column) == here]
    use = uses[0] if uses else None
    tool, work_object = (None, None) if use is None else (use.tool, use.work_object)
    T = tools.get(tool or "")
    name = f"{move.name} {move.points[-1][1].text}"
    zones = [_zone(reader, one) for one in ([] if before is None else [before[0]]) + [move]]
    start = None if before is None else before[1]
    why = _doubt(reader, move, T, zones, [targets[k] for k in (start, *ends) if k is not None])
    text = reader.text
    speed, tool_arg = move.args[len(move.points)], move.tool
    v, load = (move.options.get(option) for option in KEPT)
    rest = text[speed.start : speed.end] + ("" if v is None else f"\\V:={text[v.start : v.end]}")
    rest += f",z0,{text[tool_arg.start : tool_arg.end]}"
    if move.work_object is not None:
        rest += f"\\WObj:={text[move.work_object.start : move.work_object.end]}"
    rest += "" if load is None else f"\\TLoad:={text[load.start : load.end]}"
    if re.search(r"[\r\n!]", rest):
        why = why or "an argument goes over several lines"
    via = (move.points[0][1].start, move.points[0][1].end) if circular else None
    radii = tuple(0.0 if zone is None else zone for zone in zones)
    path = PathMove(
        reader.line(move.start),
        name,
        start,
        ends[0] if circular else None,
        ends[-1] if None not in ends else None,
        _HERE if T is None else T,
        (radii[0], radii[-1]),
        why,
    )
    return path, PathText(move.start, via, rest, work_object, tool)


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")


def _doubt(
    reader: Reader, move: Move, T: FloatArray | None, zones: Sequence[float | None], targets: Sequence[Target]
) -> str:
    """Why no points can be put into a move; empty where they can."""
    if move.name not in EXACT:
        return f"no points are put into {move.name}: what it does on its way belongs to a place on the path"
    others = [option for option in move.options if option not in ("wobj", "tool", *KEPT, *OF_THE_END)]
    if others:
        return f"no points are put into a move with \\{others[0]}: it would mean something else for each piece"
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
    return all(_NUMBER.fullmatch(value) and abs(float(value)) >= ABSENT for value in values)


def _zone(reader: Reader, move: Move) -> float | None:
    """Radius of the zone at the end of a move, metres; None where it is not known."""
    place = len([role for role in PATTERNS[move.name].split() if role in ("to", "via", "w")]) + 1
    if move.name not in EXACT or "z" in move.options or len(move.args) <= place:
        return None
    zone: Arg = move.args[place]
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
    for (move, place), cut in zip(moves, cuts, strict=True):
        if not len(cut.q) or move.to is None:
            continue
        to = targets[move.to]
        points = _points(cut, to, work_objects[place.work_object or ""])
        line_start = max(text.rfind("\n", 0, place.at), text.rfind("\r", 0, place.at)) + 1
        indent = text[line_start : place.at]
        gap = newline + indent if not indent.strip(" \t\ufeff") else " "
        if place.via is None:
            pieces = [f"MoveL {point},{place.rest};{gap}" for point in points]
        else:
            pairs = zip(points[:-1:2], points[1::2], strict=True)
            pieces = [f"MoveC {via},{end},{place.rest};{gap}" for via, end in pairs]
            edits.append((*place.via, points[-1]))
            replaced.append(place.via)
        edits.append((place.at, place.at, "".join(pieces)))
    return edits, replaced


def _points(cut: CutPath, to: Target, T_base_wobj: FloatArray) -> list[str]:
    """Literals of the points of a cut."""
    T = frames.inverse(T_base_wobj) @ cut.T_fake @ cut.move.T_tip_tcp
    near = np.array(to.written[3:])[None].repeat(len(T), axis=0)
    out = []
    assert isinstance(to.configuration, ConfData)
    external = re.sub(r"\s", "", to.external)
    for row, q in zip(numbers_from_poses(T, near), cut.q, strict=True):
        place = ",".join(number_text(value, DECIMALS) for value in row[:3])
        turn = ",".join(number_text(value, QUATERNION_DECIMALS) for value in row[3:])
        conf = ",".join(map(str, configuration_of(q, to.configuration.cfx)))
        out.append(f"[[{place}],[{turn}],[{conf}],{external}]")
    return out
