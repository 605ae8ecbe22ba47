"""Robot programs, whatever their language: what the filter asks of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias, TypeVar

from irbcal import safe_files
from irbcal.arrays import FloatArray, IntArray, Locked
from irbcal.correction.fake_targets import FakeTargets
from irbcal.correction.instructions import InstructionTable
from irbcal.correction.loads import Load
from irbcal.errors import ProgramError
from irbcal.io.controller_model import ControllerFrames
from irbcal.modeling.arm import Arm

T = TypeVar("T")

TargetKind: TypeAlias = Literal["joint", "pose"]
"""What a target is: a set of joints, or a pose of the tool centre point in a work object."""


class Unchanged(NamedTuple):
    """A target or a move that is left as it was."""

    target: str
    """Its name; a move is named by its instruction and its target."""
    line: int
    """Where it stands in the file, from 1."""
    reason: str
    """Why, one sentence part."""

    @property
    def with_line(self) -> str:
        """Its name and line; a target without a name is called by its line already."""
        return self.target if f" in line {self.line}" in self.target else f"{self.target} (line {self.line})"


class Note(NamedTuple):
    """Something in the program that the corrections do not know about."""

    line: int
    text: str


class Stop(NamedTuple):
    """A stop of the program."""

    line: int
    """Of the move, from 1."""
    target: int | None
    """Number of its target in the program; None where the program computes it."""
    previous: int | None
    """Number of the target of the stop before; None where the arm may come from elsewhere: at the begin of a routine,
    behind a branch, a label or a computed move.
    """


@dataclass(frozen=True, eq=False, repr=False)
class WantedTargets(Locked):
    """The n targets of one kind that may be corrected."""

    kind: TargetKind
    """``joint`` or ``pose``."""
    numbers: IntArray
    """Shape (n,). Which targets of the program they are, counted from 0."""
    names: tuple[str, ...]
    """Length n."""
    lines: IntArray
    """Shape (n,). Where they stand in the file, from 1."""
    values: FloatArray
    """Shape (n, joints) or (n, 4, 4). Joints of the URDF in radians (metres for prismatic joints), or ``T_base_tip`` in
    metres.
    """
    joints: FloatArray | None = None
    """Shape (n, 6). Joints that the controller takes for poses, radians; NaN where ``unknown``. None: those nearest to
    zero joints.
    """
    unknown: tuple[str, ...] = ()
    """Length n, or empty. Why there are no joints; empty where there are."""
    loads: tuple[tuple[Load | None, ...], ...] = ()
    """Length n, or empty. What the robot carries there, several where several moves differ; None for what it carries
    before the program names any load. Empty where the program names none.
    """


Corrections: TypeAlias = Sequence[tuple[WantedTargets, FakeTargets]]
"""Targets of each kind with their corrections."""


class ControllerSetup(NamedTuple):
    """What a program does not say of its controller: frames by their names, where they count from, its own model."""

    tools: Mapping[str, FloatArray]
    work_objects: Mapping[str, FloatArray]
    """Values of shape (4, 4). In the controller's flange and world, metres, by names in lower case."""
    controller: ControllerFrames
    pulses: tuple[float, ...] = ()
    """Pulses per degree of the joints, for programs that are written in pulses; empty where they are not given."""
    controller_arm: Arm | None = None
    """What the controller itself computes with where that is not the nominal arm."""
    where: tuple[FloatArray, FloatArray] | None = None
    """Shapes (6,) and (4, 4). Joints as the controller counts them, radians, and the pose that it reports there with no
    tool and base, metres.
    """
    start: FloatArray | None = None
    posture: FloatArray | None = None
    """Shape (6,). Joints of the URDF, radians: where the program begins, and those whose posture is meant where nothing
    else says.
    """
    instructions: InstructionTable = MappingProxyType({})
    """Motion instructions that the user teaches, by language."""
    ignored_calls: tuple[str, ...] = ()
    """Patterns of names of routines that are not in the programs, and neither move the arm nor set tool or frame."""
    split_points: bool = False
    """Whether targets that moves shift by numbers become targets of their own in these moves."""
    T_world_base: FloatArray | None = None
    """Shape (4, 4). Where the robot stands in the controller's world, metres; None where they are the same, or the
    controller's frames say it.
    """


class Program(ABC):
    """A program as read: what it asks of the robot, and the way back into its file."""

    source: str
    """File name for messages."""
    fingerprint: str | None
    """Of the calibration that it was already corrected with; empty where its mark does not say; None without."""
    notes: Sequence[Note]
    """What the user should look at."""

    @abstractmethod
    def wanted_targets(self) -> Sequence[WantedTargets]:
        """The targets that may be corrected, of each kind that there is."""

    @abstractmethod
    def stops(self) -> Sequence[Stop]:
        """The stops in the order of the program."""

    @abstractmethod
    def with_fake_targets(self, corrections: Corrections, fingerprint: str | None) -> dict[str, bytes]:
        """Files of the program, by name, with the fake targets that were found and the fingerprint of a calibration.

        Without a fingerprint there is no mark: the targets are no fake targets then, but new wanted ones. Targets that
        are not corrected (``ok`` is false) and all else keep their bytes; a program without any corrected target gets
        no mark.
        """

    def unchanged_targets(self) -> Sequence[Unchanged]:
        """What is left as it is, whatever the calibration says."""
        return ()

    def refused(self, batch: WantedTargets, fake: FakeTargets) -> Sequence[str]:
        """Why corrections that were found cannot be written, for each target; empty where they can."""
        return [""] * len(batch.names)


@dataclass(frozen=True)
class Unread(Program):
    """A file among others that cannot be read: all of it is left, and nothing is written for it."""

    source: str
    reason: str
    """Why, one sentence part."""
    fingerprint: None = None
    notes: tuple[Note, ...] = ()

    def wanted_targets(self) -> Sequence[WantedTargets]:
        """None is known."""
        return ()

    def stops(self) -> Sequence[Stop]:
        """None is known."""
        return ()

    def with_fake_targets(self, corrections: Corrections, fingerprint: str | None) -> dict[str, bytes]:
        """No files."""
        return {}

    def unchanged_targets(self) -> Sequence[Unchanged]:
        """The whole file."""
        return (Unchanged("the file", 1, self.reason),)


def each_read(files: Sequence[Path], read: Callable[[Path], T]) -> tuple[list[T], list[Unread]]:
    """What is read from files, and the files that cannot be read.

    Raises
    ------
    ProgramError
        If none can be read.
    """
    out: list[T] = []
    unread: list[Unread] = []
    for file in files:
        try:
            out.append(read(file))
        except ProgramError as refusal:
            if len(unread) == len(files) - 1:
                raise
            unread.append(Unread(str(file), str(refusal).removeprefix(f"{file}: ")))
    return out, unread


def refuse_filtered(program: Program) -> None:
    """Refuse a program that bears the mark of an earlier correction.

    Raises
    ------
    ProgramError
        If it does.
    """
    if program.fingerprint is not None:
        which = f" for calibration {program.fingerprint}" if program.fingerprint else ""
        raise ProgramError(f"these are fake targets already{which}: filter the original program", file=program.source)


def read_bytes(path: str | Path) -> bytes:
    """Content of a program file.

    Raises
    ------
    ProgramError
        If there is nothing to read.
    """
    data = safe_files.read_bytes(path, ProgramError)
    if not data.strip():
        raise ProgramError("the file is empty, expected a robot program", file=path)
    return data
