"""Live correction: right where it goes, and never a wild or jumping command, in Python and in C++."""

import json
import os
import shutil
import subprocess

import numpy as np
import pytest
from export_harness import COMPILERS, WARNINGS
from stream_cases import beyond, faults, fuzzed, move, quaternion
from support import assert_same_poses, random_robot

import irbcal
from irbcal.errors import OptionError
from irbcal.exporting import cpp
from irbcal.exporting.live_correction import Live
from irbcal.exporting.source import Source
from irbcal.io import urdf
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.inverse.orthoparallel import OrthoParallel

needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C++ compiler")
FUZZER = shutil.which("clang++")


def answers(live, rows, kind="joints", start=0.0, step=1e-3, **more):
    """Answers to rows, a millisecond from one to the next."""
    lines = [{kind: np.asarray(row).tolist(), "t": start + step * k, **more} for k, row in enumerate(rows)]
    return [json.loads(live.answer(json.dumps(line))) for line in lines]


def opened(source, at, units="rad", **options):
    return Live(source, units, at=np.asarray(at).tolist(), **options)


def standing(row, n):
    return np.repeat([row], n, axis=0)


def nine_joints(folder):
    """A robot with nine joints that turn."""
    axes = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0.0{k % 3} 0 0.2" rpy="0 0 0.1"/><axis xyz="{axis}"/>'
        f'<limit lower="-2.5" upper="2.5" effort="1" velocity="2"/></joint><link name="l{k + 1}"/>'
        for k, axis in enumerate(axes)
    )
    path = folder / "nine.urdf"
    path.write_text(f'<robot name="nine"><link name="l0"/>{joints}</robot>')
    return random_robot(urdf.read(path, "l0", "l9").arm, "placement", np.random.default_rng(1), 0.2)


def built(source, folder, compiler, *options, name="stream"):
    """The exported program."""
    for file, content in cpp.files(source).files.items():
        (folder / file).write_bytes(content)
    call = [compiler, "-std=c++17", *options, *folder.glob("*_stream.cpp"), "-o", folder / name]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / name


def compare(program, source, lines, at):
    """Both programs say the same to the same lines."""
    words = ",".join(map(repr, at.tolist()))
    done = subprocess.run([program, "--units", "rad", "--at", words], input=b"".join(lines), capture_output=True)
    assert done.returncode == 0, done.stderr
    theirs = done.stdout.decode(errors="replace").splitlines()
    live = opened(source, at)
    assert len(theirs) == len(lines)
    for line, other in zip(lines, map(json.loads, theirs), strict=True):
        one = json.loads(live.answer(line))
        numbers = {"joints", "error_m", "error_rad"}
        assert {k: v for k, v in one.items() if k not in numbers} == {
            k: v for k, v in other.items() if k not in numbers
        }, line
        for name in numbers & set(one):
            if one[name] is not None:
                assert np.abs(np.array(one[name]) - other[name]).max() < 1e-7  # times of 20 us magnify rounding
    return done.stderr


@pytest.mark.parametrize("name", ["irb1600", "panda"])
def test_the_tool_goes_where_the_nominal_robot_would_go(sources, name):
    source = sources[name]
    robot = source.robot
    wanted = move(robot, 700, 3, 0.3)
    live = opened(source, wanted[0])
    nominal = robot.arm.with_table(robot.joint_map.terms.arm.table)
    said = answers(live, wanted)
    assert not any(one["held"] for one in said)
    assert said[0]["joints"] == wanted[0].tolist()  # the arm stands there
    assert said[0]["error_m"] > 1e-4
    error = np.array([(one["error_m"], one["error_rad"]) for one in said])
    assert error[400:].max() < 1e-5
    assert (error[400:] < 1e-9).all(axis=1).mean() > 0.5  # what it goes on with after the start, exactly
    at = 400 + int(np.argmin(error[400:].max(axis=1)))
    again = opened(source, wanted[0])
    answers(again, wanted[: at + 1])
    q, moves = np.array([said[at]["joints"]]), np.array([again._moves])
    if np.abs(moves / source.numbers.stride).max() > 0.999:  # the lean is that of a whole move
        assert_same_poses(robot.forward(q, q - moves), nominal.forward(wanted[at : at + 1]), 1e-8, 1e-8)


