"""Yaskawa jobs: positions ``C…`` and the moves that go there.

Pseudo lines (``///TOOL 1``, ``///POSTYPE USER``, ``///RCONF …``) hold for the positions behind them. Positions in
pulses need the pulses per degree of the robot's joints, which no job tells.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.backup import files_named, text_of
from irbcal.correction.control_flow import ControlFlow, FrameState
from irbcal.correction.fake_targets import FakeTargets
from irbcal.correction.instructions import MotionInstruction, built_in, teaching
from irbcal.correction.language import TO_99, FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.listing import Edit, Listing, Number, joined_comments, up_to_next
from irbcal.correction.loads import load_of
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Note, Program, WantedTargets, each_read, read_bytes
from irbcal.correction.targets import PULSES, Target
from irbcal.correction.text_program import NumberedData, PostureProgram, from_backup
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

YASKAWA = Maker(
    name="INFORM",
    orientation=notation.Angles(("Rx", "Ry", "Rz"), "zyx", reverse=True),
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(3, 4, 0),
    axes=("+z", "+y", "-y", "-x", "-y", "-x"),
    matrix=np.eye(6),
    world=True,
    wrist_axis=4,
    pulses=True,
)
"""At zero joints the wrist is in front, the elbow above and the wrist flipped."""

MOTIONS = built_in(
    """
    MOVJ MOVL MOVC MOVS SMOVJ SMOVL SMOVC SMOVS SVSPOTMOV: to *
    """
)

HALF = math.pi


def posture_of(rconf: Sequence[int]) -> tuple[Posture, str]:
    """What RCONF means, and why it means nothing that is confirmed."""
    if len(rconf) < 6 or any(value not in (0, 1) for value in rconf[:6]):
        return Posture(), "its RCONF is not understood"
    flip, elbow, back, *turns = rconf[:6]
    if back:
        return Posture(), "its RCONF says behind axis 1: how the elbow is counted there is not confirmed"
    if any(turns):
        return Posture(), "its RCONF says that a joint is beyond 180 degrees: to which side is not confirmed"
    low, high = [-np.inf] * 6, [np.inf] * 6
    for joint in (0, 3, 5):
        low[joint], high[joint] = -HALF, HALF
    return Posture(False, bool(elbow), 1 if flip else -1, tuple(low), tuple(high)), ""


@dataclass(frozen=True, eq=False, repr=False)
class JobProgram(PostureProgram):
    """A job as read."""

    pulses: tuple[float, ...]
    """Pulses per degree of the six joints; empty where they are not given."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """Two comments, because they take 32 characters each."""
        newline = self.listing.newline()
        return at, at, f"'irbcal fake targets{newline}'{fingerprint}{newline}"

    def joint_units(self, target: Target) -> FloatArray:
        """Radians of one pulse of each joint."""
        return DEG / np.array(self.pulses)

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """RCONF of joints, turns among them."""
        low, high = [-np.inf] * 6, [np.inf] * 6
        for joint in (0, 3, 5):
            if abs(joints[joint]) < HALF:
                low[joint], high[joint] = -HALF, HALF
        return Posture(back, bent, -1 if negative else 1, tuple(low), tuple(high))

    def refused(self, batch: WantedTargets, fake: FakeTargets) -> list[str]:
        """Corrections that would need another RCONF, turns among them: several points share one."""
        out = [""] * len(batch.names)
        rows = np.flatnonzero(fake.ok) if batch.kind == "pose" else np.zeros(0, dtype=int)
        for row, new in zip(rows.tolist(), self.postures(fake.q[rows]), strict=True):
            if new != self.targets[int(batch.numbers[row])].configuration:
                out[row] = "its correction would need another RCONF, which other points share"
        return out


WORLD = "base"
_LINE = re.compile(r"[^\r\n]+")
_POSITION = re.compile(r"[ \t]*((?:C|P|BC|BP|EC|EX)\d+)[ \t]*=[ \t]*(.*)")
_PLAIN = re.compile(r"[ \t]*([-+]?(?:\d+\.?\d*|\.\d+))[ \t]*(,|\Z)")
_POINT = re.compile(r"\b(B?C|E?C|B?P|EX)(\d+)\b")
_FLOW = re.compile(r"[ \t]*(?:\*|JUMP|CALL|RET|IF|ELSE|ENDIF|SWITCH|CASE|ENDSWITCH|FOR|NEXT|WHILE|ENDWHILE|DEFAULT)")


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a Yaskawa job."""
    return re.match(rb"(?:\xef\xbb\xbf)?\s*/JOB\b", data) is not None


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read Yaskawa jobs for an arm, each a program; see `irbcal.correction.languages.Language`."""
    beside = {folder: backup_of(folder) for folder in {file.parent for file in files}}
    shared = _Shared(files)
    programs, unread = each_read(
        files, lambda file: parse(arm, read_bytes(file), str(file), setup, beside[file.parent], shared)
    )
    return [*programs, *unread]


_NUMBERED = re.compile(r"^//(TOOL|UFRAME)[ \t]+(\d+)[ \t]*\r?$", re.MULTILINE)
_TOOL_LINE = re.compile(r"(?:^[ \t]*/[^\n]*\n)*^([^/\n]*)$(?:\n^([^/\n]*)$\n^([^/\n]*)$)?", re.MULTILINE)
_USER_LINE = re.compile(r"^/{3,4}BUSER[ \t]*\r?\n?[ \t]*([^/\n]+)$", re.MULTILINE)


def backup_of(folder: Path) -> NumberedData:
    """Tools and user frames, by number, that a backup's ``TOOL.CND`` and ``UFRAME.CND`` beside jobs have.

    Those whose six numbers are not all there, and such that stand there twice with other numbers, are none. The lines
    behind a tool are its centre of gravity in the flange, mm, and its mass, kg; a mass of zero was never given.
    """
    frames_of_kind: tuple[dict[str, FloatArray], dict[str, FloatArray]] = {}, {}
    loads = {}
    names = {"TOOL": "tool.cnd", "UFRAME": "uframe.cnd"}
    for kind, (title, name) in enumerate(names.items()):
        for path in files_named(folder, name):
            text = text_of(path).replace("\r\n", "\n")
            heads = [head for head in _NUMBERED.finditer(text) if head[1] == title]
            for head, end in up_to_next(heads, len(text)):
                head_line = (_USER_LINE.search if kind else _TOOL_LINE.match)(text, head.end() + 1, end)
                numbers = _numbers(head_line[1].strip(), 0) if head_line is not None else None
                if numbers is None or len(numbers) != 6:
                    continue
                T = YASKAWA.frame([number.value for number in numbers])
                known = frames_of_kind[kind].setdefault(head[2], T)
                frames_of_kind[kind][head[2]] = T if np.array_equal(T, known) else np.full((4, 4), np.nan)
                behind = (
                    []
                    if kind or head_line is None
                    else [_numbers((head_line[k] or "").strip(), 0) or [] for k in (2, 3)]
                )
                if [len(numbers) for numbers in behind] == [3, 1] and behind[1][0].value > 0.0:
                    loads[head[2]] = load_of(behind[1][0].value, [number.value * MM for number in behind[0]])
    return NumberedData(*frames_of_kind, loads)


def parse(
    arm: Arm,
    data: bytes,
    source: str,
    setup: ControllerSetup,
    backup: NumberedData = NumberedData(),  # noqa: B008
    shared: _Shared | None = None,
) -> JobProgram:
    """Read a Yaskawa job of a backup.

    Raises
    ------
    ProgramError
        If this is none, or a tool or frame that is needed is not known.
    """
    listing = Listing([(source, data)], "Yaskawa INFORM")
    if not looks_like(data):
        raise ProgramError("expected a Yaskawa job that begins with /JOB", file=source)
    taught = setup.instructions.get("inform", {}).values()
    job = _JobReader(listing, setup.pulses, shared or _Shared({source: data}), backup, taught)
    job.read()
    targets = list(job.points.values())
    return JobProgram.assembled(
        YASKAWA,
        arm,
        job.flow,
        targets,
        setup,
        backup.tools,
        {**backup.user_frames, WORLD: frames.transform()},
        units=np.array([DEG / value for value in setup.pulses]) if setup.pulses else None,
        notes=[
            *job.notes.values(),
            *from_backup(targets, setup, backup, "TOOL.CND and UFRAME.CND beside the job"),
        ],
        comments=comments_of(listing),
        mark_at=job.nop,
        pulses=tuple(setup.pulses),
    )


_COMMENT = re.compile(r"^[ \t]*'[^\r\n]*", re.MULTILINE)
_VARIABLE = re.compile(r"\bP(\d+)\b")
_CALLED = re.compile(r"\bCALL[ \t]+(?:JOB:)?([^\s]+)")


class _Shared:
    """What several jobs know of position variables, which are the controller's and so those of all jobs.

    Parameters
    ----------
    jobs : sequence of Path, or dict of str to bytes
        Files, or their contents by their names; what cannot be read is passed over.
    """

    def __init__(self, jobs: Sequence[Path] | Mapping[str, bytes]) -> None:
        contents = jobs if isinstance(jobs, Mapping) else {str(path): _content(path) for path in jobs}
        self.users: dict[str, set[str]] = {}
        self.names: set[str] = set()
        self.indexed = ""
        for source, data in contents.items():
            text = _COMMENT.sub("", data.decode("latin-1"))
            self.names |= set(re.findall(r"^//NAME[ \t]+(\S+)", text, re.MULTILINE))
            if re.search(r"\bP\[", text):
                self.indexed = self.indexed or Path(source).name
            for number in set(_VARIABLE.findall(text)):
                self.users.setdefault(f"P{int(number)}", set()).add(source)

    def conflict(self, name: str, source: str) -> str:
        """Why a position variable of a job is not the job's alone; empty where it is."""
        if self.indexed:
            return f"{self.indexed} uses position variables by an index that is computed"
        others = sorted(self.users.get(name, set()) - {source})
        return f"{Path(others[0]).name} uses it, too: position variables are those of all jobs" if others else ""


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except ProgramError:
        return b""


