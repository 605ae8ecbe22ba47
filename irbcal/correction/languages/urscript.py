"""URScript: joint lists and poses in variables and inside moves.

A pose names no solution of the arm: that is the one next to ``qnear`` of ``get_inverse_kin``, else next to the stop
before. Poses are those of the TCP that ``set_tcp`` sets, in the link ``base`` of the URDF.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.backup import Backup, text_of, unzipped
from irbcal.correction.calls import Calls
from irbcal.correction.control_flow import ControlFlow, FrameState
from irbcal.correction.instructions import TO, VIA, MotionInstruction, built_in, teaching_routine
from irbcal.correction.language import ANY_WORD, FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.listing import BOM, Edit, Listing, Token, Tokens, between_commas, numbers
from irbcal.correction.loads import Load, load_of, unknown_load
from irbcal.correction.maker import FARTHEST_TOOL, Maker
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Note, Program, each_read, read_bytes
from irbcal.correction.targets import START, Role, Target
from irbcal.correction.text_program import PostureProgram
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG

UNIVERSAL_ROBOTS = Maker(
    name="URScript",
    orientation=notation.RotationVector(),
    length=1.0,
    angle=1.0,
    joint=1.0,
    decimals=(9, 9, 9),
    axes=(),
    matrix=np.eye(6),
    world=True,
)


@dataclass(frozen=True, eq=False, repr=False)
class ScriptProgram(PostureProgram):
    """A URScript program as read."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment line."""
        text = f"# irbcal: fake targets, calibration {fingerprint}{self.listing.newline()}"
        return at, at, text


