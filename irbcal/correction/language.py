"""What a robot language declares of itself: all that the rest of the package knows of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

from irbcal.correction.backup import Backup
from irbcal.correction.instructions import MotionInstruction
from irbcal.correction.listing import Listing, mark_in
from irbcal.correction.maker import Maker
from irbcal.correction.moves import Moves
from irbcal.correction.program import ControllerSetup, Program
from irbcal.modeling.arm import Arm


class FrameDeclaration(NamedTuple):
    """How tools and work objects are declared to a controller."""

    name: str
    names: str
    """Pattern of the names that it allows, and the same in words."""
    head: str
    tool: str
    work_object: str
    foot: str = ""
    """Lines; those of frames with their ``{name}``, its ``{base}`` without index, and numbers ``{0}`` …"""
    held_part: str = ""
    fixed_tool: str = ""
    """Likewise of a part that the robot holds, in the flange, and of the tool that works on it; empty where how the
    maker has them is not known.
    """
    negative: str = "{}"
    """How a negative number is written."""
    as_file: Callable[[list[str]], str] | None = None
    """The file that lines make; None where they are one as they are."""


ANY_WORD = r"[A-Za-z_]\w{0,31}", "begin with a letter and have letters, digits and _ only"
TO_99 = r"[1-9]\d?", "are numbers from 1 to 99"
"""Names as several makers have them."""


class SampleArm(NamedTuple):
    """An arm as a maker builds them, of invented size, and the stops of its program, for ``irbcal samples``.

    The programs are the templates of ``irbcal/examples/templates/FOLDER``.
    """

    folder: str
    stops: tuple[tuple[float, ...], ...]
    """Joints of the controller, degrees."""
    tried: Mapping[str, str]
    """Program to what its command needs; other files go with them. ``{where}``: joints of the first stop and its pose
    with no tool.
    """
    joints: tuple[tuple[tuple[float, float, float], str], ...] = ()
    """Origin and axis. Of the six joints, metres, in frames parallel to the base at zero joints; empty for an arm with
    a name.
    """
    flange: tuple[float, ...] = (0, 0, 0, 0, 0, 0)
    """Place of the tip on the last link, metres, and its roll, pitch, yaw."""
    base: float = 0.0
    """Height of the controller's world, metres."""
    tool: tuple[float, ...] = (0, 0, 150, 0, 0, 0)
    frame: tuple[float, ...] = (0, 0, 0, 0, 0, 0)
    """Numbers of the tool and of the frame that the program's poses are given in, as its controller writes them."""
    robot_name: str = ""
    """A robot's name, for arms without joints."""


def nothing_said(files: Sequence[Path]) -> Backup:
    """What a backup says where a language does not look into it."""
    return Backup()


def mark_among(
    comments: Callable[[Listing], Iterable[str]], language_name: str, encodings: tuple[str, ...] = ()
) -> Callable[[bytes, str], str | None]:
    """What `Language.fingerprint` is where the mark stands among the comments of a text."""

    def fingerprint(data: bytes, source: str = "program") -> str | None:
        return mark_in(comments(Listing([(source, data)], language_name, encodings)))

    return fingerprint


class ReadFor(Protocol):
    """How a language reads programs."""

    def __call__(self, arm: Arm, files: Sequence[Path], setup: ControllerSetup, /) -> Sequence[Program]:
        """Read programs for an arm.

        Parameters
        ----------
        arm : Arm
            What the controller computes with.
        files : sequence of Path
            One at least; they may be several programs, or one that lies in several files.
        setup : ControllerSetup
            Frames that the programs do not define, and the controller's own.

        Raises
        ------
        ProgramError
            If a file cannot be read or understood, or the language cannot serve this arm.
        OptionError
            If frames are given to a language that knows none.
        """
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Language:
    """A robot language."""

    name: str
    """For messages."""
    endings: tuple[str, ...]
    """Of its files, lower case, with the dot."""
    looks_like: Callable[[bytes], bool]
    """Whether a file looks as if it were of this language."""
    reader: ReadFor
    """Reads programs; ask `read_for`."""
    fingerprint: Callable[[bytes, str], str | None]
    """Fingerprint in the mark of a program, from the file and its name for messages: None without mark, empty where the
    mark does not say. Raises a `ProgramError` if the file is not of this language.
    """
    maker: Maker | None = None
    """How its controllers write poses and joints; None for what is no controller's."""
    robots: str = ""
    """Pattern of the names of robots (lower case) whose controllers run it; empty where none tells."""
    write_moves: Callable[[Moves], dict[str, str]] | None = None
    """Writes joint moves as files, by their names, in ASCII; None for a language that has no moves."""
    motions: Mapping[str, MotionInstruction] | None = None
    """Its motion instructions by name in lower case, to which users may add; None where they may not."""
    moves_name_tools: bool = False
    """Whether moves name their tool; else the one that holds counts."""
    backup: Callable[[Sequence[Path]], Backup] = nothing_said
    """What the backup in which programs lie says of the controller; raises a `ProgramError` if it says two things."""
    declaration: FrameDeclaration | None = None
    """How frames are declared to its controllers."""
    sample: SampleArm | None = None
    shares_endings: bool = False
    """Whether other files have its endings, too: in a folder only what looks like a program is taken."""
    without_text: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Endings of its programs that hold no text, the ending of the text of the same name, and what to do."""

    def read_for(self, arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> Sequence[Program]:
        """Read programs for an arm, which must be one whose joints the maker's controllers count so; see `ReadFor`."""
        if self.maker is not None:
            self.maker.check(arm, str(files[0]))
        return self.reader(arm, files, setup)

    @property
    def six_numbers(self) -> Maker | None:
        """How six numbers of a frame are meant; None where frames are given with quaternions only."""
        return self.maker if self.maker is not None and len(self.maker.orientation.names) == 3 else None
