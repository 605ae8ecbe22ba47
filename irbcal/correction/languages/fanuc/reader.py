"""FANUC LS listings: positions ``P[n]`` and the moves that go there.

User frame and tool are those that stand in each position (the controller refuses to move where others are active);
their values are not in the program and must be given, but for 0, the world and the flange.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from irbcal.correction.course import Course, State
from irbcal.correction.languages.fanuc.sections import Instruction, Point, instructions, points, sections
from irbcal.correction.languages.fanuc.writing import FANUC, LsProgram
from irbcal.correction.listing import Listing, mark_in
from irbcal.correction.maker_program import Found, parts_of
from irbcal.correction.program import Given, Note, read_bytes
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

_MOVE = re.compile(r"\s*([JLCAS])[ \t]+(?=P|PR\[)")
_GOAL = re.compile(r"[\s:]*\b(PR?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]")
_INDEX = re.compile(r"\s*(\d{1,6})\s*(?::.*)?\Z", re.DOTALL)
_FLOW = re.compile(r"\b(LBL|JMP|CALL|IF|SELECT|FOR|ENDFOR|RUN|WENN|AUFRUF|SPRUNG)\b")
_FRAME = re.compile(r"\b(UFRAME|UTOOL)\[[ \t]*(\w+)[^\]]*\][ \t]*=")
_REASONS = (
    (re.compile(r"\bRTCP\b"), "RTCP moves a part against a fixed tool"),
    (re.compile(r"\bINC\b"), "INC makes its target relative"),
    (re.compile(r"\bCOORD\b"), "COORD moves against another motion group"),
    (re.compile(r"\bVOFFSET\b"), "a camera moves its target (VOFFSET)"),
)
_OFFSET = re.compile(r"\b(?:TOOL_|WKZ_)?OFFSET\b")


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a FANUC listing."""
    return re.search(rb"^/PROG\b", data, re.MULTILINE) is not None and b"/MN" in data


def read_for(arm: Arm, files: Sequence[Path], given: Given) -> list[LsProgram]:
    """Read FANUC listings for an arm, each a program; see `irbcal.correction.languages.Language`."""
    FANUC.check(arm, str(files[0]))
    return [parse(arm, read_bytes(file), str(file), given) for file in files]


def parse(arm: Arm, data: bytes, source: str, given: Given) -> LsProgram:
    """Read a FANUC listing.

    Raises
    ------
    ProgramError
        If this is none, or a frame that is needed is not known.
    """
    listing = Listing([(source, data)], "FANUC LS")
    places = sections(listing)
    if "PROG" not in places or "MN" not in places:
        raise ProgramError("expected a FANUC listing with /PROG and /MN", file=source)
    if "END" not in places:
        raise ProgramError("the listing does not end with /END", file=source)
    taught: dict[int, Point] = {}
    for point in points(listing, *places["POS"]) if "POS" in places else ():
        if point.number in taught:
            raise listing.error(point.start, f"P[{point.number}] stands here a second time")
        taught[point.number] = point
    moves = _Moves(listing, taught)
    steps = instructions(listing, *places["MN"])
    for step in steps:
        moves.take(step)
    found = [point.found for point in taught.values() if point.found is not None]
    order = moves.course.order({id(one): k for k, one in enumerate(found)})
    eye = {"0": frames.transform()}
    return LsProgram(
        **parts_of(FANUC.of(arm), arm, listing, found, order, given, eye, eye, source),
        uncorrected=tuple(moves.course.uncorrected),
        notes=tuple(moves.notes(found)),
        fingerprint=_mark_in(moves.comments),
        mark_at=places["MN"][1],
        mark_number=max((step.number for step in steps), default=0) + 1,
    )


