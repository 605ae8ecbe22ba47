"""FANUC LS listings: positions ``P[n]`` and the moves that go there.

User frame and tool are those that stand in each position (the controller refuses to move where others are active);
their values are not in the program and must be given, but for 0, the world and the flange.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.backup import files_named, text_of
from irbcal.correction.calls import Calls
from irbcal.correction.control_flow import ControlFlow, FrameState
from irbcal.correction.language import TO_99, FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.listing import Edit, Listing, Number, Span, joined_comments, up_to_next
from irbcal.correction.loads import Load, LoadFlow, load_of, unknown_load
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Note, Program, each_read, read_bytes
from irbcal.correction.targets import Configuration, Target
from irbcal.correction.text_program import NumberedData, PostureProgram, from_backup
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

_COUPLED = np.eye(6)
_COUPLED[2, 1] = 1.0  # the pendant measures joint 3 against the horizontal

FANUC = Maker(
    name="FANUC",
    orientation=notation.Angles(("W", "P", "R"), "zyx", reverse=True),
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(3, 3, 3),
    axes=("+z", "+y", "-y", "-x", "-y", "-x"),
    matrix=_COUPLED,
    aligned=True,
    world=True,
)
"""At zero joints the wrist is in front and the elbow up: ``U T``."""

TURNING = (0, 3, 5)
"""Joints of the three turn numbers, in their order."""

_CONFIG = re.compile(r"\s*([NF])\s*([UD])\s*([TB])\s*,\s*([-+]?\d+)\s*,\s*([-+]?\d+)\s*,\s*([-+]?\d+)\s*\Z")


def config(text: str, start: int) -> tuple[Posture | None, tuple[Span, ...], str]:
    """What a CONFIG means, where its turn numbers stand, and why it means nothing.

    Parameters
    ----------
    text : str
        What stands between the quotes.
    start : int
        Where it begins.
    """
    match = _CONFIG.match(text)
    if match is None:
        problem = "is empty" if not text.strip() else f"{text.strip()[:20]!r} is of another kind of arm"
        return None, (), f"its CONFIG {problem}"
    wrist, elbow, front = match.group(1, 2, 3)
    if front == "B":
        return None, (), "its CONFIG says B: how U and D are counted behind axis 1 is not confirmed"
    turns = [int(value) for value in match.group(4, 5, 6)]
    spans = tuple((start + match.start(k), start + match.end(k)) for k in (4, 5, 6))
    return posture_of(-1 if wrist == "N" else 1, elbow == "D", turns), spans, ""


def posture_of(wrist: int, down: bool, turns: list[int]) -> Posture:
    """A posture in front of axis 1."""
    low, high = [-np.inf] * 6, [np.inf] * 6
    for joint, turn in zip(TURNING, turns, strict=True):
        low[joint], high[joint] = (2 * turn - 1) * math.pi, (2 * turn + 1) * math.pi
    return Posture(False, down, wrist, tuple(low), tuple(high))


@dataclass(frozen=True, eq=False, repr=False)
class LsProgram(PostureProgram):
    """A FANUC program as read."""

    mark_number: int
    """Number of the mark's line; 0 where the lines have no numbers."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """Comments at the end of the instructions, so that no other line changes its number.

        Two, because older controllers take 32 characters each.
        """
        newline, number = self.listing.newline(), self.mark_number
        first, second = (f"{number:4d}", f"{number + 1:4d}") if number else ("    ", "    ")
        text = f"{first}:  !irbcal fake targets ;{newline}{second}:  !{fingerprint} ;{newline}"
        return at, at, text

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """CONFIG of joints."""
        turns = [math.floor((joints[k] + math.pi) / (2 * math.pi)) for k in TURNING]
        return posture_of(-1 if negative else 1, bent, turns)._replace(rear=back)

    def configuration_edits(self, target: Target, configuration: Configuration) -> list[Edit]:
        """New turn numbers."""
        assert isinstance(configuration, Posture)
        out: list[Edit] = []
        for joint, (start, end) in zip(TURNING, target.configuration_spans, strict=True):
            turn = round((configuration.low[joint] / math.pi + 1) / 2)
            if turn != int(self.text[start:end]):
                out.append((start, end, str(turn)))
        return out


_SECTION = re.compile(r"^/(PROG|ATTR|APPL|MN|POS|END)\b", re.MULTILINE)
_LINE = re.compile(r"^[ \t]*(\d*)[ \t]*:(.*)$", re.MULTILINE)
_POINT = re.compile(r"\bP\[[ \t]*(\d{1,6})[ \t]*(?::[^\]\r\n]*)?\][ \t]*\{([^{}]*)\}")
_GROUP = re.compile(r"\bGP(\d+)[ \t]*:")
_FRAMES = re.compile(r"\bUF[ \t]*:[ \t]*(\w+)[ \t]*,[ \t]*UT[ \t]*:[ \t]*(\w+)")
_QUOTED = re.compile(r"\w+[ \t]*:[ \t]*'([^'\r\n]*)'")
_FIELD = re.compile(r"\b([A-Z][A-Z0-9]?)[ \t]*=[ \t]*(\*+|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)[ \t]*(\w*)")

POSE, JOINTS = ("X", "Y", "Z", "W", "P", "R"), ("J1", "J2", "J3", "J4", "J5", "J6")


class Instruction(NamedTuple):
    """An instruction without its number: its text, where that stands, and whether it belongs to the move above it."""

    number: int
    start: int
    end: int
    inner: bool = False


NUMBER_WIDTH = 4
"""Columns of a line's number; farther to the right are numbers of lines within a move (``P-SPS``), from 1 again."""


