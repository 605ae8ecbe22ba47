r"""ABB RAPID modules: which targets stand in them as numbers, and which moves use them.

Literals of ``robtarget`` and ``jointtarget`` in declarations, in assignments and inside moves are read; a move whose
target the program computes (arithmetic, a function) is reported and left. A target that is also shifted by ``Offs`` or
``RelTool`` is corrected for its direct moves, and what becomes of the shifted one is told. A target is not
corrected where its literal does more than the direct moves that use it: where it is also an argument of something
else, where its variable is also computed, where moves use it with different tools or work objects. Uses in
other modules of the same call count, see `Task`; what is not in the call is not seen.
"""

from __future__ import annotations

import bisect
import functools
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, locked
from irbcal.correction import notation
from irbcal.correction.backup import Backup, folders_named, placed, text_of
from irbcal.correction.calls import Calls, may_set_load
from irbcal.correction.instructions import ANY, POINTS, TO, TOOL, VIA, WRITES, MotionInstruction, built_in, teaching
from irbcal.correction.language import ANY_WORD, FrameDeclaration, Language, SampleArm
from irbcal.correction.listing import Edit, Listing, Number, Span, Token, mark_in, up_to_next
from irbcal.correction.loads import Carrying, Load, LoadFlow, load_of, unknown_load
from irbcal.correction.maker import (
    NO_CONFDATA,
    NO_POSTURE,
    NO_REACH,
    ConfData,
    Maker,
    Posture,
    Solutions,
    configuration_of,
    seeds_of,
)
from irbcal.correction.moves import Moves, note
from irbcal.correction.notation import DECIMALS, QUATERNION_DECIMALS, number_text, numbers_from_poses
from irbcal.correction.paths import CutPath, PathMove
from irbcal.correction.program import ControllerSetup, Note, Program, TargetKind, each_read, read_bytes
from irbcal.correction.text_program import (
    START,
    Configuration,
    ControlFlow,
    Shift,
    Target,
    TextProgram,
    Use,
    complete,
    needed_frames,
)
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, own_model
from irbcal.units import DEG, MM

ABSENT = 0.9e9
"""From here on a number stands for an axis that is not there (9E9, 1E9), or for no place at all."""

ABB = Maker(
    name="RAPID",
    orientation=notation.Quaternion(),
    length=MM,
    angle=1.0,
    joint=DEG,
    decimals=(DECIMALS, QUATERNION_DECIMALS, DECIMALS),
    axes=(),
    matrix=np.eye(6),
    largest=ABSENT,
)

MOTIONS = built_in(
    """
    # joint and straight moves, circles
    MoveJ MoveL MoveAbsJ: to speed zone tool
    MoveC: via to speed zone tool
    # with an output, with a routine
    MoveJDO MoveJAO: to speed zone tool signal value
    MoveJGO: to speed zone tool signal *
    MoveLDO MoveLAO: to speed zone tool signal value
    MoveLGO: to speed zone tool signal *
    MoveCDO MoveCAO: via to speed zone tool signal value
    MoveCGO: via to speed zone tool signal *
    MoveJSync MoveLSync: to speed zone tool routine
    MoveCSync: via to speed zone tool routine
    # with events on the path
    TriggJ TriggL TriggAbsJ: to speed trigger zone tool
    TriggC: via to speed trigger zone tool
    TriggJIOs TriggLIOs: to speed zone tool
    # searches end where something is found
    SearchL: signal writes to speed tool
    SearchC: signal writes via to speed tool
    # arc welding; weave data stand among the others in older versions
    ArcL ArcL1 ArcL2 ArcLStart ArcLEnd: to speed seam weld * tool
    ArcC ArcC1 ArcC2 ArcCStart ArcCEnd: via to speed seam weld * tool
    # spot welding, nuts
    SpotL SpotJ SpotML SpotMJ NutL NutJ: to speed * tool
    # dispensing, painting, the continuous application platform
    DispL: to speed bead zone tool
    DispC: via to speed bead zone tool
    PaintL: to speed * zone tool
    PaintC: via to speed * zone tool
    CapL: to speed cap * zone tool
    CapC: via to speed cap * zone tool
    """
)
"""With ABB's options, as their manuals list the arguments."""

_WORDS = (
    "module endmodule proc endproc func endfunc trap endtrap record endrecord alias const pers var local task "
    "if then elseif else endif for from to step do endfor while endwhile test case default endtest goto return "
    "error undo backward raise retry trynext exit connect with"
)
_OPERATORS = "div mod and or not xor"
STRUCTURE = frozenset(_WORDS.split())
OPERATORS = frozenset(_OPERATORS.split())
RESERVED = STRUCTURE | OPERATORS | {"true", "false"}

_SPACE = r"[ \t\r\n\f\v]*"
_NUMBER = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_SIGNED = rf"{_SPACE}[+-]?{_SPACE}{_NUMBER}{_SPACE}"
TOKEN = re.compile(
    rf"""{_SPACE}
    (?:(?P<list>\[{_SPACE}[+-]?{_NUMBER}(?:{_SPACE},{_SPACE}[+-]?{_NUMBER})*{_SPACE}\])
    |(?P<symbol>:=|<>|<=|>=|\.(?![0-9])|[-+*/=<>()\[\]{{}},;:\\?|%])
    |(?P<number>(?!0[xXbBoO][0-9a-fA-F]){_NUMBER})
    |(?P<name>[^\W\d]\w*)
    |(?P<comment>![^\r\n]*)
    |(?P<string>"(?:[^"\r\n]|"")*")
    |(?P<hex>0[xXbBoO][0-9a-fA-F]+)
    |(?P<other>[^ \t\r\n\f\v]))""",
    re.VERBOSE,
)
"""A list of plain numbers is one token, whose word is its bracket: most of a long module are such lists."""
_LIST, _NAME = TOKEN.groupindex["list"], TOKEN.groupindex["name"]
_KINDS = ("", *sorted(TOKEN.groupindex, key=lambda kind: TOKEN.groupindex[kind]))


Subscripts: TypeAlias = tuple[int | None, ...]
"""Index of an element, each from 1; None where it is computed."""

Scope: TypeAlias = "dict[str, RapidData]"
"""Data of a routine by their names in lower case."""


def may_be(index: Subscripts, index_of_other: Subscripts) -> bool:
    """Whether two indices may name the same element; None, or no index at all, stands for any."""
    return all(a is None or b is None or a == b for a, b in zip(index, index_of_other, strict=False))


class Node(NamedTuple):
    """A value: a list of values, a plain number, or (both None) any other expression."""

    items: list[Node] | None
    number: float | None
    start: int
    end: int


class Mention(NamedTuple):
    """A name in any other place."""

    scope: Scope | None
    name: str
    indices: Subscripts
    start: int


@dataclass(eq=False, repr=False)
class Literal(Target):
    """A target in numbers of a module."""

    mentioned: list[int] = field(default_factory=list)
    """Where its variable is used in another way than as the target of a move."""
    monitored: set[bool | None] = field(default_factory=set)
    """Whether its configuration counts in its moves: ``ConfJ`` or ``ConfL`` is on; None where that is not known."""

    @property
    def moves_axes(self) -> bool:
        """Whether it has external axes that are there."""
        return bool(self.e)


class Arg(NamedTuple):
    """An argument of a move: a literal (node), a name with an index, or neither: computed; ``text`` may be cut."""

    node: Node | None
    name: str | None
    indices: Subscripts
    start: int
    text: str
    end: int


class MoveInstruction(NamedTuple):
    """A move instruction: its points with their roles, tool and work object (None: wobj0), and all its arguments."""

    name: str
    start: int
    scope: Scope | None
    points: list[tuple[str, Arg]]
    tool: Arg
    work_object: Arg | None
    args: list[Arg]
    options: dict[str, Arg | None]
    taught: bool = False


class Shifted(NamedTuple):
    """``Offs(point,x,y,z)`` or ``RelTool(point,x,y,z)`` as the target of a move."""

    move: int
    name: str
    indices: Subscripts
    start: int
    in_tool: bool
    numbers: tuple[float, ...] | None


class Monitoring(NamedTuple):
    """An instruction that switches whether configurations count, in joint moves (``j``) or others (``l``)."""

    scope: Scope | None
    start: int
    moves: str
    on: bool


class Assignment(NamedTuple):
    """``name{index} := node``; without node: a computed value, or a component only."""

    scope: Scope | None
    name: str
    indices: Subscripts
    node: Node | None
    start: int


class RapidData:
    """What one name stands for: its type, and its value where the declaration gives a list."""

    def __init__(
        self,
        spelling: str,
        type_name: str,
        start: int,
        sizes: Subscripts = (),
        node: Node | None = None,
        computed: int | None = None,
        local: bool = False,
    ) -> None:
        self.spelling, self.type, self.start = spelling, type_name, start
        self.sizes, self.node, self.computed, self.local = sizes, node, computed, local
        self.entries: list[tuple[Subscripts, Literal]] = []  # filled by `literals`
        self.changes: list[tuple[Subscripts, int]] = []  # and the positions of computed values, too
        self._places: dict[Subscripts, list[int]] = {}
        self._loose: list[int] = []
        self._known = 0

    def literals(self, index: Subscripts) -> list[Literal]:
        """Entries that an index may mean, in their order: looked up, not looked through, where it is plain numbers."""
        for k in range(self._known, len(self.entries)):
            at = self.entries[k][0]
            if None in at or len(at) != len(self.sizes):
                self._loose.append(k)
            else:
                self._places.setdefault(at, []).append(k)
        self._known = len(self.entries)
        if None in index or len(index) != len(self.sizes):
            return [literal for at, literal in self.entries if may_be(at, index)]
        loose = [k for k in self._loose if may_be(self.entries[k][0], index)]
        return [self.entries[k][1] for k in sorted([*self._places.get(index, []), *loose])]


CLOSING = {"(": ")", "{": "}"}
_PREDEFINED = re.compile(r"v\d+|vmax|z\d+|fine|wobj0|load0|true|false")
DEEPEST = 12  # lists in lists
_NODE = partial(tuple.__new__, Node)  # half the time of Node(…)

EXACT = frozenset(["MoveJ", "MoveL", "MoveAbsJ", "MoveC"])
"""Moves that do nothing else on their way."""


