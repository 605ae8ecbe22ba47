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
POINTS = (TO, VIA, WRITES)

RAPID = r"""
# joint and straight moves, circles
rapid MoveJ to speed zone tool
rapid MoveL to speed zone tool
rapid MoveAbsJ to speed zone tool
rapid MoveC via to speed zone tool
# with an output, with a routine
rapid MoveJDO to speed zone tool signal value
rapid MoveJAO to speed zone tool signal value
rapid MoveJGO to speed zone tool signal *
rapid MoveLDO to speed zone tool signal value
rapid MoveLAO to speed zone tool signal value
rapid MoveLGO to speed zone tool signal *
rapid MoveCDO via to speed zone tool signal value
rapid MoveCAO via to speed zone tool signal value
rapid MoveCGO via to speed zone tool signal *
rapid MoveJSync to speed zone tool routine
rapid MoveLSync to speed zone tool routine
rapid MoveCSync via to speed zone tool routine
# with events on the path
rapid TriggJ to speed trigger zone tool
rapid TriggL to speed trigger zone tool
rapid TriggAbsJ to speed trigger zone tool
rapid TriggC via to speed trigger zone tool
rapid TriggJIOs to speed zone tool
rapid TriggLIOs to speed zone tool
# searches end where something is found
rapid SearchL signal writes to speed tool
rapid SearchC signal writes via to speed tool
# arc welding; weave data stand among the others in older versions
rapid ArcL to speed seam weld * tool
rapid ArcL1 to speed seam weld * tool
rapid ArcL2 to speed seam weld * tool
rapid ArcLStart to speed seam weld * tool
rapid ArcLEnd to speed seam weld * tool
rapid ArcC via to speed seam weld * tool
rapid ArcC1 via to speed seam weld * tool
rapid ArcC2 via to speed seam weld * tool
rapid ArcCStart via to speed seam weld * tool
rapid ArcCEnd via to speed seam weld * tool
# spot welding, nuts
rapid SpotL to speed * tool
rapid SpotJ to speed * tool
rapid SpotML to speed * tool
rapid SpotMJ to speed * tool
rapid NutL to speed * tool
rapid NutJ to speed * tool
# dispensing, painting, the continuous application platform
rapid DispL to speed bead zone tool
rapid DispC via to speed bead zone tool
rapid PaintL to speed * zone tool
rapid PaintC via to speed * zone tool
rapid CapL to speed cap * zone tool
rapid CapC via to speed cap * zone tool
"""
"""Of ABB's options, as their manuals list the arguments."""

OTHERS = """
krl PTP to
krl LIN to
krl CIRC via to
krl SPTP to
krl SLIN to
krl SCIRC via to
krl SPL to
inform MOVJ to *
inform MOVL to *
inform MOVC to *
inform MOVS to *
inform SMOVJ to *
inform SMOVL to *
inform SMOVC to *
inform SMOVS to *
inform SVSPOTMOV to *
kawasaki JMOVE to *
kawasaki LMOVE to *
kawasaki HMOVE to *
kawasaki XMOVE to *
kawasaki C1MOVE via *
kawasaki C2MOVE to *
urscript movej to *
urscript movel to *
urscript movep to *
urscript movec via to *
val3 movej to tool *
val3 movel to tool *
val3 movec via to tool *
"""


LANGUAGES = ("rapid", "krl", "inform", "kawasaki", "urscript", "val3")
NAME_TOOLS = ("rapid", "val3")
"""Languages whose moves name their tool; in the others the one that holds counts."""


class MotionInstruction(NamedTuple):
    """A motion instruction."""

    name: str
    """As usually spelled."""
    words: tuple[str, ...]
    """Its arguments that are not optional."""
    taught: bool = False
    """Whether a user's file has it."""

    def roles(self, count: int, tool_given: bool) -> tuple[str, ...] | None:
        """Of each of ``count`` arguments its word; None where that is not their number.

        Parameters
        ----------
        count : int
        tool_given : bool
            Whether the tool is an optional argument, so that it does not stand among the others.
        """
        words = [word for word in self.words if not (tool_given and word == TOOL)]
        if ANY not in words:
            return tuple(words) if len(words) == count else None
        k = words.index(ANY)
        more = count - len(words) + 1
        return None if more < 0 else (*words[:k], *[ANY] * more, *words[k + 1 :])


Table: TypeAlias = Mapping[str, Mapping[str, MotionInstruction]]
"""Instructions by language and by name in lower case."""


def parse(text: str, source: str | None = None) -> dict[str, dict[str, MotionInstruction]]:
    """Instructions of a text.

    Raises
    ------
    OptionError
        If a line is no such line; names it.
    """
    out: dict[str, dict[str, MotionInstruction]] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        language, *words = line.split("#", maxsplit=1)[0].split() or [""]
        if not language:
            continue
        fault = ""
        tools = int(language in NAME_TOOLS)
        if language not in LANGUAGES:
            fault = f"expected an instruction of one of the languages {', '.join(LANGUAGES)}, found {language!r}"
        elif not words or not re.fullmatch(r"[^\W\d]\w*", words[0]):
            fault = "expected the name of an instruction behind the language"
        elif words[1:].count(TOOL) != tools or (source is not None and words[1:].count(TO) != 1):
            fault = f"expected one 'to' and {'one' if tools else 'no'} 'tool' in {language}"
        elif max(words.count(VIA), words.count(ANY)) > 1:
            fault = "expected at most one 'via' and at most one '*'"
        if fault:
            raise OptionError(f"line {number}: {fault}", file=source, parameter="instructions")
        out.setdefault(language, {})[words[0].lower()] = MotionInstruction(
            words[0], tuple(words[1:]), source is not None
        )
    return out


def read(path: str | Path) -> dict[str, dict[str, MotionInstruction]]:
    """Instructions that a user's file teaches; see `parse`."""
    data = safe_files.read_bytes(path, OptionError)
    return parse(data.decode("utf-8-sig", errors="replace"), str(path))


def teaching(language: str, name: str, words: Sequence[str]) -> str:
    """How to teach an instruction, behind the reason why its target is left."""
    return f" (if it moves there, teach it with --instructions: {' '.join([language, name, *words])})"


def teaching_routine(language: str, name: str, arguments: Sequence[bool]) -> str:
    """How to teach a routine, by which of its arguments are targets; empty where none is."""
    words = [TO if is_target else f"argument{k}" for k, is_target in enumerate(arguments, start=1)]
    return teaching(language, name, words) if words.count(TO) == 1 else ""


INSTRUCTIONS: Table = parse(RAPID + OTHERS)