class ProgramPoint(NamedTuple):
    """A position: its target (or why it has none) and the frames that are stored with it."""

    number: int
    target: Target | None
    reason: str
    user_frame: str
    tool: str
    start: int


def sections(listing: Listing) -> dict[str, tuple[int, int]]:
    """First place behind the name of each section, and its end.

    Raises
    ------
    ProgramError
        If /PROG or /MN is missing.
    """
    out: dict[str, tuple[int, int]] = {}
    for mark, end in up_to_next(list(_SECTION.finditer(listing.text)), len(listing.text)):
        out.setdefault(mark[1], (mark.end(), end))
    if "PROG" not in out or "MN" not in out:
        raise ProgramError("expected a FANUC listing with /PROG and /MN", file=listing.files[0].name)
    return out


def instructions(listing: Listing, start: int, end: int) -> list[Instruction]:
    """Instructions with the lines on which they go on: those without a number behind a line that no ``;`` ends."""
    out: list[Instruction] = []
    for match in _LINE.finditer(listing.text, start, end):
        if match[1] or not out or listing.text[out[-1].end - 1] == ";":
            inner = match.end(1) - match.start() > max(NUMBER_WIDTH, len(match[1]))
            end_of_text = match.start(2) + len(match[2].rstrip())
            out.append(Instruction(int(match[1][:9] or 0), match.start(2), end_of_text, inner))
        else:
            out[-1] = out[-1]._replace(end=match.start(2) + len(match[2].rstrip()))
    return out


def points(listing: Listing, start: int, end: int) -> list[ProgramPoint]:
    """Positions."""
    return [_point(listing, match) for match in _POINT.finditer(listing.text, start, end)]


