"""Targets that one module declares and another one of the same call uses."""

import numpy as np
import pytest
from rapid_modules import EXT, J, P
from support import arm

from irbcal.correction.languages import rapid
from irbcal.correction.program import Given
from irbcal.files.controller_frames import unknown

TOOL = "PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];"
OTHER_TOOL = TOOL.replace("100", "200")


def read(folder, given=None, **modules):
    """The modules of a call by their names, each from its data and the lines of its routine."""
    paths = []
    for name, (data, *lines) in modules.items():
        path = folder / f"{name}.mod"
        body = "\n".join(lines)
        path.write_text(f"MODULE {name}\n{data}\nPROC r{name}()\n{body}\nENDPROC\nENDMODULE\n")
        paths.append(path)
    found = rapid.read_for(arm(), paths, Given(given or {}, {}, unknown()))
    return dict(zip(modules, found, strict=True))


@pytest.mark.parametrize("how", ["CONST", "PERS", "TASK PERS", "VAR"])
def test_a_target_is_corrected_where_it_stands(how, tmp_path):
    seen = read(
        tmp_path,
        Data=(f"{TOOL} {how} robtarget p:={P}; {how} jointtarget j:={J}; {how} robtarget unused:={P};",),
        Work=("", "MoveAbsJ J,v1,fine,tA;", "MoveL P,v1,fine,tA;", "MoveJ p,v1,fine,tA;"),
    )
    data, work = seen["Data"], seen["Work"]
    assert [data.targets[k].name for k in data.correctable()] == ["p", "j"]
    assert [(use.line, use.file, use.instruction) for use in data.targets[0].uses] == [
        (5, "Work.mod", "MoveL"),
        (6, "Work.mod", "MoveJ"),
    ]
    assert data.tools["ta"][2, 3] == 0.1
    assert (work.left(), data.left()) == ([], [])
    assert all(stop.target is None for stop in work.stops())


def test_elements_of_arrays(tmp_path):
    row = f"CONST robtarget p{{2}}:=[{P},{P}]; CONST robtarget q{{2}}:=[{P},{P}];"
    seen = read(tmp_path, Data=(row,), Work=("", "MoveL p{2},v1,fine,tool0;", "MoveL q{i},v1,fine,tool0;"))
    assert [seen["Data"].targets[k].name for k in seen["Data"].correctable()] == ["p{2}", "q{1}", "q{2}"]


IN_DOUBT = [  # of the declaring module, of the using one, and what is said
    (f"{TOOL} CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "f p;"], "line 5 of Work.mod uses it in another way"),
    (f"{TOOL} PERS robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "p:=CRobT();"], "line 5 of Work.mod gives it another value"),
    (f"{TOOL} PERS robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "p.trans.x:=1;"], "gives it another value"),
    (f"{TOOL} PERS robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "SearchL d,p,q,v1,tA;"], "gives it another value"),
    (f"{TOOL} CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "MoveL p,v1,fine,tool0;"], "used with different tools: tool0 (line 5 of Work.mod), ta (line 4 of Work.mod)"),
    (f"{TOOL} CONST robtarget p:={P};", f"LOCAL {OTHER_TOOL}", ["MoveL p,v1,fine,tA;"], "the tool ta is another one in another module"),
    (f"CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tX;"], "the tool tx is not defined in numbers in these modules"),
    (f"{TOOL} CONST robtarget p:={P};", "", ["MoveL p,v1,fine,tA;", "tA:=tool0;"], "the tool ta is changed"),
    (f"{TOOL} CONST robtarget p:={P};", "", [r"MoveL p,v1,fine,\Tool?tB;"], "is computed: tB of Work.mod"),
]  # fmt: skip


@pytest.mark.parametrize(("data", "own", "lines", "reason"), IN_DOUBT)
def test_in_doubt_it_is_left_with_the_reason(data, own, lines, reason, tmp_path):
    seen = read(tmp_path, Data=(data,), Work=(own, *lines))
    assert seen["Data"].correctable() == []
    ((target, why),) = seen["Data"].skipped()
    assert target.uses
    assert reason in why


def test_uses_of_the_own_module_and_of_others_count_together(tmp_path):
    data = f"{TOOL} CONST robtarget p:={P};"
    agree = read(tmp_path, Data=(data, "MoveL p,v1,fine,tA;"), Work=("", "MoveL p,v1,fine,tA;"))
    assert agree["Data"].correctable() == [0]
    differ = read(tmp_path, Data=(data, "MoveL p,v1,fine,tA;"), Work=("", "MoveL p,v1,fine,tool0;"))
    assert "used with different tools" in differ["Data"].targets[0].reason


@pytest.mark.parametrize(
    ("own", "line"),
    [
        (f"LOCAL CONST robtarget p:={P};", ""),  # hidden by data of the module
        (f"CONST robtarget p:={P};", ""),
        ("VAR num p;", ""),
        ("", f"VAR robtarget p:={P};"),  # and of the routine
    ],
)
def test_names_that_hide_the_other_modules_target(own, line, tmp_path):
    moves = [line, "" if own.startswith("VAR num") else "MoveL p,v1,fine,tool0;"]
    seen = read(tmp_path, Data=(f"CONST robtarget p:={P};",), Work=(own, *moves))
    assert not seen["Data"].targets[0].uses
    assert seen["Data"].correctable() == []


def test_a_routines_parameter_hides_it_too(tmp_path):
    (tmp_path / "a.mod").write_text(f"MODULE a\nCONST robtarget p:={P};\nENDMODULE\n")
    text = "MODULE b\nPROC go(robtarget p)\nMoveL p,v1,fine,tool0;\nENDPROC\nENDMODULE\n"
    (tmp_path / "b.mod").write_text(text)
    a, b = rapid.read_for(arm(), [tmp_path / "a.mod", tmp_path / "b.mod"], Given({}, {}, unknown()))
    assert not a.targets[0].uses
    assert [entry.reason for entry in b.uncorrected] == ["p is a parameter of the routine"]


def test_local_data_are_not_seen_and_names_declared_twice_are_left(tmp_path):
    seen = read(tmp_path, Data=(f"LOCAL CONST robtarget p:={P};",), Work=("", "MoveL p,v1,fine,tool0;"))
    assert not seen["Data"].targets[0].uses
    assert [entry.reason for entry in seen["Work"].uncorrected] == ["p is not declared in this module"]
    one = f"CONST robtarget p:={P};"
    seen = read(tmp_path, A=(one, "MoveL p,v1,fine,tool0;"), B=(one,), C=("", "MoveL p,v1,fine,tool0;"))
    assert seen["A"].correctable() == []
    assert "line 4 of C.mod uses this name, which A.mod and B.mod declare" in seen["A"].targets[0].reason
    assert "declare" in seen["B"].targets[0].reason


def test_a_given_tool_goes_before_what_modules_say(tmp_path):
    T = np.eye(4)
    T[0, 3] = 0.3
    data = (f"{TOOL} CONST robtarget p:=[[1,2,3],[1,0,0,0],[0,0,0,0],{EXT}];",)
    seen = read(tmp_path, {"ta": T}, Data=data, Work=(f"LOCAL {OTHER_TOOL}", "MoveL p,v1,fine,tA;"))
    assert seen["Data"].correctable() == [0]
    assert seen["Data"].tools["ta"][0, 3] == 0.3
