"""Targets that one RAPID module declares and another one of the same call uses.

Data that a module declares outside its routines, without ``LOCAL``, are seen by all modules of the task that do not
declare the name themselves. A target is followed there where one file alone declares it; uses, mentions and new values
in other files then count as those of its own module do; tools and work objects must mean the same frame in all files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.languages.rapid.literals import KIND_OF, Literals
from irbcal.correction.languages.rapid.parts import Data, Index, Literal

Frames = Mapping[str, Mapping[str, FloatArray]]


class Abroad:
    """What a module sees of the targets of the others.

    Parameters
    ----------
    mine : Literals
        Of the module.
    others : sequence of Literals
        Of the other files of the call.
    frames : dict of str to dict of str to dict of str to ndarray
        Tools and work objects that each file defines in numbers, by file, by type and by name.
    given : dict of str to dict of str to ndarray
        Those from the caller, which go before.

    Attributes
    ----------
    data : dict of str to Data
        The targets that this module sees and another one declares, by their names.
    """

    def __init__(
        self,
        mine: Literals,
        others: Sequence[Literals] = (),
        frames: Mapping[str, Frames] | None = None,
        given: Frames | None = None,
    ) -> None:
        self.mine, self.frames, self.given = mine, frames or {}, given or {"tooldata": {}, "wobjdata": {}}
        self.modules = [mine, *others]
        self.data: dict[str, Data] = {}
        self.source: dict[str, str] = {}
        seen: dict[str, list[tuple[Data, str]]] = {}
        for other in others:
            for name, data in other.reader.data.items():
                if not data.local and name not in mine.reader.data:
                    seen.setdefault(name, []).append((data, Path(other.reader.source).name))
        self.twice = {
            name: " and ".join(source for _, source in found)
            for name, found in seen.items()
            if len(found) > 1 and any(data.type in KIND_OF for data, _ in found)
        }
        for name, found in seen.items():
            if found[0][0].type in KIND_OF and len(found) == 1:
                self.data[name], self.source[name] = found[0]
        self._twice_declared = {name: [data for data, _ in seen[name]] for name in self.twice}

    def frame_problem(self, type_name: str, name: str) -> str:
        """What speaks against a tool or work object of a move here to a target there; empty where nothing does."""
        if name in self.given[type_name]:
            return ""
        declared = [one.reader.data[name] for one in self.modules if name in one.reader.data]
        found = [types[type_name][name] for types in self.frames.values() if name in types[type_name]]
        what = "tool" if type_name == "tooldata" else "work object"
        if not found or len(found) < len(declared):
            return f"the {what} {name} is not defined in numbers in these modules"
        if any(not np.array_equal(T, found[0]) for T in found):
            return f"the {what} {name} is another one in another module"
        if any(change.name == name for one in self.modules for change in one.reader.assignments):
            return f"the {what} {name} is changed"
        return ""

    def gather(self) -> None:
        """Note what this module does to the targets of others but to move to them."""
        reader = self.mine.reader
        file = Path(reader.source).name
        for scope, name, index, start in reader.mentions:
            self._against(scope, name, index, f"line {reader.line(start)} of {file} uses it in another way")
        changes = [(one.scope, one.name, one.indices, one.start) for one in reader.assignments]
        for move in reader.moves:
            changes += [
                (move.scope, arg.name, arg.indices, move.start) for role, arg in move.points if role == "w" and arg.name
            ]
            for _, arg in move.points:
                if arg.name in self.twice and reader.lookup(move.scope, arg.name) is None:
                    self._declared_twice(arg.name, f"line {reader.line(move.start)} of {file}")
        for scope, name, index, start in changes:
            self._against(scope, name, index, f"line {reader.line(start)} of {file} gives it another value")

    def _against(self, scope: dict[str, Data] | None, name: str, index: Index, reason: str) -> None:
        if self.mine.reader.lookup(scope, name) is not None:
            return
        for literal in self.literals(name, index):
            literal.reasons.append(reason)

    def _declared_twice(self, name: str, where: str) -> None:
        for data in self._twice_declared[name]:
            for _, literal in data.entries:
                literal.reasons.append(f"{where} uses this name, which {self.twice[name]} declare")

    def literals(self, name: str, index: Index) -> list[Literal]:
        """Literals of another module that a name with an index may stand for here."""
        data = self.data.get(name)
        return [] if data is None else data.literals(index)
