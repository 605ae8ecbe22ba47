"""Modules that are not whole or not understood: one sentence that names the line."""

import pytest
from rapid_modules import EXT, P, module, refused


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
