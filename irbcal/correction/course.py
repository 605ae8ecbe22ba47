"""The way of a program through its text: which tool and frame hold, and which stop comes before which.

Text is followed from top to bottom. Where it branches or begins anew, the stop before is not known; tool and frame
hold on, unless a branch or loop sets them: then nothing is known of them behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from irbcal.correction.listing import Listing
from irbcal.correction.maker_program import Found
from irbcal.correction.program import Stop
from irbcal.correction.text_program import Role, Uncorrected, Use

UNSET = "active"
"""Name of the tool and frame that hold before the program sets any."""


@dataclass(frozen=True)
class State:
    """Tool and frame, by name in lower case; None and the reason where they are computed."""

    tool: str | None = UNSET
    frame: str | None = UNSET
    why: str = ""


@dataclass
class _Block:
    loop: bool
    before: State
    used: list[Found]
    changed: bool = False
    ends: list[State] = field(default_factory=list)


class Course:
    """Follows moves.

    Parameters
    ----------
    listing : Listing

    Attributes
    ----------
    state : State
    stops : list of (int, Found or None, Found or None)
        Place of the move, its target, and the target before.
    uncorrected : list of Uncorrected
    """

    def __init__(self, listing: Listing) -> None:
        self.listing = listing
        self.state = State()
        self.stops: list[tuple[int, Found | None, Found | None]] = []
        self.uncorrected: list[Uncorrected] = []
        self._previous: Found | None = None
        self._passed: list[tuple[Found, Found | None]] = []
        self._blocks: list[_Block] = []

    def tool(self, name: str | None, why: str = "") -> None:
        """A tool is set; None where it is computed."""
        self.state = replace(self.state, tool=name, why=why or self.state.why)

    def frame(self, name: str | None, why: str = "") -> None:
        """A frame is set; None where it is computed."""
        self.state = replace(self.state, frame=name, why=why or self.state.why)

    def forget(self) -> None:
        """The arm may come from elsewhere."""
        self._previous = None

    def restart(self) -> None:
        """A routine begins: nothing is known."""
        self.state, self._previous, self._blocks = State(), None, []

    def use(self, found: Found, at: int, instruction: str, role: Role = "to", state: State | None = None) -> None:
        """A move goes to a target, or over it."""
        state = state or self.state
        line = self.listing.line(at)
        found.uses.append(Use(line, self.listing.column(at), instruction, role, state.tool, state.frame))
        if found.kind == "pose" and None in (state.tool, state.frame):
            found.reasons.append(state.why or f"the tool or frame of {instruction} in line {line} is computed")
        if role == "via":
            self._passed.append((found, self._previous))
        for block in self._blocks:
            block.used.append(found)

    def stop(self, found: Found | None, at: int) -> None:
        """The arm stops at a target, or, with None, somewhere."""
        self.stops.append((at, found, self._previous))
        self._previous = found

    def left(self, at: int, instruction: str, target: str, reason: str) -> None:
        """A move, or a part of one, that goes to no target in numbers."""
        place = self.listing.line(at), self.listing.column(at)
        self.uncorrected.append(Uncorrected(*place, instruction, target, reason))

    def open(self, loop: bool = False) -> None:
        """A branch or loop begins."""
        self._blocks.append(_Block(loop, self.state, []))
        self.forget()

    def alternative(self) -> None:
        """Another branch begins."""
        self.forget()
        if self._blocks:
            block = self._blocks[-1]
            block.changed |= self.state != block.before
            self.state = block.before

    def close(self, at: int) -> None:
        """A branch or loop ends."""
        self.forget()
        if not self._blocks:
            return
        block = self._blocks.pop()
        before = block.before
        if not block.changed and self.state == before:
            return
        line = self.listing.line(at)
        why = f"the tool or frame is set in the branch or loop that ends in line {line}"
        if block.loop:
            for found in block.used:
                if any((use.tool, use.work_object) == (before.tool, before.frame) for use in found.uses):
                    found.reasons.append(why)
        self.state = State(None, None, why)

    def order(self, numbers: dict[int, int]) -> tuple[Stop, ...]:
        """The stops, with the numbers of targets by their ``id``; notes in each target where it is come from."""
        out = []
        for at, found, before in self.stops:
            target = None if found is None else numbers.get(id(found))
            previous = None if before is None else numbers.get(id(before))
            out.append(Stop(self.listing.line(at), target, previous))
            if found is not None:
                found.after.append(previous)
        for found, before in self._passed:
            found.after.append(None if before is None else numbers.get(id(before)))
        return tuple(out)
