"""Joint moves as a Yaskawa job."""

from __future__ import annotations

import numpy as np

from irbcal.correction.languages.inform.writing import YASKAWA
from irbcal.correction.moves import Moves, note
from irbcal.errors import ProgramError

LONGEST = 30
"""Characters of a comment that all controllers take."""
LONGEST_WAIT_S = 600.0


def write_moves(moves: Moves) -> dict[str, str]:
    """``PLAN.JBI``: positions in pulses and ``MOVJ`` to them.

    Raises
    ------
    ProgramError
        If the pulses per degree are not known.
    """
    if not moves.pulses:
        raise ProgramError("a Yaskawa job holds pulses: give the pulses per degree of the six joints (--pulses)")
    pulses = np.rint(moves.degrees(YASKAWA) * np.array(moves.pulses)).astype(np.int64)
    points = [f"C{k:05d}={','.join(map(str, row))}" for k, row in enumerate(pulses.tolist())]
    lines = [f"'{note(text, LONGEST)}" for text in moves.head]
    for k, move in enumerate(moves.moves):
        lines += [f"'{note(move.comment, LONGEST)}"] if move.comment else []
        lines.append(f"MOVJ C{k:05d} VJ={move.percent:.2f} PL=0")
        waits = [LONGEST_WAIT_S] * int(move.wait_s // LONGEST_WAIT_S) + [move.wait_s % LONGEST_WAIT_S]
        lines += [f"TIMER T={seconds:.2f}" for seconds in waits if seconds]
    head = ["/JOB", "//NAME PLAN", "//POS", f"///NPOS {len(points)},0,0,0,0,0", "///TOOL 0", "///POSTYPE PULSE"]
    middle = ["//INST", "///DATE 2000/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    return {"PLAN.JBI": "\r\n".join([*head, "///PULSE", *points, *middle, *lines, "END", ""])}
