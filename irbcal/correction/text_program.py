r"""Programs of text: targets in numbers, moves that use them, tools and work objects, and the text to edit.

The same for all makers: a language finds the targets (`Target`) and follows the moves
(`ControlFlow`). A target is either a set of joints or a pose of the tool centre point in
a work object. Writing fake targets (Nubiola 2011, section 6.2) means to replace the numbers of targets and to leave
every other byte::

    T_base_tip = T_base_wobj @ T_wobj_tcp @ inverse(T_tip_tcp)

where ``tip`` is the flange frame that carries the tool (``tool0``) and ``base`` the frame that carries the work
objects (``wobj0``).

Where the robot holds the part and the tool stands, the part is what is on the tip, and the tool what is in the base: a
target that is the pose of the fixed tool in the part is then the inverse of ``T_wobj_tcp``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked, locked
from irbcal.cell.external_axes import ExternalAxis, carried, moving
from irbcal.correction.calls import Calls, may_set_frames, may_set_load
from irbcal.correction.listing import Edit, Listing, Number, Span, mark_in, number_like, one_word
from irbcal.correction.loads import Carrying, Load, LoadFlow, Ways, combined, seen_from
from irbcal.correction.maker import BEYOND, NO_POSTURE, ConfData, Maker, Posture, Solutions
from irbcal.correction.notation import check_rigid
from irbcal.correction.program import ControllerSetup, Corrections, Left, Note, Program, Stop, TargetKind, WantedTargets
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

if TYPE_CHECKING:
    from typing_extensions import Self

Configuration: TypeAlias = ConfData | Posture
"""Which solution of a pose is meant, as a language says it."""

Role: TypeAlias = Literal["to", "via"]

_NO_VALUE = locked(np.full(6, np.nan))


@dataclass(frozen=True)
class Use:
    """One direct use of a target in a move."""

    line: int
    column: int
    """Of the instruction; both start at 1."""
    instruction: str
    """As usually spelled: MoveJ, LIN, movec, …"""
    role: Role
    """``to``, or ``via`` for the point on the circle."""
    tool: str | None
    work_object: str | None
    """Names in lower case of what is on the flange and of what stands; None where the program computes them."""
    file: str = ""
    """Of the move where that is another than the target's."""
    held: bool = False
    """Whether the robot holds the part: ``tool`` is that part, and ``work_object`` the fixed tool."""

    @property
    def place(self) -> str:
        """Where it stands, in words."""
        return f"line {self.line} of {self.file}" if self.file else f"line {self.line}"


@dataclass(eq=False, repr=False)
class Target:
    """A target whose numbers stand in the file; its uses and conflicts are gathered while the program is read."""

    name: str
    """As in the program, with the index for the element of an array; the place for a literal inside a move."""
    kind: TargetKind
    """``joint`` or ``pose``."""
    start: int
    """Where it begins in the text."""
    numbers: Sequence[Number]
    """As they stand in the file."""
    configuration: Configuration | None = None
    """Of a pose; None where it is not a literal."""
    configuration_spans: tuple[Span, ...] = ()
    """Where the configuration stands in the text."""
    external: str = ""
    """External axes as they stand in the file."""
    e: Mapping[str, float] = field(default_factory=dict)
    """Their positions by number, as written (mm or degrees): ``e1`` …."""
    uses: list[Use] = field(default_factory=list)
    """Direct uses in moves."""
    conflicts: list[str] = field(default_factory=list)
    """Why changing this literal would do more, or something else, than correct its direct uses."""
    near: FloatArray | None = None
    """Shape (6,). Joints of the URDF that the program names as the ones to start from, radians."""
    after: list[int | None] = field(default_factory=list)
    """For each use the number of the target that the arm comes from, `AT_START` for the place where the program begins;
    None where it may come from elsewhere.
    """
    line: int = 0
    column: int = 0
    """Where the literal begins; both start at 1."""
    value: FloatArray = field(default_factory=lambda: _NO_VALUE)
    """Shape (6,) or (4, 4). Joints of the URDF in radians, or ``T_wobj_tcp`` in metres; locked. NaN where ``conflicts``
    says that it has none.
    """
    inverted: bool = False
    """Whether the robot holds the part, and the value is the pose of the fixed tool in it."""
    carried: list[Carrying] = field(default_factory=list)
    """What the robot carries in each use."""
    split: Split | None = None
    """The shifted target in whose place in a move this one is to stand; ``numbers`` and ``configuration_spans`` are
    those of the target that is shifted.
    """

    @property
    def correctable(self) -> bool:
        """Whether a move uses this target and nothing speaks against changing it."""
        return bool(self.uses) and not self.conflicts

    @property
    def moves_axes(self) -> bool:
        """Whether it has external axes."""
        return bool(self.external)

    @property
    def reason(self) -> str:
        """Why the target is not correctable, one sentence part; empty if it is."""
        return "; ".join(self.conflicts) or ("" if self.uses else "no move of this module uses it")

    @property
    def written(self) -> tuple[float, ...]:
        """The numbers as they stand in the file."""
        return tuple(number.value for number in self.numbers)


class Split(NamedTuple):
    """A shifted target that becomes a target of its own, with numbers of its own."""

    target: Target
    """The one that is shifted."""
    T_left: FloatArray
    T_right: FloatArray
    """Shape (4, 4). See `Shift`."""
    span: Span
    """The text in whose place the new target stands."""


