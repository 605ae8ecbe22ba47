"""Which moves use which targets, and what speaks against changing these."""

import numpy as np
import pytest
from rapid_modules import EXT, LEFT, MOVES, TOOLS, USE, J, P, module, pose

from irbcal.correction import text_program as programs
from irbcal.correction.languages import rapid


@pytest.mark.parametrize(("line", "role"), MOVES)
def test_moves_and_their_arguments(line, role):
    seen = rapid.parse(module(line))
    assert seen.correctable() == [0], seen.skipped()
    (use,) = seen.targets[0].uses
    assert (use.role, use.tool, use.work_object, use.line) == (role, "tool0", "wobj0", 4)
    assert {entry.target for entry in seen.uncorrected} <= {"q"}


@pytest.mark.parametrize(("line", "reason"), LEFT)
def test_moves_that_are_left_are_reported(line, reason):
    data = f"CONST robtarget p10:={P}; VAR num number; VAR robtarget empty;"
    seen = rapid.parse(module(line, data=data))
    assert seen.correctable() == []
    assert [(entry.line, entry.reason) for entry in seen.uncorrected] == [(4, reason)]


CONFLICTS = [
    ("MyMove p10,v1;", "line 5 uses it in another way: MyMove p10,v1;"),
    ("ArcL p10,v1,s,w,fine,tA;", "line 5 uses it in another way: ArcL p10,v1,s,w,fine,tA;"),
    ("p20:=p10;", "line 5 uses it in another way: p20:=p10;"),
    ("IF p10.trans.z>5 THEN ENDIF", "line 5 uses it in another way: IF p10.trans.z>5 THEN ENDIF"),
    ("MoveL Offs(p10,0,0,1),v1,z1,tA;", "line 5 uses it in another way: MoveL Offs(p10,0,0,1),v1,z1,tA;"),
    ("p10.trans.x:=p10.trans.x+1;", "p10 is computed or changed in line 5; line 5 uses it in another way: p10.trans.x:=p10.trans.x+1;"),
    ("p10:=CRobT();", "p10 is computed or changed in line 5"),
    ("SearchL di,p10,q,v1,tA;", "p10 is computed or changed in line 5"),
    ("MoveJ p10,v1,z1,tB;", "used with different tools: tb (line 5), ta (line 4)"),
    (r"MoveJ p10,v1,z1,tA\WObj:=wA;", "used with different work objects: wa (line 5), wobj0 (line 4)"),
    ("MoveJ p10,v1,z1,tools{1};", "the tool of MoveJ in line 5 is computed: tools{1}; used with different tools: a computed one (line 5), ta (line 4)"),
    (r"MoveJ p10,v1,z1,tA\WObj?w;", "the work object of MoveJ in line 5 is computed: w; used with different work objects: a computed one (line 5), wobj0 (line 4)"),
    ("tA.tframe.trans:=CPos();", "the tool tA is changed in line 5"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "reason"), CONFLICTS)
def test_targets_that_do_more_are_not_corrected(line, reason):
    seen = rapid.parse(module(USE, line, data=TOOLS + f"VAR robtarget p10:={P};"))
    (target,) = seen.targets
    assert target.reason == reason
    assert target.uses
    assert not target.correctable
    assert seen.skipped() == [(target, reason)]
    changed = rapid.parse(programs.with_targets(seen, {0: pose(3, 4, 5)}))  # the caller may decide otherwise
    assert np.abs(changed.targets[0].value - pose(3, 4, 5)).max() < 1e-15


def test_what_does_not_conflict():
    lines = [USE, "MoveL p10,v1,z1,tA;", "x.p10:=1;", r"Call \p10:=2;", 'TPWrite "p10";', "! p10", "MoveAbsJ j,v1,fine,tA;", "MoveAbsJ j,v1,fine,tB;"]  # fmt: skip
    seen = rapid.parse(module(*lines, data=TOOLS + f"VAR robtarget p10:={P}; VAR jointtarget j:={J};"))
    assert seen.correctable() == [0, 1]
    many = rapid.parse(module(USE, *["f p10;"] * 5, data=TOOLS + f"VAR robtarget p10:={P};"))
    assert many.targets[0].conflicts[3] == "so do 2 more lines"
    unused = rapid.parse(
        module(data=f"VAR robtarget p10:={P}; VAR robtarget p20:=[[0,0,0],[0,0,0,0],[0,0,0,0],{EXT}];")
    )
    reasons = ["no move of this module uses it", "expected a unit quaternion, found one of length 0"]
    assert [target.reason for target in unused.targets] == reasons


def test_routines_have_data_of_their_own():
    content = f"""MODULE m
    CONST robtarget p10:={P};
    PROC a(robtarget p10, \\switch s | switch t, INOUT num p20{{*}})
      MoveL p10,v1,z1,tool0;
      p10:={P};
    ENDPROC
    FUNC num b(num x)
      VAR robtarget p10:=[[7,8,9],[1,0,0,0],[0,0,0,0],{EXT}];
      p10.trans.x:=x;
      MoveL p10,v1,z1,tool0;
      RETURN 1;
    ENDFUNC
    TRAP c
      MoveL p10,v1,z1,tool0;
    ENDTRAP
    RECORD pair robtarget first; num second; ENDRECORD
    PROC d(PERS tooldata tool0) MoveL p10,v1,z1,tool0; ENDPROC
    ENDMODULE""".encode()
    seen = rapid.parse(content)
    outer, inner = seen.targets
    assert [use.line for use in outer.uses] == [14, 17]
    assert outer.conflicts[0] == "the tool tool0 is a parameter of the routine"
    assert inner.conflicts == ("p10 is computed or changed in line 9",)
    assert [entry.reason for entry in seen.uncorrected] == [
        "p10 is a parameter of the routine",
        "is a parameter of the routine",
        "p10 is computed or changed in line 9",
        "the tool tool0 is a parameter of the routine",
    ]
