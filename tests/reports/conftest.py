"""A calibration of simulated poses and its report."""

import numpy as np
import pytest
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.reports import report_page


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A calibration of 60 simulated poses."""
    nominal = arm()
    rng = np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    out = tmp_path_factory.mktemp("saved") / "calibration"
    irbcal.save(irbcal.calibrate(path, "irb1600", "34", holdout=0.3), out)
    return out


@pytest.fixture(scope="session")
def calibration(folder):
    return irbcal.load(folder).record


@pytest.fixture(scope="session")
def page(calibration):
    return report_page.render(calibration)


@pytest.fixture(scope="session")
def evidence(calibration):
    return report_page.gather(calibration)
