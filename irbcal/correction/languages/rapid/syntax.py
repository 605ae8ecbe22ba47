"""The syntax of RAPID modules, as far as targets, tools, work objects and moves need it.

The reader goes once through the tokens of a module and notes declarations, assignments, moves and every other mention
of a name; what they mean for targets is decided afterwards, see ``literals`` and ``uses``.
"""

from __future__ import annotations

from collections.abc import Callable

from irbcal.correction.languages.rapid.expressions import CLOSING, Walker
from irbcal.correction.languages.rapid.parts import Arg, Assignment, Data, Index, Move, Node, Scope
from irbcal.correction.languages.rapid.tokens import STRUCTURE
from irbcal.errors import ProgramError

PATTERNS = {  # positional arguments of moves; s: anything, w: a point that the instruction writes, t: the tool
    **dict.fromkeys(["MoveJ", "MoveL", "MoveAbsJ"], "to s s t"),
    "MoveC": "via to s s t",
    **{f"Move{a}{b}": "to s s t" for a in "JL" for b in ("DO", "AO", "GO", "Sync")},
    **{f"MoveC{b}": "via to s s t" for b in ("DO", "AO", "GO", "Sync")},
    **dict.fromkeys(["TriggJ", "TriggL", "TriggAbsJ"], "to s s s t"),
    "TriggC": "via to s s s t",
    **dict.fromkeys(["TriggJIOs", "TriggLIOs"], "to s s t"),
    "SearchL": "s w to s t",
    "SearchC": "s w via to s t",
}
MOVES = {name.lower(): (name, tuple(pattern.split())) for name, pattern in PATTERNS.items()}
EXACT = frozenset(["MoveJ", "MoveL", "MoveAbsJ", "MoveC"])  # the others may have more arguments after the tool


class Reader(Walker):
    """One pass through the text of a module.

    Attributes
    ----------
    data : dict of str to Data
        Of the module.
    scopes : list of dict
        The same for each routine.
    moves, assignments : list of Move, Assignment
    loose : list of Node
        Lists of values in any other place.
    """

    def __init__(self, text: str, source: str, most: int | None = None) -> None:
        super().__init__(text, source, most)
        self.data: Scope = {}
        self.scopes: list[Scope] = []
        self.moves: list[Move] = []
        self.assignments: list[Assignment] = []
        self.loose: list[Node] = []

    def lookup(self, scope: Scope | None, name: str) -> Data | None:
        """What a name stands for in a routine or in the module; None if it is not declared here."""
        found = scope.get(name) if scope is not None else None
        return found if found is not None else self.data.get(name)

    def _declare(self, scope: Scope, data: Data, name: str) -> None:
        if name in scope:
            first = self.line(scope[name].start)
            raise self.error(data.start, f"{data.spelling!r} is declared a second time, first in line {first}")
        scope[name] = data

    def header(self) -> int:
        """Number of the token behind the header of the module, which may follow the header of older files."""
        tokens = self.tokens
        i = 0
        while tokens[i].kind != "end" and tokens[i].word != "module":
            i += 1
        if tokens[i].kind == "end":
            raise ProgramError("expected a RAPID module, found no MODULE", file=self.source)
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
            kind, word = token.kind, token.word
            if kind == "end":
                raise self.error(token.start, "the module has no ENDMODULE: the file is not whole")
            if kind == "name":
                if word in STRUCTURE and not self._is_member(i):
                    if stack:
                        raise self.error(token.start, f"expected {CLOSING[stack[-1]]!r}, found {self._found(i)}")
                    if word == "endmodule":
                        break
                    if word == "module":
                        raise self.error(token.start, "a second module in one file is not supported")
                    i = handlers[word](i) if word in handlers else i + 1
                elif word in MOVES and not stack and not self._is_member(i):
                    i = self._move(i)
                elif not stack and self._is_assignment(i):
                    i = self._assignment(i)
                else:
                    self._mention(i)
                    i += 1
            elif word == "[":
                node, i = self._list(i)
                self.loose.append(node)
            else:
                self._bracket(stack, i)
                i += 1
        if self.scope is not None:
            raise self.error(token.start, "ENDMODULE stands in a routine: its end is missing")
        if tokens[i + 1].kind != "end":
            found = self._found(i + 1)
            raise self.error(tokens[i + 1].start, f"expected the end of the file after ENDMODULE, found {found}")

    def _declaration(self, i: int) -> int:
        type_token, local = self._name(i + 1, "a data type"), self.tokens[i - 1].word == "local"
        name = self._name(i + 2, "a name")
        sizes: Index = ()
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
        data = Data(spelling, type_token.word, name.start, sizes, node, computed, local)
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
        name, whole = self.tokens[i], True
        index: Index = ()
        i += 1
        if self.tokens[i].word == "{":
            index, i = self._index(i)
        while self.tokens[i].word != ":=":
            whole = False
            i = self._index(i)[1] if self.tokens[i].word == "{" else i + 2
        node = None
        if self.tokens[i + 1].word == "[":
            node, i = self._list(i + 1)
        else:
            i = self._expression(i + 1, (";",))
        i = self._expect(i, ";")
        self.assignments.append(Assignment(self.scope, name.word, index, node if whole else None, name.start))
        return i

    def _routine(self, i: int) -> int:
        start, word = self.tokens[i].start, self.tokens[i].word
        if self.scope is not None:
            raise self.error(start, f"{word.upper()} stands in a routine: the end of that one is missing")
        if word == "func":
            self._name(i + 1, "a data type")
            i += 1
        name = self._name(i + 1, "the name of the routine")
        if name.word in MOVES:
            raise self.error(start, f"the module makes its own {MOVES[name.word][0]}: this is not supported")
        self.scope = {}
        self.scopes.append(self.scope)
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
                data = Data(self.text[name.start : name.end], "parameter", name.start)
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
        name, pattern = MOVES[self.tokens[i].word]
        start, stops = self.tokens[i].start, (",", "\\", ";")
        args: list[Arg] = []
        options: dict[str, Arg | None] = {}
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
                role = pattern[len(args)] if len(args) < len(pattern) else "s"
                arg, i = self._arg(i, stops, role != "s")
                args.append(arg)
            if self.tokens[i].word == ",":
                i += 1
                if self.tokens[i].word in (",", ";"):
                    raise self.error(self.tokens[i].start, f"expected an argument of {name}, found {self._found(i)}")
            elif self.tokens[i].word not in ("\\", ";"):
                raise self.error(self.tokens[i].start, f"expected ',' or ';', found {self._found(i)}")
        need = len(pattern) - (options.get("tool") is not None)
        if len(args) < need or (name in EXACT and len(args) > need):
            raise self.error(start, f"{name}: expected {need} arguments that are not optional, found {len(args)}")
        points = [(role, arg) for role, arg in zip(pattern, args, strict=False) if role in ("to", "via", "w")]
        tool = options.get("tool") or args[len(pattern) - 1]
        self.moves.append(Move(name, start, self.scope, points, tool, options.get("wobj"), args, options))
        return i + 1

    def _arg(self, i: int, stops: tuple[str, ...], plain: bool) -> tuple[Arg, int]:
        """An argument that begins at token i; names count as mentioned unless this is what the move is about."""
        node, name, start = None, None, self.tokens[i].start
        index: Index = ()
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