class Reader:
    """One pass through the text of a module, which notes declarations, assignments, moves and other mentions of names.

    What they mean for targets is decided afterwards, see `Literals` and `Uses`.
    """

    def __init__(self, listing: Listing, instructions: Mapping[str, MotionInstruction] = MOTIONS) -> None:
        self.listing, self.text, self.instructions = listing, listing.text, instructions
        """``instructions``: moves that are known, by their names in lower case."""
        self.line, self.error, self.quote = listing.line, listing.error, listing.quote
        self.tokens: list[Token] = []
        """The last one is of the kind ``end``, without a word."""
        self.comments: list[str] = []
        self.mentions: list[Mention] = []
        """Names in any other place."""
        self.scope: Scope | None = None
        """Data of the routine that is being read; None outside routines."""
        self.data: Scope = {}
        """Of the module."""
        self.scopes: list[Scope] = []
        """The same for each routine."""
        self.routines: list[tuple[str, Scope, int]] = []
        """Names in lower case, the data of each, and where it begins."""
        self.monitoring: list[Monitoring] = []
        self.moves: list[MoveInstruction] = []
        self.assignments: list[Assignment] = []
        self.loose: list[Node] = []
        """Lists of values in any other place."""
        self.calls: list[int] = []
        """Tokens with which statements begin that are no move that is known, and may be one."""
        self.wrong: list[tuple[int, str]] = []
        """Moves with another number of arguments than is known, and why they are none."""
        self.shifted: list[Shifted] = []
        """By the number of their moves."""
        self._level = 0
        self._tokenize()

    def _tokenize(self) -> None:
        make, append = partial(tuple.__new__, Token), self.tokens.append  # half the time of Token(…)
        for match in TOKEN.finditer(self.text, 1 if self.text.startswith("\ufeff") else 0):
            k, end = match.lastindex, match.end()
            assert k is not None
            word = match[k]
            if k == _LIST:
                append(make(("list", "[", end - len(word), end)))
            elif k < _NAME:
                append(make((_KINDS[k], word, end - len(word), end)))
            elif k == _NAME:
                append(make(("name", word.lower(), end - len(word), end)))
            elif _KINDS[k] == "comment":
                self.comments.append(word)
            elif _KINDS[k] == "other":
                problem = "the string is not closed in its line" if word == '"' else f"unexpected character {word!r}"
                raise self.error(end - 1, problem)
            else:
                append(make((_KINDS[k], word, end - len(word), end)))

        append(Token("end", "", len(self.text), len(self.text)))

    @functools.cached_property
    def branches(self) -> list[int]:
        """Places of the words that begin, split or end a branch, a loop or a routine."""
        return [token.start for token in self.tokens if token.kind == "name" and token.word in BRANCHES]

    def lookup(self, scope: Scope | None, name: str) -> RapidData | None:
        """What a name stands for in a routine or in the module; None if it is not declared here."""
        declared = scope.get(name) if scope is not None else None
        return declared if declared is not None else self.data.get(name)

    def _declare(self, scope: Scope, data: RapidData, name: str) -> None:
        if name not in scope:
            scope[name] = data
            return
        scope[name].changes.append(((), data.start))  # local data of two modules in one file: either may be meant
        if data.node is not None:
            self.loose.append(data.node)

    def header(self, i: int = 0) -> int:
        """Number of the token behind the next header of a module, which may follow the header of older files."""
        tokens = self.tokens
        while tokens[i].kind != "end" and tokens[i].word != "module":
            i += 1
        if tokens[i].kind == "end":
            raise ProgramError("expected a RAPID module, found no MODULE", file=self.listing.parts[0].name)
        i += tokens[i + 1].kind == "number" and tokens[i + 1].end == tokens[i + 2].start  # generators name one 1_Job
        self._name(i + 1, "the name of the module")
        i += 2
        if tokens[i].word == "(":
            while tokens[i].word != ")":
                if tokens[i].kind == "end":
                    raise self.error(tokens[i].start, "expected ')' after the attributes of the module")
                i += 1
            i += 1
        return i

    def read(self) -> None:
        """Go through the module."""
        tokens, i = self.tokens, self.header()
        handlers: dict[str, Callable[[int], int]] = {
            **dict.fromkeys(["const", "pers", "var"], self._declaration),
            **dict.fromkeys(["proc", "func", "trap"], self._routine),
            **dict.fromkeys(["endproc", "endfunc", "endtrap"], self._routine_end),
            "record": self._record,
        }
        stack: list[str] = []
        while True:
            token = tokens[i]
            kind, word, start = token.kind, token.word, token.start
            if kind == "end":
                raise self.error(token.start, "the module has no ENDMODULE: the file is not whole")
            if kind == "name":
                if word in STRUCTURE and not self._is_member(i):
                    if stack:
                        raise self.error(token.start, f"expected {CLOSING[stack[-1]]!r}, found {self._found(i)}")
                    if word == "module":
                        raise self.error(token.start, "MODULE stands in a module: the end of that one is missing")
                    if word == "endmodule" and self.scope is not None:
                        raise self.error(token.start, "ENDMODULE stands in a routine: its end is missing")
                    if word == "endmodule" and tokens[i + 1].word != "module":
                        break
                    i = self.header(i) if word == "endmodule" else handlers[word](i) if word in handlers else i + 1
                elif word in self.instructions and not stack and not self._is_member(i):
                    i = self._move(i)
                elif not stack and self._is_assignment(i):
                    i = self._assignment(i)
                else:
                    if word in ("confj", "confl") and not self._is_member(i):
                        self.monitoring.append(Monitoring(self.scope, start, word[-1], tokens[i + 2].word != "off"))
                    if not stack and word not in HARMLESS and tokens[i - 1].word in _BEFORE_STATEMENT:
                        self.calls.append(i)
                    self._mention(i)
                    i += 1
            elif word == "[":
                node, i = self._list(i)
                self.loose.append(node)
            else:
                self._bracket(stack, i)
                i += 1
        if tokens[i + 1].kind != "end":
            spelling = self._found(i + 1)
            raise self.error(tokens[i + 1].start, f"expected the end of the file after ENDMODULE, found {spelling}")

    def _declaration(self, i: int) -> int:
        type_token, local = self._name(i + 1, "a data type"), self.tokens[i - 1].word == "local"
        name = self._name(i + 2, "a name")
        sizes: Subscripts = ()
        node, computed = None, None
        i += 3
        if self.tokens[i].word == "{":
            sizes, i = self._index(i)
        if self.tokens[i].word == ":=":
            if self.tokens[i + 1].word == "[":
                node, i = self._list(i + 1)
            else:
                computed = self.tokens[i + 1].start
                i = self._expression(i + 1, (";",))
        i = self._expect(i, ";")
        spelling = self.text[name.start : name.end]
        data = RapidData(spelling, type_token.word, name.start, sizes, node, computed, local)
        self._declare(self.data if self.scope is None else self.scope, data, name.word)
        return i

    def _is_assignment(self, i: int) -> bool:
        """Whether a name with indices and components stands before ``:=``."""
        if self._is_member(i):
            return False
        i += 1
        while i and self.tokens[i].word in ("{", "."):
            if self.tokens[i].word == "{":
                i = self._behind_index(i)
            else:
                i = i + 2 if self.tokens[i + 1].kind == "name" else 0
        return bool(i) and self.tokens[i].word == ":="

    def _assignment(self, i: int) -> int:
        name, constant = self.tokens[i], True
        index: Subscripts = ()
        i += 1
        if self.tokens[i].word == "{":
            index, i = self._index(i)
        while self.tokens[i].word != ":=":
            constant = False
            i = self._index(i)[1] if self.tokens[i].word == "{" else i + 2
        node = None
        if self.tokens[i + 1].word == "[":
            node, i = self._list(i + 1)
        else:
            i = self._expression(i + 1, (";",))
        i = self._expect(i, ";")
        self.assignments.append(Assignment(self.scope, name.word, index, node if constant else None, name.start))
        return i

    def _routine(self, i: int) -> int:
        start, word = self.tokens[i].start, self.tokens[i].word
        if self.scope is not None:
            raise self.error(start, f"{word.upper()} stands in a routine: the end of that one is missing")
        if word == "func":
            self._name(i + 1, "a data type")
            i += 1
        name = self._name(i + 1, "the name of the routine")
        self.scope = {}
        self.scopes.append(self.scope)
        self.routines.append((name.word, self.scope, start))
        return self._parameters(i + 2, self.scope) if self.tokens[i + 2].word == "(" else i + 2

    def _parameters(self, i: int, scope: Scope) -> int:
        name = None
        while self.tokens[i].word != ")":
            i += 1
            kind, word, start, _ = self.tokens[i]
            if kind == "end" or word == ";":
                raise self.error(start, f"expected ')', found {self._found(i)}")
            if kind == "name":
                name = self.tokens[i]
            elif word in (",", "\\", "|", ")") and name is not None:
                data = RapidData(self.text[name.start : name.end], "parameter", name.start)
                self._declare(scope, data, name.word)
                name = None
        return i + 1

    def _routine_end(self, i: int) -> int:
        if self.scope is None:
            raise self.error(self.tokens[i].start, f"{self.tokens[i].word.upper()} ends no routine")
        self.scope = None
        return i + 1

    def _record(self, i: int) -> int:
        start = self.tokens[i].start
        while self.tokens[i].word != "endrecord":
            if self.tokens[i].kind == "end":
                raise self.error(start, "RECORD has no ENDRECORD")
            i += 1
        return i + 1

    def _move(self, i: int) -> int:
        instruction = self.instructions[self.tokens[i].word]
        name = instruction.name
        start, stops = self.tokens[i].start, (",", "\\", ";")
        args: list[Arg] = []
        options: dict[str, Arg | None] = {}
        shifts: dict[int, Shifted] = {}
        i += 1
        while self.tokens[i].word != ";":
            if self.tokens[i].word == "\\":
                option = self._name(i + 1, "the name of an optional argument").word
                i += 2
                options[option] = None
                if self.tokens[i].word in (":=", "?"):
                    computed = self.tokens[i].word == "?"
                    arg, i = self._arg(i + 1, stops, option in ("wobj", "tool"))
                    options[option] = arg._replace(node=None, name=None) if computed else arg
            else:
                first = i
                arg, i = self._arg(i, stops, plain=True)
                args.append(arg)
                if (shift := self._shift(first, i)) is not None:
                    shifts[len(args) - 1] = shift
            if self.tokens[i].word == ",":
                i += 1
                if self.tokens[i].word in (",", ";"):
                    raise self.error(self.tokens[i].start, f"expected an argument of {name}, found {self._found(i)}")
            elif self.tokens[i].word not in ("\\", ";"):
                raise self.error(self.tokens[i].start, f"expected ',' or ';', found {self._found(i)}")
        roles = instruction.roles(len(args), options.get("tool") is not None)
        for role, arg in zip(roles or [ANY] * len(args), args, strict=True):
            if role not in POINTS and arg.name is not None and (role != TOOL):
                self.mentions.append(
                    Mention(self.scope, arg.name, () if None in arg.indices else arg.indices, arg.start)
                )
            if role not in POINTS and arg.node is not None:
                self.loose.append(arg.node)
        if roles is None:
            self.wrong.append((start, f"{name} is known as {' '.join(instruction.words)}, found {len(args)} arguments"))
            return i + 1
        points = [(role, arg) for role, arg in zip(roles, args, strict=True) if role in POINTS]
        tool = options.get("tool") or args[roles.index(TOOL)]
        move = MoveInstruction(name, start, self.scope, points, tool, options.get("wobj"), args, options)
        self.moves.append(move._replace(taught=instruction.taught))
        for k, shift in shifts.items():
            if roles[k] in (TO, VIA):
                self.shifted.append(shift)
                last = range(len(self.mentions) - 1, -1, -1)
                del self.mentions[next(k for k in last if self.mentions[k].start == shift.start)]
        return i + 1

    def _shift(self, first: int, behind: int) -> Shifted | None:
        """What the tokens of an argument shift, and by how much; None where they are nothing of the kind."""
        words = [token.word for token in self.tokens[first : first + 3]]
        if words[0] not in ("offs", "reltool") or words[1] != "(" or not self._is_data(first + 2):
            return None
        if any(token.word == "\\" for token in self.tokens[first:behind]):  # turned, too
            return None
        index: Subscripts = ()
        k = first + 3
        if self.tokens[k].word == "{":
            index, k = self._index(k)
        text = self.text[self.tokens[k].start : self.tokens[behind - 1].start]
        numbers = re.fullmatch(rf"{_SPACE},({_SIGNED}),({_SIGNED}),({_SIGNED})", text)
        if self.tokens[k].word != ",":
            return None
        values = None if numbers is None else tuple(float(re.sub(r"\s", "", number)) for number in numbers.groups())
        start = self.tokens[first + 2].start
        return Shifted(len(self.moves), words[2], index, start, words[0] == "reltool", values)

    def arguments(self, i: int) -> list[list[Token]]:
        """Tokens of each argument of a statement that begins at token i, without the optional ones."""
        out: list[list[Token]] = [[]]
        depth, optional = 0, False
        for token in itertools.islice(self.tokens, i + 1, None):
            if token.word in (";", "") or (token.word in STRUCTURE and depth == 0):
                break
            if depth == 0 and token.word in (",", "\\"):
                optional = token.word == "\\"
                if out[-1] and not optional:
                    out.append([])
                continue
            depth += (token.word in CLOSING or (token.word == "[" and token.kind == "symbol")) - (
                token.word in (")", "}", "]")
            )
            if not optional:
                out[-1].append(token)
        return [tokens for tokens in out if tokens]

    def _arg(self, i: int, stops: tuple[str, ...], plain: bool) -> tuple[Arg, int]:
        """An argument that begins at token i; names count as mentioned unless this is what the move is about."""
        node, name, start = None, None, self.tokens[i].start
        index: Subscripts = ()
        if self.tokens[i].word == "[":
            node, j = self._list(i)
        elif self.tokens[i].word == "*" and self.tokens[i + 1].word in stops:
            j = i + 1
        else:
            j = i + 1
            if self._is_data(i) and self.tokens[j].word == "{":
                j = self._behind_index(j)
            if plain and j and self._is_data(i) and self.tokens[j].word in stops:
                name = self.tokens[i].word
                index = self._index(i + 1)[0] if j > i + 1 else ()
            else:
                j = self._expression(i, stops)
        end = self.tokens[j - 1].end
        return Arg(node, name, index, start, self.quote(start, end), end), j

    def _found(self, i: int) -> str:
        token = self.tokens[i]
        end = token.start + 1 if token.kind == "list" else token.end
        return "the end of the file" if token.kind == "end" else repr(self.quote(token.start, end))

    def _expect(self, i: int, word: str) -> int:
        if self.tokens[i].word != word:
            raise self.error(self.tokens[i].start, f"expected {word!r}, found {self._found(i)}")
        return i + 1

    def _name(self, i: int, expected: str) -> Token:
        if not self._is_data(i):
            raise self.error(self.tokens[i].start, f"expected {expected}, found {self._found(i)}")
        return self.tokens[i]

    def _is_data(self, i: int) -> bool:
        """Whether token i can be the name of something."""
        return self.tokens[i].kind == "name" and self.tokens[i].word not in RESERVED

    def _is_member(self, i: int) -> bool:
        """Whether token i is a component after a dot or the name of an optional argument."""
        return self.tokens[i - 1].word in (".", "\\")

    def _bracket(self, stack: list[str], i: int) -> None:
        """Keep the brackets ``( )`` and ``{ }`` in pairs within a statement."""
        kind, word = self.tokens[i].kind, self.tokens[i].word
        if kind != "symbol":
            return
        if word in CLOSING:
            stack.append(word)
        elif word in ")}]":
            if not stack or CLOSING[stack.pop()] != word:
                raise self.error(self.tokens[i].start, f"{word!r} closes nothing")
        elif word == ";" and stack:
            raise self.error(self.tokens[i].start, f"expected {CLOSING[stack[-1]]!r}, found ';'")

    def _mention(self, i: int) -> None:
        """Note a name that stands for data; components after a dot and names of optional arguments do not."""
        if self.tokens[i].word not in RESERVED and not self._is_member(i):
            _, word, start, _ = self.tokens[i]
            self.mentions.append(Mention(self.scope, word, self._plain_index(i + 1), start))

    def _whole(self, i: int) -> int | None:
        """Value of a whole number; None for any other token."""
        word = self.tokens[i].word
        return int(word) if self.tokens[i].kind == "number" and word.isdecimal() and len(word) < 10 else None

    def _plain_index(self, i: int) -> Subscripts:
        """Index such as ``{1,2}`` that begins at token i, if it is all of plain whole numbers; else empty."""
        index: list[int | None] = []
        while self.tokens[i].word == ("," if index else "{") and self._whole(i + 1) is not None:
            index.append(self._whole(i + 1))
            i += 2
        return tuple(index) if index and self.tokens[i].word == "}" else ()

    def _expression(self, i: int, stops: tuple[str, ...]) -> int:
        """Walk over any expression to the first of ``stops`` outside brackets; returns the number of its token."""
        begin, operand = i, False
        stack: list[str] = []
        while True:
            kind, word, start, _ = self.tokens[i]
            symbol = kind == "symbol"
            if symbol and not stack and word in stops:
                if i == begin:
                    raise self.error(start, f"expected a value, found {self._found(i)}")
                return i
            structure = word in STRUCTURE and not self._is_member(i)
            if kind == "end" or structure or word in (";", "]") or (word == ":=" and not stack):
                expected = f"'{CLOSING[stack[-1]]}'" if stack else " or ".join(f"'{stop}'" for stop in stops)
                raise self.error(start, f"expected {expected}, found {self._found(i)}")
            value = not symbol and word not in OPERATORS
            if operand and (value or word == "["):
                raise self.error(start, f"expected an operator or '{stops[-1]}', found {self._found(i)}")
            if word == "[":
                _, i = self._list(i)
                operand = True
                continue
            if kind == "name":
                self._mention(i)
            self._bracket(stack, i)
            operand = value or word in (")", "}")
            i += 1

    def _list(self, i: int) -> tuple[Node, int]:
        """A list of values that begins at token i: its node and the number of the token behind it."""
        kind, _, begin, end = self.tokens[i]
        if self._level == DEEPEST:
            raise self.error(begin, f"more than {DEEPEST} lists within each other")
        if kind == "list":
            return Node(self._plain_items(begin, end), None, begin, end), i + 1
        nodes: list[Node] = []
        self._level += 1
        while True:
            i += 1
            node, i = self._list(i) if self.tokens[i].word == "[" else self._item(i)
            nodes.append(node)
            if self.tokens[i].word not in (",", "]"):
                raise self.error(self.tokens[i].start, f"expected ',' or ']', found {self._found(i)}")
            if self.tokens[i].word == "]":
                self._level -= 1
                return Node(nodes, None, begin, self.tokens[i].end), i + 1

    def _plain_items(self, begin: int, end: int) -> list[Node]:
        """Nodes of a list of plain numbers."""
        nodes, at = [], begin + 1
        for word_text in self.text[at : end - 1].split(","):
            word = word_text.strip()
            start = at if len(word) == len(word_text) else at + word_text.index(word)
            nodes.append(_NODE((None, float(word), start, start + len(word))))
            at += len(word_text) + 1
        return nodes

    def _item(self, i: int) -> tuple[Node, int]:
        j = self._expression(i, (",", "]"))
        start, end = self.tokens[i].start, self.tokens[j - 1].end
        signed = (
            j - i == 2
            and self.tokens[i].word in ("-", "+")
            and not any(char in self.text[start:end] for char in "!\r\n")
        )
        if self.tokens[j - 1].kind == "number" and (j - i == 1 or signed):
            number = float(self.tokens[j - 1].word)
            return Node(None, -number if self.tokens[i].word == "-" else number, start, end), j
        return Node(None, None, start, end), j

    def _index(self, i: int) -> tuple[Subscripts, int]:
        """Index that begins at token i: whole numbers, None for computed ones; and the number of the token behind."""
        indices: list[int | None] = []
        while not indices or self.tokens[i].word == ",":
            j = self._expression(i + 1, (",", "}"))
            indices.append(self._whole(i + 1) if j == i + 2 else None)
            i = j
        return tuple(indices), i + 1

    def _behind_index(self, i: int) -> int:
        """Number of the token behind the braces that begin at token i; 0 if they do not end in the statement."""
        depth = 0
        while self.tokens[i].word not in (";", ""):
            depth += (self.tokens[i].word == "{") - (self.tokens[i].word == "}")
            i += 1
            if depth == 0:
                return i
        return 0


