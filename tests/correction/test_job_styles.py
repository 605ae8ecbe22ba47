"""Programs in the styles in which controllers hold and generators write them: how many of their targets are corrected.

The joints from which the poses were made are the oracle: what is corrected leads there, in every program.
"""

from dataclasses import dataclass, field

import numpy as np
import pytest
from maker_cases import language_tests, pose_numbers, robot_of, universal_robot
from scipy.spatial.transform import Rotation
from support import arm, assert_same_poses, random_robot

from irbcal.correction import languages
from irbcal.correction.corrected_program import together
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.program import ControllerSetup
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames

EXT = "[9E9,9E9,9E9,9E9,9E9,9E9]"
TOOL = [120.0, 0.0, 85.5, 0.0, 30.0, 0.0]
"""x, y, z in mm and angles about z, y, x, degrees."""


@dataclass
class Job:
    """Files, options, joints (degrees) that poses were made from, and the number of literal targets."""

    language: str
    robot: str
    files: dict
    truth: np.ndarray | dict
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


def smooth(q0, n, seed, size=1.0):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.5, 1.5, 6), rng.uniform(0, 6, 6)
    s = np.linspace(0, 4, n)[:, None]
    return np.array(q0) + np.sin(a * s + b) * np.array([25, 10, 10, 20, 12, 40]) * size


def fanuc_cell():
    """Main with calls, pick and place with labels and waits, frames of SYSFRAME.VA."""
    t = language_tests("fanuc")
    nominal, _, at = robot_of("m20ia")
    q = np.degrees(t.in_front(nominal, 30))
    T = np.linalg.inv(at.T_base_world @ t.USER) @ nominal.forward(np.radians(q)) @ t.TOOL
    rows = pose_numbers(T, "xyz")
    names = ["PICK", "PLACE", "WELD"]
    files = {}
    main = [
        "!******************",
        "UFRAME_NUM=0",
        "UTOOL_NUM=1",
        "J P[1:HOME] 100% FINE",
        "LBL[1:cycle]",
        "WAIT DI[1]=ON",
        "CALL PICK",
        "IF DI[3]=OFF,JMP LBL[1]",
        "CALL PLACE",
        "CALL WELD(1,'A')",
        "R[1:count]=R[1:count]+1",
        "JMP LBL[1]",
    ]

    def text(name, lines, points):
        body = "".join(f"{k:4d}:  {line}    ;\n" for k, line in enumerate(lines, 1))
        return f'/PROG  {name}\n/ATTR\nOWNER\t\t= MNEDITOR;\nCOMMENT\t\t= "";\nPROG_SIZE\t= 1024;\nCREATE\t\t= DATE 19-03-11  TIME 10:11:12;\nMODIFIED\t= DATE 19-03-11  TIME 10:11:12;\nFILE_NAME\t= ;\nVERSION\t\t= 0;\nLINE_COUNT\t= {len(lines)};\nMEMORY_SIZE\t= 1500;\nPROTECT\t\t= READ_WRITE;\nTCD:  STACK_SIZE\t= 0,\n      TASK_PRIORITY\t= 50,\n      TIME_SLICE\t= 0,\n      BUSY_LAMP_OFF\t= 0,\n      ABORT_REQUEST\t= 0,\n      PAUSE_REQUEST\t= 0;\nDEFAULT_GROUP\t= 1,*,*,*,*;\nCONTROL_CODE\t= 00000000 00000000;\n/MN\n{body}/POS\n{"".join(points)}/END\n'

    home = t.pendant(np.radians(q[:1]))[0]
    files["MAIN.LS"] = text("MAIN", main, [t.point(1, home, uf=0, ut=1)])
    truth = {"P[1] MAIN": q[0]}
    for m, name in enumerate(names):
        k0 = 10 * m
        lines = ["UFRAME_NUM=2", "UTOOL_NUM=1", "PAYLOAD[1]", "OVERRIDE=80%"]
        pts = []
        for k in range(10):
            tail = ["CNT100", "FINE", "CNT50 ACC80", "CNT0 TB .10sec,DO[5]=ON", "FINE Wjnt"][k % 5]
            kind = "J" if k == 0 else "L"
            speed = "50%" if kind == "J" else ("250mm/sec" if name != "WELD" else "WELD_SPEED")
            if name == "WELD" and k == 5:
                lines.append("Weld Start[1,1]")
            lines.append(f'{kind} P[{k + 1}:"pt {k}"] {speed} {tail}')
            if k == 3:
                lines += ["RO[1]=ON", "WAIT    .50(sec)", "IF RI[1]=ON,JMP LBL[7]", "UALM[3]", "LBL[7]"]
            pts.append(t.point(k + 1, rows[k0 + k], t.config(np.radians(q[k0 + k])), 2, 1))
            truth[f"P[{k + 1}] {name}"] = q[k0 + k]
        files[name + ".LS"] = text(name, lines, pts)

    def frame_va(name, T):
        r = pose_numbers(T[None], "xyz")[0]
        return r

    va = []
    for label, T, i in (("$MNUTOOL", t.TOOL, 1), ("$MNUFRAME", t.USER, 2)):
        r = frame_va(label, T)
        va.append(
            f"[*SYSTEM*]{label}  Storage: CMOS  Access: RW  : ARRAY[1,10] OF POSITION\n"
            + "".join(
                f"     [1,{j}] = \n  Group: 1   Config: N D B, 0, 0, 0\n  X: {(r[0] if j == i else 0):10.3f}   Y: {(r[1] if j == i else 0):10.3f}   Z: {(r[2] if j == i else 0):10.3f}\n  W: {(r[3] if j == i else 0):10.3f}   P: {(r[4] if j == i else 0):10.3f}   R: {(r[5] if j == i else 0):10.3f}\n"
                for j in range(1, 11)
            )
        )
    files["SYSFRAME.VA"] = "\n".join(va)
    return Job("fanuc", "m20ia", files, truth, 31)


