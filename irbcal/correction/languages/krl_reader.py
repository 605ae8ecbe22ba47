"""The text of KRL files: tokens of lines, variables with their values, and the folds of inline forms."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import notation
from irbcal.correction.listing import BOM, Listing, Number, Span, Token, between_commas
from irbcal.correction.loads import Load, load_of, unknown_load
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.targets import Target
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


def posture_of(status: int, turn: int) -> Posture:
    """What S and T mean; bits 3 and above of S say nothing of joints."""
    negative = [bool(turn >> k & 1) for k in range(6)]
    low = tuple(-np.inf if minus else 0.0 for minus in negative)
    high = tuple(0.0 if minus else np.inf for minus in negative)
    return Posture(bool(status & 1), not status & 2, -1 if negative[4] else 1, low, high)


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


OPEN = ("if", "switch", "spline", "ptp_spline")
LOOPS = ("for", "while", "repeat", "loop")
ALTERNATIVE = ("else", "case", "default")
CLOSE = ("endif", "endswitch", "endfor", "endwhile", "until", "endloop")
ROUTINE = ("def", "deffct", "defdat", "end", "endfct", "enddat")
_BEFORE_BRACKETS = "bas and or not exor case when sec else to step"
NO_CALLS = {*OPEN, *LOOPS, *CLOSE, *ROUTINE, *_BEFORE_BRACKETS.split()}
"""What stands before a bracket and is no routine."""
EVENTS = ("trigger", "interrupt")
"""What calls routines at other times."""


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

    @property
    def called_routines(self) -> list[Token]:
        """Routines that it calls, the controller's own among them; triggers and interrupts call theirs at other times.

        A routine without arguments may be called without brackets.
        """
        tokens = self.tokens
        if tokens[0].word in (*EVENTS, "global"):
            return []
        if len(tokens) == 1 and tokens[0].kind == "name":
            alone = tokens[0].word not in (*OPEN, *LOOPS, *CLOSE, *ALTERNATIVE, *ROUTINE, "endspline")
            return tokens if alone else []
        pairs = pairwise(tokens)
        return [
            word for word, behind in pairs if behind.word == "(" and word.kind == "name" and word.word not in NO_CALLS
        ]

    @property
    def arguments(self) -> list[TokenLine]:
        """Arguments of a call with which it begins."""
        return [TokenLine([*tokens], self.file) for tokens in between_commas(self.tokens[2:]) if tokens]

    @property
    def routine(self) -> str:
        """Name of the routine that it begins; empty for other lines."""
        keywords = [token.word for token in self.tokens]
        begins = "def" in keywords[:2] or "deffct" in keywords[:3]
        return keywords[keywords.index("(") - 1] if begins and "(" in keywords else ""


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


_FOLD = re.compile(r"^[ \t]*;[ \t]*(?:(FOLD)|ENDFOLD)\b([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
_FORM = re.compile(r"\bTool\[\d+\].*\bBase\[\d+\].*%\{", re.IGNORECASE)


LOAD_DATA = re.compile(
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