KIND_OF: dict[str, TargetKind] = {"robtarget": "pose", "jointtarget": "joint"}
TYPE_OF: dict[TargetKind, str] = {"pose": "robtarget", "joint": "jointtarget"}
_PARTS: dict[TargetKind, tuple[tuple[int, str], ...]] = {
    "pose": ((3, "[x, y, z]"), (4, "[q1, q2, q3, q4]"), (4, "[cf1, cf4, cf6, cfx]"), (6, "[six external axes]")),
    "joint": ((6, "[six joints]"), (6, "[six external axes]")),
}


class Literals:
    """All targets in numbers of a module, and everything that gives a target another value."""

    def __init__(self, listing: Listing, instructions: Mapping[str, MotionInstruction] = MOTIONS) -> None:
        self.flow, self.reader = ControlFlow(listing), Reader(listing, instructions)
        """``reader``: the module as read. ``flow``: what looks like a target where none can be corrected, and moves to
        targets that cannot, are noted there.
        """
        self.source = listing.parts[0].name
        self.targets: list[Literal] = []
        """In the order in which they are come upon."""
        self.reader.read()
        self._collect()

    def _collect(self) -> None:
        """Find all literals and everything that gives a target another value."""
        reader = self.reader
        for scope in [reader.data, *reader.scopes]:
            for data in scope.values():
                if data.type in KIND_OF:
                    if data.node is not None:
                        self._fill(data, (), data.node)
                    elif data.computed is not None:
                        data.changes.append(((), data.computed))
        for assigned in reader.assignments:
            self._assignment(*assigned)
        for move in reader.moves:
            for role, arg in move.points:
                goal = reader.lookup(move.scope, arg.name) if role == WRITES and arg.name else None
                if goal is not None:
                    goal.changes.append((arg.indices, move.start))
        for start, reason in reader.wrong:
            self.flow.leave(start, "other", reader.listing.quote_line(start), reason)
        self.lessons = self._lessons()
        for node in reader.loose:
            if _looks_like_target(node):
                text = reader.quote(node.start, node.end)
                reason = "this is no move that is known" + self.lessons.get(reader.line(node.start), "")
                self.flow.leave(node.start, "other", text, reason)

    def _lessons(self) -> dict[int, str]:
        """Of each line with a statement that may be a move, the line of a table that would teach it."""
        reader = self.reader
        out: dict[int, str] = {}
        for i in reader.calls:
            words: list[str] = []
            unknown: list[int] = []  # arguments that may be a tool of another module
            for k, tokens in enumerate(reader.arguments(i)):
                first = tokens[0]
                data = reader.lookup(self._scope_at(first.start), first.word) if first.kind == "name" else None
                if first.kind == "name" and data is None and not _PREDEFINED.fullmatch(first.word) and len(tokens) == 1:
                    unknown.append(k)
                if first.word == "[" or (data is not None and data.type in KIND_OF):
                    words.append(TO)
                else:
                    is_tool = first.word == "tool0" or (data is not None and data.type == "tooldata")
                    words.append(TOOL if is_tool else f"argument{k + 1}")
            count = words.count(TO)
            if not 0 < count <= 2:
                continue
            if count == 2:
                words[words.index(TO)] = VIA
            if TOOL not in words and unknown:
                words[unknown[-1]] = TOOL
            if words.count(TOOL) == 1:
                name = reader.text[reader.tokens[i].start : reader.tokens[i].end]
                out[reader.line(reader.tokens[i].start)] = teaching("rapid", name, words)
        return out

    def _scope_at(self, at: int) -> Scope | None:
        """Data of the routine at a place in the text."""
        before = [scope for _, scope, start in self.reader.routines if start <= at]
        return before[-1] if before else None

    def _assignment(self, scope: Scope | None, name: str, index: Subscripts, node: Node | None, start: int) -> None:
        data = self.reader.lookup(scope, name)
        if data is not None and data.type in KIND_OF and node is not None:
            self._fill(data, index, node)
        elif data is not None:
            data.changes.append((index, start))
        if (data is None or data.type == "parameter") and node is not None and _looks_like_target(node):
            where = "is not declared in this module" if data is None else "is a parameter of the routine"
            self.flow.leave(start, "assignment", name, where)

    def _fill(self, data: RapidData, index: Subscripts, node: Node) -> None:
        """Take the literals of a declaration or an assignment, element by element."""
        sizes = data.sizes[len(index) :] if not index or len(index) == len(data.sizes) else ()
        kind = KIND_OF[data.type]
        pending = [(index, node, sizes)]
        while pending:
            index, node, sizes = pending.pop()
            if sizes:
                if node.items is None:
                    data.changes.append((index, node.start))
                    continue
                if sizes[0] is not None and len(node.items) != sizes[0]:
                    reason = f"expected {sizes[0]} elements, found {len(node.items)}"
                    self.flow.leave(node.start, data.type, data.spelling, reason)
                    data.changes.append((index, node.start))
                    continue
                new = [((*index, k + 1), node_of_element, sizes[1:]) for k, node_of_element in enumerate(node.items)]
                pending.extend(reversed(new))
                continue
            inside = ",".join("?" if k is None else str(k) for k in index)
            name = data.spelling + (f"{{{inside}}}" if index else "")
            literal, reason = self.literal(node, kind, name)
            if reason:
                self.flow.leave(node.start, data.type, name, reason)
            if literal is None:
                data.changes.append((index, node.start))
            else:
                data.entries.append((index, literal))

    def literal(self, node: Node, kind: TargetKind, name: str) -> tuple[Literal | None, str]:
        """The literal that a list of values is, or None; and what is wrong where it is no target at all."""
        if node.items is None:
            return None, ""
        if wrong := self._wrong_part(node.items, kind):
            return None, wrong
        values = [component.items for component in (node.items[:2] if kind == "pose" else node.items[:1])]
        numbers = [leaf for leaves in values for leaf in leaves or ()]
        if any(leaves is None for leaves in values):
            return None, ""
        for leaf in numbers:
            if leaf.items is not None:
                return None, f"expected a number, found {self.reader.quote(leaf.start, leaf.end)}"
        if any(leaf.number is None for leaf in numbers):
            return None, ""
        leaves = self._configuration(node.items[2]) if kind == "pose" else []
        axes = node.items[-1]
        literal = Literal(
            name,
            kind,
            node.start,
            [Number(leaf.number, leaf.start, leaf.end) for leaf in numbers if leaf.number is not None],
            ConfData(*(int(leaf.number or 0) for leaf in leaves)) if leaves else None,
            tuple((leaf.start, leaf.end) for leaf in leaves),
            self.reader.text[axes.start : axes.end],
            {
                f"e{k}": leaf.number
                for k, leaf in enumerate(axes.items or (), 1)
                if leaf.number is not None and abs(leaf.number) < ABSENT
            },
        )
        absent = [k for k, value in enumerate(literal.written, start=1) if abs(value) >= ABSENT]
        if kind == "joint" and absent:
            literal.conflicts.append(f"joint {absent[0]} has no value (9E9)")
        self.targets.append(literal)
        return literal, ""

    def _wrong_part(self, components: list[Node], kind: TargetKind) -> str:
        """Which part of a list is none of a target; empty where all are."""
        if len(components) != len(_PARTS[kind]):
            expected = "[" + ", ".join(text for _, text in _PARTS[kind]) + "]"
            return f"expected {expected}, found {len(components)} parts"
        for component, (size, text) in zip(components, _PARTS[kind], strict=True):
            if component.number is not None or (component.items is not None and len(component.items) != size):
                return f"expected {text}, found {self.reader.quote(component.start, component.end)}"
        return ""

    def _configuration(self, component: Node) -> list[Node]:
        """The four numbers of configuration data; empty if they are computed, or not whole."""
        numbers = [leaf.number for leaf in component.items or () if leaf.number is not None]
        if component.items is None or len(numbers) < len(component.items):
            return []
        return [] if any(abs(number) > ABSENT * 100 or number % 1 for number in numbers) else component.items


