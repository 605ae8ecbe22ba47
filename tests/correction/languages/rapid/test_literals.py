"""Targets in numbers: declared, assigned, in arrays."""

import numpy as np
from rapid_modules import EXT, P, module, pose

from irbcal.correction.languages import rapid


def test_assignments_of_literals_are_targets():
    seen = rapid.parse(
        module("p10:=[[4,5,6],[1,0,0,0],[0,0,0,0]," + EXT + "];", "MoveL p10,v1,z1,tool0;", data="VAR robtarget p10;")
    )
    assert seen.correctable() == [0]
    assert seen.targets[0].line == 4
    both = rapid.parse(module(f"p10:={P};", "MoveL p10,v1,z1,tool0;", data=f"VAR robtarget p10:={P};"))
    assert both.correctable() == [0, 1]
    row = f"VAR robtarget p{{3}}:=[{P},{P},{P}];"
    one = rapid.parse(module(f"p{{2}}:={P};", "MoveL p{2},v1,z1,tool0;", data=row))
    assert [(t.name, t.correctable) for t in one.targets] == [
        ("p{1}", False),
        ("p{2}", True),
        ("p{3}", False),
        ("p{2}", True),
    ]
    all_ = rapid.parse(module(f"p{{q{{1}}}}:={P};", "MoveL p{n+1},v1,z1,tool0;", data=row))
    assert [(t.name, t.correctable) for t in all_.targets] == [
        ("p{1}", True),
        ("p{2}", True),
        ("p{3}", True),
        ("p{?}", True),
    ]
    whole = rapid.parse(module(f"p:=[{P},{P},{P}];", "MoveL p{1},v1,z1,tool0;", data=row))
    assert whole.correctable() == [0, 3]


def test_arrays():
    two = f"CONST robtarget p{{2,2}}:=[[{P},{P.replace('1,2,3', '4,5,6')}],[{P},{P}]];"
    seen = rapid.parse(module("MoveL p{1,2},v1,z1,tool0;", "MoveL p{2,i},v1,z1,tool0;", data=two))
    assert [target.name for target in seen.targets] == ["p{1,1}", "p{1,2}", "p{2,1}", "p{2,2}"]
    assert seen.correctable() == [1, 2, 3]
    assert np.abs(seen.targets[1].value - pose(4, 5, 6)).max() < 1e-15
    mixed = rapid.parse(module("MoveL p{i},v1,z1,tool0;", data=f"CONST robtarget p{{n}}:=[{P},q];"))
    assert mixed.correctable() == []
    assert mixed.targets[0].reason == "p{i} is computed or changed in line 2"
    assert [entry.reason for entry in mixed.uncorrected] == ["p{i} is computed or changed in line 2"]
    one = rapid.parse(module("MoveL p{1},v1,z1,tool0;", "f p{2};", data=f"CONST robtarget p{{2}}:=[{P},{P}];"))
    assert one.correctable() == [0]
    assert one.targets[1].reason == "line 5 uses it in another way: f p{2};"
    out = rapid.parse(module("MoveL p{3},v1,z1,tool0;", data=f"CONST robtarget p{{2}}:=[{P},{P}];"))
    assert [entry.reason for entry in out.uncorrected] == ["p{3} has no value in this module"]


def test_joints_without_a_value_are_left():
    seen = rapid.parse(module("MoveAbsJ j,v1,fine,tool0;", data=f"CONST jointtarget j:=[[1,9E9,3,4,5,6],{EXT}];"))
    assert seen.targets[0].reason == "joint 2 has no value (9E9)"
    assert np.isnan(seen.targets[0].value).tolist() == [False, True] + [False] * 4
