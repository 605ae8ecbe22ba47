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
    judged,
    quantile,
    unit_of,
)


def term(joint, p, without=1e-3, with_it=0.5e-3, **more):
    return JointTerm("backlash", joint, ("backlash",), (1e-3,), (0.5e-3,), (1.5e-3,), p, without, with_it, **more)


def test_holm_by_hand():
    # smallest first: 3 x 0.010, 2 x 0.020, 1 x 0.022, the last not below the one before; not tested: does not count
    found = judged([term(1, 0.022), term(2, 0.010), term(3, 0.020), JointTerm("backlash", 4, note="one side only")])
    assert [t.p for t in found] == pytest.approx([0.040, 0.030, 0.040, 1.0], abs=1e-12)
    assert [t.verdict for t in found] == ["worth it", "worth it", "worth it", "not tested"]
    # 3 x 0.020 is too much: nothing after it is seen either, whatever its own p
    found = judged([term(1, 0.021), term(2, 0.020), term(3, 0.9)])
    assert [t.p for t in found] == pytest.approx([0.060, 0.060, 0.9], abs=1e-12)
    assert [t.verdict for t in found] == ["not seen"] * 3
    assert judged([term(1, 0.6), term(2, 0.7)])[0].p == 1.0


@pytest.mark.parametrize(
    ("p", "with_it", "verdict"),
    [
        (0.049, 0.9799e-3, "worth it"),
        (0.049, 0.9801e-3, "small"),
        (0.049, 1.0e-3, "not seen"),
        (0.05, 0.5e-3, "not seen"),
    ],
)
def test_verdicts_at_their_limits(p, with_it, verdict):
    assert judged([term(1, p, 1e-3, with_it)])[0].verdict == verdict


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
    assert unit_of(term(2, 0.1)) == ("deg", np.pi / 180)
    assert unit_of(term(2, 0.1), [False, True]) == ("mm", 1e-3)
    assert unit_of(JointTerm("gain", 1)) == ("1", 1.0)
    assert unit_of(JointTerm("move", 1)) == ("deg/100 deg", 0.01)


def test_a_term_speaks_shortly():
    many = JointTerm("fourier", 6, fourier_names(12), (0.1,) * 24, (0.0,) * 24, (0.2,) * 24, 0.01)
    assert len(repr(many)) < 2000
    assert repr(term(4, 0.02)).startswith("<JointTerm: backlash of joint 4: backlash 0.0573 ± 0.0286 deg, p = 0.02")
    assert term(4, 0.02).coefficients() == {"backlash": 1e-3}
    hidden = JointTerm("gain", 1, beside_needed=many)
    assert hidden.shown is many
    assert many.shown is many


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
