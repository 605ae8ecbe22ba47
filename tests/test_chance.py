"""Distributions against scipy."""

import numpy as np
from scipy import special

from irbcal import statistics


def test_normal_distribution():
    z = np.linspace(-8.0, 8.0, 97)
    assert np.abs(statistics.normal_below(z) / special.ndtr(z) - 1.0).max() < 1e-13
    share = np.concatenate([[1e-12], np.linspace(1e-4, 1 - 1e-4, 200)])
    assert np.abs(statistics.normal_quantile(share) - special.ndtri(share)).max() < 1e-12


def test_f_distribution():
    rng = np.random.default_rng(1)
    for value, a, b in zip(
        10 ** rng.uniform(-3, 3, 300), rng.integers(1, 60, 300), rng.integers(1, 3000, 300), strict=True
    ):
        expected = special.fdtrc(a, b, value)
        assert abs(statistics.f_beyond(value, a, b) - expected) < 1e-11 * expected + 1e-12
    assert statistics.f_beyond(0.0, 3, 5) == 1.0
    assert np.isnan(statistics.f_beyond(np.nan, 3, 5))


def test_student_distribution():
    for freedom in (1, 2, 7.5, 40, 5000):
        for share in (0.5, 0.95, 0.999):
            expected = special.stdtrit(freedom, 0.5 + share / 2)
            assert abs(statistics.student_within(share, freedom) / expected - 1.0) < 1e-10