def _point(listing: Listing, match: re.Match[str]) -> ProgramPoint:
    """A position, of which the first motion group is the robot."""
    number = int(match[1])
    groups = list(_GROUP.finditer(listing.text, match.start(2), match.end(2)))
    first = next((k for k, group in enumerate(groups) if group[1] == "1"), None)
    if first is None:
        return ProgramPoint(number, None, "it is of another motion group", "", "", match.start())
    begin = groups[first].end()
    end = groups[first + 1].start() if first + 1 < len(groups) else match.end(2)
    frame_numbers = _FRAMES.search(listing.text, begin, end)
    frames = (frame_numbers[1], frame_numbers[2]) if frame_numbers else ("", "")
    target, reason = _target(listing, f"P[{number}]", match.start(), begin, end)
    if target is not None and not all(frame.isdecimal() for frame in frames):
        target.conflicts.append("it names no user frame or tool by number")
    if target is not None and len(groups) > 1:
        target.external = "other groups"
        others = sorted(_positions(listing, groups[first + 1].end(), match.end(2), "J").items())
        target.e = {**target.e, **{f"e{k}": value for k, (_, value) in enumerate(others, len(target.e) + 1)}}
    return ProgramPoint(number, target, reason, *frames, match.start())


def _target(listing: Listing, name: str, at: int, begin: int, end: int) -> tuple[Target | None, str]:
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
    target = Target(name, "joint" if names is JOINTS else "pose", at, numbers)
    target.external = ", ".join(key for key in fields if (key[0] == "E" and key[1:].isdecimal()) or key == "J7")
    target.e = {key.lower(): value for key, value in _positions(listing, begin, end, "E").items()}
    if target.kind == "pose":
        quoted = _QUOTED.search(listing.text, begin, end)
        if quoted is None:
            target.conflicts.append("it has no CONFIG")
        else:
            target.configuration, target.configuration_spans, reason = config(quoted[1], quoted.start(1))
            target.conflicts += [reason] if reason else []
    return target, ""


def _positions(listing: Listing, begin: int, end: int, letter: str) -> dict[str, float]:
    """Values of ``E1`` or ``J1`` and so on in a part of the text, mm or degrees; of several groups in order."""
    fields = [field for field in _FIELD.finditer(listing.text, begin, end) if field[1][0] == letter]
    return {field[1]: float(field[2]) for field in fields if field[1][1:].isdecimal() and field[2][0] != "*"}


