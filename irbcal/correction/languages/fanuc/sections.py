"""Sections of a FANUC listing: instructions with their numbers, and positions."""

from __future__ import annotations

import re
from typing import NamedTuple

from irbcal.correction.languages.fanuc.writing import config
from irbcal.correction.listing import Listing, Number
from irbcal.correction.maker_program import Found

_SECTION = re.compile(r"^/(PROG|ATTR|APPL|MN|POS|END)\b", re.MULTILINE)
_LINE = re.compile(r"^[ \t]*(\d*)[ \t]*:(.*)$", re.MULTILINE)
_POINT = re.compile(r"\bP\[[ \t]*(\d{1,6})[ \t]*(?::[^\]\r\n]*)?\][ \t]*\{([^{}]*)\}")
_GROUP = re.compile(r"\bGP(\d+)[ \t]*:")
_FRAMES = re.compile(r"\bUF[ \t]*:[ \t]*(\w+)[ \t]*,[ \t]*UT[ \t]*:[ \t]*(\w+)")
_QUOTED = re.compile(r"\w+[ \t]*:[ \t]*'([^'\r\n]*)'")
_FIELD = re.compile(r"\b([A-Z][A-Z0-9]?)[ \t]*=[ \t]*(\*+|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)[ \t]*(\w*)")

POSE, JOINTS = ("X", "Y", "Z", "W", "P", "R"), ("J1", "J2", "J3", "J4", "J5", "J6")


class Instruction(NamedTuple):
    """An instruction without its number: its text and where that stands."""

    number: int
    start: int
    end: int


class Point(NamedTuple):
    """A position: its target (or why it has none) and the frames that are stored with it."""

    number: int
    found: Found | None
    reason: str
    user_frame: str
    tool: str
    start: int


def sections(listing: Listing) -> dict[str, tuple[int, int]]:
    """First place behind the name of each section, and its end."""
    marks = list(_SECTION.finditer(listing.text))
    if not marks:
        return {}
    ends = [*(mark.start() for mark in marks[1:]), len(listing.text)]
    out: dict[str, tuple[int, int]] = {}
    for mark, end in zip(marks, ends, strict=True):
        out.setdefault(mark[1], (mark.end(), end))
    return out


def instructions(listing: Listing, start: int, end: int) -> list[Instruction]:
    """Instructions, with the lines that go on behind a colon without a number."""
    out: list[Instruction] = []
    for line in _LINE.finditer(listing.text, start, end):
        if line[1] or not out:
            out.append(Instruction(int(line[1][:9] or 0), line.start(2), line.end(2)))
        else:
            out[-1] = out[-1]._replace(end=line.end(2))
    return out


def points(listing: Listing, start: int, end: int) -> list[Point]:
    """Positions."""
    return [_point(listing, found) for found in _POINT.finditer(listing.text, start, end)]


def _point(listing: Listing, match: re.Match[str]) -> Point:
    """A position, of which the first motion group is the robot."""
    number = int(match[1])
    groups = list(_GROUP.finditer(listing.text, match.start(2), match.end(2)))
    first = next((k for k, group in enumerate(groups) if group[1] == "1"), None)
    if first is None:
        return Point(number, None, "it is of another motion group", "", "", match.start())
    begin = groups[first].end()
    end = groups[first + 1].start() if first + 1 < len(groups) else match.end(2)
    held = _FRAMES.search(listing.text, begin, end)
    frames = (held[1], held[2]) if held else ("", "")
    found, reason = _target(listing, f"P[{number}]", match.start(), begin, end)
    if found is not None and not all(frame.isdecimal() for frame in frames):
        found.reasons.append("it names no user frame or tool by number")
    if found is not None and len(groups) > 1:
        found.external = "other groups"
    return Point(number, found, reason, *frames, match.start())


def _target(listing: Listing, name: str, at: int, begin: int, end: int) -> tuple[Found | None, str]:
    fields = {field[1]: field for field in reversed(list(_FIELD.finditer(listing.text, begin, end)))}
    if "RX" in fields:
        return None, "it is a remote-TCP point: the part is on the robot and the tool is fixed"
    names = JOINTS if "J1" in fields else POSE
    unit = "deg" if "J1" in fields else "mm"
    missing = [key for key in names if key not in fields]
    if missing:
        return None, f"it has no {missing[0]}"
    if any(fields[key][2].startswith("*") for key in names):
        return None, "it is not taught (****)"
    units = [fields[key][3].lower() for key in names]
    if units != [unit] * 3 + ["deg"] * 3:
        return None, "its numbers are not in mm and degrees"
    numbers = [Number(float(fields[key][2]), fields[key].start(2), fields[key].end(2)) for key in names]
    found = Found(name, "joint" if names is JOINTS else "pose", at, numbers)
    found.external = ", ".join(key for key in fields if (key[0] == "E" and key[1:].isdecimal()) or key == "J7")
    if found.kind == "pose":
        quoted = _QUOTED.search(listing.text, begin, end)
        if quoted is None:
            found.reasons.append("it has no CONFIG")
        else:
            found.posture, found.posture_spans, reason = config(quoted[1], quoted.start(1))
            found.reasons += [reason] if reason else []
    return found, ""
