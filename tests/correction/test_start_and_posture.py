"""Poses whose configuration the program does not say: from the stop before, the start, or a posture; the joints that
made the poses are the oracle."""

from dataclasses import replace

import numpy as np
import pytest
from maker_cases import pose_numbers, robot_of
from scipy.spatial.transform import Rotation
from support import arm, assert_same_poses, random_robot

import irbcal
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import rapid, val3
from irbcal.correction.maker import configuration_of
from irbcal.correction.program import ControllerSetup
from irbcal.errors import OptionError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling.inverse import nearly_closed_form

EXT = "[9E9,9E9,9E9,9E9,9E9,9E9]"
OFF = ["ConfL \\Off;", "ConfJ\\Off;"]
HOME = [5.0, -20, 30, 10, 40, -15]
WRONG = "0,-1,-1,0"
"""What some generators write into every target."""


def target(nominal, joints, conf=WRONG):
    """A robtarget that these joints (degrees) reach, its quaternion by scipy."""
    T = nominal.forward(np.radians([joints]))[0]
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    xyz = ",".join(f"{1000 * v:.7f}" for v in T[:3, 3])
    return f"[[{xyz}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}],[{conf}],{EXT}]"


def read(tmp_path, nominal, *lines, start=None, posture=None, routines=""):
    (tmp_path / "m.mod").write_text(
        "\n".join(["MODULE m", "PROC main()", *lines, "ENDPROC", routines, "ENDMODULE", ""])
    )
    joints = [None if q is None else np.radians(q) for q in (start, posture)]
    setup = ControllerSetup({}, {}, unknown_frames(), start=joints[0], posture=joints[1])
    (program,) = rapid.read_for(nominal, [tmp_path / "m.mod"], setup)
    return program


def moved(*change):
    return [a + b for a, b in zip(HOME, change, strict=True)]


A, B = moved(10, 5, -5, 3, 10, 20), moved(20, 0, 5, -9, -15, 40)


@pytest.mark.parametrize("start", [None, HOME])
def test_where_configurations_do_not_count_the_joints_are_next_to_the_stop_before(tmp_path, start):
    nominal = arm()
    robot = random_robot(nominal, "16", np.random.default_rng(1), size=0.2)
    begin = f"MoveAbsJ [[{','.join(map(str, HOME))}],{EXT}],v1,fine,tool0;"
    lines = [f"MoveJ {target(nominal, A)},v1,fine,tool0;", f"MoveL {target(nominal, B)},v1,fine,tool0;"]
    program = read(tmp_path, nominal, *OFF, *([begin] if start is None else []), *lines, start=start)
    found = filter_program(program, CorrectionModel(robot, nominal, "abc"))
    assert found.unchanged_targets == ()
    np.testing.assert_allclose(np.degrees(found.q_before[-2:]), [A, B], rtol=0, atol=1e-4)
    assert_same_poses(robot.poses(found.q[-2:]), nominal.forward(np.radians([A, B])), 1e-6, 1e-6)
    assert found.data.count(f"[{WRONG}]".encode()) == 2, "what does not count is not written"


def test_without_a_start_they_are_left_with_the_options_that_help(tmp_path):
    nominal = arm()
    moves = [f"MoveJ {target(nominal, A)},v1,fine,tool0;", f"MoveL {target(nominal, B)},v1,fine,tool0;"]
    program = read(tmp_path, nominal, *OFF, *moves)
    found = filter_program(
        program, CorrectionModel(random_robot(nominal, "16", np.random.default_rng(1), size=0.2), nominal, "abc")
    )
    assert len(found.unchanged_targets) == 2
    assert all("--start" in left.reason and "--posture" in left.reason for left in found.unchanged_targets)
    flipped = [HOME[0], HOME[1], HOME[2], HOME[3] + 180, -HOME[4], HOME[5] - 180]
    for posture, q in ((HOME, A), (flipped, [A[0], A[1], A[2], A[3] + 180, -A[4], A[5] - 180])):
        (batch,) = read(tmp_path, nominal, *OFF, *moves, posture=posture).wanted_targets()
        np.testing.assert_allclose(np.degrees(batch.joints[0]), q, rtol=0, atol=1e-4)


