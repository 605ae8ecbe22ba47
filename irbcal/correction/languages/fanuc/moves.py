"""Joint moves as a FANUC listing."""

from __future__ import annotations

from irbcal.correction.languages.fanuc.writing import FANUC
from irbcal.correction.moves import Moves, note

LONGEST = 32
"""Characters of a remark that all controllers take."""
LONGEST_WAIT_S = 300.0


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.ls``: positions as joints, J3 with J2 in it as the pendant counts, and moves to them."""
    lines: list[str] = [f"!{_remark(text)}" for text in moves.head] + ["UFRAME_NUM=0", "UTOOL_NUM=1"]
    points: list[str] = []
    for number, (move, joints) in enumerate(zip(moves.moves, moves.texts(FANUC), strict=True), start=1):
        lines += [f"!{_remark(move.comment)}"] if move.comment else []
        lines.append(f"J P[{number}] {move.percent}% FINE")
        waits = [LONGEST_WAIT_S] * int(move.wait_s // LONGEST_WAIT_S) + [move.wait_s % LONGEST_WAIT_S]
        lines += [f"WAIT {seconds:6.2f}(sec)" for seconds in waits if seconds]
        fields = [f"J{k}= {text:>9} deg" for k, text in enumerate(joints, start=1)]
        points += [f"P[{number}]{{", "   GP1:", "\tUF : 0, UT : 1,"]
        points += ["\t" + ",\t".join(fields[:3]) + ",", "\t" + ",\t".join(fields[3:]), "};"]
    text = [f"{number:4d}:  {line} ;" for number, line in enumerate(lines, start=1)]
    text = [line.replace(":  J P", ":J P", 1) for line in text]
    head = ["/PROG  PLAN", "/ATTR", 'COMMENT\t\t= "irbcal plan";', f"LINE_COUNT\t= {len(lines)};"]
    head += ["PROTECT\t\t= READ_WRITE;", "DEFAULT_GROUP\t= 1,*,*,*,*;", "/MN"]
    return {"plan.ls": "\r\n".join([*head, *text, "/POS", *points, "/END", ""])}


def _remark(text: str) -> str:
    return note(text, LONGEST, ";:'\"")