class _JobReader:
    """Follows the lines of a job."""

    def __init__(
        self,
        listing: Listing,
        pulses: Sequence[float],
        shared: _Shared,
        backup: NumberedData,
        taught: Iterable[MotionInstruction],
    ) -> None:
        self.listing, self.pulses, self.shared, self.backup = listing, pulses, shared, backup
        moves = [move.name for move in (*MOTIONS.values(), *taught)]
        self._move = re.compile(rf"[ \t]*({'|'.join(moves)}|IMOV|REFP)\b[ \t]*(.*)")
        self.flow = ControlFlow(listing)
        self.points: dict[str, Target] = {}
        self.notes: dict[str, Note] = {}
        self.nop = len(listing.text)
        self._frames: dict[str, FrameState] = {}
        self._missing: dict[str, str] = {}
        self._now = {"USER": "", "TOOL": "0", "POSTYPE": "PULSE", "RCONF": ""}
        self._trouble = ""
        self._called = ""

    def read(self) -> None:
        """Take all lines."""
        instructions = False
        for line in _LINE.finditer(self.listing.text):
            text, at = line[0], line.start()
            if text.lstrip().startswith("'"):
                continue
            if text.startswith("///"):
                self._pseudo(text)
            elif text.startswith("//"):
                instructions = text.startswith("//INST")
            elif instructions and re.match(r"[ \t]*NOP\b", text):
                self.nop = self.listing.after_line(at)
            elif instructions:
                self._instruction(text, at)
            elif (position := _POSITION.match(text)) is not None:
                self._position(position[1], position[2], at + position.start(2))
        for name, target in self.points.items():
            target.conflicts += [self._trouble] if self._trouble else []
            target.conflicts += [self._called] if self._called and name[0] == "P" else []
            if name[0] == "P" and target.correctable:
                text = f"{name} is a position variable: other jobs and the pendant see the corrected one"
                self.notes.setdefault("variables", Note(self.listing.line(target.start), text))

    def _pseudo(self, text: str) -> None:
        word, _, value = text[3:].partition(" ")
        if word in self._now:
            self._now[word] = value.strip()
        elif word == "PULSE":
            self._now["POSTYPE"] = "PULSE"
        elif word.startswith("GROUP"):
            if word != "GROUP1" or not value.strip().startswith("RB1"):
                self._trouble = "the job moves other groups than one robot"
            elif "BS" in value:
                self._trouble = "the robot stands on base axes, which carry its frames"

    def _position(self, name: str, text: str, at: int) -> None:
        """A position line; only the robot's own step points and position variables are targets."""
        if name[0] not in "CP":
            return
        name = _shown(name)
        numbers = _numbers(text, at)
        kind = self._now["POSTYPE"]
        if numbers is None or len(numbers) != 6:
            self._missing[name] = "its six numbers are not understood"
        elif name in self.points:
            self.points[name].conflicts.append("it stands twice in the job")
        elif kind == "PULSE" and not self.pulses:
            self._missing[name] = "it is in pulses: give the pulses per degree of the joints (--pulses)"
        elif kind in ("PULSE", "BASE", "ROBOT", "USER"):
            target = Target(name, "joint" if kind == "PULSE" else "pose", at, numbers)
            if kind != "PULSE":
                rconf = [int(v) for v in self._now["RCONF"].split(",") if re.fullmatch(r"\s*\d{1,3}\s*", v)]
                target.configuration, reason = posture_of(rconf)
                target.conflicts += [reason] if reason else []
            if name[0] == "P" and (reason := self.shared.conflict(name, self.listing.files[0].name)):
                target.conflicts.append(reason)
            self.points[name] = target
            frame = self._now["USER"] if kind == "USER" else WORLD
            self._frames[name] = FrameState(self._now["TOOL"], frame or "0")
        else:
            self._missing[name] = f"its POSTYPE {kind[:10]} is not supported"

    def _instruction(self, text: str, at: int) -> None:
        move = self._move.match(text)
        names = [_shown(match[0]) for match in _POINT.finditer(text)]
        called = _CALLED.search(text)
        if called is not None and called[1] not in self.shared.names and not self._called:
            self._called = f"{called[1][:40]}, called in line {self.listing.line(at)}, may set position variables: it"
            self._called += " is not among these jobs"
        if move is None:
            if _FLOW.match(text):
                self.flow.forget()
            if re.match(r"[ \t]*SFTON\b", text):
                shift = "SFTON shifts targets that are corrected without it"
                self.notes.setdefault("shift", Note(self.listing.line(at), shift))
            self.flow.teaching[self.listing.line(at)] = teaching("inform", text.split()[0], ["to", "*"])
            self._otherwise(names, at)
            return
        at += len(text) - len(text.lstrip())
        first = names[0] if names else ""
        target = self.points.get(first)
        if move[1] in ("IMOV", "REFP") or target is None:
            reason = self._missing.get(first, "it is not a step point of this job")
            reason = "it moves on by a distance" if move[1] == "IMOV" else reason
            self.flow.leave(at, move[1], first or self.listing.quote(at, at + 40), reason)
            self.flow.stop(None, at)
            self._otherwise(names, at)
            return
        if "+MOV" in text or any(name.startswith("B") for name in names) or re.search(r"\b(?:TL|UF)#", text):
            target.conflicts.append(f"line {self.listing.line(at)} moves other groups, or names another tool or frame")
        if any(name.startswith("E") for name in names):
            target.external = PULSES
        if self._frames[first].tool in self.backup.loads:
            self.flow.carry(self.backup.loads[self._frames[first].tool or ""], at)
        elif self.flow.names_loads:
            self.flow.carry(None, at)
        self.flow.use(target, at, move[1], state=self._frames[first])
        self.flow.stop(target, at)

    def _otherwise(self, names: Sequence[str], at: int) -> None:
        for name in names:
            if name in self.points:
                self.flow.mention(self.points[name], at)


