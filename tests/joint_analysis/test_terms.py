"""JointTerms of a joint: series, frequencies and their intervals."""

import numpy as np
import pytest
from scipy.stats import f as fisher

from irbcal.joint_analysis.terms import (
    JointTerm,
    best_frequency,
    fourier_columns,
    fourier_names,
    fourier_order,
    frequencies,
    interval,
    quantile,
)


def term(joint, evidence=10.0, moves=1e-4, **more):
    return JointTerm("backlash", joint, ("backlash",), (1e-3,), (0.5e-3,), (1.5e-3,), evidence, moves, **more)


@pytest.mark.parametrize(
    ("evidence", "moves", "needed"),
    [(5.0, 3e-6, True), (4.99, 1e-3, False), (100.0, 2.9e-6, False), (-3.0, 1e-3, False)],
)
def test_a_term_is_needed_where_evidence_and_points_say_so(evidence, moves, needed):
    found = term(1, evidence, moves)
    assert found.needed is needed
    assert found.verdict == ("needed" if needed else "not needed")
    assert not term(1, 100.0, note="one side only").needed


def test_probability_by_hand():
    assert term(1, 0.0).probability == 0.5
    assert term(1, np.log(19.0)).probability == pytest.approx(0.95, abs=1e-12)
    assert term(1, -1e9).probability == pytest.approx(0.0, abs=1e-12)


def test_a_series_is_that_of_the_thesis():
    q = np.array([0.3, -1.2])
    names = fourier_names(2)
    assert names == ("a1", "b1", "a2", "b2")
    expected = [[np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)] for x in 1.001 * q]
    np.testing.assert_allclose(fourier_columns(q, 2, 1.001), expected, rtol=0, atol=1e-15)
    assert fourier_order(JointTerm("fourier", 6, ("a1", "b2"))) == 2


def test_the_best_frequency_is_refined_between_those_tried():
    tried = frequencies(2 * np.pi, 20.0)
    assert tried[0] == 0.5
    assert np.diff(tried) == pytest.approx(0.25, abs=1e-12)
    assert best_frequency(lambda f: abs(f - 7.137), tried) == pytest.approx(7.137, abs=1e-5)


def test_student_s_quantile():
    assert quantile(10) == pytest.approx(2.228, abs=5e-4)  # from tables
    assert quantile(1e9) == pytest.approx(1.96, abs=5e-4)


def test_units_outside():
    assert term(2).unit_and_size == ("deg", np.pi / 180)
    assert term(2, prismatic=True).unit_and_size == ("mm", 1e-3)
    assert JointTerm("gain", 1).unit_and_size == ("1", 1.0)
    assert JointTerm("move", 1).unit_and_size == ("deg/100 deg", 0.01)
    assert JointTerm("move", 1, prismatic=True).unit_and_size == ("mm/100 mm", 0.01)


def test_a_term_speaks_shortly():
    many = JointTerm("fourier", 6, fourier_names(12), (0.1,) * 24, (0.0,) * 24, (0.2,) * 24, 10.0, 1e-3)
    assert len(repr(many)) < 2000
    assert repr(term(4)).startswith("<JointTerm: backlash of joint 4: backlash 0.0573 ± 0.0286 deg: log evidence +10.0")
    assert term(4).coefficients() == {"backlash": 1e-3}


X = np.radians(np.arange(-360, 361, 15.0))


def made(noise, seed=0, frequency=1.3, slope=0.0):
    rng = np.random.default_rng(seed)
    return 1e-3 * np.cos(frequency * X + 0.4) + slope * X + noise * rng.standard_normal(len(X))


def found_in(y, noise, freedom=40):
    tried = frequencies(np.ptp(X), 12.0)
    return interval(X, y, noise**2 * np.eye(len(X)), np.ones((len(X), 1)), 1, tried, 1.3, freedom)


def test_its_ends_are_those_that_the_likelihood_ratio_just_refuses():
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
