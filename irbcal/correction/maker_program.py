"""Programs whose poses are three lengths and three numbers of orientation: all languages but RAPID.

A language finds targets (`Found`) and follows the moves (`irbcal.correction.course`); what is left is the same for all
of them and stands here: frames that the targets need, the joints that the controller takes, new numbers in the text.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.listing import Edit, Listing, Number, Span, number_like, one_word
from irbcal.correction.maker import BEYOND, NO_POSTURE, Maker, Posture, Solutions
from irbcal.correction.program import Given, Goals, Kind, Stop
from irbcal.correction.text_program import Configuration, Target, TextProgram, Use, check_values, tip_poses
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm

LARGEST = 1e6
"""Millimetres and degrees beyond which a number stands for no place."""


class Found:
    """A target in numbers while its uses are gathered.

    Attributes
    ----------
    name : str
    kind : str
        ``joint`` or ``pose``.
    start : int
        Where it stands.
    numbers : list of Number
        Six, as written.
    posture : Posture or None
    posture_spans : tuple of (int, int)
        Where the posture stands.
    external : str
    uses : list of Use
    reasons : list of str
        What speaks against changing it.
    near : ndarray, shape (6,), or None
        Joints of the URDF that the program names to start from, radians.
    after : list of int or None
        Of each use, the number of the target before.
    """

    def __init__(self, name: str, kind: Kind, start: int, numbers: Sequence[Number]) -> None:
        self.name, self.kind, self.start, self.numbers = name, kind, start, tuple(numbers)
        self.posture: Posture | None = None
        self.posture_spans: tuple[Span, ...] = ()
        self.external = ""
        self.uses: list[Use] = []
        self.reasons: list[str] = []
        self.near: FloatArray | None = None
        self.after: list[int | None] = []
        if not all(abs(number.value) <= LARGEST for number in self.numbers):
            self.reasons.append("found a number that is too large")


@dataclass(frozen=True, eq=False, repr=False)
class MakerProgram(TextProgram):
    """A program as read.

    Attributes
    ----------
    listing : Listing
        Its text.
    maker : Maker
    arm : Arm
        What the controller computes with.
    order : tuple of Stop
        The stops in the order of the program.
    own_model : Arm or None
        What the controller itself computes with where that is not ``arm``.
    mark_at : int
        Where the mark goes.
    """

    listing: Listing
    maker: Maker
    arm: Arm
    order: tuple[Stop, ...]
    own_model: Arm | None
    mark_at: int

    @abstractmethod
    def mark(self, fingerprint: str) -> Edit:
        """The comment that marks a corrected program."""

    def posture_edits(self, target: Target, posture: Posture) -> list[Edit]:
        """New text of the configuration of a target; none where the language writes none."""
        return []

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
        if not len(q) or type(self).posture is MakerProgram.posture:
            return [None] * len(q)
        flags = (flag.tolist() for flag in self.maker.postures(self.arm, q))
        return [self.posture(*row) for row in zip(*flags, self.maker.program_joints(q), strict=True)]

    def stops(self) -> tuple[Stop, ...]:
        """The stops in the order of the program."""
        return self.order

    def goals(self) -> list[Goals]:
        """The targets that may be corrected, poses with the joints that the controller takes."""
        joints, poses = self.correctable("joint"), self.correctable("pose")
        out = []
        if joints:
            out.append(self._goals("joint", joints, np.array([self.targets[k].value for k in joints])))
        if poses:
            T = tip_poses(self, poses)
            q, reasons = self._meant(poses, T)
            plain = self._goals("pose", poses, T)
            confs = plain.configurations
            out.append(Goals("pose", plain.numbers, plain.names, plain.lines, T, confs, q, tuple(reasons)))
        return out

    def _meant(self, poses: Sequence[int], T: FloatArray) -> tuple[FloatArray, list[str]]:
        """Joints that the controller takes for poses: those of the posture, else those next to the stop before."""
        targets = [self.targets[k] for k in poses]
        postures = [t.configuration if isinstance(t.configuration, Posture) else Posture() for t in targets]
        unknown = np.full(6, np.nan)
        near = np.array([unknown if t.near is None else t.near for t in targets]).reshape(-1, 6)
        alone = np.array([p.whole for p in postures], dtype=bool) | np.isfinite(near).all(axis=1)
        q = np.full((len(poses), 6), np.nan)
        reasons = [NO_POSTURE] * len(poses)

        solutions = Solutions(self.maker, self.arm, T, postures, self.own_model)
        rows = np.flatnonzero(alone)
        q[rows], why = solutions.next_to(rows, near[rows])
        for k, reason in zip(rows.tolist(), why, strict=True):
            reasons[k] = reason
        row_of = {number: row for row, number in enumerate(poses)}
        stops = [stop.target for stop in self.order if stop.target is not None]
        waiting = [*(row_of[number] for number in stops if number in row_of), *range(len(poses))]  # vias last
        for row in dict.fromkeys(row for row in waiting if not alone[row]):
            starts = [self._joints_of(number, row_of, q) for number in targets[row].after]
            if not starts or not np.isfinite(starts).all():
                continue
            found, why = solutions.next_to(np.full(len(starts), row), np.array(starts))
            q[row], reasons[row] = found[0], next(filter(None, why), "")
            if not reasons[row] and np.abs(found - found[0]).max() > 1e-6:
                q[row], reasons[row] = unknown, "the stops before its moves lead to different solutions of the arm"
        return q, reasons

    def _joints_of(self, number: int | None, row_of: Mapping[int, int], q: FloatArray) -> FloatArray:
        if number is not None and self.targets[number].kind == "joint":
            return self.targets[number].value
        return np.full(6, np.nan) if number is None or number not in row_of else q[row_of[number]]

    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """The postures that the new joints have."""
        pairs = zip(targets, self.postures(q), strict=True)
        return [posture if target.configuration_spans else None for target, posture in pairs]

    def edits(self, new_values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]) -> list[Edit]:
        """New text of numbers and configurations."""
        out: list[Edit] = []
        poses = [k for k in new_values if self.targets[k].kind == "pose"]
        of_poses: dict[int, FloatArray] = {}
        if poses:
            near = np.array([self.targets[k].written for k in poses])
            rows = self.maker.numbers(np.array([new_values[k] for k in poses]), near)
            of_poses = dict(zip(poses, rows, strict=True))
        for k, value in new_values.items():
            target = self.targets[k]
            if target.kind == "joint":
                numbers = self.maker.program_joints(np.asarray(value)) / self.joint_units(target)
                least = [self.joint_decimals(target)] * 6
            else:
                numbers = of_poses[k]
                least = [self.maker.decimals[0]] * 3 + [self.maker.decimals[1]] * 3
            for span, new, old, places in zip(target.spans, numbers, target.written, least, strict=True):
                edit = self._edit(span, float(new), old, places)
                if edit is not None:
                    out.append(edit)
        for k, posture in configurations.items():
            if isinstance(posture, Posture):
                out += self.posture_edits(self.targets[k], posture)
        return out

    def joint_units(self, target: Target) -> Any:
        """SI value of one unit of the joints of a target, one for all or one for each."""
        return self.maker.joint

    def joint_decimals(self, target: Target) -> int:
        """Least decimals of joints."""
        return self.maker.decimals[2]

    def _edit(self, span: Span, new: float, old: float, least: int) -> Edit | None:
        start, end = span
        text = number_like(self.text[start:end], new, least)
        if float(text) == old:
            return None
        if self.maker.aligned:
            more = len(text) - (end - start)
            blanks = len(self.text[:start]) - len(self.text[:start].rstrip(" ")) if more > 0 else 0
            start -= min(max(more, 0), max(blanks - 1, 0))
            text = text.rjust(span[1] - start) if more <= 0 else text
        return start, end, text

    def with_fake_targets(self, found: Sequence[tuple[Goals, Corrected]], fingerprint: str | None) -> dict[str, bytes]:
        """Files of the program with fake targets, configurations and, with a fingerprint, the mark."""
        values, configurations = self.new_text(found)
        if not values:
            return self.listing.files_with([])
        check_values(self, values)
        mark = [] if fingerprint is None else [self.mark(one_word(fingerprint))]
        return self.listing.files_with([*self.edits(values, configurations), *mark])


class Parts(TypedDict):
    """What all these programs are made of: arguments of `MakerProgram`."""

    source: str
    text: str
    encoding: str
    targets: tuple[Target, ...]
    tools: dict[str, FloatArray]
    work_objects: dict[str, FloatArray]
    listing: Listing
    maker: Maker
    arm: Arm
    order: tuple[Stop, ...]
    own_model: Arm | None


def parts_of(
    maker: Maker,
    arm: Arm,
    listing: Listing,
    found: Sequence[Found],
    order: tuple[Stop, ...],
    given: Given,
    tools: Mapping[str, FloatArray],
    work_objects: Mapping[str, FloatArray],
    source: str,
    units: Mapping[int, FloatArray] | None = None,
) -> Parts:
    """Targets with the frames that they need; arguments as for `targets_of` and `frames_for`.

    Raises
    ------
    ProgramError
        If a frame is not known, or in which frames the controller counts.
    """
    targets = targets_of(maker, arm, listing, found, units)
    check_ends(maker, arm, given, targets, source)
    on_tip, in_base = frames_for(targets, given, tools, work_objects, source)
    return Parts(
        source=source,
        text=listing.text,
        encoding="latin-1",
        targets=targets,
        tools=on_tip,
        work_objects=in_base,
        listing=listing,
        maker=maker,
        arm=arm,
        order=order,
        own_model=given.own_model,
    )


def targets_of(
    maker: Maker, arm: Arm, listing: Listing, found: Sequence[Found], units: Mapping[int, FloatArray] | None = None
) -> tuple[Target, ...]:
    """Targets from what was found; the array of each is locked.

    Parameters
    ----------
    maker : Maker
    arm : Arm
    listing : Listing
    found : sequence of Found
        With all their uses and reasons.
    units : dict of int to ndarray, optional
        Units of the joints of a target that are others than the maker's.
    """
    out = []
    rows = np.array([[number.value for number in one.numbers] for one in found]).reshape(-1, 6)
    small = (np.abs(rows) <= LARGEST).all(axis=1)
    poses = maker.poses(np.where(small[:, None], rows, 0.0))
    poses[~small] = np.nan
    poses.setflags(write=False)
    for k, (one, written) in enumerate(zip(found, rows, strict=True)):
        if one.kind == "pose":
            value = poses[k]
        else:
            value = maker.joints(written * (units or {}).get(k, maker.joint)) if small[k] else np.full(6, np.nan)
            value.setflags(write=False)
        frames_used = {(use.tool, use.work_object) for use in one.uses}
        reasons = list(one.reasons)
        if one.kind == "joint" and not reasons:
            outside = np.flatnonzero((value < arm.lower - BEYOND) | (value > arm.upper + BEYOND))
            reasons += [f"joint {k + 1} is outside the limits of {arm.name}" for k in outside[:1]]
        if one.kind == "pose" and len(frames_used) > 1:
            reasons.append(f"used with different tools or frames in lines {_lines(one.uses)}")
        if one.near is not None:
            one.near.setflags(write=False)
        out.append(
            Target(
                name=one.name,
                kind=one.kind,
                value=value,
                configuration=one.posture,
                external=one.external,
                line=listing.line(one.start),
                column=listing.column(one.start),
                uses=tuple(one.uses),
                conflicts=tuple(dict.fromkeys(reasons)),
                written=tuple(written.tolist()),
                spans=tuple((number.start, number.end) for number in one.numbers),
                configuration_spans=one.posture_spans,
                near=one.near,
                after=tuple(dict.fromkeys(one.after)),
            )
        )
    return tuple(out)


def _lines(uses: Sequence[Use]) -> str:
    return ", ".join(str(line) for line in sorted({use.line for use in uses}))


def frames_for(
    targets: Sequence[Target],
    given: Given,
    tools: Mapping[str, FloatArray],
    work_objects: Mapping[str, FloatArray],
    source: str,
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Tools on the tip and work objects in the base link of all targets that may be corrected.

    Poses need them; of joint targets those are taken that are known.

    Parameters
    ----------
    targets : sequence of Target
    given : Given
        Frames from the caller go before those of the program.
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        What the program says, in the controller's flange and world.
    source : str
        For messages.

    Raises
    ------
    ProgramError
        If one is not known.
    """
    ours = {**tools, **given.tools}, {**work_objects, **given.work_objects}
    missing: dict[str, int] = {}
    found: tuple[dict[str, FloatArray], dict[str, FloatArray]] = {}, {}
    for target in targets:
        for use in target.uses if target.correctable else ():
            for k, (what, name) in enumerate((("tool", use.tool), ("frame", use.work_object))):
                if name is None or name in found[k]:
                    continue
                needed = target.kind == "pose"
                if name in ours[k]:
                    T = ours[k][name]
                    if not np.abs(T).max() <= LARGEST:
                        if not needed:
                            continue
                        raise ProgramError(f"{what} {name}: found a number that is too large", file=source)
                    found[k][name] = given.controller.T_tip_flange @ T if k == 0 else given.controller.T_base_world @ T
                elif needed:
                    missing.setdefault(f"--{what} {name}=", use.line)
    if missing:
        first, line = next(iter(missing.items()))
        more = f" (also: {', '.join(list(missing)[1:])})" if len(missing) > 1 else ""
        what = "tool" if first.startswith("--tool") else "frame"
        name = first.split(" ", 1)[1][:-1]
        message = f"this move uses the {what} {name}, which the program does not define: give it with {first}…{more}"
        raise ProgramError(message, file=source, line=line)
    return found