def _shown(name: str) -> str:
    """A position's name; that of a variable has different numbers of digits in positions and instructions."""
    return f"P{int(name[1:])}" if name[0] == "P" else name


def _numbers(text: str, at: int) -> list[Number] | None:
    """Numbers with commas between them; None where something else stands there."""
    out: list[Number] = []
    k, more = 0, True
    while more:
        match = _PLAIN.match(text, k)
        if match is None:
            return None
        out.append(Number(float(match[1]), at + match.start(1), at + match.end(1)))
        k, more = match.end(), match[2] == ","
    return out


def comments_of(listing: Listing) -> list[str]:
    """Comments of a job, as one."""
    return joined_comments([line for line in _LINE.findall(listing.text) if line.lstrip().startswith("'")], " \t'")


LONGEST = 30
"""Characters of a comment that all controllers take."""
LONGEST_WAIT_S = 600.0


def write_moves(moves: Moves) -> dict[str, str]:
    """``PLAN.JBI``: positions in pulses and ``MOVJ`` to them.

    Raises
    ------
    ProgramError
        If the pulses per degree are not known.
    """
    if not moves.pulses:
        raise ProgramError("a Yaskawa job holds pulses: give the pulses per degree of the six joints (--pulses)")
    pulses = np.rint(moves.degrees(YASKAWA) * np.array(moves.pulses)).astype(np.int64)
    points = [f"C{k:05d}={','.join(map(str, row))}" for k, row in enumerate(pulses.tolist())]
    lines = [f"'{note(text, LONGEST)}" for text in moves.head]
    for k, move in enumerate(moves.moves):
        lines += [f"'{note(move.comment, LONGEST)}"] if move.comment else []
        lines.append(f"MOVJ C{k:05d} VJ={move.percent:.2f} PL=0")
        waits = [LONGEST_WAIT_S] * int(move.wait_s // LONGEST_WAIT_S) + [move.wait_s % LONGEST_WAIT_S]
        lines += [f"TIMER T={seconds:.2f}" for seconds in waits if seconds]
    head = ["/JOB", "//NAME PLAN", "//POS", f"///NPOS {len(points)},0,0,0,0,0", "///TOOL 0", "///POSTYPE PULSE"]
    middle = ["//INST", "///DATE 2000/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    return {"PLAN.JBI": "\r\n".join([*head, "///PULSE", *points, *middle, *lines, "END", ""])}


LANGUAGE = Language(
    name="Yaskawa INFORM",
    endings=(".jbi",),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(comments_of, "Yaskawa INFORM"),
    maker=YASKAWA,
    robots=r"motoman|yaskawa|(^|_)(gp|hc|mh|ma|ms)\d",
    write_moves=write_moves,
    motions=MOTIONS,
    declaration=FrameDeclaration(
        *TO_99,
        head="To type in: ROBOT, TOOL and ROBOT, USER COORD (mm, degrees)",
        tool="TOOL {name}  X {0}  Y {1}  Z {2}  Rx {3}  Ry {4}  Rz {5}",
        work_object="USER {name}  X {0}  Y {1}  Z {2}  Rx {3}  Ry {4}  Rz {5}",
    ),
    sample=SampleArm(
        folder="yaskawa",
        joints=(
            ((0, 0, 0.35), "0 0 1"),
            ((0.05, 0, 0), "0 1 0"),
            ((0, 0, 0.36), "0 -1 0"),
            ((0.35, 0, 0.045), "-1 0 0"),
            ((0, 0, 0), "0 -1 0"),
            ((0, 0, 0), "-1 0 0"),
        ),
        flange=(0.08, 0, 0, np.pi, -np.pi / 2, 0),
        base=0.35,
        stops=((10, 5, -10, 20, -40, 30), (-25, 15, 5, -15, -50, -40), (30, -10, -15, 10, -35, 60)),
        tried={
            "JOB.JBI": "--out YASKAWA.JBI --pulses 1341.4,1341.4,1341.4,1000,1000,622 --tool 1=0,0,150,0,0,0",
        },
    ),
)
