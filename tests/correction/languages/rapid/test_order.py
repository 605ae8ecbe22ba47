"""The order of stops as the text of a module tells it."""

import pytest
from rapid_modules import EXT

from irbcal.correction.languages import rapid


def order(body, more=""):
    """(name, name of the stop before) of each stop of a module with targets a, b, c and an array r of two."""
    data = "".join(f"CONST robtarget {n}:=[[{k},2,3],[1,0,0,0],[0,0,0,0],{EXT}];\n" for k, n in enumerate("abc"))
    two = ",".join([f"[[7,2,3],[1,0,0,0],[0,0,0,0],{EXT}]"] * 2)
    text = f"MODULE m\n{data}CONST robtarget r{{2}}:=[{two}];\nPROC main()\n{body}\nENDPROC\n{more}ENDMODULE\n"
    module = rapid.parse(text.encode())
    names = [target.name for target in module.targets]
    return [
        (None if s.target is None else names[s.target], None if s.previous is None else names[s.previous])
        for s in module.stops()
    ]


def to(name):
    return f"MoveL {name},v100,fine,tool0;\n"


def test_moves_follow_one_another_past_what_does_not_move():
    body = f"{to('a')}SetDO do1,1;\nn:=n+1;\nWaitTime 1;\n{to('b')}MoveC a,c,v1,z1,tool0;\n{to('r{2}')}"
    assert order(f"VAR num n;\n{body}") == [("a", None), ("b", "a"), ("a", "b"), ("c", "a"), ("r{2}", "c")]


@pytest.mark.parametrize(
    "between",
    [
        "grip;",
        'grip 1,"x";',
        '%"routine"%;',
        "GOTO again;",
        "again:",
        "MoveL Offs(b,0,0,1),v1,fine,tool0;",
        "MoveL r{n},v1,fine,tool0;",
        "SearchL di1,found,b,v1,tool0;",
        "IF n>1 MoveL b,v1,fine,tool0;",
        "IF n>1 THEN\nMoveL b,v1,fine,tool0;\nENDIF",
        "FOR i FROM 1 TO 3 DO\nMoveL b,v1,fine,tool0;\nENDFOR",
        "TEST n\nCASE 1:\nMoveL b,v1,fine,tool0;\nENDTEST",
        "ERROR",
    ],
)
def test_behind_branches_calls_and_computed_moves_the_stop_before_is_not_known(between):
    found = order(f"{to('a')}{between}\n{to('c')}")
    assert found[0] == ("a", None)
    assert found[-1] == ("c", None)
    if "IF" in between or "FOR" in between or "CASE" in between:
        assert found[1] == ("b", None)


def test_routines_begin_with_an_unknown_stop():
    assert order(to("a"), more=f"PROC other()\n{to('b')}{to('c')}ENDPROC\n") == [
        ("a", None),
        ("b", None),
        ("c", "b"),
    ]
