"""KUKA KRL programs: a routine's ``.src`` with the ``.dat`` of the same name, and ``$config.dat`` where it is given.

Targets are values in numbers of ``E6POS``, ``POS``, ``E6AXIS``, ``AXIS`` and ``FRAME``, in declarations, in assignments
and inside moves. Where a component is missing the value before stays, so that such a target has no pose of its own.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.backup import Backup, folders_named, placed, text_of
from irbcal.correction.calls import Calls
from irbcal.correction.control_flow import ControlFlow, FrameState
from irbcal.correction.instructions import POINTS, VIA, WRITES, MotionInstruction, built_in, teaching_routine
from irbcal.correction.language import TO_99, FrameDeclaration, Language, SampleArm
from irbcal.correction.listing import BOM, Edit, Listing, Number, Span, Token, mark_in
from irbcal.correction.loads import Load, Ways, load_of, unknown_load
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Note, Program, each_read, read_bytes
from irbcal.correction.targets import Configuration, Role, Shift, Target
from irbcal.correction.text_program import CARRIED, PostureProgram
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

KUKA = Maker(
    name="KRL",
    orientation=notation.Angles(("A", "B", "C"), "zyx"),
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(6, 6, 6),
    axes=("-z", "+y", "+y", "-x", "+y", "-x"),
    matrix=np.eye(6),
    reference=(0.0, -90.0, 90.0, 0.0, 0.0, 0.0),
)
"""The reference stands upright with the forearm forward, S = 2: its elbow bit is set."""

_STATUS = 7


def integer(text: str) -> int | None:
    """Value of S or T: a whole number, or bits or hexadecimal digits in quotes; None for anything else."""
    text = text.strip()
    if re.fullmatch(r"\d{1,9}", text):
        return int(text)
    bits = re.fullmatch(r"'B([01]{1,32})'", text, re.IGNORECASE)
    if bits:
        return int(bits[1], 2)
    digits = re.fullmatch(r"'H([0-9A-F]{1,8})'", text, re.IGNORECASE)
    return int(digits[1], 16) if digits else None


def like(old: str, value: int) -> str:
    """A whole number in the form of another one."""
    if old[:2].upper() == "'B":
        return f"{old[:2]}{value:0{len(old) - 3}b}'"
    if old[:2].upper() == "'H":
        return f"{old[:2]}{value:0{len(old) - 3}X}'"
    return str(value)


def posture_of(status: int, turn: int) -> Posture:
    """What S and T mean; bits 3 and above of S say nothing of joints."""
    negative = [bool(turn >> k & 1) for k in range(6)]
    low = tuple(-np.inf if minus else 0.0 for minus in negative)
    high = tuple(0.0 if minus else np.inf for minus in negative)
    return Posture(bool(status & 1), not status & 2, -1 if negative[4] else 1, low, high)


@dataclass(frozen=True, eq=False, repr=False)
class KrlProgram(PostureProgram):
    """A KRL program as read."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment line."""
        newline = self.listing.newline(self.listing.file_at(at))
        return at, at, f"; irbcal: fake targets, calibration {fingerprint}{newline}"

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """S and T of joints."""
        turn = sum(1 << k for k in range(6) if joints[k] < 0)
        return posture_of(int(back) | (0 if bent else 2), turn)

    def configuration_edits(self, target: Target, configuration: Configuration) -> list[Edit]:
        """New text of S and T; upper bits of S stay."""
        assert isinstance(configuration, Posture)
        out: list[Edit] = []
        for k, (start, end) in enumerate(target.configuration_spans):
            old = self.text[start:end]
            value = integer(old) or 0
            if k == 0:
                wrist = 4 if (configuration.wrist or 0) < 0 else 0
                new = (value & ~_STATUS) | (1 if configuration.rear else 0) | (0 if configuration.bent else 2) | wrist
            else:
                new = (value & ~0b111111) | sum(1 << i for i in range(6) if configuration.high[i] == 0.0)
            if new != value:
                out.append((start, end, like(old, new)))
        return out

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """Components in braces in the move."""
        assert target.split is not None
        components = [
            f"{name.upper()} {text}" for name, text in zip(POSE, self.split_texts(target, numbers), strict=True)
        ]
        components += [
            f"{name} {text}" for name, text in zip("ST", self.split_configuration(target, configuration), strict=False)
        ]
        components += [f"{name.upper()} {value!r}" for name, value in sorted(target.e.items())]
        return [(*target.split.span, "{" + ",".join(components) + "}")]


