"""Joint moves as a VAL3 application."""

from __future__ import annotations

from irbcal.correction.languages.val3.writing import STAUBLI
from irbcal.correction.moves import Moves, note

_HEAD = '<?xml version="1.0" encoding="utf-8" ?>'
_XSI = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
_SPACE = "http://www.staubli.com/robotics/VAL3"


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.pjx``, ``plan.dtx`` and ``start.pgx``: an array of joints, and moves to its elements."""
    code = ["begin", *(f"  // {note(text, without='<>[]')}" for text in moves.head)]
    for k, move in enumerate(moves.moves):
        code += [f"  // {note(move.comment, without='<>[]')}"] if move.comment else []
        code += [f"  mPlan.vel={move.percent}", f"  movej(jPlan[{k}],flange,mPlan)", "  waitEndMove()"]
        code += [f"  delay({move.wait_s:.1f})"] if move.wait_s else []
    values = [
        f'      <Value key="{k}" ' + " ".join(f'j{i}="{text}"' for i, text in enumerate(joints, start=1)) + " />"
        for k, joints in enumerate(moves.texts(STAUBLI))
    ]
    data = [
        _HEAD,
        f'<Database {_XSI} xmlns="{_SPACE}/Data/2">',
        "  <Datas>",
        f'    <Data name="jPlan" access="private" xsi:type="array" type="jointRx" size="{len(values)}">',
        *values,
        "    </Data>",
        '    <Data name="mPlan" access="private" xsi:type="array" type="mdesc" size="1">',
        '      <Value key="0" accel="50" vel="10" decel="50" tmax="99999" rmax="99999" blend="off" />',
        "    </Data>",
        "  </Datas>",
        "</Database>",
    ]
    program = [_HEAD, f'<Programs xmlns="{_SPACE}/Program/2">', '  <Program name="start">', "    <Code><![CDATA["]
    start = [*program, *code, "end]]></Code>", "  </Program>", "</Programs>"]
    project = [
        _HEAD,
        f'<Project xmlns="{_SPACE}/Project/3">',
        '  <Parameters version="s7.3.1" stackSize="5000" millimeterUnit="true" />',
        "  <Programs>",
        '    <Program file="start.pgx" />',
        "  </Programs>",
        "  <Database>",
        '    <Data file="plan.dtx" />',
        "  </Database>",
        "  <Libraries />",
        "</Project>",
    ]
    files = {"plan.pjx": project, "plan.dtx": data, "start.pgx": start}
    return {name: "\r\n".join([*lines, ""]) for name, lines in files.items()}
