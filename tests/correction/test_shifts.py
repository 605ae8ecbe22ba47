"""Points that moves go to directly and that others shift, in the languages of all makers that have such moves."""

import re

import numpy as np
import pytest
from maker_cases import corrected, given, language_tests, pose_numbers, poses, robot_of, well_inside
from rapid_modules import parsed
from scipy.spatial.transform import Rotation
from support import arm, assert_same_poses, random_robot

from irbcal.correction.languages import kawasaki, krl, rapid, val3
from irbcal.correction.program import ControllerSetup
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot

SHIFT = [5.0, -10.0, -80.0, 3.0, 2.0, 1.0]


def krl_program(robots, shifted, split=False):
    nominal, _, at = robots
    q = well_inside(nominal, 1)
    x = pose_numbers(nominal.forward(q), "ZYX")[0]
    point = "{" + ",".join(f"{n} {v:.6f}" for n, v in zip("XYZABC", x, strict=True)) + "}"
    axes = ",".join(f"A{k} {v:.6f}" for k, v in enumerate(np.degrees(q[0]), 1))
    head = f"DEF job()\nDECL FRAME P1\nP1={point}\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nPTP $AXIS_ACT\nPTP {{{axes}}}\n"
    data = f"{head}LIN P1\nLIN{'' if shifted.startswith('_') else ' '}{shifted} C_DIS\nEND\n"
    return krl.parse(nominal, [("job.src", data.encode())], given(at)._replace(split_points=split))


def val3_program(robots, shifted, split=False):
    nominal, _, at = robots
    q = language_tests("val3").in_front(nominal, 1)
    x = pose_numbers(np.linalg.inv(at.T_base_world) @ nominal.forward(q), "XYZ")[0]
    names = ("x", "y", "z", "rx", "ry", "rz")
    back, bent, negative = (bool(flag[0]) for flag in val3.STAUBLI.postures(nominal, q))
    assert not back
    posture = f'shoulder="lefty" elbow="{"enegative" if bent else "epositive"}" wrist="{"wnegative" if negative else "wpositive"}"'
    value = " ".join(f'{n}="{v:.6f}"' for n, v in zip(names, x, strict=True)) + f' {posture} fatherId="world[0]"'
    datum = f'<Data name="P1" xsi:type="array" type="pointRx" size="1"><Value key="0" {value}/></Data>'
    data = f'<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2"><Datas>{datum}</Datas></Database>'
    code = f"begin\n  movel(P1,flange,m)\n  movel({shifted},flange,m)\nend"
    files = [
        ("a.dtx", data.encode()),
        ("a.pgx", f"<Programs><Program><Code><![CDATA[{code}]]></Code></Program></Programs>".encode()),
    ]
    return val3.parse(nominal, files, given(at)._replace(split_points=split))


def kawasaki_program(robots, shifted, split=False):
    tests = language_tests("kawasaki")
    nominal = robots[0]
    q = well_inside(nominal, 1)
    x = pose_numbers(np.linalg.inv(tests.WORLD) @ nominal.forward(q) @ tests.FLANGE, "ZYZ")
    joints = " ".join(f"{v:.6f}" for v in np.degrees(q[0]))
    lines = ["TOOL NULL", "BASE NULL", "JMOVE #h", "LMOVE p1", shifted]
    data = tests.save(lines, [f"p1 {tests.numbers(x[0])}"], [f"#h {joints}"])
    setup = given(robots[2])._replace(where=tests.pair(nominal), split_points=split)
    return kawasaki.parse(nominal, [("job.as", data)], setup)


NUMBERS = ",".join(map(str, SHIFT))
DEPARTS = {  # moves away from the point, and where they end in its own axes, or in those of the base
    ("kawasaki", "LDEPART 80"): ([0, 0, -80], True),
    ("krl", "_REL {X 0,Z -80} #TOOL"): ([0, 0, -80], True),
    ("krl", "_REL {Y 20,Z 80}"): ([0, 20, 80], False),
}


@pytest.mark.parametrize(("language", "move"), DEPARTS)
def test_moves_away_from_a_point_are_told(language, move):
    """The controller goes there from the corrected point; how far off is computed with SciPy's inverse."""
    name, program, *_ = CASES[language]
    robots = nominal, robot, _at = robot_of(name, size=0.05)
    seen = program(robots, move)
    assert seen.unchanged_targets() == []
    found = corrected(robot, nominal, seen)
    assert not found.unchanged_targets
    (note,) = [note.text for note in found.notes if "the shifted target is off by" in note.text]
    by, in_tool = DEPARTS[language, move]
    T = np.eye(4)
    T[:3, 3] = np.array(by) / 1e3
    tests = language_tests("kawasaki")
    right = tests.FLANGE if language == "kawasaki" else np.eye(4)
    move_by = [
        (q @ right @ T @ np.linalg.inv(right) if in_tool else T @ q)
        for q in (nominal.forward(found.q_before[-1:])[0], nominal.forward(found.q[-1:])[0])
    ]
    q = found.q_before[-1]
    off = [np.linalg.norm((reached(robot, nominal, each, q) - move_by[0])[:3, 3]) * 1e3 for each in move_by]
    assert f"off by {off[1]:.3f} mm ({off[0]:.3f} mm without" in note