_MOVE = re.compile(r"\s*([JLCAS])[ \t]+(?=P|PR\[)")
_GOAL = re.compile(r"[\s:]*\b(PR?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]")
_INDEX = re.compile(r"\s*(\d{1,6})\s*(?::.*)?\Z", re.DOTALL)
_FLOW = re.compile(r"\b(LBL|JMP|CALL|IF|SELECT|FOR|ENDFOR|RUN|WENN|AUFRUF|SPRUNG)\b")
_FRAME = re.compile(r"\b(UFRAME|UTOOL)\[[ \t]*(\w+)[^\]]*\][ \t]*=")
_SIGNED = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_ELEMENT_SET = re.compile(
    rf"\s*PR\[\s*(\d+)\s*(?::[^,\]]*)?,\s*([1-6])\s*(?::[^\]]*)?\]\s*=\s*\(?\s*({_SIGNED})\s*\)?\s*;?\s*"
)
_REGISTER_SET = re.compile(r"\s*PR\[\s*(\w+)[^=;]*=")
_REGISTER = re.compile(r"\s*PR\[\s*(\d+)\s*(?::[^\]]*)?\]\s*;?\s*")
SAME_FRAME = 1e-6
"""By how much two frames may differ that are the same but for printed decimals; metres and components of rotations."""
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


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read FANUC listings for an arm, each a program; see `irbcal.correction.languages.Language`."""
    backups = {
        folder: NumberedData(*frames_beside(folder), loads_beside(folder)) for folder in {file.parent for file in files}
    }
    contents, unread = each_read(files, lambda file: (file, read_bytes(file)))
    loads, calls = LoadFlow(), Calls(setup.ignored_calls)
    for _, data in contents:
        learn(data.decode("latin-1"), calls)
    programs, not_parsed = each_read(
        [file for file, _ in contents],
        lambda file: parse(arm, dict(contents)[file], str(file), setup, backups[file.parent], calls, loads),
    )
    return [*programs, *unread, *not_parsed]


_COMMENT = re.compile(r"^[ \t]*\d*[ \t]*:[ \t]*(?:!|//|--)[^\r\n]*", re.MULTILINE)
_CALL = re.compile(r"\bCALL[ \t]+([A-Z_]\w*)", re.IGNORECASE)
_PAYLOAD = re.compile(r"\bPAYLOAD\[[ \t]*(?:GP1[ \t]*:[ \t]*)?([^\]\r\n]*)\]", re.IGNORECASE)


def learn(text: str, calls: Calls) -> None:
    """Note which programs a listing calls, and whether it says what the robot carries."""
    text = _COMMENT.sub("", text)
    name = re.search(r"^/PROG[ \t]+(\S+)", text, re.MULTILINE)
    if name is not None:
        called = [called.lower() for called in _CALL.findall(text)]
        calls.learn(name[1].lower(), called, True, True, _PAYLOAD.search(text) is not None)


SYSTEM_FRAMES, SYSTEM_LOADS = "sysframe.va", "symotn.va"
_SCHEDULE = re.compile(
    r"^[ \t]*Field:[ \t]*\$PLST_GRP1\[(\d+)\]\.\$(PAYLOAD(?:_[XYZ])?|COMMENT)[ \t][^=\r\n]*=[ \t]*([^\r\n]*)",
    re.MULTILINE,
)
_CM = 0.01
_VARIABLE = re.compile(r"\[\*SYSTEM\*\]\$(\w+)[^\r\n]*")
_ELEMENT = re.compile(r"^[ \t]*\[[ \t]*(\d+)[ \t]*,[ \t]*(\d+)[ \t]*\][ \t]*=", re.MULTILINE)
_NAMED_NUMBER = re.compile(r"\b([XYZWPR]):[ \t]*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?=\s|\Z)")


def loads_beside(folder: Path) -> dict[str, Load]:
    """Payload schedules of the first motion group that a backup's ``SYMOTN.VA`` beside programs has: kg and cm.

    Schedules that nobody filled in (no comment and no centre, or a negative mass) are none.
    """
    fields: dict[str, dict[str, str]] = {}
    for path in files_named(folder, SYSTEM_LOADS):
        for number, name, value in _SCHEDULE.findall(text_of(path)):
            fields.setdefault(number, {}).setdefault(name, value.strip())
    out = {}
    for number, schedule in fields.items():
        values = [schedule.get(name, "") for name in ("PAYLOAD", "PAYLOAD_X", "PAYLOAD_Y", "PAYLOAD_Z")]
        if not all(re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", value) for value in values):
            continue
        mass, *centre = (float(value) for value in values)
        comment = schedule.get("COMMENT", "").strip("'")
        if mass >= 0.0 and (any(centre) or comment not in ("", "Uninitialized")):
            out[number] = load_of(mass, [value * _CM for value in centre])
    return out


def frames_beside(folder: Path) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Tools and user frames of the first motion group, by number, that a backup's ``SYSFRAME.VA`` beside programs has.

    Elements whose six numbers are not all there, and such that stand there twice with other numbers, are none.
    """
    found: tuple[dict[str, FloatArray], dict[str, FloatArray]] = {}, {}
    for path in files_named(folder, SYSTEM_FRAMES):
        text = text_of(path)
        variables = list(_VARIABLE.finditer(text))
        for variable, end in up_to_next(variables, len(text)):
            if variable[1] not in ("MNUTOOL", "MNUFRAME"):
                continue
            frames_of = found[variable[1] == "MNUFRAME"]
            elements = list(_ELEMENT.finditer(text, variable.end(), end))
            for element, behind in up_to_next(elements, end):
                numbers = dict(_NAMED_NUMBER.findall(text, element.end(), behind))
                if element[1] != "1" or len(numbers) < 6:
                    continue
                T = FANUC.frame([float(numbers[key]) for key in POSE])
                known = frames_of.setdefault(element[2], T)
                frames_of[element[2]] = T if np.array_equal(T, known) else np.full((4, 4), np.nan)
    return found


