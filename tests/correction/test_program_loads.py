"""Loads that programs name: each target is corrected for what the robot carries there.

The oracle reads joints of the corrected text by itself, and asks the robot that carries the expected load where it ends.
"""

import re

import numpy as np
import pandas as pd
import pytest
from history_cases import sided_robot
from maker_cases import given, robot_of, well_inside
from rapid_modules import parsed
from support import arm, assert_same_poses, example_robot

import irbcal
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import fanuc, inform, kawasaki, krl, urscript
from irbcal.correction.loads import LoadFlow, combined, load_of
from irbcal.io import controller_model, urdf
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.term_map import TermMap

USUAL, PLACE = 4.0, (0.0, 0.02, 0.1)
ABSENT = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def giving_way(nominal):
    """A robot whose joints give way by 1e-5 rad/(N m)."""
    terms = TermMap(nominal, tuple(Payload(PLACE).terms(nominal)), np.full(6, 1e-5))
    return Robot(nominal, JointMap(terms, payload_kg=USUAL))


def numbers(text):
    return [float(number) for number in re.findall(r"[-+]?\d+\.\d+", text)]


def rapid_case():
    nominal = arm()
    q = well_inside(nominal, 9)
    lines = [f"MoveAbsJ [[{','.join(f'{v:.6f}' for v in np.degrees(row))}],{ABSENT}],v100,fine,grip;" for row in q]
    text = "\n".join(
        [
            "MODULE Job",
            "PERS tooldata grip:=[TRUE,[[10,0,150],[0,0,1,0]],[1.5,[0,0,50],[1,0,0,0],0,0,0]];",
            "PERS loaddata part:=[3,[0,5,20],[1,0,0,0],0,0,0];",
            "PERS loaddata taught:=[3,[0,5,20],[1,0,0,0],0,0,0];",
            *["PROC main()", lines[0], "Pick;", lines[1], "place;", lines[2], "ENDPROC"],
            *["PROC Pick()", lines[3], "GripLoad part;", lines[4], "ENDPROC"],
            *["PROC Place()", lines[5], "! GripLoad part;", "GripLoad load0;", lines[6]],
            "taught.mass:=n;",
            *["GripLoad taught;", lines[7], "GripLoad load0;", "ENDPROC"],
            *["PROC Other()", lines[8], "ENDPROC"],
            "ENDMODULE",
        ]
    )
    empty = 1.5, (0.0, 0.0, 0.05)
    at_part = (np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]]) @ [0.0, 0.005, 0.02]) + [0.01, 0.0, 0.15]
    full = 4.5, tuple((1.5 * np.array(empty[1]) + 3.0 * at_part) / 4.5)
    carried = [empty, full, empty, empty, full, full, empty, None, "usual"]
    module = parsed(text.encode())

    def joints(data):
        rows = re.findall(r"MoveAbsJ \[\[([^\]]*)\]", data.decode())
        return np.radians([[float(v) for v in row.split(",")] for row in rows])

    return nominal, np.eye(4), module, q, carried, joints


def krl_case():
    nominal, _, at = robot_of("kr120r2500pro")
    q = well_inside(nominal, 7)
    moves = ["PTP {" + ",".join(f"A{k} {v:.6f}" for k, v in enumerate(np.degrees(row), 1)) + "}" for row in q]
    src = [
        *[
            "DEF job()",
            "BAS(#TOOL,1)",
            moves[0],
            "BAS(#TOOL,2)",
            moves[1],
            "$LOAD={M 12,CM {X 0,Y 10,Z 30,A 0,B 0,C 0}}",
            moves[2],
        ],
        *["; $LOAD={M 99}", "IF $IN[1] THEN", "BAS(#TOOL,1)", "ENDIF", "BAS(#TOOL,2)", moves[3]],
        *[moves[4] + " WITH $LOAD = LOAD_DATA[3]", moves[5], "$LOAD.M=5", moves[6], "END"],
    ]
    config = [
        "DEFDAT $CONFIG",
        "LOAD_DATA[1]={M -1.0,CM {X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0},J {X 0.0,Y 0.0,Z 0.0}}",
        "LOAD_DATA[2]={M 7.5,CM {X 1.0,Y 2.0,Z 60.0,A 0.0,B 0.0,C 0.0},J {X 0.0,Y 0.0,Z 0.0}}",
        "LOAD_DATA[3]={M 30,CM {X 0.0,Y 0.0,Z 90.0,A 0.0,B 0.0,C 0.0},J {X 0.0,Y 0.0,Z 0.0}}",
        "ENDDAT",
    ]
    tool = 7.5, (0.001, 0.002, 0.06)
    carried = ["usual", tool, (12.0, (0.0, 0.01, 0.03)), tool, (30.0, (0, 0, 0.09)), tool, None]
    files = [("job.src", "\n".join(src).encode()), ("$config.dat", "\n".join(config).encode())]

    def joints(data):
        return np.radians([numbers(row) for row in re.findall(r"PTP \{([^}]*)\}", data.decode())])

    return nominal, at.T_tip_flange, krl.parse(nominal, files, given(at)), q, carried, joints


