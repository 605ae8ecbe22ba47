"""What the robot carries at each move of a program that names its loads.

A load holds until the program names another one: it is followed through branches, loops and labels, into routines and
out of them. Where ways that lead to a move bring several loads, all of them are kept.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.units import LARGEST_PAYLOAD_KG

FARTHEST_M = 10.0
"""Metres from the flange beyond which no load is."""


class Load(NamedTuple):
    """What the flange carries, tool and part."""

    mass_kg: float
    """NaN where it is not known."""
    centre: tuple[float, float, float] | None = None
    """Its centre of gravity, metres: in the controller's flange as a language reads it, in the tip link in a
    `irbcal.correction.targets.Target`; None where it is not known.
    """
    reason: str = ""
    """Why the mass is not known, one sentence part."""


def unknown_load(why: str) -> Load:
    """A load of which nothing is known but why."""
    return Load(np.nan, None, why)


class _Meeting(NamedTuple):
    """A place in a program at which several ways meet: where a routine begins or ends, a loop or label."""

    kind: str
    name: str


Ways: TypeAlias = frozenset["Load | _Meeting | None"]
"""Loads that may hold: None is the one that holds before the program names any, a point whatever holds there."""

_USUAL: Ways = frozenset([None])


class Carrying(NamedTuple):
    """What the robot carries in a move."""

    ways: Ways
    """What the program says."""
    tool: Load | None = None
    """Of the tool, in the controller's flange, where the program says the part alone."""
    seen_from: str | None = None
    """Name of the tool in whose frame the centres of the parts are; None: in the flange."""


class _LoadBlock(NamedTuple):
    entering: Ways
    loop: _Meeting | None
    ends: list[Ways]


class LoadFlow:
    """Follows the loads that a program names through its text, from top to bottom."""

    def __init__(self) -> None:
        self.names_any = False
        """Whether the program names a load."""
        self.now: Ways = _USUAL
        """What may hold here."""
        self._leads_to: dict[_Meeting, set[Load | _Meeting | None]] = {}
        self._routines: list[tuple[str, Ways, list[_LoadBlock]]] = []
        self._blocks: list[_LoadBlock] = []
        self._count = 0

    def take(self, load: Load | None) -> None:
        """The program names a load; None where it goes back to the usual one."""
        self.names_any = True
        self.now = frozenset([load])

    def begin(self, routine: str, starts_with: Load | None = None) -> None:
        """A routine begins; without a call in the program with the usual load, or the one that holds at a start."""
        self._routines.append((routine, self.now, self._blocks))
        self.now, self._blocks = self._meet("begin", routine, [starts_with] if starts_with is not None else []), []

    def end(self) -> None:
        """The routine ends that began last; outside of it the load is the one before it began."""
        if self._routines:
            routine, before, blocks = self._routines.pop()
            self._meet("end", routine, self.now)
            self.now, self._blocks = before, blocks

    def returns(self) -> None:
        """The routine may end here."""
        if self._routines:
            self._meet("end", self._routines[-1][0], self.now)

    def call(self, routine: str, sets_loads: bool, missing: str = "") -> None:
        """A routine is called; ``missing`` says why it is not known what one does that is not in the program."""
        self._meet("begin", routine, self.now)
        if missing:
            self.now = frozenset([unknown_load(missing)])
        elif sets_loads:
            self.now = self._meet("end", routine, [])

    def open(self, loop: bool = False) -> None:
        """A branch or loop begins."""
        meeting = None
        before = self.now
        if loop:
            self._count += 1
            meeting = _Meeting("loop", str(self._count))
            self.now = self._meet(*meeting, before)
        self._blocks.append(_LoadBlock(before, meeting, []))

    def alternative(self) -> None:
        """Another branch begins."""
        if self._blocks:
            self._blocks[-1].ends.append(self.now)
            self.now = self._blocks[-1].entering

    def close(self) -> None:
        """A branch or loop ends."""
        if self._blocks:
            block = self._blocks.pop()
            if block.loop is not None:
                self.now = self._meet(*block.loop, self.now)
            else:
                self.now = self.now.union(block.entering, *block.ends)

    def label(self) -> None:
        """The program may jump to here, or away from here, within the routine."""
        self.now = self._meet("label", self._routines[-1][0] if self._routines else "", self.now)

    def _meet(self, kind: str, name: str, ways: Iterable[Load | _Meeting | None]) -> Ways:
        meeting = _Meeting(kind, name)
        self._leads_to.setdefault(meeting, set()).update(ways)
        return frozenset([meeting])

    def loads(self, ways: Ways) -> tuple[Load | None, ...]:
        """The loads that ways bring, once the whole program is followed."""
        if not self.names_any:
            return (None,)
        waiting, met, out = [*ways], {*ways}, dict[Load | None, None]()
        while waiting:
            path = waiting.pop()
            if not isinstance(path, _Meeting):
                out[path] = None
                continue
            behind = self._leads_to.get(path, set())
            if path.kind == "begin" and not behind:
                out[None] = None
            waiting += behind - met
            met |= behind
        return tuple(sorted(out, key=lambda load: (load is not None, str(load)))) or (None,)


def seen_from(load: Load, T: FloatArray | None) -> Load:
    """A load with its centre seen from elsewhere, by the place (4, 4) of the frame in which it is; None: unknown."""
    if load.centre is None or T is None:
        return load._replace(centre=None)
    x, y, z = T[:3, :3] @ load.centre + T[:3, 3]
    return load._replace(centre=(float(x), float(y), float(z)))


def combined(loads: Sequence[Load]) -> Load:
    """Several loads at a time as one, centres in the same frame; the centre is not known where one of theirs is not."""
    why = next((load.reason for load in loads if load.reason), "")
    mass = sum(load.mass_kg for load in loads)
    heavy = [load for load in loads if load.mass_kg]
    centres = [load.centre for load in heavy if load.centre is not None]
    if why or mass == 0.0 or len(centres) < len(heavy):
        return Load(mass, None, why)
    x, y, z = np.array([load.mass_kg for load in heavy]) @ np.array(centres) / mass
    return Load(mass, (float(x), float(y), float(z)))


def load_of(mass_kg: float, centre: Collection[float] | None = None) -> Load:
    """A load in numbers; it is not known where the numbers are none of a load."""
    values = np.array([mass_kg, *(centre or ())])
    too_far = np.abs(values[1:]).max(initial=0.0) > FARTHEST_M
    if not np.isfinite(values).all() or not 0.0 <= mass_kg <= LARGEST_PAYLOAD_KG or too_far:
        return unknown_load("the numbers of its load are none that an arm carries")
    x_y_z = [float(value) for value in centre or ()]
    return Load(float(mass_kg), (x_y_z[0], x_y_z[1], x_y_z[2]) if len(x_y_z) == 3 else None)
