import feature_cases as cases
import numpy as np
import pytest

from irbcal.errors import OptionError
from irbcal.identification.devices import DEVICES
from irbcal.planning.device_comparison import _Work, compare_devices


@pytest.fixture(scope="module")
def found():
    return compare_devices("irb1600", (40,), noise=0.05e-3)


def test_devices_stand_in_the_order_of_an_independent_calculation(found):
    """Its order at 100 poses: tracker, four balls, strings, ballbar, two balls, sockets, one ball, planes."""
    left = {row.device: row.left for row in found.rows}
    assert left["tracker"] < left["balls"] < left["two-balls"] < left["sockets"] < left["ball"]
    assert left["sockets"] < left["plane"]
    assert all(value < found.before for value in left.values())
    assert "Calculated, not measured" in str(found.summary())
    assert list(found.to_frame()["left_mm"]) == sorted(found.to_frame()["left_mm"])


def test_less_noise_and_more_poses_leave_less():
    work = _Work(cases.arm(), 0)
    few, more = (work.at("balls", count) for count in (16, 48))
    assert work.left(*more[:2], 1e-4) < work.left(*few[:2], 1e-4)
    assert work.left(*few[:2], 1e-5) < work.left(*few[:2], 1e-4)
    assert set(DEVICES) >= {"ball", "sockets", "ballbar", "string", "plane"}


def test_the_prior_is_that_of_drawn_arms():
    """Mean square error of arms drawn with errors of natural sizes, about the best place of each."""
    nominal, work = cases.arm(), _Work(cases.arm(), 0)
    q = nominal.random_joints(300, 7)
    drawn = [np.mean(cases.apart(cases.true_arm(nominal, seed), nominal, q) ** 2) for seed in range(40)]
    assert work.before == pytest.approx(np.sqrt(np.mean(drawn)), rel=0.15)


def test_numbers_of_poses_are_checked():
    with pytest.raises(OptionError, match="poses"):
        compare_devices("irb1600", (2,))
