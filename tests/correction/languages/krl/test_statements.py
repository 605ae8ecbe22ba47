"""What lines of a routine do to tool, base and the stop before."""

import pytest

from irbcal.correction.languages.krl.data import Data
from irbcal.correction.languages.krl.statements import Statements
from irbcal.correction.languages.krl.tokens import lines_of
from irbcal.correction.listing import Listing

P = "{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}"


def run(*lines):
    listing = Listing([("job.src", "\n".join(lines).encode())], "KUKA KRL")
    data = Data(listing, ["job"])
    statements = Statements(listing, data)
    for line in lines_of(listing)[0]:
        if not data.declaration(line):
            statements.statement(line)
    return statements


def test_tools_and_bases():
    for line, tool in (
        ("$TOOL=TOOL_DATA[4]", "4"),
        ("$TOOL = $NULLFRAME", "0"),
        ("BAS(#TOOL,3)", "3"),
        ("BAS(#TOOL,n)", None),
        ("$TOOL=BASE_DATA[1]", None),
        ("$TOOL=f(1)", None),
        ("$TOOL=grip", "grip"),
    ):
        assert run(line).course.state.tool == tool, line
    assert run("BAS(#BASE,2)").course.state.frame == "2"
    assert run("$BASE=TOOL_DATA[2]").course.state.frame is None
    literal = run("$BASE={X 1000,Y 0,Z 0,A 90,B 0,C 0}")
    assert literal.frames[literal.course.state.frame][0, 3] == 1.0


def test_stops_follow_one_another_until_the_program_branches():
    stops = run(f"PTP {P}", f"LIN {P}", "IF x THEN", f"LIN {P}", "ENDIF", f"LIN {P}", f"CIRC {P},{P}").course.stops
    assert [before is not None for _, _, before in stops] == [False, True, False, False, True]


def test_circles_have_a_point_on_the_way():
    done = run(f"CIRC {P},{P},CA 90")
    assert [[use.role for use in found.uses] for found in done.literals] == [["via"], ["to"]]
    assert run("CIRC {X 1}").course.uncorrected[-1].reason == "its end point is missing"


FP1, FP2 = "DECL FDAT FP1={TOOL_NO 1,BASE_NO 5,IPO_FRAME #BASE}", "DECL FDAT FP2={TOOL_NO 2,BASE_NO 0,IPO_FRAME #BASE}"
FIXED = "DECL FDAT FP3={TOOL_NO 3,BASE_NO 1,IPO_FRAME #TCP}"
BEFORE = ("$TOOL=TOOL_DATA[7]", "$BASE=BASE_DATA[8]")


@pytest.mark.parametrize(
    ("lines", "tool", "base"),
    [
        # inline forms of KSS 8: PTP_PARAMS and CP_PARAMS of KUKA's bas.src call FRAMES()
        ((FP1, "FDAT_ACT=FP1", "BAS(#PTP_PARAMS,100)", "PTP {P}"), "1", "5"),
        ((FP2, "FDAT_ACT=FP2", "BAS (#CP_PARAMS, 0.2)", "LIN {P}"), "2", "0"),
        # of KSS 5: PTP_DAT sets speeds alone, FRAMES the rest
        ((FP1, "BAS(#PTP_DAT)", "FDAT_ACT=FP1", "BAS(#FRAMES)", "BAS(#VEL_PTP,100)", "PTP {P}"), "1", "5"),
        (("FDAT_ACT={TOOL_NO 4,BASE_NO 0,IPO_FRAME #BASE}", "BAS(#FRAMES)", "LIN {P}"), "4", "0"),
        # what is set afterwards holds, until BAS takes FDAT_ACT again
        ((FP1, "FDAT_ACT=FP1", "BAS(#FRAMES)", "$TOOL=TOOL_DATA[9]", "LIN {P}"), "9", "5"),
        ((FP1, "FDAT_ACT=FP1", "BAS(#FRAMES)", "$TOOL=TOOL_DATA[9]", "BAS(#CP_PARAMS,1)", "LIN {P}"), "1", "5"),
        ((FP1, "FDAT_ACT=FP1", "SLIN {P} WITH $TOOL=TOOL_DATA[3], $BASE=BASE_DATA[2]"), "3", "2"),
        (("BAS(#VEL_PTP,20)", "BAS(#ACC_CP,20)", "LIN {P}"), "7", "8"),
        (("BAS(#INITMOV,0)", "LIN {P}"), "active", "active"),
    ],
)
def test_inline_forms_set_tool_and_base(lines, tool, base):
    use = run(*BEFORE, *lines_with_point(lines)).literals[-1].uses[-1]
    assert (use.tool, use.work_object) == (tool, base)


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ((FP1, "FDAT_ACT=FP1", "BAS(#PTP_DAT)", "LIN {P}"), "FDAT_ACT names tool 1 and base 5"),
        ((FP1, "FDAT_ACT=FP1", "SLIN {P} WITH $VEL.CP=1"), "FDAT_ACT names tool 1 and base 5"),
        (("BAS(#PTP_PARAMS,100)", "LIN {P}"), "FDAT_ACT, which is not set"),
        ((FP1, "FDAT_ACT=FP1", "IF n THEN", "FDAT_ACT=x", "ENDIF", "BAS(#FRAMES)", "LIN {P}"), "FDAT_ACT, which is"),
        ((FP1, "FDAT_ACT=FP1", "FDAT_ACT.TOOL_NO=2", "BAS(#FRAMES)", "LIN {P}"), "a part of FDAT_ACT is set"),
        (("FDAT_ACT=FP9", "BAS(#CP_PARAMS,1)", "LIN {P}"), "FP9 are not in these files"),
        ((FIXED, "FDAT_ACT=FP3", "BAS(#CP_PARAMS,1)", "LIN {P}"), "the part on the robot"),
        (("$IPO_MODE=#TCP", "LIN {P}"), "the part on the robot"),
        (("BAS(#EX_BASE,2)", "LIN {P}"), "external axis"),
        (("BAS(n,2)", "LIN {P}"), "computes the tool or base"),
        (("SPLINE WITH $TOOL=TOOL_DATA[1]", "SPL {P}", "ENDSPLINE", "LIN {P}"), "spline block"),
    ],
)
def test_moves_whose_tool_is_in_doubt_are_refused(lines, reason):
    target = run(*BEFORE, *lines_with_point(lines)).literals[-1]
    assert any(reason in text for text in target.reasons), target.reasons


def lines_with_point(lines):
    return [line.replace("{P}", P) for line in lines]