TOKEN = re.compile(
    r"""(?P<space>[ \t\f\v]+)
    |(?P<comment>;[^\r\n]*)
    |(?P<newline>\r\n|\n|\r)
    |(?P<string>"[^"\r\n]*")
    |(?P<bits>'[^'\r\n]*')
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z_$]))
    |(?P<name>[$\#]?[A-Za-z_$\x80-\xff][\w$\x80-\xff]*)
    |(?P<symbol>==|<>|<=|>=|[-+*/=<>()\[\]{},:.&@?])
    |(?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)


END = Token("end", "", 0, 0)


class TokenLine:
    """The tokens of a line and a place among them.

    Attributes
    ----------
    tokens : list of Token
    file : int
        Number of the file.
    at : int
        The token that comes next.
    """

    def __init__(self, tokens: list[Token], file: int) -> None:
        self.tokens, self.file, self.at = tokens, file, 0

    @property
    def next(self) -> Token:
        """The token that comes next; `END` behind the last."""
        return self.tokens[self.at] if self.at < len(self.tokens) else END

    def word(self, ahead: int = 0) -> str:
        """Text of a token that comes; empty behind the last."""
        k = self.at + ahead
        return self.tokens[k].word if 0 <= k < len(self.tokens) else ""

    def take(self, *spellings: str) -> bool:
        """Whether the next token is one of these words; it is taken then."""
        if self.word() in spellings and self.next is not END:
            self.at += 1
            return True
        return False

    @property
    def start(self) -> int:
        """Where the line's first token stands."""
        return self.tokens[0].start

    @property
    def end(self) -> int:
        """Behind its last token."""
        return self.tokens[-1].end

    def number(self) -> Number | None:
        """A number with its sign, taken; None where there is none."""
        k = self.at
        minus = 0
        while self.word() in ("-", "+"):
            minus += self.word() == "-"
            self.at += 1
        token = self.next
        if token.kind != "number" or self.at - k > 1:
            self.at = k
            return None
        self.at += 1
        start = self.tokens[k].start
        return Number(-float(token.word) if minus else float(token.word), start, token.end)

    def index(self) -> tuple[int, ...] | None:
        """A whole index in brackets, taken, empty where there is none; None where it is computed (and taken, too)."""
        if not self.take("["):
            return ()
        out: list[int] = []
        good = True
        depth = 1
        while depth and self.next is not END:
            token = self.next
            self.at += 1
            depth += (token.word == "[") - (token.word == "]")
            if token.kind == "number" and token.word.isdecimal() and len(token.word) < 9:
                out.append(int(token.word))
            elif token.word not in ("]", ","):
                good = False
        return tuple(out) if good and out else None


def lines_of(listing: Listing) -> tuple[list[TokenLine], list[str]]:
    """Lines with their tokens, without comments, and the comments.

    Raises
    ------
    ProgramError
        If a string is not closed in its line.
    """
    lines: list[TokenLine] = []
    comments: list[str] = []
    for number, file in enumerate(listing.files):
        tokens: list[Token] = []
        start = file.start + (len(BOM) if listing.text.startswith(BOM, file.start, file.end) else 0)
        for match in TOKEN.finditer(listing.text, start, file.end):
            kind = str(match.lastgroup)
            if kind == "newline":
                if tokens:
                    lines.append(TokenLine(tokens, number))
                tokens = []
            elif kind == "comment":
                comments.append(match[0])
            elif kind == "other" and match[0] in "\"'":
                raise listing.error(match.start(), "the string is not closed in its line")
            elif kind != "space":
                tokens.append(Token(kind, match[0].lower(), match.start(), match.end()))
        if tokens:
            lines.append(TokenLine(tokens, number))
    return lines, comments


def names_in(tokens: Sequence[Token]) -> list[Token]:
    """The names among tokens."""
    return [token for token in tokens if token.kind == "name"]


TYPES = ("pos", "e6pos", "axis", "e6axis", "frame", "fdat")
POSE, JOINTS = ("x", "y", "z", "a", "b", "c"), ("a1", "a2", "a3", "a4", "a5", "a6")
DECLARING = ("decl", "global", "const", "public")
PLAIN = ("int", "real", "bool", "char", "signal", "struc", "enum", "ext", "extfct", "import", "load", "trigger_para")

ArrayIndex: TypeAlias = tuple[int, ...]
VariableKey: TypeAlias = tuple[str, str]
"""File of the module (a stem in lower case, empty for global data) and name."""
PointedTargets: TypeAlias = tuple[list[Target], str, str]
"""Targets that an argument stands for, its text, and why they are not all or not to be changed."""


class Value(NamedTuple):
    """A component of an aggregate: its number (or None) and where its text stands."""

    number: Number | None
    text: str
    start: int
    end: int


class Aggregate(NamedTuple):
    """Components in braces, by their names in lower case, and the type that the braces name."""

    type: str
    values: dict[str, Value]
    start: int
    end: int

    def frame(self) -> FloatArray | None:
        """The frame (4, 4) that X to C are, metres; None where these are not all there in numbers."""
        numbers = [self.values[key].number for key in POSE if key in self.values]
        plain = [number.value for number in numbers if number is not None]
        return KUKA.frame(plain) if len(plain) == len(POSE) else None


class Variable:
    """What a name stands for."""

    def __init__(self, spelling: str, type_name: str, file: int) -> None:
        self.spelling, self.type, self.file = spelling, type_name, file
        self.entries: list[tuple[ArrayIndex, Aggregate]] = []
        """Literal values and their indices."""
        self.changes: list[int] = []
        """Where it gets another value."""
        self.targets: dict[ArrayIndex, Target] = {}
        """Its targets."""


def aggregate(statement: TokenLine, listing: Listing) -> Aggregate | None:
    """Components in braces that begin with the next token, taken; None, and nothing taken, where there are none."""
    if statement.word() != "{":
        return None
    begin, start = statement.at, statement.next.start
    statement.at += 1
    name = ""
    if statement.next.kind == "name" and statement.word(1) == ":":
        name = statement.word()
        statement.at += 2
    values: dict[str, Value] = {}
    while statement.next is not END and statement.word() != "}":
        if statement.next.kind != "name":
            statement.at = begin
            return None
        key = statement.word()
        statement.at += 1
        statement.index()
        first = statement.next
        number = statement.number()
        last = statement.tokens[statement.at - 1]
        if statement.word() not in (",", "}"):
            number = None
            last = _skip(statement)
        values.setdefault(key, Value(number, listing.text[first.start : last.end], first.start, last.end))
        statement.take(",")
    if statement.next is END:
        statement.at = begin
        return None
    end = statement.next.end
    statement.at += 1
    return Aggregate(name, values, start, end)


def _skip(statement: TokenLine) -> Token:
    """The last token before the next comma or brace outside brackets; all up to it taken."""
    depth = 0
    last = statement.next
    while statement.next is not END and (depth or statement.word() not in (",", "}")):
        depth += (statement.word() in "([{") - (statement.word() in ")]}")
        last = statement.next
        statement.at += 1
    return last


def target(name: str, type_name: str, braces: Aggregate, listing: Listing) -> tuple[Target | None, str]:
    """The target that an aggregate is, or why it is none."""
    kind = type_name or braces.type
    joint = kind in ("axis", "e6axis") or (not kind and "a1" in braces.values)
    names = JOINTS if joint else POSE
    missing = [key.upper() for key in names if key not in braces.values]
    if missing:
        return None, f"it has no {missing[0]}, so that the value before stays"
    numbers = [braces.values[key].number for key in names]
    plain = [number for number in numbers if number is not None]
    if len(plain) < 6:
        return None, "some of its numbers are computed"
    parsed = Target(name, "joint" if joint else "pose", braces.start, plain)
    external = {key: value for key, value in braces.values.items() if key[0] == "e" and key[1:].isdecimal()}
    parsed.external = ", ".join(value.text for value in external.values() if re.search(r"[1-9]", value.text))
    parsed.e = {key: value.number.value for key, value in external.items() if value.number is not None}
    if not joint and "s" in braces.values and "t" in braces.values:
        status, turn = integer(braces.values["s"].text), integer(braces.values["t"].text)
        if status is None or turn is None:
            parsed.conflicts.append("its S or T is no number")
        else:
            parsed.configuration = posture = posture_of(status, turn)
            if posture.wrist != (-1 if status & 4 else 1):
                parsed.conflicts.append("its S and T contradict one another about the sign of A5")
            parsed.configuration_spans = tuple((braces.values[key].start, braces.values[key].end) for key in ("s", "t"))
    return parsed, ""


class KrlData:
    """All variables of a program."""

    def __init__(self, listing: Listing, stems: list[str]) -> None:
        self.listing, self.stems = listing, stems
        self.variables: dict[VariableKey, Variable] = {}

    def lookup(self, file: int, name: str) -> Variable | None:
        """The variable that a name stands for in a file."""
        return self.variables.get((self.stems[file], name)) or self.variables.get(("", name))

    def system(self, file: int) -> bool:
        """Whether a file is one of the controller's own, such as ``$config.dat``."""
        return Path(self.stems[file]).name.startswith("$")

    def declaration(self, statement: TokenLine) -> bool:
        """Take a declaration; whether the line is one."""
        begin = statement.at
        public = False
        while statement.word() in DECLARING:
            public |= statement.word() in ("global", "public")
            statement.at += 1
        kind = statement.word()
        typed = (
            statement.next.kind == "name"
            and (statement.tokens[statement.at + 1 : statement.at + 2] or [END])[0].kind == "name"
        )
        if not typed or (kind not in TYPES and statement.at == begin and kind not in PLAIN) or kind in ROUTINE:
            statement.at = begin
            return False
        statement.at += 1
        shared = public or self.system(statement.file)
        while statement.next.kind == "name":
            token = statement.next
            statement.at += 1
            spelling = self.listing.text[token.start : token.end]
            index = statement.index()
            variable = Variable(spelling, kind, statement.file)
            declared = self.variables.setdefault(("" if shared else self.stems[statement.file], token.word), variable)
            if declared is not variable:  # copies of a program in one folder: either may be meant
                declared.changes.append(token.start)
                variable = declared
            if statement.take("="):
                self.value(variable, () if index is None else index, statement)
            if not statement.take(","):
                break
        return True

    def value(self, variable: Variable, index: ArrayIndex | None, statement: TokenLine) -> None:
        """A value of a variable: components in numbers, or something else."""
        at = statement.next.start if statement.next is not END else statement.end
        braces = aggregate(statement, self.listing)
        if braces is None or index is None or statement.word() not in ("", ","):
            variable.changes.append(at)
        else:
            variable.entries.append((index, braces))

    def collect(self) -> None:
        """Make targets of all literal values."""
        for variable in self.variables.values():
            if variable.type not in ("pos", "e6pos", "axis", "e6axis", "frame"):
                continue
            for index, braces in variable.entries:
                inside = ",".join(str(k) for k in index)
                name = variable.spelling + (f"[{inside}]" if index else "")
                parsed, _ = target(name, variable.type, braces, self.listing)
                if parsed is not None and index in variable.targets:
                    variable.changes.append(braces.start)
                elif parsed is not None:
                    variable.targets[index] = parsed
                else:
                    variable.changes.append(braces.start)


MOTIONS = built_in(
    """
    PTP LIN: to
    CIRC: via to
    SPTP SLIN: to
    SCIRC: via to
    SPL: to
    """
)
RELATIVE = {name.lower(): name for name in ("PTP_REL", "LIN_REL", "CIRC_REL", "SPTP_REL", "SLIN_REL", "SCIRC_REL")}
OPEN = ("if", "switch", "spline", "ptp_spline")
LOOPS = ("for", "while", "repeat", "loop")
ALTERNATIVE = ("else", "case", "default")
CLOSE = ("endif", "endswitch", "endfor", "endwhile", "until", "endloop")
ROUTINE = ("def", "deffct", "defdat", "end", "endfct", "enddat")
_HOME = re.compile(r"xhome\d*|\$h_pos|\$axis_home")
"""Joint targets that stand in the controller's ``$config.dat`` and ``$machine.dat`` and serve all of its programs."""
NULLFRAME = "0"
_BUILT_IN = (
    "wait continue pulse halt brake return ini user_msg set_cd_params exit abs sqrt sin cos tan acos atan2 b_and "
    "b_or b_exor b_not inv_pos inverse forward varstate cast_from cast_to stradd strclear strcopy strcomp strlen "
    "strfind strdecllen strtoint strtoreal strtobool strtoframe strtopos inttostr swrite sread cwrite cread copen "
    "cclose cioctl fopen fclose set_krlmsg set_krldlg clear_krlmsg clear_krldlg exists_krlmsg exists_krldlg "
    "msgnotify msgquit msgdialog msgloop setinfo clear_kcpmsg on_error_proceed err_raise get_sig_inf "
    "get_decl_place getcyclicgetline timer_limit rob_timer delete_backward_buffer eb_test svel_joint svel_cp "
    "stool2 sbase sipo_mode sload sacc_joint sacc_cp sapo sapo_ptp sgear_jerk sjerk sori_typ use_cm_pro_values "
    "eki_init eki_open eki_close eki_send eki_clear eki_lock eki_unlock eki_checkbuffer eki_getint eki_getreal "
    "eki_getbool eki_getstring eki_getframe eki_getintarray eki_getrealarray eki_getboolarray"
)
BUILT_IN = frozenset(_BUILT_IN.split())
"""Instructions and functions of the controller's own that move nothing and leave tool and base."""
TAKES_FDAT = ("#frames", "#ptp_params", "#cp_params")
"""Commands of ``BAS`` that set tool and base from ``FDAT_ACT``."""
NO_FRAMES = (
    "#acc_cp",
    "#acc_glue",
    "#acc_ptp",
    "#vel_cp",
    "#vel_ptp",
    "#cp_dat",
    "#ptp_dat",
    "#group",
    "#out_sync",
    "#out_async",
)
"""Commands of ``BAS`` that leave tool and base."""
QUIET_BAS = [[command] for command in NO_FRAMES]
NUMBERED, ANY = ("tool_data", "base_data"), ""
SETS_FRAMES = ("$tool", "$base", "$ipo_mode", "fdat_act", *NUMBERED)
"""What a routine says that may set tool or base, beside commands of ``BAS``."""
NO_CALLS = (
    *OPEN,
    *LOOPS,
    *CLOSE,
    *ROUTINE,
    "bas",
    "and",
    "or",
    "not",
    "exor",
    "case",
    "when",
    "sec",
    "else",
    "to",
    "step",
)
"""What stands before a bracket and is no routine."""
EVENTS = ("trigger", "interrupt")
"""What calls routines at other times."""
FIXED_TOOL = "the tool is fixed and the part on the robot (#TCP)"


def _called(statement: TokenLine) -> list[Token]:
    """Routines that a line calls, the controller's own among them; triggers and interrupts call theirs at other times.

    A routine without arguments may be called without brackets.
    """
    tokens = statement.tokens
    if tokens[0].word in (*EVENTS, "global"):
        return []
    if len(tokens) == 1 and tokens[0].kind == "name":
        alone = tokens[0].word not in (*OPEN, *LOOPS, *CLOSE, *ALTERNATIVE, *ROUTINE, "endspline")
        return tokens if alone else []
    pairs = pairwise(tokens)
    return [word for word, behind in pairs if behind.word == "(" and word.kind == "name" and word.word not in NO_CALLS]


def _arguments(statement: TokenLine) -> list[TokenLine]:
    """Arguments of a call with which a line begins."""
    out: list[list[Token]] = [[]]
    depth = 0
    for token in statement.tokens[1:]:
        depth += (token.word in ("(", "[", "{")) - (token.word in (")", "]", "}"))
        if depth == 0:
            break
        if depth == 1 and token.word == ",":
            out.append([])
        elif depth > 1 or token.word != "(":
            out[-1].append(token)
    return [TokenLine(tokens, statement.file) for tokens in out if tokens]


def _routine(keywords: Sequence[str]) -> str:
    """Name of the routine that a line begins; empty for other lines."""
    begins = "def" in keywords[:2] or "deffct" in keywords[:3]
    return keywords[keywords.index("(") - 1] if begins and "(" in keywords else ""


_FOLD = re.compile(r"^[ \t]*;[ \t]*(?:(FOLD)|ENDFOLD)\b([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
_FORM = re.compile(r"\bTool\[\d+\].*\bBase\[\d+\].*%\{", re.IGNORECASE)


_LOAD_DATA = re.compile(
    r"^[ \t]*LOAD_DATA[ \t]*\[[ \t]*(\d+)[ \t]*\][ \t]*=[ \t]*([^\r\n;]*)", re.IGNORECASE | re.MULTILINE
)
_REAL = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)"
_MASS = re.compile(rf"\{{[^{{}}]*?\bM[ \t]+{_REAL}", re.IGNORECASE)
_CENTRE = re.compile(
    rf"\bCM[ \t]*\{{[^{{}}]*?\bX[ \t]+{_REAL}[ \t]*,[ \t]*Y[ \t]+{_REAL}[ \t]*,[ \t]*Z[ \t]+{_REAL}", re.IGNORECASE
)


def load(text: str) -> Load | None:
    """The load that an aggregate in numbers is, in the flange; None for M -1, which says nothing."""
    mass, centre = _MASS.search(text), _CENTRE.search(text)
    if mass is None:
        return unknown_load("its load is not in numbers")
    if float(mass[1]) < 0.0:
        return None
    return load_of(float(mass[1]), None if centre is None else [float(number) * MM for number in centre.groups()])


def inline_forms(listing: Listing) -> list[Span]:
    """Where the folds of inline forms are that name tool and base of their point.

    What the options of a controller (arc welding, glue, grippers) call in a form goes with its move, and the form shows
    and touches up its point with the tool and base that it names.
    """
    out: list[Span] = []
    opened: list[tuple[int, bool]] = []
    for fold in _FOLD.finditer(listing.text):
        if fold[1]:
            opened.append((fold.start(), _FORM.search(fold[2]) is not None))
        elif opened:
            start, form = opened.pop()
            out += [(start, fold.end())] if form and listing.file_at(start) == listing.file_at(fold.start()) else []
    return sorted(out)


class Statements:
    """Follows the lines of routines.

    Parameters
    ----------
    listing : Listing
    data : KrlData
        With its targets collected.
    harmless : sequence of str
        Patterns of names of routines that neither move the arm nor set tool or base.
    split_points : bool
        Whether shifted targets become targets of their own.
    taught : dict of str to MotionInstruction
        Routines that move to one of their arguments.
    """

    def __init__(
        self,
        listing: Listing,
        data: KrlData,
        harmless: Sequence[str] = (),
        split_points: bool = False,
        taught: Mapping[str, MotionInstruction] = MappingProxyType({}),
    ) -> None:
        self.listing, self.data, self.taught = listing, data, taught
        self.flow = ControlFlow(listing, Calls(harmless, BUILT_IN), split_points=split_points)
        self._forms = inline_forms(listing)
        self._called_in_form: tuple[Span, str, Ways] | None = None
        self._loads: dict[str, Load | None] = {}
        for assignment in _LOAD_DATA.finditer(listing.text):
            value = load(assignment[2])
            if self._loads.setdefault(assignment[1], value) != value:
                self._loads[assignment[1]] = unknown_load(
                    f"line {listing.line(assignment.start())} changes LOAD_DATA[{assignment[1]}]"
                )
        self.flow.first_begins = True
        self.literals: list[Target] = []
        """Targets inside moves."""
        self.tools: dict[str, FloatArray] = {}
        self.frames: dict[str, FloatArray] = {}
        """Values of shape (4, 4). Of the names that the program gives values to."""
        self.notes: list[tuple[int, str]] = []
        self._fdat: FrameState | None = None
        self._fdat_taken, self._fdat_at = True, -1
        self._before_spline = FrameState()
        self._changed: dict[tuple[str, str], int] = {}
        self._mentioned: list[tuple[Token, int]] = []

    def follow(self, lines: Iterable[TokenLine]) -> None:
        """Learn which routines set tool or base, which move, and what they call."""
        name = ""
        for statement in lines:
            keywords = [token.word for token in statement.tokens]
            if "def" in keywords[:2] or "deffct" in keywords[:3]:
                name = _routine(keywords)
                self.flow.calls.learn(name)
            else:
                sets = not {*keywords}.isdisjoint(SETS_FRAMES) or (
                    keywords[:1] == ["bas"] and keywords[2:3] not in QUIET_BAS
                )
                moves = keywords[0] in MOTIONS or keywords[0] in RELATIVE or keywords[0] in self.taught
                called = [token.word for token in _called(statement) if token.word not in self.taught]
                self.flow.calls.learn(
                    name, called, sets, moves, "$load" in keywords or (sets and any(self._loads.values()))
                )

    def _call(self, routine: Token) -> None:
        """A routine is called. In an inline form tool and base are those of the form until it ends."""
        form = self._form_of(routine.start)
        state, carried = self.flow.state, self.flow.loads.now
        self.flow.call(routine.word, self.listing.text[routine.start : routine.end], routine.start)
        if self.flow.state is state:
            return
        if form is not None and self._fdat_taken and self._fdat_at > form[0]:
            self._called_in_form = self._called_in_form or (form, self.flow.state.reason, self.flow.loads.now)
            self.flow.state, self.flow.loads.now = state, carried
        else:
            self._forget_fdat()

    def _form_of(self, at: int) -> Span | None:
        """The inline form in which a place lies."""
        k = bisect.bisect_right(self._forms, (at, len(self.listing.text))) - 1
        start, end = self._forms[k] if k >= 0 else (0, 0)
        return (start, end) if start <= at < end else None

    def statement(self, statement: TokenLine) -> None:
        """Take one line."""
        statement.take("global")
        word = statement.word()
        if self._called_in_form is not None and statement.start >= self._called_in_form[0][1]:
            self.flow.state = FrameState(None, None, self._called_in_form[1])
            self.flow.loads.now = self._called_in_form[2]
            self._forget_fdat()
            self._called_in_form = None
        if word in self.taught and statement.word(1) == "(":
            self._taught_move(statement, self.taught[word])
            return
        if word not in ROUTINE:
            for routine in _called(statement):
                self._call(routine)
        if word in EVENTS:
            for routine, bracket in pairwise(statement.tokens):
                if bracket.word == "(":
                    self.flow.call_any_time(routine.word)
        if word in MOTIONS:
            self._move(statement, MOTIONS[word])
        elif word in ("lin_rel", "slin_rel") and self._relative(statement, RELATIVE[word]):
            pass
        elif word in RELATIVE:
            self.flow.leave(statement.start, RELATIVE[word], self._rest(statement, 1), "its target is relative")
            self.flow.stop(None, statement.start)
            self._mention(statement.tokens[1:], statement.file)
        elif word in ROUTINE:
            self.flow.restart(_routine([token.word for token in statement.tokens]))
            self._forget_fdat()
        elif word in (*OPEN, *LOOPS):
            self._mention(statement.tokens, statement.file)
            if word in ("spline", "ptp_spline"):
                self._before_spline = self.flow.state
                self._with(statement, self.flow.state, lasting=True)
            else:
                self.flow.open(word in LOOPS)
                self._forget_fdat()
        elif word in ALTERNATIVE:
            self.flow.alternative()
            self._forget_fdat()
        elif word in CLOSE:
            self.flow.close(statement.start)
            self._forget_fdat()
        elif word == "endspline":
            if self.flow.state != self._before_spline:
                reason = (
                    f"the spline block that ends in line {self.listing.line(statement.start)} has its own tool or base"
                )
                self.flow.state = FrameState(None, None, reason)
        elif word == "interrupt" and not self.flow.stops:  # declared and switched on before anything moves
            self._mention(statement.tokens, statement.file)
        elif statement.word(1) == ":" and len(statement.tokens) == 2:
            self.flow.label(statement.start)
            self._forget_fdat()
        elif word in ("goto", "interrupt", "return", "halt"):
            self.flow.forget()
            if word in ("return", "halt"):
                self.flow.loads.returns()
            elif word != "interrupt":
                self.flow.loads.label()
        elif word == "bas" and statement.word(1) == "(":
            self._bas(statement)
        else:
            self._assignment(statement)

    def _bas(self, statement: TokenLine) -> None:
        """What ``BAS`` does to tool and base, as KUKA's bas.src has it.

        ``#FRAMES``, ``#PTP_PARAMS`` and ``#CP_PARAMS`` set both from ``FDAT_ACT``; ``#INITMOV`` sets both to what the
        version of the controller says, so that they count as those before the first of the program.
        """
        command, n = statement.word(2), statement.word(4)
        plain = n if n.isdecimal() and statement.word(5) == ")" else None
        where = self.listing.line(statement.start)
        computed = f"BAS in line {where} computes the tool or base"
        if command == "#tool":
            self.flow.tool(plain, computed)
            self._carry_tool(plain, statement.start)
        elif command == "#base":
            self.flow.frame(plain, computed)
        elif command == "#ex_base":
            name = None if plain is None else f"{CARRIED}{plain}"
            self.flow.frame(name, f"BAS in line {where} ties the base to an external axis")
        elif command in TAKES_FDAT:
            reason = f"BAS({command.upper()}) in line {where} takes tool and base from FDAT_ACT, which is not set"
            self.flow.state = self._fdat or FrameState(None, None, reason)
            self._fdat_taken = True
            self._carry_tool(self.flow.state.tool, statement.start)
        elif command == "#initmov":
            self.flow.state = FrameState()
        elif command not in NO_FRAMES:
            self.flow.state = FrameState(None, None, computed)

    def _carry_tool(self, number: str | None, at: int) -> None:
        """The load of a tool, which ``BAS`` sets with it, where the files have loads of tools."""
        if any(self._loads.values()):
            self.flow.carry(self._load_of_tool(number), at)

    def _load_of_tool(self, number: str | None) -> Load | None:
        """``LOAD_DATA`` of a tool."""
        if number is None or not (number.isdecimal() and (number == NULLFRAME or number in self._loads)):
            return unknown_load(f"LOAD_DATA[{number or '…'}] is not in these files")
        return self._loads.get(number)

    def _load_value(self, statement: TokenLine) -> Load | None:
        """The load that is assigned to ``$LOAD``, of which the value comes next."""
        word, start = statement.word(), statement.next.start
        if word == "{":
            return load(self.listing.text[start : statement.end])
        if word == "load_data":
            return self._load_of_tool(statement.word(2) if statement.word(3) == "]" else None)
        if word == "sload" and statement.word(1) == "(":
            return self._load_of_tool(self._of_fdat(statement.file, statement.word(2)).tool)
        return unknown_load(f"$LOAD is computed in line {self.listing.line(start)}")

    def _forget_fdat(self) -> None:
        """``FDAT_ACT`` may have another value from here on."""
        self._fdat, self._fdat_taken, self._fdat_at = None, True, -1

    def _checked_fdat(self, state: FrameState) -> FrameState:
        """Tool and base of a move; unknown where ``FDAT_ACT`` names others and no ``BAS`` has taken it."""
        fdat = self._fdat
        same = fdat is not None and (fdat.tool, fdat.frame, fdat.part_on_robot) == (
            state.tool,
            state.frame,
            state.part_on_robot,
        )
        if fdat is None or self._fdat_taken or same:
            return state
        names = f"tool {fdat.tool} and base {fdat.frame}"
        return FrameState(None, None, fdat.reason or f"FDAT_ACT names {names}, but no BAS sets them before the move")

    def _of_fdat(self, file: int, name: str) -> FrameState:
        """Tool and base of the frame data of an inline form."""
        variable = self.data.lookup(file, name)
        if variable is None or len(variable.entries) != 1 or variable.changes:
            return FrameState(None, None, f"the frame data {name.upper()} are not in these files")
        return self._of_frame_data(variable.entries[0][1], name.upper())

    def _of_frame_data(self, data: Aggregate, name: str) -> FrameState:
        values = data.values
        numbers = [values[key].number for key in ("tool_no", "base_no") if key in values]
        mode = values["ipo_frame"].text.strip().lower() if "ipo_frame" in values else "#base"
        if mode not in ("#base", "#tcp"):
            return FrameState(None, None, f"{name} does not say in a word whether {FIXED_TOOL}")
        plain = [str(int(number.value)) for number in numbers if number is not None and number.value % 1 == 0]
        if len(plain) < 2:
            return FrameState(None, None, f"the frame data {name} name no tool or base")
        return FrameState(plain[0], plain[1], part_on_robot=mode == "#tcp")

    def _set_fdat(self, statement: TokenLine) -> None:
        """A value of ``FDAT_ACT``: frame data by their name, or in braces."""
        self._fdat_taken, self._fdat_at = False, statement.start
        in_braces = aggregate(statement, self.listing)
        if in_braces is not None:
            self._fdat = self._of_frame_data(in_braces, f"in line {self.listing.line(statement.start)}")
        elif statement.next.kind == "name" and statement.at + 1 == len(statement.tokens):
            self._fdat = self._of_fdat(statement.file, statement.word())
        else:
            self._fdat = FrameState(None, None, f"FDAT_ACT is computed in line {self.listing.line(statement.start)}")

    def _assignment(self, statement: TokenLine) -> None:
        """An assignment, or any other statement."""
        tokens = statement.tokens
        first = statement.next
        if first.kind != "name":
            self._mention(tokens, statement.file)
            return
        statement.at = 1
        index = statement.index()
        member = statement.word() == "."
        if not member and statement.take("="):
            self._assigned(statement, first, index)
            return
        variable = self.data.lookup(statement.file, first.word)
        if statement.word() == "(":
            variables = [self.data.lookup(statement.file, each.word()) for each in _arguments(statement)]
            name = self.listing.text[first.start : first.end]
            text = teaching_routine("krl", name, [bool(v is not None and v.targets) for v in variables])
            self.flow.teaching[self.listing.line(first.start)] = text
        if member and first.word == "fdat_act":
            self._fdat = FrameState(
                None, None, f"a part of FDAT_ACT is set in line {self.listing.line(statement.start)}"
            )
            self._fdat_taken = False
            return
        if member and first.word in ("$tool", "$base"):
            reason = f"a part of {first.word.upper()} is set in line {self.listing.line(first.start)}"
            (self.flow.tool if first.word == "$tool" else self.flow.frame)(None, reason)
            return
        if member and first.word == "$load":
            where = f"a part of $LOAD is set in line {self.listing.line(first.start)}"
            usual = statement.word(2) == "=" and statement.word(3).startswith("$def_l_")
            self.flow.carry(None if usual else unknown_load(where), first.start)
            return
        if first.word in NUMBERED:
            self._changed[first.word, str(index[0]) if index else ANY] = first.start
            return
        if member and variable is not None and statement.word(2) == "=":
            variable.changes.append(first.start)
            self._mention(tokens[statement.at :], statement.file)
            return
        self._mention(tokens, statement.file)

    def _assigned(self, statement: TokenLine, first: Token, index: tuple[int, ...] | None) -> None:
        word = first.word
        if word in ("$tool", "$base"):
            name = self._frame_value(statement, word == "$tool")
            reason = f"{word.upper()} is computed in line {self.listing.line(first.start)}"
            (self.flow.tool if word == "$tool" else self.flow.frame)(name, reason)
            return
        if word == "$ipo_mode":
            self._hold(self._with_mode(self.flow.state, statement))
            return
        if word == "$load":
            self.flow.carry(self._load_value(statement), first.start)
            return
        if word == "fdat_act":
            self._set_fdat(statement)
            return
        if word in NUMBERED:
            number = str(index[0]) if index else ANY
            braces = aggregate(statement, self.listing)
            frames = self.tools if word == "tool_data" else self.frames
            frame = None if braces is None else braces.frame()
            if frame is None or number == ANY or not np.array_equal(frames.setdefault(number, frame), frame):
                self._changed[word, number] = first.start
            return
        variable = self.data.lookup(statement.file, word)
        if variable is not None:
            begin = statement.at
            self.data.value(variable, index, statement)
            if variable.changes:
                self._mention(statement.tokens[begin:], statement.file)
        else:
            self._mention(statement.tokens[statement.at :], statement.file)

    def _frame_value(self, statement: TokenLine, tool: bool) -> str | None:
        """Name of the frame that is assigned to ``$TOOL`` or ``$BASE``; None where it is computed."""
        frames = self.tools if tool else self.frames
        at, file = statement.next.start, statement.file
        braces = aggregate(statement, self.listing)
        if braces is not None:
            frame = braces.frame()
            if frame is None or statement.word() not in ("", ","):
                return None
            name = f"of line {self.listing.line(at)}, column {self.listing.column(at)}"
            frames[name] = frame
            return name
        word = statement.word()
        if statement.next.kind != "name":
            return None
        statement.at += 1
        if word in ("stool2", "sbase") and statement.take("("):
            name = statement.word()
            depth = 1
            while depth and statement.next is not END:
                depth += (statement.word() == "(") - (statement.word() == ")")
                statement.at += 1
            state = self._of_fdat(file, name)
            return state.tool if tool else state.frame
        index = statement.index()
        if statement.word() not in ("", ",", "c_spl", "c_ptp", "c_dis", "c_vel", "c_ori") or index is None:
            return None
        if word in ("$nullframe", "$world"):
            return NULLFRAME
        if word in ("tool_data", "base_data"):
            return str(index[0]) if len(index) == 1 and (word == "tool_data") is tool else None
        return self._variable_frame(file, word, index, frames)

    def _variable_frame(
        self, file: int, word: str, index: tuple[int, ...], frames: dict[str, FloatArray]
    ) -> str | None:
        variable = self.data.lookup(file, word)
        if variable is None:
            return word
        frame_target = variable.targets.get(index)
        if frame_target is None or variable.changes or len(variable.entries) != len(variable.targets):
            return None
        frames[word + str(index or "")] = KUKA.frame([number.value for number in frame_target.numbers])
        return word + str(index or "")

    def _with(self, statement: TokenLine, state: FrameState, lasting: bool = False) -> FrameState:
        """Tool and base that ``WITH`` gives a move."""
        tokens = statement.tokens
        for k, (token, behind) in enumerate(pairwise(tokens)):
            if token.word in ("$tool", "$base", "$ipo_mode") and behind.word == "=":
                statement.at = k + 2
                if token.word == "$ipo_mode":
                    state = self._with_mode(state, statement)
                    if lasting:
                        self._hold(state)
                    continue
                name = self._frame_value(statement, token.word == "$tool")
                reason = f"{token.word.upper()} is computed in line {self.listing.line(token.start)}"
                new = (name, state.frame) if token.word == "$tool" else (state.tool, name)
                state = FrameState(*new, reason if None in new else state.reason, state.part_on_robot)
                if lasting:
                    (self.flow.tool if token.word == "$tool" else self.flow.frame)(name, "" if name else reason)
        return state

    def _carried_with(self, statement: TokenLine) -> Ways | None:
        """The load that ``WITH`` gives a move; None where it gives none."""
        for k, (token, behind) in enumerate(pairwise(statement.tokens)):
            if token.word == "$load" and behind.word == "=":
                statement.at = k + 2
                self.flow.names_loads.append(token.start)
                self.flow.loads.names_any = True
                return frozenset([self._load_value(statement)])
        return None

    def _hold(self, state: FrameState) -> None:
        """Take from a state, beside which tool and frame stay, whether the robot holds the part, if that is known."""
        if state.tool is state.frame is None:
            self.flow.state = state
        else:
            self.flow.hold(state.part_on_robot)

    def _with_mode(self, state: FrameState, statement: TokenLine) -> FrameState:
        """Tool and base with the value of ``$IPO_MODE`` that comes next, in a word or as frame data have it."""
        if statement.word() == "sipo_mode":
            form = self._of_fdat(statement.file, statement.word(2))
            return form if form.tool is None else replace(state, part_on_robot=form.part_on_robot)
        if statement.word() in ("#base", "#tcp"):
            return replace(state, part_on_robot=statement.word() == "#tcp")
        return FrameState(None, None, f"$IPO_MODE is computed: it is not known whether {FIXED_TOOL}")

    def _taught_move(self, statement: TokenLine, instruction: MotionInstruction) -> None:
        """A routine that moves to one of its arguments."""
        arguments = _arguments(statement)
        roles = instruction.roles(len(arguments), False)
        if roles is None:
            known = f"it is known as {' '.join(instruction.required)}, found {len(arguments)} arguments"
            self.flow.leave(statement.start, instruction.name, "", known)
        goal: Target | None = None
        for role, argument in zip(roles or [""] * len(arguments), arguments, strict=True):
            variable = self.data.lookup(statement.file, argument.word())
            if role in POINTS:
                pointed, state = self._point(argument, instruction.name), self._checked_fdat(self.flow.state)
                goal = self._use(pointed, statement.start, instruction.name, "via" if role == VIA else "to", state)
            elif role == WRITES and variable is not None:
                variable.changes.append(statement.start)
            else:
                self._mention(argument.tokens, statement.file)
        self.flow.stop(goal, statement.start)

    def _use(
        self, pointed: PointedTargets, at: int, name: str, role: Role, state: FrameState, *own: Any
    ) -> Target | None:
        """Use what a point stands for, as `ControlFlow.use`; the target where it is one."""
        targets, text, reason = pointed
        if reason:
            self.flow.leave(at, name, text, reason)
        for goal in targets:
            self.flow.use(goal, at, name, role, state, *own)
            goal.conflicts += [reason] if reason else []
        return targets[0] if len(targets) == 1 and not reason else None

    def _move(self, statement: TokenLine, instruction: MotionInstruction) -> None:
        """The points of a move."""
        name = instruction.name
        ends = [k for k, token in enumerate(statement.tokens) if token.word == "with"]
        state = self._checked_fdat(self.flow.state)
        state = self._with(statement, state) if ends else state
        carried = self._carried_with(statement) if ends else None
        statement.at = 1
        if statement.word() in ("$axis_act", "$pos_act") and not ends:  # to where the arm stands
            return
        words = [token.word for token in statement.tokens]
        goal: Target | None = None
        for k, word in enumerate(instruction.required):
            role: Role = "via" if word == VIA else "to"
            if k and not statement.take(","):
                self.flow.leave(statement.start, name, self._rest(statement, 1), "its end point is missing")
                break
            shifted = self._shifted(statement, name, state)
            if shifted == []:
                goal = None
                continue
            pointed = (shifted, "", "") if shifted else self._point(statement, name)
            goal = self._use(pointed, statement.start, name, role, state, ("$tool" in words, "$base" in words), carried)
        self.flow.stop(goal, statement.start)
        unused = [token for token in statement.tokens[statement.at :] if token.kind == "name" and token.word[:1] != "$"]
        self._mention([token for token in unused if not token.word.startswith("c_")], statement.file)

    def _shifted(self, statement: TokenLine, move: str, state: FrameState) -> list[Target] | None:
        """Take a point with a shift in its own axes, ``P:{X …,Y …,Z …,A …,B …,C …}``; None where no such comes next.

        The target of its own that it becomes, none where it stays.
        """
        begin = statement.at
        variable = self.data.lookup(statement.file, statement.word()) if statement.next.kind == "name" else None
        statement.at += 1
        index = statement.index()
        braces = aggregate(statement, self.listing) if statement.take(":") else None
        T = None if braces is None else braces.frame()
        targets = [] if variable is None else [t for at, t in variable.targets.items() if index in (None, at)]
        if variable is None or not targets or variable.changes or T is None or statement.word() == ":":
            statement.at = begin
            return None
        at, text = statement.tokens[0].start, self._rest(statement, begin, statement.at)
        span = statement.tokens[begin].start, statement.tokens[statement.at - 1].end
        shifts = [Shift(t, at, move, text, np.eye(4), T, True, state.tool, state.frame) for t in targets]
        new_target = self.flow.shift(shifts, span)
        self.literals += [new_target] if new_target is not None else []
        return [new_target] if new_target is not None else []

    def _relative(self, statement: TokenLine, move: str) -> bool:
        """Take a move by a distance in numbers, along the base or the tool, from a target by its tool and base."""
        start, state = self.flow.standing_at(), self._checked_fdat(self.flow.state)
        statement.at = 1
        braces = aggregate(statement, self.listing)
        values = {} if braces is None else {name: value.number for name, value in braces.values.items()}
        numbers = {name: number.value for name, number in values.items() if number is not None}
        in_tool, rest = statement.take("#tool"), statement.take("#base")
        ends = statement.next is END or statement.word().startswith("c_")
        plain = len(numbers) == len(values) > 0 and not any(numbers[name] for name in numbers.keys() - {"x", "y", "z"})
        if start is None or start.kind == "joint" or start.external or not plain or not ends or (in_tool and rest):
            statement.at = 0
            return False
        if (start.uses[-1].tool, start.uses[-1].work_object) != (state.tool, state.frame):
            statement.at = 0
            return False
        T = frames.transform(None, [numbers.get(name, 0.0) * MM for name in "xyz"])
        left, right = (np.eye(4), T) if in_tool else (T, np.eye(4))
        text = self._rest(statement, 1)
        self.flow.shifts.append(Shift(start, statement.start, move, text, left, right, True, state.tool, state.frame))
        self.flow.stop_beside(statement.start)
        return True

    def _point(self, statement: TokenLine, move: str) -> PointedTargets:
        """What the argument that comes next stands for."""
        begin = statement.at
        braces = aggregate(statement, self.listing)
        if braces is not None and statement.word() != ":":
            name = f"of {move} in line {self.listing.line(braces.start)}"
            parsed, reason = target(name, "", braces, self.listing)
            text = self.listing.quote(braces.start, braces.end)
            if parsed is None:
                return [], text, reason
            self.literals.append(parsed)
            return [parsed], text, ""
        statement.at = begin
        token = statement.next
        if token.kind != "name":
            return [], self._rest(statement, begin), "its target is computed"
        statement.at += 1
        index = statement.index()
        text = self._rest(statement, begin, statement.at)
        if statement.word() in (":", ".", "(", "+", "-"):
            self._mention(statement.tokens[begin:], statement.file)
            statement.at = len(statement.tokens)
            return [], self._rest(statement, begin), "its target is computed"
        variable = self.data.lookup(statement.file, token.word)
        if _HOME.fullmatch(token.word) and (variable is None or self.data.system(variable.file)):
            self.notes.append((token.start, f"{text} is a joint target of the controller's own: it is left as it was"))
            return [], "", ""
        if variable is None:
            return [], text, f"{text} is not declared in these files"
        if self.data.system(variable.file):
            self.notes.append((token.start, f"{text} stands in a file that other programs share: it is left as it was"))
            return [], "", ""
        return self._of_variable(variable, index, text)

    def _of_variable(self, variable: Variable, index: tuple[int, ...] | None, text: str) -> PointedTargets:
        targets = [target_at for at, target_at in variable.targets.items() if index is None or at == index]
        if variable.changes:
            statement = self.listing.line(variable.changes[0])
            return targets, text, f"{text} is computed, changed or not whole in line {statement}"
        if not targets:
            return [], text, f"{text} has no value in these files"
        return targets, text, ""

    def _mention(self, tokens: list[Token], file: int) -> None:
        """Note names that are used in another way than as the target of a move."""
        self._mentioned += [(token, file) for token in names_in(tokens)]

    def conclude(self) -> None:
        """Tell targets where they are used in another way than in a move, and where their tools and bases change."""
        for token, file in self._mentioned:
            variable = self.data.lookup(file, token.word)
            if variable is not None and not self.data.system(variable.file):  # those of the system stay in any case
                for mentioned in variable.targets.values():
                    self.flow.mention(mentioned, token.start)
        for used in [*self.literals, *(each for v in self.data.variables.values() for each in v.targets.values())]:
            for word in NUMBERED if self._changed else ():
                for number in {(use.tool if word == "tool_data" else use.work_object) or ANY for use in used.uses}:
                    at = self._changed.get((word, number), self._changed.get((word, ANY)))
                    if at is not None:
                        used.conflicts.append(f"line {self.listing.line(at)} changes {word.upper()}[{number}]")

    def _rest(self, statement: TokenLine, begin: int, end: int | None = None) -> str:
        tokens = statement.tokens[begin:end]
        return self.listing.quote(tokens[0].start, tokens[-1].end) if tokens else ""


_BEGIN = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(DEF|DEFFCT|DEFDAT)\b", re.IGNORECASE | re.MULTILINE)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like KRL."""
    return data.lstrip(b"\xef\xbb\xbf \r\n\t").upper().startswith(b"&ACCESS") or _BEGIN.search(data) is not None


_SYSTEM = frozenset(["mada", "steu", "system", "tp"])
"""Folders of a backup (``KRC``) that hold the controller's own files; of those ``$config.dat`` says tools and bases."""


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read KRL for an arm: all files are one program; see `irbcal.correction.languages.Language`."""
    files = [path for path in files if not _of_the_system(path) or path.name.lower() == "$config.dat"] or list(files)
    for file in [file for file in files if file.suffix.lower() in (".src", ".sub")]:
        beside = [path for path in sorted(file.parent.glob("*")) if path.name.lower() == file.stem.lower() + ".dat"]
        files += [path for path in beside if path not in files]
    contents, unread = each_read(files, _checked)
    return [parse(arm, contents, setup), *unread]


def _of_the_system(path: Path) -> bool:
    folders = [word.lower() for word in path.parts]
    return "krc" in folders and bool(_SYSTEM & {*folders[folders.index("krc") :]})


def _checked(file: Path) -> tuple[str, bytes]:
    """Name and content of a file of KRL."""
    data = read_bytes(file)
    if not looks_like(data):
        raise ProgramError("expected a KRL program with DEF or DEFDAT", file=file)
    lines_of(Listing([(str(file), data)], "KUKA KRL"))
    return str(file), data


def parse(arm: Arm, files: Sequence[tuple[str, bytes]], setup: ControllerSetup, maker: Maker = KUKA) -> KrlProgram:
    """Read KRL from the names and contents of files.

    Raises
    ------
    ProgramError
        If this is no KRL, or a tool or base that is needed is not known.
    """
    # declarations before routines, so that moves find their targets
    ordered = sorted(files, key=lambda file: (Path(file[0]).suffix.lower() != ".dat", files.index(file)))
    listing = Listing(ordered, "KUKA KRL")
    lines, comments = lines_of(listing)
    data = KrlData(listing, [str(Path(file.name).with_suffix("")).lower() for file in listing.files])
    statements_left = [
        statement for statement in lines if statement.tokens[0].word != "&" and not data.declaration(statement)
    ]
    taught = setup.instructions.get("krl", {})
    statements = Statements(listing, data, setup.harmless, setup.split_points, taught)
    statements_left = _values_first(statements, data, statements_left)
    data.collect()
    statements.follow(statements_left)
    for statement in statements_left:
        statement.at = 0
        statements.statement(statement)
    statements.conclude()
    targets = [literal for variable in data.variables.values() for literal in variable.targets.values()]
    return _program(arm, maker, listing, setup, statements, [*targets, *statements.literals], comments)


def _values_first(statements: Statements, data: KrlData, lines: list[TokenLine]) -> list[TokenLine]:
    """Take values of data files and assignments in numbers; returns the other lines."""
    statements_left = []
    for statement in lines:
        statement.at = 0
        if _is_value(statement, data):
            statements.statement(statement)
        else:
            statements_left.append(statement)
    return statements_left


def _is_value(statement: TokenLine, data: KrlData) -> bool:
    """Whether a line gives a value to a variable that is declared, to one of its components, or to a numbered frame."""
    if statement.next.kind != "name" or statement.word() in ("$tool", "$base", "fdat_act"):
        return False
    name = statement.word()
    statement.at = 1
    index = statement.index()
    member = statement.word() == "." and statement.word(2) == "="
    setup = statement.take("=") and statement.word() != ""
    statement.at = 0
    if name in NUMBERED:
        return setup and bool(index)
    variable = data.lookup(statement.file, name)
    return (setup or member) and variable is not None and variable.type in TYPES


def _program(
    arm: Arm,
    maker: Maker,
    listing: Listing,
    setup: ControllerSetup,
    statements: Statements,
    targets: list[Target],
    comments: list[str],
) -> KrlProgram:
    targets.sort(key=lambda target: target.start)
    if len(listing.files) > 1:
        for one in targets:
            one.name += f" of {Path(listing.files[listing.file_at(one.start)].name).name}"
    eye = {NULLFRAME: frames.transform()}
    main = next((p for p in listing.files if Path(p.name).suffix.lower() != ".dat"), listing.files[0])
    notes = [Note(listing.line(at), text) for at, text in statements.notes]
    status = [
        integer(listing.text[slice(*target.configuration_spans[0])]) for target in targets if target.configuration_spans
    ]
    if any((value or 0) & 16 for value in status) and setup.own_model is None:
        text = (
            "points say (S, bit 4) that the robot was absolutely accurate: it must not be corrected twice; what such a "
            "controller computes with is given with --controller-model"
        )
        notes.append(Note(1, text))
    return KrlProgram.assembled(
        maker,
        arm,
        statements.flow,
        targets,
        setup,
        {**statements.tools, **eye},
        {**statements.frames, **eye},
        source=main.name,
        notes=dict.fromkeys(notes),
        comments=comments,
        mark_at=_behind_head(listing, main.start, main.end),
        marks_beside=tuple(_behind_head(listing, p.start, p.end) for p in listing.files if p is not main),
    )


def _behind_head(listing: Listing, start: int, end: int) -> int:
    """Behind the first line with ``DEF``; before everything where there is none."""
    match = _BEGIN.search(listing.text[start:end].encode("latin-1"))
    if match is None:
        return start
    at = listing.after_line(start + match.start())
    return at if at < end or listing.text[at - 1 : at] in "\r\n" else start


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the mark of a KRL file; see `irbcal.correction.languages.Language`."""
    _, comments = lines_of(Listing([(source, data)], "KUKA KRL"))
    return mark_in(comments)


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.src``: PTP moves to axes with exact stops; external axes stay where they are."""
    lines = ["&ACCESS RVP", "DEF plan( )", *(f"; {note(text)}" for text in moves.head)]
    lines += ["BAS (#INITMOV,0)", "BAS (#ACC_PTP,50)"]
    percent = 0
    for move, joints in zip(moves.moves, moves.texts(KUKA), strict=True):
        lines += [f"; {note(move.comment)}"] if move.comment else []
        if move.percent != percent:
            percent = move.percent
            lines.append(f"BAS (#VEL_PTP,{percent})")
        lines.append(f"PTP {{{', '.join(f'A{k} {text}' for k, text in enumerate(joints, start=1))}}}")
        lines += [f"WAIT SEC {move.wait_s:.1f}"] if move.wait_s else []
    return {"plan.src": "\r\n".join([*lines, "END", ""])}


_ROBROOT = re.compile(r"^[ \t]*(?:DECL[ \t]+)?(?:FRAME[ \t]+)?\$ROBROOT[ \t]*=[ \t]*\{([^{}\r\n]*)\}", re.I | re.M)
_ABS_ACCUR = re.compile(r"^[^;\r\n]*\$ABS_ACCUR[ \t]*=[ \t]*(?:TRUE|#ACTIVATED)\b", re.I | re.M)
_DEACTIVATED = re.compile(
    r"^[^;\r\n]*\$(?:DEACTIVATE_ABS_ACCUR[ \t]*=[ \t]*TRUE|ABS_ACCUR[ \t]*=[ \t]*FALSE)\b", re.I | re.M
)
_OF_ROBOT = ("roboter", "ir_spec", "rdc")
"""Folders beside ``KRC`` in archives that hold the files of one robot."""
_COMPONENT = re.compile(r"\b([XYZABC])[ \t]+([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)", re.I)


def backup(files: Sequence[Path]) -> Backup:
    """Where the robot stands (``$ROBROOT``), and whether the controller corrects it itself.

    It does by ``$ABS_ACCUR``, and with the ``.pid`` file of an absolutely accurate robot, which newer controllers use
    unless ``$DEACTIVATE_ABS_ACCUR``.
    """
    out = Backup()
    for root in folders_named(files, "krc"):
        folders = [root, *(path for path in root.parent.glob("*") if path.name.lower() in _OF_ROBOT and path.is_dir())]
        of_robot = sorted(path for folder in folders for path in folder.rglob("*") if path.suffix.lower() == ".pid")
        deactivated = False
        for path in sorted(path for path in root.rglob("$*") if path.suffix.lower() == ".dat" and path.is_file()):
            text = text_of(path)
            deactivated |= _DEACTIVATED.search(text) is not None
            if _ABS_ACCUR.search(text):
                out = out._replace(accuracy=f"the robot is absolutely accurate ($ABS_ACCUR in {path.name})")
            for match in _ROBROOT.finditer(text):
                values = {name.upper(): float(value) for name, value in _COMPONENT.findall(match[1])}
                if len(values) == len(POSE):
                    out = placed(out, KUKA.frame([values[name.upper()] for name in POSE]), path)
        if of_robot and not deactivated and not out.accuracy:
            out = out._replace(accuracy=f"the robot is absolutely accurate ({of_robot[0].name} is in the backup)")
    for path in files:
        if path.suffix.lower() in (".src", ".sub") and _ABS_ACCUR.search(text_of(path)):
            out = out._replace(accuracy=f"{path.name} switches on that the robot is absolutely accurate ($ABS_ACCUR)")
    return out


LANGUAGE = Language(
    name="KUKA KRL",
    endings=(".src", ".dat", ".sub"),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=fingerprint,
    maker=KUKA,
    robots=r"kuka|(^|_)k[ru]\d",
    write_moves=write_moves,
    motions=MOTIONS,
    backup=backup,
    declaration=FrameDeclaration(
        *TO_99,
        head="DEFDAT $CONFIG",
        tool="TOOL_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        work_object="BASE_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        foot="ENDDAT",
        held_part="TOOL_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        fixed_tool="BASE_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
    ),
    sample=SampleArm(
        folder="kuka",
        joints=(
            ((0, 0, 0.4), "0 0 -1"),
            ((0.025, 0, 0), "0 1 0"),
            ((0.45, 0, 0), "0 1 0"),
            ((0.42, 0, 0.035), "-1 0 0"),
            ((0, 0, 0), "0 1 0"),
            ((0, 0, 0), "-1 0 0"),
        ),
        flange=(0.08, 0, 0, 0, np.pi / 2, 0),
        stops=((10, -80, 100, 20, 40, 30), (-25, -95, 110, -15, 50, -40), (30, -70, 80, 10, -35, 60)),
        frame=(400, 0, 200, 0, 0, 0),
        tried={"job.src": "--out kuka-job --tool 3=0,0,150,0,0,0 --frame 1=400,0,200,0,0,0"},
    ),
)
