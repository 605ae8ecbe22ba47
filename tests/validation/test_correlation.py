"""Correlation of series against scipy, and its promise on slow series."""

import numpy as np
import pytest
from scipy import stats

from irbcal.validation.tracker_check import correlation


def test_correlation_interval_is_fishers_for_white_noise_and_honest_for_slow_series():
    rng = np.random.default_rng(3)
    a = rng.standard_normal(4000)
    b = 0.3 * a + rng.standard_normal(4000)
    found = correlation(a, b).to_dict()
    reference = stats.pearsonr(a, b).confidence_interval()
    assert found["interval"] == pytest.approx([reference.low, reference.high], abs=0.01)
    # unrelated slow series: the textbook's interval would call about two thirds of them related
    told = []
    for _ in range(100):
        walk = rng.standard_normal((2, 600))
        for k in range(1, 600):
            walk[:, k] += 0.95 * walk[:, k - 1]
        told.append(correlation(*walk).told)
    assert np.mean(told) < 0.15
