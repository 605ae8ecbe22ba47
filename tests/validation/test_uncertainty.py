"""How well a saved calibration knows where the robot is."""

import numpy as np

import irbcal
from irbcal.validation.uncertainty import position_std


def test_uncertainty_of_a_saved_calibration_is_that_of_its_fit(outcome, folder):
    loaded = irbcal.load(folder)
    q = outcome.urdf.arm.random_joints(20, 6)
    expected = np.sqrt(np.einsum("nii->ni", outcome.fit.predicted_covariance(q, "smr2")))
    assert np.abs(position_std(loaded, q, "smr2") / expected - 1).max() < 1e-6
    tip = position_std(loaded, q)
    assert tip.shape == (20, 3)
    assert 0 < tip.min() < tip.max() < 1e-3
