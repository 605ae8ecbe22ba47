"""KUKA KRL: what is read, what is left, and what the corrected numbers are."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import corrected, damaged, given, pose_numbers, poses, robot_of, well_inside
from support import assert_same_poses

from irbcal.correction.languages import krl
from irbcal.correction.languages.krl import reader
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
    return reader.parse(
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
    assert found.left == ()
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
    assert blank.sub(b"#", found.files["job.dat"]) == blank.sub(b"#", files["job.dat"].encode("latin-1"))
    again = parsed(robots, found.files)
    assert again.fingerprint == "abc123"
    with pytest.raises(ProgramError, match="these are fake targets already for calibration abc123"):
        corrected(robot, nominal, again)
    assert krl.fingerprint(found.files["job.src"]) == "abc123"
    with pytest.raises(ValueError, match="one word"):
        corrected(robot, nominal, parsed(robots, files), "abc\nHALT")


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "cp437"])
def test_unchanged_programs_are_the_same_bytes(robots, newline, encoding):
    data = program(robots[0], well_inside(robots[0], 2), newline)["job.dat"].replace("point", "Größe").encode(encoding)
    seen = parsed(robots, {"job.dat": data})
    assert seen.listing.files_with([]) == {"job.dat": data}


P = "{X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224,S 2,T 2,E1 0}"
HEAD = "DEF job()\nDECL E6POS P\nDECL INT n\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n"
FRAMES = {"tools": {"1": np.eye(4)}, "work_objects": {"2": np.eye(4)}}


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (f"P={P}\nLIN P:OFF\n", "its target is computed"),
        (f"P={P}\nLIN P\nP.X=P.X+10\n", "computed, changed"),
        (f"P={P}\nLIN P\nQ=P\n", "uses it in another way"),
        (f"P={P}\nLIN P\nn=DIST(P)\n", "uses it in another way"),
        (f"P={P}\nP={P}\nLIN P\n", "computed, changed"),
        ("LIN_REL {X 10}\n", "its target is relative"),
        ("PTP $AXIS_ACT\n", "is not declared"),
        ("LIN {X 1,Y 2}\n", "it has no Z"),
        ("LIN {X 1+n,Y 2,Z 3,A 1,B 2,C 3}\n", "some of its numbers are computed"),
        (f"P={P}\nLIN P\n$TOOL=TOOL_DATA[n]\nLIN P\n", "TOOL is computed in line"),
        (f"P={P}\nLIN P\n$BASE=EK(1,2,3)\nLIN P\n", "BASE is computed in line"),
        (f"P={P}\nIF n==1 THEN\n$TOOL=TOOL_DATA[3]\nENDIF\nLIN P\n", "branch or loop"),
        (f"P={P}\nLOOP\nLIN P\n$TOOL=TOOL_DATA[3]\nENDLOOP\n", "branch or loop"),
        (f"P={P}\nSLIN P WITH $IPO_MODE=#TCP\n", "the part on the robot"),
        ("LIN {X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224}\n", "nothing says which"),
    ],
)
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, body, reason):
    nominal, robot, _ = robots
    source = {"job.src": f"{HEAD}{body}END\n"}
    found = corrected(robot, nominal, parsed(robots, source, **FRAMES))
    assert any(reason in left.reason for left in found.left), found.left
    assert found.files["job.src"] == source["job.src"].encode()


@pytest.mark.parametrize(
    "body",
    [
        f"P={P}\nLIN P C_DIS\n",
        f"LIN {P}\n",
        f"PTP {{E6POS: {P[1:]}\n",
        f"P={P}\nSLIN P WITH $VEL.CP=1, $TOOL=TOOL_DATA[1]\n",
        f"P={P}\nIF n==1 THEN\nLIN P\nELSE\nPTP P\nENDIF\n",
        "PTP {A1 10,A2 -80,A3 90,A4 10,A5 20,A6 0}\nLIN {X 1675.117,Y -311.39,Z 1471.544,A -174.596,B 53.668,C -163.224}\n",
        'DECL FDAT FP={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}\nFDAT_ACT=FP\nBAS(#FRAMES)\nBAS(#TOOL,1)\n'
        f"LIN {P}\n",
    ],
)
def test_what_can_be_corrected(robots, body):
    nominal, robot, _ = robots
    found = corrected(robot, nominal, parsed(robots, {"job.src": f"{HEAD}{body}END\n"}, **FRAMES))
    assert found.left == ()
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
    assert found.left == ()
    new = read_back(found.files["job.dat"])
    T = poses([new[f"XP{k}"][0] for k in range(6)], ZYX) @ frames.inverse(TOOL)
    assert_same_poses(T, nominal.forward(found.q), 2e-8, 2e-7)
    assert_same_poses(robot.poses(found.q), nominal.forward(q), 2e-7, 2e-7)


def test_missing_tools_are_named(robots):
    with pytest.raises(ProgramError, match=r"job.src: line 6: .* uses the tool 1.*--tool 1=… \(also: --frame 2=\)"):
        parsed(robots, {"job.src": f"{HEAD}LIN {P}\nEND\n"})
    with pytest.raises(ProgramError, match="tool active"):
        parsed(robots, {"job.src": f"DEF job()\nLIN {P}\nEND\n"})


def test_tools_stand_in_config_dat(robots):
    config = "DEFDAT $CONFIG\nTOOL_DATA[1]={X 0,Y 0,Z 100,A 0,B 0,C 0}\nBASE_DATA[2]={X 0,Y 0,Z 0,A 0,B 0,C 0}\nE6AXIS XHOME={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nENDDAT\n"
    seen = parsed(robots, {"job.src": f"{HEAD}PTP XHOME\nLIN {P}\nEND\n", "$config.dat": config})
    np.testing.assert_allclose(seen.tools["1"][:3, 3], [0, 0, 0.1], rtol=0, atol=1e-12)
    assert any("other programs share" in note.text for note in seen.notes)
    assert [target.name for target in seen.targets if target.correctable] == ["of LIN in line 7 of job.src"]


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
        krl.MAKER.check(other[0], "job.src")


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
    done = 0
    for k, data in enumerate(damaged(whole, 300)):
        try:
            seen = parsed(robots, {"job.src": data}, **FRAMES)
            if k % 10 == 0:
                corrected(robot, nominal, seen)
            done += 1
        except ProgramError:
            pass
    assert done > 50
