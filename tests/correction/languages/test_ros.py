"""Nodes of YAML stand where the text has them."""

import re

import numpy as np
import pytest
import yaml
from ros_cases import ECHO, NAMES, message

from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.languages import ros
from irbcal.correction.languages.ros import NodeReader, document, line_of
from irbcal.correction.program import ControllerSetup
from irbcal.errors import OptionError, ProgramError
from irbcal.io import urdf
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.trajectory import Trajectory


def test_numbers_are_found_where_they_stand_behind_letters_of_several_bytes():
    text = "# größe ü\na: [1.5, -2e3]\nb:\n  - 7\n"
    read = NodeReader("x.yaml")
    found = read.mapping(document(text, "x.yaml"), "something")
    numbers = [read.number(one, "n") for one in (*read.elements(found["a"], "a"), *read.elements(found["b"], "b"))]
    assert [n.value for n in numbers] == [1.5, -2000.0, 7.0]
    assert [text[n.start : n.end] for n in numbers] == ["1.5", "-2e3", "7"]
    assert line_of(found["b"]) == 4


@pytest.mark.parametrize("text", ["1_0", "\u0661", "", "one", "[1]"])
def test_what_is_no_number_is_refused(text):
    read = NodeReader("x.yaml")
    node = read.mapping(document(f"a: {text}", "x.yaml"), "something")["a"]
    with pytest.raises(ProgramError, match=r"x\.yaml: line 1: expected a speed"):
        read.number(node, "a speed")


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_numbers_of_the_arm_change_and_nothing_else(newline, mark):
    nominal = urdf.read("irb1600").arm
    data = (mark + ECHO.replace("\n", newline)).encode()
    program = ros.parse(nominal, data, "a.yaml")
    (goals,) = program.wanted_targets()
    fake = correct_joints(Robot(nominal), nominal, goals.values)
    (out,) = program.with_fake_targets([(goals, fake)], "abc123").values()
    again = ros.parse(nominal, out, "a.yaml")
    assert again.fingerprint == "abc123"
    assert again.trajectory.q == pytest.approx(program.trajectory.q, abs=1e-9)
    assert "9.5" in out.decode()  # the gripper's

    def bare(text):
        return re.sub(r"-?\d+\.?\d*(e-1)?", "N", text)

    assert bare(out.decode().removesuffix(f"# irbcal fake targets, calibration abc123{newline}")) == bare(data.decode())
    assert out.decode().count("\r") == newline.count("\r") * out.decode().count("\n")


def test_speeds_are_written_where_they_are_and_an_uncorrected_file_stays():
    nominal = urdf.read("irb1600").arm
    data = message().encode()
    program = ros.parse(nominal, data, "a.yaml")
    (goals,) = program.wanted_targets()
    fake = correct_joints(Robot(nominal), nominal, goals.values)
    moving = program.with_motion(program.trajectory.slowed(2.0).with_derivatives())
    (out,) = moving.with_fake_targets([(goals, fake)], "x").values()
    assert ros.parse(nominal, out, "a.yaml").trajectory.dq == pytest.approx(np.full((3, 6), 0.05), abs=1e-12)
    far = correct_joints(Robot(nominal), nominal, goals.values + 9.0)
    assert program.with_fake_targets([(goals, far)], "x") == {"a.yaml": data}


@pytest.fixture(scope="module")
def nominal():
    return urdf.read("irb1600").arm


