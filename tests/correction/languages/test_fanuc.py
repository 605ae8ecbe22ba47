"""Moves as FANUC: what is written, and that it is read again."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import check_damaged, corrected, given, pose_numbers, poses, robot_of, well_inside
from moves_cases import written
from support import assert_same_poses

from irbcal.correction.languages import fanuc
from irbcal.correction.languages.fanuc import instructions, points, sections
from irbcal.correction.listing import Listing
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames

LINE = "J1=   10.0000 deg,\tJ2=  -60.0000 deg,\tJ3=  155.5000 deg,"


def test_joints_rests_and_speeds():
    files = written("fanuc", "m20ia")
    text = files["plan.ls"]
    assert LINE in text
    assert text.isascii()
    assert "J P[2] 25% FINE ;\r\n   7:  WAIT   4.50(sec) ;" in text


TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
USER = frames.from_xyz_angles([0.5, 0.1, 0.3, 0.0, 0.1, 0.2])
FRAMES = {"tools": {"1": TOOL}, "work_objects": {"2": USER}}


@pytest.fixture(scope="module")
def robots():
    return robot_of("m20ia", size=0.05)


def pendant(q):
    """Joints as the pendant shows them, degrees: J3 against the horizontal."""
    j = np.degrees(q)
    j[..., 2] -= j[..., 1]
    return j


def config(q):
    """CONFIG of joints with the wrist in front and the elbow up."""
    turns = [int(np.floor((np.degrees(q[k]) + 180) / 360)) for k in (0, 3, 5)]
    return f"{'N' if q[4] < 0 else 'F'} U T, {turns[0]}, {turns[1]}, {turns[2]}"


def point(number, values, conf=None, uf=2, ut=1):
    head = f"P[{number}]{{\n   GP1:\n\tUF : {uf}, UT : {ut},"
    if conf is None:
        names = [f"J{k}" for k in range(1, 7)]
        fields = [f"\t{n}={v:10.3f} deg" for n, v in zip(names, values, strict=True)]
        body = "\n" + ",".join(fields[:3]) + ",\n" + ",".join(fields[3:])
    else:
        fields = [f"\t{n} = {v:9.3f}  {u}" for n, v, u in zip("XYZWPR", values, ["mm"] * 3 + ["deg"] * 3, strict=True)]
        body = f"\t\tCONFIG : '{conf}',\n" + ",".join(fields[:3]) + ",\n" + ",".join(fields[3:])
    return head + body + "\n};\n"


def listing(lines, points, newline="\n"):
    numbered = "".join(f"{k:4d}:{line} ;\n" for k, line in enumerate(lines, start=1))
    text = f'/PROG  JOB\n/ATTR\nCOMMENT\t\t= "Größe";\nLINE_COUNT\t= 0;\n/MN\n{numbered}/POS\n{"".join(points)}/END\n'
    return text.replace("\n", newline).encode("latin-1")


def in_front(nominal, n):
    """Joints with the wrist in front and the elbow up."""
    q = well_inside(nominal, 6 * n)
    back, bent, _ = fanuc.FANUC.postures(nominal, q)
    return q[~back & ~bent][:n]


def program(nominal, at, q, newline="\n"):
    T = frames.inverse(USER) @ frames.inverse(at.T_base_world) @ nominal.forward(q) @ TOOL
    lines, points = ["  !  moves", "  UFRAME_NUM=2"], []
    for k, (joints, numbers) in enumerate(zip(pendant(q), pose_numbers(T, "xyz"), strict=True)):
        points += [point(2 * k + 1, joints), point(2 * k + 2, numbers, config(q[k]))]
        lines += [f"J P[{2 * k + 1}] 50% FINE    ", f'L P[{2 * k + 2}:"x"] 100mm/sec CNT10    ']
    return listing(lines, points, newline)


def parsed(robots, data, **more):
    nominal, _, at = robots
    return fanuc.parse(nominal, data, "job.ls", given(at, **(more or FRAMES)))


def read_back(data):
    out = {}
    for number, body in re.findall(r"P\[(\d+)\]\{(.*?)\};", data.decode("latin-1"), re.DOTALL):
        values = dict(re.findall(r"\b([A-Z]\d?)\s*=\s*(-?[\d.]+)", body))
        names = [f"J{k}" for k in range(1, 7)] if "J1" in values else "XYZWPR"
        found = re.search("CONFIG : '(.*?)'", body)
        out[int(number)] = np.array([float(values[name]) for name in names]), found[1] if found else None
    return out


def test_the_robot_goes_where_it_was_meant_to(robots):
    nominal, robot, at = robots
    q = in_front(nominal, 30)
    seen = parsed(robots, program(nominal, at, q))
    found = corrected(robot, nominal, seen)
    assert found.unchanged_targets == ()
    assert len(found.targets) == 60
    wanted = nominal.forward(q)
    new = read_back(found.data)
    joints = np.radians([new[2 * k + 1][0] for k in range(30)])
    joints[:, 2] += joints[:, 1]
    # 0.001 degrees in each of six joints at up to 2 m, and 0.001 mm
    assert_same_poses(robot.poses(joints), wanted, 6e-5, 3e-5)
    T = at.T_base_world @ USER @ poses([new[2 * k + 2][0] for k in range(30)], "xyz") @ frames.inverse(TOOL)
    assert_same_poses(T, nominal.forward(found.q[30:]), 1e-5, 2e-5)
    assert_same_poses(robot.poses(found.q[30:]), wanted, 6e-5, 3e-5)
    assert np.abs(found.q_before[30:] - q).max() < 2e-3, "CONFIG names the joints that were meant"
    assert [new[2 * k + 2][1] for k in range(30)] == [config(found.q[30 + k]) for k in range(30)]


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_lines_without_numbers_are_lines_of_their_own(robots, newline):
    """Exports of some controllers number no line; a line goes on only where no ``;`` ended the one before."""
    nominal, robot, _ = robots
    lines = ["J P[1] 10% FINE", "! a remark", "C P[2]\n    :  P[3] 50mm/sec FINE", "L P[4] 9mm/sec FINE\n    :  ACC50"]
    q = in_front(nominal, 4)
    joints = [point(k, pendant(row)) for k, row in enumerate(q, start=1)]
    numbered = listing(lines, joints, newline)
    blank = re.sub(rb"(?m)^ +\d+:", b"    :", numbered)
    assert blank != numbered
    seen, plain = (parsed(robots, data) for data in (blank, numbered))
    assert [len(target.uses) for target in seen.targets] == [1] * 4
    assert [(stop.target, stop.previous) for stop in seen.order] == [(0, None), (2, 0), (3, 2)]
    assert [(use.role, use.instruction) for t in seen.targets for use in t.uses] == [
        (use.role, use.instruction) for t in plain.targets for use in t.uses
    ]
    one, other = (corrected(robot, nominal, program).data for program in (seen, plain))
    assert one.split(b"/POS")[1] == other.split(b"/POS")[1]
    assert b"    :  !irbcal fake targets ;" in one
    assert fanuc.LANGUAGE.fingerprint(one) == "abc123"


def test_a_turn_is_rewritten_where_the_joint_crosses_it(robots):
    nominal, robot, at = robots
    q = in_front(nominal, 1)
    for joint in (179.999, -179.999, 180.2, -180.2):
        q[0, 5] = np.radians(joint)
        found = corrected(robot, nominal, parsed(robots, program(nominal, at, q)))
        assert found.unchanged_targets == ()
        assert abs(np.degrees(found.q[1, 5]) - joint) < 3
        assert read_back(found.data)[2][1] == config(found.q[1])


def test_only_numbers_change_and_stay_in_their_columns(robots):
    nominal, robot, at = robots
    data = program(nominal, at, in_front(nominal, 3), "\r\n")
    found = corrected(robot, nominal, parsed(robots, data))
    mark = b"   9:  !irbcal fake targets ;\r\n  10:  !abc123 ;\r\n"
    assert found.data.count(mark) == 1
    kept = found.data.replace(mark, b"")
    blank = re.compile(rb"[-+\d.]+")
    assert [len(line) for line in kept.splitlines()] == [len(line) for line in data.splitlines()]
    assert blank.sub(b"#", kept).split() == blank.sub(b"#", data).split()
    assert fanuc.LANGUAGE.fingerprint(found.data) == "abc123"
    with pytest.raises(ProgramError, match="calibration abc123"):
        corrected(robot, nominal, parsed(robots, found.data))


GOOD = [1525.0, 100.0, 800.0, 170.0, -10.0, 20.0]


@pytest.mark.parametrize(
    ("lines", "points", "reason"),
    [
        (["L PR[1] 10mm/sec FINE"], [], "position register"),
        (["L P[7] 10mm/sec FINE"], [], "not in the /POS section"),
        (["L P[1] 10mm/sec FINE INC"], [point(1, GOOD, "N U T, 0, 0, 0")], "relative"),
        (["L P[1] 10mm/sec FINE RTCP"], [point(1, GOOD, "N U T, 0, 0, 0")], "fixed tool"),
        (["L P[1] 10mm/sec FINE", "  PR[1]=P[1]"], [point(1, GOOD, "N U T, 0, 0, 0")], "in another way"),
        (["L P[1] 10mm/sec FINE", "  P[R[1]]=PR[1]"], [point(1, GOOD, "N U T, 0, 0, 0")], "in another way"),
        (["L P[1] 10mm/sec FINE", "  UFRAME[2]=PR[1]"], [point(1, GOOD, "N U T, 0, 0, 0")], "changes UFRAME"),
        (["L P[1] 10mm/sec FINE"], [point(1, GOOD, "N U B, 0, 0, 0")], "says B"),
        (["L P[1] 10mm/sec FINE"], [point(1, GOOD, "L, 0, 0, 0")], "another kind of arm"),
        (["L P[1] 10mm/sec FINE"], [point(1, GOOD, "")], "is empty"),
        (["L P[1] 10mm/sec FINE"], [point(1, GOOD, "N U T, 0, 0, 0", uf="F")], "no user frame"),
        (["L P[1] 10mm/sec FINE"], [point(1, GOOD, "N U T, 0, 0, 0").replace("1525.000", "********")], "not taught"),
        (["L P[1] 10mm/sec FINE"], [re.sub(r"\b([XYZWPR]) =", r"R\1 =", point(1, GOOD, "N U T, 0, 0, 0"))], "remote-TCP"),
        (["C P[1]    :  P[9] 10mm/sec"], [point(1, GOOD, "N U T, 0, 0, 0")], "not in the /POS section"),
    ],
)  # fmt: skip
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, lines, points, reason):
    nominal, robot, _ = robots
    found = corrected(robot, nominal, parsed(robots, listing(lines, points)))
    assert any(reason in left.reason for left in found.unchanged_targets), found.unchanged_targets


def test_what_belongs_to_other_languages_and_groups(robots):
    nominal, robot, at = robots
    q = in_front(nominal, 2)
    data = program(nominal, at, q).replace(b"CONFIG", b"KONFIG").replace(b"UFRAME_NUM", b"BENUTZER_NUM")
    data = data.replace(b"\n};\n", b"\n   GP2:\n\tUF : 0, UT : 1,\n\tJ1=     5.000 mm\n};\n")
    data = data.replace(b"CNT10     ;", b"CNT10\n    :  Offset,PR[1]    ;")
    found = corrected(robot, nominal, parsed(robots, data))
    assert found.unchanged_targets == ()
    assert len(found.targets) == 4
    assert found.data.count(b"J1=     5.000 mm") == 4
    texts = [note.text for note in found.notes]
    assert any("offset" in text for text in texts)
    assert any("external axes" in text for text in texts)


def test_frames_are_asked_for(robots):
    nominal, _, at = robots
    data = program(nominal, at, in_front(nominal, 1))
    ((_, _, reason),) = parsed(robots, data, tools={}).unchanged_targets()
    assert all(words in reason for words in ("give it with --tool 1=…", "give it with --frame 2=…"))
    ((_, _, reason),) = fanuc.parse(nominal, data, "job.ls", given(unknown_frames(), **FRAMES)).unchanged_targets()
    assert "has no link base" in reason
    joints_only = listing(["J P[1] 10% FINE"], [point(1, pendant(in_front(nominal, 1))[0])])
    assert len(fanuc.parse(nominal, joints_only, "job.ls", given(unknown_frames())).targets) == 1


def test_tools_and_frames_of_a_backup_stand_beside_its_programs(robots, tmp_path):
    nominal, _, at = robots
    data = program(nominal, at, in_front(nominal, 2))

    def element(index, T, group=1):
        x, y, z, w, p, r = pose_numbers(T[None], "xyz")[0]
        return (
            f"     [{index}] = \n  Group: {group}   Config: N D B, 0, 0, 0\n"
            f"  X: {x:12.6f}   Y: {y:12.6f}   Z: {z:12.6f}\n  W: {w:12.6f}   P: {p:12.6f}   R: {r:12.6f}\n"
        )

    other = frames.from_xyz_angles([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    untaught = "     [1,3] = \n  Group: 1\n  X: ********   Y: ********   Z: ********\n"
    text = "[*SYSTEM*]$MNUFRAME  Storage: CMOS  Access: RW  : ARRAY[2,9] OF POSITION = \n"
    text += element("1,1", other) + element("1,2", USER) + untaught + element("2,2", other, 2)
    text += "[*SYSTEM*]$MNUFRAMENUM  Storage: CMOS  Access: RW  : ARRAY[2] OF BYTE\n     [1] = 5\n"
    text += "[*SYSTEM*]$MNUTOOL  Storage: SHADOW  Access: RW  : ARRAY[2,10] OF POSITION\n"
    text += element("1,1", TOOL) + element("1,2", other) + element("2,1", other, 2)
    (tmp_path / "SYSFRAME.VA").write_bytes(text.replace("\n", "\r\n").encode())
    (tmp_path / "job.ls").write_bytes(data)
    (seen,) = fanuc.read_for(nominal, [tmp_path / "job.ls"], given(at))
    known = parsed(robots, data)
    assert seen.unchanged_targets() == []
    poses_of = seen.correctable("pose")
    np.testing.assert_allclose(seen.tip_poses(poses_of), known.tip_poses(poses_of), rtol=0, atol=1e-7)
    assert any("tool 1, user frame 2: the numbers are those of SYSFRAME.VA" in note.text for note in seen.notes)
    (typed,) = fanuc.read_for(nominal, [tmp_path / "job.ls"], given(at, tools={"1": other}))
    np.testing.assert_allclose(typed.tools["1"], at.T_tip_flange @ other, rtol=0, atol=1e-12)
    (tmp_path / "SYSFRAME.VA").write_bytes((text + element("1,1", other)).encode())  # twice, with other numbers
    (doubtful,) = fanuc.read_for(nominal, [tmp_path / "job.ls"], given(at))
    assert [left.target for left in doubtful.unchanged_targets()] == ["P[2]", "P[4]"]


def test_a_controller_report(robots):
    """R-2000iC/210F-like: the pendant's joints and pose, of a public repository; link lengths fitted to it."""
    from scipy.spatial.transform import Rotation

    j1, j2, j3, j4, j5, j6 = np.radians([0, -10, 40, 5, -90, -95])
    about = [("z", j1), ("y", j2), ("y", -(j3 + j2)), ("x", -j4), ("y", -j5), ("x", -j6)]
    R = np.eye(3)
    for axis, angle in about:
        R = R @ Rotation.from_euler(axis, angle).as_matrix()
    R = (
        R
        @ Rotation.from_euler("xyz", [np.pi, -np.pi / 2, 0]).as_matrix()
        @ Rotation.from_euler("z", 2.5, degrees=True).as_matrix()
    )
    np.testing.assert_allclose(
        Rotation.from_matrix(R).as_euler("xyz", degrees=True), [-139.75, 0.99, -98.93], rtol=0, atol=0.03
    )
    np.testing.assert_allclose(
        fanuc.FANUC.joints(np.radians([0, -10, 40, 5, -90, -95]))[2], j3 + j2, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "cp437"])
