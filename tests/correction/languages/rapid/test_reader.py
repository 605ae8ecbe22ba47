"""RAPID modules by hand: what is read, what is left alone, what is refused, and that no other byte ever changes."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irbcal.correction import program as programs
from irbcal.correction.languages import rapid
from irbcal.correction.program import ConfData
from irbcal.errors import ProgramError
from irbcal.modeling import frames

EXT = "[9E9,9E9,9E9,9E9,9E9,9E9]"
P = f"[[1,2,3],[1,0,0,0],[0,0,0,0],{EXT}]"
J = f"[[1,2,3,4,5,6],{EXT}]"

CELL = r"""MODULE Cell(SYSMODULE, NOSTEPIN)
  ! a comment with a "quote and MoveL p99,v100,fine,tNone; and a bracket [
  PERS tooldata tGrip:=[TRUE,[[10,0,120.5],[0.7071068,0,0.7071068,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wFix:=[FALSE,TRUE,"",[[800,0,500],[0.5,0.5,0.5,0.5]],[[10,20,30],[0,0,0,1]]];
  CONST robtarget p10:=[[100,-.5,1.],[0,1E0,0,0],[0,-1,-2,1],[9E9,9E+09,9E9,9E9,9E9,9E9]]; ! behind
  LOCAL pers ROBTARGET pRest := [ [1.5E2, - 20 , +3],
      ! between the parts
      [1,0,0,0], [1,0,1,0],
      [9E9,9E9,9E9,9E9,9E9,9E9] ] ;
  CONST robtarget pRow{2}:=[[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[4,5,6],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  VAR jointtarget jHome:=[[0,10,-20,30.25,40,-90],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST string text:="a ""quoted"" ; MoveL p98";
  PROC main(\switch on, num n)
    MoveAbsJ jHome\NoEOffs,v100,fine,tool0;
    IF n>3 MoveL \Conc, p10, v100\T:=5, z10 \Inpos:=inpos50, tGrip \WObj:=wFix \TLoad:=load0;
    MOVEJ P10,v100,
      z10, ! line by line
      TGRIP,\wobj:=WFIX;
    FOR i FROM 1 TO 2 DO MoveL pRow{i},v100,z10,tool0; ENDFOR
    MoveC [[7,8,9],[1,0,0,0],[0,0,0,0],[100,9E9,9E9,9E9,9E9,9E9]],pRest,v100,z1,tGrip\WObj:=wFix;
    MoveL Offs(p10,0,0,10),v100,z10,tGrip\WObj:=wFix;
  ENDPROC
ENDMODULE
"""


def module(*lines, data=f"CONST robtarget p10:={P};"):
    """A module of one routine; data stand in line 2, the first line of the routine is line 4."""
    return "\n".join(["MODULE m", data, "PROC main()", *lines, "ENDPROC", "ENDMODULE", ""]).encode()


def refused(content, **frames_given):
    with pytest.raises(ProgramError) as caught:
        rapid.parse(content, "m.mod", **frames_given)
    text = str(caught.value)
    assert text.startswith("m.mod: ")
    assert "\n" not in text
    return text.removeprefix("m.mod: ")


def named(program, name):
    found = [k for k, target in enumerate(program.targets) if target.name == name]
    assert len(found) == 1, [target.name for target in program.targets]
    return found[0]


def pose(x, y, z, rotation=None):
    return frames.transform(rotation, np.array([x, y, z]) / 1000)


def test_declared_targets_with_their_uses():
    seen = rapid.parse(CELL.encode())
    names = ["p10", "pRest", "pRow{1}", "pRow{2}", "jHome", "of MoveC in line 21"]
    assert [target.name for target in seen.targets] == names
    assert [target.kind for target in seen.targets] == ["pose"] * 4 + ["joint", "pose"]
    assert [(t.line, t.column) for t in seen.targets] == [(5, 24), (6, 33), (10, 29), (11, 5), (12, 26), (21, 11)]
    p10, rest, row_1, row_2, home, inline = seen.targets
    assert np.abs(p10.value - pose(100, -0.5, 1, frames.rot_x(np.pi))).max() < 1e-15
    assert np.abs(rest.value - pose(150, -20, 3)).max() < 1e-15
    assert np.abs(row_2.value - pose(4, 5, 6)).max() < 1e-15
    assert np.abs(np.degrees(home.value) - [0, 10, -20, 30.25, 40, -90]).max() < 1e-13
    assert p10.configuration == ConfData(0, -1, -2, 1)
    assert home.configuration is None
    assert p10.external == "[9E9,9E+09,9E9,9E9,9E9,9E9]"
    uses = [(use.line, use.column, use.instruction, use.role, use.tool, use.work_object) for use in p10.uses]
    assert uses == [(16, 12, "MoveL", "to", "tgrip", "wfix"), (17, 5, "MoveJ", "to", "tgrip", "wfix")]
    assert [(use.instruction, use.tool, use.work_object) for use in home.uses] == [("MoveAbsJ", "tool0", "wobj0")]
    assert [(use.instruction, use.role) for use in (*inline.uses, *rest.uses)] == [("MoveC", "via"), ("MoveC", "to")]
    assert row_1.uses == row_2.uses
    assert seen.correctable() == [1, 2, 3, 4, 5]
    assert seen.correctable("joint") == [4]
    assert seen.skipped() == [
        (p10, r"line 22 uses it in another way: MoveL Offs(p10,0,0,10),v100,z10,tGrip\WObj:=wFix;")
    ]
    (left,) = seen.uncorrected
    assert (left.line, left.column, left.instruction, left.target) == (22, 5, "MoveL", "Offs(p10,0,0,10)")
    assert left.reason == "its target is computed: Offs(p10,0,0,10)"
    assert [note.line for note in seen.notes] == [21]  # its first external axis has a value
    with pytest.raises(ValueError, match="read-only"):
        p10.value[0, 0] = 0.0


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


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_unchanged_programs_are_the_same_bytes(encoding, newline):
    content = (
        CELL.replace("a comment", "Größe Ångström").replace("pRest", "pRüst").replace("\n", newline).encode(encoding)
    )
    seen = rapid.parse(content)
    assert seen.data == content
    assert programs.with_targets(seen, {}) == content
    same = {k: target.value for k, target in enumerate(seen.targets)}
    assert programs.with_targets(seen, same) == content
    assert seen.targets[named(seen, "pRüst")].line == 6
    new = programs.with_targets(seen, {1: pose(7, 8, 9)})
    assert new == content.replace(b"[1.5E2, - 20 , +3]", b"[7, 8 , 9]")


def test_one_target_changes_only_its_numbers():
    seen = rapid.parse(CELL.encode())
    text = CELL
    for name, value, old, new in [
        ("pRest", pose(150, -20.0000001, 3.0000019), "+3]", "3.000002]"),  # what does not change keeps its text
        ("pRow{2}", pose(4, -0.00000001, 1e-5 / 3, frames.rot_z(0.2)), "[[4,5,6],[1,0,0,0]", "[[4,0,0.000003],[0.995004165,0,0,0.099833417]"),
        ("jHome", np.radians([0, 10, -20, 30.25, 123456.7890126, -179.5]), "30.25,40,-90]", "30.25,123456.789013,-179.5]"),
        ("p10", pose(1e7, -0.5, -1, frames.rot_x(-np.pi)), "[[100,-.5,1.]", "[[10000000,-.5,-1]"),  # -q is not nearer
    ]:  # fmt: skip
        written = programs.with_targets(seen, {named(seen, name): value})
        assert written.decode() == text.replace(old, new)
        assert text.count(old) == 1


def test_configurations_are_rewritten():
    seen = rapid.parse(CELL.encode())
    k = named(seen, "p10")
    written = programs.with_targets(seen, {}, {k: ConfData(0, 2, -3, 1)})
    assert written.decode() == CELL.replace("[0,-1,-2,1]", "[0,2,-3,1]")
    computed = rapid.parse(
        module("MoveL p10,v1,fine,tool0;", data=f"CONST robtarget p10:=[[1,2,3],[1,0,0,0],conf,{EXT}];"), "m"
    )
    assert computed.correctable() == [0]
    with pytest.raises(ProgramError, match="m: line 2: target p10 has no configuration in numbers to rewrite"):
        programs.with_targets(computed, {}, {0: ConfData(0, 0, 0, 0)})


@pytest.mark.parametrize(
    "value", [np.zeros(6), np.full((4, 4), np.nan), np.diag([2.0, 1, 1, 1]), np.diag([-1.0, 1, 1, 1])]
)
def test_values_that_cannot_be_written_are_refused(value):
    seen = rapid.parse(module("MoveL p10,v1,fine,tool0;"))
    with pytest.raises(ValueError, match="expected"):
        programs.with_targets(seen, {0: value})


MOVES = [
    (r"MoveL\Conc,p10\ID:=3,v1\V:=50,z1\Z:=2\Inpos:=inpos5,tool0\WObj:=wobj0\Corr\TLoad:=l;", "to"),
    (r"MoveL p10,v1\T:=f(1,2),z1,tool0;", "to"),
    (r"MoveL p10,v1,z1,\Tool:=tool0;", "to"),
    ("MoveC q,p10,v1,fine,tool0;", "to"),
    ("MoveC p10,q,v1,fine,tool0;", "via"),
    (r"MoveLDO p10,v1,z1,tool0\WObj:=wobj0,do1,1;", "to"),
    ("MoveJDO p10,v1,z1,tool0,do1,1;", "to"),
    ('MoveLSync p10,v1,z1,tool0,"routine";', "to"),
    ('MoveJSync p10,v1,z1,tool0,"routine";', "to"),
    ('MoveCSync q,p10,v1,z1,tool0,"routine";', "to"),
    (r"TriggL p10,v1,t1\T2:=t2,z1,tool0;", "to"),
    ("TriggJ p10,v1,t1,z1,tool0;", "to"),
    ("TriggC q,p10,v1,t1,z1,tool0;", "to"),
    (r"SearchL\Stop,di1\Flanks,found,p10,v1,tool0\WObj:=wobj0;", "to"),
    ("SearchC di1,found,p10,q,v1,tool0;", "via"),
    ("IF a=1 AND b{2}<>3 THEN WaitTime 1; ELSE MoveL p10,v1,z1,tool0; ENDIF", "to"),
    ("TEST n CASE 1,2: MoveL p10,v1,z1,tool0; DEFAULT: Stop; ENDTEST", "to"),
    ("again: MoveL p10,v1,z1,tool0; GOTO again;", "to"),
]


@pytest.mark.parametrize(("line", "role"), MOVES)
def test_moves_and_their_arguments(line, role):
    seen = rapid.parse(module(line))
    assert seen.correctable() == [0], seen.skipped()
    (use,) = seen.targets[0].uses
    assert (use.role, use.tool, use.work_object, use.line) == (role, "tool0", "wobj0", 4)
    assert {entry.target for entry in seen.uncorrected} <= {"q"}


LEFT = [
    ("MoveL RelTool(p10,0,0,1\\Rx:=5),v1,z1,tool0;", "its target is computed: RelTool(p10,0,0,1\\Rx:=5)"),
    ("MoveL GetP(),v1,z1,tool0;", "its target is computed: GetP()"),
    ("MoveL p10.target,v1,z1,tool0;", "its target is computed: p10.target"),
    ("MoveL *,v1,z1,tool0;", "the position * stands in the controller only"),
    ("MoveL pElsewhere,v1,z1,tool0;", "pElsewhere is not declared in this module"),
    ("MoveL number,v1,z1,tool0;", "number is declared as num"),
    ("MoveL empty,v1,z1,tool0;", "empty has no value in this module"),
    (f"MoveL [[1,2,n],[1,0,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;", "its numbers are computed: [[1,2,n],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9…"),
    (f"MoveL [[1,2,-\n3],[1,0,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;", "its numbers are computed: [[1,2,- 3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9…"),
    (f"MoveL [p10.trans,[1,0,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;", "its numbers are computed: [p10.trans,[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9…"),
    (f"ArcL {P},v1,s,w,z1,tool0;", "this is no move that is known"),
    (f"pElsewhere:={P};", "is not declared in this module"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "reason"), LEFT)
def test_moves_that_are_left_are_reported(line, reason):
    data = f"CONST robtarget p10:={P}; VAR num number; VAR robtarget empty;"
    seen = rapid.parse(module(line, data=data))
    assert seen.correctable() == []
    assert [(entry.line, entry.reason) for entry in seen.uncorrected] == [(4, reason)]


TOOLS = (
    "PERS tooldata tA:=[TRUE,[[1,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]; "
    "PERS tooldata tB:=[TRUE,[[2,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]; "
    'PERS wobjdata wA:=[FALSE,TRUE,"",[[1,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]; '
)
USE = "MoveL p10,v1,z1,tA;"
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


def test_frames_from_the_caller():
    content = module(r"MoveL p10,v1,z1,tGrip\WObj:=wFix;")
    assert refused(content) == (
        "line 4: MoveL uses the tool tgrip, which this module does not define: give its frame (also: work object wfix in line 4)"
    )
    T = pose(1, 2, 3, frames.rot_y(0.3))
    assert "uses the work object wfix, which" in refused(content, tools={"TGRIP": T})
    seen = rapid.parse(content, tools={"TGRIP": T}, work_objects={"wFix": T})
    assert seen.correctable() == [0]
    assert np.array_equal(seen.tools["tgrip"], T)
    over = rapid.parse(module(USE, data=TOOLS + f"VAR robtarget p10:={P};"), tools={"ta": T})
    assert np.array_equal(over.tools["ta"], T)
    with pytest.raises(ValueError, match="frame a: expected a transform"):
        rapid.parse(content, tools={"a": np.eye(3)})
    # what is not corrected needs no frame
    assert rapid.parse(module("MoveL Offs(p10,0,0,1),v1,z1,tGrip;")).tools == {}
    assert rapid.parse(module("MoveL p10,v1,z1,tGrip;", "f p10;")).tools == {}


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


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "expected a RAPID module, found no MODULE"),
        (b"PROC main() ENDPROC", "expected a RAPID module, found no MODULE"),
        (b"MODULE m\nPROC main()\nENDPROC\n", "line 4: the module has no ENDMODULE: the file is not whole"),
        (b"MODULE ;", "line 1: expected the name of the module, found ';'"),
        (b"MODULE m(NOVIEW", "line 1: expected ')' after the attributes of the module"),
        (b"MODULE m ENDMODULE MODULE n ENDMODULE", "line 1: expected the end of the file after ENDMODULE, found 'MODULE'"),
        (b"MODULE m MODULE n ENDMODULE", "line 1: a second module in one file is not supported"),
        (b"MODULE m PROC a() ENDMODULE", "line 1: ENDMODULE stands in a routine: its end is missing"),
        (b"MODULE m PROC a() PROC b()", "line 1: PROC stands in a routine: the end of that one is missing"),
        (b"MODULE m ENDPROC ENDMODULE", "line 1: ENDPROC ends no routine"),
        (b"MODULE m RECORD a", "line 1: RECORD has no ENDRECORD"),
        (b"MODULE m PROC MoveL(robtarget p) ENDPROC ENDMODULE", "line 1: the module makes its own MoveL: this is not supported"),
        (b"MODULE m PROC a(num b; ENDPROC ENDMODULE", "line 1: expected ')', found ';'"),
        (b"MODULE m\x00", "expected a RAPID module in text, found binary data"),
        (module('TPWrite "abc;'), "line 4: the string is not closed in its line"),
        (module("a$b;"), "line 4: unexpected character '$'"),
        (module("f(1;"), "line 4: expected ')', found ';'"),
        (module("f 1);"), "line 4: ')' closes nothing"),
        (module("f 1];"), "line 4: ']' closes nothing"),
        (module("VAR num 5;"), "line 4: expected a name, found '5'"),
        (module("VAR num p"), "line 5: expected ';', found 'ENDPROC'"),
        (module(f"VAR robtarget p:={P}"), "line 5: expected ';', found 'ENDPROC'"),
        (module("VAR num x; VAR num X;"), "line 4: 'X' is declared a second time, first in line 4"),
        (module("VAR robtarget p:=[[1,2,3]"), "line 5: expected ',' or ']', found 'ENDPROC'"),
        (module("VAR robtarget p:=[[1,2 3]];"), "line 4: expected an operator or ']', found '3'"),
        (module("VAR robtarget p:=[[1,2,]];"), "line 4: expected a value, found ']'"),
        (module("VAR robtarget p:=" + "[" * 1000), "line 4: more than 12 lists within each other"),
        (module("VAR robtarget p:=[[1,2,3],[1,0,0,0]];"), "line 4: robtarget 'p': expected [[x, y, z], [q1, q2, q3, q4], [cf1, cf4, cf6, cfx], [six external axes]], found 2 parts"),
        (module(f"VAR robtarget p:=[[1,2],[1,0,0,0],[0,0,0,0],{EXT}];"), "line 4: robtarget 'p': expected [x, y, z], found [1,2]"),
        (module(f"VAR robtarget p:=[7,[1,0,0,0],[0,0,0,0],{EXT}];"), "line 4: robtarget 'p': expected [x, y, z], found 7"),
        (module(f"VAR robtarget p:=[[1,2,[3]],[1,0,0,0],[0,0,0,0],{EXT}];"), "line 4: robtarget 'p': expected a number, found [3]"),
        (module(f"VAR robtarget p:=[[1,2,3],[1,0,0,0],[0,0,.5,0],{EXT}];"), "line 4: robtarget 'p': expected a configuration in whole numbers, found [0,0,.5,0]"),
        (module(f"VAR jointtarget j:=[[1,2,3,4,5],{EXT}];"), "line 4: jointtarget 'j': expected [six joints], found [1,2,3,4,5]"),
        (module(f"VAR robtarget p{{3}}:=[{P},{P}];"), "line 4: robtarget 'p': expected 3 elements, found 2"),
        (module(f"MoveL [[1,2,3],[1,0.1,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;"), "line 4: robtarget 'of MoveL in line 4': expected a unit quaternion, found one of length 1.005"),
        (module(f"MoveL [[1,2,1E999],[1,0,0,0],[0,0,0,0],{EXT}],v1,z1,tool0;"), "line 4: robtarget 'of MoveL in line 4': found a number that is too large"),
        (module("MoveL p10,v1,z1;"), "line 4: MoveL: expected 4 arguments that are not optional, found 3"),
        (module("MoveL p10,v1,z1,tool0,1;"), "line 4: MoveL: expected 4 arguments that are not optional, found 5"),
        (module("MoveL p10,,v1,z1,tool0;"), "line 4: expected an argument of MoveL, found ','"),
        (module("MoveL p10,v1,z1,tool0"), "line 5: expected ',' or '\\' or ';', found 'ENDPROC'"),
        (module("MoveL p10,v1,z1,tool0", "MoveL p10,v1,z1,tool0;"), "line 5: expected an operator or ';', found 'MoveL'"),
        (module("MoveAbsJ p10,v1,z1,tool0;"), "line 4: MoveAbsJ goes to a jointtarget, but p10 is a robtarget"),
        (module("MoveL p10{1},v1,z1,tool0;"), "line 4: p10 has 0 indices, but p10{1} has 1"),
    ],
)  # fmt: skip
def test_refusals_name_the_line(content, expected):
    assert refused(content) == expected


def test_joints_without_a_value_are_left():
    seen = rapid.parse(module("MoveAbsJ j,v1,fine,tool0;", data=f"CONST jointtarget j:=[[1,9E9,3,4,5,6],{EXT}];"))
    assert seen.targets[0].reason == "joint 2 has no value (9E9)"
    assert np.isnan(seen.targets[0].value).tolist() == [False, True] + [False] * 4


def test_notes():
    seen = rapid.parse(
        module("PDispOn p10,tool0;", "PDispSet x;", "SetDataVal a,b;", "PDispOn p10,tool0;", "PDispOff;")
    )
    assert [note.line for note in seen.notes] == [4, 5, 6]


@pytest.mark.parametrize(
    ("head", "expected"),
    [
        ("MODULE m\r\n  ! x\r\n", "MODULE m\r\n{}\r\n  ! x\r\n"),
        ("! MODULE\nmodule m ( NOVIEW,\n NOSTEPIN ) ! x\n", "! MODULE\nmodule m ( NOVIEW,\n NOSTEPIN ) ! x\n{}\n"),
        ("MODULE m VAR num x; ", "MODULE m\n{}\n VAR num x; "),
        ("\ufeff%%%\n  VERSION:1\n%%%\nMODULE m\n", "\ufeff%%%\n  VERSION:1\n%%%\nMODULE m\n{}\n"),
    ],
)
def test_the_mark(head, expected):
    content = (head + "ENDMODULE").encode()
    assert not programs.is_filtered(rapid.parse(content))
    marked = rapid.mark(content, "12ab-cd")
    assert marked.decode() == expected.format("! irbcal: fake targets, calibration 12ab-cd") + "ENDMODULE"
    seen = rapid.parse(marked)
    assert programs.is_filtered(seen)
    assert seen.fingerprint == "12ab-cd"
    for wrong in ("", "a b", "a\n"):
        with pytest.raises(ValueError, match="one word"):
            rapid.mark(content, wrong)


def test_other_marks():
    assert rapid.parse(module("!Irbcal: fake targets")).fingerprint == ""
    assert rapid.parse(module("! not irbcal: fake targets", 'f "! irbcal: fake targets";')).fingerprint is None


def test_files(tmp_path):
    path = tmp_path / "m.mod"
    path.write_bytes(CELL.encode())
    assert rapid.read(path).source == str(path)
    with pytest.raises(ProgramError, match="there is no such file"):
        rapid.read(tmp_path / "none.mod")


# property tests

WORDS = re.findall(r'"[^"\n]*"|![^\n]*\n|\w+|\s+|.', CELL)
PIECES = [
    *["[", "]", "{", "}", "(", ")", ",", ";", ":=", "\\", "!", '"', ".", "-", "+", "*", "%", "$", "\n", "\r\n", " ", "é", "\x85", "\xa0"],
    *["9E9", "1E999", ".5", "1.", "0x1F", "MoveL", "MoveC", "p10", "pRow", "tGrip", "tool0", "i", "CONST", "VAR", "robtarget", "PROC x()"],
    *["ENDPROC", "ENDMODULE", "MODULE", "TRUE", "RECORD", "pRow{1}", "p10:=", P, J, "MoveL p10,v1,z1,tool0;", "[[", "]]", "٣", "²"],
]  # fmt: skip
EDIT = st.tuples(
    st.integers(0, len(WORDS) - 1), st.sampled_from(["cut", "put", "swap", "twice"]), st.sampled_from(PIECES)
)
NUMBERS = st.tuples(*[st.floats(-2e3, 2e3)] * 3, *[st.floats(-3.1, 3.1)] * 3)


def check_rewriting(content, numbers):
    """Either one clear sentence, or a parse whose targets can be rewritten without touching anything else."""
    try:
        seen = rapid.parse(content, "m.mod")
    except ProgramError as error:
        assert re.fullmatch(r"m\.mod: \S[^\r\n]*", str(error))
        return False
    assert programs.with_targets(seen, {}) == content
    T = pose(*numbers[:3], frames.rot_x(numbers[3]) @ frames.rot_y(numbers[4]) @ frames.rot_z(numbers[5]))
    new = {k: T if target.kind == "pose" else np.array(numbers) for k, target in enumerate(seen.targets)}
    new = {k: value for k, value in new.items() if k % 2 == 0}
    written = programs.with_targets(seen, new)
    again = rapid.parse(written, "m.mod")
    assert len(again.targets) == len(seen.targets)
    for k, (before, after) in enumerate(zip(seen.targets, again.targets, strict=True)):
        want = new.get(k, before.value)
        assert np.array_equal(np.isnan(after.value), np.isnan(want))
        assert not (np.abs(after.value - want) > 1e-8).any()
        assert (after.name, after.kind) == (before.name, before.kind)
        assert (after.line, after.external, after.configuration) == (before.line, before.external, before.configuration)
        assert [replace(use, column=0) for use in after.uses] == [replace(use, column=0) for use in before.uses]

    def frame(program):
        """The text without the numbers of the changed targets."""
        cuts = sorted(span for k in new for span in program.targets[k].spans)
        starts, ends = [0, *(end for _, end in cuts)], [*(start for start, _ in cuts), len(program.text)]
        return [program.text[a:b] for a, b in zip(starts, ends, strict=True)]

    assert frame(again) == frame(seen)
    return True


@settings(max_examples=300, deadline=None)
@given(
    st.lists(EDIT, min_size=0, max_size=4),
    NUMBERS,
    st.sampled_from(["utf-8", "utf-8-sig"]),
    st.sampled_from(["\n", "\r\n"]),
)
def test_mutated_modules_are_refused_or_rewritten_without_damage(edits, numbers, encoding, newline):
    words = list(WORDS)
    for place, what, piece in edits:
        words[place] = {"cut": "", "put": piece, "swap": words[place - 1] + piece, "twice": words[place] + piece}[what]
    check_rewriting("".join(words).replace("\n", newline).encode(encoding), numbers)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=30), st.integers(0, len(CELL)), NUMBERS)
def test_any_bytes_in_a_module(piece, place, numbers):
    content = CELL.encode()
    check_rewriting(content[:place] + piece + content[place:], numbers)
    check_rewriting(content[:place], numbers)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.sampled_from([*PIECES, *(line for line, _ in MOVES), *(line for line, _ in LEFT)]), max_size=8), NUMBERS
)
def test_any_words_in_a_routine(words, numbers):
    check_rewriting(module(" ".join(words)), numbers)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(NUMBERS, st.booleans()), min_size=1, max_size=5))
def test_numbers_come_through(targets):
    names = [f"p{k}" for k in range(len(targets))]
    kinds = ["pose" if is_pose else "joint" for _, is_pose in targets]
    data = [
        f"VAR {'robtarget' if kind == 'pose' else 'jointtarget'} {name}:={P if kind == 'pose' else J};"
        for name, kind in zip(names, kinds, strict=True)
    ]
    lines = [
        f"{'MoveL' if kind == 'pose' else 'MoveAbsJ'} {name},v1,z1,tool0;"
        for name, kind in zip(names, kinds, strict=True)
    ]
    content = module(*lines, data="\n".join(data))
    assert rapid.parse(content).correctable() == list(range(len(targets)))
    assert all(check_rewriting(content, numbers) for numbers, _ in targets)


@given(st.floats(-1e9, 1e9), st.sampled_from([6, 9]))
def test_number_text(value, decimals):
    text = programs.number_text(value, decimals)
    assert re.fullmatch(r"-?(0|[1-9]\d*)(\.\d*[1-9])?", text)
    assert text != "-0"
    assert abs(float(text) - value) <= 0.5 * 10.0**-decimals + 1e-15 * abs(value)
