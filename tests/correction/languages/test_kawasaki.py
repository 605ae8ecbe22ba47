"""Moves as Kawasaki AS: what is written, and that it is read again."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import check_damaged, corrected, given, pose_numbers, poses, robot_of, well_inside
from moves_cases import written
from support import assert_same_poses

from irbcal.correction.languages import kawasaki
from irbcal.correction.languages.kawasaki import ends, keyed, read
from irbcal.correction.listing import Listing
from irbcal.errors import OptionError, ProgramError
from irbcal.modeling import frames


def test_joints_rests_and_speeds():
    text = written("kawasaki", "rs007n")["plan.pg"]
    assert "  SPEED 25\r\n  JMOVE #plan2\r\n  BREAK\r\n  TWAIT 4.5\r\n" in text
    assert "\r\n#plan2 10.0000 -60.0000 95.5000 20.0000 30.1250 -40.0000\r\n" in text
    assert text.isascii()


TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
BASE = frames.from_xyz_angles([0.2, 0.1, 0.1, 0.0, 0.1, 0.2])
WORLD = frames.from_xyz_angles([0.0, 0.0, 0.36, 0.0, 0.0, np.pi])
FLANGE = frames.from_xyz_angles([0.0, 0.0, 0.0, 0.0, 0.0, np.pi])
WHERE_Q = np.radians([20.0, 30.0, -80.0, 40.0, 60.0, 10.0])


@pytest.fixture(scope="module")
def robots():
    return robot_of("rs007n", size=0.05)


def pair(nominal):
    """What the controller of this test shows: turned by 180 degrees at both ends, its base at the height of axis 2."""
    return WHERE_Q, frames.inverse(WORLD) @ nominal.forward(WHERE_Q[None])[0] @ FLANGE


def numbers(row):
    return " ".join(f"{v:.6f}" for v in row)


def save(statements, trans=(), joints=(), newline="\r\n"):
    head = [".***--- größe", ".SYSDATA", "SPEED 10", ".END", ".PROGRAM main()", "  ; größe JMOVE #p0"]
    lines = [*head, *statements, ".END", ".TRANS", *trans, ".END", ".JOINTS", *joints, ".END", ""]
    return newline.join(lines).encode("latin-1")


def program(robots, q, **more):
    """Each place as joints, then as a transformation; the last two as literals."""
    nominal, _, _ = robots
    T = frames.inverse(WORLD @ BASE) @ nominal.forward(q) @ FLANGE @ TOOL
    rows = pose_numbers(T, "ZYZ")
    trans = [
        f"tcp  {numbers(pose_numbers(TOOL[None], 'ZYZ')[0])}",
        f"cell {numbers(pose_numbers(BASE[None], 'ZYZ')[0])}",
    ]
    trans += [f"shelf.open[{k},1]  {numbers(row)}" for k, row in enumerate(rows[:-1])]
    joints = [f"#p{k}   {numbers(row)}" for k, row in enumerate(np.degrees(q)[:-1])]
    moves = ["  TOOL tcp", "  base CELL", "10.5.x = 2"][:2]
    for k in range(len(q) - 1):
        moves += ["  SPEED 20 ALWAYS", f"  JMOVE #P{k} ;go", f"  LMOVE shelf.open[{k},1],2 ", f'  PRINT "LMOVE #p{k}"']
    last, pose = (", ".join(f"{v:.6f}" for v in row) for row in (np.degrees(q)[-1], rows[-1]))
    return save([*moves, f"  JMOVE #PPOINT({last})", f"  XMOVE TRANS({pose}) TILL 1001"], trans, joints, **more)


def parsed(robots, data, where=True, **more):
    nominal, _, at = robots
    extra = given(at, **more)._replace(where=pair(nominal) if where else None)
    return kawasaki.parse(nominal, [("job.as", data)], extra)


def read_back(data):
    """Joints and poses of the program's places in their order."""
    text = data.decode("latin-1")
    number = r"[-+\d.]+"
    rows = re.findall(rf"^(?:#p|shelf\S+)\S*((?:\s+{number}){{6}})", text, re.MULTILINE)
    literals = re.findall(r"(?:#PPOINT|TRANS)\(([^)]*)\)", text)
    values = [np.array([float(v) for v in re.findall(number, row)]) for row in rows]
    literal = [np.array([float(v) for v in row.split(",")]) for row in literals]
    n = len(values) // 2
    return np.array([*values[n:], literal[0]]), np.array([*values[:n], literal[1]])