def fanuc_case(tmp_path):
    nominal, _, at = robot_of("m20ia")
    q = well_inside(nominal, 6)
    pendant = np.degrees(q) - np.outer(np.degrees(q)[:, 1], [0, 0, 1, 0, 0, 0])
    goes = [f"J P[{k}] 50% FINE" for k in range(1, 7)]
    steps = [goes[0], "PAYLOAD[2]", goes[1], "LBL[1]", goes[2], "PAYLOAD[3]", goes[3], "JMP LBL[1]"]
    steps += ["PAYLOAD[2]", "CALL GRIP", goes[4], "PAYLOAD[4]", goes[5]]
    text = ["/PROG JOB", "/MN", *(f"{k:4d}:  {s} ;" for k, s in enumerate(steps, 1)), "/POS"]
    for k, row in enumerate(pendant, 1):
        fields = ",\t".join(f"J{j}= {v:.3f} deg" for j, v in enumerate(row, 1))
        text += [f"P[{k}]{{", "   GP1:", "\tUF : 0, UT : 1,", f"\t{fields}", "};"]
    grip = ["/PROG GRIP", "/MN", "   1:  !PAYLOAD[9] ;", "   2:  PAYLOAD[3] ;", "/POS", "/END", ""]
    tmp_path.mkdir(exist_ok=True)
    (tmp_path / "JOB.LS").write_text("\n".join([*text, "/END", ""]))
    (tmp_path / "GRIP.LS").write_text("\n".join(grip))
    field = "     Field: $PLST_GRP1[{}].${} Access: RW: {} = {}\n"
    backup = "[*SYSTEM*]$PLST_GRP1  Storage: SHADOW  Access: RW  : ARRAY[10] OF PLST_GRP_T\n"
    for n, mass, z, comment in (
        (2, "1.100000e+01", "1.5e+01", "'EOAT'"),
        (3, "16.0", "20", "'PART'"),
        (4, "100", "0", "''"),
    ):
        backup += field.format(n, "COMMENT", "STRING[16]", comment) + field.format(n, "PAYLOAD", "REAL", mass)
        for axis, value in zip("XYZ", ("0", "-2.5", z), strict=True):
            backup += field.format(n, f"PAYLOAD_{axis}", "REAL", value if comment != "''" else "0")
    (tmp_path / "SYMOTN.VA").write_text(backup)
    program = fanuc.read_for(nominal, [tmp_path / "JOB.LS", tmp_path / "GRIP.LS"], given(at))[0]
    tool, part = (11.0, (0.0, -0.025, 0.15)), (16.0, (0.0, -0.025, 0.2))
    mean = 13.5, tuple((11.0 * np.array(tool[1]) + 16.0 * np.array(part[1])) / 27.0)
    carried = ["usual", tool, mean, part, part, None]

    def joints(data):
        rows = np.array([numbers(row) for row in re.findall(r"UT : 1,\s*([^}]*)\}", data.decode())])
        return np.radians(rows + np.outer(rows[:, 1], [0, 0, 1, 0, 0, 0]))

    return nominal, at.T_tip_flange, program, q, carried, joints