WITNESSES = 3
"""Points with whole postures at least that tell how targets of held parts are counted."""
UNCLEAR_SIDE = (
    "the tool is fixed and the part on the robot: the postures of such points do not tell whether they are counted in "
    "the part or at the tool"
)
EXTERNAL_AXES = "has external axes: where they carry the robot or the work, its place is another"
CARRIED = "ex_base"
"""Names of frames begin so that the program ties to external axes."""
PULSES = "pulses"
"""External axes of a target whose positions stand in pulses."""


def _carried(name: str | None) -> str:
    """Why a target in such a frame is left where no axis of the cell carries it."""
    return (
        f"external axes carry its base: say which, and how, with irbcal cell --axes (carries {name}), and give --cell"
    )


UNSET = "active"
"""Name of the tool and frame that hold before the program sets any."""

_IN = " in "
"""Between `UNSET` and the name of a routine: the tool or frame that holds where the routine begins."""

START = Target("the start", "joint", 0, ())
"""Stands for the place where a program begins, among the targets that stops come from."""

AT_START = -1
"""Its number in `Target.after`."""


@dataclass(frozen=True)
class FrameState:
    """Tool and frame, by name in lower case; None and the reason where they are computed; see `Use`."""

    tool: str | None = UNSET
    frame: str | None = UNSET
    why: str = ""
    held: bool = False


class Shift(NamedTuple):
    """A move to a target that the program shifts where it is used; the target itself stays."""

    target: Target
    at: int
    """Place of the move."""
    instruction: str
    text: str
    """Of the move, and its argument."""
    T_left: FloatArray
    T_right: FloatArray
    """Shape (4, 4). ``T_wobj_tcp = T_left @ target @ T_right``, metres."""
    known: bool
    """Whether the numbers of the shift stand in the program; else `PROBE` in each direction stands for them."""
    tool: str | None
    work_object: str | None
    """Names in lower case; None where the program computes them."""
    own: Target | None = None
    """The target of its own that the shifted one becomes."""


PROBE = 0.1
"""Metres by which a target is shifted to tell what becomes of shifts that are computed."""


class _Inherited(NamedTuple):
    """A use of a target in a block, and whether the tool or the frame is still the one from before the block."""

    target: Target
    tool: bool
    frame: bool


@dataclass
class _Block:
    loop: bool
    before: FrameState
    previous: Target | None
    stops: int
    used: list[_Inherited] = field(default_factory=list)
    changed: bool = False
    disturbed: bool = False
    tool_set: bool = False
    frame_set: bool = False


