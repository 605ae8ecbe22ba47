"""Data of KRL: declarations, aggregates in braces, and everything that gives a variable another value."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from irbcal.correction.languages.krl.tokens import END, Line
from irbcal.correction.languages.krl.writing import integer, posture_of
from irbcal.correction.listing import Listing, Number
from irbcal.correction.maker_program import Found
from irbcal.correction.tokens import Token

TYPES = ("pos", "e6pos", "axis", "e6axis", "frame", "fdat")
POSE, JOINTS = ("x", "y", "z", "a", "b", "c"), ("a1", "a2", "a3", "a4", "a5", "a6")
DECLARING = ("decl", "global", "const", "public")
PLAIN = ("int", "real", "bool", "char", "signal", "struc", "enum", "ext", "extfct", "import", "load", "trigger_para")

Index: TypeAlias = tuple[int, ...]
Key: TypeAlias = tuple[str, str]
"""File of the module (a stem in lower case, empty for global data) and name."""


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


class Variable:
    """What a name stands for.

    Attributes
    ----------
    spelling, type : str
    entries : list of (tuple of int, Aggregate)
        Literal values and their indices.
    changes : list of int
        Where it gets another value.
    found : dict of tuple of int to Found
        Its targets.
    """

    def __init__(self, spelling: str, type_name: str, part: int) -> None:
        self.spelling, self.type, self.part = spelling, type_name, part
        self.entries: list[tuple[Index, Aggregate]] = []
        self.changes: list[int] = []
        self.found: dict[Index, Found] = {}


def aggregate(line: Line, listing: Listing) -> Aggregate | None:
    """Components in braces that begin with the next token, taken; None, and nothing taken, where there are none."""
    if line.word() != "{":
        return None
    begin, start = line.at, line.next.start
    line.at += 1
    name = ""
    if line.next.kind == "name" and line.word(1) == ":":
        name = line.word()
        line.at += 2
    values: dict[str, Value] = {}
    while line.next is not END and line.word() != "}":
        if line.next.kind != "name":
            line.at = begin
            return None
        key = line.word()
        line.at += 1
        line.index()
        first = line.next
        number = line.number()
        last = line.tokens[line.at - 1]
        if line.word() not in (",", "}"):
            number = None
            last = _skip(line)
        values.setdefault(key, Value(number, listing.text[first.start : last.end], first.start, last.end))
        line.take(",")
    if line.next is END:
        line.at = begin
        return None
    end = line.next.end
    line.at += 1
    return Aggregate(name, values, start, end)


def _skip(line: Line) -> Token:
    """The last token before the next comma or brace outside brackets; all up to it taken."""
    depth = 0
    last = line.next
    while line.next is not END and (depth or line.word() not in (",", "}")):
        depth += (line.word() in "([{") - (line.word() in ")]}")
        last = line.next
        line.at += 1
    return last


def target(name: str, type_name: str, one: Aggregate, listing: Listing) -> tuple[Found | None, str]:
    """The target that an aggregate is, or why it is none."""
    kind = type_name or one.type
    joint = kind in ("axis", "e6axis") or (not kind and "a1" in one.values)
    names = JOINTS if joint else POSE
    missing = [key.upper() for key in names if key not in one.values]
    if missing:
        return None, f"it has no {missing[0]}, so that the value before stays"
    numbers = [one.values[key].number for key in names]
    plain = [number for number in numbers if number is not None]
    if len(plain) < 6:
        return None, "some of its numbers are computed"
    found = Found(name, "joint" if joint else "pose", one.start, plain)
    external = [key for key in one.values if key[0] == "e" and key[1:].isdecimal()]
    found.external = ", ".join(listing.quote(one.values[key].start, one.values[key].end) for key in external)
    if not joint and "s" in one.values and "t" in one.values:
        status, turn = integer(one.values["s"].text), integer(one.values["t"].text)
        if status is None or turn is None:
            found.reasons.append("its S or T is no number")
        else:
            found.posture = posture_of(status, turn)
            if found.posture.wrist != (-1 if status & 4 else 1):
                found.reasons.append("its S and T contradict one another about the sign of A5")
            found.posture_spans = tuple((one.values[key].start, one.values[key].end) for key in ("s", "t"))
    return found, ""


class Data:
    """All variables of a program.

    Attributes
    ----------
    variables : dict of Key to Variable
    """

    def __init__(self, listing: Listing, stems: list[str]) -> None:
        self.listing, self.stems = listing, stems
        self.variables: dict[Key, Variable] = {}

    def lookup(self, part: int, name: str) -> Variable | None:
        """The variable that a name stands for in a file."""
        return self.variables.get((self.stems[part], name)) or self.variables.get(("", name))

    def declaration(self, line: Line) -> bool:
        """Take a declaration; whether the line is one."""
        begin = line.at
        public = False
        while line.word() in DECLARING:
            public |= line.word() in ("global", "public")
            line.at += 1
        kind = line.word()
        named = line.next.kind == "name" and (line.tokens[line.at + 1 : line.at + 2] or [END])[0].kind == "name"
        if not named or (kind not in TYPES and line.at == begin and kind not in PLAIN):
            line.at = begin
            return False
        line.at += 1
        shared = public or self.stems[line.part].startswith("$")
        while line.next.kind == "name":
            token = line.next
            line.at += 1
            spelling = self.listing.text[token.start : token.end]
            index = line.index()
            variable = Variable(spelling, kind, line.part)
            self.variables.setdefault(("" if shared else self.stems[line.part], token.word), variable)
            if line.take("="):
                self.value(variable, () if index is None else index, line)
            if not line.take(","):
                break
        return True

    def value(self, variable: Variable, index: Index | None, line: Line) -> None:
        """A value of a variable: components in numbers, or something else."""
        at = line.next.start if line.next is not END else line.end
        one = aggregate(line, self.listing)
        if one is None or index is None or line.word() not in ("", ","):
            variable.changes.append(at)
        else:
            variable.entries.append((index, one))

    def collect(self) -> None:
        """Make targets of all literal values."""
        for variable in self.variables.values():
            if variable.type not in ("pos", "e6pos", "axis", "e6axis", "frame"):
                continue
            for index, one in variable.entries:
                inside = ",".join(str(k) for k in index)
                name = variable.spelling + (f"[{inside}]" if index else "")
                found, _ = target(name, variable.type, one, self.listing)
                if found is not None and index in variable.found:
                    variable.changes.append(one.start)
                elif found is not None:
                    variable.found[index] = found
                else:
                    variable.changes.append(one.start)
