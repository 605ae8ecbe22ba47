"""KUKA KRL: what is read, what is left, and what the corrected numbers are."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import check_damaged, corrected, given, pose_numbers, poses, robot_of, well_inside
from moves_cases import written
from support import assert_same_poses

from irbcal.correction.languages import krl
from irbcal.correction.languages.krl import (
    END,
    KrlData,
    KrlProgram,
    Statements,
    aggregate,
    lines_of,
    posture_of,
    target,
)
from irbcal.correction.listing import Listing
from irbcal.correction.targets import START
from irbcal.errors import ProgramError
from irbcal.modeling import frames

TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
BASE = frames.from_xyz_angles([0.5, 0.1, 0.3, 0.0, 0.1, 0.2])
ZYX = "ZYX"


@pytest.fixture(scope="module")
def robots():
    return robot_of("kr120r2500pro")


def status_and_turn(nominal, q):
    """S and T, from the geometry and the facts of the language, without irbcal's own."""
    T = nominal.forward(q[None])[0]
    wrist = T[:3, 3] - 0.215 * T[:3, 2]
    a = np.degrees(q)
    front = wrist[0] * np.cos(q[0]) - wrist[1] * np.sin(q[0])  # A1 turns about -z
    s = int(front < 0) | 2 * int(a[2] >= np.degrees(np.arctan2(-0.041, 1.0))) | 4 * int(a[4] < 0)
    return s, sum(1 << k for k in range(6) if a[k] < 0)


def text(values, names="X Y Z A B C"):
    return ",".join(f"{n} {v:.6f}" for n, v in zip(names.split(), values, strict=True))


def program(nominal, q, newline="\r\n"):
    """A program with points in data, one kind after the other."""
    T = frames.inverse(BASE) @ nominal.forward(q) @ TOOL
    dat, src = ["&ACCESS RVP", "DEFDAT job PUBLIC"], ["&ACCESS RVP", "DEF job()", "; Größe: P1 {X 1}"]
    tool, base = (pose_numbers(frame[None], ZYX)[0] for frame in (TOOL, BASE))
    dat.append(f"DECL FRAME grip={{{text(tool)}}}")
    src += ["$TOOL=grip", f"$BASE={{FRAME: {text(base)}}}"]
    for k, (joints, numbers) in enumerate(zip(np.degrees(q), pose_numbers(T, ZYX), strict=True)):
        s, t = status_and_turn(nominal, q[k])
        dat.append(f"DECL E6POS XP{k}={{{text(numbers)},S {s},T {t},E1 0.0,E2 0.0}} ; point")
        dat.append(f"DECL  E6AXIS   xa{k} = {{ {text(joints, 'A1 A2 A3 A4 A5 A6')} }}")
        src += [f"ptp XA{k}", f"LIN Xp{k} C_DIS"]
    return {"job.src": newline.join([*src, "END", ""]), "job.dat": newline.join([*dat, "ENDDAT", ""])}


def parsed(robots, files, **more):
    nominal, _, at = robots
    return krl.parse(
        nominal, [(n, t if isinstance(t, bytes) else t.encode("latin-1")) for n, t in files.items()], given(at, **more)
    )


def read_back(data):
    """Numbers of all points: name to six numbers, and S and T."""
    out = {}
    for name, inside in re.findall(r"(?i)DECL\s+E6\w+\s+(\w+)\s*=\s*\{([^}]*)\}", data.decode("latin-1")):
        values = dict(re.findall(r"([A-Z]\d?)\s+([-\d.]+)", inside))
        keys = "A1 A2 A3 A4 A5 A6" if "A1" in values else "X Y Z A B C"
        out[name.upper()] = np.array([float(values[k]) for k in keys.split()]), values.get("S"), values.get("T")
    return out


