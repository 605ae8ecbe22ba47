"""Calls of routines: what is known behind them of tool, frame and the place of the arm."""

import numpy as np
import pytest
from maker_cases import given, robot_of, universal_robot
from support import arm

from irbcal.correction.calls import CallEffect, Calls
from irbcal.correction.languages import kawasaki, krl, rapid, urscript
from irbcal.correction.program import ControllerSetup
from irbcal.io.controller_model import unknown_frames


def test_a_routine_does_what_its_lines_and_those_it_calls_do():
    calls = Calls(["Grip*", "plc"], {"wait"})
    calls.learn("job", ["wait", "sub", "gripopen"])
    calls.learn("sub", ["job", "deep"])  # in a circle
    calls.learn("deep", moves=True, sets_loads=True)
    calls.learn("frames", ["plc"], sets_frames=True)
    calls.learn("wait_long", ["wait"])
    effects = {name: calls.effect(name) for name in ("job", "frames", "wait_long", "wait", "griptight", "other")}
    assert effects == {
        "job": CallEffect(False, True, True),
        "frames": CallEffect(True, False, False),
        "wait_long": CallEffect(False, False, False),
        "wait": CallEffect(False, False, False),
        "griptight": CallEffect(False, False, False),
        "other": CallEffect(True, True, True),
    }
    calls.learn("wait", sets_frames=True)
    assert calls.effect("wait_long") == (True, False, False), (
        "a routine of the program's own goes before a built-in one"
    )


POSE = "{X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224}"
POINT = POSE[:-1] + ",S 2,T 2}"
SPLINE = (
    "$VEL_AXIS[1] = SVEL_JOINT(100.0), $TOOL = STOOL2(FP1), $BASE = SBASE(FP1.BASE_NO), $IPO_MODE = "
    "SIPO_MODE(FP1.IPO_FRAME), $LOAD = SLOAD(FP1.TOOL_NO), $ACC_AXIS[1] = SACC_JOINT(PPDAT1), $APO = SAPO_PTP(PPDAT1)"
)
FOLD = (
    ";FOLD ARCON WDAT1 LIN P1 Vel=0.5 m/s CPDAT1 Tool[1]:torch Base[2]:part ;%{PE}\n;FOLD Parameters ;%{h}\n;ENDFOLD\n"
)
TAKES = "FDAT_ACT = FP1\nBAS(#CP_PARAMS, 0.5)\n"
AXES = "PTP {A1 10,A2 -80,A3 90,A4 10,A5 20,A6 0}\n"


def krl_program(body, data="IPO_FRAME #BASE", ignored_calls=(), more=""):
    nominal, _, at = robot_of("kr120r2500pro")
    setup = given(at, tools={"1": np.eye(4)}, work_objects={"2": np.eye(4)})._replace(ignored_calls=ignored_calls)
    dat = f'DEFDAT job\nDECL E6POS XP1={POINT}\nDECL FDAT FP1={{TOOL_NO 1,BASE_NO 2,{data},POINT2[] " "}}\nENDDAT\n'
    src = f"DEF job()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n{body}END\n{more}"
    return krl.parse(nominal, [("job.src", src.encode()), ("job.dat", dat.encode())], setup)


@pytest.mark.parametrize(
    ("body", "corrected"),
    [
        (f"Gripper(1)\nLIN {POINT}\n", False),
        (f"GripOpen()\nLIN {POINT}\n", True),
        (f"{AXES}GripOpen()\nLIN {POSE}\n", True),
        (f"{AXES}plc_signal(3)\nLIN {POSE}\n", False),
        (f"IF Gripper(1) THEN\nLIN {POINT}\nENDIF\n", False),
        (f"n = Gripper(1)\nLIN {POINT}\n", False),
        (f'n = ABS(3) + SQRT(4)\nMsgNotify("x")\nLIN {POINT}\n', True),
        (f"WHILE (NOT ($IN[1] OR (n > 2)))\nWAIT FOR ($IN[2])\nWAIT SEC (1)\nENDWHILE\nLIN {POINT}\n", True),
        (f"closed()\nLIN {POINT}\n", True),
        (f"{AXES}closed()\nLIN {POSE}\n", True),
        (f"{AXES}moved()\nLIN {POINT}\n", True),
        (f"{AXES}moved()\nLIN {POSE}\n", False),
        (f"deep()\nLIN {POINT}\n", False),
        (f"set()\nLIN {POINT}\n", False),
    ],
)
def test_krl_behind_a_call(body, corrected):
    more = (
        "DEF closed()\n$OUT[1]=TRUE\nBAS(#VEL_CP,1)\nGripTight()\nEND\nGLOBAL DEF moved()\nPTP {A1 10}\nEND\n"
        "DEF deep()\nclosed()\nset()\nEND\nDEF set()\nBAS(#TOOL,2)\nEND\n"
    )
    seen = krl_program(body, ignored_calls=("GRIP?*n", "Grip*t"), more=more)
    (literal,) = [target for target in seen.targets if target.kind == "pose" and target.name.startswith("LIN in")]
    _, *unknown = seen.wanted_targets() or [None]
    reasons = [reason for batch in seen.wanted_targets() for reason in batch.unknown if reason]
    assert (literal.correctable and not reasons) == corrected, (literal.reason, reasons, unknown)


