"""Gear terms: a pair of waves with a variance of its own."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, some_joints, values_of

from irbcal.modeling.terms.gear import FAMILY, HIGHEST, LOWEST, SIZE, gear_terms, in_words
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


def test_a_wave_is_named_with_the_drive_that_makes_it():
    assert (
        in_words(4, 242, 0.0031)
        == "joint 4: 242 cycles per turn, 0.0031 degrees: twice 121, a harmonic drive of ratio 121"
    )
    assert in_words(1, 241, 0.00188) == "joint 1: 241 cycles per turn, 0.0019 degrees"
    assert in_words(1, 58, 0.002).endswith("0.0020 degrees")
    assert in_words(1, 60, 0.002).endswith("ratio 30")
