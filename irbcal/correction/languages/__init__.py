"""Robot programs: one file a language.

A language is a module of this folder, listed in `known`, that offers what `Language` says: its name, the endings of
its files, ``looks_like``, ``read_for``, ``write_moves`` and ``fingerprint``. What it reads are
`irbcal.correction.program.Program`: the targets that may be corrected, and the way back into the files.

A language whose targets stand as numbers in a text derives its programs from
`irbcal.correction.text_program.TextProgram`, which replaces these numbers and keeps every other byte: with a
`irbcal.correction.maker.Maker` (how orientations, lengths and joints are written, where the arm's axes point, how
joints are counted) what is left to do is to find the targets (`Target`) and to tell `ControlFlow` of each move, frame
and branch. ``table`` (CSV) and ``ros`` stand on their own.
"""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, Protocol, cast

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.corrected_targets import commanded
from irbcal.correction.maker import Maker
from irbcal.correction.moves import Moves
from irbcal.correction.program import ControllerSetup, Program, read_bytes
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.home import DECIMALS
from irbcal.units import DEG


class Language(Protocol):
    """What a language must offer."""

    @property
    def NAME(self) -> str:
        """For messages."""
        ...

    @property
    def ENDINGS(self) -> tuple[str, ...]:
        """Of its files, lower case, with the dot."""
        ...

    @property
    def MAKER(self) -> Maker | None:
        """How six numbers of a frame are meant; None where frames are given with quaternions only."""
        ...

    @property
    def ROBOTS(self) -> str:
        """Pattern of the names of robots (lower case) whose controllers run it; empty where none tells."""
        ...

    @property
    def write_moves(self) -> Callable[[Moves], dict[str, str]] | None:
        """Writes joint moves as files, by their names, in ASCII; None for a language that has no moves."""
        ...

    def looks_like(self, data: bytes) -> bool:
        """Whether a file looks as if it were of this language."""
        ...

    def read_for(self, arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> Sequence[Program]:
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

    def fingerprint(self, data: bytes, source: str) -> str | None:
        """Fingerprint in the mark of a program.

        Parameters
        ----------
        data : bytes
            The file.
        source : str
            File name for messages.

        Returns
        -------
        str or None
            None for a program without mark; empty where the mark does not say.

        Raises
        ------
        ProgramError
            If the file is not of this language.
        """
        ...


def known() -> tuple[Language, ...]:
    """All languages."""
    return tuple(_known())


def _known() -> Iterator[Language]:
    """All languages, each loaded when it is its turn."""
    for name in ("rapid", "krl", "fanuc", "inform", "kawasaki", "urscript", "val3", "ros", "table"):
        yield cast(Language, import_module(f"{__name__}.{name}"))


def by_name() -> dict[str, Language]:
    """All languages by the names of their files; a table is called ``csv``."""
    return {name_of(language): language for language in known()}


def name_of(language: Language) -> str:
    """Name of a language's module, ``csv`` for tables."""
    name = str(language.__name__).rsplit(".", 1)[1]  # type: ignore[attr-defined]
    return "csv" if name == "table" else name


def of_robot(name: str) -> Language | None:
    """The language of a robot's maker, by the robot's name; None where the name does not tell."""
    return next(
        (language for language in known() if language.ROBOTS and re.search(language.ROBOTS, name.lower())), None
    )


SHARED = (".yaml", ".yml")
"""Endings of other files, too: in a folder only what looks like a program is taken."""
_UNREADABLE = {
    ".tp": (".ls", "a binary FANUC program: have the controller write it as .LS"),
    ".urp": (".script", "a compressed PolyScope program: export it as .script"),
}
"""Endings of programs that hold no text, the ending of the text of the same name, and what to do."""
_ELSEWISE = (
    (b"\x1f\x8b", "a compressed file: unpack it"),
    (b"PK\x03\x04", "a zip archive: unpack it"),
    (b"%PDF", "a PDF document"),
    (b"<?xml", "an XML file of no language that is known"),
)


def of(path: str | Path) -> Language:
    """The language of a file, by its ending, or by what it looks like where no language has such files.

    Raises
    ------
    ProgramError
        If it looks like no language, or there is no file to read.
    """
    ending = Path(path).suffix.lower()
    for language in _known():
        if ending in language.ENDINGS:
            return language
    data = read_bytes(path)  # whatever else is wrong with it is said first
    looks = [language for language in known() if language.looks_like(data)]
    if len(looks) == 1:
        return looks[0]
    expected = ", ".join(f"{language.NAME} ({', '.join(language.ENDINGS)})" for language in known())
    actual = f"the ending {ending}" if ending else "a name without ending"
    if ending in _UNREADABLE:
        actual = _UNREADABLE[ending][1]
    else:
        actual = next((description for begin, description in _ELSEWISE if data.startswith(begin)), actual)
    raise ProgramError(f"expected a program in one of {expected}, found {actual}", file=path)


class ProgramFiles(NamedTuple):
    """Files of programs."""

    language: Language
    files: list[Path]
    relative: dict[Path, Path]
    """Where each lies in the folder that was searched; its name where it was named itself."""
    skipped: list[tuple[Path, str]]
    """Files of folders that are passed over, and why."""


def files_of(programs: Sequence[str | Path]) -> ProgramFiles:
    """The language and the files of programs; folders are searched to their end for files of a language.

    In folders the language with most files is taken, a robot's before tables and trajectories.

    Raises
    ------
    ProgramError
        If there is none, or files of several languages are named.
    """
    endings: dict[str, Language] = {}
    named = {path: path.name for path in map(Path, programs) if not path.is_dir()}
    relative = {path: Path(name) for path, name in named.items()}
    skipped: list[tuple[Path, str]] = []
    for folder in (path for path in map(Path, programs) if path.is_dir()):
        endings = endings or {ending: language for language in known() for ending in language.ENDINGS}
        inside = sorted(path for path in folder.rglob("*") if path.is_file() and path not in named)
        for path in inside:
            ending = path.suffix.lower()
            if ending in endings and _looks_like(endings[ending], path):
                relative[path] = path.relative_to(folder)
            elif ending in endings and ending not in SHARED:
                skipped.append((path, f"it does not look like {endings[ending].NAME}"))
            elif ending in _UNREADABLE and not path.with_suffix(_UNREADABLE[ending][0]).exists():
                skipped.append((path, f"it is {_UNREADABLE[ending][1]}"))
        if not any(path in relative for path in inside):
            raise ProgramError("expected a robot program or a folder with some, found none", file=folder)
    languages = {path: of(path) for path in relative}
    counts = Counter(language for path, language in languages.items() if path not in named)
    robots = [language for language in counts if language.MAKER is not None or language.ROBOTS]
    language = next(
        iter([languages[path] for path in named] or sorted(robots or counts, key=lambda found: -counts[found]))
    )
    for path, other in languages.items():
        if other is not language and path in named:
            first = next(iter(named.values()))
            raise ProgramError(
                f"this is {other.NAME}, but {first} is {language.NAME}: filter them one by one", file=path
            )
        if other is not language:
            skipped.append((path, f"it is {other.NAME}, this call corrects {language.NAME}: filter it by itself"))
    relative = {path: place for path, place in relative.items() if languages[path] is language}
    doubled = [path for path, count in Counter(relative.values()).items() if count > 1]
    if doubled:
        second = [path for path, place in relative.items() if place == doubled[0]][-1]
        raise ProgramError("there are two files of this name: filter them one by one", file=second)
    return ProgramFiles(language, [*relative], relative, skipped)


def _looks_like(language: Language, path: Path) -> bool:
    with suppress(ProgramError):
        return language.looks_like(read_bytes(path))
    return False


def write(language: Language, moves: Moves) -> dict[str, bytes]:
    """Joint moves as a program.

    Returns
    -------
    dict of str to bytes
        File name -> content.

    Raises
    ------
    ProgramError
        If the language cannot serve this arm, or has no moves to write, or what was written does not hold the joints.
    """
    if language.write_moves is None:
        raise ProgramError(f"{language.NAME} has no moves to write")
    if language.MAKER is not None:
        language.MAKER.check(moves.arm, moves.arm.name)
    elif not moves.arm.six_revolute:
        raise ProgramError(
            f"{language.NAME} moves are of six revolute joints, {moves.arm.name} has {moves.arm.joints_listed}"
        )
    contents = {name: text.encode("ascii") for name, text in language.write_moves(moves).items()}
    setup = ControllerSetup({}, {}, unknown_frames(), moves.pulses)
    with tempfile.TemporaryDirectory() as folder:
        for name, data in contents.items():
            (Path(folder) / name).write_bytes(data)
        files = [path for path in sorted(Path(folder).iterdir()) if path.suffix.lower() in language.ENDINGS]
        q = np.concatenate([commanded(program, moves.arm) for program in language.read_for(moves.arm, files, setup)])
    if q.shape != moves.q.shape or (np.abs(q - moves.q) > _printed(moves)).any():
        raise ProgramError(f"the {language.NAME} program does not hold the joints that were to be written")
    return contents


def _printed(moves: Moves) -> FloatArray:
    """By how much joints that are read may differ from those that were to be written, radians, shape (6,)."""
    digits = np.full(6, 2.0 * 0.5 * 10.0**-DECIMALS * DEG)  # twice: a coupled joint is the sum of two
    if not moves.pulses:
        return digits
    return digits + 0.5 * DEG / np.abs(np.array(moves.pulses))