def fanuc_arcs():
    """A arcs, C circles, German, skip, position register approach."""
    t = language_tests("fanuc")
    nominal, _, at = robot_of("m20ia")
    q = np.degrees(t.in_front(nominal, 40))[20:40]
    T = np.linalg.inv(at.T_base_world) @ nominal.forward(np.radians(q)) @ t.TOOL
    rows = pose_numbers(T, "xyz")
    lines = ["BENUTZER_NUM=0", "WKZ_NUM=1", "J PR[5] 50% FINE"]
    k = 1
    while k <= 20:
        if k == 5:
            lines += [f"C P[{k}]    \n    :  P[{k + 1}] 100mm/sec FINE"]
            k += 2
            continue
        if k in (9, 10, 11):
            lines += [f"A P[{k}] 50mm/sec CNT100"]
            k += 1
            continue
        if k == 15:
            lines += [f"L P[{k}] 100mm/sek FINE ueberspringen,LBL[3]"]
            k += 1
            continue
        lines += [f"L P[{k}] 100mm/sek CNT20"]
        k += 1
    body = "".join(f"{k:4d}:{line} ;\n" for k, line in enumerate(lines, 1))
    pts = [
        t.point(k, rows[k - 1], t.config(np.radians(q[k - 1])), 0, 1).replace("CONFIG", "KONFIG") for k in range(1, 21)
    ]
    text = f'/PROG  NAHT1\t  Process\n/ATTR\nEIGN.\t\t= MNEDITOR;\nKOMMENTAR\t= "Naht";\nZEILEN\t= {len(lines)};\n/APPL\n  ARC Welding Equipment : 1,*,*,*,*;\n/MN\n{body}/POS\n{"".join(pts)}/END\n'
    return Job(
        "fanuc", "m20ia", {"naht1.ls": text}, {f"P[{k}]": q[k - 1] for k in range(1, 21)}, 20, {"tools": {"1": t.TOOL}}
    )