def test_behind_a_move_away_the_posture_is_known_and_the_side_it_comes_from_is_not():
    robots = robot_of("rs007n", size=0.05)
    seen = kawasaki_program(robots, "LDEPART 80\r\nLMOVE p1")
    numbers = {target.name: k for k, target in enumerate(seen.targets)}
    at_point = [stop for stop in seen.stops() if stop.target == numbers["p1"]]
    assert [stop.previous for stop in at_point] == [numbers["#h"], None]
    assert seen.targets[numbers["p1"]].previous == [numbers["#h"], numbers["p1"]]
    twice = kawasaki_program(robots, "LDEPART 80\r\nLDEPART 20")
    assert [left.reason for left in twice.unchanged_targets()] == ["it moves by a distance"]
    assert len(twice.shifts) == 1


@pytest.mark.parametrize("move", ["LIN_REL {A 5}", "LIN_REL {Z 5,E1 10}", "LIN_REL {Z n}", "PTP_REL {Z 5}"])
def test_other_relative_moves_are_left(move):
    robots = robot_of("kr120r2500pro", size=0.05)
    assert len(krl_program(robots, f"P1\n{move}").unchanged_targets()) == 1


CASES = {  # a shift in numbers, one that is computed, how scipy names the angles
    "krl": ("kr120r2500pro", krl_program, "P1:{X 5.0,Y -10.0,Z -80.0,A 3.0,B 2.0,C 1.0}", None, "ZYX"),
    "val3": ("rx160", val3_program, f"appro(P1,{{{NUMBERS}}})", "appro(P1,tUp)", "XYZ"),
    "kawasaki": ("rs007n", kawasaki_program, "LAPPRO p1,80", "LAPPRO p1,height", None),
}


@pytest.mark.parametrize("language", CASES)
def test_the_point_is_corrected_and_the_shifted_one_is_told(language):
    name, program, shifted, computed, angles = CASES[language]
    robots = nominal, robot, _ = robot_of(name, size=0.05)
    seen = program(robots, shifted)
    assert seen.unchanged_targets() == []
    (shift,) = seen.shifts
    T = poses(SHIFT, angles)[0] if angles else poses([0, 0, -80, 0, 0, 0], "ZYZ")[0]
    np.testing.assert_allclose(shift.T_left @ shift.T_right, T, rtol=0, atol=1e-12)
    found = corrected(robot, nominal, seen)
    assert any("p1" in name.lower() for name in found.targets)
    (note,) = [note for note in found.notes if "the shifted target is off by" in note.text]
    after, before = (
        float(word) for word in note.text.replace("(", "").split() if word.replace(".", "").isdigit() and "." in word
    )
    assert after < before
    if computed is not None:
        (shift,) = program(robots, computed).shifts
        assert not shift.numeric


@pytest.mark.parametrize("language", CASES)
def test_a_point_that_is_only_shifted_stays(language):
    name, program, shifted, *_ = CASES[language]
    robots = robot_of(name, size=0.05)
    direct = {"krl": b"LIN P1\n", "val3": b"movel(P1,flange,m)", "kawasaki": b"LMOVE p1\r\n"}[language]
    seen = program(robots, shifted)
    kept = seen.data.replace(direct, b"")
    files = [
        (part.name, seen.text[part.start : part.end].encode("latin-1").replace(direct, b""))
        for part in seen.listing.files
    ]
    assert len(kept) < len(seen.data)
    module = {"krl": krl, "val3": val3}.get(language)
    if module is None:
        again = language_tests("kawasaki").parsed(robots, files[0][1])
    else:
        again = module.parse(robots[0], files, given(robots[2]))
    assert [target.kind for target in again.targets if target.correctable] in ([], ["joint"])
    assert again.shifts == ()
    assert len(again.unchanged_targets()) == 2


def reached(robot, nominal, T_base_tip, near):
    """Where the true robot ends that a nominal controller sends to a pose next to joints."""
    q, _ = closed_form.nearest(nominal, closed_form.branches(nominal, T_base_tip[None]), near)
    return robot.forward(q)[0]


SPLIT = {  # how the corrected text names the new numbers
    "krl": r"LIN \{(X [^}]*)\} C_DIS",
    "val3": r'<Data name="p3c9" xsi:type="array" type="pointRx" size="1"><Value key="0" ([^/]*)/></Data>',
    "kawasaki": r"LMOVE TRANS\(([^)]*)\)",
}


