"""Moves as INFORM: what is written, and that it is read again."""

import re

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st
from maker_cases import check_damaged, corrected, given, pose_numbers, poses, robot_of, well_inside
from moves_cases import written
from support import assert_same_poses

from irbcal.correction.languages import inform
from irbcal.correction.languages.inform import posture_of
from irbcal.errors import ProgramError
from irbcal.modeling import frames

LINE = "C00001=13414,-80484,-128104,20000,30125,-24880"


def test_joints_rests_and_speeds():
    files = written("inform", "gp8")
    text = files["PLAN.JBI"]
    assert LINE in text
    assert text.isascii()
    assert "MOVJ C00001 VJ=25.00 PL=0\r\nTIMER T=4.50\r\n" in text


def test_pulses_are_needed():
    with pytest.raises(ProgramError, match="give the pulses per degree"):
        written("inform", "gp8", pulses=())


TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
USER = frames.from_xyz_angles([0.2, 0.1, 0.1, 0.0, 0.1, 0.2])
PULSES = (1341.4, 1341.4, -1341.4, 1000.0, 1000.0, 622.0)
FRAMES = {"tools": {"1": TOOL}, "work_objects": {"2": USER}}


@pytest.fixture(scope="module")
def robots():
    return robot_of("gp8", size=0.05)


def in_front(nominal, n):
    """Wrist in front, turns below 180 degrees, away from where flip changes."""
    q = well_inside(nominal, 20 * n)
    back, _, _ = inform.YASKAWA.postures(nominal, q)
    inside = (np.abs(q[:, [0, 3, 5]]) < 3.0).all(axis=1) & (np.abs(np.cos(q[:, 3])) > 0.05)
    return q[~back & inside][:n]


def job(positions, moves, newline="\r\n"):
    lines = [
        "/JOB",
        "//NAME TEST",
        "//POS",
        "///NPOS 9,0,0,0,0,0",
        *positions,
        "//INST",
        "///DATE 2020/01/01 00:00",
        "///COMM größe",
        "///ATTR SC,RW,RJ",
        "///GROUP1 RB1",
        "NOP",
        *moves,
        "END",
        "",
    ]
    return newline.join(lines).encode("latin-1")


def program(robots, q, **more):
    nominal, _, at = robots
    T = frames.inverse(at.T_base_world @ USER) @ nominal.forward(q) @ TOOL
    elbow = np.atleast_1d(inform.YASKAWA.postures(nominal, q)[1])
    positions, moves = ["///TOOL 1", "///POSTYPE PULSE", "///PULSE"], []
    for k, row in enumerate(np.rint(np.degrees(q) * PULSES).astype(int)):
        positions.append(f"C{2 * k:05d}=" + ",".join(map(str, row)))
    positions += ["///USER 2", "///POSTYPE USER", "///RECTAN"]
    for k, row in enumerate(pose_numbers(T, "xyz")):
        flip = 0 if abs(np.degrees(q[k, 3])) < 90 else 1
        positions += [
            f"///RCONF {flip},{int(elbow[k])},0,0,0,0,0,0",
            f"C{2 * k + 1:05d}=" + ",".join(f"{v:.{3 if i < 3 else 4}f}" for i, v in enumerate(row)),
        ]
        moves += [f"MOVJ C{2 * k:05d} VJ=50.00", "'MOVL C99999", f"MOVL C{2 * k + 1:05d}  V=100.0 PL=0"]
    return job(positions, moves, **more)


def parsed(robots, data, pulses=PULSES, **more):
    nominal, _, at = robots
    return inform.parse(nominal, data, "job.jbi", given(at, **(more or FRAMES))._replace(pulses=pulses))


def read_back(data):
    return {int(k): np.array([float(v) for v in row.split(b",")]) for k, row in re.findall(rb"C(\d+)=([-\d.,]+)", data)}