def test_unchanged_programs_are_the_same_bytes(robots, newline, encoding):
    nominal, _, at = robots
    data = program(nominal, at, in_front(nominal, 2), newline).decode("latin-1").encode(encoding)
    assert parsed(robots, data).listing.files_with([]) == {"job.ls": data}


@settings(max_examples=30, deadline=None)
@hypothesis_given(
    st.lists(
        st.tuples(st.lists(st.floats(-90, 90), min_size=6, max_size=6), st.booleans(), st.sampled_from("JLA")),
        min_size=1,
        max_size=5,
    ),
    st.sampled_from(["\n", "\r\n"]),
)
def test_generated_programs_keep_their_bytes(robots, points, newline):
    nominal, robot, _ = robots
    texts = [
        point(k, values, None if joint else "N U T, 0, 0, 0") for k, (values, joint, _) in enumerate(points, start=1)
    ]
    data = listing([f"{move} P[{k}] 10% FINE" for k, (_, _, move) in enumerate(points, start=1)], texts, newline)
    seen = parsed(robots, data)
    assert seen.listing.files_with([]) == {"job.ls": data}
    assert len(seen.targets) == len(points)
    kept = re.sub(rb" *\d+:  !(irbcal fake targets|abc123) ;\r?\n", b"", corrected(robot, nominal, seen).data)
    blank = re.compile(rb"[-+\d.]+")
    assert blank.sub(b"#", kept).split() == blank.sub(b"#", data).split()