def yaskawa_backup():
    """Jobs that call one another, TOOL.CND and UFRAME.CND, rectangular user points, labels and conditions."""
    t = language_tests("inform")
    nominal, _, at = robot_of("gp8")
    q = np.degrees(t.in_front(nominal, 24))
    r = np.radians(q)
    T = np.linalg.inv(at.T_base_world @ t.USER) @ nominal.forward(r) @ t.TOOL
    rows = pose_numbers(T, "xyz")
    elbow = np.atleast_1d(t.inform.YASKAWA.postures(nominal, r)[1])
    files, truth = {}, {}

    def head(name, pos, moves, n):
        return "\r\n".join(
            [
                "/JOB",
                f"//NAME {name}",
                "//POS",
                f"///NPOS {n},0,0,0,0,0",
                *pos,
                "//INST",
                "///DATE 2021/04/01 12:00",
                "///ATTR SC,RW,RJ",
                "////FRAME USER 2",
                "///GROUP1 RB1",
                "NOP",
                *moves,
                "END",
                "",
            ]
        )

    for m, name in enumerate(["PICK", "SEAM"]):
        pos = ["///USER 2", "///TOOL 1", "///POSTYPE USER", "///RECTAN"]
        moves = ["'---- " + name]
        last = ""
        for k in range(12):
            i = 12 * m + k
            conf = f"///RCONF {0 if abs(q[i, 3]) < 90 else 1},{int(elbow[i])},0,0,0,0,0,0"
            pos += [conf] if conf != last else []
            last = conf
            pos.append(f"C{k:05d}=" + ",".join(f"{v:.{3 if j < 3 else 4}f}" for j, v in enumerate(rows[i])))
            truth[f"C{k} {name}"] = q[i]
            if name == "SEAM":
                mv = [
                    f"MOVL C{k:05d} V=11.0",
                    f"MOVC C{k:05d} V=8.0",
                    f"MOVL C{k:05d} V=100.0 PL=1 ACC=50 DEC=50",
                    f"MOVS C{k:05d} V=20.0",
                ][0 if k < 3 else 1 if k < 6 else 2 if k < 9 else 3]
                moves += ["ARCON ASF#(1)", "WVON WEV#(1)"] if k == 2 else []
                moves += ["WVOF", "ARCOF AEF#(1)"] if k == 9 else []
                moves.append(mv)
            else:
                moves.append(
                    f"MOV{'J' if k % 4 == 0 else 'L'} C{k:05d} {'VJ=25.00' if k % 4 == 0 else 'V=250.0'} PL=0"
                    + (" UNTIL IN#(4)=ON" if k == 7 else "")
                )
                moves += (
                    ["*LOOP", "DOUT OT#(1) ON", "TIMER T=0.20", "JUMP *LOOP IF IN#(2)=OFF", "SET B000 1", "INC I001"]
                    if k == 5
                    else []
                )
        files[name + ".JBI"] = head(name, pos, moves, 12)
    files["MASTER.JBI"] = head(
        "MASTER", [], ["*TOP", "CALL JOB:PICK IF IN#(1)=ON", "CALL JOB:SEAM", 'MSG "done"', "JUMP *TOP"], 0
    )

    def six(T):
        return ",".join(f"{v:.{3 if j < 3 else 4}f}" for j, v in enumerate(pose_numbers(T[None], "xyz")[0]))

    files["TOOL.CND"] = "\r\n".join(
        [
            "//TOOL 0",
            "///NAME ",
            "0.000,0.000,0.000,0.0000,0.0000,0.0000",
            "0.000,0.000,0.000",
            "0.000",
            "0.000,0.000,0.000",
            "//TOOL 1",
            "///NAME TORCH",
            six(t.TOOL),
            "0.000,0.000,50.000",
            "3.000",
            "0.000,0.000,0.000",
            "",
        ]
    )
    files["UFRAME.CND"] = "\r\n".join(
        ["//UFRAME 2", "///NAME JIG", "///TOOL 1", "///GROUP 1,0,0", "////BUSER", six(t.USER), ""]
    )
    return Job("inform", "gp8", files, truth, 24)


def yaskawa_pulses():
    t = language_tests("inform")
    nominal, _, _at = robot_of("gp8")
    q = np.degrees(t.in_front(nominal, 20))
    pos = ["///TOOL 0", "///POSTYPE PULSE", "///PULSE"]
    moves = []
    for k, row in enumerate(np.rint(q * t.PULSES).astype(int)):
        pos.append(f"C{k:05d}=" + ",".join(map(str, row)))
        moves.append(f"MOVJ C{k:05d} VJ=50.00" if k % 2 else f"MOVL C{k:05d} V=166.6 PL=1")
        moves += ["CALL JOB:GRIPPER"] if k % 6 == 5 else []
    text = "\r\n".join(
        [
            "/JOB",
            "//NAME TRAVEL",
            "//POS",
            "///NPOS 20,0,0,0,0,0",
            *pos,
            "//INST",
            "///DATE 2021/04/01 12:00",
            "///ATTR SC,RW",
            "///GROUP1 RB1",
            "NOP",
            *moves,
            "END",
            "",
        ]
    )
    return Job("inform", "gp8", {"TRAVEL.JBI": text}, {f"C{k}": q[k] for k in range(20)}, 20, {"pulses": t.PULSES})