def test_the_robot_goes_where_it_was_meant_to(robots):
    nominal, robot, _ = robots
    q = well_inside(nominal, 25)
    found = corrected(robot, nominal, parsed(robots, program(robots, q)))
    assert found.unchanged_targets == ()
    assert len(found.targets) == 50
    wanted = nominal.forward(q)
    joints, rows = read_back(found.data)
    assert_same_poses(robot.poses(np.radians(joints)), wanted, 1e-7, 1e-7)
    T = WORLD @ BASE @ poses(rows, "ZYZ") @ frames.inverse(FLANGE @ TOOL)
    assert_same_poses(T, nominal.forward(np.radians(joints)), 1e-7, 1e-7)
    assert np.abs(found.q_before[25:] - np.roll(q, 1, axis=0)).max() < 1e-6, "the solution next to the stop before"


def test_only_numbers_change(robots):
    nominal, robot, _ = robots
    for newline in ("\n", "\r\n"):
        data = b"\xef\xbb\xbf" * (newline == "\n") + program(robots, well_inside(nominal, 3), newline=newline)
        found = corrected(robot, nominal, parsed(robots, data))
        mark = f"; irbcal: fake targets, calibration abc123{newline}".encode()
        assert found.data.count(mark) == 1
        blank = re.compile(rb"[-+\d.]+")
        assert blank.sub(b"#", found.data.replace(mark, b"")) == blank.sub(b"#", data)
        assert kawasaki.LANGUAGE.fingerprint(found.data) == "abc123"
        tcp = next(line for line in data.splitlines() if line.startswith(b"tcp"))
        assert tcp in found.data
        with pytest.raises(ProgramError, match="calibration abc123"):
            corrected(robot, nominal, parsed(robots, found.data))


@pytest.mark.parametrize(("statement", "name", "frame"), [("TOOL", b"TOOL tcp", TOOL), ("BASE", b"base CELL", BASE)])
def test_tool_and_base_may_be_given_in_numbers(robots, statement, name, frame):
    nominal, robot, _ = robots
    data = program(robots, well_inside(nominal, 3))
    values = numbers(pose_numbers(frame[None], "ZYZ")[0]).replace(" ", ", ")
    in_numbers = data.replace(name, f"{statement} TRANS({values})".encode())
    assert in_numbers != data
    named, given_in_numbers = (corrected(robot, nominal, parsed(robots, text)) for text in (data, in_numbers))
    assert given_in_numbers.unchanged_targets == ()
    np.testing.assert_array_equal(given_in_numbers.q, named.q)


def test_poses_need_a_pair_of_joints_and_pose(robots):
    """Joints are corrected without it."""
    found = corrected(robots[1], robots[0], parsed(robots, program(robots, well_inside(robots[0], 3)), where=False))
    assert len(found.targets) == 3
    assert len(found.unchanged_targets) == 3
    assert all(
        "as WHERE shows them, with null tool and null base (--where)" in left.reason for left in found.unchanged_targets
    )


P, J = "a 400 50 300 10 120 20", "#p 10 20 -60 10 50 5"


