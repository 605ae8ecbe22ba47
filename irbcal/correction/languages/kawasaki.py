"""Kawasaki AS: programs with their locations, ``.JOINTS`` (``#name``) and ``.TRANS``.

A transformation names no posture: the arm keeps its own, so the solution is the one next to the stop before. Tools,
frames and plain numbers stand in ``.TRANS``, too: only what moves alone use is a target. How the controller's base and
flange are turned against the URDF is told by one pair of joints and pose.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.calls import Calls
from irbcal.correction.control_flow import ControlFlow
from irbcal.correction.instructions import TARGETS, VIA, WRITES, MotionInstruction, built_in, teaching_routine
from irbcal.correction.language import FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.listing import Edit, Listing, Number, Span, Token, Tokens, between_commas, numbers
from irbcal.correction.loads import load_of, unknown_load
from irbcal.correction.maker import Maker
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Program, each_read, read_bytes
from irbcal.correction.targets import Configuration, Role, Shift, Target
from irbcal.correction.text_program import PostureProgram
from irbcal.errors import OptionError, ProgramError
from irbcal.io.controller_model import ControllerFrames
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

KAWASAKI = Maker(
    name="AS",
    orientation=notation.Angles(("O", "A", "T"), "zyz"),
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(6, 6, 6),
    axes=("-z", "-x", "+x", "+z", "+x", "+z"),
    matrix=np.eye(6),
    world=True,
    asks_where=True,
)
"""No configuration stands in its programs."""

NO_WHERE = (
    "how the controller's base and flange are turned against the URDF is not known: give joints and pose of one place "
    "as WHERE shows them, with null tool and null base (--where)"
)
FIT_M, FIT_RAD = 1.0 * MM, 0.1 * DEG
"""By how much a pair of joints and pose may be off."""


def ends(arm: Arm, joints: FloatArray, pose: FloatArray) -> ControllerFrames:
    """The controller's base and flange by one pair of joints and pose.

    They are looked for among quarter turns about z at both ends, with the base at any height: of the six numbers of the
    pair one is fitted, and the others tell whether that holds.

    Parameters
    ----------
    arm : Arm
    joints : ndarray, shape (6,)
        As the controller counts them, radians.
    pose : ndarray, shape (4, 4)
        What it reports with null tool and null base, metres.

    Raises
    ------
    OptionError
        If no such turns fit the pair, or several do.
    """
    T = arm.forward(KAWASAKI.for_arm(arm).joints(joints)[None])[0]
    good, nearest = [], (np.inf, np.inf)
    for base, flange in product(range(4), repeat=2):
        B, F = (frames.from_xyz_angles([0.0, 0.0, 0.0, 0.0, 0.0, k * np.pi / 2]) for k in (base, flange))
        base_error = frames.inverse(B) @ T @ F
        off = base_error[:3, 3] - pose[:3, 3]
        B[2, 3] = off[2]
        angle = float(frames.rotation_distance(base_error[None, :3, :3], pose[None, :3, :3])[0])
        distance = float(np.linalg.norm(off[:2]))
        nearest = min(nearest, (distance, angle))
        if distance < FIT_M and angle < FIT_RAD:
            good.append(ControllerFrames(B, F, True, True))
    if not good:
        raise OptionError(
            f"where: this pose is none of {arm.name} at these joints with quarter turns about z at base and flange: "
            f"the nearest is {nearest[0] / MM:.1f} mm and {nearest[1] / DEG:.2f} degrees off (null tool, null base?)",
            parameter="where",
        )
    if len(good) > 1:
        raise OptionError(
            "where: this pair fits several turns: take one with all joints away from 0", parameter="where"
        )
    return good[0]


@dataclass(frozen=True, eq=False, repr=False)
class AsProgram(PostureProgram):
    """Programs and locations of a Kawasaki file as read."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment line."""
        newline = self.listing.newline(self.listing.file_at(max(at - 1, 0)))
        return at, at, f"; irbcal: fake targets, calibration {fingerprint}{newline}"

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """A straight or joint move to a transformation in numbers."""
        assert target.split is not None
        word = {"J": "JMOVE", "L": "LMOVE"}[self.text[target.split.span[0]].upper()]
        return [(*target.split.span, f"{word} TRANS({', '.join(self.split_texts(target, numbers))})")]