def test_what_ros2_topic_echo_prints(nominal):
    program = ros.parse(nominal, ECHO.encode(), "a.yaml")
    motion = program.trajectory
    assert motion.times.tolist() == [0.5, 2.25]
    assert motion.names == nominal.joint_names
    assert motion.q.tolist() == [[0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [-0.1, 0.3, 0.3, 0.4, 0.5, 1.0]]
    assert motion.dq is None
    assert program.lines == (6, 13)
    assert program.fingerprint is None
    (note,) = program.notes
    assert note.line == 13
    assert [ECHO[a:b] for a, b in program.spans["positions"][6:8]] == ["-0.1", "0.3"]


@pytest.mark.parametrize("key", ["trajectory", "joint_trajectory", "goal"])
def test_the_goal_of_an_action_around_it(nominal, key):
    inside = yaml.safe_load(message())
    text = yaml.safe_dump({key: {"trajectory": inside} if key == "goal" else inside})
    assert np.array_equal(ros.parse(nominal, text.encode(), "a.yml").trajectory.q, [[0.1 * k] * 6 for k in range(3)])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (message(time_from_start=0.5), "times of a trajectory grow, but point 3 is at 0.5 s after 0.5 s"),
        (message(time_from_start=float("nan")), "line .*: expected time_from_start as a finite number, found '.nan'"),
        (message(time_from_start=None), "expected time_from_start as a finite number"),
        (message(positions=[float("inf")] * 6), "expected one of the positions as a finite number, found '.inf'"),
        (message(positions=[0.1] * 5), "point 3 has 5 positions for 6 joints"),
        (message(velocities=[]), "point 3 has no velocities, others have"),
        (message(velocities=["x"] * 6), "expected one of the velocities as a finite number, found 'x'"),
        (message(wrong={"joint_names": [*NAMES[:5], "elbow"]}), "expected the joints joint_1, .*, found .*elbow"),
        (message(wrong={"joint_names": [*NAMES[:5], "joint_1"]}), "the joint joint_1 stands in joint_names a second"),
        (message(wrong={"points": []}), "the trajectory has no points"),
        (message(wrong={"points": 3}), "expected points as a list"),
        ("points: []", "joint_names is missing"),
        ("- a", "expected a trajectory with names and values"),
        ("a: [1", "line 2: this is no YAML: did not find expected"),
        ("---\n---\n", "found 0 YAML documents"),
        (message() + "---\n" + message(), "expected one trajectory, found 2"),
        ("[" * 3000, "this is no"),
        (message().replace("joint_names:", "points: []\njoint_names:"), "points stands here a second time"),
    ],
)
def test_refusals_name_what_is_wrong(nominal, text, words):
    with pytest.raises(ProgramError, match=words) as refusal:
        ros.parse(nominal, text.encode(), "a.yaml")
    assert str(refusal.value).startswith("a.yaml: ")


def test_what_is_no_text_and_frames_are_refused(nominal, tmp_path):
    with pytest.raises(ProgramError, match="line 2: expected UTF-8 text"):
        ros.parse(nominal, b"a: 1\n\xff", "a.yaml")
    text = message().replace("positions: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]", "positions: &a [0, 0, 0, 0, 0, 0]")
    text = text.replace("positions: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]", "positions: *a")
    with pytest.raises(ProgramError, match=r"two points share one list of numbers \(an alias\)"):
        ros.parse(nominal, text.encode(), "a.yaml")
    with pytest.raises(OptionError, match="holds joints: there is no frame to give"):
        ros.read_for(nominal, [tmp_path / "a.yaml"], ControllerSetup({"t": frames.transform()}, {}, unknown_frames()))


def test_it_looks_like_a_trajectory():
    assert ros.looks_like(ECHO.encode())
    assert not ros.looks_like(b"kinematics:\n  shoulder: {x: 0}\n")


def test_written_messages_are_what_they_say():
    rng = np.random.default_rng(1)
    times = np.array([0.0, 0.1, 0.30000000004, 12.999999999999])
    q, dq = rng.standard_normal((2, 4, 2))
    found = yaml.safe_load(ros.to_yaml(Trajectory(times, q, dq, names=("a", "b")), "base"))
    assert found["joint_names"] == ["a", "b"]
    assert found["header"]["frame_id"] == "base"
    points = found["points"]
    assert np.array([p["positions"] for p in points]) == pytest.approx(q, abs=1e-12)
    assert np.array([p["velocities"] for p in points]) == pytest.approx(dq, abs=1e-12)
    assert all(p["accelerations"] == [] for p in points)
    assert points[2]["time_from_start"] == {"sec": 0, "nanosec": 300000000}
    assert points[3]["time_from_start"] == {"sec": 13, "nanosec": 0}