def test_the_robot_goes_where_it_was_meant_to(robots):
    nominal, robot, _ = robots
    q = well_inside(nominal, 40)
    seen = parsed(robots, program(nominal, q))
    found = corrected(robot, nominal, seen)
    assert found.unchanged_targets == ()
    assert len(found.targets) == 80
    new = read_back(found.files["job.dat"])
    wanted = nominal.forward(q)
    joints = np.radians([new[f"XA{k}"][0] for k in range(40)])
    assert_same_poses(robot.poses(joints), wanted, 2e-7, 2e-7)
    # the controller: base and tool off, inverse in the branch that S and T name; here seeded with the old joints
    T = BASE @ poses([new[f"XP{k}"][0] for k in range(40)], ZYX) @ frames.inverse(TOOL)
    assert_same_poses(T, nominal.forward(found.q[40:]), 2e-8, 2e-7)
    assert_same_poses(robot.poses(found.q[40:]), wanted, 2e-7, 2e-7)
    assert np.abs(found.q_before[40:] - q).max() < 1e-6, "S and T name the joints that were meant"
    for k in range(40):
        assert tuple(map(int, new[f"XP{k}"][1:])) == status_and_turn(nominal, found.q[40 + k])
    assert 0.05 < found.shift.mean() * 1e3 < 20


def test_only_numbers_change(robots):
    nominal, robot, _ = robots
    files = program(nominal, well_inside(nominal, 5))
    found = corrected(robot, nominal, parsed(robots, files))
    mark = b"; irbcal: fake targets, calibration abc123\r\n"
    assert found.files["job.src"].replace(mark, b"") == files["job.src"].encode("latin-1")
    assert found.files["job.src"].count(mark) == 1
    blank = re.compile(rb"[-+\d.]+(?:E[-+]?\d+)?")
    assert found.files["job.dat"].count(mark) == 1
    data = found.files["job.dat"].replace(mark, b"")
    assert blank.sub(b"#", data) == blank.sub(b"#", files["job.dat"].encode("latin-1"))
    for again in (found.files, files | {"job.dat": found.files["job.dat"]}):  # also beside the routine as it was
        assert parsed(robots, again).fingerprint == "abc123"
    again = parsed(robots, found.files)
    with pytest.raises(ProgramError, match="calibration abc123"):
        corrected(robot, nominal, again)
    assert krl.LANGUAGE.fingerprint(found.files["job.src"]) == "abc123"
    with pytest.raises(ValueError, match="one word"):
        corrected(robot, nominal, parsed(robots, files), "abc\nHALT")


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "cp437"])
def test_unchanged_programs_are_the_same_bytes(robots, newline, encoding):
    data = program(robots[0], well_inside(robots[0], 2), newline)["job.dat"].replace("point", "Größe").encode(encoding)
    seen = parsed(robots, {"job.dat": data})
    assert seen.listing.files_with([]) == {"job.dat": data}


POINT = "{X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224,S 2,T 2,E1 0}"
HEAD = "DEF job()\nDECL E6POS P\nDECL INT n\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n"
FRAMES = {"tools": {"1": np.eye(4)}, "work_objects": {"2": np.eye(4)}}


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (f"P={POINT}\nLIN P:OFF\n", "its target is computed"),
        (f"P={POINT}\nLIN P\nP.X=P.X+10\n", "computed, changed"),
        (f"P={POINT}\nLIN P\nQ=P\n", "uses it in another way"),
        (f"P={POINT}\nLIN P\nn=DIST(P)\n", "uses it in another way"),
        (f"P={POINT}\nP={POINT}\nLIN P\n", "computed, changed"),
        ("LIN_REL {X 10}\n", "its target is relative"),
        ("PTP $AXIS_ACT_MEAS\n", "is not declared"),
        ("LIN {X 1,Y 2}\n", "it has no Z"),
        ("LIN {X 1+n,Y 2,Z 3,A 1,B 2,C 3}\n", "some of its numbers are computed"),
        (f"P={POINT}\nLIN P\n$TOOL=TOOL_DATA[n]\nLIN P\n", "TOOL is computed in line"),
        (f"P={POINT}\nLIN P\n$BASE=EK(1,2,3)\nLIN P\n", "BASE is computed in line"),
        (f"P={POINT}\nIF n==1 THEN\n$TOOL=TOOL_DATA[3]\nENDIF\nLIN P\n", "branch or loop"),
        (f"P={POINT}\nLOOP\nLIN P\n$TOOL=TOOL_DATA[3]\nENDLOOP\n", "branch or loop"),
        (f"P={POINT}\nLOOP\n$BASE=BASE_DATA[2]\nLIN P\n$TOOL=TOOL_DATA[3]\nENDLOOP\n", "branch or loop"),
        (f"P={POINT}\nLOOP\nSLIN P WITH $TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[3]\nENDLOOP\n", "branch or loop"),
        (
            f"P={POINT}\nLOOP\nIF n==1 THEN\n$TOOL=TOOL_DATA[1]\nENDIF\nLIN P\n$TOOL=TOOL_DATA[3]\nENDLOOP\n",
            "branch or loop",
        ),
        (
            f"P={POINT}\nLOOP\nSPLINE WITH $TOOL=TOOL_DATA[1]\nSLIN P\nENDSPLINE\n$BASE=BASE_DATA[3]\nENDLOOP\n",
            "branch or loop",
        ),
        (f"P={POINT}\nLOOP\nLIN P\n$IPO_MODE=#TCP\nENDLOOP\n", "branch or loop"),
        (f"P={POINT}\nSLIN P WITH $IPO_MODE=mode\n", "the part on the robot"),
        (f"grip()\nLIN {POINT}\nEND\nDEF grip()\n$TOOL=TOOL_DATA[1]\n", "grip, called in line 6, may set the tool"),
        (f"grip()\nLIN {POINT}\nEND\nDEF grip()\nchange()\n", "grip, called in line 6, may set the tool or base"),
        ("LIN {X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224}\n", "nothing says which"),
    ],
)
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, body, reason):
    nominal, robot, _ = robots
    source = {"job.src": f"{HEAD}{body}END\n"}
    found = corrected(robot, nominal, parsed(robots, source, **FRAMES))
    assert any(reason in left.reason for left in found.unchanged_targets), found.unchanged_targets
    assert found.files["job.src"] == source["job.src"].encode()