def kawasaki_save():
    t = language_tests("kawasaki")
    nominal, _, _at = robot_of("rs007n")
    q = np.degrees(t.well_inside(nominal, 2))
    q = smooth([10, 20, -80, 20, 55, 30], 24, 5)
    r = np.radians(q)
    T = np.linalg.inv(t.WORLD @ t.BASE) @ nominal.forward(r) @ t.FLANGE @ t.TOOL
    rows = pose_numbers(T, "ZYZ")
    J = [f"#home {t.numbers(q[0])}", *(f"#j{k} {t.numbers(q[k])}" for k in range(1, 8))]
    X = [
        f"tcp {t.numbers(pose_numbers(t.TOOL[None], 'ZYZ')[0])}",
        f"jig {t.numbers(pose_numbers(t.BASE[None], 'ZYZ')[0])}",
    ]
    X += [f"{'part' if k < 16 else 'shelf'}{f'[{k}]' if k >= 16 else k} {t.numbers(rows[k])}" for k in range(8, 24)]
    main = [
        ".PROGRAM main()",
        "  ; cycle",
        "  TOOL tcp",
        "  BASE jig",
        "  SPEED 100 ALWAYS",
        "  ACCURACY 1 ALWAYS",
        "  JMOVE #home",
        "  WHILE SIG(1001) DO",
        "    CALL pick",
        "    CALL place",
        "  END",
        "  JMOVE #home",
        ".END",
    ]
    pick = [".PROGRAM pick()", "  SPEED 50"] + [f"  JMOVE #j{k}" for k in range(1, 8)] + ["  SIGNAL 9", "  TWAIT 0.2"]
    for k in range(8, 16):
        pick += ["  SPEED 200 MM/S", f"  LMOVE part{k}"]
        pick += ["  BREAK", "  CLOSEI", "  IF SIG(1003) THEN", '    PRINT "no part"', "  END"] if k == 11 else []
    pick += ["  LDEPART 50", ".END"]
    place = (
        [".PROGRAM place()", "  JMOVE #j7"]
        + [f"  LMOVE shelf[{k}]" if k != 19 else f"  LAPPRO shelf[{k}],80\n  LMOVE shelf[{k}]" for k in range(16, 24)]
        + [".END"]
    )
    text = "\r\n".join(
        [
            '.NETCONF     192.168.0.2,""',
            ".***--- header",
            ".ROBOTDATA1",
            "ZROBOT.TYPE   37   6   1   2  RS007N",
            ".END",
            *main,
            *pick,
            *place,
            ".TRANS",
            *X,
            ".END",
            ".JOINTS",
            *J,
            ".END",
            ".REALS",
            "count = 3",
            ".END",
            "",
        ]
    ).replace("\n  LMOVE", "\r\n  LMOVE")
    truth = {
        "#home": q[0],
        **{f"#j{k}": q[k] for k in range(1, 8)},
        **{f"part{k}": q[k] for k in range(8, 16)},
        **{f"shelf[{k}]": q[k] for k in range(16, 24)},
    }
    return Job("kawasaki", "rs007n", {"save.as": text}, truth, 24, {"where": t.pair(nominal)})


def kawasaki_blocks():
    language_tests("kawasaki")
    _nominal, _, _at = robot_of("rs007n")
    q = smooth([10, 20, -80, 20, 55, 30], 16, 6)
    lines = [".PROGRAM pg12()#0"]
    for k, row in enumerate(q):
        kind = "JOINT" if k % 3 == 0 else "LINEAR"
        lines.append(
            f"    {kind} SPEED9 ACCU1 TIMER0 TOOL1 WORK0 CLAMP1 (OFF,0,0,O) 2 (OFF,0,0,O) OX= WX= #[{', '.join(f'{v:.6f}' for v in row)}]  ;"
        )
    text = "\r\n".join([*lines, ".END", ""])
    return Job("kawasaki", "rs007n", {"pg12.pg": text}, {f"#{k}": q[k] for k in range(16)}, 16)


def staubli_app():
    t = language_tests("val3")
    nominal, _, at = robot_of("rx160")
    q = np.degrees(t.in_front(nominal, 20))
    r = np.radians(q)
    T = np.linalg.inv(at.T_base_world @ t.OUTER @ t.INNER) @ nominal.forward(r) @ t.TOOL
    rows = pose_numbers(T, "XYZ")
    conf = [
        f'shoulder="lefty" elbow="{"epositive" if a[2] >= 0 else "enegative"}" wrist="{"wpositive" if a[4] >= 0 else "wnegative"}" fatherId="fInner[0]"'
        for a in r
    ]
    points = [t.value(rows[k], k, conf[k]) for k in range(4, 20)]
    joints = [t.value(q[k], k, names=[f"j{i}" for i in range(1, 7)]) for k in range(4)]
    code = [
        "  num l_i",
        "begin",
        "  movej(j[0],tGrip,mFast)",
        "  for l_i=0 to 3",
        "    movej(j[l_i],tGrip,mFast)",
        "  endFor",
        "  while true",
        "    wait(dioStart==true)",
        "    movej(appro(p[4],{0,0,-50,0,0,0}),tGrip,mFast)",
        "    movel(p[4],tGrip,mSlow)",
        "    waitEndMove()",
        "    close(tGrip)",
        "    delay(0.2)",
        *[f"    movel(p[{k}],tGrip,mSlow)" for k in range(5, 12)],
        "    movec(p[12],p[13],tGrip,mSlow)",
        "    call sub()",
        "  endWhile",
        "end",
    ]
    sub = ["begin", *[f"  movel(p[{k}],tGrip,mSlow)" for k in range(14, 20)], "end"]
    files = t.application(points, joints, [])

    def prog(n, c):
        return "\r\n".join(
            [
                '<?xml version="1.0" encoding="utf-8"?>',
                '<Programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2">',
                f'  <Program name="{n}">',
                "    <Locals />",
                "    <Code><![CDATA[" + c[0],
                *c[1:-1],
                c[-1] + "]]></Code>",
                "  </Program>",
                "</Programs>",
                "",
            ]
        )

    files["start.pgx"] = prog("start", code).encode()
    files["sub.pgx"] = prog("sub", sub).encode()
    files = {f"app/{n}": d.decode("utf-8") if isinstance(d, bytes) else d for n, d in files.items()}
    return Job(
        "val3", "rx160", files, {**{f"j[{k}]": q[k] for k in range(4)}, **{f"p[{k}]": q[k] for k in range(4, 20)}}, 20
    )