_LINE = re.compile(r"[^\r\n]+")
_SECTION = re.compile(
    r"(?:\xef\xbb\xbf)?\.(?:(PROGRAM)[ \t]+([^\s(;]+)|(TRANS|JOINTS)[ \t]*\Z|(END)\b|([A-Z]\w*))", re.I
)
_LOCATION = re.compile(r"[ \t]*(#?[A-Za-z_][\w.]*)[ \t]*(?:\[([^\[\]]*)\])?(?=[ \t])")
_VALUE = re.compile(r"[ \t,]+([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?=[ \t,]|\Z)")
_TOKEN = re.compile(
    r"""(?P<space>[ \t]+)
    |(?P<comment>;.*)
    |(?P<string>"[^"]*"?)
    |(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w))
    |(?P<name>[\#$]?\.?[A-Za-z_][\w.]*)
    |(?P<symbol>.)""",
    re.VERBOSE,
)


class Statement(NamedTuple):
    """A statement of a program; the first of each has the program's name and no tokens."""

    start: int
    tokens: list[Token]
    program: str


@dataclass
class Sections:
    """What stands in the files."""

    lines: list[Statement] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    locations: dict[str, Target] = field(default_factory=dict)
    """By name and index in lower case, ``#p[1,2]``."""
    names: dict[str, list[str]] = field(default_factory=dict)
    """Locations of each name."""
    numbered: dict[str, list[str]] = field(default_factory=dict)
    """Locations of each name and index: several where it is given again."""
    begins: list[int] = field(default_factory=list)
    """Behind the first line of each program."""


def read(listing: Listing) -> Sections:
    """Read all programs, ``.TRANS`` and ``.JOINTS`` of the files; other sections are passed over."""
    out = Sections()
    section = ""
    for file in listing.files:
        section = ""
        for statement in _LINE.finditer(listing.text, file.start, file.end):
            head = _SECTION.match(statement[0])
            if head is not None and (head[1] or head[3]):
                section = (head[1] or head[3]).upper()
                if head[1]:
                    out.lines.append(Statement(statement.start(), [], head[2].lower()))
                    out.begins.append(listing.after_line(statement.start()))
            elif head is not None and head[4]:
                section = ""
            elif head is not None and section != "PROGRAM":
                section = "other"
            elif section == "PROGRAM":
                tokens = _tokens(statement[0], statement.start(), out.comments)
                out.lines += [Statement(statement.start(), tokens, "")] if tokens else []
            elif section in ("TRANS", "JOINTS"):
                _location(out, statement[0], statement.start(), section)
    return out


def _tokens(text: str, start: int, comments: list[str]) -> list[Token]:
    tokens = []
    for match in _TOKEN.finditer(text):
        kind = str(match.lastgroup)
        if kind == "comment":
            comments.append(match[0])
        elif kind != "space":
            word = match[0].lower() if kind == "name" else match[0]
            tokens.append(Token(kind, word, start + match.start(), start + match.end()))
    return tokens


def _location(out: Sections, text: str, start: int, section: str) -> None:
    """A line of ``.TRANS`` or ``.JOINTS``."""
    head = _LOCATION.match(text)
    if head is None or head[1].startswith("#") != (section == "JOINTS"):
        return
    numbers: list[Number] = []
    at = head.end()
    while (value := _VALUE.match(text, at)) is not None:
        numbers.append(Number(float(value[1]), start + value.start(1), start + value.end(1)))
        at = value.end()
    key = plain = keyed(head[1], head[2])
    name = text[head.start(1) : head.end()].strip()
    complete = len(numbers) >= 6 and not text[at:].strip()
    empty = [Number(0.0, start, start)] * 6
    target = Target(name, "joint" if section == "JOINTS" else "pose", start, numbers[:6] if complete else empty)
    if not complete:
        target.conflicts.append("its six numbers are not understood")
    if len(numbers) > 6:
        target.external = "JT7"
        target.e = {f"e{k}": number.value for k, number in enumerate(numbers[6:], 1)}
    if key in out.locations:
        for target_of_name in (target, out.locations[key]):
            target_of_name.conflicts.append("there are two of this name")
        key = f"{key} (again in line {start})"
    out.locations[key] = target
    out.names.setdefault(head[1].lower(), []).append(key)
    out.numbered.setdefault(plain, []).append(key)


def keyed(name: str, index: str | None) -> str:
    """Name and index of a location as they are looked up."""
    return name.lower() if index is None else f"{name.lower()}[{''.join(index.split())}]"