def _looks_like_target(node: Node) -> bool:
    sizes = [len(component.items) if component.items is not None else None for component in node.items or []]
    return sizes in ([3, 4, 4, 6], [6, 6])


class Task:
    """The modules of a task, and what they see of one another.

    Data that a module declares outside its routines, without ``LOCAL``, are seen by all modules of the task that do not
    declare the name themselves. A target is followed there where one file alone declares it; uses, mentions and new
    values in other files then count as those of its own module do; tools and work objects must mean the same frame in
    all files.
    """

    def __init__(self, modules: Sequence[Literals], setup: ControllerSetup) -> None:
        self.modules, self.setup, self.readers = modules, setup, [module.reader for module in modules]
        tools, work_objects = {"tool0": np.eye(4), **setup.tools}, {"wobj0": np.eye(4), **setup.work_objects}
        self.given = {"tooldata": tools, "wobjdata": work_objects}
        """Frames from the caller, which go before, and those that are always there, by type and by name."""
        self.frames = {module.source: frames_in_numbers(module.reader) for module in modules}
        """Tools and work objects that each file defines in numbers, by file, by type and by name."""
        self.calls, self.loads = Calls(setup.harmless, HARMLESS), LoadFlow()
        self.public: dict[str, list[tuple[RapidData, Literals]]] = {}
        """Data that other modules see, by their names, with the modules that declare them."""
        for module in modules:
            learn(module.reader, self.calls)
            for name, data in module.reader.data.items():
                if not data.local:
                    self.public.setdefault(name, []).append((data, module))
        self.grips = any(token.word == "gripload" for reader in self.readers for token in reader.tokens)
        """Whether a module says what the robot carries."""
        totals = (_total_load(move) for reader in self.readers for move in reader.moves)
        self.loads.names_any = self.grips or any(total is not None for total in totals)

    @functools.cached_property
    def first(self) -> list[Scope | None]:
        """Data of the routine with which the program begins, ``main`` or the only one that moves; of several: all."""
        mains = [scope for reader in self.readers for name, scope, _ in reader.routines if name == "main"]
        return [*mains] or [*{id(move.scope): move.scope for reader in self.readers for move in reader.moves}.values()]

    def assigns(self, name: str) -> bool:
        """Whether a module assigns a value to a name."""
        return any(change.name == name for reader in self.readers for change in reader.assignments)

    def frame_problem(self, type_name: str, name: str) -> str:
        """What speaks against a tool or work object of a move here to a target there; empty where nothing does."""
        if name in self.given[type_name]:
            return ""
        declared = [reader for reader in self.readers if name in reader.data]
        definitions = [types[type_name][name] for types in self.frames.values() if name in types[type_name]]
        title = "tool" if type_name == "tooldata" else "work object"
        if not definitions or len(definitions) < len(declared):
            return f"the {title} {name} is not defined in numbers in these modules"
        if any(not np.array_equal(T, definitions[0]) for T in definitions):
            return f"the {title} {name} is another one in another module"
        return f"the {title} {name} is changed" if self.assigns(name) else ""


_QUOTED = 3  # mentions of a target that are quoted before the rest is counted


class InOrder(NamedTuple):
    """A move in the order of the text: the targets of its points, and the move before with its target, where known."""

    move: MoveInstruction
    ends: list[Literal | None]
    before: tuple[MoveInstruction, Target] | None


