"""The calibrated robot that touches what stands in a cell."""

import pytest

from irbcal.io import calibration_folder


@pytest.fixture(scope="module")
def record(demo_calibration):
    return calibration_folder.read(demo_calibration).record


@pytest.fixture(scope="module")
def robot(record):
    return record.robot_calibrated()