@pytest.mark.parametrize(
    "body",
    [
        f"P={POINT}\nLIN P C_DIS\n",
        f"LIN {POINT}\n",
        f"PTP {{E6POS: {POINT[1:]}\n",
        f"P={POINT}\nSLIN P WITH $VEL.CP=1, $TOOL=TOOL_DATA[1]\n",
        f"P={POINT}\nIF n==1 THEN\nLIN P\nELSE\nPTP P\nENDIF\n",
        f"P={POINT}\nLOOP\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\nLIN P\n$TOOL=TOOL_DATA[3]\nENDLOOP\n",
        f"P={POINT}\nLOOP\nSLIN P WITH $TOOL=TOOL_DATA[1], $BASE=BASE_DATA[2]\n$BASE=BASE_DATA[3]\nENDLOOP\n",
        "PTP {A1 10,A2 -80,A3 90,A4 10,A5 20,A6 0}\nLIN {X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224}\n",
        'DECL FDAT FP={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}\nFDAT_ACT=FP\nBAS(#FRAMES)\nBAS(#TOOL,1)\n'
        f"LIN {POINT}\n",
        f"grip(TRUE)\nLIN {POINT}\nEND\nDEF grip(n:IN)\nIF (n) THEN\n$OUT[1]=TRUE\nENDIF\nWAIT SEC 1\n",
    ],
)
def test_what_can_be_corrected(robots, body):
    nominal, robot, _ = robots
    found = corrected(robot, nominal, parsed(robots, {"job.src": f"{HEAD}{body}END\n"}, **FRAMES))
    assert found.unchanged_targets == ()
    assert len(found.targets) >= 1


def test_inline_forms_are_corrected_with_the_tool_of_their_point(robots):
    nominal, robot, _ = robots
    q = well_inside(nominal, 6)
    tools = {"1": frames.transform(None, [0.0, 0.0, 0.4]), "2": TOOL}
    src, dat = ["DEF job()", "BAS(#INITMOV,0)", "$TOOL=TOOL_DATA[1]", "$BASE=$NULLFRAME"], ["DEFDAT job"]
    for k, numbers in enumerate(pose_numbers(nominal.forward(q) @ TOOL, ZYX)):
        s, t = status_and_turn(nominal, q[k])
        dat.append(f"DECL E6POS XP{k}={{{text(numbers)},S {s},T {t}}}")
        dat.append(f"DECL FDAT FP{k}={{TOOL_NO 2,BASE_NO 0,IPO_FRAME #BASE}}")
        kind, move = ("P", "PTP") if k % 2 else ("L", "LIN")
        src += [f"{kind}DAT_ACT={kind}CDAT{k}", f"FDAT_ACT=FP{k}"]
        src += [f"BAS(#{'PTP' if k % 2 else 'CP'}_PARAMS,10)", f"{move} XP{k}"]
    config = "DEFDAT $CONFIG\nDECL FDAT FDAT_ACT={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE}\nENDDAT\n"
    files = {"job.src": "\n".join([*src, "END", ""]), "job.dat": "\n".join([*dat, "ENDDAT", ""]), "$config.dat": config}
    found = corrected(robot, nominal, parsed(robots, files, tools=tools))
    assert found.unchanged_targets == ()
    new = read_back(found.files["job.dat"])
    T = poses([new[f"XP{k}"][0] for k in range(6)], ZYX) @ frames.inverse(TOOL)
    assert_same_poses(T, nominal.forward(found.q), 2e-8, 2e-7)
    assert_same_poses(robot.poses(found.q), nominal.forward(q), 2e-7, 2e-7)


