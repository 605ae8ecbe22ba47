r"""Motion instructions as a table: which of their arguments is the target, the point on a circle, the tool.

A line names a language, an instruction and its arguments that are not optional, in their order::

    rapid ArcL to speed seam weld * tool
    krl DISPENSE to bead

``to`` is the target, ``via`` a point on the way, ``tool`` the tool, ``writes`` a point that the instruction itself
gives a value, ``*`` any number of arguments, and any other word one argument. Tool and work object may also be given as
``\Tool`` and ``\WObj``. Users teach instructions of their own with a file of such lines: of RAPID and INFORM
instructions, of the other languages routines that are called with brackets.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

from irbcal import safe_files
from irbcal.errors import OptionError

TO, VIA, TOOL, WRITES, ANY = "to", "via", "tool", "writes", "*"
TARGETS = (TO, VIA)
POINTS = (*TARGETS, WRITES)


class MotionInstruction(NamedTuple):
    """A motion instruction."""

    name: str
    """As usually spelled."""
    required: tuple[str, ...]
    """Its arguments that are not optional."""
    taught: bool = False
    """Whether a user's file has it."""

    def refusal(self, count: int) -> str:
        """Why a move with another number of arguments is not understood."""
        return f"{self.name} is known as {' '.join(self.required)}, found {count} arguments"

    def roles(self, count: int, tool_given: bool) -> tuple[str, ...] | None:
        """Of each of ``count`` arguments its word; None where that is not their number.

        Parameters
        ----------
        count : int
        tool_given : bool
            Whether the tool is an optional argument, so that it does not stand among the others.
        """
        required = [word for word in self.required if not (tool_given and word == TOOL)]
        if ANY not in required:
            return tuple(required) if len(required) == count else None
        k = required.index(ANY)
        more = count - len(required) + 1
        return None if more < 0 else (*required[:k], *[ANY] * more, *required[k + 1 :])


InstructionTable: TypeAlias = Mapping[str, Mapping[str, MotionInstruction]]
"""Instructions by language and by name in lower case."""


def built_in(text: str) -> dict[str, MotionInstruction]:
    """Instructions of a language, by name in lower case: lines of names, a colon, and the words that all have."""
    lines = [text_line.partition(":") for text_line in text.split("\n") if ":" in text_line]
    pairs = [(name, roles.split()) for names, _, roles in lines for name in names.split()]
    return {name.lower(): MotionInstruction(name, tuple(roles)) for name, roles in pairs}


def read(path: str | Path, languages: Mapping[str, bool]) -> dict[str, dict[str, MotionInstruction]]:
    """Instructions that a user's file teaches.

    Parameters
    ----------
    path : str or Path
    languages : dict of str to bool
        Names of languages that can be taught, and whether their moves name the tool.

    Raises
    ------
    OptionError
        If a line is no such line; names it.
    """
    text = safe_files.read_bytes(path, OptionError).decode("utf-8-sig", errors="replace")
    out: dict[str, dict[str, MotionInstruction]] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        language, *arguments = line.split("#", maxsplit=1)[0].split() or [""]
        if not language:
            continue
        fault = ""
        tools = int(languages.get(language, False))
        if language not in languages:
            fault = f"expected an instruction of one of the languages {', '.join(languages)}, found {language!r}"
        elif not arguments or not re.fullmatch(r"[^\W\d]\w*", arguments[0]):
            fault = "expected the name of an instruction behind the language"
        elif arguments[1:].count(TOOL) != tools or arguments[1:].count(TO) != 1:
            fault = f"expected one 'to' and {'one' if tools else 'no'} 'tool' in {language}"
        elif max(arguments.count(VIA), arguments.count(ANY)) > 1:
            fault = "expected at most one 'via' and at most one '*'"
        if fault:
            raise OptionError(f"line {number}: {fault}", file=path, parameter="instructions")
        out.setdefault(language, {})[arguments[0].lower()] = MotionInstruction(
            arguments[0], tuple(arguments[1:]), taught=True
        )
    return out


def teaching(language: str, name: str, words: Sequence[str]) -> str:
    """How to teach an instruction, behind the reason why its target is left."""
    return f" (if it moves there, teach it with --instructions: {' '.join([language, name, *words])})"


def teaching_routine(language: str, name: str, arguments: Sequence[bool]) -> str:
    """How to teach a routine, by which of its arguments are targets; empty where none is."""
    words = [TO if is_target else f"argument{k}" for k, is_target in enumerate(arguments, start=1)]
    return teaching(language, name, words) if words.count(TO) == 1 else ""