def urscript_case():
    path = example_robot("ur_description/urdf/ur10_robot.urdf")
    nominal = urdf.read(path).arm
    at = controller_model.controller_frames(path.read_bytes(), str(path), nominal.base_link, nominal.tip_link)
    low, high = np.radians([-170, -130, 40, -100, 40, -170]), np.radians([170, -50, 110, -20, 130, 170])
    q = np.random.default_rng(3).uniform(low, high, (6, 6))
    moves = [f"  movej([{','.join(f'{v:.9f}' for v in row)}], a=1, v=1)" for row in q]
    text = ["def job():", "  def grip():", "    set_payload(3.2, [0.0, 0.01, 0.05])", "  end", moves[0]]
    text += ["  set_target_payload(1.2, [0, 0, 0.04], [0, 0, 0, 0, 0, 0])", moves[1], "  grip()", moves[2]]
    text += ["  # set_payload(9)", "  set_payload(1.5)", moves[3], "  set_payload(mass)", moves[4]]
    text += ["  if a:", "    set_payload_mass(2)", "  else:", "    set_payload(2)", "  end", moves[5], "end", ""]
    usual_place = 1.5, None
    carried = ["usual", (1.2, (0, 0, 0.04)), (3.2, (0, 0.01, 0.05)), usual_place, None, None]

    def joints(data):
        return np.array([numbers(row) for row in re.findall(r"movej\(\[([^\]]*)\]", data.decode())])

    program = urscript.parse(nominal, "\n".join(text).encode(), "job.script", given(at))
    return nominal, at.T_tip_flange, program, q, carried, joints


def kawasaki_case():
    nominal, _, at = robot_of("rs007n")
    q = well_inside(nominal, 5)
    points = [f"#p{k} {' '.join(f'{v:.6f}' for v in np.degrees(row))}" for k, row in enumerate(q)]
    text = [".PROGRAM job()", "  JMOVE #p0", "  WEIGHT 5,0,0,60", "  JMOVE #p1", "  CALL grip", "  JMOVE #p2"]
    text += ["  WEIGHT mass", "  JMOVE #p3", "  CALL elsewhere", "  JMOVE #p4", ".END"]
    text += [".PROGRAM grip()", "  WEIGHT 6.5", ".END", ".JOINTS", *points, ".END", ""]
    carried = ["usual", (5.0, None), (6.5, None), None, None]

    def joints(data):
        return np.radians([numbers(row.split(" ", 1)[1]) for row in re.findall(r"(?m)^#p.*$", data.decode())])

    program = kawasaki.parse(nominal, [("job.as", "\n".join(text).encode())], given(at))
    return nominal, at.T_tip_flange, program, q, carried, joints


def inform_case(tmp_path):
    nominal, _, at = robot_of("gp8")
    pulses = np.array([1341.4, 1341.4, 1341.4, 1000.0, 1000.0, 622.0])
    q = np.rint(np.degrees(well_inside(nominal, 3)) * pulses) / pulses
    rows = [f"C{k:05d}={','.join(f'{v:.0f}' for v in row)}" for k, row in enumerate(q * pulses)]
    text = ["/JOB", "//NAME J", "//POS", "///NPOS 3,0,0,0,0,0", "///TOOL 0", "///POSTYPE PULSE", "///PULSE", rows[0]]
    text += ["///TOOL 1", rows[1], "///TOOL 2", rows[2], "//INST", "///DATE 2020/01/01 00:00", "///ATTR SC,RW"]
    text += ["///GROUP1 RB1", "NOP", *(f"MOVJ C{k:05d} VJ=10.00" for k in range(3)), "END", ""]
    tools = [(0, "-4.000,0.000,118.000\n2.480"), (1, "0.000,0.000,0.000\n0.000"), (2, "0.000,1.000,60.000\n6.000")]
    lines = [
        f"//TOOL {n}\n///NAME T\n0.000,0.000,1.000,0.0000,0.0000,0.0000\n{load}\n0.000,0.000,0.000" for n, load in tools
    ]
    (tmp_path / "TOOL.CND").write_text("\n".join([*lines, ""]))
    (tmp_path / "J.JBI").write_text("\n".join(text))
    setup = given(at)._replace(pulses=tuple(pulses))
    carried = [(2.48, (-0.004, 0, 0.118)), "usual", (6.0, (0, 0.001, 0.06))]

    def joints(data):
        found = re.findall(r"(?m)^C\d+=(.*)$", data.decode())
        return np.radians(np.array([[float(v) for v in row.split(",")] for row in found]) / pulses)

    program = inform.read_for(nominal, [tmp_path / "J.JBI"], setup)[0]
    return nominal, at.T_tip_flange, program, np.radians(q), carried, joints


