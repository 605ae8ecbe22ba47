"""VAL3 applications (CS8 and CS9): points and joints in ``.dtx``, moves in ``.pgx``; a folder is one application.

A point stands in the frame that it names as its father, whose place is in the data as well, up to ``world``. In data of
SRS 7 and newer a value is an element with all of its attributes; in those of VAL3 s6 father, place and configuration of
a value are elements of their own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.control_flow import ControlFlow, FrameState
from irbcal.correction.instructions import TARGETS, TOOL, WRITES, MotionInstruction, built_in
from irbcal.correction.language import ANY_WORD, FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.listing import Edit, Listing, Number, Span
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Program, each_read, read_bytes
from irbcal.correction.targets import Configuration, Shift, Target
from irbcal.correction.text_program import PostureProgram
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

STAUBLI = Maker(
    name="VAL3",
    orientation=notation.Angles(("rx", "ry", "rz"), "xyz"),
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(6, 6, 6),
    axes=("+z", "+y", "+y", "+z", "+y", "+z"),
    matrix=np.eye(6),
    reference=(0.0, 0.0, 90.0, 0.0, 0.0, 0.0),
    world=True,
)
"""In the reference the elbow is positive."""


MOTIONS = built_in(
    """
    movej movel: to tool *
    movec: via to tool *
    """
)


def posture_of(attributes: Mapping[str, str]) -> tuple[Posture, str]:
    """What shoulder, elbow and wrist mean, and why they mean nothing; ``same`` and ``free`` leave it open."""
    shoulder, elbow, wrist = (attributes.get(key, "") for key in ("shoulder", "elbow", "wrist"))
    if shoulder == "righty":
        return Posture(), "its shoulder is righty: how the elbow is counted behind axis 1 is not confirmed"
    meanings = {
        "shoulder": ("lefty", "ssame", "sfree", ""),
        "elbow": ("epositive", "enegative", "esame", "efree", ""),
        "wrist": ("wpositive", "wnegative", "wsame", "wfree", ""),
    }
    for key, value in (("shoulder", shoulder), ("elbow", elbow), ("wrist", wrist)):
        if value not in meanings[key]:
            return Posture(), f"its {key} {value[:20]!r} is not known"
    shoulder_back = False if shoulder == "lefty" else None
    bent = {"epositive": False, "enegative": True}.get(elbow)
    return Posture(shoulder_back, bent, {"wpositive": 1, "wnegative": -1}.get(wrist)), ""


@dataclass(frozen=True, eq=False, repr=False)
class Val3Program(PostureProgram):
    """A VAL3 application as read."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment of the XML."""
        return at, at, f"<!-- irbcal: fake targets, calibration {fingerprint.replace('-', '_')} -->"

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """Shoulder, elbow and wrist of joints."""
        return Posture(back, bent, -1 if negative else 1)

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """A datum of one point, with the father and the configuration of the one that was shifted."""
        assert target.split is not None
        text, start = self.text, target.split.target.start
        begin, behind = text.rindex("<Data", 0, start), text.index("</Data>", start) + len("</Data>")
        head, value = text[begin : text.index(">", begin) + 1], text[start : text.index(">", start) + 1]
        pairs = zip(target.numbers, self.split_texts(target, numbers), strict=True)
        for number, new in sorted(pairs, key=lambda pair: -pair[0].start):
            value = value[: number.start - start] + new + value[number.end - start :]
        name = _split_name(self.listing, target.split.span)
        head = _with_attribute(_with_attribute(head, "name", name), "size", "1")
        value = _with_attribute(value, "key", "0") + ("" if value.endswith("/>") else "</Value>")
        return [(*target.split.span, name), (behind, behind, f"{self.listing.newline()}{head}{value}</Data>")]


def _with_attribute(tag: str, key: str, value: str) -> str:
    """A tag with another value of an attribute."""
    return re.sub(rf"(\s{key}\s*=\s*)(\"[^\"]*\"|'[^']*')", rf'\g<1>"{value}"', tag)


def _split_name(listing: Listing, span: Span) -> str:
    """Name of the point for a place in a program."""
    return f"p{listing.line(span[0])}c{listing.column(span[0])}"