class _Moves:
    """Follows the instructions."""

    def __init__(self, listing: Listing, taught: dict[int, Point]) -> None:
        self.listing, self.taught = listing, taught
        self.course = Course(listing)
        self.comments: list[str] = []
        self._noted: dict[str, Note] = {}

    def take(self, step: Instruction) -> None:
        """Take one instruction."""
        text = self.listing.text[step.start : step.end]
        if text.lstrip().startswith(("!", "//", "--")):
            self.comments.append(text)
            return
        text = re.sub(r"'[^'\r\n]*'|\"[^\"\r\n]*\"", lambda found: " " * len(found[0]), text)
        move = _MOVE.match(text)
        if move is not None:
            self._move(step, text, move)
            return
        self._changes(step, text)
        if _FLOW.search(text.upper()):
            self.course.forget()
        for goal in _GOAL.finditer(text):
            if goal[1] == "P":
                why = f"line {self.listing.line(step.start)} uses it in another way"
                for point in self._named(goal[2])[0]:
                    if point.found is not None:
                        point.found.reasons.append(why)

    def _named(self, inside: str) -> tuple[list[Point], str]:
        """Positions that an index names, all where it is computed, and why there are none."""
        index = _INDEX.match(inside)
        if index is None:
            return list(self.taught.values()), ""
        point = self.taught.get(int(index[1]))
        return ([point], "") if point is not None else ([], "it is not in the /POS section")

    def _move(self, step: Instruction, text: str, move: re.Match[str]) -> None:
        at = move.end()
        goals = []
        for _ in range(2 if move[1] == "C" else 1):
            goal = _GOAL.match(text, at)
            if goal is None:
                break
            goals.append(goal)
            at = goal.end()
        options = text[at:].upper()
        reason = next((words for sign, words in _REASONS if sign.search(options)), "")
        if _OFFSET.search(options) and not reason:
            line = self.listing.line(step.start)
            self._noted.setdefault("offset", Note(line, "an offset moves targets that are corrected without it"))
        stop: Found | None = None
        for k, goal in enumerate(goals):
            stop = self._goal(step, move[1], goal, "via" if k < len(goals) - 1 else "to", reason)
        if not goals or (move[1] == "C" and len(goals) < 2):
            self.course.left(step.start, move[1], self.listing.quote(step.start, step.end), "its target is computed")
        self.course.stop(stop, step.start)

    def _goal(self, step: Instruction, move: str, goal: re.Match[str], role: str, reason: str) -> Found | None:
        """Use the positions of one argument; the target where it is just one."""
        text = goal[0].strip(" \t\r\n:")
        if goal[1] == "PR":
            self.course.left(step.start, move, text, "a position register stands in the controller only")
            return None
        named, missing = self._named(goal[2])
        if missing:
            self.course.left(step.start, move, text, missing)
        for point in named:
            if point.found is None:
                self.course.left(step.start, move, f"P[{point.number}]", point.reason)
                continue
            point.found.reasons += [reason] if reason else []
            state = State(point.tool, point.user_frame)
            self.course.use(point.found, step.start, move, "via" if role == "via" else "to", state)
        return named[0].found if len(named) == 1 and not reason else None

    def _changes(self, step: Instruction, text: str) -> None:
        """Frames that the program sets itself."""
        for change in _FRAME.finditer(text.upper()):
            line = self.listing.line(step.start)
            for point in self.taught.values():
                held = point.user_frame if change[1] == "UFRAME" else point.tool
                if point.found is not None and (held == change[2] or not change[2].isdecimal()):
                    point.found.reasons.append(f"line {line} changes {change[1]}[{change[2]}]")

    def notes(self, found: Sequence[Found]) -> list[Note]:
        """What the corrections do not know about."""
        moved = next((one for one in found if one.external and one.uses), None)
        if moved is not None:
            text = (
                f"{moved.name} has other axes or groups: where they carry the robot or the work, its place is another"
            )
            self._noted.setdefault("external", Note(self.listing.line(moved.start), text))
        if any(one.kind == "joint" and one.uses for one in found):
            text = "joint 3 is taken as the pendant counts it, against the horizontal: check one pair on the pendant"
            self._noted.setdefault("coupled", Note(1, text))
        return list(self._noted.values())


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the mark of a listing; empty where it names none, None without mark.

    Raises
    ------
    ProgramError
        If this is no FANUC listing.
    """
    listing = Listing([(source, data)], "FANUC LS")
    if not looks_like(data):
        raise ProgramError("expected a FANUC listing with /PROG and /MN", file=source)
    steps = instructions(listing, *sections(listing)["MN"]) if "MN" in sections(listing) else []
    texts = [listing.text[step.start : step.end] for step in steps]
    return _mark_in([text for text in texts if text.lstrip().startswith("!")])


def _mark_in(comments: Sequence[str]) -> str | None:
    """Fingerprint in the mark among comments, of which the second line bears it."""
    return mark_in([" ".join(text.strip(" \t\r!;") for text in comments)])