class Uses:
    """The uses of the targets of a module of a task."""

    def __init__(self, literals: Literals, task: Task) -> None:
        self.task, self.literals, self.reader, self.flow = task, literals, literals.reader, literals.flow
        own, others = task.frames[literals.source], task.frames.values()
        self.given = {
            kind: {name: T for types in others for name, T in types[kind].items() if name not in own[kind]} | given
            for kind, given in task.given.items()
        }
        """Frames that the module does not define itself, by type and by name."""
        self.flow.split_points, self.flow.first_begins = task.setup.split_points, True
        self.flow.calls, self.flow.loads = task.calls, task.loads
        self.in_order: list[InOrder] = []
        """The moves as they stand in the text."""
        self._shifted: dict[tuple[int, str], Literal | None] = {}

    def _elsewhere(self, name: str) -> list[tuple[RapidData, str]]:
        """What other modules declare by a name that this one does not, with their files."""
        found = self.task.public.get(name, ()) if name not in self.reader.data else ()
        return [(data, Path(module.source).name) for data, module in found if module is not self.literals]

    def _of_others(self, name: str) -> RapidData | None:
        """The targets that a name stands for in the one other module that declares it."""
        found = self._elsewhere(name)
        return found[0][0] if len(found) == 1 and found[0][0].type in KIND_OF else None

    def _against(self, name: str, index: Subscripts, reason: str) -> None:
        """Note what this module does to targets of others but to move to them."""
        data = self._of_others(name)
        for literal in [] if data is None else data.literals(index):
            literal.conflicts.append(reason)

    def gather(self) -> None:
        """Give every literal its uses, those of other modules, too.

        A move that uses what cannot be its target, its tool or its work object is left.
        """
        self._shifts()
        self._mentions()
        self._follow()

    def _follow(self) -> None:
        """Take the moves in the order of the text, with the branches, calls and loads between them."""
        reader, flow = self.reader, self.flow
        flow.previous = None
        routines = {start: (name, scope) for name, scope, start in reader.routines}
        waiting = list(reversed(reader.moves))
        scope: Scope | None = None
        for i, step in steps(reader):
            _, word, start, _ = reader.tokens[i]
            while waiting and waiting[-1].start <= start:
                self._move(waiting.pop())
            if step == "name in a text":
                flow.forget()
                flow.loads.call("%", True, may_set_load("a routine by its name in a text", reader.line(start)))
            elif step == "end of IF":  # the move behind it may not have been made
                flow.close(start)
                flow.forget()
            elif step == "label" or word in _JUMPS:
                flow.label(start)
            elif word == "gripload":
                flow.carry(self._load_named(scope, i + 1), start)
            elif step == "call":
                flow.call(word, reader.text[start : start + len(word)], start)
            elif word in _OPENING:
                flow.open(word in ("for", "while"))
            elif word in _CLOSING:
                flow.close(start)
            elif word in ("elseif", "else", "case", "default"):
                flow.alternative()
            elif start in routines:
                name, scope = routines[start]
                flow.restart(name, Load(0.0) if name == "main" else None)  # a start from main sets load0
                flow.previous = START if len(self.task.first) == 1 and self.task.first[0] is scope else None
            elif step == "branch":
                flow.previous = None
                if word == "return":
                    flow.loads.returns()
                elif word in ("endproc", "endfunc", "endtrap"):
                    flow.loads.end()
                    scope = None
            elif not self.in_order or self.in_order[-1].move.start != start:  # a move with other arguments than known
                flow.forget()
        for move in reversed(waiting):
            self._move(move)

    def _shifts(self) -> None:
        """Note moves that shift a target of this module; other shifts are uses in another way."""
        reader = self.reader
        for shift in reader.shifted:
            move = reader.moves[shift.move]
            data = reader.lookup(move.scope, shift.name)
            literals = data.literals(shift.indices) if data is not None and data.type == "robtarget" else []
            if not literals or data is None or data.changes or len(shift.indices) != len(data.sizes):
                index = () if None in shift.indices else shift.indices
                reader.mentions.append(Mention(move.scope, shift.name, index, shift.start))
                continue
            tool, wobj, _, _ = self._frames(move)
            T = frames.transform(None, np.array(shift.numbers or (0.0, 0.0, 0.0)) * MM)
            left, right = (np.eye(4), T) if shift.in_tool else (T, np.eye(4))
            known = shift.numbers is not None
            arg = next(arg for _, arg in move.points if arg.start <= shift.start < arg.end)
            own = self.flow.shift(
                [Shift(each, move.start, move.name, arg.text, left, right, known, tool, wobj) for each in literals],
                (arg.start, arg.end),
            )
            if isinstance(own, Literal):
                own.mentioned, own.monitored = [], set()
                self.literals.targets.append(own)
            self._shifted[move.start, arg.text] = own if isinstance(own, Literal) else None

    def _move(self, move: MoveInstruction) -> None:
        """Give the literals that a move goes to this use, or report what is in the way."""
        reader = self.reader
        kind: TargetKind = "joint" if move.name.endswith("AbsJ") else "pose"
        line = reader.line(move.start)
        tool, wobj, held, unclear = self._frames(move)
        use = Use(line, reader.listing.column(move.start), move.name, "to", tool, wobj, held=held)
        unknown = unclear if kind == "pose" else ""
        carried = self._carrying(move, tool, held)
        points: list[tuple[list[Literal], bool]] = []
        """For each point the literals that it may stand for, and whether it may be another place."""
        monitored, file = self._monitored(move) if kind == "pose" else True, Path(self.literals.source).name
        for role, arg in move.points:
            if role == WRITES:
                continue
            data = self._of_other_module(move, arg, kind)
            if data is not None:
                literals, against = data.literals(arg.indices), self._against_other(data, arg, use, unknown)
                reason = "; ".join(against) or ("" if literals else "it has no value in numbers")
                points.append(([], True))
            else:
                literals, reason = self._goals(move, arg, kind, line)
                own = self._shifted.get((move.start, arg.text))
                if own is not None and not unknown:
                    literals, reason = [own], ""
                points.append((literals, bool(reason)))
                if own is None and (move.start, arg.text) in self._shifted and not unknown:
                    continue
                against = [text for text in (reason, unknown) if text]
                reason = reason or unknown
            if reason:
                self.flow.leave(move.start, move.name, arg.text, reason)
            for literal in literals:
                literal.monitored.add(monitored)
                literal.inverted |= held and kind == "pose"
                literal.uses.append(
                    replace(use, role="via" if role == VIA else "to", file="" if data is None else file)
                )
                literal.carried.append(carried)
                literal.after += [] if data is None else [None]
                literal.conflicts.extend(against)
        self._stops(move, points)

    def _stops(self, move: MoveInstruction, points: Sequence[tuple[list[Literal], bool]]) -> None:
        """Note the stops of a move at its points, and the move before where the arm comes from there."""
        flow = self.flow
        ends = [literals[0] if len(literals) == 1 and not computed else None for literals, computed in points]
        before = flow.previous if self.in_order and flow.previous is not START else None
        self.in_order.append(InOrder(move, ends, None if before is None else (self.in_order[-1].move, before)))
        for (literals, _), end in zip(points, ends, strict=True):
            before = None if end is None else flow.previous
            for literal in literals or (None,):
                flow.previous = before
                flow.stop(literal, move.start)
            flow.previous = end
        if move.name.startswith("Search"):  # it ends where something was found
            flow.forget()

    def _carrying(self, move: MoveInstruction, tool: str | None, held: bool) -> Carrying:
        """What the robot carries in a move: the part, and by itself the tool (its ``tload``)."""
        ways = self.flow.loads.now if self.task.grips else frozenset([None])
        if not self.flow.loads.names_any:
            return Carrying(ways)
        total = _total_load(move)
        if total is not None:
            self.flow.names_loads.append(move.start)
            ways = frozenset([unknown_load(f"\\TLoad:={total.text} says the load of the move alone")])
        data = next((reader.data[tool] for reader in self.task.readers if tool in reader.data), None)
        of_tool = unknown_load(f"the tool {tool} has no load in numbers in these modules")
        if tool == "tool0":
            of_tool = Load(0.0)
        elif data is not None and data.node is not None and len(data.node.items or ()) == 3 and not data.changes:
            of_tool = _load((data.node.items or [])[2])
        return Carrying(ways, of_tool, "" if held or tool is None else tool)

    def _load_named(self, scope: Scope | None, i: int) -> Load:
        """The load that an argument is."""
        reader = self.reader
        token = reader.tokens[i]
        if token.word == "load0":
            return Load(0.0)
        if token.word == "[":
            return _load(reader._list(i)[0])
        data = reader.lookup(scope, token.word)
        if data is None:
            others = [other.data[token.word] for other in self.task.readers if token.word in other.data]
            data = others[0] if len(others) == 1 else None
        changed = data is not None and (data.changes or self.task.assigns(token.word))
        if data is None or data.node is None or data.type != "loaddata" or changed:
            text = reader.text[token.start : token.end]
            return unknown_load(
                f"the load {text} of GripLoad in line {reader.line(token.start)} is not in numbers that stay"
            )
        return _load(data.node)

    def _monitored(self, move: MoveInstruction) -> bool | None:
        """Whether the configuration of a pose counts in a move; None where that depends on who calls the routine."""
        moves = "j" if _JOINT_MOVE.search(move.name) else "l"
        every = [switch for reader in self.task.readers for switch in reader.monitoring]
        switches = [switch for switch in every if switch.moves == moves]
        if all(switch.on for switch in (every if move.taught else switches)):
            return True
        if move.taught:  # which kind of move it is, is not known
            return None
        own = [switch for switch in self.reader.monitoring if switch.moves == moves and switch.scope is move.scope]
        before = [switch for switch in own if switch.start < move.start]
        if not before:
            return None
        first, last = before[0], before[-1]
        branches = self.reader.branches
        straight = bisect.bisect(branches, last.start) == bisect.bisect(branches, move.start)
        from_begin = next((start for _, scope, start in self.reader.routines if scope is move.scope), 0)
        alike = bisect.bisect(branches, from_begin) == bisect.bisect(branches, first.start)
        if not straight and not (alike and all(switch.on is first.on for switch in own)):
            return None
        others = [switch for switch in switches if switch.scope is not move.scope]  # a routine that is called, or calls
        return last.on if all(switch.on is last.on for switch in others) else None

    def _of_other_module(self, move: MoveInstruction, arg: Arg, kind: TargetKind) -> RapidData | None:
        """What an argument names in another module; None where it is no target there."""
        if arg.name is None or self.reader.lookup(move.scope, arg.name) is not None:
            return None
        data = self._of_others(arg.name)
        return data if data is not None and KIND_OF[data.type] == kind and len(arg.indices) == len(data.sizes) else None

    def _against_other(self, data: RapidData, arg: Arg, use: Use, unknown: str) -> list[str]:
        """What speaks against a use of another module's target."""
        frames = (("tooldata", use.tool), ("wobjdata", use.work_object)) if data.type == "robtarget" else ()
        against = [f"{unknown} of {Path(self.literals.source).name}"] if unknown else []
        against += [problem for kind, name in frames if name and (problem := self.task.frame_problem(kind, name))]
        changed = any(may_be(index, arg.indices) for index, _ in data.changes)
        return [*against, *(["it is computed or changed in its own module"] if changed else [])]

    def _goals(self, move: MoveInstruction, arg: Arg, kind: TargetKind, line: int) -> tuple[list[Literal], str]:
        """Literals that an argument stands for, and why these are not all, or not to be changed."""
        reader = self.reader
        if arg.node is not None:
            literal, wrong = self.literals.literal(arg.node, kind, f"of {move.name} in line {line}")
            return ([], wrong or f"its numbers are computed: {arg.text}") if literal is None else ([literal], "")
        if arg.name is None:
            if arg.text == "*":
                return [], "the position * stands in the controller only"
            return [], f"its target is computed: {arg.text}"
        data = reader.lookup(move.scope, arg.name)
        if data is None:
            return [], f"{arg.text} is not declared in this module"
        if data.type == "parameter":
            return [], f"{arg.text} is a parameter of the routine"
        if KIND_OF.get(data.type) != kind:
            return data.literals(()), f"{arg.text} is declared as {data.type}"
        if len(arg.indices) != len(data.sizes):
            message = f"{data.spelling} has {len(data.sizes)} indices, but {arg.text} has {len(arg.indices)}"
            return data.literals(()), message
        literals = data.literals(arg.indices)
        changes = sorted(position for index, position in data.changes if may_be(index, arg.indices))
        if changes:
            return literals, f"{arg.text} is computed or changed in line {reader.line(changes[0])}"
        return literals, "" if literals else f"{arg.text} has no value in this module"

    def _frames(self, move: MoveInstruction) -> tuple[str | None, str | None, bool, str]:
        """What is on the flange, what stands, whether the robot holds the part; and why they are not known."""
        tool, no_tool = self._frame_name(move, move.tool, "tooldata", "tool")
        wobj, no_wobj = self._frame_name(move, move.work_object, "wobjdata", "work object")
        if tool is None or wobj is None:
            return tool, wobj, False, no_tool or no_wobj
        on_flange = self._is_on_flange("tooldata", tool), self._is_on_flange("wobjdata", wobj)
        if on_flange == (False, True):
            return wobj, tool, True, ""
        if on_flange == (False, False):
            wrong = f"the tool {tool} is not held by the robot (robhold FALSE), and the work object {wobj} neither"
            return None, None, False, wrong
        return tool, wobj, False, f"the robot holds both {tool} and {wobj} (robhold TRUE)" if on_flange[1] else ""

    def _is_on_flange(self, type_name: str, name: str) -> bool:
        """Whether the robot holds a tool or work object."""
        other = next(key for key in self.given if key != type_name)
        if name not in self.given[type_name] and name in self.given[other]:
            return other == "tooldata"
        data = self.reader.data.get(name)
        if name in self.given[type_name] or data is None or data.type != type_name:
            return type_name == "tooldata"
        return is_on_flange(self.reader, data)

    def _frame_name(self, move: MoveInstruction, arg: Arg | None, type_name: str, title: str) -> tuple[str | None, str]:
        """Name of a tool or work object, or None and why there is no one name."""
        if arg is None:
            return "wobj0", ""
        if arg.name is None or arg.indices:
            return (
                None,
                f"the {title} of {move.name} in line {self.reader.line(move.start)} is computed: {arg.text}",
            )
        data = self.reader.lookup(move.scope, arg.name)
        if data is None or (arg.name in self.given[type_name] and data.type != "parameter"):
            return arg.name, ""
        if data.type == "parameter" or self.reader.data.get(arg.name) is not data:
            kind = "a parameter of" if data.type == "parameter" else "declared in"
            return None, f"the {title} {arg.text} is {kind} the routine"
        if data.changes:
            return None, f"the {title} {arg.text} is changed in line {self.reader.line(data.changes[0][1])}"
        if data.type != type_name:
            return None, f"expected a {type_name}, but {arg.text} is declared as {data.type}"
        return arg.name, ""

    def _mentions(self) -> None:
        """Note where a target is used in another way than as that of a move, changed by another module, or not sure."""
        reader, file = self.reader, Path(self.literals.source).name
        for scope, name, index, start in reader.mentions:
            data = reader.lookup(scope, name)
            if data is None:
                self._against(name, index, f"line {reader.line(start)} of {file} uses it in another way")
            for literal in data.literals(index) if data is not None else ():
                literal.mentioned.append(start)
        changes = [(change.scope, change.name, change.indices, change.start) for change in reader.assignments]
        for move in reader.moves:
            for role, arg in move.points:
                if arg.name and reader.lookup(move.scope, arg.name) is None:
                    self._declared_twice(arg.name, f"line {reader.line(move.start)} of {file}")
                if role == WRITES and arg.name:
                    changes.append((move.scope, arg.name, arg.indices, move.start))
        for scope, name, index, start in changes:
            if reader.lookup(scope, name) is None:
                self._against(name, index, f"line {reader.line(start)} of {file} gives it another value")

    def _declared_twice(self, name: str, where: str) -> None:
        """A move names what may be a target that several modules declare."""
        found = self._elsewhere(name)
        if len(found) > 1 and any(data.type in KIND_OF for data, _ in found):
            reason = f"{where} uses this name, which {' and '.join(file for _, file in found)} declare"
            for data, _ in found:
                for _, literal in data.entries:
                    literal.conflicts.append(reason)

    def module(self, arm: Arm | None) -> Module:
        """The module, once the uses of all modules are gathered."""
        reader, literals, listing, setup = self.reader, self.literals.targets, self.reader.listing, self.task.setup
        self.flow.settle()
        complete(literals, listing, ABB)
        for literal in literals:
            if literal.kind == "pose" and literal.uses and not literal.configuration and literal.monitored != {False}:
                literal.conflicts.append("its configuration is computed, or not of whole numbers")
            lines = {reader.line(start): start for start in sorted(literal.mentioned)}
            quoted = list(lines.items())[:_QUOTED]
            literal.conflicts += [
                f"line {line} uses it in another way: {listing.quote_line(start)}{self.literals.lessons.get(line, '')}"
                for line, start in quoted
            ]
            if len(lines) > _QUOTED:
                literal.conflicts.append(f"so do {len(lines) - _QUOTED} more lines")
            literal.conflicts = list(dict.fromkeys(literal.conflicts))
        declared = self._declared_frames()
        given, world = (self.given["tooldata"], self.given["wobjdata"]), setup.T_world_base
        available = ControllerSetup(*given, unknown_frames(), T_world_base=world)
        tools, work_objects = needed_frames(literals, available, declared["tooldata"], declared["wobjdata"])
        targets = tuple(sorted(literals, key=lambda literal: literal.start))
        header = reader.tokens[reader.header() - 1].end
        reader.tokens.clear()  # nothing below asks for them, and the module keeps the reader
        return Module(
            source=self.literals.source,
            listing=listing,
            maker=ABB,
            targets=targets,
            tools=tools,
            work_objects=work_objects,
            order=self.flow.order(targets),
            moves_left=tuple(sorted(self.flow.moves_left, key=lambda move: move.line)),
            notes=_notes(reader),
            fingerprint=_mark_of(reader),
            mark_at=header,
            arm=arm,
            own_model=setup.own_model,
            start=setup.start,
            assumed=setup.posture,
            shifts=tuple(self.flow.shifts),
            loads=self.flow.loads,
            names_loads=tuple(self.flow.names_loads),
            T_tip_flange=np.eye(4),
            moves=functools.cache(lambda: paths(reader, self.in_order, targets, tools)),
        )

    def _declared_frames(self) -> dict[str, dict[str, FloatArray]]:
        """Tools and work objects of this module that its targets use: of poses all, of joints those that are known."""
        out: dict[str, dict[str, FloatArray]] = {"tooldata": {}, "wobjdata": {}}
        for literal in self.literals.targets:
            for use in literal.uses if literal.correctable else ():
                for type_name, name in (("tooldata", use.tool), ("wobjdata", use.work_object)):
                    if (
                        name is None
                        or name in (*out[type_name], *self.given[type_name])
                        or name not in self.reader.data
                    ):
                        continue
                    try:
                        out[type_name][name] = read_frame(self.reader, self.reader.data[name])
                    except ValueError as problem:
                        literal.conflicts += [str(problem)] if literal.kind == "pose" else []
        return out