_PIECE = re.compile(
    r"(?P<comment><!--.*?-->)|<!\[CDATA\[(?P<code>.*?)\]\]>|<code>(?P<plain>[^<]+)</code>|<(?P<end>/?)(?P<tag>[A-Za-z]\w*)(?P<rest>[^<>]*)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([A-Za-z_][\w:.]*)\s*=\s*(?:\"([^\"<]*)\"|'([^'<]*)')")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\Z")

POSE, JOINTS = ("x", "y", "z", "rx", "ry", "rz"), ("j1", "j2", "j3", "j4", "j5", "j6")


class DatumValue(NamedTuple):
    """An element of a datum: its attributes and where their texts stand."""

    type: str
    name: str
    key: str
    attributes: dict[str, str]
    offsets: dict[str, int]
    start: int

    @property
    def indexed_name(self) -> str:
        """Name with its index."""
        return f"{self.name}[{self.key}]"


OLD_TYPES = {"point": "pointRx", "joint": "jointRx", "frame": "frame", "tool": "tool"}
"""Elements of VAL3 s6, and what newer data call them."""
_OLD_FATHERS, _OLD_VALUES = ("pFather", "fFather", "tFather"), ("valuePoint", "valueJoint", "valueFrame", "valueTool")


class Code(NamedTuple):
    """The text of a program."""

    start: int
    end: int


def read(listing: Listing) -> tuple[list[DatumValue], list[Code], list[str]]:
    """Elements of all data, program texts and comments."""
    values: list[DatumValue] = []
    codes: list[Code] = []
    comments: list[str] = []
    for file in listing.files:
        datum: dict[str, str] = {}
        for piece in _PIECE.finditer(listing.text, file.start, file.end):
            if piece["comment"]:
                comments.append(piece["comment"])
            elif piece["code"] is not None or piece["plain"] is not None:
                kind = "code" if piece["code"] is not None else "plain"
                codes.append(Code(piece.start(kind), piece.end(kind)))
            elif piece["tag"] == "Data":
                datum = {} if piece["end"] else _attributes(piece)[0]
            elif piece["tag"] == "Value" and datum and not piece["end"]:
                attributes, positions = _attributes(piece)
                key = attributes.get("key", "0")
                kind, name = datum.get("type", ""), datum.get("name", "")
                values.append(DatumValue(kind, name, key, attributes, positions, piece.start()))
            elif not piece["end"]:
                _read_old(piece, datum, values)
    return values, codes, comments


def _read_old(piece: re.Match[str], datum: dict[str, str], values: list[DatumValue]) -> None:
    """A tag of the data of VAL3 s6: ``datum`` keeps what holds for the values that follow."""
    tag, (attributes, positions) = piece["tag"], _attributes(piece)
    if tag in OLD_TYPES or tag.endswith("Section"):
        datum.clear()
    if tag in OLD_TYPES and "name" in attributes:
        datum |= {"old": OLD_TYPES[tag], "name": attributes["name"], "father": "world[0]"}
    elif "old" not in datum:
        return
    elif tag in _OLD_FATHERS:
        alias, father = attributes.get("alias", ""), attributes.get("name", "")
        datum["father"] = f"{alias}{':' * bool(alias)}{father}[{attributes.get('fatherIndex', '0')}]"
    elif tag in _OLD_VALUES:
        datum["key"] = attributes.get("index", "0")
    elif tag == "cpValue" and values:
        values[-1].attributes.update(attributes)
    elif "x" in attributes or "j1" in attributes:
        attributes["fatherId"] = datum["father"]
        values.append(
            DatumValue(datum["old"], datum["name"], datum.get("key", "0"), attributes, positions, piece.start())
        )


def _attributes(piece: re.Match[str]) -> tuple[dict[str, str], dict[str, int]]:
    texts: dict[str, str] = {}
    positions: dict[str, int] = {}
    for match in _ATTRIBUTE.finditer(piece["rest"]):
        which = 2 if match[2] is not None else 3
        texts.setdefault(match[1], match[which])
        positions.setdefault(match[1], piece.start("rest") + match.start(which))
    return texts, positions


def numbers(value: DatumValue, names: tuple[str, ...], absent: bool = False) -> list[Number] | None:
    """Six numbers of an element; None where one is none, or, unless ``absent`` (they are 0 then), is not there."""
    out = []
    for name in names:
        text = value.attributes.get(name, "0" if absent else "").strip()
        if not _NUMBER.match(text):
            return None
        position = value.offsets.get(name, value.start)
        raw = value.attributes.get(name, text)
        start = position + raw.index(text)
        out.append(Number(float(text), start, start + len(text)))
    return out