def test_the_reason_says_how_a_call_is_ignored():
    (left,) = [left for left in krl_program(f"Gripper(1)\nLIN {POINT}\n").unchanged_targets() if "call" in left.reason]
    assert left.reason.endswith("or say --ignored-calls Gripper if it neither does that nor moves the robot")


@pytest.mark.parametrize(
    ("body", "data", "why"),
    [
        (f"PLC(1)\nSPTP XP1 WITH {SPLINE} C_SPL\n", "IPO_FRAME #BASE", ""),
        (f"SPTP XP1 WITH {SPLINE}\n", "IPO_FRAME #TCP", "the part on the robot"),
        (
            f"PLC(1)\n{FOLD}{TAKES}ArcMainNG(#ArcOnBeforeMoveStd, WDAT1, WP1)\nLIN XP1\n;ENDFOLD\n",
            "IPO_FRAME #BASE",
            "",
        ),
        (f"{FOLD}FDAT_ACT = FP1\nArcMainNG(1)\nLIN XP1\n;ENDFOLD\n", "IPO_FRAME #BASE", "ArcMainNG, called in"),
        (f"{TAKES}{FOLD}ArcMainNG(1)\nLIN XP1\n;ENDFOLD\n", "IPO_FRAME #BASE", "ArcMainNG, called in"),
        (f"{TAKES}ArcMainNG(1)\nLIN XP1\n", "IPO_FRAME #BASE", "ArcMainNG, called in"),
        (f"{FOLD}{TAKES}ArcMainNG(1)\n;ENDFOLD\nLIN XP1\n", "IPO_FRAME #BASE", "ArcMainNG, called in"),
        (
            f"{FOLD}{TAKES}ArcMainNG(1)\nLIN XP1\nArcMainNG(2)\n;ENDFOLD\nLIN XP1\n",
            "IPO_FRAME #BASE",
            "ArcMainNG, called",
        ),
        (f";FOLD mine\n{TAKES}ArcMainNG(1)\nLIN XP1\n;ENDFOLD\n", "IPO_FRAME #BASE", "ArcMainNG, called in"),
    ],
)
def test_an_inline_form_keeps_its_tool_and_base_until_it_ends(body, data, why):
    seen = krl_program(body, data)
    (point,) = [target for target in seen.targets if target.name.startswith("XP1")]
    assert (why in point.reason) if why else point.correctable, point.reason
    assert {(use.tool, use.work_object) for use in point.uses} >= ({("1", "2")} if not why else set())


@pytest.mark.parametrize(
    ("call", "known"), [("CALL open_it", False), ("CALL grip.open", True), ("CALL inside", True), ("GOSUB 100", False)]
)
def test_kawasaki_behind_a_call(call, known):
    nominal, _, at = robot_of("rs007n")
    text = (
        f".PROGRAM job()\nTOOL NULL\nBASE NULL\nJMOVE #p\n{call}\nLMOVE a\n.END\n.PROGRAM inside()\nSIGNAL 3\n.END\n"
        ".JOINTS\n#p 20 30 -80 15 60 10\n.END\n.TRANS\na 218 546 234 53 52 -62\n.END\n"
    )
    setup = given(at)._replace(ignored_calls=("Grip.*",))
    (target,) = [t for t in kawasaki.parse(nominal, [("job.as", text.encode())], setup).targets if t.kind == "pose"]
    assert (target.uses[0].tool == "null") == known
    assert (target.previous == [None]) != known


def test_functions_that_are_not_in_a_script_are_the_controllers_own():
    nominal, _, at = universal_robot()
    lines = [
        *("def job():", "  def grip(on):", "    set_digital_out(1, on)", "    sleep(0.1)", "  end"),
        *("  def frame():", "    set_tcp(p[0,0,0.1,0,0,0])", "  end", "  set_tcp(p[0,0,0.2,0,0,0])"),
        *("  movej([0,-1.2,1.3,-1.5,-1.5,0.1])", "  set_standard_digital_out(1, True)", "  n = grip(True)"),
        *(
            "  movel(p[0.5,0.1,0.4,3.1,0.1,0])",
            "  if frame():",
            "    sleep(1)",
            "  end",
            "  movel(p[0.5,0.2,0.4,3.1,0.1,0])",
        ),
        *("  force_mode(p[0,0,0,0,0,0])", "  movel(p[0.5,0.3,0.4,3.1,0.1,0])", "end", ""),
    ]
    seen = urscript.parse(nominal, "\n".join(lines).encode(), "job.script", given(at))
    first, second, third = [target for target in seen.targets if target.kind == "pose" and target.uses]
    assert first.correctable
    assert first.previous != [None]
    assert "frame, called in line 14, may set the TCP" in second.reason
    assert third.previous == [None]


