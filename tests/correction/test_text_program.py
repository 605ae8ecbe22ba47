"""Rewriting targets in a text: the numbers change, and no other byte ever does."""

from types import SimpleNamespace

import numpy as np
import pytest
from rapid_modules import CELL, EXT, module, named, parsed, pose, rewritten

from irbcal.correction.control_flow import ControlFlow
from irbcal.correction.languages.krl import KUKA
from irbcal.correction.listing import Listing, Number
from irbcal.correction.maker import ConfData
from irbcal.correction.program import WantedTargets, read_bytes, refuse_filtered
from irbcal.correction.targets import AT_START, UNSET, Target, Use, complete
from irbcal.errors import ProgramError
from irbcal.modeling import frames


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_unchanged_programs_are_the_same_bytes(encoding, newline):
    content = (
        CELL.replace("a comment", "Größe Ångström").replace("pRest", "pRüst").replace("\n", newline).encode(encoding)
    )
    seen = parsed(content)
    assert seen.data == content
    assert rewritten(seen, {}) == content
    same = {k: target.value for k, target in enumerate(seen.targets)}
    assert rewritten(seen, same) == content
    assert seen.targets[named(seen, "pRüst")].line == 6
    new = rewritten(seen, {1: pose(7, 8, 9)})
    assert new == content.replace(b"[1.5E2, - 20 , +3]", b"[7, 8 , 9]")


def test_one_target_changes_only_its_numbers():
    seen = parsed(CELL.encode())
    text = CELL
    for name, value, old, new in [
        ("pRest", pose(150, -20.0000001, 3.0000019), "+3]", "3.000002]"),  # what does not change keeps its text
        ("pRow{2}", pose(4, -0.00000001, 1e-5 / 3, frames.rot_z(0.2)), "[[4,5,6],[1,0,0,0]", "[[4,0,0.000003],[0.995004165,0,0,0.099833417]"),
        ("jHome", np.radians([0, 10, -20, 30.25, 123456.7890126, -179.5]), "30.25,40,-90]", "30.25,123456.789013,-179.5]"),
        ("p10", pose(1e7, -0.5, -1, frames.rot_x(-np.pi)), "[[100,-.5,1.]", "[[10000000,-.5,-1]"),  # -q is not nearer
    ]:  # fmt: skip
        written = rewritten(seen, {named(seen, name): value})
        assert written.decode() == text.replace(old, new)
        assert text.count(old) == 1


def test_configurations_are_rewritten():
    seen = parsed(CELL.encode())
    k = named(seen, "p10")
    written = rewritten(seen, {}, {k: ConfData(0, 2, -3, 1)})
    assert written.decode() == CELL.replace("[0,-1,-2,1]", "[0,2,-3,1]")
    for conf in ("conf", "[0,0,.5,0]"):
        data = f"CONST robtarget p10:=[[1,2,3],[1,0,0,0],{conf},{EXT}];"
        computed = parsed(module("MoveL p10,v1,fine,tool0;", data=data), "m")
        assert computed.targets[0].reason == "its configuration is computed, or not of whole numbers"
        with pytest.raises(ProgramError, match="m: line 2: target p10 has no configuration in numbers to rewrite"):
            rewritten(computed, {}, {0: ConfData(0, 0, 0, 0)})


@pytest.mark.parametrize(
    "value", [np.zeros(6), np.full((4, 4), np.nan), np.diag([2.0, 1, 1, 1]), np.diag([-1.0, 1, 1, 1])]
)
def test_values_that_cannot_be_written_are_refused(value):
    seen = parsed(module("MoveL p10,v1,fine,tool0;"))
    with pytest.raises(ValueError, match="expected"):
        rewritten(seen, {0: value})


def flow():
    return ControlFlow(Listing([("a", b"x\n" * 9)], "X"))


def target():
    return Target("p", "pose", 0, [Number(0.0, 0, 1)] * 6)


def test_frames_hold_until_a_branch_sets_them():
    one = flow()
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
    assert "line 3" in one.state.reason
    one.tool("3")
    one.restart()
    assert one.state.tool == UNSET


def test_a_loop_that_sets_the_tool_spoils_what_comes_before_in_it():
    one, inside, outside = flow(), target(), target()
    one.tool("1")
    one.frame("1")
    one.use(outside, 0, "LIN")
    one.open(loop=True)
    one.use(inside, 2, "LIN")
    one.tool("2")
    one.close(4)
    assert inside.conflicts
    assert not outside.conflicts