def parse(
    arm: Arm,
    data: bytes,
    source: str,
    setup: ControllerSetup,
    backup: NumberedData = NumberedData(),  # noqa: B008
    calls: Calls | None = None,
    loads: LoadFlow | None = None,
) -> LsProgram:
    """Read a FANUC listing of a backup; ``calls`` and ``loads`` are those of all listings that call one another.

    Raises
    ------
    ProgramError
        If this is none.
    """
    listing = Listing([(source, data)], "FANUC LS")
    sections_of = sections(listing)
    if "END" not in sections_of:
        raise ProgramError("the listing does not end with /END", file=source)
    taught: dict[int, ProgramPoint] = {}
    for point in points(listing, *sections_of["POS"]) if "POS" in sections_of else ():
        if point.number in taught:
            raise listing.error(point.start, f"P[{point.number}] stands here a second time")
        taught[point.number] = point
    moves = _InstructionReader(listing, taught, setup, backup, ControlFlow(listing, calls, loads))
    program_name = re.match(r"[ \t]*(\S*)", listing.text[sections_of["PROG"][0] :])
    moves.flow.loads.begin(program_name[1].lower() if program_name else "")
    steps = instructions(listing, *sections_of["MN"])
    for step in steps:
        moves.take(step)
    targets = [point.target for point in taught.values() if point.target is not None]
    eye = {"0": frames.transform()}
    numbers = [step.number for step in steps if not step.inner]
    return LsProgram.assembled(
        FANUC,
        arm,
        moves.flow,
        targets,
        setup,
        {**backup.tools, **eye},
        {**backup.user_frames, **eye},
        notes=[
            *moves.notes(targets),
            *from_backup(targets, setup, backup, "SYSFRAME.VA beside the program"),
        ],
        comments=comments_of(listing),
        mark_at=sections_of["MN"][1],
        mark_number=max(numbers, default=0) + 1 if any(numbers) else 0,
    )


