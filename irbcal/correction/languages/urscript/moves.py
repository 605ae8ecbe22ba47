"""Joint moves as URScript."""

from __future__ import annotations

import numpy as np

from irbcal.correction.languages.urscript.writing import UNIVERSAL_ROBOTS
from irbcal.correction.moves import Moves, note
from irbcal.units import DEG


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.script``: ``movej`` to joints in radians."""
    lines = ["def plan():", *(f"  # {note(text)}" for text in moves.head)]
    radians = np.round(moves.degrees(UNIVERSAL_ROBOTS) * DEG, 9) + 0.0
    for move, joints in zip(moves.moves, radians, strict=True):
        lines += [f"  # {note(move.comment)}"] if move.comment else []
        lines.append(f"  movej([{', '.join(f'{value:.9f}' for value in joints)}], a=1.0, v={move.joint_speed:.3f})")
        lines += [f"  sleep({move.wait_s:.1f})"] if move.wait_s else []
    return {"plan.script": "\n".join([*lines, "end", ""])}
