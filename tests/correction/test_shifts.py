"""Points that moves go to directly and that others shift, in the languages of all makers that have such moves."""

import numpy as np
import pytest
from maker_cases import corrected, given, language_tests, pose_numbers, poses, robot_of, well_inside

from irbcal.correction.languages import krl, val3
from irbcal.correction.program import ControllerSetup

SHIFT = [5.0, -10.0, -80.0, 3.0, 2.0, 1.0]


def krl_program(robots, shifted):
    nominal, _, at = robots
    q = well_inside(nominal, 1)
    x = pose_numbers(nominal.forward(q), "ZYX")[0]
    point = "{" + ",".join(f"{n} {v:.6f}" for n, v in zip("XYZABC", x, strict=True)) + "}"
    axes = ",".join(f"A{k} {v:.6f}" for k, v in enumerate(np.degrees(q[0]), 1))
    head = f"DEF job()\nDECL FRAME P1\nP1={point}\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nPTP $AXIS_ACT\nPTP {{{axes}}}\n"
    data = f"{head}LIN P1\nLIN {shifted} C_DIS\nEND\n"
    return krl.parse(nominal, [("job.src", data.encode())], given(at))


def val3_program(robots, shifted):
    nominal, _, at = robots
    q = language_tests("val3").in_front(nominal, 1)
    x = pose_numbers(np.linalg.inv(at.T_base_world) @ nominal.forward(q), "XYZ")[0]
    names = ("x", "y", "z", "rx", "ry", "rz")
    back, bent, negative = (bool(flag[0]) for flag in val3.MAKER.postures(nominal, q))
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
    return val3.parse(nominal, files, ControllerSetup({}, {}, at))


def kawasaki_program(robots, shifted):
    tests = language_tests("kawasaki")
    nominal = robots[0]
    q = well_inside(nominal, 1)
    x = pose_numbers(np.linalg.inv(tests.WORLD) @ nominal.forward(q) @ tests.FLANGE, "ZYZ")
    joints = " ".join(f"{v:.6f}" for v in np.degrees(q[0]))
    lines = ["TOOL NULL", "BASE NULL", "JMOVE #h", "LMOVE p1", shifted]
    return tests.parsed(robots, tests.save(lines, [f"p1 {tests.numbers(x[0])}"], [f"#h {joints}"]))


NUMBERS = ",".join(map(str, SHIFT))
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
    assert seen.left() == []
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
        assert not shift.known


@pytest.mark.parametrize("language", CASES)
def test_a_point_that_is_only_shifted_stays(language):
    name, program, shifted, *_ = CASES[language]
    robots = robot_of(name, size=0.05)
    direct = {"krl": b"LIN P1\n", "val3": b"movel(P1,flange,m)", "kawasaki": b"LMOVE p1\r\n"}[language]
    seen = program(robots, shifted)
    kept = seen.data.replace(direct, b"")
    files = [
        (part.name, seen.text[part.start : part.end].encode("latin-1").replace(direct, b""))
        for part in seen.listing.parts
    ]
    assert len(kept) < len(seen.data)
    module = {"krl": krl, "val3": val3}.get(language)
    if module is None:
        again = language_tests("kawasaki").parsed(robots, files[0][1])
    else:
        again = module.parse(robots[0], files, given(robots[2]))
    assert [target.kind for target in again.targets if target.correctable] in ([], ["joint"])
    assert again.shifts == ()
    assert len(again.left()) == 2
