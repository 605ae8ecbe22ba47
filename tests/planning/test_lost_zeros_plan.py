"""Plans that find lost zeros: what they promise against zeros refitted from SIMULATED points of them, drawn anew."""

from dataclasses import replace

import numpy as np
import pytest
from support import measured

import irbcal
from irbcal.errors import MeasurementError, OptionError
from irbcal.io import calibration_folder
from irbcal.modeling.lost_zeros import with_zeros
from irbcal.units import DEG
from irbcal.validation.refit import Refit

OFF = ("collision", "sight", "path", "acceptance")


@pytest.fixture(scope="module")
def planned(demo_calibration):
    return irbcal.plan(demo_calibration, refit_zeros=(3, 5), targets=1, ignore=OFF, candidates=200)


def test_the_promise_is_what_refits_scatter(planned, demo_calibration):
    true = calibration_folder.read(demo_calibration).record.robot_calibrated()
    lost = np.array([0.4, -0.7]) * DEG
    crashed = with_zeros(true, (3, 5), lost).replace(targets={"ball": planned.prediction.model.targets.positions[0]})
    exact = measured(crashed, planned.q)
    rng, refit = np.random.default_rng(1), Refit(base=True, tool=True, zeros=(3, 5))
    estimates = []
    for _ in range(60):
        noise = rng.normal(scale=planned.options.noise, size=exact.xyz.shape)
        placed = refit.placed(true, replace(exact, xyz=exact.xyz + noise), "m.csv")
        estimates.append((placed.arm.table.theta - true.arm.table.theta)[[2, 4]])
    promised = [parameter.std * DEG for parameter in planned.prediction.parameters]
    # a standard deviation of 60 draws is known to 9 %
    np.testing.assert_allclose(np.std(estimates, axis=0, ddof=1), promised, rtol=0.25)
    np.testing.assert_allclose(np.mean(estimates, axis=0), lost, rtol=0, atol=4 * max(promised) / np.sqrt(60))


def test_a_tenth_fewer_poses_are_not_enough(planned, demo_calibration):
    """Of as many poses as are enough the intervals are within 0.01 degrees; of fewer, with their quantile, not."""
    from scipy.stats import t

    count = int(0.9 * len(planned.q))
    fewer = irbcal.plan(demo_calibration, refit_zeros=(3, 5), targets=1, ignore=OFF, candidates=200, optimal=count)
    for plan, good in ((planned, True), (fewer, False)):
        placing = len(plan.q) - 1
        std = max(parameter.std for parameter in plan.prediction.parameters) * np.sqrt(len(plan.q) / placing)
        assert (t.ppf(0.975, 3 * placing - 11) * std <= 0.01) == good


@pytest.mark.parametrize(
    ("zeros", "error", "words"),
    [((1,), MeasurementError, "cannot be separated from the base"), ((7,), OptionError, "refit_zeros")],
)
def test_what_no_pose_shows_is_refused(demo_calibration, zeros, error, words):
    with pytest.raises(error, match=words):
        irbcal.plan(demo_calibration, refit_zeros=zeros, targets=1, ignore=OFF, candidates=200)


def test_a_level_beside_zeros_is_refused(demo_calibration):
    with pytest.raises(OptionError, match="level: a plan for lost zeros"):
        irbcal.plan(demo_calibration, refit_zeros=(3,), level="34")


def test_a_robot_that_is_not_calibrated_is_refused():
    with pytest.raises(OptionError, match="give a calibration folder"):
        irbcal.plan("irb1600", refit_zeros=(3,), targets=1, ignore=OFF)