def ur_polyscope():
    t = language_tests("urscript")
    nominal, _, at = universal_robot()
    q = smooth([30, -90, 80, -60, 80, 20], 16, 8)
    r = np.radians(q)
    T = np.linalg.inv(at.T_base_world) @ nominal.forward(r) @ t.TOOL
    rows = pose_numbers(T, None, 1.0)
    head = [
        "def palletize():",
        "  set_standard_analog_input_domain(0, 1)",
        "  set_tool_voltage(0)",
        "  set_runstate_standard_digital_output_to_value(0, False)",
        f"  set_tcp(p[{t.numbers(pose_numbers(t.TOOL[None], None, 1.0)[0], 15)}])",
        "  set_payload(1.5, [0.0, 0.0, 0.05])",
        "  set_gravity([0.0, 0.0, 9.82])",
        "  step_count_x = 0.0",
        "  thread Step_Counter_Thread_x():",
        "    while (True):",
        "      step_count_x = step_count_x + 1.0",
        "      sync()",
        "    end",
        "  end",
        "  run Step_Counter_Thread_x()",
        "  global gripped = False",
    ]
    body = ["  def Subprog():", '    $ 20 "Subprog"']
    truth = {}
    for k in range(16):
        head += [f"  global W_{k}_p=p[{t.numbers(rows[k])}]", f"  global W_{k}_q=[{t.numbers(r[k], 16)}]"]
        truth[f"W_{k}_p"] = q[k]
    for k in range(10, 16):
        body += [
            f'    $ {30 + k} "W_{k}"',
            f"    movel(W_{k}_p, a=1.2, v=0.25, r=0.01)"
            if k % 2
            else f"    movej(get_inverse_kin(W_{k}_p, qnear=W_{k}_q), a=1.3962634015954636, v=1.0471975511965976)",
        ]
    body += ["  end", "  while (True):", '    $ 1 "Robot Program"']
    for k in range(10):
        body += [
            f'    $ {2 + k} "W_{k}"',
            f"    movej(get_inverse_kin(W_{k}_p, qnear=W_{k}_q), a=1.3962634015954636, v=1.0471975511965976)"
            if k % 3 == 0
            else f"    movel(W_{k}_p, a=1.2, v=0.25)",
        ]
        body += (
            [
                "    set_standard_digital_out(0, True)",
                "    sleep(0.5)",
                "    if (get_standard_digital_in(1) == True):",
                "      gripped = True",
                "    end",
            ]
            if k == 4
            else []
        )
    body += ["    Subprog()", "  end", "end", ""]
    return Job("urscript", None, {"palletize.script": "\n".join(head + body)}, truth, 16)