def check_ends(maker: Maker, arm: Arm, given: Given, targets: Sequence[Target], source: str) -> None:
    """Refuse poses where it is not known in which frames the controller counts them.

    Raises
    ------
    ProgramError
        If there are some, and the URDF names no ``base`` or ``tool0`` where these matter.
    """
    if not any(target.kind == "pose" and target.correctable for target in targets):
        return
    missing = [
        name
        for name, needed, there in (
            ("base (the controller's world)", maker.world, given.controller.base_known),
            ("tool0 (its flange)", arm.tip_link != "tool0", given.controller.flange_known),
        )
        if needed and not there
    ]
    if missing:
        raise ProgramError(
            f"the URDF of {arm.name} has no link {' and no link '.join(missing)} that is fixed to its ends, or it is "
            "not at hand: without it the poses of this program have no place",
            file=source,
        )


def frame(maker: Maker, numbers: Sequence[float]) -> FloatArray:
    """A frame (4, 4) from six numbers as the maker writes them; NaN where they are too large."""
    if not all(abs(value) <= LARGEST for value in numbers):
        return np.full((4, 4), np.nan)
    return maker.poses(np.array([numbers]))[0]


def relative(T: FloatArray, to: FloatArray) -> FloatArray:
    """A frame (4, 4) seen from another one in the same base."""
    return np.asarray(frames.inverse(to) @ T)
