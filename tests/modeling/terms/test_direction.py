"""The direction of approach: sign, width and derivatives of its soft step."""

import numpy as np
from support import arm
from term_cases import PREVIOUS, assert_derivatives, rail, values_of

from irbcal.modeling.terms.direction import FAMILY, WIDTHS
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap


def test_long_moves_count_by_their_sign_only():
    model = arm("irb120")
    move = np.radians([[10.0, -10.0, 40.0, -3.0, 0.0, 0.5]])
    values = values_of(FAMILY.terms(model), model, Motion(np.zeros((1, 6)), move))[:, 0]
    np.testing.assert_allclose(values, [1.0, -1.0, 1.0, -1.0, 0.0, (np.e**2 - 1) / (np.e**2 + 1)], atol=2e-5)


def test_an_unknown_stop_before_counts_for_nothing():
    model = arm("irb120")
    found = TermMap(model, tuple(FAMILY.terms(model)), np.ones(6))
    np.testing.assert_array_equal(found.effective(Motion(np.ones((2, 6)))), np.ones((2, 6)))


def test_derivatives_inside_the_play():
    model = arm("irb120")
    q = PREVIOUS + np.radians([0.2, -0.4, 0.1, 0.7, -0.3, 0.5])
    slopes = assert_derivatives(FAMILY.terms(model), model, q)
    width = np.radians(0.5)
    np.testing.assert_allclose(np.diag(slopes), (1 - np.tanh((q - PREVIOUS) / width) ** 2) / width, rtol=1e-9)
    assert np.count_nonzero(slopes) == 6


def test_a_prismatic_joint_has_a_width_in_metres(tmp_path):
    model = rail(tmp_path)
    first, second = FAMILY.terms(model)[:2]
    assert (first.axis, first.unit, first.parameters) == ("tz", "m", {"width_m": WIDTHS["m"]})
    assert (second.axis, second.unit, second.parameters) == ("rz", "rad", {"width_rad": WIDTHS["rad"]})
    assert first.group != second.group
    move = np.zeros((1, 7))
    move[0, 0] = -0.5e-3
    assert values_of([first], model, Motion(np.zeros((1, 7)), move))[0, 0] == -np.tanh(1.0)