def read_frame(reader: Reader, data: RapidData) -> FloatArray:
    """Frame of a tool on the flange or of a work object in the base.

    Parameters
    ----------
    reader : Reader
    data : RapidData
        Of the type ``tooldata`` or ``wobjdata``.

    Returns
    -------
    ndarray, shape (4, 4)
        ``T_tip_tcp``, or ``T_base_wobj`` = user frame times object frame; metres. A fixed tool is in the base, a work
        object that the robot holds in the tip link.

    Raises
    ------
    ValueError
        If it does not stand there in numbers, or is of a kind that is not supported.
    """
    tool = data.type == "tooldata"
    title = f"{'tool' if tool else 'work object'} {data.spelling} of line {reader.line(data.start)}"
    nodes = data.node.items if data.node is not None else None
    if nodes is None or len(nodes) != (3 if tool else 5):
        option = f"--{'tool' if tool else 'wobj'} {data.spelling}=…"
        raise ValueError(f"{title} has no frame in numbers: give it with {option}")
    texts = [reader.text[node_of_item.start : node_of_item.end].lower() for node_of_item in nodes]
    if texts[0] not in ("true", "false"):
        raise ValueError(f"{title}: expected TRUE or FALSE for robhold, found {texts[0]}")
    if not tool and texts[1] != "true":
        moved = f"is moved by a mechanical unit (ufprog {texts[1].upper()})"
        raise ValueError(f"{title} {moved}: this is not supported")
    T = np.eye(4)
    for node in nodes[1:2] if tool else nodes[3:5]:
        lists = [leaf_nodes.items or [] for leaf_nodes in node.items or []]
        leaves = [leaf.number for leaf_nodes in lists for leaf in leaf_nodes if leaf.number is not None]
        if [len(leaf_nodes) for leaf_nodes in lists] != [3, 4] or len(leaves) < 7:
            expected = "a frame [[x, y, z], [q1, q2, q3, q4]] in numbers"
            spelling = reader.quote(node.start, node.end)
            raise ValueError(f"{title}: expected {expected}, found {spelling}")
        problem = ABB.problem("pose", leaves)
        if problem:
            raise ValueError(f"{title}: {problem}")
        T = T @ ABB.frame(leaves)
    return T


def is_on_flange(reader: Reader, data: RapidData) -> bool:
    """Whether the robot holds a tool or work object (``robhold``); as usual where that does not stand there."""
    nodes = data.node.items if data.node is not None else None
    text = reader.text[nodes[0].start : nodes[0].end].lower() if nodes else ""
    return text == "true" if text in ("true", "false") else data.type == "tooldata"


def frames_in_numbers(reader: Reader) -> dict[str, dict[str, FloatArray]]:
    """Tools and work objects that a module defines in numbers, by name: ``tooldata`` what is on the flange."""
    out: dict[str, dict[str, FloatArray]] = {"tooldata": {}, "wobjdata": {}}
    for name, declared in reader.data.items():
        if declared.type in out:
            with suppress(ValueError):  # targets that need it are left
                mount = "tooldata" if is_on_flange(reader, declared) else "wobjdata"
                out[mount][name] = read_frame(reader, declared)
    return out


_BRANCHES = (
    "if then elseif else endif for endfor while endwhile test case default endtest goto return error undo backward "
    "raise retry trynext exit proc endproc func endfunc trap endtrap connect"
)
_HARMLESS = (
    "accset add bitclear bitset bookerrno clear clkreset clkstart clkstop close confj confl decr enddo errlog errwrite "
    "gripload idisable ienable incr invertdo isignaldi isleep iwatch open pathresol pulsedo reset rewind "
    "setao setdo setgo set singarea softact softdeact speedrefresh startload tperase tpshow tpwrite triggequip "
    "triggint triggio triggspeed unload velset waitai waitao waitdi waitdo waitgi waitgo waitrob waittime waituntil "
    "worldacclim write writebin writestrbin"
)
_OPENING, _CLOSING = frozenset(["if", "for", "while", "test"]), frozenset(["endif", "endfor", "endwhile", "endtest"])
_ROUTINES = frozenset(["proc", "func", "trap"])
_DECLARING = frozenset(["const", "pers", "var", "local", "task"])
_JUMPS = frozenset(["goto", "error", "undo", "backward", "raise", "retry", "trynext", "connect"])
_BEFORE = _CLOSING | {"then", "else", "do", "default", "error", "undo", "backward"}
"""Words that a statement may follow without a semicolon."""
_BEFORE_STATEMENT = _BEFORE | {";", ")", ":", ""}
BRANCHES = frozenset(_BRANCHES.split())
HARMLESS = frozenset(_HARMLESS.split())
"""Instructions that do not move the robot; any other name may be a routine that does."""


def steps(reader: Reader) -> Iterator[tuple[int, str]]:
    """What a program is followed by: tokens by their numbers, each with what it is.

    It is a ``branch`` (any of `BRANCHES`), the ``end of IF`` without THEN, or begins a statement: a ``move``, a
    ``label``, a ``name in a text`` (of a routine), or a ``call``, which may be any other instruction as well.
    """
    begin, compact, condition, head = True, False, False, False
    for i, (kind, word, _, _) in enumerate(reader.tokens[:-1]):
        if condition and (kind == "name" or word == "%") and _behind_value(reader, i):
            begin, condition = True, False  # the statement of an IF without THEN
        if kind == "name":
            if word in BRANCHES and not reader._is_member(i):
                condition = word == "if" and not _has_then(reader, i)
                compact = compact or condition
                head = word in _ROUTINES
                yield i, "branch"
            elif begin and word in reader.instructions:
                yield i, "move"
            elif begin and word not in _DECLARING and not reader._is_assignment(i):
                yield i, "label" if reader.tokens[i + 1].word == ":" else "call"
            begin = word in _BEFORE or reader.tokens[i - 1].word == "trap"
            continue
        if begin and word == "%":
            yield i, "name in a text"
        if word == ";" and compact:
            yield i, "end of IF"
            compact = condition = False
        begin = word in (";", ":") or (head and word == ")")
        head = head and word != ")"


def _behind_value(reader: Reader, i: int) -> bool:
    """Whether a token stands where an operator would have to, behind a whole value."""
    before, word = reader.tokens[i - 1], reader.tokens[i].word
    if word in OPERATORS or reader._is_member(i):
        return False
    return before.word in (")", "}", "]") or (before.kind != "symbol" and before.word not in (*OPERATORS, "if"))