def abb_station():
    """RobotStudio: main calls paths, wobj, tool in CalibData, base frame in MOC.cfg."""
    q = smooth([10, -15, 25, 15, 45, 30], 30, 9)
    wob = frames.from_xyz_angles([0.6, -0.3, 0.4, 0.1, -0.05, 0.6])
    B = frames.from_xyz_angles([1.0, 2.0, 0.5, 0.0, 0.0, 0.7])
    T = [np.linalg.inv(wob) @ B @ X @ tool() for X in arm().forward(np.radians(q))]
    calib = [
        "MODULE CalibData",
        f"  PERS tooldata tGrip:=[TRUE,[{abb(tool())}],[1,[0,0,1],[1,0,0,0],0,0,0]];",
        f'  TASK PERS wobjdata Wobj_1:=[FALSE,TRUE,"",[{abb(wob)}],[[0,0,0],[1,0,0,0]]];',
        "ENDMODULE",
    ]
    mod = ["%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%", "MODULE Module1"]
    for k, (X, c) in enumerate(zip(T, configured(q), strict=False)):
        mod.append(f"    CONST robtarget Target_{10 * (k + 1)}:=[{abb(X)},{c},{EXT}];")
    mod += [
        "    PROC main()",
        "        ConfL\\On;",
        "        SingArea\\Wrist;",
        "        Path_10;",
        "        WaitDI diStart,1;",
        "        IF diNext=1 THEN",
        "            Path_20;",
        "        ENDIF",
        "        FOR i FROM 1 TO 3 DO",
        "            Path_30 i;",
        "        ENDFOR",
        "    ENDPROC",
    ]
    for p, (a, b) in enumerate([(0, 10), (10, 20), (20, 30)]):
        mod.append(f"    PROC Path_{10 * (p + 1)}({'num n' if p == 2 else ''})")
        k = a
        while k < b:
            name = f"Target_{10 * (k + 1)}"
            if p == 1 and k == 14:
                mod.append(f"        MoveC {name},Target_{10 * (k + 2)},v200,z5,tGrip\\WObj:=Wobj_1;")
                k += 2
                continue
            mod.append(f"        Move{'J' if k == a else 'L'} {name},v1000,z100,tGrip\\WObj:=Wobj_1;")
            k += 1
        mod.append("    ENDPROC")
    mod.append("ENDMODULE")
    qB = Rotation.from_matrix(B[:3, :3]).as_quat()
    moc = f'MOC:CFG_1.0:6:0::\n#\nROBOT:\n\n      -name "ROB_1" -use_robot_type "ROB1_1600" -base_frame_pos_x {B[0, 3]} -base_frame_pos_y {B[1, 3]}\\\n      -base_frame_pos_z {B[2, 3]} -base_frame_orient_u0 {qB[3]:.9f} -base_frame_orient_u1 {qB[0]:.9f}\\\n      -base_frame_orient_u2 {qB[1]:.9f} -base_frame_orient_u3 {qB[2]:.9f}\n#\n'
    files = {
        "Backup_1/RAPID/TASK1/PROGMOD/Module1.mod": "\r\n".join(mod) + "\r\n",
        "Backup_1/RAPID/TASK1/PROGMOD/CalibData.mod": "\r\n".join(calib) + "\r\n",
        "Backup_1/SYSPAR/MOC.cfg": moc,
        "Backup_1/BACKINFO/backinfo.txt": ">>SYSTEM_ID:\n",
    }
    return Job("rapid", "irb1600", files, {f"Target_{10 * (k + 1)}": q[k] for k in range(30)}, 30)


def abb_arrays():
    q = smooth([10, -15, 25, 15, 45, 30], 20, 10)
    P = [f"[{p},{c},{EXT}]" for p, c in zip(abb_poses(q), configured(q), strict=False)]
    mod = [
        "MODULE Pallet",
        tooldata("tGrip"),
        f"  CONST robtarget pGrid{{10}}:=[{','.join(P[:10])}];",
        *(f"  PERS robtarget pS{k}:={P[k]};" for k in range(10, 20)),
        "  VAR num i:=0;",
        "PROC main()",
        "  FOR i FROM 1 TO 10 DO",
        "    MoveJ Offs(pGrid{i},0,0,100),v1000,z50,tGrip;",
        "    MoveL pGrid{i},v200,fine,tGrip;",
        "    GripLoad load1;",
        "  ENDFOR",
        "  TEST nProg",
        "  CASE 1:",
        *(f"    MoveL pS{k},v300,z10,tGrip;" for k in range(10, 15)),
        "  CASE 2:",
        *(f"    TriggL pS{k},v300,trig1,z10,tGrip;" for k in range(15, 19)),
        "  DEFAULT:",
        '    TPWrite "none";',
        "  ENDTEST",
        "  MoveLDO pS19,v100,z0,tGrip,doGun,1;",
        "ENDPROC",
        "ENDMODULE",
    ]
    return Job(
        "rapid",
        "irb1600",
        {"Pallet.mod": "\n".join(mod)},
        {**{f"pGrid{{{k + 1}}}": q[k] for k in range(10)}, **{f"pS{k}": q[k] for k in range(10, 20)}},
        20,
    )