@pytest.mark.parametrize(
    ("statements", "reason"),
    [
        (["TOOL NULL", "BASE NULL", "LMOVE a"], "no configuration, and no known stop"),
        (["TOOL NULL", "BASE NULL", "JMOVE #p", "LMOVE a + TRANS(0,0,5,0,0,0)"], "computed"),
        (["JMOVE #p", "LAPPRO a,50"], "no move goes to a itself"),
        (["JMOVE #p", "POINT #p = #q"], "line 8 uses it in another way"),
        (["JMOVE #p", "CALL pick(#p)"], "line 8 uses it in another way"),
        (["JMOVE #p", "TOOL a", "BASE NULL", "LMOVE a"], "line 8 uses it in another way"),
        (["JMOVE #p", "CALL init", "LMOVE a"], "init, called in line 8, may set the tool or base"),
        (["JMOVE #p", "BASE NULL", "TOOL a+a", "LMOVE a"], "another way"),
        (["JMOVE #p", "BASE NULL", "TOOL #x[.i]", "LMOVE a"], "TOOL in line 9 is computed"),
        (["JMOVE #p", "BASE NULL", "TOOL TRANS(1,2,3)", "LMOVE a"], "TOOL in line 9 is computed"),
        (["JMOVE #p", "BASE NULL", "TOOL f(1,2,3,4,5,6)", "LMOVE a"], "TOOL in line 9 is computed"),
        (["JMOVE #p", "IF .x == 1 THEN", "TOOL NULL", "END", "LMOVE a"], "branch or loop that ends in line 10"),
        (["10 JMOVE #p", "BASE NULL", "LMOVE a"], "the label in line 7"),
        (["TOOL NULL", "BASE NULL", "JMOVE #p", "RIGHTY", "LMOVE a"], "no known stop"),
        (["JMOVE .local"], "not in these files"),
        (["JMOVE TRANS(,,5,0,0,0)"], "computed"),
        (["DRAW 1,2,3"], "by a distance"),
        (["JMOVE b"], "six numbers are not understood"),
    ],
)
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, statements, reason):
    data = save(statements, [P, "b 1 2 3"], [J])
    found = corrected(robots[1], robots[0], parsed(robots, data))
    assert any(reason in left.reason for left in found.unchanged_targets), found.unchanged_targets


def test_frames_that_a_program_changes_are_asked_for(robots):
    data = save(["POINT t = t + t", "BASE NULL", "JMOVE #p", "TOOL t", "LMOVE a"], [P, "t 0 0 100 0 0 0"], [J])
    target, _, reason = parsed(robots, data).unchanged_targets()[0]
    assert target == "a"
    assert "does not define the tool t: give it with --tool t=…" in reason
    seen = parsed(robots, data, tools={"t": TOOL})
    assert [target.name for target in seen.targets if target.correctable] == ["a", "#p"]


def test_elements_of_an_array_by_variable_and_steps_of_teach_programs(robots):
    step = "JOINT SPEED9 ACCU1 TIMER0 TOOL1 WORK0 CLAMP1 (OFF,0,0,O) OX= WX= #[10,20,-60,10,50,5,-2000] ;"
    data = save(["FOR .i = 1 TO 2", "JMOVE #p[.i]", "END", step], [], ["#p[1] 1 2 -60 4 50 6", "#p[2] 2 3 -61 4 50 6"])
    seen = parsed(robots, data)
    assert [target.correctable for target in seen.targets] == [True] * 3
    assert seen.axes_notes()[0].text.startswith("JOINT in line 10 has external axes")
    found = corrected(robots[1], robots[0], seen)
    assert b",-2000] ;" in found.data
    assert len(found.targets) == 3


@settings(max_examples=20, deadline=None)
@hypothesis_given(
    st.lists(st.lists(st.floats(-9999, 9999), min_size=6, max_size=6), min_size=1, max_size=5),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from([" ", "\t", "   "]),
)
def test_generated_programs_keep_their_bytes(robots, points, newline, gap):
    joints = [f"#p[{k}]{gap}{gap.join(f'{v:.6f}' for v in row)}{gap}" for k, row in enumerate(points)]
    data = save([f"{gap}JMOVE{gap}#p[{k}]" for k in range(len(points))], [], joints, newline)
    seen = parsed(robots, data)
    assert seen.listing.files_with([]) == {"job.as": data}
    assert len(seen.targets) == len(points)
    np.testing.assert_allclose([target.written for target in seen.targets], points, rtol=0, atol=1e-6)