@pytest.mark.parametrize(
    ("call", "ignored_calls", "known"),
    [("GripOpen;", (), False), ("GripOpen;", ("grip*",), True), ("inside 3;", (), True), ("moves;", (), False)],
)
def test_rapid_follows_the_joints_over_ignored_calls(tmp_path, call, ignored_calls, known):
    pose = "[[1000,100,900],[0.6,0.3,0.7,0.24],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]".replace("0.24", "0.244948974")
    joints = "[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    text = (
        f"MODULE M\nPROC main()\nConfL\\Off;\nMoveAbsJ {joints},v100,fine,tool0;\n{call}\n"
        f"MoveL {pose},v100,fine,tool0;\nENDPROC\nPROC inside(num n)\nSetDO d,n;\nlabel:\ndeep;\nENDPROC\n"
        f"PROC deep()\nWaitTime 1;\nENDPROC\nPROC moves()\ndeep;\nMoveAbsJ {joints},v100,fine,tool0;\nENDPROC\nENDMODULE\n"
    )
    (tmp_path / "M.mod").write_text(text)
    setup = ControllerSetup({}, {}, unknown_frames(), ignored_calls=ignored_calls)
    (seen,) = rapid.read_for(arm(), [tmp_path / "M.mod"], setup)
    (pose_target,) = [target for target in seen.targets if target.kind == "pose"]
    assert (pose_target.previous != [None]) == known


BEGINS = {  # statements of the program that calls, and what is known of tool and frame in the one that is called
    ("TOOL tcp", "BASE jig", "CALL pick"): ("tcp", "jig"),
    ("TOOL tcp", "BASE jig", "CALL pick", "TOOL tcp", "CALL pick"): ("tcp", "jig"),
    ("CALL between",): ("tcp", "jig"),
    ("CALL pick",): ("active", "active"),
    (): ("active", "active"),
    ("TOOL tcp", "BASE jig", "CALL pick", "TOOL NULL", "CALL pick"): None,
    ("TOOL tcp", "BASE jig", "CALL pick", "CALL between", "BASE NULL", "CALL between"): ("tcp", "jig"),
    ("TOOL tcp", "BASE jig", "CALL pick", "ON 1001 CALL pick"): None,
}


@pytest.mark.parametrize("statements", BEGINS)
def test_a_routine_begins_with_the_tool_and_frame_of_its_calls(statements):
    nominal, _, at = robot_of("rs007n")
    between = ".PROGRAM between()\nTOOL tcp\nBASE jig\nCALL pick\n.END\n"
    pick = ".PROGRAM pick()\nJMOVE #h\nLMOVE p\n.END\n"
    values = ".TRANS\ntcp 0 0 100 0 0 0\njig 0 0 10 0 0 0\np 400 50 300 10 120 20\n.END\n.JOINTS\n#h 10 20 -60 10 50 5\n.END\n"
    main = "\n".join([".PROGRAM main()", *statements, ".END", ""])
    text = main + (between if "CALL between" in statements else "") + pick + values
    where = (np.zeros(6), np.eye(4))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kawasaki, "ends", lambda *_: at)
        program = kawasaki.parse(nominal, [("job.as", text.encode())], given(at)._replace(where=where))
    point = next(target for target in program.targets if target.name == "p")
    expected = BEGINS[statements]
    if expected is None:
        assert any("is called with different or computed" in reason for reason in point.conflicts)
    else:
        assert [(use.tool, use.work_object) for use in point.uses] == [expected]


@pytest.mark.parametrize(
    ("event", "known"), [("", True), ("INTERRUPT DECL 3 WHEN $IN[1] DO sub()\n", False), ("$IPO_MODE=#TCP\n", False)]
)
def test_a_krl_routine_begins_with_the_tool_and_base_of_its_calls(event, known):
    program = krl_program(f"{event}{AXES}sub()\n", more=f"DEF sub()\nLIN {POINT}\nEND\n")
    (target,) = (target for target in program.targets if target.kind == "pose" and target.uses)
    assert bool(target.conflicts) is not known
    assert [(use.tool, use.work_object) for use in target.uses] == [("1", "2") if known else (None, None)]
