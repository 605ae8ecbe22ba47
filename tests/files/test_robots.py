"""The nominal URDF files as other tools see them."""

import logging
import warnings

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

from irbcal.errors import OptionError, RobotError
from irbcal.files import robots, urdf

LIMITS_DEG = {
    "irb1600": [(-180, 180), (-90, 120), (-245, 65), (-200, 200), (-115, 115), (-400, 400)],
    "irb120": [(-165, 165), (-110, 110), (-110, 70), (-160, 160), (-120, 120), (-400, 400)],
}
SPEEDS_DEG = {"irb1600": [150, 160, 170, 320, 400, 460], "irb120": [250, 250, 250, 320, 320, 420]}
LINKS = ["base_link", *(f"link_{i}" for i in range(1, 7)), "flange", "tool0"]


@pytest.mark.parametrize("name", robots.ROBOTS)
def test_yourdfpy_reads_it_without_a_warning_and_agrees(name, caplog):
    with warnings.catch_warnings(), caplog.at_level(logging.WARNING):
        warnings.simplefilter("error")
        seen = yourdfpy.URDF.load(str(robots.robot_file(name)), load_meshes=False)
    assert caplog.records == []
    assert seen.validate()
    robot = urdf.read(name).arm
    for q in robot.random_joints(20, 0):
        seen.update_cfg(q)
        assert np.abs(seen.get_transform("tool0", "base_link") - robot.forward(q[None])[0]).max() < 1e-12


@pytest.mark.parametrize("name", robots.ROBOTS)
def test_frames_limits_speeds_and_masses(name):
    path = str(robots.robot_file(name))
    model = pin.buildModelFromUrdf(path)
    assert model.njoints == 7
    assert np.abs(np.degrees(model.lowerPositionLimit) - [low for low, _ in LIMITS_DEG[name]]).max() < 1e-9
    assert np.abs(np.degrees(model.upperPositionLimit) - [high for _, high in LIMITS_DEG[name]]).max() < 1e-9
    assert np.abs(np.degrees(model.velocityLimit) - SPEEDS_DEG[name]).max() < 1e-9
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(6))
    for link in LINKS[:-1]:
        assert np.abs(data.oMf[model.getFrameId(link)].rotation - np.eye(3)).max() < 1e-15, link
    for inertia in list(model.inertias)[1:]:
        principal = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0
        assert principal[0] > 0
        assert principal[0] + principal[1] >= principal[2]


def test_masses():
    small = pin.buildModelFromUrdf(str(robots.robot_file("irb120")))
    assert [i.mass for i in list(small.inertias)[1:]] == [3.07, 3.91, 2.94, 1.33, 0.55, 0.14]
    large = pin.buildModelFromUrdf(str(robots.robot_file("irb1600")))
    assert sum(i.mass for i in list(large.inertias)[2:]) == pytest.approx(50, abs=5)
    text = robots.robot_file("irb1600").read_text()
    assert "estimated" in text
    assert "unconfirmed by the maker" in text


def test_the_list_of_robots_is_a_collection():
    found = robots.robots()
    assert len(found) == len(found.to_frame())
    assert [robot.name for robot in found] == list(found.to_frame()["name"])
    assert "irb120" in found
    assert found["irb120"] in found
    assert "irb999" not in found
    with pytest.raises(OptionError, match=r"name: expected irb1600, .*, found 'irb999'") as refused:
        found["irb999"]
    assert refused.value.parameter == "name"


@pytest.mark.parametrize("robot", [None, 5])
def test_what_is_no_name_is_refused(robot):
    with pytest.raises(RobotError, match="expected the path of a URDF or a robot's name, found") as refused:
        urdf.read(robot)
    assert refused.value.parameter == "robot"
