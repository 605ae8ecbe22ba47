"""Which tool holds and which stop comes before."""

from irbcal.correction.course import UNSET, Course
from irbcal.correction.listing import Listing, Number
from irbcal.correction.maker_program import Found


def course():
    return Course(Listing([("a", b"x\n" * 9)], "X"))


def found():
    return Found("p", "pose", 0, [Number(0.0, 0, 1)] * 6)


def test_frames_hold_until_a_branch_sets_them():
    one = course()
    assert one.state.tool == UNSET
    one.tool("1")
    one.open()
    one.tool("1")
    one.alternative()
    one.close(2)
    assert one.state.tool == "1"
    one.open()
    one.tool("2")
    one.alternative()
    assert one.state.tool == "1"
    one.close(4)
    assert one.state.tool is None
    assert "line 3" in one.state.why
    one.tool("3")
    one.restart()
    assert one.state.tool == UNSET


def test_a_loop_that_sets_the_tool_spoils_what_comes_before_in_it():
    one, inside, outside = course(), found(), found()
    one.tool("1")
    one.frame("1")
    one.use(outside, 0, "LIN")
    one.open(loop=True)
    one.use(inside, 2, "LIN")
    one.tool("2")
    one.close(4)
    assert inside.reasons
    assert not outside.reasons


def test_stops_and_where_they_are_come_from():
    one, a, b, via = course(), found(), found(), found()
    one.stop(a, 0)
    one.use(via, 2, "CIRC", "via")
    one.stop(b, 2)
    one.forget()
    one.stop(a, 4)
    one.stop(None, 6)
    one.stop(b, 8)
    order = one.order({id(a): 0, id(b): 1, id(via): 2})
    assert [(stop.line, stop.target, stop.previous) for stop in order] == [
        (1, 0, None),
        (2, 1, 0),
        (3, 0, None),
        (4, None, 0),
        (5, 1, None),
    ]
    assert (a.after, b.after, via.after) == ([None, None], [0, None], [0])