class ControlFlow:
    """Follows a program through its text: which tool and frame hold, and which stop comes before which.

    Text is followed from top to bottom. Where it branches or begins anew, the stop before is not known, but behind a
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
        self.moves_left: list[Left] = []
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
        self._state = replace(self.state, tool=name, why=reason or self.state.why)
        for block in self._blocks[-1:]:
            block.tool_set = True

    def frame(self, name: str | None, reason: str = "") -> None:
        """A frame is set; None where it is computed."""
        self._state = replace(self.state, frame=name, why=reason or self.state.why)
        for block in self._blocks[-1:]:
            block.frame_set = True

    def hold(self, held: bool) -> None:
        """Whether the robot holds the part from here on; tool and frame stay."""
        self._state = replace(self.state, held=held)

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

    def call(self, routine: str, shown: str, at: int) -> None:
        """A routine, by its name in lower case and as it is spelled, is called."""
        effect = self.calls.effect(routine)
        self.load_call(shown, at)
        self._calls_from.setdefault(routine, []).append(self.state)
        if effect.moves:
            self.forget()
        if effect.sets_frames:
            self.state = FrameState(None, None, may_set_frames(shown, self.listing.line(at)))

    def call_any_time(self, routine: str) -> None:
        """An interrupt or a signal calls a routine, by its name in lower case."""
        self._calls_from.setdefault(routine, []).append(FrameState(None, None))

    def load_call(self, shown: str, at: int) -> None:
        """What a call of a routine does to the load alone."""
        routine = shown.lower()
        sets = self.calls.effect(routine).sets_loads
        missing = may_set_load(shown, self.listing.line(at)) if sets and not self.calls.knows(routine) else ""
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
        begin = f"{UNSET}{_IN}{routine}" if routine else UNSET
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
        use = Use(line, self.listing.column(at), instruction, role, state.tool, state.frame, held=state.held)
        target.uses.append(use)
        if any(name is not None and _IN in name for name in (state.tool, state.frame)):
            self._inherits.append(target)
        if target.kind == "pose" and None in (state.tool, state.frame):
            target.conflicts.append(state.why or f"the tool or frame of {instruction} in line {line} is computed")
        if role == "via":
            self._passed.append((target, self.previous))
        tool, frame = not names_tool, not names_frame
        for block in reversed(self._blocks):
            tool, frame = tool and not block.tool_set, frame and not block.frame_set
            block.used.append(_Inherited(target, tool, frame))

    def stop(self, target: Target | None, at: int) -> None:
        """The arm stops at a target, or, with None, somewhere."""
        self._moving.add((self.listing.part(at), 0 if self.first_begins else self._routine))
        self._behind_offset |= {len(self.stops)} if self._offset else set()
        self.stops.append((at, target, self.previous))
        self.previous, self._offset = target, False

    def stop_beside(self, at: int) -> None:
        """The arm stops at a distance in numbers from a target, in the posture that it has."""
        before = self.previous
        self.stop(None, at)
        self.previous, self._offset = before, True

    def standing_at(self) -> Target | None:
        """The target of a move at which the arm stands; None where it is not known, or it stands beside one."""
        return self.previous if self.previous is not None and self.previous.uses and not self._offset else None

    def leave(self, at: int, instruction: str, target: str, reason: str) -> None:
        """Note a move, or a part of one, that goes to no target in numbers."""
        self.moves_left.append(Left(f"{instruction} {target}", self.listing.line(at), reason))

    def shift(self, shifts: Sequence[Shift], span: Span) -> Target | None:
        """A move goes to a target, or one of several, that is shifted; the target of its own where it becomes one.

        The move uses that one as any other target; ``span`` is the text in whose place it stands.
        """
        self.shifts += shifts
        shift = shifts[0]
        if not self.split_points or len(shifts) > 1 or not shift.known or shift.target.kind == "joint":
            return None
        split = Split(shift.target, shift.T_left, shift.T_right, span)
        name = f"{shift.text} in line {self.listing.line(span[0])}"
        fresh: dict[str, Any] = {"uses": [], "conflicts": [], "after": [], "carried": [], "near": None}
        own = replace(shift.target, name=name, start=span[0], split=split, **fresh)
        self.shifts[-1] = shift._replace(own=own)
        return own

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
            if shift.own is not None and shift.target.conflicts:
                shift.own.uses.clear()  # whatever is wrong with the target may be wrong with the shifted one
            elif shift.own is not None and shift.own.correctable and not shift.target.uses:
                continue
            frames_of_uses = {(use.tool, use.work_object) for use in shift.target.uses}
            held = any(use.held for use in shift.target.uses)
            if shift.target.kind == "pose" and frames_of_uses == {(shift.tool, shift.work_object)} and not held:
                self.shifts.append(shift)
            else:
                reason = "it is shifted, and the robot holds the part" if held else ""
                reason = (
                    reason
                    or f"it is shifted, and no move goes to {shift.target.name} itself with the same tool and frame"
                )
                self.leave(shift.at, shift.instruction, shift.text, reason)
                self.mention(shift.target, shift.at)

    def _of_calls(self, target: Target, use: Use) -> Use:
        """A use with the tool and frame that hold where its routine is called, as far as it sets none itself."""
        tool, frame = self._at_begin("tool", use.tool), self._at_begin("frame", use.work_object)
        for kind, before, after in (("tool", use.tool, tool), ("frame", use.work_object, frame)):
            if before is not None and after is None and target.kind == "pose":
                routine = before.partition(_IN)[2]
                target.conflicts.append(f"{routine} is called with different or computed {kind}s, and sets none itself")
        return replace(use, tool=tool, work_object=frame)

    def _at_begin(self, kind: Literal["tool", "frame"], name: str | None) -> str | None:
        """Tool or frame that a name means which stands for what holds where a routine begins; None of several."""
        waiting, known = [name], dict[str | None, None]()
        names = set[str | None]()
        while waiting:
            name = waiting.pop()
            callers = self._calls_from.get(name.partition(_IN)[2]) if name is not None and _IN in name else ()
            if callers is None:
                names.add(UNSET)
            elif not callers:
                names.add(name)
            elif name not in known:
                waiting += [None if state.held else getattr(state, kind) for state in callers]
            known[name] = None
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
            block.changed |= self.state != block.before
            self._state = block.before
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
        state_before = block.before
        if not block.changed and self.state == state_before:
            return
        line = self.listing.line(at)
        reason = f"the tool or frame is set in the branch or loop that ends in line {line}"
        other = block.changed or self.state.held != state_before.held
        other_tool, other_frame = self.state.tool != state_before.tool, self.state.frame != state_before.frame
        for used in block.used if block.loop else ():
            if other or (used.tool and other_tool) or (used.frame and other_frame):
                used.target.conflicts.append(reason)
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
                target.after.append(previous)
        for target, previous_target in self._passed:
            target.after.append(None if previous_target is None else numbers.get(id(previous_target)))
        return tuple(out)


@dataclass(frozen=True, eq=False, repr=False)
class TextProgram(Locked, Program):
    """A program as read: its text and what was understood of it; a language says how it is marked."""

    source: str
    """File name for messages."""
    listing: Listing
    """Its text."""
    maker: Maker
    """How numbers are written."""
    targets: tuple[Target, ...]
    """In the order of the file."""
    tools: Mapping[str, FloatArray]
    work_objects: Mapping[str, FloatArray]
    """Values of shape (4, 4). ``T_tip_tcp`` and ``T_base_wobj`` of the names (lower case) that direct uses of poses
    need, and of those of joint targets that are known; metres.
    """
    order: tuple[Stop, ...]
    """The stops in the order of the program."""
    moves_left: tuple[Left, ...]
    """Moves that are left as they are."""
    notes: tuple[Note, ...]
    """What the user should look at."""
    fingerprint: str | None
    """Of the calibration that this program was already corrected with; empty where the mark does not say."""
    mark_at: int
    """Where the mark goes."""
    axes: tuple[ExternalAxis, ...] = field(default=(), kw_only=True)
    """External axes of the cell, where they are known."""
    shifts: tuple[Shift, ...] = field(default=(), kw_only=True)
    """Moves to corrected targets that are shifted where they are used."""
    start: FloatArray | None = field(default=None, kw_only=True)
    assumed: FloatArray | None = field(default=None, kw_only=True)
    """Shape (6,). Joints of the URDF, radians: where the program begins, and those next to which poses are meant where
    nothing else says.
    """
    loads: LoadFlow = field(default_factory=LoadFlow, kw_only=True)
    """What the robot carries."""
    names_loads: tuple[int, ...] = field(default=(), kw_only=True)
    """Places in the text that say so."""
    T_tip_flange: FloatArray | None = field(default=None, kw_only=True)
    """Shape (4, 4). The controller's flange, in which loads are; None where it is not known."""
    marks_beside: tuple[int, ...] = field(default=(), kw_only=True)
    """Where it goes in the other files, if their targets are corrected."""

    def on_axes(self, axes: Sequence[ExternalAxis]) -> Self:
        """The program in a cell with external axes: targets that do not say where these are stay as they are."""
        for target in self.targets:
            for use in target.uses:
                if any(use.work_object in axis.carries for axis in axes):
                    target.conflicts = [text for text in target.conflicts if text != _carried(use.work_object)]
                missing = [axis.name for axis in moving(axes, use.work_object) if axis.name not in target.e]
                if missing:
                    pulses = "its external axes are in pulses, of which it is not known how many a mm or degree has"
                    conflict = (
                        pulses if target.external == PULSES else f"it has no position of external axis {missing[0]}"
                    )
                    target.conflicts.append(conflict)
            target.conflicts = list(dict.fromkeys(target.conflicts))
        return replace(self, axes=tuple(axes))

    def axes_notes(self) -> list[Note]:
        """A note if targets of moves have external axes, of which the cell says nothing."""
        moved = next((target for target in self.targets if target.uses and target.moves_axes), None)
        return [] if moved is None or self.axes else [Note(moved.line, f"{moved.name} {EXTERNAL_AXES}")]

    @abstractmethod
    def mark(self, fingerprint: str, at: int) -> Edit:
        """The comment that marks a file of a corrected program, at a place."""

    @abstractmethod
    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """Configurations of pose targets that joints (n, 6) in radians reach; None where none is to be written."""

    def configuration_edits(self, target: Target, configuration: Configuration) -> list[Edit]:
        """New text of the configuration of a target; none where the language writes none."""
        return []

    def number_text(self, old: Number, new: float, decimals: int) -> str | None:
        """Text of a new number with ``decimals`` decimals at least; None where the old text stays."""
        text = number_like(self.text[old.start : old.end], new, decimals)
        return None if float(text) == old.value else text

    def joint_units(self, target: Target) -> Any:
        """SI value of one unit of the joints of a target, one for all or one for each."""
        return self.maker.joint

    @property
    def text(self) -> str:
        """Of all files."""
        return self.listing.text

    @property
    def data(self) -> bytes:
        """The bytes of all files."""
        return b"".join(self.listing.files_with([]).values())

    def correctable(self, kind: TargetKind | None = None) -> list[int]:
        """Numbers of the targets that may be changed, of one kind or of both."""
        return [k for k, t in enumerate(self.targets) if t.correctable and kind in (None, t.kind)]

    def wanted_targets(self) -> list[WantedTargets]:
        """The targets that may be corrected: joints first, then poses."""
        out = []
        if joints := self.correctable("joint"):
            out.append(self._batch("joint", joints, np.array([self.targets[k].value for k in joints])))
        if poses := self.correctable("pose"):
            T = self.tip_poses(poses)
            out.append(self._batch("pose", poses, T, *self.meant_joints(poses, T)))
        return out

    def meant_joints(self, poses: Sequence[int], T_base_tip: FloatArray) -> tuple[FloatArray | None, Sequence[str]]:
        """Joints (n, 6) that the controller takes for poses, and why there are none; None: configurations tell them."""
        return None, ()

    def next_to_stops(
        self,
        poses: Sequence[int],
        q: FloatArray,
        reasons: list[str],
        waiting: Iterable[int],
        solutions: Solutions,
        check: Callable[[FloatArray, FloatArray], str] | None = None,
    ) -> None:
        """Find joints of poses next to the stop before, in the order of the program, in place.

        Parameters
        ----------
        poses : sequence of int, length n
            Numbers of the targets.
        q : ndarray, shape (n, 6)
            Joints that are known, radians; NaN elsewhere.
        reasons : list of str, length n
            Why there are none.
        waiting : iterable of int
            Rows to find joints for.
        solutions : Solutions
            Of the poses.
        check : callable, optional
            What speaks against going from joints (6,) to others; empty where nothing does.
        """
        row_of = {number: row for row, number in enumerate(poses)}
        stops = [stop.target for stop in self.order if stop.target is not None]
        wanted = set(waiting)
        in_order = [*(row_of[number] for number in stops if number in row_of), *range(len(poses))]  # vias last
        for row in dict.fromkeys(row for row in in_order if row in wanted):
            known = [self._joints_of(number, row_of, q) for number in self.targets[poses[row]].after or (None,)]
            assumed = self.assumed is not None and not np.isfinite(known).all()
            starts = np.array(known)
            if self.assumed is not None:
                starts = np.where(np.isfinite(starts), starts, self.assumed)
            if not np.isfinite(starts).all():
                continue
            q_ends, reasons_found = solutions.next_to(np.full(len(starts), row), starts)
            q[row], reasons[row] = q_ends[0], next(filter(None, reasons_found), "")
            if not reasons[row] and np.abs(q_ends - q_ends[0]).max() > 1e-6:
                reasons[row] = "the stops before its moves lead to different solutions of the arm"
            judge = solutions.unclear if assumed else check
            if not reasons[row] and judge is not None:
                reasons[row] = next(filter(None, (judge(s, e) for s, e in zip(starts, q_ends, strict=True))), "")
            if reasons[row]:
                q[row] = np.nan

    def _joints_of(self, number: int | None, row_of: Mapping[int, int], q: FloatArray) -> FloatArray:
        """Joints of the URDF at a target, NaN where they are not known."""
        if number == AT_START and self.start is not None:
            return self.start
        if number is not None and number >= 0 and self.targets[number].kind == "joint":
            return self.joints_at(self.targets[number])
        return np.full(6, np.nan) if number is None or number not in row_of else q[row_of[number]]

    def joints_at(self, target: Target) -> FloatArray:
        """Joints of the URDF of a joint target, radians."""
        return target.value

    def _batch(
        self,
        kind: TargetKind,
        numbers: list[int],
        values: FloatArray,
        joints: FloatArray | None = None,
        unknown: Sequence[str] = (),
    ) -> WantedTargets:
        targets = [self.targets[k] for k in numbers]
        return WantedTargets(
            kind,
            np.array(numbers),
            tuple(target.name for target in targets),
            np.array([target.line for target in targets]),
            values,
            tuple(target.configuration for target in targets) if kind == "pose" else None,
            joints,
            tuple(unknown),
            self._loads_of(targets) if self.loads.names_any else (),
        )

    def _loads_of(self, targets: Sequence[Target]) -> tuple[tuple[Load | None, ...], ...]:
        """What the robot carries at targets, centres in the tip link."""
        keys = [tuple(dict.fromkeys(target.carried)) for target in targets]
        known = {key: self._carried(key) for key in dict.fromkeys(keys)}
        return tuple(known[key] for key in keys)

    def _carried(self, carried: Sequence[Carrying]) -> tuple[Load | None, ...]:
        out: dict[Load | None, None] = {}
        for ways, tool, frame in carried:
            for load in self.loads.loads(ways):
                part = load if load is None or frame is None else seen_from(load, self.tools.get(frame))
                whole = part if part is None or tool is None else combined([tool, part])
                out[whole if whole is None else seen_from(whole, self.T_tip_flange)] = None
        return tuple(out)

    def left(self) -> list[Left]:
        """Targets that are not correctable, and moves whose target is not."""
        targets = [t for t in self.targets if t.conflicts]
        return [*(Left(t.name, t.line, t.reason) for t in targets), *self.moves_left]

    def stops(self) -> tuple[Stop, ...]:
        """The stops in the order of the program."""
        return self.order

    def edits(self, values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]) -> list[Edit]:
        """New text of numbers and configurations, by the number of the target.

        Raises
        ------
        ValueError
            If a value is not finite, not rigid or of the wrong shape.
        """
        poses = [k for k in values if self.targets[k].kind == "pose"]
        for k, value in values.items():
            shape = (4, 4) if self.targets[k].kind == "pose" else (6,)
            if np.shape(value) != shape or not np.isfinite(value).all():
                raise ValueError(f"target {self.targets[k].name}: expected finite numbers of shape {shape}")
        T = np.array([values[k] for k in poses]).reshape(-1, 4, 4)
        check_rigid(T)
        near = np.array([self.targets[k].written for k in poses])
        rows = dict(zip(poses, self.maker.numbers(T, near), strict=True)) if poses else {}
        out: list[Edit] = []
        for k, value in values.items():
            target = self.targets[k]
            position, angle, joint = self.maker.decimals
            if target.split is not None:
                out += self.split_edits(target, rows[k].tolist(), configurations.get(k))
                continue
            if target.kind == "joint":
                row, decimals_at_least = (
                    self.maker.program_joints(np.asarray(value)) / self.joint_units(target),
                    [joint] * 6,
                )
            else:
                row = rows[k]
                decimals_at_least = [position] * 3 + [angle] * (len(row) - 3)
            for number, new, decimals in zip(target.numbers, row, decimals_at_least, strict=True):
                text = self.number_text(number, float(new), decimals)
                out += [] if text is None else [self._aligned(number.start, number.end, text)]
        for k, configuration in configurations.items():
            out += [] if self.targets[k].split else self.configuration_edits(self.targets[k], configuration)
        return out

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """Text of a target of its own in place of a shifted one; for languages that have such (`ControlFlow.shift`)."""
        raise NotImplementedError

    def split_texts(self, target: Target, numbers: list[float]) -> list[str]:
        """New numbers with as many decimals as those of the target that was shifted."""
        position, angle, _ = self.maker.decimals
        decimals = [position] * 3 + [angle] * (len(numbers) - 3)
        old = [self.text[number.start : number.end] for number in target.numbers]
        return [number_like(text, value, k) for text, value, k in zip(old, numbers, decimals, strict=True)]

    def split_configuration(self, target: Target, configuration: Configuration | None) -> list[str]:
        """Texts of the parts of the configuration of a target of its own, changed where they must."""
        edits = {} if configuration is None else {e[:2]: e[2] for e in self.configuration_edits(target, configuration)}
        return [edits.get(span, self.text[slice(*span)]) for span in target.configuration_spans]

    def _aligned(self, start: int, end: int, text: str) -> Edit:
        """The edit of a number, with its right edge kept where the maker wants that."""
        if self.maker.aligned:
            more = len(text) - (end - start)
            blanks = len(self.text[:start]) - len(self.text[:start].rstrip(" ")) if more > 0 else 0
            text = text.rjust(end - start) if more <= 0 else text
            start -= min(max(more, 0), max(blanks - 1, 0))
        return start, end, text

    def with_fake_targets(self, corrections: Corrections, fingerprint: str | None) -> dict[str, bytes]:
        """Files of the program with fake targets, configurations and, with a fingerprint, the mark."""
        values: dict[int, FloatArray] = {}
        configurations: dict[int, Configuration] = {}
        for batch, fake in corrections:
            rows = np.flatnonzero(fake.ok)
            chosen = batch.numbers[rows].tolist()
            if batch.kind == "joint":
                values |= dict(zip(chosen, fake.q[rows], strict=True))
                continue
            values |= self.values_for_tip_poses(chosen, fake.T_fake[rows])
            new = self.new_configurations([self.targets[k] for k in chosen], fake.q[rows])
            configurations |= {
                k: configuration for k, configuration in zip(chosen, new, strict=True) if configuration is not None
            }
        if not values:
            return self.listing.files_with([])
        edits = self.edits(values, configurations)
        if fingerprint is not None:
            changed = {self.listing.part(max(start, stop - 1)) for start, stop, _ in edits}
            beside = [at for at in self.marks_beside if self.listing.part(at) in changed]
            edits += [self.mark(one_word(fingerprint), at) for at in (self.mark_at, *beside)]
        return self.listing.files_with(edits)

    def tip_poses(self, indices: Sequence[int]) -> FloatArray:
        """Poses of the flange ``T_base_tip`` (n, 4, 4), metres, that correctable pose targets ask for."""
        T_base_wobj, T_tip_tcp = self._frames_of(indices)
        values = self._seen_from_base(indices, np.array([self.targets[k].value for k in indices]).reshape(-1, 4, 4))
        return T_base_wobj @ values @ frames.inverse(T_tip_tcp)

    def shifted(self, values: Mapping[int, FloatArray]) -> list[tuple[int, Shift, FloatArray, FloatArray, FloatArray]]:
        """Shifts of pose targets that get new values.

        Parameters
        ----------
        values : dict of int to ndarray, shape (4, 4)
            New values by the number of the target.

        Returns
        -------
        list of tuple
            Number of the target, the shift, poses of the tip in the base link (m, 4, 4) before and after, one for each
            probe, and the tool (4, 4).
        """
        numbers = {id(target): k for k, target in enumerate(self.targets)}
        out = []
        for shift in self.shifts:
            k = numbers.get(id(shift.target), -1)
            if k not in values:
                continue
            (T_base_wobj,), (T_tip_tcp,) = self._frames_of([k])
            probes = [np.eye(4)] if shift.known else [frames.transform(None, PROBE * axis) for axis in np.eye(3)]
            behind = frames.inverse(T_tip_tcp)
            before, after = (
                np.array([T_base_wobj @ (shift.T_left @ probe) @ value @ shift.T_right @ behind for probe in probes])
                for value in (self.targets[k].value, values[k])
            )
            out.append((k, shift, before, after, T_tip_tcp))
        return out

    def values_for_tip_poses(self, indices: Sequence[int], T_base_tip: ArrayLike) -> dict[int, FloatArray]:
        """Values of pose targets that make the flange reach given poses; the inverse of `tip_poses`."""
        T_base_wobj, T_tip_tcp = self._frames_of(indices)
        values = frames.inverse(T_base_wobj) @ np.asarray(T_base_tip, dtype=float).reshape(-1, 4, 4) @ T_tip_tcp
        return dict(zip(indices, self._seen_from_base(indices, values), strict=True))

    def _seen_from_base(self, indices: Sequence[int], values: FloatArray) -> FloatArray:
        """Values (n, 4, 4) of pose targets as what is on the tip in what stands in the base, and the way back."""
        inverted = np.array([self.targets[k].inverted for k in indices], dtype=bool)[:, None, None]
        return np.where(inverted, frames.inverse(values), values)

    def _frames_of(self, indices: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        uses = [self.targets[k].uses[0] for k in indices]  # a correctable target is used with one tool and work object
        work_objects = [self.work_objects[use.work_object or ""] for use in uses]
        if self.axes:
            moves = zip(indices, uses, work_objects, strict=True)
            work_objects = [
                carried(self.axes, use.work_object or "", self.targets[k].e, nominal=True) @ T for k, use, T in moves
            ]
        tools = [self.tools[use.tool or ""] for use in uses]
        return np.array(work_objects).reshape(-1, 4, 4), np.array(tools).reshape(-1, 4, 4)


@dataclass(frozen=True, eq=False, repr=False)
class PostureProgram(TextProgram):
    """A program whose poses name a posture, or none: all languages but RAPID."""

    arm: Arm
    """What the controller computes with."""
    own_model: Arm | None
    """What the controller itself computes with where that is not ``arm``."""
    joints_of_urdf: ClassVar[bool] = True

    @classmethod
    def assembled(
        cls,
        maker: Maker,
        arm: Arm,
        flow: ControlFlow,
        targets: Sequence[Target],
        setup: ControllerSetup,
        tools: Mapping[str, FloatArray],
        work_objects: Mapping[str, FloatArray],
        *,
        comments: Iterable[str],
        mark_at: int,
        notes: Iterable[Note] = (),
        source: str = "",
        units: FloatArray | None = None,
        **more: Any,
    ) -> Self:
        """A program from what a language found: targets, the moves that use them, and its frames.

        Poses whose frames are not known, or of which it is not known where the controller counts them, are left.
        """
        maker, listing = maker.of(arm), flow.listing
        flow.settle()
        source = source or listing.parts[0].name
        order = flow.order(targets)
        done = complete(targets, listing, maker, units, arm)
        if reason := _unknown_ends(maker, arm, setup):
            for target in done:
                target.conflicts += [reason] if target.kind == "pose" and target.correctable else []
        on_tip, in_base = needed_frames(done, setup, tools, work_objects)
        for target in done:
            names = dict.fromkeys(use.work_object for use in target.uses if (use.work_object or "").startswith(CARRIED))
            target.conflicts += map(_carried, names)
        program = cls(
            source=source,
            listing=listing,
            maker=maker,
            targets=done,
            tools=on_tip,
            work_objects=in_base,
            order=order,
            moves_left=tuple(flow.moves_left),
            notes=tuple(notes),
            fingerprint=mark_in(comments),
            mark_at=mark_at,
            arm=arm,
            own_model=setup.own_model,
            start=setup.start,
            assumed=setup.posture,
            shifts=tuple(flow.shifts),
            loads=flow.loads,
            names_loads=tuple(flow.names_loads),
            T_tip_flange=setup.controller.T_tip_flange
            if setup.controller.flange_known or arm.tip_link == "tool0"
            else None,
            **more,
        )
        program._settle_held_parts()
        return program

    def _settle_held_parts(self) -> None:
        """Find out from postures whether targets of held parts are poses of the fixed tool in the part, or the inverse.

        Makers do not say which it is. The postures of whole points, `WITNESSES` or more, decide: the robot must reach
        all of them as one of the two, and not all of them as the other; else such targets are left.
        """
        held = [k for k in self.correctable("pose") if self.targets[k].uses[0].held]
        whole: list[int] = []
        for k in held:
            posture = self.targets[k].configuration
            if isinstance(posture, Posture) and posture.whole and np.isfinite([*posture.low, *posture.high]).any():
                whole.append(k)
        fits = []
        unknown = np.full((len(whole), 6), np.nan)
        for inverted in (False, True):
            for k in held:
                self.targets[k].inverted = inverted
            postures = [posture for k in whole if isinstance(posture := self.targets[k].configuration, Posture)]
            solutions = Solutions(self.maker, self.arm, self.tip_poses(whole), postures, self.own_model)
            _, reasons = solutions.next_to(np.arange(len(whole)), unknown)
            fits.append(len(whole) >= WITNESSES and not any(reasons))
        for k in held:
            self.targets[k].inverted = fits[1]
            if fits[0] == fits[1]:
                self.targets[k].conflicts.append(UNCLEAR_SIDE)

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture | None:
        """Posture as the language writes it; None where it writes none.

        Parameters
        ----------
        back, bent, negative : bool
            See `irbcal.correction.maker.Maker.postures`.
        joints : ndarray, shape (6,)
            As the controller counts them, radians.
        """
        return None

    def postures(self, q: FloatArray) -> Sequence[Posture | None]:
        """Postures of joints (n, 6) of the URDF."""
        if not len(q) or type(self).posture is PostureProgram.posture:
            return [None] * len(q)
        flags = (flag.tolist() for flag in self.maker.postures(self.arm, q))
        return [self.posture(*row) for row in zip(*flags, self.maker.program_joints(q), strict=True)]

    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """The postures that the new joints have."""
        pairs = zip(targets, self.postures(q), strict=True)
        return [posture if target.configuration_spans else None for target, posture in pairs]

    def meant_joints(self, poses: Sequence[int], T_base_tip: FloatArray) -> tuple[FloatArray, list[str]]:
        """Joints that the controller takes for poses: those of the posture, else those next to the stop before."""
        targets = [self.targets[k] for k in poses]
        postures = [t.configuration if isinstance(t.configuration, Posture) else Posture() for t in targets]
        unknown = np.full(6, np.nan)
        near = np.array([unknown if t.near is None else t.near for t in targets]).reshape(-1, 6)
        determined = np.array([p.whole for p in postures], dtype=bool) | np.isfinite(near).all(axis=1)
        q = np.full((len(poses), 6), np.nan)
        reasons = [NO_POSTURE] * len(poses)

        solutions = Solutions(self.maker, self.arm, T_base_tip, postures, self.own_model)
        rows = np.flatnonzero(determined)
        q[rows], reasons_found = solutions.next_to(rows, near[rows])
        for k, reason in zip(rows.tolist(), reasons_found, strict=True):
            reasons[k] = reason
        self.next_to_stops(poses, q, reasons, np.flatnonzero(~determined).tolist(), solutions)
        return q, reasons


def complete(
    targets: Iterable[Target], listing: Listing, maker: Maker, units: FloatArray | None = None, arm: Arm | None = None
) -> tuple[Target, ...]:
    """Values, places and conflicts of targets whose uses are gathered.

    Parameters
    ----------
    targets : iterable of Target
    listing : Listing
    maker : Maker
    units : ndarray, shape (6,), optional
        Of joints where they are others than the maker's, radians.
    arm : Arm, optional
        Joints that it does not reach are none of its own.
    """
    out = tuple(targets)
    poses = [target for target in out if target.kind == "pose"]
    rows = np.array([target.written for target in poses])
    usable = np.array([maker.problem("pose", target.written) is None for target in poses], dtype=bool)
    values = np.full((len(poses), 4, 4), np.nan)
    if usable.any():
        values[usable] = maker.poses(rows[usable])
    values.setflags(write=False)
    for target, value in zip(poses, values, strict=True):
        target.value = value
        if target.split is not None:
            target.value = target.split.T_left @ value @ target.split.T_right
            target.value.setflags(write=False)
    for target in out:
        target.line, target.column = listing.line(target.start), listing.column(target.start)
        if target.uses and not target.conflicts and (problem := maker.problem(target.kind, target.written)) is not None:
            target.conflicts.append(problem)
        if target.kind == "joint":
            written = np.array(target.written)
            in_range = np.abs(written) < maker.largest
            joints = maker.joints(np.where(in_range, written, 0.0) * (maker.joint if units is None else units))
            target.value = np.where(in_range, joints, np.nan)
            target.value.setflags(write=False)
            if arm is not None and not target.conflicts:
                outside = np.flatnonzero((target.value < arm.lower - BEYOND) | (target.value > arm.upper + BEYOND))
                target.conflicts += [f"joint {k + 1} is outside the limits of {arm.name}" for k in outside[:1]]
        else:
            target.conflicts += _different_frames(target.uses)
        if target.near is not None:
            target.near.setflags(write=False)
        target.conflicts = list(dict.fromkeys(target.conflicts))
        target.after = list(dict.fromkeys(target.after))
    return out


def _different_frames(uses: Sequence[Use]) -> list[str]:
    """What speaks against a pose whose moves name several tools or work objects."""
    if len({use.held for use in uses}) > 1:
        return ["used with the part on the robot, and with the tool on it"]
    tools = {use.tool: use.place for use in reversed(uses)}
    work_objects = {use.work_object: use.place for use in reversed(uses)}
    out = []
    for kind, names in (("tools", tools), ("work objects", work_objects)):
        if len(names) > 1:
            usage = ", ".join(f"{name or 'a computed one'} ({lines_text})" for name, lines_text in names.items())
            out.append(f"used with different {kind}: {usage}")
    return out


def needed_frames(
    targets: Sequence[Target],
    setup: ControllerSetup,
    tools: Mapping[str, FloatArray],
    work_objects: Mapping[str, FloatArray],
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Tools on the tip and work objects in the base link of all targets that may be corrected.

    Poses need them, and are left where one is not known; of joint targets those are taken that are known.

    Parameters
    ----------
    targets : sequence of Target
    setup : ControllerSetup
        Frames from the caller go before those of the program.
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        What the program says, in the controller's flange and world.
    """
    frame_values = {**tools, **setup.tools}, {**work_objects, **setup.work_objects}
    T_base_world = setup.controller.T_base_world
    if setup.T_world_base is not None:
        T_base_world = T_base_world @ frames.inverse(setup.T_world_base)
    ends = setup.controller.T_tip_flange, T_base_world
    needed: tuple[dict[str, FloatArray], dict[str, FloatArray]] = {}, {}
    for target in targets:
        against: list[str] = []
        for use in target.uses if target.correctable else ():
            for k, (kind, name) in enumerate((("tool", use.tool), ("frame", use.work_object))):
                if name is None or name in needed[k]:
                    continue
                if name not in frame_values[k]:
                    against.append(f"the program does not define the {kind} {name}: give it with --{kind} {name}=…")
                elif np.isfinite(frame_values[k][name]).all():
                    needed[k][name] = ends[k] @ frame_values[k][name]
                else:
                    against.append(f"{kind} {name}: found a number that is too large")
        target.conflicts += dict.fromkeys(against) if target.kind == "pose" else ()
    return needed


class NumberedData(NamedTuple):
    """Tools, user frames and loads by number, as the backup has them in which a program lies."""

    tools: Mapping[str, FloatArray] = MappingProxyType({})
    user_frames: Mapping[str, FloatArray] = MappingProxyType({})
    """Values of shape (4, 4). In the controller's flange and world, metres."""
    loads: Mapping[str, Load] = MappingProxyType({})
    """In the controller's flange."""


def from_backup(targets: Sequence[Target], setup: ControllerSetup, backup: NumberedData, source: str) -> list[Note]:
    """A note of the tools and user frames of poses that are those of a file of the backup."""
    uses = [use for target in targets if target.kind == "pose" for use in target.uses]
    taken = [
        f"{title} {number}"
        for title, numbers, known, given in (
            ("tool", {use.tool for use in uses}, backup.tools, setup.tools),
            ("user frame", {use.work_object for use in uses}, backup.user_frames, setup.work_objects),
        )
        for number in sorted(filter(None, numbers))
        if number in known and number not in given and number != "0"
    ]
    return [Note(1, f"{', '.join(taken)}: the numbers are those of {source}")] if taken else []


def _unknown_ends(maker: Maker, arm: Arm, setup: ControllerSetup) -> str:
    """Why it is not known in which frames the controller counts poses; empty where it is."""
    missing = [
        name
        for name, needed, present in (
            ("base (the controller's world)", maker.world, setup.controller.base_known),
            ("tool0 (its flange)", arm.tip_link != "tool0", setup.controller.flange_known),
        )
        if needed and not present
    ]
    if not missing:
        return ""
    return (
        f"the URDF of {arm.name} has no link {' and no link '.join(missing)} that is fixed to its ends, or it is not "
        "at hand: without it a pose has no place"
    )
