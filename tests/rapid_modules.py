"""RAPID modules by hand, and what tests of them need."""

import numpy as np
import pytest
from support import arm

from irbcal.correction.languages import rapid
from irbcal.correction.program import ControllerSetup
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames
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
    (f"MyMove {P},v1,z1;", "this is no move that is known"),
    (f"pElsewhere:={P};", "is not declared in this module"),
]  # fmt: skip
TOOLS = (
    "PERS tooldata tA:=[TRUE,[[1,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]; "
    "PERS tooldata tB:=[TRUE,[[2,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]; "
    'PERS wobjdata wA:=[FALSE,TRUE,"",[[1,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]; '
)
USE = "MoveL p10,v1,z1,tA;"


def module(*lines, data=f"CONST robtarget p10:={P};"):
    """A module of one routine; data stand in line 2, the first line of the routine is line 4."""
    return "\n".join(["MODULE m", data, "PROC main()", *lines, "ENDPROC", "ENDMODULE", ""]).encode()


def parsed(data, source="program", nominal=None, tools=None, work_objects=None):
    """A module by itself; frames by their names, upper and lower case alike."""
    by_name = ({name.lower(): T for name, T in (given or {}).items()} for given in (tools, work_objects))
    return rapid.parse(nominal or arm(), data, source, ControllerSetup(*by_name, unknown_frames()))


def refused(content, **frames_given):
    with pytest.raises(ProgramError) as caught:
        parsed(content, "m.mod", **frames_given)
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


def rewritten(program, values, configurations=None):
    """Bytes of a module with new values for some targets."""
    return program.listing.files_with(program.edits(values, configurations or {}))[program.source]


def skipped(program):
    """Targets that are left as they are, with the reason."""
    return [(target, target.reason) for target in program.targets if not target.correctable]
