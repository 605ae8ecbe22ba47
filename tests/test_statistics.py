"""Distributions against scipy."""

import numpy as np
import pytest
from scipy import special

from irbcal import distributions
from irbcal.arrays import smallest
from irbcal.error_statistics import (
    orientation_line,
    rotation_statistics,
    statistics,
    statistics_by,
    statistics_table,
)
from irbcal.validation.accuracy import percentiles


def test_normal_distribution():
    z = np.linspace(-8.0, 8.0, 97)
    assert np.abs(distributions.normal_cdf(z) / special.ndtr(z) - 1.0).max() < 1e-13
    share = np.concatenate([[1e-12], np.linspace(1e-4, 1 - 1e-4, 200)])
    assert np.abs(distributions.normal_quantile(share) - special.ndtri(share)).max() < 1e-12


def test_f_distribution():
    rng = np.random.default_rng(1)
    for value, a, b in zip(
        10 ** rng.uniform(-3, 3, 300), rng.integers(1, 60, 300), rng.integers(1, 3000, 300), strict=True
    ):
        expected = special.fdtrc(a, b, value)
        assert abs(distributions.f_survival(value, a, b) - expected) < 1e-11 * expected + 1e-12
    assert distributions.f_survival(0.0, 3, 5) == 1.0
    assert distributions.f_survival(np.inf, 3, 5) == 0.0
    assert np.isnan(distributions.f_survival(np.nan, 3, 5))


def test_student_distribution():
    for freedom in (1, 2, 7.5, 40, 5000):
        for share in (0.5, 0.95, 0.999):
            expected = special.stdtrit(freedom, 0.5 + share / 2)
            assert abs(distributions.student_within(share, freedom) / expected - 1.0) < 1e-10


def test_gamma_quantiles_are_scipys():
    for shape in (0.5, 1.0, 1.5, 3.7, 148.5, 1e5):
        for share in (0.05, 0.5, 0.95):
            expected = special.gammaincinv(shape, share)
            assert abs(distributions.gamma_quantile(shape, share) / expected - 1.0) < 1e-11


def test_distances_by_hand():
    # 1, 2 and 6 mm: mean 3, squares of the deviations 4 + 1 + 9 = 14, divided by n - 1 = 2
    found = dict(statistics([1e-3, 2e-3, 6e-3]))
    assert found == {
        "n": 3,
        "mean_mm": pytest.approx(3.0, abs=1e-12),
        "sigma_mm": pytest.approx(np.sqrt(7.0), abs=1e-12),
        "max_mm": pytest.approx(6.0, abs=1e-12),
        "mean_plus_3sigma_mm": pytest.approx(3.0 + 3 * np.sqrt(7.0), abs=1e-12),
        "rms_mm": pytest.approx(np.sqrt(41 / 3), abs=1e-12),
    }


def test_angles_by_hand():
    # 1 and 3 degrees: mean 2, squares of the deviations 1 + 1 = 2, divided by n - 1 = 1; with n it would be 1
    found = dict(rotation_statistics(np.radians([1.0, 3.0])))
    assert found == {
        "n": 2,
        "mean_deg": pytest.approx(2.0, abs=1e-12),
        "sigma_deg": pytest.approx(np.sqrt(2.0), abs=1e-12),
        "max_deg": pytest.approx(3.0, abs=1e-12),
    }
    # 1, 2 and 6 degrees: 14 / 2; with n it would be 14 / 3
    assert rotation_statistics(np.radians([1.0, 2.0, 6.0]))["sigma_deg"] == pytest.approx(np.sqrt(7.0), abs=1e-12)


def test_one_value_has_no_sigma_and_none_no_statistics():
    one, turn = statistics([2e-3]), rotation_statistics([0.1])
    assert (one["n"], one["mean_mm"], one["rms_mm"], one["max_mm"]) == (1, 2.0, 2.0, 2.0)
    assert (one["sigma_mm"], one["mean_plus_3sigma_mm"], turn["sigma_deg"]) == (None, None, None)
    assert statistics_table("errors", [("all", "model", dict(one))], set()).cells()[0][2:] == [
        *("1", "2.000", "–", "2.000", "–", "2.000"),
    ]
    assert "sigma" not in orientation_line("model", dict(turn))
    assert statistics([]) is None
    assert rotation_statistics(np.zeros(0)) is None


def test_statistics_by_label():
    found = statistics_by(np.array([1e-3, 5e-3, 3e-3]), ["b", "a", "b"])
    assert list(found) == ["a", "b"]
    assert (found["a"]["n"], found["b"]["n"]) == (1, 2)
    assert found["b"]["mean_mm"] == pytest.approx(2.0, abs=1e-12)


def test_distances_of_four_bytes_have_the_statistics_of_eight():
    d = np.random.default_rng(3).uniform(1e-3, 1.2e-3, 100_001).astype(np.float32)
    assert dict(statistics(d)) == pytest.approx(dict(statistics(d.astype(float))), rel=1e-9)
    assert percentiles(d) == pytest.approx(percentiles(d.astype(float)), rel=1e-6)
    assert statistics(d[:1])["sigma_mm"] is None


@pytest.mark.parametrize("freedom", [(31.5, 2000.0), (6000.0, 31.0), (6e5, 3e5), (3e6, 1e6)])
def test_the_f_distribution_of_many_points(freedom):
    for share in (1e-4, 0.049, 0.051, 0.5):
        value = special.fdtri(*freedom, 1.0 - share)
        assert distributions.f_survival(value, *freedom) == pytest.approx(share, rel=1e-6)


def test_the_smallest_values_are_those_up_to_the_quantile():
    rng = np.random.default_rng(4)
    for n in range(1, 120):
        values = rng.integers(0, n, n) / 7.0  # some are equal
        for share in (0.0, 0.5, 0.6, 1.0):
            assert np.array_equal(smallest(values, share), values <= np.quantile(values, share))
