"""Joint moves as a KRL program."""

from __future__ import annotations

from irbcal.correction.languages.krl.writing import KUKA
from irbcal.correction.moves import Moves, note


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.src``: PTP moves to axes with exact stops; external axes stay where they are."""
    lines = ["&ACCESS RVP", "DEF plan( )", *(f"; {note(text)}" for text in moves.head)]
    lines += ["BAS (#INITMOV,0)", "BAS (#ACC_PTP,50)"]
    percent = 0
    for move, joints in zip(moves.moves, moves.texts(KUKA), strict=True):
        lines += [f"; {note(move.comment)}"] if move.comment else []
        if move.percent != percent:
            percent = move.percent
            lines.append(f"BAS (#VEL_PTP,{percent})")
        lines.append(f"PTP {{{', '.join(f'A{k} {text}' for k, text in enumerate(joints, start=1))}}}")
        lines += [f"WAIT SEC {move.wait_s:.1f}"] if move.wait_s else []
    return {"plan.src": "\r\n".join([*lines, "END", ""])}
