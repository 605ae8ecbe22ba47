"""What calls of routines do to the tool and frame that hold, and to where the arm stands.

A routine that stands in the program does what its lines and the routines say that it calls. Of one that does not stand
there the caller may know that its call may be ignored (a gripper, a message to a PLC); else it may do anything.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import NamedTuple


class CallEffect(NamedTuple):
    """What a routine may do."""

    sets_frames: bool
    """It may set the tool or the frame."""
    moves: bool
    """It may move the arm."""
    sets_loads: bool
    """It may say that the robot carries something else."""


@dataclass
class _Routine:
    sets_frames: bool = False
    moves: bool = False
    sets_loads: bool = False
    calls: set[str] = field(default_factory=set)


class Calls:
    """The routines of a program and what calls of them do.

    Parameters
    ----------
    ignored_calls : sequence of str
        Patterns (``*``, ``?``) of names of routines that are not in the program, and neither move the arm nor set tool
        or frame; their case does not count.
    built_in : collection of str
        Names in lower case of functions of the language that do neither.
    closed : bool
        Whether all routines stand in the program: what does not is a function of the language.
    """

    def __init__(self, ignored_calls: Sequence[str] = (), built_in: Collection[str] = (), closed: bool = False) -> None:
        self._ignored = [pattern.lower() for pattern in ignored_calls]
        self._built_in, self._closed = built_in, closed
        self._routines: dict[str, _Routine] = {}

    def learn(
        self,
        routine: str,
        calls: Collection[str] = (),
        sets_frames: bool = False,
        moves: bool = False,
        sets_loads: bool = False,
    ) -> None:
        """Note what a line of a routine says; routines of one name count together."""
        learned = self._routines.setdefault(routine, _Routine())
        learned.sets_frames |= sets_frames
        learned.moves |= moves
        learned.sets_loads |= sets_loads
        learned.calls |= {*calls}

    def effect(self, name: str) -> CallEffect:
        """What a call of a routine, in lower case, may do."""
        effects = list(self._effects(name))
        return CallEffect(*(any(effect[k] for effect in effects) for k in range(len(CallEffect._fields))))

    def knows(self, name: str) -> bool:
        """Whether a routine, in lower case, stands in the program."""
        return name in self._routines

    def _effects(self, name: str) -> Iterator[CallEffect]:
        """Of a routine and of all that it calls."""
        waiting, visited = [name], {name}
        while waiting:
            name = waiting.pop()
            routine = self._routines.get(name)
            if routine is not None:
                yield CallEffect(routine.sets_frames, routine.moves, routine.sets_loads)
                waiting += routine.calls - visited
                visited |= routine.calls
            elif not (self._closed or name in self._built_in or any(fnmatchcase(name, p) for p in self._ignored)):
                yield CallEffect(True, True, True)


def may_set_frames(name: str, line: int) -> str:
    """Why tool and frame are not known behind a call, and what to do."""
    return (
        f"{name}, called in line {line}, may set the tool or base: correct its file in the same call, or say "
        f"--ignored-calls {name} if it neither does that nor moves the robot"
    )


def may_set_load(name: str, line: int) -> str:
    """Why it is not known behind a call what the robot carries, and what to do."""
    return (
        f"{name}, called in line {line}, may say that the robot carries something else: correct its file in the same "
        f"call, or say --ignored-calls {name}, or with --payload what the robot carries"
    )