def _number(tokens: Tokens) -> float | None:
    """A plain number with its sign; None where the tokens are something else."""
    sign = -1.0 if tokens and tokens[0].word == "-" else 1.0
    digits = tokens[1:] if tokens and tokens[0].word in ("-", "+") else tokens
    return sign * float(digits[0].word) if len(digits) == 1 and digits[0].kind == "number" else None


MOTIONS = built_in(
    """
    JMOVE LMOVE HMOVE XMOVE: to *
    C1MOVE: via *
    C2MOVE: to *
    """
)
BLOCKS = ("joint", "linear", "linear2", "cir1", "cir2")
"""Steps of teach programs, which end with their joints."""
RELATIVE = ("jappro", "lappro", "jdepart", "ldepart", "draw", "tdraw", "drive", "align", "home", "home2")
POSTURES = ("lefty", "righty", "above", "below", "uwrist", "dwrist")
FRAMES = {"tool", "base"}
NULL = "null"
LISTS = ("()", "[]")
_BEGIN = re.compile(
    rb"(?:\A(?:\xef\xbb\xbf)?|[\r\n])\.(?:PROGRAM[ \t]|(?:TRANS|JOINTS)[ \t]*(?:[\r\n]|\Z))", re.IGNORECASE
)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like one of a Kawasaki controller."""
    return _BEGIN.search(data) is not None


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read Kawasaki files for an arm: all are one program; see `irbcal.correction.languages.Language`."""
    contents, unread = each_read(files, _checked)
    return [parse(arm, contents, setup), *unread]


def _checked(file: Path) -> tuple[str, bytes]:
    """Name and content of a file of Kawasaki AS."""
    data = read_bytes(file)
    if not looks_like(data):
        raise ProgramError("expected a Kawasaki file with .PROGRAM, .TRANS or .JOINTS", file=file)
    Listing([(str(file), data)], "Kawasaki AS")
    return str(file), data


def parse(arm: Arm, files: Sequence[tuple[str, bytes]], setup: ControllerSetup) -> AsProgram:
    """Read Kawasaki AS from the names and contents of files.

    Raises
    ------
    ProgramError
        If this is none, or a tool or base that is needed is not known.
    OptionError
        If the pair of joints and pose does not fit the arm.
    """
    listing = Listing(files, "Kawasaki AS")
    sections = read(listing)
    reader = _ProgramReader(listing, sections, setup)
    for statement in sections.lines:
        reader.take(statement)
    reader.conclude()
    targets = sorted([*sections.locations.values(), *reader.literals], key=lambda target: target.start)
    if setup.where is None:
        for target in targets:
            target.conflicts += [NO_WHERE] if target.kind == "pose" and target.uses else []
    else:
        setup = setup._replace(controller=ends(arm, *setup.where))
    frame_values = {**reader.frames(), NULL: frames.transform()}
    first_begins = {listing.file_at(at): at for at in reversed(sections.begins)}
    return AsProgram.assembled(
        KAWASAKI,
        arm,
        reader.flow,
        targets,
        setup,
        frame_values,
        frame_values,
        comments=sections.comments,
        mark_at=sections.begins[0] if sections.begins else len(listing.text),
        marks_beside=tuple(at for at in first_begins.values() if at != sections.begins[0]),
    )