def test_the_robot_goes_where_it_was_meant_to(robots):
    nominal, robot, at = robots
    q = in_front(nominal, 25)
    found = corrected(robot, nominal, parsed(robots, program(robots, q)))
    assert found.unchanged_targets == ()
    assert len(found.targets) == 50
    wanted = nominal.forward(q)
    new = read_back(found.data)
    joints = np.radians(np.array([new[2 * k] for k in range(25)]) / PULSES)
    # half a pulse of each joint, twice (as read and as written), is 0.001 degrees at most
    assert_same_poses(robot.poses(joints), wanted, 5e-5, 8e-5)
    T = at.T_base_world @ USER @ poses([new[2 * k + 1] for k in range(25)], "xyz") @ frames.inverse(TOOL)
    assert_same_poses(T, nominal.forward(found.q[25:]), 2e-6, 3e-6)
    assert_same_poses(robot.poses(found.q[25:]), wanted, 3e-6, 4e-6)
    assert np.abs(found.q_before[25:] - q).max() < 1e-3, "RCONF names the joints that were meant"


def test_only_numbers_change(robots):
    nominal, robot, _ = robots
    data = program(robots, in_front(nominal, 3))
    found = corrected(robot, nominal, parsed(robots, data))
    mark = b"NOP\r\n'irbcal fake targets\r\n'abc123\r\n"
    assert found.data.count(mark) == 1

    def shape(text):
        """Numbers by their decimals: three of millimetres, four of degrees, none of pulses."""
        return re.sub(rb"-?\d+(\.\d+)?", lambda number: b"#" * len(number[1] or b"0"), text)

    assert shape(found.data.replace(mark, b"NOP\r\n")) == shape(data)
    assert inform.LANGUAGE.fingerprint(found.data) == "abc123"
    with pytest.raises(ProgramError, match="calibration abc123"):
        corrected(robot, nominal, parsed(robots, found.data))


HEAD = ["///TOOL 1", "///USER 2", "///POSTYPE USER", "///RECTAN", "///RCONF 0,0,0,0,0,0"]
P = "C00000=400.000,50.000,300.000,170.0000,-10.0000,20.0000"


@pytest.mark.parametrize(
    ("positions", "moves", "reason"),
    [
        ([*HEAD, P], ["MOVL C00001 V=1"], "not a step point"),
        ([*HEAD, P], ["IMOV P001 V=1 TF"], "by a distance"),
        ([*HEAD, P], ["MOVL P001 V=1"], "not a step point"),
        ([*HEAD, P.replace("400.000", "xx")], ["MOVL C00000 V=1"], "not understood"),
        ([*HEAD, P], ["MOVL C00000 BC00000 V=1"], "other groups"),
        ([*HEAD, P], ["SMOVL C00000 V=1 +MOVJ C00001"], "other groups"),
        (["///GROUP2 RB2", *HEAD, P], ["MOVL C00000 V=1"], "other groups"),
        ([*HEAD[:-1], "///RCONF 0,0,1,0,0,0", P], ["MOVL C00000 V=1"], "behind axis 1"),
        ([*HEAD[:-1], P], ["MOVL C00000 V=1"], "RCONF is not understood"),
        (["///POSTYPE MTOOL", P], ["MOVL C00000 V=1"], "POSTYPE MTOOL"),
    ],
)
def test_what_cannot_be_corrected_is_left_with_its_reason(robots, positions, moves, reason):
    found = corrected(robots[1], robots[0], parsed(robots, job(positions, moves)))
    assert any(reason in left.reason for left in found.unchanged_targets), found.unchanged_targets


def test_a_correction_never_turns_a_joint_beyond_what_rconf_says(robots):
    """RCONF counts turns of 180 degrees: joints next to them may be corrected on their side only."""
    nominal, robot, _ = robots
    q = in_front(nominal, 12)
    q[:, 5] = np.where(np.arange(12) % 2, 1, -1) * (np.pi - 1e-6)
    found = corrected(robot, nominal, parsed(robots, program(robots, q)))
    reason = "its correction would need another RCONF, which other points share"
    assert {target.reason for target in found.unchanged_targets} == {reason}
    assert 2 <= len(found.unchanged_targets) <= 10
    new, old = read_back(found.data), read_back(program(robots, q))
    names = {target.target for target in found.unchanged_targets}
    for k in range(1, 24, 2):
        assert (new[k] == old[k]).all() == (f"C{k:05d}" in names)