CASES = {
    "rapid": (lambda _: rapid_case(), 1e-6),
    "krl": (lambda _: krl_case(), 1e-6),
    "fanuc": (fanuc_case, 1e-3),
    "urscript": (lambda _: urscript_case(), 1e-6),
    "kawasaki": (lambda _: kawasaki_case(), 1e-6),
    "inform": (inform_case, 1e-3),
}


@pytest.mark.parametrize("language", CASES)
def test_each_target_is_corrected_for_the_load_that_holds_there(language, tmp_path):
    make, degrees = CASES[language]
    nominal, T_tip_flange, program, q, carried, joints = make(tmp_path)
    robot = giving_way(nominal)
    filtered = filter_program(program, CorrectionModel(robot, nominal, "abc", follow_loads=True))
    written = joints(b"".join(filtered.files.values()))
    assert len(written) == len(q)
    uncorrected = np.abs(written - q).max(axis=1) < np.radians(degrees)
    assert uncorrected.tolist() == [load is None for load in carried]
    assert len(filtered.unchanged_targets) == uncorrected.sum()
    tolerance = np.radians(degrees) * 4
    for k, load in enumerate(carried):
        if load is None:
            continue
        mass, centre = (USUAL, PLACE) if load == "usual" else load
        at = PLACE if centre is None or load == "usual" else T_tip_flange[:3, :3] @ centre + T_tip_flange[:3, 3]
        ends = robot.carrying(mass, at).forward(written[k : k + 1])
        assert_same_poses(ends, nominal.forward(q[k : k + 1]), tolerance * 3, tolerance)
        other = robot.carrying(mass + 30.0, at).forward(written[k : k + 1])
        assert np.linalg.norm(other[0, :3, 3] - ends[0, :3, 3]) > 4 * tolerance, "the load matters here"
    assert [note for note in filtered.notes if "what the program says that the robot carries" in note.text]


@pytest.mark.parametrize("language", CASES)
def test_with_a_payload_for_all_the_program_is_only_noted(language, tmp_path):
    nominal, _, program, q, _, joints = CASES[language][0](tmp_path)
    robot = giving_way(nominal).carrying(9.0)
    filtered = filter_program(program, CorrectionModel(robot, nominal, "abc"))
    assert not filtered.unchanged_targets
    tolerance = np.radians(CASES[language][1]) * 4
    assert_same_poses(
        robot.forward(joints(b"".join(filtered.files.values()))), nominal.forward(q), 3 * tolerance, tolerance
    )
    assert [note for note in filtered.notes if "all targets are corrected for 9 kg" in note.text]
    stiff = filter_program(program, CorrectionModel(Robot(nominal), nominal, "abc", follow_loads=True))
    assert not [note for note in stiff.notes if "kg" in note.text], "nothing is known of loads"


def test_a_target_that_is_reached_with_two_loads_takes_the_mean_and_says_so():
    nominal = arm()
    (row,) = well_inside(nominal, 1)
    target = f"[[{','.join(f'{v:.6f}' for v in np.degrees(row))}],{ABSENT}]"
    move = "MoveAbsJ above,v100,fine,tool0;"
    body = ["PROC main()", move, "GripLoad [6,[0,0,50],[1,0,0,0],0,0,0];", move, "ENDPROC"]
    text = "\n".join(["MODULE Job", f"CONST jointtarget above:={target};", *body, "ENDMODULE"])
    robot = giving_way(nominal)
    filtered = filter_program(parsed(text.encode()), CorrectionModel(robot, nominal, "abc", follow_loads=True))
    (written,) = np.radians([numbers(re.findall(r"above:=\[\[([^\]]*)", filtered.data.decode())[0])])
    wanted = nominal.forward(row[None])[0, :3, 3]
    assert_same_poses(robot.carrying(3.0, [0, 0, 0.05]).forward([written]), nominal.forward(row[None]), 1e-7, 1e-7)
    off = [np.linalg.norm(robot.carrying(m, [0, 0, 0.05]).forward([written])[0, :3, 3] - wanted) for m in (0.0, 6.0)]
    (note,) = [note.text for note in filtered.notes if "is reached with" in note.text]
    assert note.startswith("above is reached with 0 and 6 kg")
    assert f"off by up to {1e3 * max(off):.3f} mm" in note