class _ProgramReader:
    """Follows the programs."""

    def __init__(self, listing: Listing, sections: Sections, setup: ControllerSetup) -> None:
        self.listing, self.sections = listing, sections
        self.taught = setup.instructions.get("kawasaki", {})
        self.flow = ControlFlow(listing, Calls(setup.ignored_calls), split_points=setup.split_points)
        self.literals: list[Target] = []
        self._literal_frames: dict[str, FloatArray] = {}
        self._bad = {key for key, location in sections.locations.items() if location.conflicts}
        self._framed: dict[str, int] = {}
        _learn(self.flow.calls, sections.lines, self.taught)

    def take(self, statement: Statement) -> None:
        """Take one line."""
        if statement.program:
            self.flow.restart(statement.program)
            return
        tokens = self._without_label(statement.tokens)
        if not tokens:
            return
        word, arguments, at = tokens[0].word, tokens[1:], tokens[0].start
        routine = arguments[0] if word == "call" and arguments[1:2] and arguments[1].word == "(" else None
        if routine is not None and routine.word in self.taught:
            self._taught_move(self.taught[routine.word], between_commas(arguments[2:-1]), at)
        elif word in MOTIONS:
            self._move(word, arguments, at)
        elif word in BLOCKS and any(token.word == "#" for token in arguments):
            first = next(k for k, token in enumerate(arguments) if token.word == "#")
            self._mention(arguments[:first], at)
            self._go(word, arguments[first:], at, "via" if word == "cir1" else "to")
        elif word in ("tool", "base"):
            self._frame(word, arguments, at)
        elif word == "weight":
            mass = _number(between_commas(arguments)[0]) if arguments else None
            computed = unknown_load(f"the load of line {self.listing.line(at)} is not in numbers")
            self.flow.carry(computed if mass is None else load_of(mass), at)
        elif self._approach(word, arguments, at) or self._depart(word, arguments, at):
            pass
        elif word in RELATIVE:
            self.flow.leave(at, word.upper(), self.listing.quote(at, tokens[-1].end), "it moves by a distance")
            self.flow.stop(None, at)
            self._mention(arguments, at)
        else:
            if routine is not None:
                shown = self.listing.quote(routine.start, routine.end)
                are_locations = [bool(self._named(argument)) for argument in between_commas(arguments[2:-1])]
                self.flow.teaching[self.listing.line(at)] = teaching_routine("kawasaki", shown, are_locations)
            self._flow(word, tokens, at)
            self._mention(tokens, at)

    def _taught_move(self, instruction: MotionInstruction, arguments: list[Tokens], at: int) -> None:
        """A program that moves to one of its arguments."""
        roles = instruction.roles(len(arguments), False)
        if roles is None:
            self.flow.leave(at, instruction.name, "", instruction.refusal(len(arguments)))
            self.flow.stop(None, at)
        for role, argument in zip(roles or [WRITES] * len(arguments), arguments, strict=True):
            if role in TARGETS:
                self._go(instruction.name, argument, at, "via" if role == VIA else "to")
            else:
                self._mention(argument, at)

    def _approach(self, word: str, arguments: Tokens, at: int) -> bool:
        """Take a location from which a move stays away along the tool's axis, if it is one (``LAPPRO point,80``)."""
        points = between_commas(arguments) if word in ("jappro", "lappro") else []
        keys = self._named(points[0]) if points else None
        targets = [self.sections.locations[key] for key in keys or ()]
        if len(points) != 2 or not targets or any(target.kind == "joint" for target in targets):
            return False
        text = self.listing.quote(arguments[0].start, arguments[-1].end)
        self._beside(word, targets, _number(points[1]), text, (at, arguments[-1].end))
        self._mention(points[1], at)
        return True

    def _depart(self, word: str, arguments: Tokens, at: int) -> bool:
        """Take a move away from the location where the arm stands, if it is at one by its tool and base."""
        target = self.flow.standing_at(self.flow.state)
        distance = _number(arguments) if word in ("jdepart", "ldepart") else None
        if target is None or target.kind == "joint" or distance is None:
            return False
        end = arguments[-1].end
        self._beside(word, [target], distance, self.listing.quote(arguments[0].start, end), (at, end))
        return True

    def _beside(self, word: str, targets: Sequence[Target], distance: float | None, text: str, span: Span) -> None:
        """Go to a distance from a location, one of several, along the tool's axis; None where it is computed."""
        at = span[0]
        T = frames.transform(None, [0.0, 0.0, -(distance or 0.0) * MM])
        tool, frame = self.flow.state.tool, self.flow.state.frame
        known = distance is not None
        shifts = [Shift(t, at, word.upper(), text, np.eye(4), T, known, tool, frame) for t in targets]
        new_target = None if any(t.external for t in targets) else self.flow.shift(shifts, span)
        if new_target is not None:
            self.literals.append(new_target)
            self.flow.use(new_target, at, word.upper())
        if new_target is not None or not known:
            self.flow.stop(new_target, at)
        else:
            self.flow.stop_beside(at)

    def _without_label(self, tokens: Tokens) -> Tokens:
        """The statement behind a label; behind one nothing is known."""
        has_name = len(tokens) > 1 and tokens[1].word == ":" and tokens[0].word not in ("any", "else")
        if tokens[0].kind != "number" and not has_name:
            return tokens
        self.flow.label(tokens[0].start)
        return tokens[2 if has_name else 1 :]

    def _flow(self, word: str, tokens: Tokens, at: int) -> None:
        names = [token.word for token in tokens if token.kind == "name"]
        if word in ("if", "while", "for", "do", "case", "scase"):
            if word != "if" or names[-1] == "then":
                self.flow.open(word in ("while", "for", "do"))
        elif word in ("else", "elseif", "value", "svalue", "any"):
            self.flow.alternative()
        elif word in ("end", "until"):
            self.flow.close(at)
        elif word in POSTURES or word in ("return", "goto", "here", "point"):
            self.flow.forget()
            if word == "return":
                self.flow.loads.returns()
        if "goto" in names:
            self.flow.loads.label()
        if "call" in names or word in ("gosub", "on", "oni", "pcexecute"):
            for callee in _called(tokens) or tokens[:1]:
                self.flow.call(callee.word, self.listing.quote(callee.start, callee.end), at)
                if word in ("on", "oni"):
                    self.flow.call_any_time(callee.word)
        elif "goto" in names:
            self.flow.forget()

    def _move(self, word: str, arguments: Tokens, at: int) -> None:
        till = next((k for k, token in enumerate(arguments) if token.word == "till"), len(arguments))
        points = between_commas(arguments[:till])
        for tokens in [*points[1:], arguments[till:]]:
            self._mention(tokens, at)
        self._go(word, points[0], at, "via" if word == "c1move" else "to")
        if word == "xmove":  # a signal may stop it on the way
            self.flow.forget()

    def _go(self, word: str, point: Tokens, at: int, role: Role) -> None:
        """Use the target of a move."""
        goals, reason = self._goals(point, f"{word.upper()} in line {self.listing.line(at)}")
        if not goals:
            text = self.listing.quote(point[0].start, point[-1].end) if point else ""
            self.flow.leave(at, word.upper(), text, reason)
            self._mention(point, at)
        for target in goals:
            self.flow.use(target, at, word.upper(), role)
        if role == "to":
            self.flow.stop(goals[0] if len(goals) == 1 else None, at)

    def _goals(self, tokens: Tokens, name: str) -> tuple[list[Target], str]:
        """The locations that an argument names, all of an array where its index is computed."""
        keys_of_name = self._named(tokens)
        if keys_of_name is not None:
            keys = keys_of_name
            return [self.sections.locations[key] for key in keys], "" if keys else "it is not in these files"
        head = tokens[0].word if tokens else ""
        joint = head in ("#ppoint", "#")
        values = numbers(tokens[1:], LISTS) if joint or head == "trans" else None
        if values is None or len(values) < 6 or (len(values) > 6 and not joint):
            return [], "its target is computed"
        target = Target(name, "joint" if joint else "pose", tokens[0].start, values[:6])
        target.external = "JT7" if len(values) > 6 else ""
        target.e = {f"e{k}": number.value for k, number in enumerate(values[6:], 1)}
        self.literals.append(target)
        return [target], ""

    def _named(self, tokens: Tokens) -> list[str] | None:
        """Keys of the locations that a name with or without index stands for; None where it is something else."""
        if not tokens or tokens[0].kind != "name" or tokens[0].word in ("trans", "#ppoint", NULL):
            return None
        inside = tokens[2:-1]
        indexed = len(tokens) > 3 and tokens[1].word == "[" and tokens[-1].word == "]"
        if len(tokens) > 1 and (not indexed or any(token.word in ("[", "]") for token in inside)):
            return None
        name = tokens[0].word
        if len(tokens) > 1 and not all(token.kind == "number" or token.word == "," for token in inside):
            return self.sections.names.get(name, [])
        key = keyed(name, "".join(token.word for token in inside) if len(tokens) > 1 else None)
        return self.sections.numbered.get(key, [])

    def _frame(self, word: str, arguments: Tokens, at: int) -> None:
        """``TOOL`` and ``BASE``."""
        set_to = self.flow.tool if word == "tool" else self.flow.frame
        statement = self.listing.line(at)
        values = numbers(arguments[1:], LISTS) if arguments and arguments[0].word == "trans" else None
        if values is not None and len(values) == 6:
            name = f"of line {statement}"
            self._literal_frames[name] = KAWASAKI.frame([value.value for value in values])
            set_to(name)
        elif len(arguments) == 1 and arguments[0].word == NULL:
            set_to(NULL)
        else:
            index = arguments[2:-1]
            plain = self._named(arguments) is not None and all(t.kind == "number" or t.word == "," for t in index)
            inside = "".join(token.word for token in index) if len(arguments) > 1 else None
            key = keyed(arguments[0].word, inside) if plain else None
            set_to(key, f"{word.upper()} in line {statement} is computed")
            if key is None:
                self._mention(arguments, at)
            else:
                self._framed[key] = at

    def _mention(self, tokens: Tokens, at: int) -> None:
        """Names that something else than a move uses."""
        for token in tokens:
            for key in self.sections.names.get(token.word, ()) if token.kind == "name" else ():
                self.flow.mention(self.sections.locations[key], at)
                self._bad.add(key)

    def frames(self) -> dict[str, FloatArray]:
        """Transformations that may serve as tool or base: those that nothing changes."""
        constant_frames = {
            key: KAWASAKI.frame([number.value for number in location.numbers])
            for key, location in self.sections.locations.items()
            if location.kind == "pose" and key not in self._bad
        }
        return {**constant_frames, **self._literal_frames}

    def conclude(self) -> None:
        """Tell the targets that are a tool or base as well."""
        for key, at in self._framed.items():
            target = self.sections.locations.get(key)
            if target is not None and target.uses:
                self.flow.mention(target, at)


