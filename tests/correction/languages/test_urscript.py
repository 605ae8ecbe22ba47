"""Moves as URScript: what is written, and that it is read again."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import check_damaged, corrected, given, pose_numbers, poses
from moves_cases import written
from support import assert_same_poses, example_robot, random_robot

from irbcal.correction.languages import urscript
from irbcal.correction.languages.urscript import UNIVERSAL_ROBOTS, arguments, statements
from irbcal.correction.listing import Listing
from irbcal.correction.listing import numbers as numbers_of
from irbcal.errors import ProgramError
from irbcal.io import controller_model, urdf
from irbcal.modeling import frames

LINE = "movej([0.174532925, -1.047197551, 1.666789436, 0.349065850, 0.525780437, -0.698131701], a=1.0, v=0.500)"


def test_joints_rests_and_speeds():
    files = written("urscript", "ur10")
    text = files["plan.script"]
    assert LINE in text
    assert text.isascii()
    assert LINE + "\n  sleep(4.5)\n" in text


TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])


@pytest.fixture(scope="module")
def robots():
    path = example_robot("ur_description/urdf/ur10_robot.urdf")
    nominal = urdf.read(path).arm
    at = controller_model.controller_frames(path.read_bytes(), str(path), nominal.base_link, nominal.tip_link)
    return nominal, random_robot(nominal, "placement", np.random.default_rng(1), size=0.05), at


def joints(n):
    """Joints away from singularities: elbow bent, wrist 2 turned, arm out."""
    rng = np.random.default_rng(3)
    low = np.radians([-170, -130, 40, -100, 40, -170])
    return rng.uniform(low, np.radians([170, -50, 110, -20, 130, 170]), (n, 6))


def numbers(values, decimals=12):
    return ",".join(
        f"{value:.{decimals}f}".replace("0.", ".", 1) if abs(value) < 1 else f"{value:.{decimals}f}" for value in values
    )


def program(robots, q, newline="\n"):
    nominal, _, at = robots
    T = frames.inverse(at.T_base_world) @ nominal.forward(q) @ frames.inverse(at.T_tip_flange) @ at.T_tip_flange @ TOOL
    head, body = ["def job():", f"  set_tcp(p[{numbers(pose_numbers(TOOL[None], None, 1.0)[0], 15)}])", "  # Größe"], []
    for k, (row, pose) in enumerate(zip(q, pose_numbers(T, None, 1.0), strict=True)):
        head += [f"  global W_{k}_p=p[{numbers(pose)}]", f"  global W_{k}_q=[{numbers(row, 16)}]"]
        body += [f'  $ {k} "W_{k}"', f"  movej(get_inverse_kin(W_{k}_p, qnear=W_{k}_q), a=1.4, v=1.0)"]
        body += [f"  movel(p[{numbers(pose)}], a=1.2)", f"  movej([ {numbers(row)} ])"]
    return newline.join([*head, *body, "end", ""]).encode()


def parsed(robots, data, **more):
    nominal, _, at = robots
    return urscript.parse(nominal, data, "job.script", given(at, **more))


def test_the_base_is_turned_and_the_flange_is_tool0(robots):
    at = robots[2]
    assert at.base_known
    assert at.flange_known
    np.testing.assert_allclose(at.T_base_world[:3, :3], np.diag([-1, -1, 1]), rtol=0, atol=1e-9)


def test_the_robot_goes_where_it_was_meant_to(robots):
    nominal, robot, at = robots
    q = joints(15)
    found = corrected(robot, nominal, parsed(robots, program(robots, q)))
    assert found.unchanged_targets == ()
    assert len(found.targets) == 45
    wanted = nominal.forward(q)
    text = found.data.decode()
    literal = re.findall(r"(p?)\[([^\]]*)\]", re.sub(r"global W_\d+_q=.*", "", text))
    rows = [np.array([float(v) for v in inside.split(",")]) for _, inside in literal]
    kinds = [kind for kind, _ in literal]
    new = np.array([row for row, kind in zip(rows, kinds, strict=True) if kind == "p"][1:])
    moved = np.array([row for row, kind in zip(rows, kinds, strict=True) if not kind])
    assert_same_poses(robot.poses(moved), wanted, 1e-8, 1e-8)
    T = at.T_base_world @ poses(new, None, 1.0) @ frames.inverse(TOOL)
    fake = dict(zip(found.targets, found.q, strict=True))
    named = np.array([fake[f"W_{k}_p"] for k in range(15)])
    assert_same_poses(T[:15], nominal.forward(named), 1e-8, 1e-8)
    assert_same_poses(T[15:], T[:15], 1e-8, 1e-8)
    assert_same_poses(robot.poses(named), wanted, 1e-7, 1e-7)
    assert np.abs(found.q_before - np.r_[q, q, q]).max() < 7, "qnear and the stop before tell the solution"
    for line in [line for line in program(robots, q).decode().splitlines() if "_q=" in line]:
        assert line in text, "joints that only say where to start from stay"


def test_only_numbers_change(robots):
    nominal, robot, _ = robots
    data = program(robots, joints(3), "\r\n")
    found = corrected(robot, nominal, parsed(robots, data))
    mark = b"# irbcal: fake targets, calibration abc123\r\n"
    assert found.data.count(mark) == 1
    blank = re.compile(rb"[-+]?[\d.]+")
    assert blank.sub(b"#", found.data.replace(mark, b"")) == blank.sub(b"#", data)
    assert urscript.LANGUAGE.fingerprint(found.data) == "abc123"
    with pytest.raises(ProgramError, match="fake targets already"):
        corrected(robot, nominal, parsed(robots, found.data))


P, Q = "p[0.5,0.3,0.4,0.1,3.0,0.2]", "[0.1,-1.5,1.2,-1.2,-1.5,0.1]"
TCP = "set_tcp(p[0,0,0.1,0,0,0])\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"movel({P})", "nothing says which"),
        (f"movej(get_inverse_kin(pose_trans(f,{P}), qnear={Q}))", "its target is computed"),
        (f"movel(pose_add({P},{P}))", "its target is computed"),
        ("movej(get_target_joint_positions())", "its target is computed"),
        (f"x={Q}\nmovej(x)\nx[1]=2", "computed or changed in line 4"),
        (f"x={Q}\nx={Q}\nmovej(x)", "computed or changed in line 3"),
        (f"x={Q}\nmovej(x)\ny=x", "uses it in another way"),
        (f"movej({Q})\nset_tcp(other)\nmovel({P})", "the TCP of line 3 is computed"),
        (f"movej({Q})\nset_tcp(p[0,0,150,0,0,0])\nmovel({P})", "the TCP of line 3 is in millimetres"),
        (f"movej({Q})\nmovel(p[500,300,400,0.1,3.0,0.2])", "found a position in millimetres, expected metres"),
        (f"movej({Q})\nif a:\n set_tcp({P})\nend\nmovej(get_inverse_kin({P}, qnear={Q}))", "branch or loop"),
        (
            f"def grip():\n {TCP}end\nmovej({Q})\ngrip()\nmovej(get_inverse_kin({P}, qnear={Q}))",
            "grip, called in line 6, may set the TCP",
        ),
        ("movej(Waypoint_p)", "its target is computed"),
        (f"servoj({Q}, 0, 0, 0.1)", "while the program runs"),
        ("movec(p[1,2,3,4,5,6])", "its target is missing"),
        (  # joint 1 by 0.8 rad: another side of what is between
            f"x={P}\nmovej(get_inverse_kin(x, qnear={Q}))\nmovej(get_inverse_kin(x, qnear={Q.replace('0.1,-1', '0.9,-1')}))",
            "start from different joints (qnear)",
        ),
    ],
)
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, text, reason):
    nominal, robot, _ = robots
    found = corrected(robot, nominal, parsed(robots, (TCP + text + "\n").encode()))
    assert any(reason in left.reason for left in found.unchanged_targets), found.unchanged_targets


@pytest.mark.parametrize(
    "text", [f"movej({Q}, a=1, v=1)", f"global x={Q}\nwhile True:\n movej(x)\nend", f"movep(get_inverse_kin({P}, {Q}))"]
)
def test_what_is_read(robots, text):
    seen = parsed(robots, (TCP + text + "\n").encode())
    assert len(seen.correctable()) == 1


def test_a_tool_that_the_installation_holds_is_asked_for(robots):
    text = f"movej(get_inverse_kin({P}, qnear={Q}))\n".encode()
    ((_, _, reason),) = parsed(robots, text).unchanged_targets()
    assert "give it with --tool active=…" in reason
    assert parsed(robots, text, tools={"active": np.eye(4)}).correctable() == [0]


@pytest.mark.parametrize(
    ("text", "known"),
    [
        ("MOVE", True),
        ("def job():\n  set_digital_out(1,True)\n  MOVE\nend\njob()", True),
        ("def job():\n  freedrive_mode()\n  MOVE\nend\njob()", False),  # others move it
        ("def job():\n  sleep(1)\n  MOVE\nend", True),
        ("def job():\n  def sub():\n    movej(x)\n  end\n  MOVE\nend", True),
        ("def job():\n  def sub():\n    MOVE\n  end\nend", False),
        ("def job():\n  def sub():\n    movej(x)\n  end\n  sub()\n  MOVE\nend", False),
        ("def job():\n  if True:\n    sleep(1)\n  end\n  MOVE\nend", True),
        ("def one():\n  movej(x)\nend\ndef job():\n  MOVE\nend", False),
    ],
)
def test_a_pose_without_qnear_begins_where_the_program_does(robots, text, known):
    nominal, _, at = robots
    q = joints(1)[0]
    T = pose_numbers(frames.inverse(at.T_base_world) @ nominal.forward(q[None]), None, 1.0)[0]
    data = text.replace("MOVE", f"movel(p[{numbers(T)}])").encode()
    setup = given(at, tools={"active": np.eye(4)})._replace(start=q + 0.1)
    (batch,) = urscript.parse(nominal, data, "job.script", setup).wanted_targets()
    assert (batch.unknown[0] == "") == known, batch.unknown
    if known:
        np.testing.assert_allclose(batch.joints[0], q, rtol=0, atol=1e-6)


def test_circles(robots):
    nominal, _, at = robots
    q = joints(1)[0] + np.array([[0, 0, 0, 0, 0, 0], [0.05, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0]])
    T = pose_numbers(frames.inverse(at.T_base_world) @ nominal.forward(q), None, 1.0)
    text = f"movej([{numbers(q[0])}])\nmovec(p[{numbers(T[1])}], p[{numbers(T[2])}], a=1)\n".encode()
    found = corrected(robots[1], nominal, parsed(robots, text, tools={"active": np.eye(4)}))
    assert found.unchanged_targets == ()
    np.testing.assert_allclose(found.q_before, q, rtol=0, atol=1e-6)


@settings(max_examples=30, deadline=None)
@hypothesis_given(
    st.lists(
        st.tuples(
            st.lists(st.floats(-3, 3), min_size=6, max_size=6),
            st.sampled_from(["movej", "movel", "movep"]),
            st.booleans(),
            st.sampled_from(["", " ", "\t"]),
        ),
        min_size=1,
        max_size=6,
    ),
    st.sampled_from(["\n", "\r\n"]),
)
def test_generated_programs_keep_their_bytes(robots, points, newline):
    lines = [
        f"{blank}{move}({'p' * pose}[{(',' + blank).join(f'{v:.6f}' for v in values)}],{blank}a=1)"
        for values, move, pose, blank in points
    ]
    data = newline.join(["def x():", *lines, "end"]).encode()
    seen = parsed(robots, data, tools={"active": np.eye(4)})
    assert seen.listing.files_with([]) == {"job.script": data}
    assert len(seen.targets) == len(points)


def test_damaged_programs_end_in_a_refusal_or_a_result(robots):
    nominal, robot, _ = robots
    check_damaged(
        program(robots, joints(2)),
        lambda data: parsed(robots, data, tools={"active": np.eye(4)}),
        lambda seen: corrected(robot, nominal, seen),
    )


def read(text):
    return statements(Listing([("a.script", text.encode("latin-1"))], "URScript"))


def test_statements_end_with_lines_outside_brackets():
    found, comments = read('movej([1,\n 2])\n  $ 12 "a" # no\nx=1 # y\na();b()\n')
    assert ["".join(token.word for token in line) for line in found] == ["movej([1,2])", "x=1", "a()", "b()"]
    assert comments == ["# y"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[-.5, +1, 2e-3]", [-0.5, 1, 0.002]),
        ("[1,]", None),
        ("[1 2]", None),
        ("[x]", None),
        ("[1-2]", None),
        ("[-]", None),
        ("[]", None),
        ("[1", None),
    ],
)
def test_numbers(text, expected):
    try:
        ((*tokens,),), _ = read(text)
    except ProgramError:
        assert expected is None
        return
    found = numbers_of(tokens)
    assert (None if found is None else [number.value for number in found]) == expected


def test_arguments():
    ((*tokens,),), _ = read("(p[1,2], a=1.2, f(x,y), t=[0,1]) + 3")
    assert [(name, "".join(t.word for t in part)) for name, part in arguments(tokens)] == [
        ("", "p[1,2]"),
        ("a", "1.2"),
        ("", "f(x,y)"),
        ("t", "[0,1]"),
    ]


def test_open_brackets_are_refused():
    with pytest.raises(ProgramError, match=r"a.script: line 2: the brackets of this statement"):
        read("x=1\nmovej([1,2\n")


def test_units_are_si():
    assert (UNIVERSAL_ROBOTS.length, UNIVERSAL_ROBOTS.angle, UNIVERSAL_ROBOTS.joint) == (1, 1, 1)


@pytest.mark.parametrize(
    ("frame", "move", "why"),
    [
        ("plane=FRAME", "movel(pose_trans(plane, POSE), a=1)", ""),
        ("plane=FRAME", "movel(get_inverse_kin(pose_trans(plane, POSE), qnear=[JOINTS]))", ""),
        ("plane=FRAME", "p1=POSE\n  movel(pose_trans(plane, p1))", ""),
        ("n=1", "movel(pose_trans(FRAME, POSE))", ""),
        ("plane=FRAME", "movel(pose_trans(plane, POSE))\n  plane=get_actual_tcp_pose()", "its target is computed"),
        ("plane=FRAME", "movel(pose_trans(plane, get_actual_tcp_pose()))", "its target is computed"),
        ("plane=FRAME", "movel(pose_trans(plane, [JOINTS]))", "its target is computed"),
        ("plane=FRAME", "p1=POSE\n  movel(pose_trans(plane, p1))\n  movel(p1)", "used with different work objects"),
    ],
)
def test_poses_in_a_plane_are_corrected_there(robots, frame, move, why):
    """pose_trans(F, p) is F p: both by scipy."""
    nominal, robot, at = robots
    q = joints(1)[0]
    F = poses([0.1, -0.2, 0.3, 0.2, -0.1, 1.2], None, 1.0)[0]
    T = frames.inverse(F) @ frames.inverse(at.T_base_world) @ nominal.forward(q[None])
    pose = f"p[{numbers(pose_numbers(T, None, 1.0)[0])}]"
    text = f"def job():\n  set_tcp(p[0,0,0,0,0,0])\n  {frame}\n  movej([JOINTS])\n  {move}\nend\n"
    text = (
        text.replace("FRAME", "p[0.1, -0.2, 0.3, 0.2, -0.1, 1.2]").replace("POSE", pose).replace("JOINTS", numbers(q))
    )
    seen = urscript.parse(nominal, text.encode(), "job.script", given(at))
    if why:
        assert any(why in left.reason for left in seen.unchanged_targets()), seen.unchanged_targets()
        return
    (batch,) = [batch for batch in seen.wanted_targets() if batch.kind == "pose"]
    np.testing.assert_allclose(batch.values[0], nominal.forward(q[None])[0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(batch.joints[0], q, rtol=0, atol=1e-6)
    found = corrected(robot, nominal, seen)
    new = re.findall(rb"p\[([^\]]*)\]", found.data)[-1].decode()
    reached = (
        at.T_base_world @ F @ poses([float(v) for v in new.split(",")], None, 1.0)[0] if "p1" not in move else None
    )
    if reached is not None:
        assert_same_poses(reached[None], nominal.forward(found.q[-1:]), 1e-7, 1e-7)
        assert_same_poses(robot.poses(found.q[-1:]), nominal.forward(q[None]), 1e-6, 1e-6)