def test_pulses_are_asked_for(robots):
    found = corrected(robots[1], robots[0], parsed(robots, program(robots, in_front(robots[0], 1)), pulses=()))
    assert [left.reason for left in found.unchanged_targets] == [
        "it is in pulses: give the pulses per degree of the joints (--pulses)"
    ]


@settings(max_examples=20, deadline=None)
@hypothesis_given(
    st.lists(st.lists(st.integers(-60000, 60000), min_size=6, max_size=6), min_size=1, max_size=5),
    st.sampled_from(["\n", "\r\n"]),
)
def test_generated_programs_keep_their_bytes(robots, points, newline):
    positions = ["///POSTYPE PULSE", *(f"C{k:05d}={','.join(map(str, row))}" for k, row in enumerate(points))]
    data = job(positions, [f"MOVJ C{k:05d} VJ=1" for k in range(len(points))], newline)
    seen = parsed(robots, data)
    assert seen.listing.files_with([]) == {"job.jbi": data}
    assert len(seen.targets) == len(points)


def test_damaged_programs_end_in_a_refusal_or_a_result(robots):
    nominal, robot, _ = robots
    tools = {str(n): TOOL for n in range(10)} | {"": TOOL}
    check_damaged(
        program(robots, in_front(nominal, 2)),
        lambda data: parsed(robots, data, tools=tools, work_objects={"2": USER, "0": USER}),
        lambda seen: corrected(robot, nominal, seen),
    )


@pytest.mark.parametrize(
    ("rconf", "expected", "reason"),
    [
        ([0, 0, 0, 0, 0, 0, 0, 0], (False, False, -1), ""),
        ([1, 1, 0, 0, 0, 0], (False, True, 1), ""),
        ([1, 0, 1, 0, 0, 0], (None, None, None), "behind axis 1"),
        ([1, 0, 0, 1, 0, 0], (None, None, None), "beyond 180"),
        ([1, 0], (None, None, None), "not understood"),
        ([2, 0, 0, 0, 0, 0], (None, None, None), "not understood"),
    ],
)
def test_what_it_means(rconf, expected, reason):
    posture, why = posture_of(rconf)
    assert posture[:3] == expected
    assert reason in why
    assert bool(why) == bool(reason)


PULSES_OF = ["///TOOL 1", "///POSTYPE PULSE", "///PULSE", "P00005=1000,2000,3000,4000,5000,6000"]


@pytest.mark.parametrize(
    ("moves", "other", "why"),
    [
        (["MOVJ P005 VJ=1"], ["WAIT IN#(1)=ON"], ""),
        (["MOVJ P005 VJ=1", "SVSPOTMOV P005 V=10"], ["'P005"], ""),
        (["MOVJ P005 VJ=1", "CALL JOB:TEST"], ["WAIT IN#(1)=ON"], ""),
        (["MOVJ P005 VJ=1", "CALL JOB:AWAY"], ["WAIT IN#(1)=ON"], "AWAY, called in line"),
        (["MOVJ P005 VJ=1"], ["SETE P005 (3) 1000"], "b.jbi uses it, too"),
        (["MOVJ P005 VJ=1"], ["MOVJ P[B000] VJ=1"], "by an index that is computed"),
        (["MOVJ P005 VJ=1", "SETE P005 (3) 1000"], ["WAIT IN#(1)=ON"], "uses it in another way"),
    ],
)
def test_position_variables_are_targets_where_no_other_job_uses_them(robots, tmp_path, moves, other, why):
    nominal, _, at = robots
    (tmp_path / "a.jbi").write_bytes(job(PULSES_OF, moves))
    (tmp_path / "b.jbi").write_bytes(job([], other))
    setup = given(at, **FRAMES)._replace(pulses=PULSES)
    first, _ = inform.read_for(nominal, [tmp_path / "a.jbi", tmp_path / "b.jbi"], setup)
    (target,) = first.targets
    assert target.name == "P5"
    assert (why in target.reason) if why else target.correctable, target.reason
    assert any("is a position variable" in note.text for note in first.notes) == (not why)
