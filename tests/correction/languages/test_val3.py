"""Elements of data with the places of their attributes."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import check_damaged, corrected, given, pose_numbers, poses, robot_of, well_inside
from moves_cases import written
from support import assert_same_poses

from irbcal.correction.languages import val3
from irbcal.correction.languages.val3 import POSE, numbers, posture_of, read, target
from irbcal.correction.listing import Listing
from irbcal.errors import ProgramError
from irbcal.modeling import frames

TEXT = """<?xml version="1.0"?><!-- note <Value x="9"/> -->
<Datas><Data name="p" type="pointRx" size="2">
<Value key="0" x="1.5" y='-2' z = "3" rx="0" ry="0" rz=" 90 " shoulder="lefty" elbow="epositive" wrist="wnegative"/>
<Value key="1" x="1" /></Data><Data name="f" type="frame"><Value key="0" z="5"/></Data>
<Code><![CDATA[begin movej(p[0],t,m) end]]></Code></Datas>"""


def test_what_is_found():
    listing = Listing([("a.dtx", TEXT.encode())], "VAL3")
    values, codes, comments = read(listing)
    assert [value.indexed_name for value in values] == ["p[0]", "p[1]", "f[0]"]
    assert [TEXT[code.start : code.end] for code in codes] == ["begin movej(p[0],t,m) end"]
    assert len(comments) == 1
    one = target(values[0])
    assert [(n.value, TEXT[n.start : n.end]) for n in one.numbers] == [
        (1.5, "1.5"), (-2, "-2"), (3, "3"), (0, "0"), (0, "0"), (90, "90")
    ]  # fmt: skip
    assert one.configuration[:3] == (False, False, -1)
    assert target(values[1]).conflicts == ["not all of its numbers are written"]
    assert target(values[2]) is None
    assert [n.value for n in numbers(values[2], POSE, absent=True)] == [0, 0, 5, 0, 0, 0]


@pytest.mark.parametrize(("old", "reason"), [("righty", "righty"), ("xx", "not known")])
def test_postures_that_are_not_confirmed(old, reason):
    values, _, _ = read(Listing([("a.dtx", TEXT.replace("lefty", old).encode())], "VAL3"))
    assert reason in target(values[0]).conflicts[0]


LINE = '<Value key="1" j1="10.0000" j2="-60.0000" j3="95.5000" j4="20.0000" j5="30.1250" j6="-40.0000" />'


def test_joints_rests_and_speeds():
    files = written("val3", "rx160")
    text = files["plan.dtx"]
    assert LINE in text
    assert text.isascii()
    assert "mPlan.vel=25\r\n  movej(jPlan[1],flange,mPlan)\r\n  waitEndMove()\r\n  delay(4.5)" in files["start.pgx"]


TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
OUTER = frames.from_xyz_angles([0.5, 0.1, 0.3, 0.0, 0.1, 0.2])
INNER = frames.from_xyz_angles([-0.1, 0.1, 0.05, 0.3, 0.0, 0.0])
NAMES = ("x", "y", "z", "rx", "ry", "rz")


@pytest.fixture(scope="module")
def robots():
    return robot_of("rx160", size=0.05)


def value(numbers, key=0, more="", names=NAMES):
    inside = " ".join(f'{name}="{number:.6f}"' for name, number in zip(names, numbers, strict=True))
    return f'      <Value key="{key}" {inside} {more}/>'


def datum(name, kind, *values):
    return [
        f'    <Data name="{name}" access="private" xsi:type="array" type="{kind}" size="9">',
        *values,
        "    </Data>",
    ]


def in_front(nominal, n):
    q = well_inside(nominal, 8 * n)
    back, _, _ = val3.STAUBLI.postures(nominal, q)
    return q[~back][:n]


def application(points, joints, code, newline="\r\n", bom="\ufeff"):
    frame = [pose_numbers(T[None], "XYZ")[0] for T in (OUTER, INNER, TOOL)]
    lines = [
        '<?xml version="1.0" encoding="utf-8" ?>',
        '<Database xmlns:xsi="x" xmlns="http://www.staubli.com/robotics/VAL3/Data/2">',
        "  <Datas>",
        *datum("fOuter", "frame", value(frame[0], 0, 'fatherId="world[0]"')),
        *datum("fInner", "frame", value(frame[1], 0, 'fatherId="fOuter[0]"')),
        *datum("tGrip", "tool", value(frame[2], 0, 'fatherId="flange[0]" ioLink="größe"')),
        *datum("p", "pointRx", *points),
        *datum("j", "jointRx", *joints),
        "  </Datas>",
        "</Database>",
    ]
    program = [
        '<Programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2"><Program name="start"><Code><![CDATA[',
        "begin",
        *code,
        "end]]></Code></Program></Programs>",
    ]
    return {"a.dtx": (bom + newline.join(lines)).encode(), "start.pgx": newline.join(program).encode()}


def program(robots, q, **more):
    nominal, _, at = robots
    T = frames.inverse(at.T_base_world @ OUTER @ INNER) @ nominal.forward(q) @ TOOL
    elbow = ["epositive" if a > -np.arctan2(0, 1) else "enegative" for a in q[:, 2]]
    wrist = ["wpositive" if a >= 0 else "wnegative" for a in q[:, 4]]
    points = [
        value(row, k, f'shoulder="lefty" elbow="{elbow[k]}" wrist="{wrist[k]}" fatherId="fInner[0]"')
        for k, row in enumerate(pose_numbers(T, "XYZ"))
    ]
    joints = [value(row, k, names=[f"j{i}" for i in range(1, 7)]) for k, row in enumerate(np.degrees(q))]
    code = [
        line
        for k in range(len(q))
        for line in (f"  movej(j[{k}], tGrip, mNom)  // go", f"  n=movel(p[{k}],tGrip[0],mNom)", "  open(tGrip)")
    ]
    return application(points, joints, code, **more)


def parsed(robots, files, **more):
    nominal, _, at = robots
    return val3.parse(nominal, list(files.items()), given(at, **more))


def read_back(data, kind):
    inside = re.search(rf'type="{kind}".*?</Data>', data.decode(), re.DOTALL)[0]
    return np.array(
        [[float(v) for v in re.findall(r'\s[xyzrj]\w?="(-?[\d.]+)"', line)] for line in inside.split("<Value")[1:]]
    )


def test_the_robot_goes_where_it_was_meant_to(robots):
    nominal, robot, at = robots
    q = in_front(nominal, 30)
    found = corrected(robot, nominal, parsed(robots, program(robots, q)))
    assert found.unchanged_targets == ()
    assert len(found.targets) == 60
    wanted = nominal.forward(q)
    data = found.files["a.dtx"]
    assert_same_poses(robot.poses(np.radians(read_back(data, "jointRx"))), wanted, 1e-7, 1e-7)
    T = at.T_base_world @ OUTER @ INNER @ poses(read_back(data, "pointRx"), "XYZ") @ frames.inverse(TOOL)
    assert_same_poses(T, nominal.forward(found.q[30:]), 1e-7, 1e-7)
    assert_same_poses(robot.poses(found.q[30:]), wanted, 1e-7, 1e-7)
    turns = (found.q_before[30:] - q) / (2 * np.pi)
    assert np.abs(turns - np.round(turns)).max() < 1e-6, "shoulder, elbow and wrist name the joints that were meant"


def test_only_numbers_change(robots):
    nominal, robot, _ = robots
    files = program(robots, in_front(nominal, 3))
    found = corrected(robot, nominal, parsed(robots, files))
    mark = b"<!-- irbcal: fake targets, calibration abc123 -->"
    assert found.files["a.dtx"].count(mark) == 1
    blank = re.compile(rb"[-+]?\d[\d.]*")
    assert blank.sub(b"#", found.files["a.dtx"].replace(mark, b"")) == blank.sub(b"#", files["a.dtx"])
    assert found.files["start.pgx"] == files["start.pgx"]
    assert val3.LANGUAGE.fingerprint(found.files["a.dtx"]) == "abc123"
    with pytest.raises(ProgramError, match="fake targets already"):
        corrected(robot, nominal, parsed(robots, found.files))


GOOD = 'shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="world[0]"'


@pytest.mark.parametrize(
    ("code", "more", "reason"),
    [
        ("movel(appro(p[0],tr),tGrip,m)", GOOD, "no move goes to p[0] itself"),
        ("movel(q,tGrip,m)", GOOD, "not declared"),
        ("movel(p[0],tGrip,m)\np[0].trsf.x=3", GOOD, "in another way"),
        ("movel(p[0],tGrip,m)\nmovel(p[0],flange,m)", GOOD, "different tools"),
        ("movel(p[0],tGrip[n],m)", GOOD, "the tool of line"),
        ("movel(p[0],tGrip,m)\ntGrip.trsf.z=5", GOOD, "uses tGrip in another way"),
        ("movel(p[0],tGrip,m)\nsetFrame(a,b,c,fOuter)", GOOD.replace("world", "fInner"), "uses fOuter in another way"),
        ("movel(p[0],tGrip,m)", GOOD.replace("lefty", "righty"), "righty"),
        ("movel(p[0],tGrip,m)", GOOD.replace("lefty", "ssame"), "nothing says which"),
    ],
)
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, code, more, reason):
    nominal, robot, _ = robots
    files = application([value([900, 100, 400, 170, 10, 20], 0, more)], [], code.split("\n"))
    found = corrected(robot, nominal, parsed(robots, files))
    assert any(reason in left.reason for left in found.unchanged_targets), found.unchanged_targets


def test_other_versions_and_units_are_refused(robots):
    files = program(robots, in_front(robots[0], 1))
    with pytest.raises(ProgramError, match="VAL3/Data/2 or DataNameSpace"):
        parsed(robots, {"a.dtx": files["a.dtx"].replace(b"Data/2", b"Data/1")})
    with pytest.raises(ProgramError, match="in inches"):
        parsed(robots, {**files, "a.pjx": b'<Parameters millimeterUnit="false"/>'})


@settings(max_examples=20, deadline=None)
@hypothesis_given(
    st.lists(st.lists(st.floats(-90, 90), min_size=6, max_size=6), min_size=1, max_size=4),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["", "\ufeff"]),
)
def test_generated_programs_keep_their_bytes(robots, points, newline, bom):
    values = [value(row, k, GOOD) for k, row in enumerate(points)]
    files = application(values, [], [f"movel(p[{k}],tGrip,m)" for k in range(len(points))], newline, bom)
    seen = parsed(robots, files)
    assert seen.listing.files_with([]) == files
    assert len(seen.correctable()) == len(points)


def test_damaged_programs_end_in_a_refusal_or_a_result(robots):
    nominal, robot, _ = robots
    files = program(robots, in_front(nominal, 2))
    for name in ("a.dtx", "start.pgx"):
        check_damaged(
            files[name],
            lambda data, name=name: parsed(robots, {**files, name: data}, tools={"tgrip[0]": TOOL}),
            lambda seen: corrected(robot, nominal, seen),
        )


@pytest.mark.parametrize(
    ("shoulder", "elbow", "wrist", "expected"),
    [
        ("lefty", "enegative", "wpositive", (False, True, 1)),
        ("ssame", "esame", "wsame", (None, None, None)),
        ("", "", "", (None, None, None)),
    ],
)
def test_what_they_mean(shoulder, elbow, wrist, expected):
    posture, reason = posture_of({"shoulder": shoulder, "elbow": elbow, "wrist": wrist})
    assert posture[:3] == expected
    assert reason == ""


def old_application(files):
    """The same application in the sections of VAL3 s6, whose values are elements of their own."""
    text = files["a.dtx"].decode("utf-8-sig")
    kinds = {
        "frame": ("frame", "f", "tf"),
        "tool": ("tool", "t", "tt"),
        "pointRx": ("point", "p", "tp"),
        "jointRx": ("joint", "", "joint"),
    }
    out = ['<?xml version="1.0" encoding="utf-8" ?>', '<dataList xmlns="DataNameSpace" >']
    world = '<frame name="world"><fFather alias="" name="" fatherIndex="0" /><valueFrame index="0" >'
    out.append(
        f'<frameSection>{world}<tfValue x="0" y="0" z="0" rx="0" ry="0" rz="0" /></valueFrame></frame></frameSection>'
    )
    for name, kind, inside in re.findall(r'<Data name="(\w+)".*?type="(\w+)" size[^>]*>(.*?)</Data>', text, re.DOTALL):
        tag, letter, place = kinds[kind]
        father = re.search(r'fatherId="(\w+)\[0\]"', inside)
        out += [f"<{tag}Section>", f'  <{tag} name="{name}" public="false" privilege="0" >']
        out += [f'    <{letter}Father alias="" name="{father[1]}" fatherIndex="0" />'] if father else []
        for key, row in re.findall(r'<Value key="(\d+)" (.*?)/>', inside):
            numbers = " ".join(re.findall(r'\b(?:[xyz]|r[xyz]|j\d)="[^"]*"', row))
            conf = " ".join(re.findall(r'\b(?:shoulder|elbow|wrist)="[^"]*"', row))
            out += [f'    <value{tag.capitalize()} index="{key}" >', f"      <{place}Value {numbers} />"]
            out += [f"      <cpValue {conf}/>"] if conf else []
            out.append(f"    </value{tag.capitalize()}>")
        out += [f"  </{tag}>", f"</{tag}Section>"]
    code = re.search(r"CDATA\[(.*?)\]\]", files["start.pgx"].decode(), re.DOTALL)[1]
    code = code.replace("begin", "begin\n  put(&quot;p[0] and appro(p[1]&quot;)")
    head = '<programList xmlns="ProgramNameSpace" ><program name="start"><source><code>'
    program_text = f"{head}{code}</code></source></program></programList>"
    return {"a.dtx": "\n".join([*out, "</dataList>"]).encode(), "start.pgx": program_text.encode()}


def test_data_of_val3_s6_get_the_same_numbers(robots, tmp_path):
    nominal, robot, _ = robots
    files = program(robots, in_front(nominal, 12))
    old = old_application(files)
    assert all(val3.looks_like(data) for data in old.values())
    new_numbers, old_numbers = (corrected(robot, nominal, parsed(robots, each)) for each in (files, old))
    assert old_numbers.unchanged_targets == ()
    assert len(old_numbers.targets) == 24
    text = old_numbers.files["a.dtx"].decode()
    for kind, tag, count in (("pointRx", "tpValue", 6), ("jointRx", "jointValue", 6)):
        rows = [re.findall(r'="(-?[\d.]+)"', row) for row in re.findall(rf"<{tag} ([^/]*)/>", text)]
        assert {len(row) for row in rows} == {count}
        np.testing.assert_allclose(
            np.array(rows, dtype=float), read_back(new_numbers.files["a.dtx"], kind), rtol=0, atol=2e-6
        )
    blank = re.compile(rb"[-+]?\d[\d.]*")
    mark = b"<!-- irbcal: fake targets, calibration abc123 -->"
    assert blank.sub(b"#", old_numbers.files["a.dtx"].replace(mark, b"")) == blank.sub(b"#", old["a.dtx"])
    assert val3.LANGUAGE.fingerprint(old_numbers.files["a.dtx"]) == "abc123"
    alias = {**old, "a.dtx": old["a.dtx"].replace(b'alias="" name="fInner"', b'alias="lib" name="fInner"')}
    left = {left.reason for left in parsed(robots, alias).unchanged_targets()}
    assert any("does not define the frame lib:finner[0]" in reason for reason in left), left
