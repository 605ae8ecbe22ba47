"""Joint moves as a Kawasaki program."""

from __future__ import annotations

from irbcal.correction.languages.kawasaki.writing import KAWASAKI
from irbcal.correction.moves import Moves, note


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.pg``: joints as ``#plan1`` … and ``JMOVE`` to them."""
    lines = [".PROGRAM plan()", *(f"; {note(text)}" for text in moves.head), "  ACCURACY 1 ALWAYS"]
    for number, move in enumerate(moves.moves, start=1):
        lines += [f"; {note(move.comment)}"] if move.comment else []
        lines += [f"  SPEED {move.percent}", f"  JMOVE #plan{number}", "  BREAK"]
        lines += [f"  TWAIT {move.wait_s:.1f}"] if move.wait_s else []
    points = [f"#plan{number} {' '.join(joints)}" for number, joints in enumerate(moves.texts(KAWASAKI), start=1)]
    return {"plan.pg": "\r\n".join([*lines, ".END", ".JOINTS", *points, ".END", ""])}