def test_damaged_programs_end_in_a_refusal_or_a_result(robots):
    nominal, robot, at = robots
    frames_given = {"tools": {"1": TOOL}, "work_objects": {"2": USER, "0": np.eye(4)}}
    check_damaged(
        program(nominal, at, in_front(nominal, 2)),
        lambda data: parsed(robots, data, **frames_given),
        lambda seen: corrected(robot, nominal, seen),
    )


TEXT = b"""/PROG A
/MN
   1:  ! x ;
   2:C P[1]
    :  P[2] 5mm/sec ;
/POS
P[1:"a b"]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, -1, 1',
\tX =   -.070  mm,\tY = 2 mm,\tZ =  3  mm,
\tW = 1 deg,\tP = 2 deg,\tR = 3 deg,
\tE1=  5.000  mm
   GP2:
\tUF : 0, UT : 1,
\tJ1 =  -7.500  deg,\tJ2 = 12 deg
};
P[3]{
   GP2:
\tUF : 0, UT : 1,
\tJ1 =  5.000  mm
};
/END
"""


def test_everything_is_found_in_its_place():
    listing = Listing([("a.ls", TEXT)], "FANUC LS")
    places = sections(listing)
    assert list(places) == ["PROG", "MN", "POS", "END"]
    steps = instructions(listing, *places["MN"])
    assert [step.number for step in steps] == [1, 2]
    assert "P[2] 5mm/sec" in listing.text[steps[1].start : steps[1].end]
    one, other = points(listing, *places["POS"])
    assert [number.value for number in one.target.numbers] == [-0.07, 2, 3, 1, 2, 3]
    assert (one.user_frame, one.tool, one.target.external) == ("0", "1", "other groups")
    assert one.target.e == {"e1": 5.0, "e2": -7.5, "e3": 12.0}
    assert [listing.text[slice(*span)] for span in one.target.configuration_spans] == ["0", "-1", "1"]
    assert other.reason == "it is of another motion group"


