"""Trajectories of ROS: what is read in all the forms there are, and what is refused in words."""

import numpy as np
import pytest
import yaml
from ros_cases import ECHO, NAMES, message

from irbcal.correction.languages import ros
from irbcal.correction.program import Given
from irbcal.errors import OptionError, ProgramError
from irbcal.files import urdf
from irbcal.files.controller_frames import unknown
from irbcal.modeling import frames


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
        ros.read_for(nominal, [tmp_path / "a.yaml"], Given({"t": frames.transform()}, {}, unknown()))


def test_it_looks_like_a_trajectory():
    assert ros.looks_like(ECHO.encode())
    assert not ros.looks_like(b"kinematics:\n  shoulder: {x: 0}\n")
