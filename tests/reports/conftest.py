"""The report of a calibration of simulated poses."""

import pytest

import irbcal
from irbcal.reports import report_page


@pytest.fixture(scope="session")
def calibration(folder):
    return irbcal.load(folder).record


@pytest.fixture(scope="session")
def page(calibration):
    return report_page.render(calibration)


@pytest.fixture(scope="session")
def evidence(calibration):
    return report_page.gather(calibration)
