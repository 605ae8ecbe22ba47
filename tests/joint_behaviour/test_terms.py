"""Terms: Holm's correction by hand, verdicts, series and the search for a frequency."""

import numpy as np
import pytest

from irbcal.joint_behaviour.terms import (
    Term,
    best_frequency,
    fourier_columns,
    fourier_names,
    fourier_order,
    frequencies,
    judged,
    quantile,
    unit_of,
)


def term(joint, p, without=1e-3, with_it=0.5e-3, **more):
    return Term("backlash", joint, ("backlash",), (1e-3,), (0.5e-3,), (1.5e-3,), p, without, with_it, **more)


def test_holm_by_hand():
    # smallest first: 3 x 0.010, 2 x 0.020, 1 x 0.022, the last not below the one before; not tested: does not count
    found = judged([term(1, 0.022), term(2, 0.010), term(3, 0.020), Term("backlash", 4, note="one side only")])
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
    assert fourier_order(Term("fourier", 6, ("a1", "b2"))) == 2


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
    assert unit_of(Term("gain", 1)) == ("1", 1.0)
    assert unit_of(Term("move", 1)) == ("deg/100 deg", 0.01)


def test_a_term_speaks_shortly():
    many = Term("fourier", 6, fourier_names(12), (0.1,) * 24, (0.0,) * 24, (0.2,) * 24, 0.01)
    assert len(repr(many)) < 2000
    assert repr(term(4, 0.02)).startswith("<Term: backlash of joint 4: backlash 0.0573 ± 0.0286 deg, p = 0.02")
    assert term(4, 0.02).coefficients() == {"backlash": 1e-3}
    hidden = Term("gain", 1, beside_needed=many)
    assert hidden.shown is many
    assert many.shown is many
