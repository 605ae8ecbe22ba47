"""What lines of a routine do to tool, base and the stop before."""

from irbcal.correction.languages.krl.data import Data
from irbcal.correction.languages.krl.statements import Statements
from irbcal.correction.languages.krl.tokens import lines_of
from irbcal.correction.listing import Listing

P = "{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}"


def run(*lines):
    listing = Listing([("job.src", "\n".join(lines).encode())], "KUKA KRL")
    statements = Statements(listing, Data(listing, ["job"]))
    for line in lines_of(listing)[0]:
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
