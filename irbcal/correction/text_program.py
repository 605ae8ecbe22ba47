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
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.cell.external_axes import ExternalAxis, carried, moving
from irbcal.correction.listing import Edit, Listing, Number, mark_in, number_like, one_word
from irbcal.correction.loads import Carrying, Load, LoadFlow, combined, seen_from
from irbcal.correction.maker import NO_POSTURE, Maker, Posture, Solutions
from irbcal.correction.notation import check_rigid
from irbcal.correction.program import (
    ControllerSetup,
    Corrections,
    Note,
    Program,
    Stop,
    TargetKind,
    Unchanged,
    WantedTargets,
)
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

if TYPE_CHECKING:
    from typing_extensions import Self
from irbcal.correction.control_flow import ControlFlow
from irbcal.correction.targets import AT_START, EXTERNAL_AXES, PROBE, PULSES, Configuration, Shift, Target, complete

WITNESSES = 3
"""Points with whole postures at least that tell how targets of held parts are counted."""

UNCLEAR_SIDE = (
    "the tool is fixed and the part on the robot: the postures of such points do not tell whether they are counted in "
    "the part or at the tool"
)

ON_EXTERNAL_AXES = "ex_base"
"""Names of frames begin so that the program ties to external axes."""


def _carried(name: str | None) -> str:
    """Why a target in such a frame is left where no axis of the cell carries it."""
    return (
        f"external axes carry its base: say which, and how, with irbcal cell --axes (carries {name}), and give --cell"
    )


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
    unchanged_moves: tuple[Unchanged, ...]
    """Moves that are left as they are."""
    notes: tuple[Note, ...]
    """What the user should look at."""
    fingerprint: str | None
    """Of the calibration that this program was already corrected with; empty where the mark does not say."""
    mark_at: int
    """Where the mark goes."""
    arm: Arm
    """What the controller computes with."""
    controller_arm: Arm | None
    """What the controller itself computes with where that is not ``arm``."""
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

    @abstractmethod
    def meant_joints(self, poses: Sequence[int], T_base_tip: FloatArray) -> tuple[FloatArray, Sequence[str]]:
        """Joints (n, 6) of the URDF that the controller takes for poses, NaN where none, and why there are none."""

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
            q_before = [self._joints_of(number, row_of, q) for number in self.targets[poses[row]].previous or (None,)]
            assumed = self.assumed is not None and not np.isfinite(q_before).all()
            starts = np.array(q_before)
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
            return self.targets[number].value
        return np.full(6, np.nan) if number is None or number not in row_of else q[row_of[number]]

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
            joints,
            tuple(unknown),
            self._loads_of(targets) if self.loads.names_any else (),
        )

    def _loads_of(self, targets: Sequence[Target]) -> tuple[tuple[Load | None, ...], ...]:
        """What the robot carries at targets, centres in the tip link."""
        keys = [tuple(dict.fromkeys(target.carried)) for target in targets]
        loads = {key: self._carried(key) for key in dict.fromkeys(keys)}
        return tuple(loads[key] for key in keys)

    def _carried(self, carried: Sequence[Carrying]) -> tuple[Load | None, ...]:
        out: dict[Load | None, None] = {}
        for ways, tool, frame in carried:
            for load in self.loads.loads(ways):
                part_load = load if load is None or frame is None else seen_from(load, self.tools.get(frame))
                total_load = part_load if part_load is None or tool is None else combined([tool, part_load])
                out[total_load if total_load is None else seen_from(total_load, self.T_tip_flange)] = None
        return tuple(out)

    def unchanged_targets(self) -> list[Unchanged]:
        """Targets that are not correctable, and moves whose target is not."""
        targets = [t for t in self.targets if t.conflicts]
        return [*(Unchanged(t.name, t.line, t.reason) for t in targets), *self.unchanged_moves]

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
            changed = {self.listing.file_at(max(start, stop - 1)) for start, stop, _ in edits}
            beside = [at for at in self.marks_beside if self.listing.file_at(at) in changed]
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
            probes = [np.eye(4)] if shift.numeric else [frames.transform(None, PROBE * axis) for axis in np.eye(3)]
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
        maker, listing = maker.for_arm(arm), flow.listing
        flow.settle()
        source = source or listing.files[0].name
        order = flow.order(targets)
        finished = complete(targets, listing, maker, units, arm)
        if reason := _unknown_ends(maker, arm, setup):
            for target in finished:
                target.conflicts += [reason] if target.kind == "pose" and target.correctable else []
        on_tip, in_base = needed_frames(finished, setup, tools, work_objects)
        for target in finished:
            names = dict.fromkeys(
                use.work_object for use in target.uses if (use.work_object or "").startswith(ON_EXTERNAL_AXES)
            )
            target.conflicts += map(_carried, names)
        program = cls(
            source=source,
            listing=listing,
            maker=maker,
            targets=finished,
            tools=on_tip,
            work_objects=in_base,
            order=order,
            unchanged_moves=tuple(flow.unchanged_moves),
            notes=tuple(notes),
            fingerprint=mark_in(comments),
            mark_at=mark_at,
            arm=arm,
            controller_arm=setup.controller_arm,
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
        of_held_parts = [k for k in self.correctable("pose") if self.targets[k].uses[0].part_on_robot]
        settled: list[int] = []
        for k in of_held_parts:
            posture = self.targets[k].configuration
            if isinstance(posture, Posture) and posture.complete and np.isfinite([*posture.low, *posture.high]).any():
                settled.append(k)
        fits = []
        unknown = np.full((len(settled), 6), np.nan)
        for inverted in (False, True):
            for k in of_held_parts:
                self.targets[k].inverted = inverted
            postures = [posture for k in settled if isinstance(posture := self.targets[k].configuration, Posture)]
            solutions = Solutions(self.maker, self.arm, self.tip_poses(settled), postures, self.controller_arm)
            _, reasons = solutions.next_to(np.arange(len(settled)), unknown)
            fits.append(len(settled) >= WITNESSES and not any(reasons))
        for k in of_held_parts:
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
        determined = np.array([p.complete for p in postures], dtype=bool) | np.isfinite(near).all(axis=1)
        q = np.full((len(poses), 6), np.nan)
        reasons = [NO_POSTURE] * len(poses)

        solutions = Solutions(self.maker, self.arm, T_base_tip, postures, self.controller_arm)
        rows = np.flatnonzero(determined)
        q[rows], reasons_found = solutions.next_to(rows, near[rows])
        for k, reason in zip(rows.tolist(), reasons_found, strict=True):
            reasons[k] = reason
        self.next_to_stops(poses, q, reasons, np.flatnonzero(~determined).tolist(), solutions)
        return q, reasons


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
    numbered = [
        f"{title} {number}"
        for title, numbers, in_backup, in_options in (
            ("tool", {use.tool for use in uses}, backup.tools, setup.tools),
            ("user frame", {use.work_object for use in uses}, backup.user_frames, setup.work_objects),
        )
        for number in sorted(filter(None, numbers))
        if number in in_backup and number not in in_options and number != "0"
    ]
    return [Note(1, f"{', '.join(numbered)}: the numbers are those of {source}")] if numbered else []


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
