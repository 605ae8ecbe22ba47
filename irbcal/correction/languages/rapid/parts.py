"""What a RAPID module is made of, as far as targets, tools, work objects and moves need it."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

from irbcal.correction.notation import quaternion_problem
from irbcal.correction.program import Kind
from irbcal.correction.text_program import Use

ABSENT = 0.9e9
"""From here on a number stands for an axis that is not there (9E9, 1E9), or for no place at all."""

Index: TypeAlias = tuple[int | None, ...]
"""Index of an element, each from 1; None where it is computed."""

Scope: TypeAlias = "dict[str, Data]"
"""Data of a routine by their names in lower case."""


def may_be(index: Index, other: Index) -> bool:
    """Whether two indices may name the same element; None, or no index at all, stands for any."""
    return all(a is None or b is None or a == b for a, b in zip(index, other, strict=False))


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
    indices: Index
    start: int


class Literal:
    """A target in numbers while its uses are gathered.

    Attributes
    ----------
    kind : str
        ``joint`` or ``pose``.
    name : str
    start : int
        Where it stands.
    numbers, configuration : tuple of Node
        The numbers to correct, and the configuration data: empty where they are not four numbers.
    values : tuple of float
        Of the numbers.
    external : Node
        The external axes.
    uses : list of Use
    reasons : list of str
        What speaks against changing it.
    mentioned : list of int
        Where its variable is used in another way than as the target of a move.
    problem : str or None
        What is wrong with its numbers.
    """

    def __init__(
        self, kind: Kind, name: str, start: int, numbers: list[Node], configuration: list[Node], external: Node
    ) -> None:
        self.kind, self.name, self.start, self.external = kind, name, start, external
        self.numbers, self.configuration = tuple(numbers), tuple(configuration)
        self.values = tuple(leaf.number for leaf in numbers if leaf.number is not None)
        self.uses: list[Use] = []
        self.reasons: list[str] = []
        self.mentioned: list[int] = []
        self.problem = self._problem()

    def _problem(self) -> str | None:
        sizes = [abs(value) for value in self.values]
        if not all(map(math.isfinite, sizes)) or (self.kind == "pose" and max(sizes) >= ABSENT):
            return "found a number that is too large"
        if self.kind == "pose":
            return quaternion_problem(self.values[3:])
        absent = [k for k, size in enumerate(sizes, start=1) if size >= ABSENT]
        if absent:
            self.reasons.append(f"joint {absent[0]} has no value (9E9)")
        return None


class Arg(NamedTuple):
    """An argument of a move: a literal (node), a name with an index, or neither: computed; ``text`` may be cut."""

    node: Node | None
    name: str | None
    indices: Index
    start: int
    text: str
    end: int


class Move(NamedTuple):
    """A move instruction: its points with their roles, tool and work object (None: wobj0), and all its arguments."""

    name: str
    start: int
    scope: Scope | None
    points: list[tuple[str, Arg]]
    tool: Arg
    work_object: Arg | None
    args: list[Arg]
    options: dict[str, Arg | None]


class Assignment(NamedTuple):
    """``name{index} := node``; without node: a computed value, or a component only."""

    scope: Scope | None
    name: str
    indices: Index
    node: Node | None
    start: int


class Data:
    """What one name stands for: its type, and its value where the declaration gives a list."""

    def __init__(
        self,
        spelling: str,
        type_name: str,
        start: int,
        sizes: Index = (),
        node: Node | None = None,
        computed: int | None = None,
        local: bool = False,
    ) -> None:
        self.spelling, self.type, self.start = spelling, type_name, start
        self.sizes, self.node, self.computed, self.local = sizes, node, computed, local
        self.entries: list[tuple[Index, Literal]] = []  # filled by `literals`
        self.changes: list[tuple[Index, int]] = []  # and the positions of computed values, too
        self._places: dict[Index, list[int]] = {}
        self._loose: list[int] = []
        self._known = 0

    def literals(self, index: Index) -> list[Literal]:
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
