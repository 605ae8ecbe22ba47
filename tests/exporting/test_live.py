"""Live correction: right where it goes, and never a wild or jumping command, in Python and in C++."""

import json
import subprocess

import numpy as np
import pytest
from export_harness import COMPILERS, WARNINGS
from stream_cases import faults, fuzzed, move, quaternion
from support import assert_same_poses

import irbcal
from irbcal.errors import OptionError
from irbcal.exporting import cpp
from irbcal.exporting.live import Live


def answers(live, rows, kind="joints"):
    return [json.loads(live.answer(json.dumps({kind: np.asarray(row).tolist()}))) for row in rows]


@pytest.mark.parametrize("name", ["irb1600", "panda"])
def test_the_tool_goes_where_the_nominal_robot_would_go(sources, name):
    source = sources[name]
    live, robot = Live(source, 1000.0, "rad"), source.robot
    wanted = move(robot, 300, 3)
    nominal = robot.arm.with_table(robot.joint_map.terms.arm.table)
    for row in wanted:
        said = json.loads(live.answer(json.dumps({"joints": row.tolist()})))
        assert not said["held"], said
    q = np.array([said["joints"]])
    assert np.abs(q - wanted[-1]).max() > 1e-4  # there was something to correct
    moves = np.array([live._moves])
    assert 0.05 < np.abs(moves / source.parts.stride).max() <= 1.0 + 1e-12
    full = np.abs(moves / source.parts.stride).max()
    if full > 0.999:  # the lean is that of a whole move: irbcal's own model says where the arm is
        assert_same_poses(robot.forward(q, q - moves), nominal.forward(wanted[-1:]), 1e-9, 1e-9)


def test_a_long_way_one_way_is_exact_and_turning_back_is_smooth(sources):
    source = sources["ur10"]
    live, robot = Live(source, 1000.0, "rad"), source.robot
    there = np.linspace(0, 0.2, 200)[:, None] * np.array([1, -0.7, 0.4, 0.9, 0.3, -0.5]) + np.array(
        [0, -1, 1, 0.2, 1, 0.3]
    )
    wanted = np.concatenate([there, there[::-1]])
    q = np.array([said["joints"] for said in answers(live, wanted, "model")])
    end = q[199:200]
    moves = source.parts.stride * np.array([[1, -0.7, 0.4, 0.9, 0.3, -0.5]])
    assert np.abs(robot.joint_map.effective(end, end - moves) - wanted[199]).max() < 1e-9
    correction = np.diff(q - wanted, axis=0)
    assert np.abs(correction).max() < 5e-5  # where the steps themselves are a thousandth of a radian
    assert np.abs(q[0] - q[-1]).max() > 1e-5  # it leans to the other side now


def test_poses_follow_joints(sources):
    source = sources["irb1600"]
    wanted = move(source.robot, 60, 5)
    by_joints = answers(Live(source, 1000.0, "rad"), wanted)
    T = source.robot.joint_map.terms.arm.forward(wanted)
    live = Live(source, 1000.0, "rad")
    poses = [[*pose[:3, 3], *quaternion(pose)] for pose in T]
    assert answers(live, poses[:1], "pose")[0] == {
        "joints": None,
        "held": True,
        "why": "pose: the first line must tell joints or model, to know which way the arm is bent",
    }
    answers(live, wanted[:1])
    by_poses = answers(live, poses[1:], "pose")
    for one, other in zip(by_joints[1:], by_poses, strict=True):
        assert not other["held"]
        assert np.abs(np.array(one["joints"]) - other["joints"]).max() < 1e-8