def test_loads_are_followed_through_loops_and_calls():
    """Against all ways through a program, walked by hand."""
    empty, part = load_of(1.0), load_of(2.0)
    flow = LoadFlow()
    flow.begin("main")
    before = flow.now
    flow.open(loop=True)
    in_loop = flow.now
    flow.take(part)
    flow.open()
    flow.take(empty)
    flow.alternative()
    other = flow.now
    flow.close()
    behind_branch = flow.now
    flow.close()
    behind = flow.now
    flow.call("put", True)
    put = flow.now
    flow.call("elsewhere", True, "elsewhere may set it")
    lost = flow.now
    flow.end()
    flow.begin("put")
    in_put = flow.now
    flow.take(empty)
    flow.returns()
    flow.take(part)
    flow.end()
    assert flow.loads(before) == (None,)
    assert set(flow.loads(in_loop)) == {None, empty, part}
    assert flow.loads(other) == (part,)
    assert set(flow.loads(behind_branch)) == {empty, part}
    assert set(flow.loads(behind)) == {None, empty, part}
    assert set(flow.loads(put)) == {empty, part}
    assert [load.reason for load in flow.loads(lost)] == ["elsewhere may set it"]
    assert set(flow.loads(in_put)) == {None, empty, part}


def test_two_loads_as_one():
    assert combined([load_of(1.0, [0, 0, 1]), load_of(3.0, [0, 0, 0])]) == (4.0, (0.0, 0.0, 0.25), "")
    assert combined([load_of(0.0), load_of(3.0, [1, 0, 0])]) == (3.0, (1.0, 0.0, 0.0), "")
    assert combined([load_of(1.0), load_of(3.0, [1, 0, 0])]).centre is None
    for mass, centre in ((-1.0, [0, 0, 0]), (np.nan, [0, 0, 0]), (1e9, [0, 0, 0]), (1.0, [0, 0, 1e3])):
        assert load_of(mass, centre).reason


def test_loads_and_last_moves_together():
    """Each stop with its load and the command before it ends where the nominal robot would."""
    sided = sided_robot("irb1600", size=1.0, others=("payload",))
    robot, nominal = sided.replace(arm=arm()), arm()
    (masses, q) = (0.0, 0.0, 20.0, 20.0, 40.0), well_inside(nominal, 5)
    goes = [f"MoveAbsJ [[{','.join(f'{v:.6f}' for v in np.degrees(row))}],{ABSENT}],v100,fine,tool0;" for row in q]
    grip = {2: 20, 4: 40}
    lines = [
        text
        for k, move in enumerate(goes)
        for text in ([f"GripLoad [{grip[k]},[0,0,50],[1,0,0,0],0,0,0];"] if k in grip else []) + [move]
    ]
    text = "\n".join(["MODULE Job", "PROC main()", *lines, "ENDPROC", "ENDMODULE"])
    filtered = filter_program(parsed(text.encode()), CorrectionModel(robot, nominal, "abc", follow_loads=True))
    rows = re.findall(r"MoveAbsJ \[\[([^\]]*)\]", filtered.data.decode())
    written = np.radians([[float(v) for v in row.split(",")] for row in rows])
    before = np.vstack([np.full((1, 6), np.nan), written[:-1]])
    wanted = nominal.forward(q)
    for k, mass in enumerate(masses):
        at = (0, 0, 0.05) if mass else robot.joint_map.payload_centre
        loaded, stop = robot.carrying(mass, at), slice(k, k + 1)
        assert_same_poses(loaded.forward(written[stop], before[stop]), wanted[stop], 3e-7, 1e-7)
        if mass:
            other = robot.carrying(0.0).forward(written[stop], before[stop])
            assert np.linalg.norm((other - wanted[stop])[0, :3, 3]) > 1e-5, "the load matters here"