def test_poses_follow_joints(sources):
    source = sources["irb1600"]
    wanted = move(source.robot, 600, 5, 0.2)
    by_joints = answers(opened(source, wanted[0]), wanted)
    T = source.robot.joint_map.terms.arm.forward(wanted)
    by_poses = answers(opened(source, wanted[0]), [[*pose[:3, 3], *quaternion(pose)] for pose in T], "pose")
    assert not any(one["held"] for one in by_joints + by_poses)
    assert np.abs(np.subtract(by_joints[-1]["joints"], by_poses[-1]["joints"])).max() < 1e-6


def test_what_is_not_safe_is_held_with_a_reason(sources):
    source = sources["level"]
    live = Live(source, "deg")
    wanted = [0, -14, 14, 0, 30, 0]
    (first,) = answers(live, [wanted])
    assert first == {"t": 0.0, "joints": None, "held": True, "why": "the first line needs at, the arm's actual joints"}
    assert answers(live, [wanted], start=0.1, at=wanted)[0]["joints"] == pytest.approx(wanted, abs=1e-12)
    last = answers(live, standing(wanted, 900), start=0.2)[-1]
    live.answer(json.dumps({"joints": wanted, "t": 2.0, "id": 7}))
    for line, why in (
        (b"{", "not a line of JSON"),
        (b"\xff\xfe", "not a line of JSON"),
        (b"[" * 100_000, "not a line of JSON"),
        ("\ud800", "not a line of JSON"),
        (b"[1]", "expected an object"),
        (b'{"joint": [], "t": 3}', "expected one of joints, pose and model"),
        (b'{"joints": [0, -14, 14, 0, 30], "t": 4}', "joints: expected 6 numbers"),
        (b'{"joints": [0, -14, 14, 0, 30, true], "t": 5}', "joints: expected 6 numbers"),
        (b'{"joints": [0, -14, 14, 0, 30, NaN], "t": 6}', "joints: not a finite number"),
        (b'{"joints": [0, -14, 14, 0, 30, 1e400], "t": 7}', "joints: not a finite number"),
        (b'{"joints": [0, -14, 14, 0, 65, 0], "t": 8}', "would jump"),
        (b'{"model": [0, 123, 14, 0, 30, 0], "t": 9}', "joint_2 would leave its limits"),
        (b'{"model": [0, 200, 14, 0, 30, 0], "t": 10}', "model: joint_2 is beyond its limits"),
        (b'{"pose": [0, 0, 9000, 1, 0, 0, 0], "t": 11}', "pose: no solution near the last command"),
        (b'{"pose": [600, 0, 900, 2, 0, 0, 0], "t": 12}', "unit quaternion"),
        (b'{"joints": [0, -14, 14, 0, 30, 0], "t": 12}', "t: not later than that of an earlier line"),
        (b'{"joints": [0, -14, 14, 0, 30, 0], "t": "x"}', "t: expected seconds"),
        (b'{"joints": [0, -14, 14, 0, 30, 0], "t": 1e12}', "t: expected seconds"),
        (b'{"joints": [0, -14, 14, 0, 30, 0]}', "t: expected in every line, as in the first"),
        (b'{"joints": [0, -14, 14, 0, 30, 0], "t": 13, "id": 7}', "id: 7 is not above 7, that of an earlier line"),
        (b'{"joints": [0, -14, 14, 0, 30, 0], "t": 14, "id": 1.5}', "id: expected a whole number"),
        (b'{"joints": [0, -14, 14, 0, 30, 0], "t": 15, "at": [0]}', "at: the arm's joints are known"),
    ):
        said = json.loads(live.answer(line))
        assert said["held"], line
        assert why in said["why"], said
        assert said["joints"] == pytest.approx(last["joints"], abs=1e-6)
    assert not answers(live, [[0.1, -14, 14, 0, 30, 0]], start=20.0)[0]["held"]


def test_radians_and_degrees_are_not_mistaken(sources):
    source = sources["level"]
    degrees = [0.0, -14, 14, 0, 30, 0]
    with pytest.raises(OptionError, match="at: joint_2 is beyond its limits: these look like degrees"):
        opened(source, degrees)
    live = opened(source, np.radians(degrees))
    assert "these look like degrees" in answers(live, [degrees])[0]["why"]
    live = opened(source, degrees, "deg")
    assert "would jump" in answers(live, [np.radians(degrees)])[0]["why"]