def kuka_spots():
    """VW-like folds: subroutines called from cell.src, spot tech forms, SLIN, CIRC, global points."""
    q = kuka_joints(24, 14)
    t = language_tests("krl")
    nominal = robot_of("kr120r2500pro")[0]
    x = ",".join(f"{n} {v}" for n, v in zip("XYZABC", TOOL, strict=True))
    dat, src = (
        [
            "&ACCESS RVP",
            "&REL 12",
            "DEFDAT  spot1 PUBLIC",
            ";FOLD EXTERNAL DECLARATIONS;%{PE}%MKUKATPBASIS,%CEXT,%VCOMMON,%P",
            ";FOLD BASISTECH EXT;%{PE}%MKUKATPBASIS,%CEXT,%VEXT,%P",
            "EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )",
            "DECL INT SUCCESS",
            ";ENDFOLD (BASISTECH EXT)",
            ";ENDFOLD (EXTERNAL DECLARATIONS)",
        ],
        kuka_head("spot1"),
    )
    src = [
        *src,
        "",
        ";FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:HOME, 3:, 5:100, 7:DEFAULT",
        "$BWDSTART = FALSE",
        "PDAT_ACT=PDEFAULT",
        "FDAT_ACT=FHOME",
        "BAS (#PTP_PARAMS,100 )",
        "$H_POS=XHOME",
        "PTP  XHOME",
        ";ENDFOLD",
    ]
    for k, (pose, row) in enumerate(zip(kuka_poses(q), np.radians(q), strict=True)):
        s, tt = t.status_and_turn(nominal, row)
        dat.append(f"DECL E6POS XP{k + 1}={pose[:-1]},S {s},T {tt},E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}}")
        dat.append(
            f'DECL FDAT FP{k + 1}={{TOOL_NO 3,BASE_NO 0,IPO_FRAME #BASE,POINT2[] "{f"XP{k}" if k == 7 else " "}",TQ_STATE FALSE}}'
        )
        n = k + 1
        if k == 6:
            continue
        if k == 7:
            src += [
                ";FOLD CIRC P7 P8 CONT Vel=2 m/s CPDAT7 Tool[3]:gun Base[0];%{PE}%R 8.3.31,%MKUKATPBASIS,%CMOVE,%VCIRC,%P 1:CIRC, 2:P7, 3:P8, 4:C_DIS C_DIS, 6:2, 8:CPDAT7",
                "$BWDSTART=FALSE",
                "LDAT_ACT=LCPDAT7",
                "FDAT_ACT=FP8",
                "BAS(#CP_PARAMS,2)",
                "CIRC XP7, XP8 C_DIS C_DIS",
                ";ENDFOLD",
            ]
        elif k % 4 == 1:
            src += [
                f";FOLD SPOT PTP P{n} Vel=100 % PDAT{n} ProgNr= {n} ServoGun= 1 Cont=OPN Part=3 mm Force=2.5 kN Tool[3]:gun Base[0];%{{PE}}%R 3.2.0,%MKUKATPSERVOTECH,%CSERVOGUN_TP,%VSPOT_PTP,%P 1:PTP, 2:P{n}",
                "$BWDSTART = FALSE",
                f"PDAT_ACT=PPDAT{n}",
                f"FDAT_ACT=FP{n}",
                "BAS (#PTP_PARAMS,100)",
                "S_ACT.GUN=1",
                "USERSPOT(#ADVSPOT,S_ACT)",
                "TRIGGER WHEN DISTANCE=1 DELAY=-50 DO EG_SPOT(#PTP, S_ACT) PRIO=-1",
                f"PTP XP{n}",
                ";ENDFOLD",
            ]
        elif k % 4 == 2:
            src += [
                f";FOLD SLIN P{n} CONT Vel=0.5 m/s CPDAT{n} Tool[3]:gun Base[0] ;%{{PE}}",
                ";FOLD Parameters ;%{h}",
                f";Params IlfProvider=kukaroboter.basistech.inlineforms.movement.spline; Kuka.PointName=P{n}; Kuka.BlendingEnabled=True",
                ";ENDFOLD",
                f"SLIN XP{n} WITH $VEL = SVEL_CP(0.5, , LCPDAT{n}), $TOOL = STOOL2(FP{n}), $BASE = SBASE(FP{n}.BASE_NO), $IPO_MODE = SIPO_MODE(FP{n}.IPO_FRAME), $LOAD = SLOAD(FP{n}.TOOL_NO), $ACC = SACC_CP(LCPDAT{n}), $ORI_TYPE = SORI_TYP(LCPDAT{n}), $APO = SAPO(LCPDAT{n}), $JERK = SJERK(LCPDAT{n}) C_Spl",
                ";ENDFOLD",
            ]
        else:
            src += [
                f";FOLD LIN P{n} Vel=1 m/s CPDAT{n} Tool[3]:gun Base[0];%{{PE}}%R 8.3.31,%MKUKATPBASIS,%CMOVE,%VLIN,%P 1:LIN, 2:P{n}, 3:, 5:1, 7:CPDAT{n}",
                "$BWDSTART=FALSE",
                f"LDAT_ACT=LCPDAT{n}",
                f"FDAT_ACT=FP{n}",
                "BAS(#CP_PARAMS,1)",
                f"LIN XP{n}",
                ";ENDFOLD",
            ]
        src += (
            [
                ";FOLD WAIT FOR ( IN 1 'ok' );%{PE}",
                ";ENDFOLD",
                ";FOLD OUT 5 'x' State=TRUE CONT;%{PE}",
                "CONTINUE",
                "$OUT[5]=TRUE",
                ";ENDFOLD",
            ]
            if k % 5 == 0
            else []
        )
    config = f"DEFDAT  $CONFIG PUBLIC\nDECL FRAME TOOL_DATA[16]\nTOOL_DATA[3]={{{x}}}\nDECL FRAME BASE_DATA[32]\nDECL LOAD LOAD_DATA[16]\nLOAD_DATA[3]={{M 50,CM {{X 0,Y 0,Z 100,A 0,B 0,C 0}},J {{X 0,Y 0,Z 0}}}}\nE6AXIS XHOME={{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0,E1 0}}\nENDDAT\n"
    cell = [
        "&ACCESS RVP",
        "DEF  CELL ( )",
        ";FOLD INIT",
        "DECL CHAR X[10]",
        ";ENDFOLD",
        "BAS (#INITMOV,0 )",
        "PTP XHOME",
        "AUTOEXT INI",
        "LOOP",
        "P00 (#EXT_PGNO,#PGNO_GET,DMY[],0 )",
        "SWITCH PGNO",
        "CASE 1",
        "P00 (#EXT_PGNO,#PGNO_ACKN,DMY[],0 )",
        "spot1 ( )",
        "DEFAULT",
        "P00 (#EXT_PGNO,#PGNO_FAULT,DMY[],0 )",
        "ENDSWITCH",
        "ENDLOOP",
        "END",
    ]
    files = {
        "KRC/R1/Program/spot1.src": "\r\n".join([*src, "END", ""]),
        "KRC/R1/Program/spot1.dat": "\r\n".join([*dat, "ENDDAT", ""]),
        "KRC/R1/System/$config.dat": config,
        "KRC/R1/cell.src": "\r\n".join(cell) + "\r\n",
        "KRC/R1/Mada/$machine.dat": "DEFDAT $MACHINE PUBLIC\nFRAME $ROBROOT={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\nENDDAT\n",
        "am.ini": "[Archive]\nName=x\n",
    }
    return Job("krl", "kr120r2500pro", files, {f"XP{k + 1}": q[k] for k in range(24)}, 24)