def test_what_is_not_safe_is_held_with_a_reason(sources):
    source = sources["level"]
    live = Live(source, 1000.0, "deg")
    (first,) = answers(live, [[0, -14, 14, 0, 30, 0]])
    assert list(first) == ["joints", "held"]
    for line, why in (
        (b"{", "not a line of JSON"),
        (b"\xff\xfe", "not a line of JSON"),
        (b"[" * 100_000, "not a line of JSON"),
        (b"[1]", "expected an object"),
        (b'{"joint": []}', "expected one of joints, pose and model"),
        (b'{"joints": [0, -14, 14, 0, 30]}', "joints: expected 6 numbers"),
        (b'{"joints": [0, -14, 14, 0, 30, true]}', "joints: expected 6 numbers"),
        (b'{"joints": [0, -14, 14, 0, 30, NaN]}', "joints: not a finite number"),
        (b'{"joints": [0, -14, 14, 0, 30, 1e400]}', "joints: not a finite number"),
        (b'{"joints": [0, -14, 14, 0, 35, 0]}', "would jump"),
        (b'{"model": [0, 200, 14, 0, 30, 0]}', "would leave its limits"),
        (b'{"pose": [0, 0, 9000, 1, 0, 0, 0]}', "pose: no solution near the last command"),
        (b'{"pose": [600, 0, 900, 2, 0, 0, 0]}', "unit quaternion"),
    ):
        said = json.loads(live.answer(line))
        assert said["held"]
        assert why in said["why"], said
        assert said["joints"] == first["joints"]
    assert json.loads(live.answer(b'{"joints": [], "id": 7}'))["id"] == 7
    (again,) = answers(live, [[0.1, -14, 14, 0, 30, 0]])
    assert not again["held"]
    assert (live.lines, live.held) == (16, 14)


@pytest.mark.parametrize("name", ["irb1600", "rail"])
def test_fuzzed_lines_never_make_a_wild_or_jumping_command(sources, name):
    source = sources[name]
    live = Live(source, 1000.0, "rad")
    said = [live.answer(line) for line in fuzzed(source.robot, 400, 1)]
    found, held = faults(said, source, live.steps)
    assert found == []
    assert 40 < held < 390


@pytest.mark.skipif(not COMPILERS, reason="no C++ compiler")
def test_the_exported_program_says_the_same(sources, tmp_path):
    source = sources["panda"]
    for name, content in cpp.files(source).files.items():
        (tmp_path / name).write_bytes(content)
    call = [COMPILERS[0], "-std=c++17", "-O0", *WARNINGS, *tmp_path.glob("*_stream.cpp"), "-o", tmp_path / "stream"]
    subprocess.run(call, check=True)
    live, lines = Live(source, 1000.0, "rad"), fuzzed(source.robot, 400, 2)
    lines += [b'{"joints": [' + b" " * 70_000 + b"]}\n", b'{"id": 12, "id": 4}\n', b"\n", b'{"model": [1]} x\n', b"{}"]
    done = subprocess.run([tmp_path / "stream", "--units", "rad"], input=b"".join(lines), capture_output=True)
    assert done.returncode == 0
    said = done.stdout.decode(errors="replace").splitlines()
    assert len(said) == len(lines)
    for line, theirs in zip(lines, said, strict=True):
        one, other = json.loads(live.answer(line)), json.loads(theirs)
        assert {k: v for k, v in one.items() if k != "joints"} == {k: v for k, v in other.items() if k != "joints"}, (
            line
        )
        if one["joints"] is not None:
            assert np.abs(np.array(one["joints"]) - other["joints"]).max() < 1e-9
    assert b"99.9th percentile" in done.stderr
    assert subprocess.run([tmp_path / "stream", "--rate", "none"], capture_output=True).returncode == 2


def test_options_and_units(folder):
    with pytest.raises(OptionError, match="rate"):
        irbcal.stream(folder, rate=0.0)
    with pytest.raises(OptionError, match="units"):
        irbcal.stream(folder, units="gon")
    q = np.array([10.0, -20, 20, 5, 40, 30])
    (degrees,), (radians,) = (
        answers(irbcal.stream(folder, units=units), [values]) for units, values in (("deg", q), ("rad", np.radians(q)))
    )
    assert np.abs(np.radians(degrees["joints"]) - radians["joints"]).max() < 1e-12
    robot = irbcal.load(folder).robot_calibrated()
    nominal = irbcal.load(folder).arm(calibrated=False)
    assert_same_poses(robot.poses([radians["joints"]]), nominal.forward(np.radians([q])), 1e-9, 1e-9)
