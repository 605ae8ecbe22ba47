"""What the tests of validation share: the record of a calibration from simulated data."""

import pytest

import irbcal
from irbcal.io import robots


@pytest.fixture(scope="session")
def record():
    """The demonstration robot, level 34."""
    return irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", "34").record