TOKEN = re.compile(
    r"""(?P<space>[ \t\f\v]+)
    |(?P<comment>\#[^\r\n]*)
    |(?P<newline>\r\n|\n|\r|;)
    |(?P<string>"[^"\r\n]*"|'[^'\r\n]*')
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z_]))
    |(?P<name>[A-Za-z_\x80-\xff][\w\x80-\xff]*)
    |(?P<symbol>==|!=|<=|>=|[-+*/=<>()\[\]{},:.%&|^~?@!])
    |(?P<line>\$[^\r\n]*)
    |(?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)
_MOST = 10_000  # tokens of a statement


def statements(listing: Listing) -> tuple[list[list[Token]], list[str]]:
    """Statements, each to the end of its line or of its brackets, and the comments.

    Raises
    ------
    ProgramError
        If a string or a bracket is not closed.
    """
    out: list[list[Token]] = []
    comments: list[str] = []
    tokens: list[Token] = []
    depth = 0
    start = len(BOM) if listing.text.startswith(BOM) else 0
    for match in TOKEN.finditer(listing.text, start):
        kind = str(match.lastgroup)
        if kind == "comment":
            comments.append(match[0])
        elif kind == "newline":
            if tokens and (depth <= 0 or match[0] == ";"):
                out.append(tokens)
                tokens, depth = [], 0
        elif kind == "other" and match[0] in "\"'":
            raise listing.error(match.start(), "the string is not closed in its line")
        elif kind not in ("space", "line"):
            depth += (match[0] in "([") - (match[0] in ")]") if kind == "symbol" else 0
            tokens.append(Token(kind, match[0], match.start(), match.end()))
            if len(tokens) > _MOST:
                raise listing.error(tokens[0].start, "the brackets of this statement are not closed")
    if tokens:
        if depth > 0:
            raise listing.error(tokens[0].start, "the brackets of this statement are not closed")
        out.append(tokens)
    return out, comments


def arguments(tokens: Tokens) -> list[tuple[str, Tokens]]:
    """Arguments of a call whose tokens begin with ``(``, each with its name or an empty text; what follows is left."""
    out: list[tuple[str, Tokens]] = []
    for argument in between_commas(tokens[1:]):
        if len(argument) > 2 and argument[0].kind == "name" and argument[1].word == "=":
            out.append((argument[0].word, argument[2:]))
        elif argument:
            out.append(("", argument))
    return out


MOTIONS = built_in(
    """
    movej movel movep: to *
    movec: via to *
    """
)
OTHER_MOVES = ("servoj", "servoc", "servol", "speedj", "speedl", "movej_joint")
LOADS = ("set_payload", "set_target_payload", "set_payload_mass", "set_payload_cog")
"""Functions that say what the flange carries: kg and metres."""
LOUD = (
    *OTHER_MOVES,
    *("force_mode", "freedrive_mode", "end_freedrive_mode", "teach_mode", "end_teach_mode", "jog_start"),
    *("track_conveyor_linear", "track_conveyor_circular", "stop_conveyor_tracking", "path_offset_enable", "eval"),
    *("path_offset_set", "optimovej", "optimovel", "movexyz", "movearc", "screw_driving", "end_force_mode", "run"),
)
"""Functions of the controller's own that move the robot or let it be moved; its others do not."""
_DEF = re.compile(r"^[ \t]*def[ \t]+\w+[ \t]*\([^\r\n]*:", re.MULTILINE)
_NOTE = (
    "poses are made for the kinematics of the URDF that was calibrated: it must be the controller's own, with its "
    "factory calibration; otherwise give that with --controller-model"
)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like URScript."""
    return (
        re.search(rb"\b(?:movej|movel|movep|movec|set_tcp|get_inverse_kin)[ \t]*\(", data) is not None
        and b"%%%" not in data
    )


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read URScript for an arm, each file a program; see `irbcal.correction.languages.Language`."""
    programs, unread = each_read(files, lambda file: parse(arm, read_bytes(file), str(file), setup))
    return [*programs, *unread]


def parse(arm: Arm, data: bytes, source: str, setup: ControllerSetup) -> ScriptProgram:
    """Read a script.

    Raises
    ------
    ProgramError
        If this is none, or the TCP is not known.
    """
    listing = Listing([(source, data)], "URScript")
    lines, comments = statements(listing)
    script = _Script(listing, setup.instructions.get("urscript", {}))
    for statement in lines:
        script.declare(statement)
    for statement in lines:
        script.take(statement)
    script.conclude()
    targets = sorted([*script.variables.values(), *script.literals], key=lambda target: target.start)
    head = _DEF.search(listing.text)
    poses = any(target.kind == "pose" and target.uses for target in targets)
    return ScriptProgram.assembled(
        UNIVERSAL_ROBOTS,
        arm,
        script.flow,
        targets,
        setup,
        script.tools,
        script.frames,
        notes=(Note(1, _NOTE),) if poses and setup.controller_arm is None else (),
        comments=comments,
        mark_at=listing.after_line(head.start()) if head else len(BOM) * listing.text.startswith(BOM),
    )


class _Script:
    """Follows the statements."""

    def __init__(self, listing: Listing, taught: Mapping[str, MotionInstruction]) -> None:
        self.listing, self.goals = listing, {**MOTIONS, **{move.name: move for move in taught.values()}}
        self.flow = ControlFlow(listing, Calls(closed=True))
        self.flow.frame("base")
        self._inside: list[str] = []
        self.variables: dict[str, Target] = {}
        self.literals: list[Target] = []
        self.tools: dict[str, FloatArray] = {}
        self.frames = {"base": frames.transform()}
        self._framed: dict[str, int] = {}
        self._changed: dict[str, int] = {}
        self._mentioned: list[Token] = []
        self._set_tcp = 0
        self._ends: list[tuple[str, FrameState]] = []
        self._begun = False

    def declare(self, tokens: list[Token]) -> None:
        """Note variables and everything that gives them another value."""
        self._set_tcp += sum(token.word == "set_tcp" for token in tokens)
        self._learn(tokens)
        name, value = _assignment(tokens)
        if name is None:
            return
        target = None if value is None else self._literal(value, name.word)
        if target is None or name.word in self.variables or name.word in self._changed:
            self._changed.setdefault(name.word, name.start)
        else:
            self.variables[name.word] = target

    def _learn(self, tokens: list[Token]) -> None:
        """Note what a statement says of the function in which it stands."""
        first = tokens[0].word
        if first in ("def", "thread", "if", "while", "for"):
            self._inside.append(tokens[1].word if first in ("def", "thread") and tokens[1:] else "")
        elif first == "end":
            del self._inside[-1:]
        identifiers = {token.word for token in tokens}
        for routine in filter(None, self._inside):
            moves = not identifiers.isdisjoint((*self.goals, *LOUD))
            called = [] if first in ("def", "thread") else identifiers - self.goals.keys()
            self.flow.calls.learn(routine, called, "set_tcp" in identifiers, moves, not identifiers.isdisjoint(LOADS))

    def take(self, tokens: list[Token]) -> None:
        """Take one statement."""
        first = tokens[0].word
        name, value = _assignment(tokens)
        if name is not None:
            if value is None or self._literal(value, "") is None:
                self._mentioned += [token for token in tokens if token.kind == "name" and token is not name]
                self._calls(tokens)
                if any(token.word in OTHER_MOVES or token.word in self.goals for token in tokens):
                    self.flow.stop(None, name.start)
        elif first in self.goals and tokens[1:2] and tokens[1].word == "(":
            self._move(tokens)
        elif first == "set_tcp" and tokens[1:2] and tokens[1].word == "(":
            self._tcp(tokens)
        elif first in LOADS and tokens[1:2] and tokens[1].word == "(":
            self.flow.carry(self._load(tokens), tokens[0].start)
        else:
            self._other(tokens)

    def _other(self, tokens: list[Token]) -> None:
        first, at = tokens[0].word, tokens[0].start
        words_of_line = [token.word for token in tokens]
        inside = next((word for word in words_of_line if word in (*MOTIONS, *OTHER_MOVES)), None)
        if words_of_line[1:2] == ["("]:
            points = [self._pose(value) is not None for _, value in arguments(tokens[1:])]
            self.flow.teaching[self.listing.line(at)] = teaching_routine("urscript", first, points)
        self._mentioned += [token for token in tokens if token.kind == "name"]
        if first not in ("def", "thread"):
            self._calls(tokens)
        if first == "return":
            self.flow.loads.returns()
        if first in ("def", "thread"):
            self.flow.loads.begin(tokens[1].word.lower() if tokens[1:] else "")
            self._ends.append((first, self.flow.state))
            if self._set_tcp != 1 and len(self._ends) > 1:
                self.flow.state = FrameState(frame="base")
            if len(self._ends) > 1 or self.flow.stops:  # the program begins in its first function
                self.flow.forget()
        elif first in ("if", "while", "for"):
            self._ends.append((first, self.flow.state))
            self.flow.open(first != "if")
        elif first in ("elif", "else"):
            self.flow.alternative()
        elif first == "end" and self._ends:
            kind, state = self._ends.pop()
            if kind in ("def", "thread"):
                self.flow.loads.end()
                self.flow.state = state if self._set_tcp != 1 else self.flow.state
                self.flow.forget()
                if len(self._ends) == 1 and not self._begun:  # functions stand before the program's own statements
                    self.flow.previous = START
            else:
                self.flow.close(at)
        if inside is not None:
            text = self.listing.quote(at, tokens[-1].end)
            self.flow.leave(at, inside, text, "its target is computed while the program runs")
            self.flow.stop(None, at)

    def _calls(self, tokens: Tokens) -> None:
        """What the functions that a statement calls do to the TCP, and to where the arm stands."""
        for called, behind in pairwise(tokens):
            effect = self.flow.calls.effect(called.word)
            if behind.word != "(" or called.kind != "name":
                continue
            self.flow.load_call(called.word, called.start)
            if effect.moves or called.word in LOUD:
                self._begun |= len(self._ends) < 2
                self.flow.forget()
            if effect.sets_frames and self._set_tcp > 1:
                line = self.listing.line(called.start)
                self.flow.tool(None, f"{called.word}, called in line {line}, may set the TCP")

    def _tcp(self, tokens: list[Token]) -> None:
        """``set_tcp``."""
        setup = arguments(tokens[1:])
        line = self.listing.line(tokens[0].start)
        target = self._pose(setup[0][1]) if setup else None
        if target is None:
            self.flow.tool(None, f"the TCP of line {line} is computed")
            return
        written = [number.value for number in target.numbers]
        if UNIVERSAL_ROBOTS.seem_millimetres(written[:3], FARTHEST_TOOL):
            self.flow.tool(None, f"the TCP of line {line} is in millimetres: URScript has metres")
            return
        name = f"of line {line}"
        self.tools[name] = UNIVERSAL_ROBOTS.frame(written)
        self.flow.tool(name)

    def _load(self, tokens: list[Token]) -> Load:
        """Mass and centre of ``set_payload`` and ``set_target_payload``."""
        mass = centre = None
        for k, (name, value) in enumerate(arguments(tokens[1:])):
            if name == "m" or (not name and k == 0):
                mass = float(value[0].word) if len(value) == 1 and value[0].kind == "number" else None
            elif name == "cog" or (not name and k == 1):
                centre = numbers(value)
        if mass is None or tokens[0].word == "set_payload_cog":
            return unknown_load(f"the load of line {self.listing.line(tokens[0].start)} is computed")
        return load_of(mass, None if centre is None or len(centre) != 3 else [number.value for number in centre])

    def _pose(self, tokens: Tokens) -> Target | None:
        """A pose, or one in a variable that does not change."""
        if len(tokens) == 1 and tokens[0].kind == "name":
            return None if tokens[0].word in self._changed else self.variables.get(tokens[0].word)
        return self._literal(tokens, "")

    def _literal(self, tokens: Tokens, name: str) -> Target | None:
        """A pose ``p[…]`` or six joints ``[…]`` in numbers."""
        pose = bool(tokens) and tokens[0].word == "p"
        values = numbers(tokens[1:] if pose else tokens)
        if values is None or len(values) != 6:
            return None
        return Target(name, "pose" if pose else "joint", tokens[0].start, values)

    def _move(self, tokens: list[Token]) -> None:
        """Points of a move."""
        move, at = tokens[0].word, tokens[0].start
        setup = arguments(tokens[1:])
        instruction = self.goals[move]
        words = [word for word in instruction.required if word in (VIA, TO)]
        named = ("q", "pose", "pose_to", "pose_via")
        if instruction.taught:
            of_call = instruction.roles(len(setup), False) or ()
            points = [value for (_, value), word in zip(setup, of_call, strict=False) if word in (VIA, TO)]
        else:
            points = [value for key, value in setup if not key or key in named][: len(words)]
        stop: Target | None = None
        roles: list[Role] = ["via" if word == VIA else "to" for word in words]
        if len(points) < len(words):
            self.flow.leave(at, move, self.listing.quote(at, tokens[-1].end), "its target is missing")
        self._begun |= len(self._ends) < 2
        for role, point in zip(roles, points, strict=False):
            stop = self._goal(move, at, point, role)
        self.flow.stop(stop, at)
        in_points = {id(token) for point in points for token in point}
        self._mentioned += [token for token in tokens[1:] if token.kind == "name" and id(token) not in in_points]

    def _goal(self, move: str, at: int, point: Tokens, role: Role) -> Target | None:
        near: FloatArray | None = None
        text = self.listing.quote(point[0].start, point[-1].end)
        goal = point
        if point[0].word == "get_inverse_kin" and point[1:2] and point[1].word == "(":
            setup = arguments(point[1:])
            names = [key for key, _ in setup]
            seed = next((value for key, value in setup[1:] if key in ("", "qnear")), None)
            if not setup or len(setup) > 2 or names[0] not in ("", "x") or (len(setup) == 2 and seed is None):
                self._mentioned += [token for token in point if token.kind == "name"]
                self.flow.leave(at, move, text, "its target is computed")
                return None
            goal = setup[0][1]
            near = self._joints(seed) if seed is not None else None
        elif len(point) > 1 and point[0].kind == "name" and point[0].word not in ("p", "pose_trans"):
            self._mentioned += [token for token in point if token.kind == "name"]
        state = self.flow.state
        if goal[0].word == "pose_trans" and goal[1:2] and goal[1].word == "(":
            in_frame = [value for key, value in arguments(goal[1:]) if not key]
            frame = self._frame(in_frame[0]) if len(in_frame) == 2 else None
            if frame is not None:
                goal, state = in_frame[1], replace(state, frame=frame)
        target = self._target(goal, f"{move} in line {self.listing.line(at)}")
        if target is None or (state.frame != "base" and target.kind == "joint"):
            name = goal[0].word if len(goal) == 1 else ""
            changed = self._changed.get(name)
            where = f"{name} is computed or changed in line {self.listing.line(changed)}" if changed is not None else ""
            self.flow.leave(at, move, text, where or "its target is computed")
            return None
        if near is not None:
            if target.near is not None and np.abs(target.near - near).max() > 0.5:
                target.conflicts.append("its moves start from different joints (qnear)")
            target.near = near
        self.flow.use(target, at, move, role, state, (False, True))
        return target

    def _frame(self, tokens: Tokens) -> str | None:
        """Name of a frame in the base: a pose in numbers, or in a variable that does not change; None for others."""
        target = self._pose(tokens)
        if target is None or target.kind != "pose":
            return None
        at = tokens[0].start
        if len(tokens) == 1:
            self._framed[tokens[0].word] = at
            name = tokens[0].word.lower()
        else:
            name = f"of line {self.listing.line(at)}, column {self.listing.column(at)}"
        self.frames[name] = UNIVERSAL_ROBOTS.frame([number.value for number in target.numbers])
        return name

    def _target(self, tokens: Tokens, name: str) -> Target | None:
        if len(tokens) == 1 and tokens[0].kind == "name":
            return self.variables.get(tokens[0].word)
        target = self._literal(tokens, name)
        if target is not None:
            self.literals.append(target)
        return target

    def _joints(self, tokens: Tokens) -> FloatArray | None:
        """Joints in radians, or those of a variable."""
        target = self._pose(tokens)
        if target is None or target.kind != "joint" or target.conflicts:
            return None
        return np.array([number.value for number in target.numbers])

    def conclude(self) -> None:
        """Tell the targets of other uses and other values of their variables."""
        for name, at in self._changed.items():
            if name in self.variables:
                line = self.listing.line(at)
                self.variables[name].conflicts.append(f"{name} is computed or changed in line {line}")
        for name, at in self._framed.items():
            if self.variables[name].uses:
                self.flow.mention(self.variables[name], at)
        for token in self._mentioned:
            if token.word in self.variables:
                self.flow.mention(self.variables[token.word], token.start)


def _assignment(tokens: Tokens) -> tuple[Token | None, Tokens | None]:
    """Name and value of an assignment; no value for that of an element."""
    statement = tokens[1:] if tokens[0].word in ("global", "local") else tokens
    if len(statement) < 2 or statement[0].kind != "name":
        return None, None
    if statement[1].word == "=":
        return statement[0], statement[2:]
    if statement[1].word == "[":
        depth = 0
        for k, token in enumerate(statement[1:], start=1):
            depth += (token.word == "[") - (token.word == "]")
            if depth == 0:
                return (
                    (statement[0], None) if statement[k + 1 : k + 2] and statement[k + 1].word == "=" else (None, None)
                )
    return None, None


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.script``: ``movej`` to joints in radians."""
    lines = ["def plan():", *(f"  # {note(text)}" for text in moves.head)]
    radians = np.round(moves.degrees(UNIVERSAL_ROBOTS) * DEG, 9) + 0.0
    for move, joints in zip(moves.moves, radians, strict=True):
        lines += [f"  # {note(move.comment)}"] if move.comment else []
        lines.append(f"  movej([{', '.join(f'{value:.9f}' for value in joints)}], a=1.0, v={move.joint_speed:.3f})")
        lines += [f"  sleep({move.wait_s:.1f})"] if move.wait_s else []
    return {"plan.script": "\n".join([*lines, "end", ""])}


_LINEARIZED = re.compile(rb"<Kinematics\b[^<>]*\bstatus=\"LINEARIZED\"")
_STATUS = re.compile(r"^[ \t]*calibration_status[ \t]*=[ \t]*2\b", re.M)


def backup(files: Sequence[Path]) -> Backup:
    """Whether the factory calibration stands in ``calibration.conf`` or in the waypoints of ``.urp`` programs."""
    for folder in dict.fromkeys(file.parent for file in files):
        for path in sorted(folder.glob("*")):
            if path.name.lower() == "calibration.conf" and _STATUS.search(text_of(path)):
                return Backup(accuracy=f"the controller has the robot's factory calibration ({path.name})")
            if path.suffix.lower() == ".urp" and _LINEARIZED.search(unzipped(path)):
                return Backup(accuracy=f"the controller has the robot's factory calibration (waypoints of {path.name})")
    return Backup()


LANGUAGE = Language(
    name="URScript",
    endings=(".script", ".urscript"),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(lambda listing: statements(listing)[1], "URScript"),
    maker=UNIVERSAL_ROBOTS,
    robots=r"universal_?robot|(^|_)ur\d+e?(_|$)",
    write_moves=write_moves,
    motions=MOTIONS,
    backup=backup,
    declaration=FrameDeclaration(
        *ANY_WORD,
        head="# Tools are set as TCP where the program uses them, frames are for pose_trans",
        tool="set_tcp(p[{0},{1},{2},{3},{4},{5}])  # {name}",
        work_object="{name} = p[{0},{1},{2},{3},{4},{5}]",
    ),
    sample=SampleArm(
        folder="universal",
        stops=((10, -80, 100, -110, -90, 30), (-25, -95, 110, -100, -80, -40), (30, -70, 80, -90, -100, 60)),
        tool=(0, 0, 0.15, 0, 0, 0),
        tried={"job.script": "--out ur-job.script --tool active=0,0,0.15,0,0,0"},
        robot_name="ur10",
    ),
    without_text={".urp": (".script", "a compressed PolyScope program: export it as .script")},
)