class _InstructionReader:
    """Follows the instructions."""

    def __init__(
        self,
        listing: Listing,
        taught: dict[int, ProgramPoint],
        setup: ControllerSetup,
        backup: NumberedData,
        flow: ControlFlow,
    ) -> None:
        self.listing, self.taught, self.backup, self.flow = listing, taught, backup, flow
        self._given = {"UTOOL": setup.tools, "UFRAME": setup.work_objects}
        self._registers: dict[str, dict[str, float]] = {}
        self._noted: list[Note] = []

    def take(self, step: Instruction) -> None:
        """Take one instruction."""
        text = self.listing.text[step.start : step.end]
        if text.lstrip().startswith(("!", "//", "--")):
            return
        text = re.sub(r"'[^'\r\n]*'|\"[^\"\r\n]*\"", lambda match: " " * len(match[0]), text)
        move = _MOVE.match(text)
        if move is not None:
            self._move(step, text, move)
            return
        self._changes(step, text)
        self._loads(step, text)
        if _FLOW.search(text.upper()):
            self.flow.forget()
            self._registers.clear()
        for goal in _GOAL.finditer(text):
            if goal[1] == "P":
                for point in self._named(goal[2])[0]:
                    if point.target is not None:
                        self.flow.mention(point.target, step.start)

    def _loads(self, step: Instruction, text: str) -> None:
        """What the robot carries from here on, and where other programs may change it."""
        called = [called[1] for called in _CALL.finditer(text)]
        if _FLOW.search(text.upper()) and not (called and text.lstrip().upper().startswith("CALL")):
            self.flow.loads.label()
        for name in called:
            before = self.flow.loads.now
            self.flow.load_call(name, step.start)
            if not text.lstrip().upper().startswith("CALL"):  # behind a condition
                self.flow.loads.now |= before
        set_to = _PAYLOAD.search(text)
        if set_to is not None:
            number = set_to[1].strip()
            missing = unknown_load(f"PAYLOAD[{number[:20]}] is not in a SYMOTN.VA beside the program")
            self.flow.carry(self.backup.loads.get(number, missing), step.start)

    def _named(self, inside: str) -> tuple[list[ProgramPoint], str]:
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
        reason = next((text_of_reason for sign, text_of_reason in _REASONS if sign.search(options)), "")
        if _OFFSET.search(options) and not reason:
            line = self.listing.line(step.start)
            self._noted = self._noted or [Note(line, "an offset moves targets that are corrected without it")]
        stop: Target | None = None
        for k, goal in enumerate(goals):
            stop = self._goal(step, move[1], goal, "via" if k < len(goals) - 1 else "to", reason)
        if not goals or (move[1] == "C" and len(goals) < 2):
            self.flow.leave(step.start, move[1], self.listing.quote(step.start, step.end), "its target is computed")
        self.flow.stop(stop, step.start)

    def _goal(self, step: Instruction, move: str, goal: re.Match[str], role: str, reason: str) -> Target | None:
        """Use the positions of one argument; the target where it is just one."""
        text = goal[0].strip(" \t\r\n:")
        if goal[1] == "PR":
            self.flow.leave(step.start, move, text, "a position register stands in the controller only")
            return None
        points, missing = self._named(goal[2])
        if missing:
            self.flow.leave(step.start, move, text, missing)
        for point in points:
            if point.target is None:
                self.flow.leave(step.start, move, f"P[{point.number}]", point.reason)
                continue
            point.target.conflicts += [reason] if reason else []
            state = FrameState(point.tool, point.user_frame)
            self.flow.use(point.target, step.start, move, "via" if role == "via" else "to", state)
        return points[0].target if len(points) == 1 and not reason else None

    def _changes(self, step: Instruction, text: str) -> None:
        """Frames that the program sets itself, and position registers that it sets number by number."""
        element = _ELEMENT_SET.fullmatch(text)
        if element is not None:
            self._registers.setdefault(element[1], {})[element[2]] = float(element[3])
        elif (register := _REGISTER_SET.match(text)) is not None:
            if register[1].isdecimal():
                self._registers.pop(register[1], None)
            else:
                self._registers.clear()
        for change in _FRAME.finditer(text.upper()):
            reason = self._changed(change, text[change.end() :], self.listing.line(step.start))
            for point in self.taught.values() if reason else ():
                frame_number = point.user_frame if change[1] == "UFRAME" else point.tool
                if point.target is not None and (frame_number == change[2] or not change[2].isdecimal()):
                    point.target.conflicts.append(reason)

    def _changed(self, change: re.Match[str], value: str, line: int) -> str:
        """Why a frame is not known that the program sets; empty where it is what the caller gives.

        The numbers of a register are those of a frame only where the register is Cartesian, which no program says.
        """
        reason = f"line {line} changes {change[1]}[{change[2]}]"
        source = _REGISTER.fullmatch(value)
        numbers = self._registers.get(source[1], {}) if source is not None else {}
        if set(numbers) != set("123456"):
            return reason
        values = [numbers[key] for key in "123456"]
        given = self._given[change[1]].get(change[2])
        if given is not None and np.abs(given - FANUC.frame(values)).max() < SAME_FRAME:
            return ""
        option = f"--{'frame' if change[1] == 'UFRAME' else 'tool'} {change[2]}={','.join(f'{v:.9g}' for v in values)}"
        return f"{reason}: if its register is Cartesian, give {option}"

    def notes(self, targets: Sequence[Target]) -> list[Note]:
        """What the corrections do not know about."""
        notes = [*self._noted]
        if any(target.kind == "joint" and target.uses for target in targets):
            text = "joint 3 is taken as the pendant counts it, against the horizontal: check one pair on the pendant"
            notes.append(Note(1, text))
        return notes


def comments_of(listing: Listing) -> list[str]:
    """Remarks of a listing, as one."""
    texts = [listing.text[step.start : step.end] for step in instructions(listing, *sections(listing)["MN"])]
    return joined_comments([text for text in texts if text.lstrip().startswith("!")], " \t\r!;")