def learn(reader: Reader, calls: Calls) -> None:
    """Note which routines of a module move the robot, and what they call."""
    name = ""
    for i, step in steps(reader):
        word = reader.tokens[i].word
        if step == "branch" and word in _ROUTINES:
            name = reader.tokens[i + (2 if word == "func" else 1)].word
            calls.learn(name)
        elif step == "name in a text" and name:
            calls.learn(name, moves=True, sets_loads=True)
        elif step in ("move", "call") and name:
            calls.learn(name, [word] if step == "call" else [], moves=step == "move", sets_loads=word == "gripload")


def _total_load(move: MoveInstruction) -> Arg | None:
    """What the option ``TLoad`` of a move names; ``load0`` leaves the load to the tool."""
    total = move.options.get("tload")
    return None if total is None or total.text.lower() == "load0" else total


def _load(node: Node) -> Load:
    """The load that ``loaddata`` in numbers are: mass in kg, centre of gravity in mm."""
    items = node.items or []
    mass = items[0].number if items else None
    leaves = (items[1].items if len(items) > 1 else None) or []
    centre = [leaf.number * MM for leaf in leaves if leaf.number is not None]
    if mass is None or len(centre) != 3:
        return unknown_load("its load is not in numbers")
    return load_of(mass, centre)


def _has_then(reader: Reader, i: int) -> bool:
    while reader.tokens[i].word not in (";", "then", ""):
        i += 1
    return reader.tokens[i].word == "then"