def test_damaged_programs_end_in_a_refusal_or_a_result(robots):
    nominal, robot, _ = robots
    check_damaged(
        program(robots, well_inside(nominal, 2)),
        lambda data: parsed(robots, data),
        lambda seen: corrected(robot, nominal, seen),
    )


TEXT = (
    ".NETCONF     192.168.0.2,x\n.***---- comment\n.SYSDATA\nTOOL 1 2 3 4 5 6\n#p 9 9 9 9 9 9\n.END\n"
    '.PROGRAM main(.a) ; says JMOVE\n  .end_x = 1\n  PRINT "JMOVE #p"\n10 JMOVE #p[1 , 2]\n.END\n'
    ".TRANS\nshelf.open[1,1]   1.000000 -2 .5 1e1 0 0 -300\nshort 1 2 3\n.END\n"
    ".JOINTS\n#p[1,2] 1 2 3 4 5 6\n#P[ 1, 2 ] 1 2 3 4 5 7\np 1 2 3 4 5 6\n.END\n"
)


def test_only_programs_and_locations_are_read():
    found = read(Listing([("a.as", TEXT.encode())], "AS"))
    assert [line.program for line in found.lines if line.program] == ["main"]
    words = [[token.word for token in line.tokens] for line in found.lines if line.tokens]
    assert words == [[".end_x", "=", "1"], ["print", '"JMOVE #p"'], ["10", "jmove", "#p", "[", "1", ",", "2", "]"]]
    assert list(found.names) == ["shelf.open", "short", "#p"]
    shelf = found.locations["shelf.open[1,1]"]
    assert [number.value for number in shelf.numbers] == [1.0, -2.0, 0.5, 10.0, 0.0, 0.0]
    assert [TEXT[number.start : number.end] for number in shelf.numbers] == ["1.000000", "-2", ".5", "1e1", "0", "0"]
    assert (shelf.external, shelf.e, shelf.conflicts) == ("JT7", {"e1": -300.0}, [])
    assert found.locations["short"].conflicts == ["its six numbers are not understood"]
    assert found.locations["#p[1,2]"].conflicts == ["there are two of this name"]
    assert [found.locations[key].conflicts for key in found.numbered["#p[1,2]"]] == [["there are two of this name"]] * 2
    assert TEXT[found.begins[0] :].startswith("  .end_x")


@pytest.mark.parametrize(("name", "index", "key"), [("#P", None, "#p"), ("a.b", " 1 ,2", "a.b[1,2]")])
def test_names_are_looked_up_without_case_and_blanks(name, index, key):
    assert keyed(name, index) == key


Q = np.radians([20.0, 30.0, -80.0, 40.0, 60.0, 10.0])


def turned(k, height=0.0):
    return frames.from_xyz_angles([0.0, 0.0, height, 0.0, 0.0, k * np.pi / 2])


@pytest.mark.parametrize(("base", "flange", "height"), [(0, 0, 0.0), (2, 2, 0.36), (1, 3, -0.1)])
def test_quarter_turns_and_the_height_are_found(base, flange, height):
    nominal = robot_of("rs007n")[0]
    B, F = turned(base, height), turned(flange)
    pose = frames.inverse(B) @ nominal.forward(Q[None])[0] @ F
    pose[0, 3] += 5e-6  # as far as a pendant rounds
    found = ends(nominal, Q, pose)
    np.testing.assert_allclose(found.T_base_world, B, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.T_tip_flange, F, rtol=0, atol=1e-9)


def test_other_pairs_are_refused():
    nominal = robot_of("rs007n")[0]
    pose = nominal.forward(Q[None])[0]
    with pytest.raises(OptionError, match=r"nearest is \d+\.\d mm and \d+\.\d\d degrees off"):
        ends(nominal, Q, pose @ frames.from_xyz_angles([0.0, 0.0, 0.1, 0.0, 0.2, 0.0]))
    upright = nominal.forward(np.zeros((1, 6)))[0]
    with pytest.raises(OptionError, match="fits several turns"):
        ends(nominal, np.zeros(6), upright)
