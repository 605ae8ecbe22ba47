"""Speeds of a URDF, against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from irbcal.files import robots
from irbcal.files.speed_limits import speed_limits


def test_speeds_are_those_that_pinocchio_reads():
    data = robots.robot_file("irb1600").read_bytes()
    names = [f"joint_{k}" for k in range(6, 0, -1)]
    model = pin.buildModelFromXML(data.decode())
    expected = [model.velocityLimit[model.joints[model.getJointId(name)].idx_v] for name in names]
    assert speed_limits(data, names) == pytest.approx(expected)
    assert np.isinf(
        speed_limits(b'<robot name="a"><joint name="j"><limit velocity="0"/></joint></robot>', ["j", "k"])
    ).all()
