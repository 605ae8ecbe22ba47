"""Programs in the styles in which controllers hold and generators write them: how many of their targets are corrected.

The joints from which the poses were made are the oracle: what is corrected leads there, in every program.
"""

from dataclasses import dataclass, field

import numpy as np
import pytest
from maker_cases import language_tests, pose_numbers, robot_of
from scipy.spatial.transform import Rotation
from support import arm, assert_same_poses, random_robot

from irbcal.correction import languages
from irbcal.correction.filter import filter_program
from irbcal.correction.filtered import together
from irbcal.correction.program import ControllerSetup
from irbcal.io.controller_model import unknown_frames

EXT = "[9E9,9E9,9E9,9E9,9E9,9E9]"
TOOL = [120.0, 0.0, 85.5, 0.0, 30.0, 0.0]
"""x, y, z in mm and angles about z, y, x, degrees."""


@dataclass
class Job:
    """Files, options, joints (degrees) by the numbers of poses that were made from them, and all literal targets."""

    language: str
    robot: str
    files: dict
    truth: np.ndarray
    literals: int
    options: dict = field(default_factory=dict)


def path(n, seed=0):
    """Joints along a smooth path, degrees."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.5, 1.5, 6), rng.uniform(0, 6, 6)
    s = np.linspace(0, 4, n)[:, None]
    return np.array([10, -15, 25, 15, 45, 30]) + np.sin(a * s + b) * [25, 12, 12, 20, 15, 40]


def tool():
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("ZYX", TOOL[3:], degrees=True).as_matrix(), np.array(TOOL[:3]) / 1e3
    return T


def abb(T):
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    return f"[{','.join(f'{1e3 * v:.5f}' for v in T[:3, 3])}],[{w:.8f},{x:.8f},{y:.8f},{z:.8f}]"


def tooldata(name):
    return f"PERS tooldata {name}:=[TRUE,[{abb(tool())}],[1,[0,0,1],[1,0,0,0],0,0,0]];"


def abb_poses(q):
    return [abb(T @ tool()) for T in arm().forward(np.radians(q))]


def absolute(q):
    return f"MoveAbsJ [[{','.join(f'{v:.6f}' for v in q)}],{EXT}]\\NoEOffs,v100,fine,tGrip;"


def generated():
    """Configuration off, one configuration for all targets, branches without moves between them."""
    q = path(40)
    lines = ["MODULE MainModule", tooldata("tGrip"), "PROC Main()", "ConfL \\Off;", "ConfJ \\Off;"]
    for k, pose in enumerate(abb_poses(q)):
        lines.append(f"Move{'J' if k % 7 == 0 else 'L'} [{pose},[0,-1,-1,0],{EXT}],v100,z1,tGrip\\WObj:=WObj0;")
        if k % 5 == 2:
            lines += ["IF TestDI(ready) THEN", "WaitDI ready,0;", "ENDIF", "SetDO grip,1;", "WaitTime 0.9;"]
    text = "\n".join([*lines, "ENDPROC", "ENDMODULE", ""])
    start = np.radians(q[0] + 5)
    return Job("rapid", "irb1600", {"main.prg": text}, q, len(q), {"start": start})


def configured(q):
    confs = np.floor(np.array(q)[:, [0, 3, 5]] / 90).astype(int)
    return [f"[{a},{b},{c},0]" for a, b, c in confs]


def taught():
    """A backup: tools in one module, points with approaches by offset in another, a module that is encoded."""
    q = path(24, 1)
    lines = ["MODULE Job"]
    lines += [
        f"CONST robtarget p{k}:=[{p},{c},{EXT}];"
        for k, (p, c) in enumerate(zip(abb_poses(q), configured(q), strict=True))
    ]
    lines += [
        "VAR robtarget never{2}:=[[[0,0,0],[0,0,0,0],[0,0,0,0]," + EXT + "],[[0,0,0],[0,0,0,0],[0,0,0,0]," + EXT + "]];"
    ]
    lines += [
        "PROC pick()",
        *(f"MoveJ Offs(p{k},0,0,50),v500,z10,tGrip;\nMoveL p{k},v50,fine,tGrip;" for k in range(24)),
    ]
    job = "\n".join([*lines, "ENDPROC", "ENDMODULE", ""])
    files = {
        "RAPID/TASK1/PROGMOD/Job.mod": job,
        "RAPID/TASK1/SYSMOD/Tools.sys": f"MODULE Tools\n{tooldata('tGrip')}\nENDMODULE\n",
    }
    files["RAPID/TASK1/SYSMOD/hidden.sys"] = "\x00\x01 encoded"
    files["RAPID/TASK1/PROGMOD/cut.mod"] = "MODULE Cut\nPROC a()\n"
    return Job("rapid", "irb1600", files, q, 24)


def process():
    """Spot and arc welding beside moves; one routine that nobody knows."""
    q = path(20, 2)
    names = [
        "MoveJ {},v500,z10,tGrip",
        "SpotL {},vmax,spot1,gun1,tGrip",
        "ArcLStart {},v100,sm1,wd1,fine,tGrip",
        "ArcL {},v100,sm1,wd1\\Weave:=wv1,z1,tGrip",
    ]
    lines = ["MODULE Weld", tooldata("tGrip"), "PROC Main()"]
    for k, (p, c) in enumerate(zip(abb_poses(q), configured(q), strict=True)):
        name = "OurNut {},gun1,tGrip" if k == 19 else names[k % 4]
        lines.append(name.format(f"[{p},{c},{EXT}]") + ";")
    return Job("rapid", "irb1600", {"Weld.mod": "\n".join([*lines, "ENDPROC", "ENDMODULE", ""])}, q[:19], 20)


def kuka_poses(q):
    nominal = robot_of("kr120r2500pro")[0]
    rows = pose_numbers(nominal.forward(np.radians(q)) @ tool(), "ZYX")
    return ["{" + ",".join(f"{n} {v:.6f}" for n, v in zip("XYZABC", row, strict=True)) + "}" for row in rows]


def kuka_joints(n, seed):
    return path(n, seed) * [1, 1, 1, 1, 1, 1] + [0, -65, 65, 0, 0, 0]


def kuka_head(name):
    head = ["&ACCESS RVP", f"DEF {name}()", ";FOLD INI", "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )"]
    return [*head, "INTERRUPT ON 3", "BAS (#INITMOV,0 )", ";ENDFOLD (INI)"]


def kuka_generated():
    """Poses without S and T behind one set of axes; the move to where it stands; home at the end."""
    q = kuka_joints(30, 3)
    x = ",".join(f"{n} {v}" for n, v in zip("XYZABC", TOOL, strict=True))
    axes = ",".join(f"A{k} {v:.6f}" for k, v in enumerate(q[0], 1))
    lines = [*kuka_head("mill"), f"$TOOL={{{x}}}", "$BASE=$NULLFRAME", "PTP $AXIS_ACT", f"PTP {{{axes}}}"]
    for k, pose in enumerate(kuka_poses(q)):
        lines.append(f"LIN {pose} C_DIS")
        lines += ["WAIT SEC 0.5", "IF $IN[1] THEN", "$OUT[1]=TRUE", "ENDIF", "CONTINUE"] if k % 6 == 1 else []
    return Job("krl", "kr120r2500pro", {"mill.src": "\n".join([*lines, "PTP XHOME", "END", ""])}, q, 31)


def kuka_inline():
    """Inline forms with their data beside, home at both ends, an approach by the geometric operator."""
    q = kuka_joints(20, 4)
    tests = language_tests("krl")
    nominal = robot_of("kr120r2500pro")[0]
    x = ",".join(f"{n} {v}" for n, v in zip("XYZABC", TOOL, strict=True))
    dat, src = ["DEFDAT job"], [*kuka_head("job"), "PTP XHOME"]
    for k, (pose, row) in enumerate(zip(kuka_poses(q), np.radians(q), strict=True)):
        s, t = tests.status_and_turn(nominal, row)
        dat.append(f"DECL E6POS XP{k}={pose[:-1]},S {s},T {t},E1 0.0}}")
        dat.append(f'DECL FDAT FP{k}={{TOOL_NO 3,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}}')
        src += [f"FDAT_ACT=FP{k}", "BAS(#CP_PARAMS,0.2)", f"LIN XP{k}:{{X 0,Y 0,Z -50,A 0,B 0,C 0}}", f"LIN XP{k}"]
    config = f"DEFDAT $CONFIG\nTOOL_DATA[3]={{{x}}}\nE6AXIS XHOME={{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}}\nENDDAT\n"
    files = {
        "KRC/R1/Program/job.src": "\r\n".join([*src, "PTP XHOME", "END", ""]),
        "KRC/R1/Program/job.dat": "\r\n".join([*dat, "ENDDAT", ""]),
    }
    files |= {"KRC/R1/System/$config.dat": config, "KRC/R1/System/ir_stopm.src": "DEF ir_stopm()\nPTP $POS_RET\nEND\n"}
    return Job("krl", "kr120r2500pro", files, q, 20)


def kuka_forms():
    """Spline forms and arc welding forms, with calls of routines that are not in the backup before and in each."""
    q = kuka_joints(20, 6)
    tests = language_tests("krl")
    nominal = robot_of("kr120r2500pro")[0]
    x = ",".join(f"{n} {v}" for n, v in zip("XYZABC", TOOL, strict=True))
    dat, src = ["DEFDAT weld"], [*kuka_head("weld")]
    for k, (pose, row) in enumerate(zip(kuka_poses(q), np.radians(q), strict=True)):
        s, t = tests.status_and_turn(nominal, row)
        dat.append(f"DECL E6POS XP{k}={pose[:-1]},S {s},T {t},E1 0.0}}")
        dat.append(f'DECL FDAT FP{k}={{TOOL_NO 3,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}')
        src += ["PLC_Ready(3)", "IF Gripper(1) THEN", "$OUT[1]=TRUE", "ENDIF"] if k % 5 == 0 else []
        if k % 2:
            src += [
                f";FOLD ARCON WDAT1 LIN P{k} Vel=0.5 m/s CPDAT1 Tool[3]:torch Base[0] ;%{{PE}}",
                "$BWDSTART = FALSE",
            ]
            src += [f"FDAT_ACT = FP{k}", "BAS(#CP_PARAMS, 0.5)", "SET_CD_PARAMS (0)"]
            src += ["TRIGGER WHEN DISTANCE = 1 DELAY = ArcGetDelay(#P, WDAT1) DO ArcMainNG(#P, WDAT1, WP3) PRIO = -1"]
            src += [
                "ArcMainNG(#ArcOnBeforeMoveStd, WDAT1, WP3)",
                f"LIN XP{k}",
                "ArcMainNG(#After, WDAT1, WP3)",
                ";ENDFOLD",
            ]
        else:
            src += [
                f";FOLD SPTP P{k} Vel=100 % PDAT1 Tool[3]:torch Base[0] ;%{{PE}}",
                ";FOLD Parameters ;%{h}",
                ";ENDFOLD",
            ]
            move = (
                f"SPTP XP{k} WITH $VEL_AXIS[1] = SVEL_JOINT(100.0), $TOOL = STOOL2(FP{k}), $BASE = SBASE(FP{k}.BASE_NO)"
            )
            src += [f"{move}, $IPO_MODE = SIPO_MODE(FP{k}.IPO_FRAME), $LOAD = SLOAD(FP{k}.TOOL_NO) C_SPL", ";ENDFOLD"]
    files = {
        "KRC/R1/Program/weld.src": "\r\n".join([*src, "PTP XHOME", "END", ""]),
        "KRC/R1/Program/weld.dat": "\r\n".join([*dat, "ENDDAT", ""]),
        "KRC/R1/System/$config.dat": f"DEFDAT $CONFIG\nTOOL_DATA[3]={{{x}}}\nENDDAT\n",
    }
    return Job("krl", "kr120r2500pro", files, q, 20)


def fanuc_generated():
    """Lines without numbers, one point of a position register, one that was never taught."""
    tests = language_tests("fanuc")
    nominal, _, at = robot_of("m20ia")
    q = np.degrees(tests.in_front(nominal, 24))
    T = np.linalg.inv(at.T_base_world) @ nominal.forward(np.radians(q)) @ tests.TOOL
    points = [
        tests.point(k, row, tests.config(np.radians(q[k - 1])), 0, 1) for k, row in enumerate(pose_numbers(T, "xyz"), 1)
    ]
    points.append(
        "P[25]{\n   GP1:\n\tUF : 0, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n\tX = ******** mm, Y = ******** mm, Z = ******** mm,\n\tW = ******** deg, P = ******** deg, R = ******** deg\n};\n"
    )
    lines = [
        "UFRAME_NUM=0",
        "UTOOL_NUM=1",
        *(f"L P[{k}] 200mm/sec CNT60" for k in range(1, 25)),
        "J P[25] 10% FINE",
        "J PR[1] 10% FINE",
    ]
    text = "/PROG  SURFACE\n/ATTR\nLINE_COUNT\t= 0;\n/MN\n" + "".join(f"    :{line} ;\n" for line in lines)
    return Job(
        "fanuc",
        "m20ia",
        {"surface.ls": text + "/POS\n" + "".join(points) + "/END\n"},
        q,
        25,
        {"tools": {"1": tests.TOOL}},
    )


JOBS = [generated, taught, process, kuka_generated, kuka_inline, kuka_forms, fanuc_generated]


def filtered(folder, job):
    """The robot, and what the filter makes of the files of a job as a folder."""
    if job.robot == "irb1600":
        nominal, at = arm(), unknown_frames()
        robot = random_robot(nominal, "16", np.random.default_rng(7), size=0.2)
    else:
        nominal, robot, at = robot_of(job.robot, size=0.05)
    for name, text in job.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text.encode("latin-1"))
    found = languages.files_of([folder])
    setup = ControllerSetup(job.options.get("tools", {}), {}, at, start=job.options.get("start"))
    programs = found.language.read_for(nominal, found.files, setup)
    return nominal, robot, together([filter_program(robot, nominal, program, "abc") for program in programs], {})


@pytest.mark.parametrize("style", JOBS, ids=lambda style: style.__name__)
def test_nine_of_ten_targets_are_corrected_and_none_is_wrong(tmp_path, style):
    job = style()
    nominal, robot, found = filtered(tmp_path, job)
    assert len(found.targets) >= 0.9 * job.literals
    before = np.degrees(found.q_before[-len(job.truth) :])
    np.testing.assert_allclose(before, job.truth, rtol=0, atol=3e-3)
    wanted = nominal.forward(np.radians(before))
    assert_same_poses(robot.poses(found.q[-len(job.truth) :]), wanted, 1e-4, 1e-4)
    for left in found.left:
        assert len(left.reason) > 10
    assert len(found.left) <= 2