LONGEST = 32
"""Characters of a remark that all controllers take."""
LONGEST_WAIT_S = 300.0


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.ls``: positions as joints, J3 with J2 in it as the pendant counts, and moves to them."""
    lines: list[str] = [f"!{_remark(text)}" for text in moves.head] + ["UFRAME_NUM=0", "UTOOL_NUM=1"]
    points: list[str] = []
    for number, (move, joints) in enumerate(zip(moves.moves, moves.texts(FANUC), strict=True), start=1):
        lines += [f"!{_remark(move.comment)}"] if move.comment else []
        lines.append(f"J P[{number}] {move.percent}% FINE")
        waits = [LONGEST_WAIT_S] * int(move.wait_s // LONGEST_WAIT_S) + [move.wait_s % LONGEST_WAIT_S]
        lines += [f"WAIT {seconds:6.2f}(sec)" for seconds in waits if seconds]
        fields = [f"J{k}= {text:>9} deg" for k, text in enumerate(joints, start=1)]
        points += [f"P[{number}]{{", "   GP1:", "\tUF : 0, UT : 1,"]
        points += ["\t" + ",\t".join(fields[:3]) + ",", "\t" + ",\t".join(fields[3:]), "};"]
    return {"plan.ls": listing_of("PLAN", "irbcal plan", lines, points)}


def listing_of(name: str, comment: str, lines: Sequence[str], points: Sequence[str] = ()) -> str:
    """Text of a listing with instructions and lines of positions."""
    text = [f"{number:4d}:  {statement} ;" for number, statement in enumerate(lines, start=1)]
    text = [statement.replace(":  J P", ":J P", 1) for statement in text]
    head = [f"/PROG  {name}", "/ATTR", f'COMMENT\t\t= "{comment}";', f"LINE_COUNT\t= {len(lines)};"]
    head += ["PROTECT\t\t= READ_WRITE;", "DEFAULT_GROUP\t= 1,*,*,*,*;", "/MN"]
    return "\r\n".join([*head, *text, "/POS", *points, "/END", ""])


def _remark(text: str) -> str:
    return note(text, LONGEST, ";:'\"")


def _frames_listing(lines: list[str]) -> str:
    """A program of lines, each maybe several, that set frames."""
    return listing_of("IRBCAL_CELL", "irbcal cell", "\n".join(lines).split("\n"))


_SET_REGISTER = "".join(f"PR[100,{k + 1}]={{{k}}}\n" for k in range(6))
"""By way of the last position register that every controller has; ``PR[100]=LPOS`` before makes it Cartesian."""

LANGUAGE = Language(
    name="FANUC LS",
    endings=(".ls",),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(comments_of, "FANUC LS"),
    maker=FANUC,
    robots=r"fanuc|(^|_)(m\d+i|lrmate|r\d000i|crx)",
    write_moves=write_moves,
    declaration=FrameDeclaration(
        *TO_99,
        head="!Overwrites PR[100]\nPR[100]=LPOS",
        tool=f"{_SET_REGISTER}UTOOL[{{name}}]=PR[100]",
        work_object=f"{_SET_REGISTER}UFRAME[{{name}}]=PR[100]",
        negative="({})",
        as_file=_frames_listing,
    ),
    sample=SampleArm(
        folder="fanuc",
        joints=(
            ((0, 0, 0.35), "0 0 1"),
            ((0.06, 0, 0), "0 1 0"),
            ((0, 0, 0.34), "0 -1 0"),
            ((0, 0, 0.03), "-1 0 0"),
            ((0.33, 0, 0), "0 -1 0"),
            ((0.085, 0, 0), "-1 0 0"),
        ),
        flange=(0, 0, 0, np.pi, -np.pi / 2, 0),
        base=0.35,
        stops=((10, 5, -10, 20, -40, 30), (-25, 15, 5, -15, -50, -40), (30, -10, -15, 10, -35, 60)),
        tried={"job.ls": "--out fanuc-job.ls --tool 1=0,0,150,0,0,0"},
    ),
    without_text={".tp": (".ls", "a binary FANUC program: have the controller write it as .LS")},
)
