"""Robot programs: one file a language.

A language is a module of this folder with a constant ``LANGUAGE`` (`irbcal.correction.language.Language`), which
declares all that others know of it, and a line in `irbcal.correction.known_languages`. What it reads are
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
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.corrected_targets import commanded
from irbcal.correction.known_languages import KNOWN, SHORT
from irbcal.correction.language import Language
from irbcal.correction.moves import Moves
from irbcal.correction.program import ControllerSetup, read_bytes
from irbcal.errors import OptionError, ProgramError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling.commanded_joints import DECIMALS
from irbcal.units import DEG


def all_languages() -> tuple[Language, ...]:
    """All languages."""
    return tuple(_languages())


def _languages() -> Iterator[Language]:
    """All languages, each loaded when it is its turn."""
    for language in KNOWN:
        yield cast(Language, import_module(f"{__name__}.{language.name}").LANGUAGE)


def by_name() -> dict[str, Language]:
    """All languages by their short names; a table is called ``csv``."""
    return {SHORT.get(entry.name, entry.name): language for entry, language in zip(KNOWN, _languages(), strict=True)}


def name_of(language: Language) -> str:
    """Short name of a language."""
    return next(name for name, other in by_name().items() if other is language)


def of_maker(maker: str) -> Language:
    """The language in which a maker's controllers declare frames, by its short name (`MAKERS`)."""
    return next(language for entry, language in zip(KNOWN, _languages(), strict=False) if entry.maker == maker)


def taught() -> dict[str, bool]:
    """Short names of the languages whose motion instructions users add to, and whether their moves name the tool."""
    return {name: language.moves_name_tools for name, language in by_name().items() if language.motions is not None}


def of_robot(name: str) -> Language | None:
    """The language of a robot's maker, by the robot's name; None where the name does not tell."""
    return next(
        (language for language in all_languages() if language.robots and re.search(language.robots, name.lower())), None
    )


_ELSEWISE = (
    (b"\x1f\x8b", "a compressed file: unpack it"),
    (b"PK\x03\x04", "a zip archive: unpack it"),
    (b"%PDF", "a PDF document"),
    (b"<?xml", "an XML file of no language that is known"),
)


def language_of(path: str | Path) -> Language:
    """The language of a file, by its ending, or by what it looks like where no language has such files.

    Raises
    ------
    ProgramError
        If it looks like no language, or there is no file to read.
    """
    ending = Path(path).suffix.lower()
    for language in _languages():
        if ending in language.endings:
            return language
    data = read_bytes(path)  # whatever else is wrong with it is said first
    looks = [language for language in all_languages() if language.looks_like(data)]
    if len(looks) == 1:
        return looks[0]
    expected = ", ".join(f"{language.name} ({', '.join(language.endings)})" for language in all_languages())
    actual = f"the ending {ending}" if ending else "a name without ending"
    without_text = _without_text()
    if ending in without_text:
        actual = without_text[ending][1]
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


def files_of(programs: Sequence[str | Path], out: str | Path | None = None) -> ProgramFiles:
    """The language and the files of programs; folders are searched to their end for files of a language.

    In folders the language with most files is taken, a robot's before tables and trajectories; the folder ``out`` in
    one of them, which will be written, is passed over.

    Raises
    ------
    ProgramError
        If there is none, or files of several languages are named.
    OptionError
        If none is named.
    """
    if not programs:
        raise OptionError("program: expected a file, found none", parameter="program")
    endings: dict[str, Language] = {}
    name_of_path = {path: path.name for path in map(Path, programs) if not path.is_dir()}
    relative = {path: Path(name) for path, name in name_of_path.items()}
    skipped: list[tuple[Path, str]] = []
    for folder in (path for path in map(Path, programs) if path.is_dir()):
        without_text = _without_text()
        endings = endings or {ending: language for language in all_languages() for ending in language.endings}
        inside = sorted(path for path in folder.rglob("*") if path.is_file() and path not in name_of_path)
        if out is not None and folder.resolve() in Path(out).resolve().parents:
            written = [path for path in inside if Path(out).resolve() in path.resolve().parents]
            skipped += [(Path(out), "it is the folder to write to")] if written else []
            inside = [path for path in inside if path not in written]
        for path in inside:
            ending = path.suffix.lower()
            if ending in endings and _looks_like(endings[ending], path):
                relative[path] = path.relative_to(folder)
            elif ending in endings and not endings[ending].shares_endings:
                skipped.append((path, f"it does not look like {endings[ending].name}"))
            elif ending in without_text and not path.with_suffix(without_text[ending][0]).exists():
                skipped.append((path, f"it is {without_text[ending][1]}"))
        if not any(path in relative for path in inside):
            raise ProgramError("expected a robot program or a folder with some, found none", file=folder)
    languages = {path: language_of(path) for path in relative}
    counts = Counter(language for path, language in languages.items() if path not in name_of_path)
    robots = [language for language in counts if language.maker is not None]
    language = next(
        iter([languages[path] for path in name_of_path] or sorted(robots or counts, key=lambda found: -counts[found]))
    )
    for path, language_of_path in languages.items():
        if language_of_path is not language and path in name_of_path:
            first = next(iter(name_of_path.values()))
            raise ProgramError(
                f"this is {language_of_path.name}, but {first} is {language.name}: filter them one by one", file=path
            )
        if language_of_path is not language:
            skipped.append(
                (path, f"it is {language_of_path.name}, this call corrects {language.name}: filter it by itself")
            )
    relative = {path: relative_path for path, relative_path in relative.items() if languages[path] is language}
    doubled = [path for path, count in Counter(relative.values()).items() if count > 1]
    if doubled:
        second = [path for path, relative_path in relative.items() if relative_path == doubled[0]][-1]
        raise ProgramError("there are two files of this name: filter them one by one", file=second)
    return ProgramFiles(language, [*relative], relative, skipped)


def _without_text() -> dict[str, tuple[str, str]]:
    """See `Language.without_text`, of all languages."""
    return {ending: advice for language in all_languages() for ending, advice in language.without_text.items()}


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
        raise ProgramError(f"{language.name} has no moves to write")
    if language.maker is not None:
        language.maker.check(moves.arm, moves.arm.name)
    contents = {name: text.encode("ascii") for name, text in language.write_moves(moves).items()}
    setup = ControllerSetup({}, {}, unknown_frames(), moves.pulses)
    with tempfile.TemporaryDirectory() as folder:
        for name, data in contents.items():
            (Path(folder) / name).write_bytes(data)
        files = [path for path in sorted(Path(folder).iterdir()) if path.suffix.lower() in language.endings]
        q = np.concatenate([commanded(program, moves.arm) for program in language.read_for(moves.arm, files, setup)])
    if q.shape != moves.q.shape or (np.abs(q - moves.q) > _printed(moves)).any():
        raise ProgramError(f"the {language.name} program does not hold the joints that were to be written")
    return contents


def _printed(moves: Moves) -> FloatArray:
    """By how much joints that are read may differ from those that were to be written, radians, shape (6,)."""
    digits = np.full(6, 2.0 * 0.5 * 10.0**-DECIMALS * DEG)  # twice: a coupled joint is the sum of two
    if not moves.pulses:
        return digits
    return digits + 0.5 * DEG / np.abs(np.array(moves.pulses))