ZONES = {"fine": 0.0, "z0": 0.3 * MM} | {f"z{n}": n * MM for n in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
"""Predefined zones and their radii, metres."""

KEPT = ("v", "tload")
"""Optional arguments that each piece takes, too, behind the speed and at the end."""
OF_THE_END = ("z", "inpos")
"""Optional arguments that belong to the end of the move."""

_HERE = locked(np.eye(4))

_STRAIGHT = re.compile("(?:Move|Trigg|Search)[LC]")


class PathText(NamedTuple):
    """Where a move stands, and of what a piece of it is made."""

    at: int
    """Begin of the instruction."""
    via: Span | None
    """The argument that names the point on the circle."""
    rest: str
    """Of a piece, behind its points."""
    work_object: str | None
    tool: str | None
    """Names in lower case."""


def paths(
    reader: Reader, in_order: Sequence[InOrder], targets: Sequence[Target], tools: Mapping[str, FloatArray]
) -> tuple[tuple[PathMove, PathText], ...]:
    """The straight and circular moves of a module in the order of its text."""
    numbers = {id(target): k for k, target in enumerate(targets)}
    return tuple(_path(reader, step, numbers, tools) for step in in_order if _STRAIGHT.match(step.move.name))


def _path(
    reader: Reader, step: InOrder, numbers: Mapping[int, int], tools: Mapping[str, FloatArray]
) -> tuple[PathMove, PathText]:
    move, ends, previous_move = step
    circular = len(ends) > 1
    position = reader.line(move.start), reader.listing.column(move.start)
    uses = [use for end in ends if end is not None for use in end.uses if (use.line, use.column) == position]
    use = uses[0] if uses else None
    tool, work_object = (None, None) if use is None else (use.tool, use.work_object)
    T = tools.get(tool or "")
    name = f"{move.name} {move.points[-1][1].text}"
    zones = [
        _zone(reader, instruction) for instruction in ([] if previous_move is None else [previous_move[0]]) + [move]
    ]
    start = None if previous_move is None else previous_move[1]
    reason = _doubt(reader, move, T, zones, [target for target in (start, *ends) if target is not None])
    reason = "the robot holds the part" if use is not None and use.held else reason
    text = reader.text
    speed, tool_arg = move.args[len(move.points)], move.tool
    v, load = (move.options.get(option) for option in KEPT)
    arguments = text[speed.start : speed.end] + ("" if v is None else f"\\V:={text[v.start : v.end]}")
    arguments += f",z0,{text[tool_arg.start : tool_arg.end]}"
    if move.work_object is not None:
        arguments += f"\\WObj:={text[move.work_object.start : move.work_object.end]}"
    arguments += "" if load is None else f"\\TLoad:={text[load.start : load.end]}"
    if re.search(r"[\r\n!]", arguments):
        reason = reason or "an argument goes over several lines"
    via = (move.points[0][1].start, move.points[0][1].end) if circular else None
    radii = tuple(0.0 if zone is None else zone for zone in zones)
    path = PathMove(
        position[0],
        name,
        None if start is None else numbers[id(start)],
        numbers[id(ends[0])] if circular and ends[0] is not None else None,
        numbers[id(ends[-1])] if None not in ends else None,
        _HERE if T is None else T,
        (radii[0], radii[-1]),
        reason,
    )
    return path, PathText(move.start, via, arguments, work_object, tool)


_JOINT_MOVE = re.compile(r"J(DO|AO|GO|Sync|IOs|Start|End|\d)*$")
_ONE_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")


def _doubt(
    reader: Reader,
    move: MoveInstruction,
    T: FloatArray | None,
    zones: Sequence[float | None],
    targets: Sequence[Target],
) -> str:
    """Why no points can be put into a move; empty where they can."""
    if move.name not in EXACT:
        return f"no points are put into {move.name}: what it does on its way belongs to a place on the path"
    unsupported = [option for option in move.options if option not in ("wobj", "tool", *KEPT, *OF_THE_END)]
    if unsupported:
        return f"no points are put into a move with \\{unsupported[0]}: it would mean something else for each piece"
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
    return all(_ONE_NUMBER.fullmatch(value) and abs(float(value)) >= ABSENT for value in values)


def _zone(reader: Reader, move: MoveInstruction) -> float | None:
    """Radius of the zone at the end of a move, metres; None where it is not known."""
    position = len(move.points) + 1
    if move.name not in EXACT or "z" in move.options or len(move.args) <= position:
        return None
    zone: Arg = move.args[position]
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
    for (move, path_text), cut in zip(moves, cuts, strict=True):
        if not len(cut.q) or move.to is None:
            continue
        to = targets[move.to]
        points = _points(cut, to, work_objects[path_text.work_object or ""])
        line_start = max(text.rfind("\n", 0, path_text.at), text.rfind("\r", 0, path_text.at)) + 1
        indent = text[line_start : path_text.at]
        gap = newline + indent if not indent.strip(" \t\ufeff") else " "
        if path_text.via is None:
            pieces = [f"MoveL {point},{path_text.rest};{gap}" for point in points]
        else:
            pairs = zip(points[:-1:2], points[1::2], strict=True)
            pieces = [f"MoveC {via},{end},{path_text.rest};{gap}" for via, end in pairs]
            edits.append((*path_text.via, points[-1]))
            replaced.append(path_text.via)
        edits.append((path_text.at, path_text.at, "".join(pieces)))
    return edits, replaced


def _points(cut: CutPath, to: Target, T_base_wobj: FloatArray) -> list[str]:
    """Literals of the points of a cut."""
    T = frames.inverse(T_base_wobj) @ cut.T_fake @ cut.move.T_tip_tcp
    near = np.array(to.written[3:])[None].repeat(len(T), axis=0)
    assert isinstance(to.configuration, ConfData)
    confs = [configuration_of(q, to.configuration.cfx) for q in cut.q]
    return [_robtarget(row, conf, to) for row, conf in zip(numbers_from_poses(T, near), confs, strict=True)]


def _robtarget(numbers: Sequence[float], conf: ConfData, like: Target) -> str:
    """A literal with the external axes of another target."""
    xyz = ",".join(number_text(value, DECIMALS) for value in numbers[:3])
    turn = ",".join(number_text(value, QUATERNION_DECIMALS) for value in numbers[3:])
    external = re.sub(r"\s", "", like.external)
    return f"[[{xyz}],[{turn}],[{','.join(map(str, conf))}],{external}]"


NOT_MONITORED = (
    "its configuration does not count (ConfJ or ConfL is off), and no stop just before it is known: say where the "
    "program begins (--start), or next to which joints it is meant (--posture)"
)
MAY_BE_MONITORED = (
    "whether its configuration counts (ConfJ, ConfL) depends on who calls the routine, and the solution next to the "
    "stop before is another one"
)

_NOTES = {
    **dict.fromkeys(["pdispon", "pdispset"], "a program displacement moves targets that are corrected without it"),
    **dict.fromkeys(["getdataval", "setdataval", "setalldataval"], "data are reached by a name that is not followed"),
}


@dataclass(frozen=True, eq=False, repr=False)
class Module(TextProgram):
    """A RAPID module as read."""

    moves: Callable[[], tuple[tuple[PathMove, PathText], ...]] = tuple
    """Gives its straight and circular moves in the order of the text, and their text; gathered when asked for."""
    cuts: tuple[CutPath, ...] = ()
    """What is put into these; empty: nothing."""
    arm: Arm | None = None
    """What the controller computes with."""
    own_model: Arm | None = None
    """What the controller itself computes with where that is not ``arm``."""

    def joints_at(self, target: Target) -> FloatArray:
        """Joints of the URDF of a joint target, radians."""
        return target.value if self.arm is None else self.arm.from_controller(target.value[None])[0]

    def meant_joints(self, poses: Sequence[int], T_base_tip: FloatArray) -> tuple[FloatArray | None, Sequence[str]]:
        """Joints that the controller takes for poses: those of the configuration, or next to the stop before.

        Where ``ConfJ`` or ``ConfL`` is off the controller goes to the solution that is nearest. Where it is not known
        whether it is, both must be the same. Targets in the place of shifted ones are next to those that were shifted:
        a shift may lead across the edge of a quadrant. None where all configurations count and a closed form is there.
        """
        targets = [self.targets[k] for k in poses]
        sets = [target.monitored if isinstance(target, Literal) else {True} for target in targets]
        free = np.array([monitored != {True} for monitored in sets], dtype=bool)
        split = np.array([target.split is not None for target in targets], dtype=bool) & ~free
        arm = self.arm
        if arm is None or (closed_form.has_closed_form(arm) and not (free | split).any()):
            return None, ()
        q, reasons = np.full((len(poses), 6), np.nan), ["no closed form is near the arm's: " + NO_POSTURE] * len(poses)
        if own_model.nearest_form(arm) is not None:
            confs = [t.configuration if isinstance(t.configuration, ConfData) else None for t in targets]
            T = np.array(T_base_tip)
            T[split] = self._unshifted(np.asarray(poses)[split].tolist())
            q, told = seeds_of(arm, T, confs, self.own_model)
            reached: BoolArray = np.logical_and.reduce(np.isfinite(q), axis=1)
            reasons = ["" if r else NO_REACH if t else NO_CONFDATA for r, t in zip(reached, told, strict=True)]
        configured = q.copy()
        rows = np.flatnonzero(free).tolist()
        for row in rows:
            q[row], reasons[row] = np.nan, NOT_MONITORED
        solutions = Solutions(ABB, arm, T_base_tip, [Posture()] * len(poses), self.own_model)
        for row in np.flatnonzero(split & np.isfinite(q).all(axis=1)).tolist():
            start = q[row].copy()
            q[row : row + 1], (reasons[row],) = solutions.next_to(np.array([row]), start[None])
            reasons[row] = reasons[row] or solutions.unclear(start, q[row])
            q[row] = np.nan if reasons[row] else q[row]
        self.next_to_stops(poses, q, reasons, rows, solutions, solutions.unclear)
        for row in rows:
            agree = np.abs(q[row] - configured[row]).max() < 1e-6
            if not reasons[row] and sets[row] != {False} and not agree:
                q[row], reasons[row] = np.nan, MAY_BE_MONITORED
        return q, reasons

    def _unshifted(self, poses: Sequence[int]) -> FloatArray:
        """Tip poses (n, 4, 4) of the targets in whose place others stand, with the frames of these."""
        T_base_wobj, T_tip_tcp = self._frames_of(poses)
        values = [split.target.value for k in poses if (split := self.targets[k].split) is not None]
        return T_base_wobj @ np.array(values).reshape(-1, 4, 4) @ frames.inverse(T_tip_tcp)

    def path_moves(self) -> list[PathMove]:
        """The straight and circular moves, see `irbcal.correction.languages.rapid`."""
        return [move for move, _ in self.moves()]

    def with_cuts(self, cuts: Sequence[CutPath]) -> Module:
        """The module that writes points into its moves, one cut for each."""
        return replace(self, cuts=tuple(cuts))

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment behind the line with ``MODULE``."""
        newline = self.listing.newline()
        line_end = re.match(r"[ \t]*(?:![^\r\n]*)?(\r\n|\n|\r)", self.text[at:])
        at, line_break = (at + line_end.end(), "") if line_end else (at, newline)
        return at, at, f"{line_break}! irbcal: fake targets, calibration {fingerprint}{newline}"

    def number_text(self, old: Number, new: float, decimals: int) -> str | None:
        """A number without needless zeros; the old text stays where it is the same within the decimals written."""
        return None if abs(new - old.value) <= 0.5 * 10.0**-decimals else number_text(new, decimals)

    def configuration_edits(self, target: Target, configuration: Configuration) -> list[Edit]:
        """New text of the quadrants that change."""
        if target.configuration is None:
            message = f"target {target.name} has no configuration in numbers to rewrite"
            raise ProgramError(message, file=self.source, line=target.line)
        assert isinstance(configuration, ConfData)
        assert isinstance(target.configuration, ConfData)
        pairs = zip(target.configuration_spans, configuration, target.configuration, strict=True)
        return [(*span, str(int(new))) for span, new, old in pairs if new != old]

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """A literal in the move."""
        assert target.split is not None
        conf = configuration or target.configuration
        assert isinstance(conf, ConfData)
        return [(*target.split.span, _robtarget(numbers, conf, target))]

    def edits(self, values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]) -> list[Edit]:
        """New text of numbers and configuration data, and points put into moves."""
        plain = super().edits(values, configurations)
        if not self.cuts:
            return plain
        inserted, replaced = insertions(self.text, self.moves(), self.cuts, self.targets, self.work_objects)
        return [*(edit for edit in plain if not any(a <= edit[0] < b for a, b in replaced)), *inserted]

    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """Quadrants of the axes; ``cfx`` stays, and so does what does not count."""
        return [
            configuration_of(row, target.configuration.cfx)
            if isinstance(target.configuration, ConfData)
            and not (isinstance(target, Literal) and target.monitored == {False})
            else None
            for row, target in zip(q, targets, strict=True)
        ]


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a RAPID module."""
    return re.search(rb"^\s*(?:%%%[\s\S]{0,200}?)?MODULE\s+\w+", data, re.IGNORECASE | re.MULTILINE) is not None


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read RAPID modules for an arm; see `irbcal.correction.languages.Language`.

    Tools and work objects that one of them defines in numbers serve all others of its task.
    """
    contents, _ = each_read(files, read_bytes)
    instructions = _instructions(contents, setup.instructions.get("rapid", {}))
    modules, unread = each_read(files, lambda path: Literals(_listing(read_bytes(path), str(path)), instructions))
    tasks: dict[str, list[Literals]] = {}
    for module in modules:
        tasks.setdefault(task_of(Path(module.source)), []).append(module)
    return [*(module for task in tasks.values() for module in _of_task(arm, task, setup)), *unread]


def _instructions(contents: Iterable[bytes], taught: Mapping[str, MotionInstruction]) -> dict[str, MotionInstruction]:
    """Moves that are known; a routine of the program's own goes before a built-in one of its name."""
    own = {name.lower() for data in contents for name in re.findall(rb"(?i)\bPROC[ \t]+(\w+)", data)}
    built_in = {name: move for name, move in MOTIONS.items() if name.encode() not in own}
    return {**built_in, **taught}


def task_of(path: Path) -> str:
    """Folder of the task that a module of a backup belongs to, ``RAPID/TASK1``; empty elsewhere."""
    words = [word.upper() for word in path.parts]
    k = words.index("RAPID") if "RAPID" in words else len(words)
    return "/".join(path.parts[: k + 2]) if k < len(words) - 2 else ""


def _of_task(arm: Arm | None, modules: Sequence[Literals], setup: ControllerSetup) -> list[Module]:
    """The modules of a task."""
    task = Task(modules, setup)
    every = [Uses(module, task) for module in modules]
    for uses in every:
        uses.gather()
    return [uses.module(arm) for uses in every]


def _listing(data: bytes, source: str) -> Listing:
    return Listing([(source, data)], "RAPID", ("utf-8",))


def parse(
    data: bytes,
    source: str = "program",
    tools: Mapping[str, FloatArray] | None = None,
    work_objects: Mapping[str, FloatArray] | None = None,
) -> Module:
    """Read a RAPID module by itself; tools and work objects of the caller go before what it says."""
    module = Literals(_listing(data, source), _instructions([data], {}))
    given_tools, given_work_objects = (
        {name.lower(): T for name, T in (given or {}).items()} for given in (tools, work_objects)
    )
    return _of_task(None, [module], ControllerSetup(given_tools, given_work_objects, unknown_frames()))[0]


def _mark_of(reader: Reader) -> str | None:
    return mark_in([text for text in reader.comments if re.match(r"!\s*irbcal", text, re.IGNORECASE)])


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the mark of a module; see `irbcal.correction.languages.Language`."""
    reader = Reader(_listing(data, source))
    reader.header()
    return _mark_of(reader)


def _notes(reader: Reader) -> tuple[Note, ...]:
    """What the corrections do not know about."""
    noted: dict[str, Note] = {}
    for mention in reader.mentions:
        if mention.name in _NOTES:
            noted.setdefault(mention.name, Note(reader.line(mention.start), _NOTES[mention.name]))
    return tuple(sorted(noted.values(), key=lambda note: note.line))


SPEED_NAMES = (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000)
"""Speeds that RAPID has names for, mm/s."""


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.mod``: absolute joint moves to fine points."""
    mm_s = round(moves.tip_speed / MM)
    speed = f"v{mm_s}" if mm_s in SPEED_NAMES else f"[{mm_s},500,5000,1000]"
    absent = ",".join(["9E9"] * 6)
    lines = ["MODULE irbcal_plan", *(f"  ! {note(text)}" for text in moves.head), "  PROC main()", "    AccSet 50,50;"]
    for move, joints in zip(moves.moves, moves.texts(), strict=True):
        lines += [f"    ! {note(move.comment)}"] if move.comment else []
        lines.append(f"    MoveAbsJ [[{','.join(joints)}],[{absent}]]\\NoEOffs,{speed},fine,tool0;")
        lines += [f"    WaitTime {move.wait_s:g};"] if move.wait_s else []
    return {"plan.mod": "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])}


_CFG_TYPE = re.compile(r"^([A-Z][A-Z0-9_]*):[ \t]*\r?$", re.M)
_CFG_VALUE = re.compile(r"-([A-Za-z]\w*)(?:[ \t]+(\"[^\"\r\n]*\"|[-+]?[\d.][\w.+-]*|[A-Za-z]\w*))?")


def backup(files: Sequence[Path]) -> Backup:
    """The base frame in ``MOC.cfg``, and whether the robot has a calibration there."""
    out = Backup()
    for root in folders_named(files, "rapid"):
        settings = [path for path in root.parent.glob("*") if path.name.lower() == "syspar" and path.is_dir()]
        for path in sorted(path for folder in settings for path in folder.glob("*") if path.name.lower() == "moc.cfg"):
            for robot in _instances(text_of(path), "ROBOT"):
                calibration = robot.get("use_robot_calib", "")
                if calibration and "uncalib" not in calibration.lower():
                    words = f"the robot has a calibration of its maker (use_robot_calib {calibration} in {path.name})"
                    out = out._replace(accuracy=words)
                numbers = [robot.get(f"base_frame_pos_{axis}", "0") for axis in "xyz"]
                numbers += [robot.get(f"base_frame_orient_u{k}", "1" if k == 0 else "0") for k in range(4)]
                try:
                    values = np.array([float(number) for number in numbers])
                except ValueError:
                    raise ProgramError(f"the base frame of {robot.get('name')} is not in numbers", file=path) from None
                if problem := notation.Quaternion().problem(values[3:].tolist()):
                    raise ProgramError(f"base frame of {robot.get('name', 'a robot')}: {problem}", file=path)
                T = notation.poses_from_numbers(np.concatenate([values[:3] / MM, values[3:]])[None])[0]
                out = placed(out, T, path)
    return out


def _instances(text: str, kind: str) -> list[dict[str, str]]:
    """Instances of one type of a configuration file of ABB, their attributes without quotes."""
    types = list(_CFG_TYPE.finditer(text))
    out: list[dict[str, str]] = []
    for found, end in up_to_next(types, len(text)):
        if found[1] == kind:
            for name, value in _CFG_VALUE.findall(text, found.end(), end):
                out += [{}] if name == "name" or not out else []
                out[-1][name] = value.strip('"')
    return out


_POSE = "[[{0},{1},{2}],[{3},{4},{5},{6}]]"
LANGUAGE = Language(
    name="RAPID",
    endings=(".mod", ".prg", ".sys", ".modx", ".sysx"),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=fingerprint,
    maker=ABB,
    robots=r"(^|_)(abb|irb_?\d)",
    write_moves=write_moves,
    motions=MOTIONS,
    moves_name_tools=True,
    backup=backup,
    declaration=FrameDeclaration(
        *ANY_WORD,
        head="MODULE irbcal_cell\n  ! The loads of tools are not known here: set them in place of mass -1",
        tool=f"  PERS tooldata {{name}}:=[TRUE,{_POSE},[-1,[0,0,0],[1,0,0,0],0,0,0]];",
        work_object=f'  PERS wobjdata {{name}}:=[FALSE,TRUE,"",{_POSE},[[0,0,0],[1,0,0,0]]];',
        foot="ENDMODULE",
        held_part=f'  PERS wobjdata {{name}}:=[TRUE,TRUE,"",{_POSE},[[0,0,0],[1,0,0,0]]];',
        fixed_tool=f"  PERS tooldata {{name}}:=[FALSE,{_POSE},[-1,[0,0,0],[1,0,0,0],0,0,0]];",
    ),
    sample=SampleArm(
        folder="abb",
        joints=(),
        flange=(),
        base=0.0,
        stops=((10, -10, 20, 15, 40, -30), (-20, 15, 5, -30, 35, 60), (35, 25, -30, 10, 50, -80)),
        tool=(0, 0, 150, 1, 0, 0, 0),
        frame=(800, 0, 400, 1, 0, 0, 0),
        tried={"job.mod": "--out job_calibrated.mod", "backup": "--out abb-job"},
        named="irb1600",
    ),
)