JOBS = [generated, taught, process, kuka_generated, kuka_inline, kuka_forms, fanuc_generated]
JOBS += [
    fanuc_cell,
    fanuc_arcs,
    yaskawa_backup,
    yaskawa_pulses,
    kawasaki_save,
    kawasaki_blocks,
    staubli_app,
    ur_polyscope,
    abb_station,
    abb_arrays,
    kuka_spots,
]


def filtered(folder, job):
    """The robot, and what the filter makes of the files of a job as a folder."""
    if job.robot == "irb1600":
        nominal, at = arm(), unknown_frames()
        robot = random_robot(nominal, "16", np.random.default_rng(7), size=0.2)
    else:
        nominal, robot, at = universal_robot() if job.robot is None else robot_of(job.robot, size=0.05)
    for name, text in job.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text.encode("utf-8" if job.language in ("val3", "urscript") else "latin-1"))
    found = languages.files_of([folder])
    assert languages.name_of(found.language) == job.language
    options = {"T_world_base": found.language.backup(found.files).T_world_base} | job.options
    tools = options.pop("tools", {})
    programs = found.language.read_for(nominal, found.files, ControllerSetup(tools, {}, at, **options))
    return (
        nominal,
        robot,
        together([filter_program(program, CorrectionModel(robot, nominal, "abc")) for program in programs], {}),
    )


@pytest.mark.parametrize("style", JOBS, ids=lambda style: style.__name__)
def test_nine_of_ten_targets_are_corrected_and_none_is_wrong(tmp_path, style):
    job = style()
    nominal, robot, found = filtered(tmp_path, job)
    assert len(found.targets) >= 0.9 * job.literals
    before, truth = (
        np.degrees(found.q_before),
        np.array([*job.truth.values()] if isinstance(job.truth, dict) else job.truth),
    )
    nearest = np.abs(before[:, None] - truth).max(axis=2)
    assert nearest.min(axis=1).max() < 5e-3, "degrees; pulses and FANUC's decimals"
    assert len({*nearest.argmin(axis=1)}) >= 0.9 * len(truth)
    assert_same_poses(robot.poses(found.q), nominal.forward(np.radians(before)), 1e-4, 1e-4)
    for left in found.unchanged_targets:
        assert len(left.reason) > 10
    assert len(found.unchanged_targets) <= 2