def _called(tokens: Tokens) -> list[Token]:
    """Programs that a statement calls."""
    return [behind for word, behind in pairwise(tokens) if word.word in ("call", "gosub") and behind.kind == "name"]


def _learn(calls: Calls, lines: Sequence[Statement], taught: Collection[str]) -> None:
    """Note which programs set tool or base, which move, and what they call; ``ON`` and ``GOSUB`` may call anything."""
    name = ""
    for statement in lines:
        name = statement.program or name
        identifiers = {token.word for token in statement.tokens if token.kind == "name"}
        may_call = [word for word in ("gosub", "on", "oni") if word in identifiers]
        moves = not identifiers.isdisjoint((*MOTIONS, *BLOCKS, *RELATIVE, *POSTURES, *taught))
        called = [*may_call, *(called.word for called in _called(statement.tokens) if called.word not in taught)]
        calls.learn(name, called, bool(identifiers & FRAMES), moves, "weight" in identifiers)


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.pg``: joints as ``#plan1`` … and ``JMOVE`` to them."""
    lines = [".PROGRAM plan()", *(f"; {note(text)}" for text in moves.head), "  ACCURACY 1 ALWAYS"]
    for number, move in enumerate(moves.moves, start=1):
        lines += [f"; {note(move.comment)}"] if move.comment else []
        lines += [f"  SPEED {move.percent}", f"  JMOVE #plan{number}", "  BREAK"]
        lines += [f"  TWAIT {move.wait_s:.1f}"] if move.wait_s else []
    points = [f"#plan{number} {' '.join(joints)}" for number, joints in enumerate(moves.texts(KAWASAKI), start=1)]
    return {"plan.pg": "\r\n".join([*lines, ".END", ".JOINTS", *points, ".END", ""])}


