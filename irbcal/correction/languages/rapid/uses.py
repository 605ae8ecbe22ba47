"""Which moves of a RAPID module use which targets, and what speaks against changing these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from irbcal.arrays import FloatArray
from irbcal.correction.languages.rapid.abroad import Abroad
from irbcal.correction.languages.rapid.literals import KIND_OF, TYPE_OF, Literals
from irbcal.correction.languages.rapid.parts import Arg, Data, Literal, Move, may_be
from irbcal.correction.program import Kind
from irbcal.correction.text_program import Role, Use

_QUOTED = 3  # mentions of a target that are quoted before the rest is counted


class Uses:
    """The uses of the targets of a module.

    Parameters
    ----------
    literals : Literals
        As collected; gathers the uses.
    given : dict of str to dict of str to ndarray
        Frames from the caller, by ``tooldata`` and ``wobjdata`` and by name.
    abroad : Abroad, optional
        The targets of other modules.

    Attributes
    ----------
    goals : list of (Move, list of (list of Literal, bool))
        For each move and each of its points the literals that it may stand for, and whether it may be another place.
    """

    def __init__(
        self, literals: Literals, given: Mapping[str, Mapping[str, FloatArray]], abroad: Abroad | None = None
    ) -> None:
        self.abroad = abroad or Abroad(literals)
        self.literals, self.reader, self.given = literals, literals.reader, given
        self.goals: list[tuple[Move, list[tuple[list[Literal], bool]]]] = []

    def gather(self) -> None:
        """Give every literal its uses, those of other modules, too.

        Raises
        ------
        ProgramError
            If a move uses what cannot be its target, its tool or its work object.
        """
        self.abroad.gather()
        for move in self.reader.moves:
            self._move(move)
        self._mentions()

    def conclude(self) -> None:
        """Put together what speaks against changing each literal, once the uses of all modules are gathered.

        Raises
        ------
        ProgramError
            If the numbers of one that is used are none.
        """
        for literal in self.literals.found:
            self._conclude(literal)

    def _move(self, move: Move) -> None:
        """Give the literals that a move goes to this use, or report what is in the way."""
        reader = self.reader
        kind: Kind = "joint" if move.name.endswith("AbsJ") else "pose"
        line = reader.line(move.start)
        tool, no_tool = self._frame_name(move, move.tool, "tooldata", "tool")
        wobj, no_wobj = self._frame_name(move, move.work_object, "wobjdata", "work object")
        use = Use(line, reader.column(move.start), move.name, "to", tool, wobj)
        unknown = no_tool or no_wobj if kind == "pose" else ""
        points: list[tuple[list[Literal], bool]] = []
        self.goals.append((move, points))
        for role, arg in move.points:
            if role == "w":
                continue
            as_role: Role = "via" if role == "via" else "to"
            if self._goes_abroad(move, arg, kind, replace(use, role=as_role), unknown):
                points.append(([], True))
                continue
            found, reason = self._goals(move, arg, kind, line)
            points.append((found, bool(reason)))
            if reason or unknown:
                self.literals.report(move.start, move.name, arg.text, reason or unknown)
            for literal in found:
                literal.uses.append(replace(use, role=as_role))
                literal.reasons.extend(text for text in (reason, unknown) if text)

    def _goes_abroad(self, move: Move, arg: Arg, kind: Kind, use: Use, unknown: str) -> bool:
        """Give a target of another module this use; false where it is none, or none that can be corrected."""
        data: Data | None = None
        if arg.name is not None and self.reader.lookup(move.scope, arg.name) is None:
            data = self.abroad.data.get(arg.name)
        if arg.name is None or data is None or KIND_OF[data.type] != kind or len(arg.indices) != len(data.sizes):
            return False
        file = Path(self.reader.source).name
        found = self.abroad.literals(arg.name, arg.indices)
        frames = (("tooldata", use.tool), ("wobjdata", use.work_object)) if kind == "pose" else ()
        against = [f"{unknown} of {file}"] if unknown else []
        against += [why for of, name in frames if name and (why := self.abroad.frame_problem(of, name))]
        changes = [start for index, start in data.changes if may_be(index, arg.indices)]
        against += ["it is computed or changed in its own module"] if changes else []
        for literal in found:
            literal.uses.append(replace(use, file=file))
            literal.reasons.extend(against)
        if against or not found:
            self.literals.report(move.start, move.name, arg.text, "; ".join(against) or "it has no value in numbers")
        return True

    def _goals(self, move: Move, arg: Arg, kind: Kind, line: int) -> tuple[list[Literal], str]:
        """Literals that an argument stands for, and why these are not all, or not to be changed."""
        reader = self.reader
        if arg.node is not None:
            literal = self.literals.literal(arg.node, kind, f"of {move.name} in line {line}")
            return ([], f"its numbers are computed: {arg.text}") if literal is None else ([literal], "")
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
            if data.type in KIND_OF:
                message = f"{move.name} goes to a {TYPE_OF[kind]}, but {data.spelling} is a {data.type}"
                raise reader.error(arg.start, message)
            return [], f"{arg.text} is declared as {data.type}"
        if len(arg.indices) != len(data.sizes):
            message = f"{data.spelling} has {len(data.sizes)} indices, but {arg.text} has {len(arg.indices)}"
            raise reader.error(arg.start, message)
        found = data.literals(arg.indices)
        changes = sorted(position for index, position in data.changes if may_be(index, arg.indices))
        if changes:
            return found, f"{arg.text} is computed or changed in line {reader.line(changes[0])}"
        return found, "" if found else f"{arg.text} has no value in this module"

    def _frame_name(self, move: Move, arg: Arg | None, type_name: str, what: str) -> tuple[str | None, str]:
        """Name of a tool or work object, or None and why there is no one name."""
        if arg is None:
            return "wobj0", ""
        if arg.name is None or arg.indices:
            return None, f"the {what} of {move.name} in line {self.reader.line(move.start)} is computed: {arg.text}"
        data = self.reader.lookup(move.scope, arg.name)
        if data is None or (arg.name in self.given[type_name] and data.type != "parameter"):
            return arg.name, ""
        if data.type == "parameter" or self.reader.data.get(arg.name) is not data:
            kind = "a parameter of" if data.type == "parameter" else "declared in"
            return None, f"the {what} {arg.text} is {kind} the routine"
        if data.changes:
            return None, f"the {what} {arg.text} is changed in line {self.reader.line(data.changes[0][1])}"
        if data.type != type_name:
            raise self.reader.error(arg.start, f"expected a {type_name}, but {arg.text} is declared as {data.type}")
        return arg.name, ""

    def _mentions(self) -> None:
        """Note for each literal where its variable is used in another way than as the target of a move."""
        for scope, name, index, start in self.reader.mentions:
            data = self.reader.lookup(scope, name)
            for literal in data.literals(index) if data is not None else ():
                literal.mentioned.append(start)

    def _conclude(self, literal: Literal) -> None:
        """Put together what speaks against changing a literal."""
        reader = self.reader
        if literal.problem and literal.uses:
            raise reader.error(literal.start, f"{TYPE_OF[literal.kind]} {literal.name!r}: {literal.problem}")
        if literal.problem:
            literal.reasons.append(literal.problem)
        if literal.kind == "pose":
            uses = literal.uses[::-1]
            tools = {use.tool: use.place for use in uses}
            work_objects = {use.work_object: use.place for use in uses}
            for what, names in (("tools", tools), ("work objects", work_objects)):
                if len(names) > 1:
                    seen = ", ".join(f"{name or 'a computed one'} ({line})" for name, line in names.items())
                    literal.reasons.append(f"used with different {what}: {seen}")
        lines = sorted({reader.line(start) for start in literal.mentioned})
        for line in lines[:_QUOTED]:
            literal.reasons.append(f"line {line} uses it in another way: {reader.quote_line(line)}")
        if len(lines) > _QUOTED:
            literal.reasons.append(f"so do {len(lines) - _QUOTED} more lines")
        literal.reasons = list(dict.fromkeys(literal.reasons))