def test_a_burst_of_queued_lines_does_not_hurry_the_arm(sources):
    """Lines without times count for the time that the clock says has passed."""
    source = sources["level"]
    now = [0.0]
    live = Live(source, "rad", at=[0, -0.25, 0.25, 0, 0.5, 0], clock=lambda: now[0])
    times, rows = [], []
    for k in range(400):
        now[0] += 2e-5 if 100 < k < 300 else 1e-3
        q = np.array([1e-3 * k, -0.25, 0.25, 0, 0.5, 0])
        said = json.loads(live.answer(json.dumps({"joints": q.tolist()})))
        times.append(now[0])
        rows.append(said["joints"])
    rows, times = np.array(rows), np.array(times)
    assert rows[:, 0].max() > 0.05
    for k in range(len(rows) - 3):
        assert not beyond(rows[k : k + 4], times[k : k + 4], live)


@pytest.mark.parametrize("name", ["irb1600", "rail"])
def test_fuzzed_lines_never_exceed_a_limit(sources, name):
    source = sources[name]
    lines, at = fuzzed(source.robot, 400, 1)
    live = opened(source, at)
    found, held = faults([live.answer(line) for line in lines], live, source)
    assert found == []
    assert 40 < held < 390


def beside_axis_1(nominal, speed, step):
    """Joints of a straight path (m/s, s) on which the wrist centre passes axis 1 at 7 mm, 60 mm to each side."""
    q = np.radians([0.0, -20.0, 0.0, 10.0, 40.0, 0.0])
    closed = OrthoParallel.from_arm(nominal)
    rows = np.repeat(q[None], 4000, axis=0)
    rows[:, 2] = np.linspace(nominal.lower[2], np.radians(-60), len(rows))
    start = rows[np.argmin(np.abs(closed.radius(rows) - 0.06))]
    way = np.arange(0.0, 0.12, speed * step)
    T = np.repeat(nominal.forward(start[None]), len(way), axis=0)
    T[:, 0, 3] -= way
    T[:, 1, 3] += 0.007
    q = closed_form.branches(nominal, T).joints[:, closed.configuration(start)]
    assert np.isfinite(q).all()
    return np.unwrap(q, axis=0)


@pytest.mark.parametrize(("speed", "step"), [(0.01, 0.01), (0.1, 0.002)])
def test_a_path_beside_axis_1_is_damped_and_goes_on(folder, speed, step):
    """The correction is bounded, what it leaves is told; where joints cannot follow, the arm comes back by itself."""
    nominal = irbcal.load(folder).arm(calibrated=False)
    wanted = beside_axis_1(nominal, speed, step)
    wanted = np.concatenate([wanted, standing(wanted[-1], int(1.5 / step))])
    live = irbcal.stream(folder, units="rad", at=wanted[0].tolist())
    said = answers(live, wanted, step=step)
    held = np.array([one["held"] for one in said])
    q = np.array([one["joints"] for one in said])
    left = np.array([one.get("error_m", np.nan) for one in said])
    assert not held[-int(1.0 / step) :].any()
    assert left[-1] < 1e-8
    q_stood = np.concatenate([standing(q[0], 2), q])
    times = np.concatenate([[-2e-4, -1e-4], step * np.arange(len(q))])
    for k in range(len(q) - 1):
        assert not beyond(q_stood[k : k + 4], times[k : k + 4], live)
    if speed < 0.05:  # 82 degrees a second of joint 1, which it can
        assert not held.any()
        assert np.abs(q - wanted).max() < np.radians(3.5)  # bounded at 3 degrees, the joint map's shift added
        assert 1e-4 < left[50:].max() < 2e-3
        assert left[:50].max() < 0.03
    else:
        assert held.any()


