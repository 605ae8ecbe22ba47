"""Joint moves as a RAPID module."""

from __future__ import annotations

from irbcal.correction.moves import Moves, note
from irbcal.units import MM

SPEED_NAMES = (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000)
"""Speeds that RAPID has names for, mm/s."""


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.mod``: absolute joint moves to fine points."""
    mm_s = round(moves.tip_speed / MM)
    speed = f"v{mm_s}" if mm_s in SPEED_NAMES else f"[{mm_s},500,5000,1000]"
    absent = ",".join(["9E9"] * 6)
    lines = ["MODULE irbcal_plan", *(f"  ! {note(text)}" for text in moves.head), "  PROC main()", "    AccSet 50,50;"]
    for move, joints in zip(moves.moves, moves.texts(), strict=True):
        lines += [f"    ! {note(move.comment)}"] if move.comment else []
        lines.append(f"    MoveAbsJ [[{','.join(joints)}],[{absent}]]\\NoEOffs,{speed},fine,tool0;")
        lines += [f"    WaitTime {move.wait_s:g};"] if move.wait_s else []
    return {"plan.mod": "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])}