def test_a_total_load_of_a_move_is_not_guessed_and_shifts_are_told_with_their_load():
    nominal = arm()
    (row,) = well_inside(nominal, 1)
    T = nominal.forward(row[None])[0]
    w, x, y, z = frames.quaternion_from_matrix(T[:3, :3])
    quadrants = np.floor(row[[0, 3, 5]] / (np.pi / 2)).astype(int)
    cfx = int(closed_form.configuration(nominal, row[None])[0])
    xyz = ",".join(f"{v:.6f}" for v in 1e3 * T[:3, 3])
    conf = ",".join(map(str, [*quadrants, cfx]))
    point = f"[[{xyz}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}],[{conf}],{ABSENT}]"
    body = ["PROC main()", "GripLoad [30,[0,0,50],[1,0,0,0],0,0,0];", "MoveL p,v1,fine,tool0;"]
    body += ["MoveL Offs(p,0,0,40),v1,fine,tool0;", f"MoveL {point},v1\\TLoad:=heavy,fine,tool0;", "ENDPROC"]
    text = "\n".join(["MODULE Job", f"CONST robtarget p:={point};", *body, "ENDMODULE"])
    robot = giving_way(nominal)
    filtered = filter_program(parsed(text.encode()), CorrectionModel(robot, nominal, "abc", follow_loads=True))
    (left,) = filtered.unchanged_targets
    assert left.reason.startswith("\\TLoad:=heavy says the load of the move alone: say with --payload")
    (note,) = [note.text for note in filtered.notes if "shifted target" in note.text]
    off = float(re.search(r"off by ([\d.]+) mm", note)[1])
    alone = robot.carrying(30.0, [0, 0, 0.05])
    (with_payload,) = [
        float(re.search(r"off by ([\d.]+) mm", note.text)[1])
        for note in filter_program(parsed(text.encode()), CorrectionModel(alone, nominal, "abc")).notes
        if "shifted target" in note.text
    ]
    assert off == with_payload > 0


def test_each_segment_equals_a_call_with_its_payload(tmp_path):
    """From SIMULATED measurements with two loads to the corrected job."""
    tables = [irbcal.simulate("irb1600", random=40, seed=k, payload=6.0 * k).to_frame() for k in (0, 1)]
    both = pd.concat([table.assign(pose=[f"{k}-{pose}" for pose in table["pose"]]) for k, table in enumerate(tables)])
    irbcal.save(irbcal.calibrate(both, "irb1600", "auto", same_tool=True), tmp_path / "two-loads")
    q = np.degrees(well_inside(arm(), 4))
    goes = [f"MoveAbsJ [[{','.join(f'{v:.4f}' for v in row)}],{ABSENT}],v100,fine,grip;" for row in q]
    tool = "PERS tooldata grip:=[TRUE,[[0,0,100],[1,0,0,0]],[2,[0,0,60],[1,0,0,0],0,0,0]];"
    grip = "GripLoad [7,[0,0,30],[1,0,0,0],0,0,0];"
    lines = ["MODULE Job", tool, "PROC main()", *goes[:2], grip, *goes[2:], "ENDPROC", "ENDMODULE"]
    (tmp_path / "job.mod").write_text("\n".join(lines))

    def written(**load):
        data = irbcal.correct(tmp_path / "two-loads", tmp_path / "job.mod", **load).data.decode()
        return re.findall(r"MoveAbsJ \[\[([^\]]*)\]", data)

    followed = written()
    empty = written(payload=2.0, payload_centre=[0, 0, 0.06])
    full = written(payload=9.0, payload_centre=[0, 0, (2 * 0.06 + 7 * 0.13) / 9])
    assert followed == [*empty[:2], *full[2:]]
    assert all(a != b for a, b in zip(empty, full, strict=True)), "the load matters here"