def test_letters_and_turns():
    posture, spans, reason = fanuc.config(" F D T, 0, 1, -1 ", 10)
    assert posture[:3] == (False, True, 1)
    assert (posture.low[3], posture.high[3]) == (np.pi, 3 * np.pi)
    assert posture.high[5] == -np.pi
    assert posture.low[1] == -np.inf
    assert spans == ((18, 19), (21, 22), (24, 26))
    assert reason == ""


@pytest.mark.parametrize("text", ["", "N U", "L, 0, 0, 0", "N U T, 0, 0", "N U B, 0, 0, 0", "n u t, 0, 0, 0"])
def test_what_means_nothing_here(text):
    assert fanuc.config(text, 0)[0] is None
    assert fanuc.config(text, 0)[2]


def test_lines_within_a_move_have_numbers_of_their_own(robots):
    """``P-SPS``: what the controller does on the way stands below the move, numbered from 1."""
    nominal, robot, at = robots
    (joints,) = np.degrees(in_front(nominal, 1))
    joints[2] -= joints[1]
    fields = ",\t".join(f"J{k}= {v:.3f} deg" for k, v in enumerate(joints, 1))
    lines = ["   1:  UTOOL_NUM=2 ;", "   2:J P[1] 100% CNT0 TB    .10sec,P-SPS    ;", "      1:  TC_ONLINE (ON) ;"]
    lines += ["      9:  WAIT (DI[62])    ;", "       ------ ;", "   3:  PAYLOAD[2] ;"]
    point = f"P[1]{{\n   GP1:\n\tUF : 0, UT : 2,\n\t{fields}\n}};"
    data = "\n".join(["/PROG  UP222", "/MN", *lines, "/POS", point, "/END", ""])
    found = corrected(robot, nominal, fanuc.parse(nominal, data.encode(), "up222.ls", given(at)))
    assert found.unchanged_targets == ()
    assert "   4:  !irbcal fake targets ;\n   5:  !abc123 ;\n/POS" in found.data.decode()
