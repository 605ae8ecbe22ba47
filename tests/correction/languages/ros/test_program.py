"""What is written back into a trajectory: the numbers of the arm's joints, and no other byte."""

import re

import numpy as np
import pytest
from ros_cases import ECHO, message

from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.languages import ros
from irbcal.files import urdf
from irbcal.modeling.robot import Robot


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_numbers_of_the_arm_change_and_nothing_else(newline, mark):
    nominal = urdf.read("irb1600").arm
    data = (mark + ECHO.replace("\n", newline)).encode()
    program = ros.parse(nominal, data, "a.yaml")
    (goals,) = program.goals()
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
    (goals,) = program.goals()
    fake = correct_joints(Robot(nominal), nominal, goals.values)
    moving = program.with_motion(program.trajectory.slowed(2.0).with_derivatives())
    (out,) = moving.with_fake_targets([(goals, fake)], "x").values()
    assert ros.parse(nominal, out, "a.yaml").trajectory.dq == pytest.approx(np.full((3, 6), 0.05), abs=1e-12)
    far = correct_joints(Robot(nominal), nominal, goals.values + 9.0)
    assert program.with_fake_targets([(goals, far)], "x") == {"a.yaml": data}
