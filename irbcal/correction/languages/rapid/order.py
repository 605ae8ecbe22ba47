"""The order of the stops of a RAPID module, as far as its text tells it.

Moves follow one another as they stand in a routine. Where a routine begins, where the program branches, loops or jumps,
where it calls what may move the robot, and behind moves whose target is computed, the stop before is not known.
"""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence

from irbcal.correction.languages.rapid.parts import Literal, Move
from irbcal.correction.languages.rapid.syntax import MOVES, Reader
from irbcal.correction.program import Stop

_BRANCHES = (
    "if then elseif else endif for endfor while endwhile test case default endtest goto return error undo backward "
    "raise retry trynext exit proc endproc func endfunc trap endtrap connect"
)
_HARMLESS = (
    "accset add bitclear bitset bookerrno clear clkreset clkstart clkstop close confj confl decr enddo errlog errwrite "
    "gripload idisable ienable incr invertdo isignaldi isleep iwatch open pathresol pulsedo reset rewind "
    "setao setdo setgo set singarea softact softdeact speedrefresh startload tperase tpshow tpwrite triggequip "
    "triggint triggio triggspeed unload velset waitai waitao waitdi waitdo waitgi waitgo waitrob waittime waituntil "
    "worldacclim write writebin writestrbin"
)
_BEFORE = frozenset(["then", "else", "do", "default", "error"])
BRANCHES = frozenset(_BRANCHES.split())
HARMLESS = frozenset(_HARMLESS.split())
"""Instructions that do not move the robot; any other name may be a routine that does."""


def breaks(reader: Reader) -> list[int]:
    """Places in the text behind which the stop before is not known, in order."""
    found = []
    tokens = reader.tokens
    begin, compact = True, False
    for i, (kind, word, start, _) in enumerate(tokens[:-1]):
        if kind == "name":
            if word in BRANCHES:
                found.append(start)
                if word == "if":
                    compact = not _has_then(reader, i)
            elif begin and word not in MOVES and word not in HARMLESS and not reader._is_assignment(i):
                found.append(start)  # a declaration, a label or a call
            begin = word in _BEFORE
            continue
        if begin and word == "%":  # a routine by its name in a text
            found.append(start)
        if word == ";" and compact:  # the move behind IF without THEN may not have been made
            found.append(start)
            compact = False
        begin = word == ";" or word == ":"
    return found


def _has_then(reader: Reader, i: int) -> bool:
    while reader.tokens[i].word not in (";", "then", ""):
        i += 1
    return reader.tokens[i].word == "then"


def stops(
    reader: Reader,
    goals: Sequence[tuple[Move, list[tuple[list[Literal], bool]]]],
    numbers: Mapping[int, int],
    places: Sequence[int],
) -> tuple[Stop, ...]:
    """The stops of a module in the order of its text.

    Parameters
    ----------
    reader : Reader
    goals : sequence of (Move, list of (list of Literal, bool))
        For each move and each of its points the literals that it may stand for, and whether it may be another place.
    numbers : dict of int to int
        Number of each literal's target by its ``id``.
    places : sequence of int
        Of `breaks`.

    Returns
    -------
    tuple of Stop
    """
    out: list[Stop] = []
    before: int | None = None
    last = 0
    for move, points in sorted(goals, key=lambda goal: goal[0].start):
        if bisect.bisect_left(places, move.start) > bisect.bisect_left(places, last):
            before = None
        last = move.start
        line = reader.line(move.start)
        for literals, computed in points:
            one = len(literals) == 1 and not computed
            for literal in literals:
                out.append(Stop(line, numbers[id(literal)], before if one else None))
            if not literals:
                out.append(Stop(line, None, None))
            before = numbers[id(literals[0])] if one else None
        if move.name.startswith("Search"):  # it ends where something was found
            before = None
    return tuple(out)