def target(value: DatumValue) -> Target | None:
    """The target that an element is; None for other data."""
    if value.type not in ("pointRx", "jointRx"):
        return None
    joint = value.type == "jointRx"
    target_numbers = numbers(value, JOINTS if joint else POSE)
    none = [Number(0.0, value.start, value.start)] * 6
    out = Target(value.indexed_name, "joint" if joint else "pose", value.start, target_numbers or none)
    if target_numbers is None:
        out.conflicts.append("not all of its numbers are written")
        return out
    if not joint:
        out.configuration, reason = posture_of(value.attributes)
        out.conflicts += [reason] if reason else []
    return out


_ITEM = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*\Z")
_NAME = re.compile(r"[A-Za-z_]\w*")
_QUIET = re.compile(r"\b(?:open|close)\s*\(\s*[A-Za-z_]\w*(?:\[\s*\d+\s*\])?\s*\)")
_FLOW = re.compile(
    r"\b(?:if|else|elseIf|endIf|while|endWhile|for|endFor|do|until|switch|case|default|endSwitch|call|return)\b"
)
MENTIONS = 3
"""Lines that use a datum in another way, and are named."""
_HEAD = re.compile(r"(?:\xef\xbb\xbf)?\s*<\?xml[^<>]*\?>")


def looks_like(data: bytes) -> bool:
    """Whether a file looks like one of a VAL3 application."""
    head = data[:2000]
    old = any(name in head for name in (b'"DataNameSpace"', b'"ProgramNameSpace"', b'"ProjectNameSpace"'))
    return (b"/VAL3/" in head or old) and b"<" in data[:10]


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read VAL3 applications for an arm, one a folder, with all files beside those named."""

    def application(folder: Path) -> Val3Program:
        beside = [path for path in sorted(folder.glob("*")) if path.suffix.lower() in ENDINGS]
        every = dict.fromkeys([*(file for file in files if file.parent == folder), *beside])
        return parse(arm, [(str(file), read_bytes(file)) for file in every], setup)

    programs, unread = each_read(list(dict.fromkeys(file.parent for file in files)), application)
    return [*programs, *unread]


def parse(arm: Arm, files: Sequence[tuple[str, bytes]], setup: ControllerSetup) -> Val3Program:
    """Read a VAL3 application.

    Raises
    ------
    ProgramError
        If this is none, or a tool or frame that is needed is not known.
    """
    listing = Listing(sorted(files, key=lambda file: not file[0].lower().endswith(".dtx")), "VAL3")
    for span in listing.files:
        text = listing.text[span.start : span.end]
        if span.name.lower().endswith(".dtx") and not re.search(r'VAL3/Data/2|xmlns="DataNameSpace"', text):
            raise ProgramError("expected data of VAL3 (VAL3/Data/2 or DataNameSpace), found others", file=span.name)
        if re.search(r"millimeterUnit\s*=\s*[\"']false", text):
            raise ProgramError("this application is in inches, which is not supported", file=span.name)
    values, codes, comments = read(listing)
    application = _ApplicationReader(listing, values, setup)
    for code in codes:
        application.follow(code)
    application.conclude()
    targets = [target for _, target in application.targets]
    main = next((file for file in listing.files if file.name.lower().endswith(".dtx")), listing.files[0])
    heads = {span: _HEAD.match(listing.text, span.start, span.end) for span in listing.files}
    marks = {span: head.end() if head else span.end for span, head in heads.items()}
    return Val3Program.assembled(
        STAUBLI,
        arm,
        application.flow,
        targets,
        setup,
        application.tools(),
        application.frames(),
        source=main.name,
        comments=comments,
        mark_at=marks.pop(main),
        marks_beside=tuple(marks.values()),
    )


def _shown(name: str, index: str = "0") -> str:
    return f"{name}[{index or '0'}]".lower()


_APPROACH = re.compile(r"\s*appro\s*\(\s*([A-Za-z_]\w*\s*(?:\[[^\[\]]*\])?)\s*,(.*)\)\s*")
_SIX = re.compile(r"\s*\{\s*" + r"\s*,\s*".join([r"[-+]?(?:\d+\.?\d*|\.\d+)"] * 6) + r"\s*\}\s*")


class _ApplicationReader:
    """Follows the program texts."""

    def __init__(self, listing: Listing, values: Sequence[DatumValue], setup: ControllerSetup) -> None:
        self.listing, self.values = listing, values
        self.flow = ControlFlow(listing, split_points=setup.split_points)
        taught = {move.name: move for move in setup.instructions.get("val3", {}).values()}
        self.moves: dict[str, MotionInstruction] = {**MOTIONS, **taught}
        self._call = re.compile(rf"\b(?:call\s+)?({'|'.join(self.moves)})\s*\(")
        self._argument_end = 0
        pairs = [(value, target(value)) for value in values]
        self.targets = [(value, target) for value, target in pairs if target is not None]
        first_of_name: dict[str, Target] = {}
        for _, target_of_value in self.targets:
            if target_of_value.name in first_of_name:
                target_of_value.conflicts.append("there are two of this name")
                first_of_name[target_of_value.name].conflicts.append("there are two of this name")
            first_of_name[target_of_value.name] = target_of_value
        self.by_name: dict[str, list[tuple[DatumValue, Target]]] = {}
        self.single: dict[tuple[str, str], list[tuple[DatumValue, Target]]] = {}
        for pair in self.targets:
            self.by_name.setdefault(pair[0].name, []).append(pair)
            self.single.setdefault((pair[0].name, pair[0].key), []).append(pair)
        self.frames_of_program = {
            _shown(value.name, value.key): value for value in values if value.type == "frame" and value.name != "world"
        }
        self.inside: dict[str, list[Target]] = {}
        for value, target_of_value in self.targets:
            if value.type == "pointRx":
                for frame_name in self._fathers(value):
                    self.inside.setdefault(frame_name, []).append(target_of_value)
        self.names = {value.name for value in values}
        self._touched: dict[str, str] = {}
        self._mentions: Counter[str] = Counter()

    def follow(self, code: Code) -> None:
        """Take the text of a program."""
        self.flow.restart()
        for line in re.finditer(r"[^\r\n]+", self.listing.text[code.start : code.end]):
            text = re.sub(r"\"[^\"]*\"|&quot;.*?&quot;", lambda match: " " * len(match[0]), line[0])
            text = _QUIET.sub(lambda match: " " * len(match[0]), text.split("//", maxsplit=1)[0])
            self._line(code.start + line.start(), text)

    def _line(self, at: int, text: str) -> None:
        at += len(text) - len(text.lstrip())
        if _FLOW.search(text):
            self.flow.forget()
        move = self._call.search(text)
        while move is not None:
            inside, end = _inside(text, move.end())
            self._move(at, move[1], inside)
            text = text[: move.start()] + " " * (end - move.start()) + text[end:]
            move = self._call.search(text)
        self._mention(at, text)

    def _mention(self, at: int, text: str) -> None:
        for name in set(_NAME.findall(text)) & self.names:
            reason = f"line {self.listing.line(at)} uses {name} in another way"
            self._touched[name.lower()] = reason
            self._mentions[name] += 1
            if self._mentions[name] > MENTIONS:
                continue
            ones = [*(target for _, target in self.by_name.get(name, ())), *self.inside.get(name.lower(), ())]
            for one in {id(target): target for target in ones}.values():
                one.conflicts.append(reason)

    def _fathers(self, value: DatumValue) -> set[str]:
        """Names of all frames that a point stands in, without index."""
        at, visited = self._father(value), set()
        while at not in visited:
            visited.add(at)
            at = self._father(self.frames_of_program[at]) if at in self.frames_of_program else at
        return {father.partition("[")[0] for father in visited}

    def conclude(self) -> None:
        """Tell the targets of tools that the programs use in another way."""
        for _, target in self.targets:
            for use in target.uses:
                name = (use.tool or "").split("[", maxsplit=1)[0]
                target.conflicts += [self._touched[name]] if name in self._touched else []

    def _father(self, value: DatumValue) -> str:
        return value.attributes.get("fatherId", "world[0]").lower()

    def _move(self, at: int, move: str, arguments: list[str]) -> None:
        roles = self.moves[move].roles(len(arguments), False)
        if roles is None:
            self.flow.leave(at, move, ", ".join(arguments)[:50], "its arguments are not understood")
            self.flow.stop(None, at)
            return
        tool = _ITEM.match(arguments[roles.index(TOOL)])
        index = (tool[2] or "0") if tool else ""
        name = _shown(tool[1], index) if tool is not None and index.isdecimal() else None
        stop: Target | None = None
        for role, argument in zip(roles, arguments, strict=True):
            if role == WRITES:
                self._mention(at, argument)
            if role not in TARGETS:
                continue
            if self._approach(at, move, argument, name, role):
                stop = self.flow.shifts[-1].new_target
                continue
            goals, reason = self._goal(argument)
            if reason:
                self.flow.leave(at, move, argument.strip()[:50], reason)
            for value, target in goals:
                state = FrameState(name, self._father(value), f"the tool of line {self.listing.line(at)} is computed")
                self.flow.use(target, at, move, "via" if role == "via" else "to", state)
            stop = goals[0][1] if len(goals) == 1 else None
            if not goals:
                self._mention(at, argument)
        self.flow.stop(stop, at)

    def _approach(self, at: int, move: str, argument: str, tool: str | None, role: str) -> bool:
        """Take a point with a shift in its own axes, ``appro(point,{x,y,z,rx,ry,rz})``; whether it is one."""
        match = _APPROACH.fullmatch(argument)
        goals = [] if match is None else self._goal(match[1])[0]
        if match is None or not goals or any(target.kind == "joint" for _, target in goals):
            return False
        numbers = [float(number) for number in match[2].strip(" {}").split(",")] if _SIX.fullmatch(match[2]) else []
        T = STAUBLI.frame(numbers) if numbers else np.eye(4)
        text, known = argument.strip()[:50], bool(numbers)
        start = self.listing.text.index(argument.strip(), max(at, self._argument_end))
        self._argument_end = start + len(argument.strip())
        shifts = [Shift(t, at, move, text, np.eye(4), T, known, tool, self._father(value)) for value, t in goals]
        span = start, self._argument_end
        new = "<dataList" not in self.listing.text and _split_name(self.listing, span) not in self.names
        if not new:
            self.flow.shifts += shifts
        new_target = self.flow.shift(shifts, span) if new else None
        if new_target is not None:
            self.targets.append((goals[0][0], new_target))
            state = FrameState(tool, shifts[0].work_object, f"the tool of line {self.listing.line(at)} is computed")
            self.flow.use(new_target, at, move, "via" if role == "via" else "to", state)
        self._mention(at, "" if numbers else match[2])
        return True

    def _goal(self, argument: str) -> tuple[list[tuple[DatumValue, Target]], str]:
        reference = _ITEM.match(argument)
        if reference is None:
            return [], "its target is computed"
        index = reference[2] or "0"
        goals = self.single.get((reference[1], index), []) if index.isdecimal() else self.by_name.get(reference[1], [])
        return goals, "" if goals else "it is not declared in this application"

    def tools(self) -> dict[str, FloatArray]:
        """Tools by name, on the flange."""
        out = {"flange[0]": frames.transform()}
        for value in self.values:
            if value.type == "tool" and value.name != "flange":
                T = self._frame(value)
                if T is not None and self._father(value) in ("flange[0]", "world[0]"):
                    out[_shown(value.name, value.key)] = T
        return out

    def frames(self) -> dict[str, FloatArray]:
        """Frames by name, in the world."""
        frame_values, out = self.frames_of_program, {"world[0]": frames.transform()}
        for name in frame_values:
            T, at, visited = np.eye(4), name, set()
            while at in frame_values and at not in visited:
                visited.add(at)
                step = self._frame(frame_values[at])
                T = np.full((4, 4), np.nan) if step is None else step @ T
                at = self._father(frame_values[at])
            if at == "world[0]" and np.isfinite(T).all():
                out[name] = T
        return out

    def _frame(self, value: DatumValue) -> FloatArray | None:
        coordinates = numbers(value, POSE, absent=True)
        return None if coordinates is None else STAUBLI.frame([number.value for number in coordinates])


def _inside(text: str, begin: int) -> tuple[list[str], int]:
    """Arguments of a call that begin there, and the place behind it."""
    depth, start = 1, begin
    out: list[str] = []
    for k in range(begin, len(text)):
        depth += (text[k] in "([{") - (text[k] in ")]}")
        if depth == 0 or (depth == 1 and text[k] == ","):
            out.append(text[start:k])
            start = k + 1
        if depth == 0:
            return out, k + 1
    return out, len(text)


_XML_HEAD = '<?xml version="1.0" encoding="utf-8" ?>'
_XSI = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_SPACE = "http://www.staubli.com/robotics/VAL3"


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.pjx``, ``plan.dtx`` and ``start.pgx``: an array of joints, and moves to its elements."""
    code = ["begin", *(f"  // {note(text, without='<>[]')}" for text in moves.head)]
    for k, move in enumerate(moves.moves):
        code += [f"  // {note(move.comment, without='<>[]')}"] if move.comment else []
        code += [f"  mPlan.vel={move.percent}", f"  movej(jPlan[{k}],flange,mPlan)", "  waitEndMove()"]
        code += [f"  delay({move.wait_s:.1f})"] if move.wait_s else []
    values = [
        f'      <Value key="{k}" ' + " ".join(f'j{i}="{text}"' for i, text in enumerate(joints, start=1)) + " />"
        for k, joints in enumerate(moves.texts(STAUBLI))
    ]
    data = [
        _XML_HEAD,
        f'<Database {_XSI} xmlns="{_SPACE}/Data/2">',
        "  <Datas>",
        f'    <Data name="jPlan" access="private" xsi:type="array" type="jointRx" size="{len(values)}">',
        *values,
        "    </Data>",
        '    <Data name="mPlan" access="private" xsi:type="array" type="mdesc" size="1">',
        '      <Value key="0" accel="50" vel="10" decel="50" tmax="99999" rmax="99999" blend="off" />',
        "    </Data>",
        "  </Datas>",
        "</Database>",
    ]
    program = [_XML_HEAD, f'<Programs xmlns="{_SPACE}/Program/2">', '  <Program name="start">', "    <Code><![CDATA["]
    start = [*program, *code, "end]]></Code>", "  </Program>", "</Programs>"]
    project = [
        _XML_HEAD,
        f'<Project xmlns="{_SPACE}/Project/3">',
        '  <Parameters version="s7.3.1" stackSize="5000" millimeterUnit="true" />',
        "  <Programs>",
        '    <Program file="start.pgx" />',
        "  </Programs>",
        "  <Database>",
        '    <Data file="plan.dtx" />',
        "  </Database>",
        "  <Libraries />",
        "</Project>",
    ]
    files = {"plan.pjx": project, "plan.dtx": data, "start.pgx": start}
    return {name: "\r\n".join([*lines, ""]) for name, lines in files.items()}