@needs_compiler
def test_the_exported_program_says_the_same(sources, tmp_path):
    source = sources["panda"]
    program = built(source, tmp_path, COMPILERS[0], "-O0", *WARNINGS)
    lines, at = fuzzed(source.robot, 400, 2)
    lines += [b'{"id": 2000, "a": "\\C"}\n', b'{"id": 2001, "a": "\\u12g4"}\n', b'{"id": 2002, "a": "\\u00e9"}\n']
    lines += [b'{"joints": [' + b" " * 70_000 + b"]}\n", b'{"id": 12, "id": 4}\n', b"\n", b'{"model": [1]} x\n', b"{}"]
    assert b"99.9th percentile" in compare(program, source, lines, at)
    assert subprocess.run([program, "--to-speed", "none"], capture_output=True).returncode == 2
    for wrong in ("1,2", "1,2,3,4,5,6,7,8", "a", "900,0,0,0,0,0,0"):
        done = subprocess.run([program, "--at", wrong], capture_output=True, text=True)
        assert done.returncode == 2
        assert done.stderr.startswith("at: ")


@needs_compiler
def test_nine_joints(tmp_path):
    """More joints than a pose has numbers: every one is its own, and no memory beyond them is touched."""
    robot = nine_joints(tmp_path)
    source = Source.of_robot(robot)
    program = built(source, tmp_path, COMPILERS[-1], "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    lines, at = fuzzed(robot, 120, 4)
    compare(program, source, lines, at)
    wanted = at + 1e-3 * np.arange(9)
    lines = [json.dumps({"model": wanted.tolist(), "t": 0.01 * k}).encode() + b"\n" for k in range(300)]
    words = ",".join(map(repr, at.tolist()))
    done = subprocess.run([program, "--units", "rad", "--at", words], input=b"".join(lines), capture_output=True)
    assert done.returncode == 0, done.stderr
    found = np.array(json.loads(done.stdout.splitlines()[-1])["joints"])
    assert np.abs(robot.joint_map.effective(found[None])[0] - wanted).max() < 1e-6


@pytest.mark.skipif(FUZZER is None, reason="no clang++ (Debian: clang, libclang-rt-14-dev)")
def test_the_exported_program_under_a_fuzzer(sources, tmp_path):
    """libFuzzer, seeded: no memory or arithmetic fault, no command that is not finite or faster than its joint."""
    source = sources["irb1600"]
    options = (
        "-O1",
        "-gline-tables-only",
        "-DIRBCAL_FUZZ",
        "-fsanitize=fuzzer,address,undefined",
        "-fno-sanitize-recover=all",
    )
    try:
        program = built(source, tmp_path, FUZZER, *options, name="fuzzer")
    except AssertionError as error:
        if "libclang_rt" not in str(error):
            raise
        pytest.skip("no libFuzzer (Debian: libclang-rt-14-dev)")
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    for seed in range(4):
        lines, at = fuzzed(source.robot, 30, seed)
        first = json.dumps({"joints": at.tolist(), "at": at.tolist(), "t": -1.0}).encode() + b"\n"
        (corpus / str(seed)).write_bytes(first + b"".join(lines))
    runs = os.environ.get("IRBCAL_FUZZ_RUNS", "400")
    call = [
        program,
        "-seed=1",
        f"-runs={runs}",
        "-max_len=8000",
        "-timeout=10",
        f"-artifact_prefix={tmp_path}/",
        corpus,
    ]
    done = subprocess.run(call, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr[-3000:]


def test_options_and_units(folder):
    with pytest.raises(OptionError, match="to_speed"):
        irbcal.stream(folder, to_speed=0.0)
    with pytest.raises(OptionError, match="units"):
        irbcal.stream(folder, units="gon")
    with pytest.raises(OptionError, match="at: expected 6 numbers"):
        irbcal.stream(folder, at=[0, 1])
    q = np.array([10.0, -20, 20, 5, 40, 30])
    degrees, radians = (
        answers(irbcal.stream(folder, units=units, at=values.tolist()), standing(values, 900))[-1]
        for units, values in (("deg", q), ("rad", np.radians(q)))
    )
    assert np.abs(np.radians(degrees["joints"]) - radians["joints"]).max() < 1e-9
    robot = irbcal.load(folder).robot_calibrated()
    nominal = irbcal.load(folder).arm(calibrated=False)
    assert_same_poses(robot.poses([radians["joints"]]), nominal.forward(np.radians([q])), 1e-8, 1e-8)
