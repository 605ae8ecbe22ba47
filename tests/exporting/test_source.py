"""What exports are made from: a calibration folder with its speeds and load."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.exporting.batch import Batch
from irbcal.exporting.parts import constants
from irbcal.exporting.source import EXACT, Source


def test_of_a_calibration_folder(folder):
    source = Source.of(folder)
    made = irbcal.load(folder)
    robot = made.robot_calibrated()
    q = robot.arm.random_joints(100, 3)
    found = Batch(**constants(source.parts, source.vectors)).forward(q)
    assert np.abs(found - robot.poses(q)).max() < 1e-12
    assert source.parts.fingerprint == made.record.fingerprint
    assert source.miss < EXACT
    assert np.degrees(source.parts.speed).round().tolist() == [150, 160, 170, 320, 400, 460]  # the URDF's
    assert Source.of(made).parts.fingerprint == source.parts.fingerprint


def test_a_load_that_is_not_known_is_refused(folder):
    with pytest.raises(RobotError, match="payload"):
        Source.of(folder, payload=3.0)


def test_numbers_that_are_not_irbcals_are_not_exported(sources, monkeypatch):
    robot = sources["level"].robot
    other = sources["irb1600"].parts
    monkeypatch.setattr("irbcal.exporting.source.Parts.of", lambda *args, **kwargs: other)
    with pytest.raises(CalibrationError, match="would miss irbcal's own kinematics"):
        Source.of_robot(robot)
