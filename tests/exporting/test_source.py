"""What exports are made from: a calibration folder with its speeds and load."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.exporting.batch import Batch
from irbcal.exporting.robot_numbers import constants
from irbcal.exporting.source import EXACT, Source


def test_of_a_calibration_folder(folder):
    source = Source.from_calibration(folder)
    made = irbcal.load(folder)
    robot = made.robot_calibrated()
    q = robot.arm.random_joints(100, 3)
    found = Batch(**constants(source.numbers, source.vectors)).forward(q)
    assert np.abs(found - robot.poses(q)).max() < 1e-12
    assert source.numbers.fingerprint == made.record.fingerprint
    assert source.miss < EXACT
    assert np.degrees(source.numbers.speed).round().tolist() == [150, 160, 170, 320, 400, 460]  # the URDF's
    assert Source.from_calibration(made).numbers.fingerprint == source.numbers.fingerprint


def test_a_load_that_is_not_known_is_refused(folder):
    with pytest.raises(RobotError, match="payload"):
        Source.from_calibration(folder, payload=3.0)


def test_numbers_that_are_not_irbcals_are_not_exported(sources, monkeypatch):
    robot = sources["level"].robot
    other = sources["irb1600"].numbers
    monkeypatch.setattr("irbcal.exporting.source.RobotNumbers.from_robot", lambda *args, **kwargs: other)
    with pytest.raises(CalibrationError, match="would miss irbcal's own kinematics"):
        Source.of_robot(robot)
