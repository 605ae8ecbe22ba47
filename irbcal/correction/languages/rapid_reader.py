"""The text of a RAPID module, read once: declarations, assignments, moves and other mentions of names."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple, TypeAlias

from irbcal.correction.instructions import ANY, POINTS, TO, TOOL, VIA, MotionInstruction
from irbcal.correction.listing import Listing, Token
from irbcal.correction.targets import Target
from irbcal.errors import ProgramError

ABSENT = 0.9e9
"""From here on a number stands for an axis that is not there (9E9, 1E9), or for no place at all."""

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

    elements: list[Node] | None
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


@dataclass(eq=False)
class RapidData:
    """What one name stands for: its type, and its value where the declaration gives a list."""

    spelling: str
    type: str
    start: int
    sizes: Subscripts = ()
    node: Node | None = None
    computed: int | None = None
    local: bool = False
    entries: list[tuple[Subscripts, Literal]] = field(default_factory=list)
    changes: list[tuple[Subscripts, int]] = field(default_factory=list)
    """Filled by `irbcal.correction.languages.rapid.Literals`; positions of computed values, too."""
    _places: dict[Subscripts, list[int]] = field(default_factory=dict)
    _loose: list[int] = field(default_factory=list)
    _known: int = 0

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


_MARK = re.compile(r"!\s*irbcal", re.IGNORECASE)
CLOSING = {"(": ")", "{": "}"}
DEEPEST = 12  # lists in lists
_NODE = partial(tuple.__new__, Node)  # half the time of Node(…)


class Reader:
    """One pass through the text of a module, which notes declarations, assignments, moves and other mentions of names.

    What they mean for targets is decided afterwards, see `Literals` and `Uses`.
    """

    def __init__(self, listing: Listing, instructions: Mapping[str, MotionInstruction]) -> None:
        self.listing, self.text, self.instructions = listing, listing.text, instructions
        """``instructions``: moves that are known, by their names in lower case."""
        self.line, self.error, self.quote = listing.line, listing.error, listing.quote
        self.tokens: list[Token] = []
        """The last one is of the kind ``end``, without a word."""
        self.marks: list[str] = []
        """Comments that may be a mark of a corrected module."""
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
                self.marks += [word] if _MARK.match(word) else []
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
            raise ProgramError("expected a RAPID module, found no MODULE", file=self.listing.files[0].name)
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
                    if not stack and word not in BUILT_IN and tokens[i - 1].word in _BEFORE_STATEMENT:
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
            self.wrong.append((start, instruction.refusal(len(args))))
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
        token_words = [token.word for token in self.tokens[first : first + 3]]
        if token_words[0] not in ("offs", "reltool") or token_words[1] != "(" or not self._is_data(first + 2):
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
        return Shifted(len(self.moves), token_words[2], index, start, token_words[0] == "reltool", values)

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


_BRANCHES = (
    "if then elseif else endif for endfor while endwhile test case default endtest goto return error undo backward "
    "raise retry trynext exit proc endproc func endfunc trap endtrap connect"
)
_BUILT_IN = (
    "accset add bitclear bitset bookerrno clear clkreset clkstart clkstop close confj confl decr enddo errlog errwrite "
    "gripload idisable ienable incr invertdo isignaldi isleep iwatch open pathresol pulsedo reset rewind "
    "setao setdo setgo set singarea softact softdeact speedrefresh startload tperase tpshow tpwrite triggequip "
    "triggint triggio triggspeed unload velset waitai waitao waitdi waitdo waitgi waitgo waitrob waittime waituntil "
    "worldacclim write writebin writestrbin"
)
OPENING, BLOCK_ENDS = frozenset(["if", "for", "while", "test"]), frozenset(["endif", "endfor", "endwhile", "endtest"])
ROUTINES = frozenset(["proc", "func", "trap"])
_DECLARING = frozenset(["const", "pers", "var", "local", "task"])
JUMPS = frozenset(["goto", "error", "undo", "backward", "raise", "retry", "trynext", "connect"])
_BEFORE = BLOCK_ENDS | {"then", "else", "do", "default", "error", "undo", "backward"}
"""Words that a statement may follow without a semicolon."""
_BEFORE_STATEMENT = _BEFORE | {";", ")", ":", ""}
BRANCHES = frozenset(_BRANCHES.split())
BUILT_IN = frozenset(_BUILT_IN.split())
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
                head = word in ROUTINES
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
    previous, word = reader.tokens[i - 1], reader.tokens[i].word
    if word in OPERATORS or reader._is_member(i):
        return False
    return previous.word in (")", "}", "]") or (previous.kind != "symbol" and previous.word not in (*OPERATORS, "if"))


def _has_then(reader: Reader, i: int) -> bool:
    while reader.tokens[i].word not in (";", "then", ""):
        i += 1
    return reader.tokens[i].word == "then"
