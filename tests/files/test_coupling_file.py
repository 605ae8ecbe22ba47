"""The file beside a URDF that declares how joints are coupled."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import RobotError
from irbcal.files.robots import robot_file


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "my.urdf"
    path.write_bytes(robot_file("irb120").read_bytes())
    return path


def test_without_a_file_there_is_none(robot):
    assert irbcal.read_urdf(robot).arm.coupling is None


def test_the_file_is_read(robot):
    robot.with_name("my.coupling.yaml").write_text("coupling: 3-2\n")
    expected = np.eye(6)
    expected[2, 1] = -1.0
    np.testing.assert_array_equal(irbcal.read_urdf(robot).arm.coupling, expected)
    robot.with_name("my.coupling.yaml").write_text(f"coupling: {expected.tolist()}\n")
    np.testing.assert_array_equal(irbcal.read_urdf(robot).arm.coupling, expected)


@pytest.mark.parametrize("text", ["3+2", "coupling:", "coupling: 3+9", "coupling: [1, 2]", "other: 3+2", "[", "\x00"])
def test_what_is_not_understood_is_refused(robot, text):
    robot.with_name("my.coupling.yaml").write_text(text)
    with pytest.raises(RobotError, match="coupling"):
        irbcal.read_urdf(robot)
