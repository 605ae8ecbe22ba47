"""The flow of control through a program's text: which tool and work object hold, and which stop comes before which."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from irbcal.correction.calls import Calls, may_set_frames, may_set_load
from irbcal.correction.listing import Listing, Span
from irbcal.correction.loads import Carrying, Load, LoadFlow, Ways
from irbcal.correction.program import Stop, Unchanged
from irbcal.correction.targets import AT_START, IN_ROUTINE, START, UNSET, Role, Shift, Split, Target, Use


@dataclass(frozen=True)
class FrameState:
    """Tool and frame, by name in lower case; None and the reason where they are computed; see `Use`."""

    tool: str | None = UNSET
    frame: str | None = UNSET
    reason: str = ""
    part_on_robot: bool = False


class _Inherited(NamedTuple):
    """A use of a target in a block, and whether the tool or the frame is still the one from before the block."""

    target: Target
    tool: bool
    frame: bool


@dataclass
class _Block:
    loop: bool
    state: FrameState
    previous: Target | None
    stops: int
    inherited: list[_Inherited] = field(default_factory=list)
    changed: bool = False
    disturbed: bool = False
    tool_set: bool = False
    frame_set: bool = False


class ControlFlow:
    """Follows a program through its text: which tool and frame hold, and which stop comes before which.

    Text is followed from top to bottom. Where it branches or begins again, the stop before is not known, but behind a
    branch or loop in which nothing moves; tool and frame hold on, unless a branch or loop sets them: then nothing is
    known of them behind it. A routine begins with the tool and frame of its calls, where they are alike.
    """

    def __init__(
        self, listing: Listing, calls: Calls | None = None, loads: LoadFlow | None = None, split_points: bool = False
    ) -> None:
        self.listing, self.calls, self.split_points = listing, calls or Calls(), split_points
        """``calls``: the routines of the program. ``split_points``: whether shifted targets become targets of their
        own.
        """
        self.loads, self.names_loads = loads or LoadFlow(), list[int]()
        """``loads``: what the robot carries; the same for programs that call one another. ``names_loads``: places where
        the program says what it is.
        """
        self._state = FrameState()
        self.stops: list[tuple[int, Target | None, Target | None]] = []
        """Place of the move, its target, and the target before."""
        self.unchanged_moves: list[Unchanged] = []
        """Moves to targets that are not in numbers."""
        self.previous: Target | None = START
        """The target that the arm comes from; None where it is not known."""
        self.shifts: list[Shift] = []
        """Moves to targets that are shifted; those that count are left by `settle`."""
        self.first_begins = False
        """Whether a program begins with the first routine of its file; else only where no other routine moves."""
        self._routine, self._moving = 0, set[tuple[int, int]]()
        self._passed: list[tuple[Target, Target | None]] = []
        self._blocks: list[_Block] = []
        self._calls_from: dict[str, list[FrameState]] = {}
        self.teaching: dict[int, str] = {}
        """How to teach the instruction of a line that is not known and names a target."""
        self._offset, self._behind_offset = False, set[int]()
        self._inherits: list[Target] = []

    @property
    def state(self) -> FrameState:
        """Tool and frame that hold; both are set by an assignment."""
        return self._state

    @state.setter
    def state(self, state: FrameState) -> None:
        self._state = state
        for block in self._blocks[-1:]:
            block.tool_set = block.frame_set = True

    def tool(self, name: str | None, reason: str = "") -> None:
        """A tool is set; None where it is computed."""
        self._state = replace(self.state, tool=name, reason=reason or self.state.reason)
        for block in self._blocks[-1:]:
            block.tool_set = True

    def frame(self, name: str | None, reason: str = "") -> None:
        """A frame is set; None where it is computed."""
        self._state = replace(self.state, frame=name, reason=reason or self.state.reason)
        for block in self._blocks[-1:]:
            block.frame_set = True

    def hold(self, part_on_robot: bool) -> None:
        """Whether the robot holds the part from here on; tool and frame stay."""
        self._state = replace(self.state, part_on_robot=part_on_robot)

    def forget(self) -> None:
        """The arm may come from elsewhere."""
        self.previous = None
        for block in self._blocks:
            block.disturbed = True

    def label(self, at: int) -> None:
        """A label that may be jumped to, after which neither stop, tool nor frame are known."""
        self.forget()
        self.loads.label()
        self.state = FrameState(None, None, f"the label in line {self.listing.line(at)} is jumped to")

    def call(self, routine: str, spelling: str, at: int) -> None:
        """A routine, by its name in lower case and as it is spelled, is called."""
        effect = self.calls.effect(routine)
        self.load_call(spelling, at)
        self._calls_from.setdefault(routine, []).append(self.state)
        if effect.moves:
            self.forget()
        if effect.sets_frames:
            self.state = FrameState(None, None, may_set_frames(spelling, self.listing.line(at)))

    def call_any_time(self, routine: str) -> None:
        """An interrupt or a signal calls a routine, by its name in lower case."""
        self._calls_from.setdefault(routine, []).append(FrameState(None, None))

    def load_call(self, spelling: str, at: int) -> None:
        """What a call of a routine does to the load alone."""
        routine = spelling.lower()
        sets = self.calls.effect(routine).sets_loads
        missing = may_set_load(spelling, self.listing.line(at)) if sets and not self.calls.knows(routine) else ""
        self.loads.call(routine, sets, missing)

    def carry(self, load: Load | None, at: int) -> None:
        """The program says what the robot carries from here on; None for what it carries without saying so."""
        self.names_loads.append(at)
        self.loads.take(load)

    def restart(self, routine: str = "", load: Load | None = None) -> None:
        """A routine begins: with the tool and frame of its calls, and the first where the program begins.

        A start of the program from there sets a ``load``.
        """
        self.loads.end()
        self.loads.begin(routine, load)
        begin = f"{UNSET}{IN_ROUTINE}{routine}" if routine else UNSET
        self.state, self._blocks = FrameState(begin, begin), []
        self._routine += 1
        if self.stops:
            self.previous = None

    def use(
        self,
        target: Target,
        at: int,
        instruction: str,
        role: Role = "to",
        state: FrameState | None = None,
        names: tuple[bool, bool] = (True, True),
        carried: Ways | None = None,
    ) -> None:
        """A move goes to a target, or over it; with a ``state`` of its own, of which it names tool and frame or not.

        ``carried`` are loads of this move alone.
        """
        target.carried.append(Carrying(self.loads.now if carried is None else carried))
        names_tool, names_frame = (False, False) if state is None or state is self.state else names
        state = state or self.state
        line = self.listing.line(at)
        use = Use(
            line, self.listing.column(at), instruction, role, state.tool, state.frame, part_on_robot=state.part_on_robot
        )
        target.uses.append(use)
        if any(name is not None and IN_ROUTINE in name for name in (state.tool, state.frame)):
            self._inherits.append(target)
        if target.kind == "pose" and None in (state.tool, state.frame):
            target.conflicts.append(state.reason or f"the tool or frame of {instruction} in line {line} is computed")
        if role == "via":
            self._passed.append((target, self.previous))
        tool, frame = not names_tool, not names_frame
        for block in reversed(self._blocks):
            tool, frame = tool and not block.tool_set, frame and not block.frame_set
            block.inherited.append(_Inherited(target, tool, frame))

    def stop(self, target: Target | None, at: int) -> None:
        """The arm stops at a target, or, with None, somewhere."""
        self._moving.add((self.listing.file_at(at), 0 if self.first_begins else self._routine))
        self._behind_offset |= {len(self.stops)} if self._offset else set()
        self.stops.append((at, target, self.previous))
        self.previous, self._offset = target, False

    def stop_beside(self, at: int) -> None:
        """The arm stops at a distance in numbers from a target, in the posture that it has."""
        previous = self.previous
        self.stop(None, at)
        self.previous, self._offset = previous, True

    def standing_at(self, state: FrameState) -> Target | None:
        """The target at which the arm stands by a tool and frame; None where not known, or it stands beside one."""
        if self.previous is None or not self.previous.uses or self._offset:
            return None
        use = self.previous.uses[-1]
        return self.previous if (use.tool, use.work_object) == (state.tool, state.frame) else None

    def leave(self, at: int, instruction: str, target: str, reason: str) -> None:
        """Note a move, or a part of one, that goes to no target in numbers."""
        self.unchanged_moves.append(Unchanged(f"{instruction} {target}", self.listing.line(at), reason))

    def shift(self, shifts: Sequence[Shift], span: Span) -> Target | None:
        """A move goes to a target, or one of several, that is shifted; the target of its own where it becomes one.

        The move uses that one as any other target; ``span`` is the text in whose place it stands.
        """
        self.shifts += shifts
        shift = shifts[0]
        if not self.split_points or len(shifts) > 1 or not shift.numeric or shift.target.kind == "joint":
            return None
        split = Split(shift.target, shift.T_left, shift.T_right, span)
        name = f"{shift.text} in line {self.listing.line(span[0])}"
        fresh: dict[str, Any] = {"uses": [], "conflicts": [], "previous": [], "carried": [], "near": None}
        shifted = replace(shift.target, name=name, start=span[0], split=split, **fresh)
        self.shifts[-1] = shift._replace(new_target=shifted)
        return shifted

    def mention(self, target: Target, at: int) -> None:
        """Something else than a move uses a target."""
        line = self.listing.line(at)
        target.conflicts.append(f"line {line} uses it in another way{self.teaching.get(line, '')}")

    def settle(self) -> None:
        """Take shifts of targets that moves go to directly, with the same tool and frame; others use them otherwise."""
        self.loads.end()
        for target in self._inherits:
            target.uses = [self._of_calls(target, use) for use in target.uses]
        shifts = [
            shift._replace(
                tool=self._at_begin("tool", shift.tool), work_object=self._at_begin("frame", shift.work_object)
            )
            for shift in self.shifts
        ]
        self.shifts = []
        for shift in shifts:
            if shift.new_target is not None and shift.target.conflicts:
                shift.new_target.uses.clear()  # whatever is wrong with the target may be wrong with the shifted one
            elif shift.new_target is not None and shift.new_target.correctable and not shift.target.uses:
                continue
            frames_of_uses = {(use.tool, use.work_object) for use in shift.target.uses}
            on_robot = any(use.part_on_robot for use in shift.target.uses)
            if shift.target.kind == "pose" and frames_of_uses == {(shift.tool, shift.work_object)} and not on_robot:
                self.shifts.append(shift)
            else:
                reason = "it is shifted, and the robot holds the part" if on_robot else ""
                reason = (
                    reason
                    or f"it is shifted, and no move goes to {shift.target.name} itself with the same tool and frame"
                )
                self.leave(shift.at, shift.instruction, shift.text, reason)
                self.mention(shift.target, shift.at)

    def _of_calls(self, target: Target, use: Use) -> Use:
        """A use with the tool and frame that hold where its routine is called, as far as it sets none itself."""
        tool, frame = self._at_begin("tool", use.tool), self._at_begin("frame", use.work_object)
        for kind, inherited, at_call in (("tool", use.tool, tool), ("frame", use.work_object, frame)):
            if inherited is not None and at_call is None and target.kind == "pose":
                routine = inherited.partition(IN_ROUTINE)[2]
                target.conflicts.append(f"{routine} is called with different or computed {kind}s, and sets none itself")
        return replace(use, tool=tool, work_object=frame)

    def _at_begin(self, kind: Literal["tool", "frame"], name: str | None) -> str | None:
        """Tool or frame that a name means which stands for what holds where a routine begins; None of several."""
        waiting, visited = [name], dict[str | None, None]()
        names = set[str | None]()
        while waiting:
            name = waiting.pop()
            callers = (
                self._calls_from.get(name.partition(IN_ROUTINE)[2]) if name is not None and IN_ROUTINE in name else ()
            )
            if callers is None:
                names.add(UNSET)
            elif not callers:
                names.add(name)
            elif name not in visited:
                waiting += [None if state.part_on_robot else getattr(state, kind) for state in callers]
            visited[name] = None
        return names.pop() if len(names) == 1 else None

    def open(self, loop: bool = False) -> None:
        """A branch or loop begins."""
        self.loads.open(loop)
        self._blocks.append(_Block(loop, self.state, self.previous, len(self.stops)))
        self.previous = None

    def alternative(self) -> None:
        """Another branch begins."""
        self.loads.alternative()
        self.previous = None
        if self._blocks:
            block = self._blocks[-1]
            block.changed |= self.state != block.state
            self._state = block.state
            block.tool_set = block.frame_set = False

    def close(self, at: int) -> None:
        """A branch or loop ends."""
        self.loads.close()
        self.previous = None
        if not self._blocks:
            return
        block = self._blocks.pop()
        if len(self.stops) == block.stops and not block.disturbed:
            self.previous = block.previous
        state_before = block.state
        if not block.changed and self.state == state_before:
            return
        line = self.listing.line(at)
        reason = f"the tool or frame is set in the branch or loop that ends in line {line}"
        other_holder = block.changed or self.state.part_on_robot != state_before.part_on_robot
        other_tool, other_frame = self.state.tool != state_before.tool, self.state.frame != state_before.frame
        for inherited in block.inherited if block.loop else ():
            if other_holder or (inherited.tool and other_tool) or (inherited.frame and other_frame):
                inherited.target.conflicts.append(reason)
        self.state = FrameState(None, None, reason)

    def order(self, targets: Iterable[Target]) -> tuple[Stop, ...]:
        """The stops with the numbers of their targets; notes in each target where the arm comes from."""
        numbers = {id(target): k for k, target in enumerate(targets)}
        if len(self._moving) < 2:  # else it is not known which routine the program begins with
            numbers[id(START)] = AT_START
        out = []
        for k, (at, target, previous_target) in enumerate(self.stops):
            previous = None if previous_target is None else numbers.get(id(previous_target))
            number = None if target is None else numbers.get(id(target))
            elsewhere = previous == AT_START or k in self._behind_offset
            out.append(Stop(self.listing.line(at), number, None if elsewhere else previous))
            if target is not None:
                target.previous.append(previous)
        for target, previous_target in self._passed:
            target.previous.append(None if previous_target is None else numbers.get(id(previous_target)))
        return tuple(out)
