"""Gear terms: a pair of waves with a variance of its own."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, some_joints, values_of

from irbcal.modeling.terms.gear import FAMILY, HIGHEST, LOWEST, SIZE, gear_terms
from irbcal.modeling.terms.situation import Motion


def test_a_gear_is_a_wave_of_any_phase():
    model = arm("irb120")
    terms = gear_terms(3, 242)
    assert {t.group for t in terms} == {"gear_4_242"}
    assert {(t.family, t.axis, t.size) for t in terms} == {("gear", "rz", SIZE)}
    assert terms[0].group != gear_terms(3, 240)[0].group
    q = some_joints(30)
    wave = np.array([3.0, 4.0]) @ values_of(terms, model, Motion(q))
    np.testing.assert_allclose(wave, 5.0 * np.cos(242 * q[:, 3] - np.arctan2(4.0, 3.0)), rtol=0, atol=1e-9)


def test_derivatives():
    model = arm("irb120")
    slopes = assert_derivatives(gear_terms(3, 242), model, some_joints(1)[0], step=1e-6)
    assert abs(np.hypot(*slopes[:, 3]) - 242) < 1e-6


def test_only_a_scan_finds_them():
    assert FAMILY.terms(arm("irb120")) == []
    assert (LOWEST, HIGHEST) == (5, 420)