@pytest.mark.parametrize("language", CASES)
@pytest.mark.parametrize("direct", [True, False])
def test_a_shifted_point_gets_numbers_of_its_own(language, direct):
    name, program, shifted, computed, angles = CASES[language]
    nominal, robot, at = robots = robot_of(name, size=0.05)
    q = (language_tests("val3").in_front if language == "val3" else well_inside)(nominal, 1)
    seen = program(robots, shifted, split=True)
    if not direct:
        files = [(part.name, seen.text[part.start : part.end].encode("latin-1")) for part in seen.listing.files]
        move = {"krl": b"LIN P1\n", "val3": b"movel(P1,flange,m)", "kawasaki": b"LMOVE p1\r\n"}[language]
        setup = given(at)._replace(split_points=True)
        if language == "kawasaki":
            setup = setup._replace(where=language_tests("kawasaki").pair(nominal))
        module = {"krl": krl, "val3": val3, "kawasaki": kawasaki}[language]
        seen = module.parse(
            nominal, [(n, data.replace(move, b"  " if language == "val3" else b"")) for n, data in files], setup
        )
    found = corrected(robot, nominal, seen)
    assert found.unchanged_targets == ()
    assert not [note for note in found.notes if "the shifted target is off" in note.text]
    text = b"".join(found.files.values()).decode("latin-1")
    assert shifted not in text
    (numbers,) = re.findall(SPLIT[language], text)
    values = [float(v) for v in re.findall(r"-?\d+\.\d+", numbers)][:6]
    if language == "val3":
        assert f"movel({'p3c9'},flange,m)" in text
        assert 'fatherId="world[0]"' in numbers
        assert 'shoulder="lefty"' in numbers
    T = poses(values, {"krl": "ZYX", "val3": "XYZ", "kawasaki": "ZYZ"}[language])[0]
    tests = language_tests("kawasaki")
    ends = {"val3": (at.T_base_world, np.eye(4)), "kawasaki": (tests.WORLD, np.linalg.inv(tests.FLANGE))}
    left, right = ends.get(language, (np.eye(4), np.eye(4)))
    shift = poses(SHIFT, angles)[0] if angles else poses([0, 0, -80, 0, 0, 0], "ZYZ")[0]
    wanted = nominal.forward(q)[0] @ np.linalg.inv(right) @ shift @ right
    assert_same_poses(reached(robot, nominal, left @ T @ right, q[0])[None], wanted[None], 2e-7, 1e-7)
    assert np.linalg.norm((reached(robot, nominal, wanted, q[0]) - wanted)[:3, 3]) > 1e-5, "it needs a correction"
    if computed is not None and direct:
        untouched = program(robots, computed, split=True)
        assert untouched.shifts[0].new_target is None
        assert computed in untouched.data.decode("latin-1")


@pytest.mark.parametrize(("text", "in_tool"), [("Offs(p10,5,-10,80)", False), ("RelTool(p10,5,-10,-80)", True)])
def test_shifted_robtargets_get_numbers_of_their_own(text, in_tool, tmp_path):
    nominal = arm()
    robot = random_robot(nominal, "placement", np.random.default_rng(1), size=0.05)
    (q,) = well_inside(nominal, 1)
    T = nominal.forward(q[None])[0]
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    quadrants = np.floor(q[[0, 3, 5]] / (np.pi / 2)).astype(int)
    cfx = int(closed_form.configuration(nominal, q[None])[0])
    xyz = ",".join(f"{v:.6f}" for v in 1e3 * T[:3, 3])
    point = (
        f"[[{xyz}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}],[{','.join(map(str, quadrants))},{cfx}],[9E9,9E9,9E9,9E9,9E9,7]]"
    )
    moves = f"MoveL p10,v1,fine,tool0;\nMoveL {text} ,v1,fine,tool0;\nMoveL Offs(p10,0,0,n),v1,fine,tool0;"
    data = f"MODULE Job\nCONST robtarget p10:={point};\nPROC main()\n{moves}\nENDPROC\nENDMODULE"
    assert parsed(data.encode()).shifts[0].new_target is None, "unless it is asked for"
    (tmp_path / "job.mod").write_text(data)
    setup = ControllerSetup({}, {}, unknown_frames(), split_points=True)
    (module,) = rapid.read_for(nominal, [tmp_path / "job.mod"], setup)
    found = corrected(robot, nominal, module)
    written = found.data.decode()
    assert not found.unchanged_targets, found.unchanged_targets
    assert [*found.targets] == ["p10", f"{text} in line 5"]
    assert text not in written
    assert "MoveL Offs(p10,0,0,n),v1,fine,tool0;" in written
    (literal,) = re.findall(r"MoveL (\[\[.*\]\]) ,v1", written)
    numbers = [float(v) for v in re.findall(r"-?[\d.]+(?:E\d)?", literal)]
    assert numbers[-6:] == [9e9] * 5 + [7], "external axes stay"
    near = np.eye(4)
    near[:3, :3] = Rotation.from_quat([*numbers[4:7], numbers[3]]).as_matrix()
    near[:3, 3] = 1e-3 * np.array(numbers[:3])
    wanted = T.copy()
    wanted[:3, 3] += T[:3, :3] @ [0.005, -0.01, -0.08] if in_tool else [0.005, -0.01, 0.08]
    assert_same_poses(reached(robot, nominal, near, q)[None], wanted[None], 2e-6, 2e-6)
    assert np.linalg.norm((reached(Robot(nominal), nominal, near, q) - wanted)[:3, 3]) > 1e-5, "it needs a correction"
    assert [note.text for note in found.notes if "Offs(p10,0,0,n)" in note.text]
