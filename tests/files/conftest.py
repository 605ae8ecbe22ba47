"""A calibration of a simulated robot, in memory and in its folder."""

import numpy as np
import pytest
from support import arm, measured, outcome_of, random_robot, write_measurements

import irbcal


@pytest.fixture(scope="session")
def outcome(tmp_path_factory):
    """A calibration of a simulated robot."""
    nominal = arm()
    rng = np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    return outcome_of(path, "irb1600", "34", holdout=0.3)


@pytest.fixture(scope="session")
def folder(outcome, tmp_path_factory):
    """The same, saved."""
    path = tmp_path_factory.mktemp("saved") / "calibration"
    irbcal.save(outcome, path, world_link=True, target_links=True)
    return path