def test_missing_tools_are_named(robots):
    joints = "PTP {A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}\n"
    seen = parsed(robots, {"job.src": f"{HEAD}{joints}LIN {POINT}\nEND\n"})
    ((_, line, reason),) = seen.unchanged_targets()
    assert line == 7
    assert all(words in reason for words in ("give it with --tool 1=…", "give it with --frame 2=…"))
    assert [target.kind for target in seen.targets if target.correctable] == ["joint"], "it needs no frame"
    assert (
        "--tool active=" in parsed(robots, {"job.src": f"DEF job()\nLIN {POINT}\nEND\n"}).unchanged_targets()[0].reason
    )


def test_tools_stand_in_config_dat(robots):
    config = "DEFDAT $CONFIG\nTOOL_DATA[1]={X 0,Y 0,Z 100,A 0,B 0,C 0}\nBASE_DATA[2]={X 0,Y 0,Z 0,A 0,B 0,C 0}\nE6AXIS XHOME={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nENDDAT\n"
    seen = parsed(robots, {"job.src": f"{HEAD}PTP XHOME\nLIN {POINT}\nEND\n", "$config.dat": config})
    np.testing.assert_allclose(seen.tools["1"][:3, 3], [0, 0, 0.1], rtol=0, atol=1e-12)
    assert [target.name for target in seen.targets if target.correctable] == ["LIN in line 7 of job.src"]


