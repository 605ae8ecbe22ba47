"""Targets of robot programs: the numbers of a point, the moves that use it, and what keeps it from being corrected."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, locked
from irbcal.correction.listing import Listing, Number, Span
from irbcal.correction.loads import Carrying
from irbcal.correction.maker import FAR_BEYOND_LIMIT, ConfData, Maker, Posture
from irbcal.correction.program import TargetKind
from irbcal.modeling.arm import Arm

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
    part_on_robot: bool = False
    """Whether the robot holds the part: ``tool`` is that part, and ``work_object`` the fixed tool."""

    @property
    def line_in_words(self) -> str:
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
    previous: list[int | None] = field(default_factory=list)
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
    numeric: bool
    """Whether the numbers of the shift stand in the program; else `PROBE` in each direction stands for them."""
    tool: str | None
    work_object: str | None
    """Names in lower case; None where the program computes them."""
    new_target: Target | None = None
    """The target of its own that the shifted one becomes."""


EXTERNAL_AXES = "has external axes: where they carry the robot or the work, its place is another"

PULSES = "pulses"
"""External axes of a target whose positions stand in pulses."""

UNSET = "active"
"""Name of the tool and frame that hold before the program sets any."""

IN_ROUTINE = " in "
"""Between `UNSET` and the name of a routine: the tool or frame that holds where the routine begins."""

START = Target("the start", "joint", 0, ())
"""Stands for the place where a program begins, among the targets that stops come from."""

AT_START = -1
"""Its number in `Target.after`."""

PROBE = 0.1
"""Metres by which a target is shifted to tell what becomes of shifts that are computed."""


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
                outside = np.flatnonzero(
                    (target.value < arm.lower - FAR_BEYOND_LIMIT) | (target.value > arm.upper + FAR_BEYOND_LIMIT)
                )
                target.conflicts += [f"joint {k + 1} is outside the limits of {arm.name}" for k in outside[:1]]
        else:
            target.conflicts += _different_frames(target.uses)
        if target.near is not None:
            target.near.setflags(write=False)
        target.conflicts = list(dict.fromkeys(target.conflicts))
        target.previous = list(dict.fromkeys(target.previous))
    return out


def _different_frames(uses: Sequence[Use]) -> list[str]:
    """What speaks against a pose whose moves name several tools or work objects."""
    if len({use.part_on_robot for use in uses}) > 1:
        return ["used with the part on the robot, and with the tool on it"]
    tools = {use.tool: use.line_in_words for use in reversed(uses)}
    work_objects = {use.work_object: use.line_in_words for use in reversed(uses)}
    out = []
    for kind, names in (("tools", tools), ("work objects", work_objects)):
        if len(names) > 1:
            usage = ", ".join(f"{name or 'a computed one'} ({lines_text})" for name, lines_text in names.items())
            out.append(f"used with different {kind}: {usage}")
    return out
