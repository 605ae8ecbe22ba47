"""Robots and points come back from calibration.json."""

import numpy as np

import irbcal


def test_nominal_robot_comes_back_too(outcome, folder):
    q = outcome.urdf.arm.random_joints(50, 5)
    found = irbcal.load(folder).robot_nominal().points(q, "smr1")
    assert np.abs(found - outcome.nominal.robot.points(q, "smr1")).max() < 1e-9