def test_a_backup_of_kuka_is_one_program_with_modules_of_one_name(robots, tmp_path):
    """Points are those of the .dat beside; the system's own programs are passed over, its tools are used."""
    nominal, _, at = robots
    files = {
        "KRC/R1/System/$config.dat": "DEFDAT $CONFIG\nTOOL_DATA[1]={X 0,Y 0,Z 100,A 0,B 0,C 0}\nENDDAT\n",
        "KRC/R1/System/bas.src": "DEF BAS()\nPTP $AXIS_ACT\nEND\n",
        "KRC/STEU/Mada/$machine.dat": "DEFDAT $MACHINE\nENDDAT\n",
        "KRC/R1/Program/a/job.src": f"{HEAD}LIN XP1\nEND\n",
        "KRC/R1/Program/a/job.dat": f"DEFDAT job\nDECL E6POS XP1={POINT}\nENDDAT\n",
        "KRC/R1/Program/b/job.src": f"{HEAD}LIN XP1\nLIN P9\nEND\n",
        "KRC/R1/Program/b/job.dat": f"DEFDAT job\nDECL E6POS XP1={POINT}\nDECL GLOBAL E6POS P9={POINT}\nENDDAT\n",
        "KRC/R1/Program/c.dat": f"DEFDAT c\nDECL GLOBAL E6POS P9={POINT}\nENDDAT\n",
        "KRC/R1/Program/d.src": 'DEF d()\nMsgNotify("x\nEND\n',
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    setup = given(at, work_objects=FRAMES["work_objects"])
    seen, unread = krl.read_for(nominal, [tmp_path / name for name in files], setup)
    assert [target.name for target in seen.targets if target.correctable] == ["XP1 of job.dat"] * 2
    assert {(left.target, left.line) for left in seen.unchanged_targets()} == {("P9 of job.dat", 3), ("LIN P9", 7)}
    assert unread.source.endswith("d.src")
    assert "string" in unread.reason


def test_a_data_list_alone_asks_for_its_program(robots, tmp_path):
    (tmp_path / "job.dat").write_text(f"DEFDAT job\nDECL E6POS XP1={POINT}\nENDDAT\n")
    with pytest.raises(ProgramError, match=r"give its program, too \(job\.src\)"):
        krl.read_for(robots[0], [tmp_path / "job.dat"], given(robots[2]))


@pytest.mark.parametrize("home", ["XHOME", "$H_POS", "xHome1"])
def test_the_controllers_own_joint_targets_are_noted_and_stop_nothing(robots, home):
    """Every ordinary program begins and ends there."""
    seen = parsed(robots, {"job.src": f"{HEAD}PTP {home}\nLIN {POINT}\nPTP {home} C_PTP\nEND\n"}, **FRAMES)
    assert len(seen.correctable()) == 1
    assert seen.unchanged_targets() == []
    assert [(note.line, "left as it was" in note.text) for note in seen.notes] == [(6, True), (8, True)]
    mine = f"{HEAD}E6AXIS XHOME={{A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}}\nPTP XHOME\nEND\n"
    assert len(parsed(robots, {"job.src": mine}).correctable()) == 1, "one that the program declares is a target"


def test_the_check_pair_of_a_posted_controller_line(robots):
    """HOME has S 2 and T 2, and the flange looks forward: A B C = 0 90 0."""
    nominal = robots[0]
    q = np.radians([0, -90, 90, 0, 0, 0])
    assert status_and_turn(nominal, q) == (2, 2)
    np.testing.assert_allclose(
        nominal.forward(q[None])[0, :3, :3], poses([0, 0, 0, 0, 90, 0], ZYX)[0, :3, :3], rtol=0, atol=1e-12
    )


def test_other_arms_are_refused(robots):
    other = robot_of("m20ia")
    with pytest.raises(ProgramError, match=r"point along -z \+y \+y -x \+y -x at zero joints"):
        krl.KUKA.check(other[0], "job.src")


NUMBER = st.floats(-150, 150).map(lambda v: f"{v:.4f}")


@settings(max_examples=40, deadline=None)
@hypothesis_given(
    st.lists(
        st.tuples(
            st.lists(NUMBER, min_size=6, max_size=6),
            st.sampled_from(["PTP", "LIN", "slin", "Sptp"]),
            st.sampled_from(["", " ", "\t "]),
            st.booleans(),
        ),
        min_size=1,
        max_size=6,
    ),
    st.sampled_from(["\n", "\r\n"]),
)
def test_generated_programs_keep_their_bytes(robots, points, newline):
    nominal, robot, _ = robots
    lines = ["DEF gen()", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME"]
    for numbers, move, blank, joint in points:
        names = "A1 A2 A3 A4 A5 A6" if joint else "X Y Z A B C"
        inside = ",".join(f"{blank}{n} {v}" for n, v in zip(names.split(), numbers, strict=True))
        lines.append(f"{blank}{move} {{{inside}{'' if joint else ',S 2,T 2'}}}{blank};{move}")
    data = newline.join([*lines, "END"]).encode()
    seen = parsed(robots, {"gen.src": data})
    assert seen.listing.files_with([]) == {"gen.src": data}
    assert len(seen.targets) == len(points)
    found = corrected(robot, nominal, seen)
    blank = re.compile(rb"[-+\d.]+")
    kept = found.files["gen.src"].replace(f"; irbcal: fake targets, calibration abc123{newline}".encode(), b"")
    assert blank.sub(b"#", kept) == blank.sub(b"#", data)


def test_damaged_programs_end_in_a_refusal_or_a_result(robots):
    nominal, robot, _ = robots
    files = program(nominal, well_inside(nominal, 2))
    whole = (files["job.dat"] + files["job.src"]).encode("latin-1")
    check_damaged(
        whole,
        lambda data: parsed(robots, {"job.src": data}, **FRAMES),
        lambda seen: corrected(robot, nominal, seen),
    )


def lines(text):
    return lines_of(Listing([("a.src", text.encode("latin-1"))], "KUKA KRL"))


def test_lines_words_and_comments():
    found, comments = lines('\xef\xbb\xbfDEF  Job()\r\n\t; fold\r\nLIN {X -1.5E-3} C_DIS ; "x\r\nMsg("a;b")\n')
    assert [[token.word for token in line.tokens] for line in found] == [
        ["def", "job", "(", ")"],
        ["lin", "{", "x", "-", "1.5e-3", "}", "c_dis"],
        ["msg", "(", '"a;b"', ")"],
    ]
    assert comments == ["; fold", '; "x']


@pytest.mark.parametrize(
    ("text", "value", "length"),
    [
        ("-1.5", -1.5, 4),
        ("+ .5", 0.5, 4),
        ("7", 7, 1),
        ("1.51745229E-12", 1.51745229e-12, 14),
        ("--1", None, 0),
        ("x", None, 0),
    ],
)
def test_numbers_with_their_signs(text, value, length):
    (line,), _ = lines(text)
    number = line.number()
    if value is None:
        assert number is None
        assert line.at == 0
    else:
        assert (number.value, number.start, number.end) == (value, 0, length)


def test_indices():
    (line,), _ = lines("[1,2] [n] x [3")
    assert line.index() == (1, 2)
    assert line.index() is None
    assert line.index() == ()
    line.at += 1
    assert line.index() == (3,)
    assert line.next is END


def test_open_strings_are_refused():
    with pytest.raises(ProgramError, match=r"a.src: line 2: the string is not closed"):
        lines('x\nmsg("abc\n')


P = "{X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2}"


def read(text, name="job.dat"):
    listing = Listing([(name, text.encode("latin-1"))], "KUKA KRL")
    data = KrlData(listing, [name.split(".", maxsplit=1)[0]])
    lines, _ = lines_of(listing)
    taken = [data.declaration(line) for line in lines]
    data.collect()
    return data, taken


@pytest.mark.parametrize(
    "text",
    [
        f"DECL E6POS XP1={P}",
        f"GLOBAL DECL E6POS XP1={P}",
        f"DECL GLOBAL E6POS Xp1={P}",
        f"e6pos xp1 = {P}",
        f"decl pos n, xP1={P}, m",
        f"DECL E6POS XP1={{E6POS: {P[1:]}",
    ],
)
def test_declarations(text):
    data, taken = read(text)
    assert taken == [True]
    (found,) = data.lookup(0, "xp1").targets.values()
    assert [number.value for number in found.numbers] == [1, 2, 3, 4, 5, 6]
    assert found.configuration.complete


def test_arrays_and_other_lines():
    data, taken = read(f"DECL FRAME v[3]\nDECL INT n=3\nLIN v\nENUM a b\nDECL E6POS q[2]={P}\n")
    assert taken == [True, True, False, True, True]
    assert data.lookup(0, "v").targets == {}
    assert list(data.lookup(0, "q").targets) == [(2,)]


def test_components_keep_their_places():
    text = "{E6POS: X 1.50, Y - 2 ,Z n+1,T 'B010'}"
    listing = Listing([("a.src", text.encode())], "KUKA KRL")
    (line,), _ = lines_of(listing)
    one = aggregate(line, listing)
    assert one.type == "e6pos"
    assert {key: text[v.start : v.end] for key, v in one.values.items()} == {
        "x": "1.50",
        "y": "- 2",
        "z": "n+1",
        "t": "'B010'",
    }
    assert one.values["y"].number.value == -2
    assert one.values["z"].number is None
    assert target("p", "", one, listing) == (None, "it has no A, so that the value before stays")


def test_positions_of_external_axes():
    """All that stand there, zero, too; where a component is missing, the value before stays."""
    data, _ = read("DECL E6POS p={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 2,E1 0.0,E2 -12.5}")
    (found,) = data.lookup(0, "p").targets.values()
    assert (found.e, found.external) == ({"e1": 0.0, "e2": -12.5}, "-12.5")


@pytest.mark.parametrize(
    ("status", "turn", "reason"), [("x", "2", "no number"), ("2", "16", "contradict"), ("6", "16", "")]
)
def test_status_and_turn(status, turn, reason):
    data, _ = read(f"DECL POS p={{X 1,Y 2,Z 3,A 4,B 5,C 6,S {status},T {turn}}}")
    (found,) = data.lookup(0, "p").targets.values()
    assert (reason in "".join(found.conflicts)) if reason else not found.conflicts


def run(*lines):
    listing = Listing([("job.src", "\n".join(lines).encode())], "KUKA KRL")
    data = KrlData(listing, ["job"])
    statements = Statements(listing, data)
    for line in lines_of(listing)[0]:
        if not data.declaration(line):
            statements.statement(line)
    statements.conclude()
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
        assert run(line).flow.state.tool == tool, line
    assert run("BAS(#BASE,2)").flow.state.frame == "2"
    assert run("$BASE=TOOL_DATA[2]").flow.state.frame is None
    literal = run("$BASE={X 1000,Y 0,Z 0,A 90,B 0,C 0}")
    assert literal.frames[literal.flow.state.frame][0, 3] == 1.0


def test_stops_follow_one_another_until_the_program_branches():
    stops = run(f"PTP {P}", f"LIN {P}", "IF x THEN", f"LIN {P}", "ENDIF", f"LIN {P}", f"CIRC {P},{P}").flow.stops
    assert [before not in (None, START) for _, _, before in stops] == [False, True, False, False, True]
    assert stops[0][2] is START


def test_a_program_begins_at_the_start_behind_what_all_of_them_begin_with():
    head = ["GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )", "INTERRUPT ON 3", "BAS (#INITMOV,0 )"]
    stops = run(
        *head, f"LIN {P}", "CONTINUE", "WAIT SEC 0.5", "IF $IN[1] THEN", "PULSE ($OUT[1],TRUE,1)", "ENDIF", f"LIN {P}"
    )
    (_, _, first), (_, _, second) = stops.flow.stops
    assert first is START
    assert second is stops.flow.stops[0][1]
    assert run(*head, "move_it ( )", f"LIN {P}").flow.stops[0][2] is None
    assert run(f"LIN {P}", "INTERRUPT ON 3", f"LIN {P}").flow.stops[1][2] is None


def test_circles_have_a_point_on_the_way():
    done = run(f"CIRC {P},{P},CA 90")
    assert [[use.role for use in found.uses] for found in done.literals] == [["via"], ["to"]]
    assert run("CIRC {X 1}").flow.unchanged_moves[-1].reason == "its end point is missing"


FP1, FP2 = "DECL FDAT FP1={TOOL_NO 1,BASE_NO 5,IPO_FRAME #BASE}", "DECL FDAT FP2={TOOL_NO 2,BASE_NO 0,IPO_FRAME #BASE}"
FIXED = "DECL FDAT FP3={TOOL_NO 3,BASE_NO 1,IPO_FRAME #TCP}"
BEFORE = ("$TOOL=TOOL_DATA[7]", "$BASE=BASE_DATA[8]")


@pytest.mark.parametrize(
    ("lines", "tool", "base"),
    [
        # inline forms of KSS 8: PTP_PARAMS and CP_PARAMS of KUKA's bas.src call FRAMES()
        ((FP1, "FDAT_ACT=FP1", "BAS(#PTP_PARAMS,100)", "PTP {P}"), "1", "5"),
        ((FP2, "FDAT_ACT=FP2", "BAS (#CP_PARAMS, 0.2)", "LIN {P}"), "2", "0"),
        # of KSS 5: PTP_DAT sets speeds alone, FRAMES the rest
        ((FP1, "BAS(#PTP_DAT)", "FDAT_ACT=FP1", "BAS(#FRAMES)", "BAS(#VEL_PTP,100)", "PTP {P}"), "1", "5"),
        (("FDAT_ACT={TOOL_NO 4,BASE_NO 0,IPO_FRAME #BASE}", "BAS(#FRAMES)", "LIN {P}"), "4", "0"),
        # what is set afterwards holds, until BAS takes FDAT_ACT again
        ((FP1, "FDAT_ACT=FP1", "BAS(#FRAMES)", "$TOOL=TOOL_DATA[9]", "LIN {P}"), "9", "5"),
        ((FP1, "FDAT_ACT=FP1", "BAS(#FRAMES)", "$TOOL=TOOL_DATA[9]", "BAS(#CP_PARAMS,1)", "LIN {P}"), "1", "5"),
        ((FP1, "FDAT_ACT=FP1", "SLIN {P} WITH $TOOL=TOOL_DATA[3], $BASE=BASE_DATA[2]"), "3", "2"),
        (("BAS(#VEL_PTP,20)", "BAS(#ACC_CP,20)", "LIN {P}"), "7", "8"),
        (("BAS(#INITMOV,0)", "LIN {P}"), "active", "active"),
    ],
)
def test_inline_forms_set_tool_and_base(lines, tool, base):
    use = run(*BEFORE, *lines_with_point(lines)).literals[-1].uses[-1]
    assert (use.tool, use.work_object) == (tool, base)


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ((FP1, "FDAT_ACT=FP1", "BAS(#PTP_DAT)", "LIN {P}"), "FDAT_ACT names tool 1 and base 5"),
        ((FP1, "FDAT_ACT=FP1", "SLIN {P} WITH $VEL.CP=1"), "FDAT_ACT names tool 1 and base 5"),
        (("BAS(#PTP_PARAMS,100)", "LIN {P}"), "FDAT_ACT, which is not set"),
        ((FP1, "FDAT_ACT=FP1", "IF n THEN", "FDAT_ACT=x", "ENDIF", "BAS(#FRAMES)", "LIN {P}"), "FDAT_ACT, which is"),
        ((FP1, "FDAT_ACT=FP1", "FDAT_ACT.TOOL_NO=2", "BAS(#FRAMES)", "LIN {P}"), "a part of FDAT_ACT is set"),
        (("FDAT_ACT=FP9", "BAS(#CP_PARAMS,1)", "LIN {P}"), "FP9 are not in these files"),
        ((FIXED.replace("#TCP", "mode"), "FDAT_ACT=FP3", "BAS(#CP_PARAMS,1)", "LIN {P}"), "the part on the robot"),
        (("BAS(#EX_BASE,n)", "LIN {P}"), "external axis"),
        (("BAS(n,2)", "LIN {P}"), "computes the tool or base"),
        (("grip()", "LIN {P}"), "grip, called in line 3, may set the tool or base"),
        ((FP1, "FDAT_ACT=FP1", "grip()", "BAS(#FRAMES)", "LIN {P}"), "FDAT_ACT, which is not set"),
        (("$IPO_MODE=mode", "LIN {P}"), "the part on the robot"),
        (("$TOOL.X=5", "LIN {P}"), "a part of $TOOL is set in line 3"),
        (("$BASE.A=5", "LIN {P}"), "a part of $BASE is set in line 3"),
        (("LIN {P}", "TOOL_DATA[7].X=5"), "changes TOOL_DATA[7]"),
        (("LIN {P}", "BASE_DATA[n]=$POS_ACT"), "changes BASE_DATA[8]"),
        (("BASE_DATA[8]={P}", "LIN {P}", "BASE_DATA[8]={X 9,Y 0,Z 0,A 0,B 0,C 0}"), "changes BASE_DATA[8]"),
        (("SPLINE WITH $TOOL=TOOL_DATA[1]", "SPL {P}", "ENDSPLINE", "LIN {P}"), "spline block"),
    ],
)
def test_moves_whose_tool_is_in_doubt_are_refused(lines, reason):
    target = run(*BEFORE, *lines_with_point(lines)).literals[-1]
    assert any(reason in text for text in target.conflicts), target.conflicts


def lines_with_point(lines):
    return [line.replace("{P}", P) for line in lines]


LINE = "PTP {A1 10.0000, A2 -60.0000, A3 95.5000, A4 20.0000, A5 30.1250, A6 -40.0000}"


def test_joints_rests_and_speeds():
    files = written("krl", "kr120r2500pro")
    text = files["plan.src"]
    assert LINE in text
    assert text.isascii()
    assert LINE + "\r\nWAIT SEC 4.5\r\n" in text
    assert text.count("BAS (#VEL_PTP,25)") == 1


@pytest.mark.parametrize("angles", [(-10, 20, -30, 40, -50, 60), (1, -2, 3, -4, 5, -6), (0, 0, 0, 0, 0, 0), (-1,) * 6])
@pytest.mark.parametrize("back", [True, False])
@pytest.mark.parametrize("bent", [True, False])
def test_status_and_turn_of_joints(angles, back, bent):
    turn = int("".join("1" if angle < 0 else "0" for angle in reversed(angles)), 2)
    status = (1 if back else 0) + (0 if bent else 2)
    found = KrlProgram.posture(None, back, bent, False, np.radians(angles))
    assert found == posture_of(status, turn)
    assert found != posture_of(status, turn ^ 1)