LANGUAGE = Language(
    name="Kawasaki AS",
    endings=(".as", ".pg"),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(lambda listing: read(listing).comments, "Kawasaki AS"),
    maker=KAWASAKI,
    robots=r"kawasaki|khi|(^|_)rs\d{3}",
    write_moves=write_moves,
    motions=MOTIONS,
    declaration=FrameDeclaration(
        name=r"[A-Za-z][A-Za-z0-9_.]{0,14}",
        names="begin with a letter and have at most 15 letters, digits, _ and .",
        head=".TRANS",
        tool="{name} {0} {1} {2} {3} {4} {5}",
        work_object="{name} {0} {1} {2} {3} {4} {5}",
        foot=".END",
    ),
    sample=SampleArm(
        folder="kawasaki",
        joints=(
            ((0, 0, 0.36), "0 0 -1"),
            ((0, 0, 0), "-1 0 0"),
            ((0, 0, 0.36), "1 0 0"),
            ((0, 0, 0.09), "0 0 1"),
            ((0, 0, 0.28), "1 0 0"),
            ((0, 0, 0.08), "0 0 1"),
        ),
        base=0.36,
        stops=((20, 30, -80, 15, 60, 10), (10, 20, -70, 15, 50, -30), (-15, 35, -60, -20, 45, 20)),
        tried={"job.as": "--out kawasaki-job.as --where {where}"},
    ),
)