@pytest.mark.parametrize(("first_begins", "routines", "known"), [(False, 1, True), (False, 2, False), (True, 2, True)])
def test_a_start_is_that_of_the_routine_that_the_program_begins_with(first_begins, routines, known):
    one, targets = flow(), [target() for _ in range(routines)]
    one.first_begins = first_begins
    for k, each in enumerate(targets):
        one.restart()
        one.stop(each, 2 * k)
    one.order(targets)
    assert targets[0].previous == ([AT_START] if known else [None])
    several = ControlFlow(Listing([("a", b"x\n"), ("b", b"x\n")], "X"))
    several.first_begins = True
    ends = [target(), target()]
    for each, at in zip(ends, (0, 2), strict=True):
        several.restart()
        several.stop(each, at)
    several.order(ends)
    assert ends[0].previous == [None], "which file begins is not known"


def test_a_branch_in_which_nothing_moves_hides_no_stop():
    one, a, b = flow(), target(), target()
    one.stop(a, 0)
    one.open()
    one.open(loop=True)
    one.close(2)
    one.alternative()
    one.close(4)
    assert one.previous is a
    for disturb in (one.forget, lambda: one.stop(b, 6)):
        one.previous = a
        one.open()
        one.open()
        disturb()
        one.close(6)
        one.close(8)
        assert one.previous is None
    one.previous = a
    one.open()
    assert one.previous is None, "the first move of a loop may come from its last"


def test_stops_and_where_they_are_come_from():
    one, a, b, via = flow(), target(), target(), target()
    one.stop(a, 0)
    one.use(via, 2, "CIRC", "via")
    one.stop(b, 2)
    one.forget()
    one.stop(a, 4)
    one.stop(None, 6)
    one.stop(b, 8)
    order = one.order([a, b, via])
    assert [(stop.line, stop.target, stop.previous) for stop in order] == [
        (1, 0, None),
        (2, 1, 0),
        (3, 0, None),
        (4, None, 0),
        (5, 1, None),
    ]
    assert (a.previous, b.previous, via.previous) == ([AT_START, None], [0, None], [0])


def test_frames_of_six_numbers():
    T = KUKA.frame([1000, 0, 0, 90, 0, 0])
    np.testing.assert_allclose(T[:3, :2], [[0, -1], [1, 0], [0, 0]], rtol=0, atol=1e-15)
    assert np.isnan(KUKA.frame([1e30, 0, 0, 90, 0, 0])).all()


@pytest.mark.parametrize("value", [1e30, float("inf"), float("nan")])
def test_absurd_numbers_are_no_targets(value):
    unused, used = (Target("p", "pose", 0, [Number(value, 0, 1)] * 6) for _ in range(2))
    used.uses.append(Use(1, 1, "LIN", "to", "0", "0"))
    other, one = complete([unused, used], Listing([("a", b"x")], "X"), KUKA)
    assert other.conflicts == []
    assert one.conflicts == ["found a number that is too large"]
    assert np.isnan(one.value).all()


def test_files_that_cannot_be_programs(tmp_path):
    (tmp_path / "empty.mod").write_text(" \n")
    for name, expected in (("none.mod", "there is no such file"), ("", "found a folder"), ("empty.mod", "is empty")):
        with pytest.raises(ProgramError, match=expected) as caught:
            read_bytes(tmp_path / name)
        assert caught.value.file == str(tmp_path / name)


@pytest.mark.parametrize(("mark", "which"), [("abc", " for calibration abc"), ("", "")])
def test_marked_programs_are_refused(mark, which):
    with pytest.raises(ProgramError) as caught:
        refuse_filtered(SimpleNamespace(source="job.mod", fingerprint=mark))
    assert str(caught.value) == f"job.mod: these are fake targets already{which}: filter the original program"
    refuse_filtered(SimpleNamespace(source="job.mod", fingerprint=None))


def test_goals_are_locked():
    goals = WantedTargets("joint", np.arange(2), ("a", "b"), np.arange(2), np.zeros((2, 6)))
    with pytest.raises(ValueError, match="read-only"):
        goals.values[0, 0] = 1.0
