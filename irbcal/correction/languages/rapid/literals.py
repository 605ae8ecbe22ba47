"""Targets that stand in a RAPID module as numbers, and everything that gives a target another value."""

from __future__ import annotations

from irbcal.correction.languages.rapid.parts import ABSENT, Data, Index, Literal, Node, Scope
from irbcal.correction.languages.rapid.syntax import Reader
from irbcal.correction.program import Kind
from irbcal.correction.text_program import Uncorrected
from irbcal.errors import ProgramError

KIND_OF: dict[str, Kind] = {"robtarget": "pose", "jointtarget": "joint"}
TYPE_OF: dict[Kind, str] = {"pose": "robtarget", "joint": "jointtarget"}
_PARTS: dict[Kind, tuple[tuple[int, str], ...]] = {
    "pose": ((3, "[x, y, z]"), (4, "[q1, q2, q3, q4]"), (4, "[cf1, cf4, cf6, cfx]"), (6, "[six external axes]")),
    "joint": ((6, "[six joints]"), (6, "[six external axes]")),
}


class Literals:
    """All targets in numbers of a module.

    Attributes
    ----------
    reader : Reader
        The module as read.
    found : list of Literal
        In the order in which they are come upon.
    uncorrected : list of Uncorrected
        What looks like a target where none can be corrected, and moves to targets that cannot.
    """

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        self.found: list[Literal] = []
        self.uncorrected: list[Uncorrected] = []

    def report(self, start: int, instruction: str, target: str, reason: str) -> None:
        """Note that something at this place is left as it is."""
        line, column = self.reader.line(start), self.reader.column(start)
        self.uncorrected.append(Uncorrected(line, column, instruction, target, reason))

    def collect(self) -> None:
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
                goal = reader.lookup(move.scope, arg.name) if role == "w" and arg.name else None
                if goal is not None:
                    goal.changes.append((arg.indices, move.start))
        for node in reader.loose:
            if _looks_like_target(node):
                text = reader.quote(node.start, node.end)
                self.report(node.start, "other", text, "this is no move that is known")

    def _assignment(self, scope: Scope | None, name: str, index: Index, node: Node | None, start: int) -> None:
        data = self.reader.lookup(scope, name)
        if data is not None and data.type in KIND_OF and node is not None:
            self._fill(data, index, node)
        elif data is not None:
            data.changes.append((index, start))
        if (data is None or data.type == "parameter") and node is not None and _looks_like_target(node):
            where = "is not declared in this module" if data is None else "is a parameter of the routine"
            self.report(start, "assignment", name, where)

    def _fill(self, data: Data, index: Index, node: Node) -> None:
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
                    raise self._wrong(node, data.type, data.spelling, f"{sizes[0]} elements", len(node.items))
                new = [((*index, k + 1), item, sizes[1:]) for k, item in enumerate(node.items)]
                pending.extend(reversed(new))
                continue
            inside = ",".join("?" if k is None else str(k) for k in index)
            literal = self.literal(node, kind, data.spelling + (f"{{{inside}}}" if index else ""))
            if literal is None:
                data.changes.append((index, node.start))
            else:
                data.entries.append((index, literal))

    def _wrong(self, node: Node, type_name: str, name: str, expected: str, found: str | int) -> ProgramError:
        return self.reader.error(node.start, f"{type_name} {name!r}: expected {expected}, found {found}")

    def literal(self, node: Node, kind: Kind, name: str) -> Literal | None:
        """The literal that a list of values is; None if some of its numbers are computed."""
        if node.items is None:
            return None
        self._check_parts(node, node.items, kind, name)
        values = [part.items for part in (node.items[:2] if kind == "pose" else node.items[:1])]
        numbers = [leaf for items in values for leaf in items or ()]
        if any(items is None for items in values):
            return None
        for leaf in numbers:
            if leaf.items is not None:
                raise self._wrong(leaf, TYPE_OF[kind], name, "a number", self.reader.quote(leaf.start, leaf.end))
        if any(leaf.number is None for leaf in numbers):
            return None
        configuration = self._configuration(node.items[2], name) if kind == "pose" else []
        literal = Literal(kind, name, node.start, numbers, configuration, node.items[-1])
        self.found.append(literal)
        return literal

    def _check_parts(self, node: Node, items: list[Node], kind: Kind, name: str) -> None:
        """Refuse a list that has not the parts of a target."""
        if len(items) != len(_PARTS[kind]):
            expected = "[" + ", ".join(text for _, text in _PARTS[kind]) + "]"
            raise self._wrong(node, TYPE_OF[kind], name, expected, f"{len(items)} parts")
        for part, (size, text) in zip(items, _PARTS[kind], strict=True):
            if part.number is not None or (part.items is not None and len(part.items) != size):
                raise self._wrong(part, TYPE_OF[kind], name, text, self.reader.quote(part.start, part.end))

    def _configuration(self, part: Node, name: str) -> list[Node]:
        """The four numbers of configuration data; empty if they are computed."""
        numbers = [leaf.number for leaf in part.items or () if leaf.number is not None]
        if part.items is None or len(numbers) < len(part.items):
            return []
        if any(abs(number) > ABSENT * 100 or number % 1 for number in numbers):
            found = self.reader.quote(part.start, part.end)
            raise self._wrong(part, TYPE_OF["pose"], name, "a configuration in whole numbers", found)
        return part.items


def _looks_like_target(node: Node) -> bool:
    sizes = [len(part.items) if part.items is not None else None for part in node.items or []]
    return sizes in ([3, 4, 4, 6], [6, 6])