def joints_of(program):
    ((batch),) = [b for b in program.wanted_targets() if b.kind == "pose"]
    return batch.joints, batch.unknown


FAR = moved(0, 0, 0, 0, 0, 175)
OTHER = [HOME[0], HOME[1], HOME[2], HOME[3], -30.0, HOME[5]]


@pytest.mark.parametrize(
    ("between", "then", "reason"),
    [
        ([], A, ""),
        (["IF di1=1 THEN", "WaitDI di1,0;", "n:=2;", "ENDIF", "WHILE n>0 DO", "n:=n-1;", "ENDWHILE"], A, ""),
        (["IF di1=1 THEN", f"MoveAbsJ [[0,0,0,0,30,0],{EXT}],v1,fine,tool0;", "ENDIF"], A, "no stop just before"),
        (["IF di1=1 Grip;"], A, "no stop just before"),
        (["IF di1=1 THEN", "Grip;", "ENDIF"], A, "no stop just before"),
        (["Grip;"], A, "no stop just before"),
        (["again:"], A, "no stop just before"),
        ([], FAR, "joint 6 turns by 175 degrees"),
        ([], OTHER, "another configuration than that of the stop before"),
    ],
)
def test_what_lies_between_two_stops(tmp_path, between, then, reason):
    """A branch in which nothing moves is passed; anything else is not."""
    nominal = arm()
    program = read(tmp_path, nominal, *OFF, *between, f"MoveJ {target(nominal, then)},v1,fine,tool0;", start=HOME)
    (q,), (why,) = joints_of(program)
    if reason:
        assert reason in why
        assert np.isnan(q).all()
    else:
        np.testing.assert_allclose(np.degrees(q), then, rtol=0, atol=1e-4)


def configured(nominal, joints, turn=0):
    """Configuration data by hand: quadrants, and the branch of the closed form."""
    q = np.radians(joints)
    conf = configuration_of(q, int(nearly_closed_form.nearest_form(nominal).configuration(q)))
    return f"{conf.cf1},{conf.cf4},{conf.cf6 + turn},{conf.cfx}"


@pytest.mark.parametrize(
    ("lines", "routines", "expected"),
    [
        (["MOVE"], "", "configured"),
        (["ConfJ\\Off;", "MOVE"], "", "configured"),  # joint moves only
        (["ConfL\\Off;", "MOVE"], "", "next"),
        (["ConfL\\Off;", "ConfL\\On;", "MOVE"], "", "configured"),
        (["ConfL\\Off;", "IF a=1 THEN", "ConfL\\On;", "ENDIF", "MOVE"], "", "both"),
        (["IF a=1 THEN", "ConfL\\Off;", "ENDIF", "MOVE"], "", "both"),
        (["ConfL\\Off;", "IF a=1 THEN", "ConfL\\Off;", "ENDIF", "MOVE"], "", "next"),
        (["MOVE"], "PROC other()\nConfL\\Off;\nENDPROC", "both"),
        (["ConfL\\On;", "MOVE"], "PROC other()\nConfL\\Off;\nENDPROC", "both"),
    ],
)
def test_whether_configurations_count(tmp_path, lines, routines, expected):
    nominal = arm()
    for turn, agree in ((0, True), (1, False)):  # the configuration of the joints, and another one
        move = f"MoveL {target(nominal, A, configured(nominal, A, turn))},v1,fine,tool0;"
        text = [line.replace("MOVE", move) for line in lines]
        program = read(tmp_path, nominal, *text, start=HOME, routines=routines)
        (batch,) = program.wanted_targets()
        assert (batch.unknown[0] == "") == (agree or expected == "next"), batch.unknown
        if not agree and expected != "next":
            assert ("fit no solution" in batch.unknown[0]) == (expected == "configured"), batch.unknown
        if not batch.unknown[0]:
            np.testing.assert_allclose(np.degrees(batch.joints[0]), A, rtol=0, atol=1e-4)


