"""Interval of a frequency: a series with white noise, judged by an F test that is written out here."""

import numpy as np
import pytest
from scipy.stats import f as fisher

from irbcal.joint_behaviour.free_frequency import interval
from irbcal.joint_behaviour.terms import fourier_columns, frequencies

X = np.radians(np.arange(-360, 361, 15.0))


def made(noise, seed=0, frequency=1.3, slope=0.0):
    rng = np.random.default_rng(seed)
    return 1e-3 * np.cos(frequency * X + 0.4) + slope * X + noise * rng.standard_normal(len(X))


def found_in(y, noise, freedom=40):
    tried = frequencies(np.ptp(X), 12.0)
    return interval(X, y, noise**2 * np.eye(len(X)), np.ones((len(X), 1)), 1, tried, 1.3, freedom)


def test_its_ends_are_those_that_the_f_test_just_refuses():
    noise = 2e-4
    y = made(noise)
    found, low, high = found_in(y, noise)

    def left(f):
        M = np.column_stack([np.ones(len(X)), fourier_columns(X, 1, f)])
        return np.sum((y - M @ np.linalg.lstsq(M, y, rcond=None)[0]) ** 2) / noise**2

    assert low < found < high
    assert left(found) <= min(left(f) for f in np.linspace(1.2, 1.4, 201)) + 1e-9
    for end in (low, high):
        assert left(end) - left(found) == pytest.approx(fisher.ppf(0.95, 1, 40), rel=1e-5)


def test_where_nothing_is_seen_nothing_is_claimed():
    noise = 0.1
    found, low, high = found_in(made(noise), noise)
    assert low == 0.0
    assert high == pytest.approx(frequencies(np.ptp(X), 12.0)[-1])
    assert low < found < high


def test_a_clear_series_has_a_narrow_interval():
    noise = 1e-7
    found, low, high = found_in(made(noise), noise)
    assert abs(found - 1.3) < 1e-4
    assert 1e-6 < high - low < 1e-3