ENDINGS = (".dtx", ".pgx", ".pjx")


_VALUE = 'x="{0}" y="{1}" z="{2}" rx="{3}" ry="{4}" rz="{5}"'
LANGUAGE = Language(
    name="VAL3",
    endings=ENDINGS,
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(lambda listing: read(listing)[2], "VAL3"),
    maker=STAUBLI,
    robots=r"staubli|(^|_)(rx\d|tx2?_?\d)",
    write_moves=write_moves,
    motions=MOTIONS,
    moves_name_tools=True,
    declaration=FrameDeclaration(
        name=rf"{ANY_WORD[0]}\[0\]",
        names="are those of elements, such as tGrip[0]",
        head='<?xml version="1.0" encoding="utf-8" ?>\n<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xmlns="http://www.staubli.com/robotics/VAL3/Data/2">\n  <Datas>',
        tool='    <Data name="{base}" access="public" xsi:type="array" type="tool" size="1">\n'
        f'      <Value key="0" {_VALUE} fatherId="flange[0]" />\n    </Data>',
        work_object='    <Data name="{base}" access="public" xsi:type="array" type="frame" size="1">\n'
        f'      <Value key="0" {_VALUE} fatherId="world[0]" />\n    </Data>',
        foot="  </Datas>\n</Database>",
    ),
    sample=SampleArm(
        folder="staubli",
        joints=(
            ((0, 0, 0.5), "0 0 1"),
            ((0.14, 0, 0), "0 1 0"),
            ((0, 0, 0.8), "0 1 0"),
            ((0, 0, 0), "0 0 1"),
            ((0, 0, 0.6), "0 1 0"),
            ((0, 0, 0.1), "0 0 1"),
        ),
        base=0.5,
        stops=((10, 20, 80, 20, 40, 30), (-25, 10, 95, -15, 50, -40), (30, 30, 70, 10, 35, 60)),
        tried={"application": "--out staubli-job"},
    ),
)