def with_offset(nominal, metres):
    """An arm whose axis 3 stands aside, as in a maker's public URDF: no closed form."""
    d = nominal.table.d.copy()
    d[2] += metres
    return nominal.with_table(replace(nominal.table, d=d))


def test_an_arm_with_a_small_offset_takes_its_configurations_by_iteration(tmp_path):
    nominal = with_offset(arm(), 0.011)
    robot = random_robot(nominal, "16", np.random.default_rng(2), size=0.2)
    rng = np.random.default_rng(3)
    wanted = [[float(v) for v in np.array(HOME) + rng.uniform(-25, 25, 6)] for _ in range(8)]
    wanted += [[q[0], q[1], q[2], q[3] - 180, -q[4], q[5] + 180] for q in wanted]
    moves = [f"MoveL {target(nominal, q, configured(nominal, q))},v1,fine,tool0;" for q in wanted]
    found = filter_program(read(tmp_path, nominal, *moves), CorrectionModel(robot, nominal, "abc"))
    assert found.unchanged_targets == ()
    np.testing.assert_allclose(np.degrees(found.q_before), wanted, rtol=0, atol=1e-4)
    assert_same_poses(robot.poses(found.q), nominal.forward(np.radians(wanted)), 1e-6, 1e-6)
    far = with_offset(arm(), 0.15)
    (_, why) = joints_of(read(tmp_path, far, *[f"MoveL {target(far, A, configured(nominal, A))},v1,fine,tool0;"]))
    assert "no closed form is near" in why[0]
    (q, why) = joints_of(read(tmp_path, far, *OFF, f"MoveL {target(far, A)},v1,fine,tool0;", start=HOME))
    assert why == ("",)
    np.testing.assert_allclose(np.degrees(q), [A], rtol=0, atol=1e-4)


def test_in_a_language_that_may_leave_the_posture_open():
    nominal, _, at = robot_of("rx160")
    q = np.array([0.2, 0.3, 1.2, 0.1, 0.7, 0.4])
    x, y, z, a, b, c = pose_numbers(np.linalg.inv(at.T_base_world) @ nominal.forward(q[None]), "XYZ")[0]
    point = f'x="{x}" y="{y}" z="{z}" rx="{a}" ry="{b}" rz="{c}" shoulder="ssame" elbow="esame" wrist="wsame"'
    data = '<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2"><Datas>'
    data += (
        f'<Data name="p" xsi:type="array" type="pointRx" size="1"><Value key="0" {point} fatherId="world[0]"/></Data>'
    )
    code = "<Programs><Program><Code><![CDATA[begin\n  movel(p,flange,m)\nend]]></Code></Program></Programs>"
    files = [("a.dtx", (data + "</Datas></Database>").encode()), ("a.pgx", code.encode())]
    for start, posture, known in ((None, None, False), (q + 0.1, None, True), (None, q + 0.1, True)):
        setup = ControllerSetup({}, {}, at, start=start, posture=posture)
        (batch,) = val3.parse(nominal, files, setup).wanted_targets()
        assert (batch.unknown[0] == "") == known, batch.unknown
        if known:
            np.testing.assert_allclose(batch.joints[0], q, rtol=0, atol=1e-6)


@pytest.mark.parametrize("option", ["start", "posture"])
@pytest.mark.parametrize("joints", [[1.0] * 5, "home", [0, 0, 0, 0, 0, 90]])
def test_joints_of_a_place_are_six_within_the_limits(demo_calibration, tmp_path, option, joints):
    read(tmp_path, arm(), f"MoveL {target(arm(), A)},v1,fine,tool0;")
    with pytest.raises(OptionError, match=f"{option}: ") as refused:
        irbcal.correct(demo_calibration, tmp_path / "m.mod", **{option: joints})
    assert refused.value.parameter == option
