"""Frames of tools and work objects as a module declares them."""

import numpy as np
import pytest
from rapid_modules import CELL, P, module, named, pose, refused

from irbcal.correction import text_program as programs
from irbcal.correction.languages import rapid
from irbcal.modeling import frames


def test_frames_of_tools_and_work_objects():
    seen = rapid.parse(CELL.encode())
    assert set(seen.tools) == {"tgrip", "tool0"}
    assert set(seen.work_objects) == {"wfix", "wobj0"}
    assert np.array_equal(seen.tools["tool0"], np.eye(4))
    tool = pose(10, 0, 120.5, frames.rot_y(np.pi / 2))
    cyclic = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x to y, y to z, z to x
    work_object = pose(800, 0, 500, cyclic) @ pose(10, 20, 30, frames.rot_z(np.pi))
    assert np.abs(seen.tools["tgrip"] - tool).max() < 1e-7
    assert np.abs(seen.work_objects["wfix"] - work_object).max() < 1e-15
    chosen = [named(seen, "pRest"), named(seen, "pRow{2}")]
    T_base_tip = programs.tip_poses(seen, chosen)
    assert np.abs(T_base_tip[0] @ tool - work_object @ pose(150, -20, 3)).max() < 1e-7
    assert np.abs(T_base_tip[1] - pose(4, 5, 6)).max() < 1e-15
    back = programs.values_for_tip_poses(seen, chosen, T_base_tip)
    assert max(np.abs(back[k] - seen.targets[k].value).max() for k in chosen) < 1e-15


FRAME = "[[1,0,0],[1,0,0,0]]"
LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (f"PERS tooldata t:=[FALSE,{FRAME},{LOAD}];", "line 3: tool t is not held by the robot (robhold FALSE): this is not supported"),
        (f"PERS tooldata t:=[TRUE,[[1,0,0],[1,0,1,0]],{LOAD}];", "line 3: tool t: expected a unit quaternion, found one of length 1.414"),
        (f"PERS tooldata t:=[TRUE,[[1,0,n],[1,0,0,0]],{LOAD}];", "line 3: tool t: expected a frame [[x, y, z], [q1, q2, q3, q4]] in numbers, found [[1,0,n],[1,0,0,0]]"),
        (f"PERS tooldata t:=[TRUE,[[1,0,1E999],[1,0,0,0]],{LOAD}];", "line 3: tool t: found a number that is too large"),
        ("PERS tooldata t:=other;", "line 3: tool t has no frame in numbers, but line 5 uses it: give its frame"),
        ("PERS tooldata t;", "line 3: tool t has no frame in numbers, but line 5 uses it: give its frame"),
        ("VAR num t;", "line 5: expected a tooldata, but t is declared as num"),
        (f'PERS wobjdata w:=[TRUE,TRUE,"",{FRAME},{FRAME}];', "line 3: work object w is held by the robot (robhold TRUE): this is not supported"),
        (f'PERS wobjdata w:=[FALSE,FALSE,"STN1",{FRAME},{FRAME}];', "line 3: work object w is moved by a mechanical unit (ufprog FALSE): this is not supported"),
        (f'PERS wobjdata w:=[FALSE,TRUE,"",{FRAME},[[1,0,0],[1,0,0]]];', "line 3: work object w: expected a frame [[x, y, z], [q1, q2, q3, q4]] in numbers, found [[1,0,0],[1,0,0]]"),
    ],
)  # fmt: skip
def test_frames_that_are_not_supported(data, expected):
    move = r"MoveL p10,v1,z1,tool0\WObj:=w;" if " w:" in data else "MoveL p10,v1,z1,t;"
    content = module(move, data=f"CONST robtarget p10:={P};\n{data}")
    assert refused(content) == expected
    assert rapid.parse(content.replace(move.encode(), b"")).correctable() == []  # nobody needs it
