"""Moves: shares by hand, derivatives by differences."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, rail, some_joints, values_of

from irbcal.modeling.terms.move import FAMILY
from irbcal.modeling.terms.situation import Motion


def test_shares_of_a_move_by_hand():
    model = arm("irb120")
    move = np.array([[0.1, -0.4, 0.2, 0.0, 0.05, -0.1], [0.0] * 6])
    values = values_of(FAMILY.terms(model), model, Motion(np.zeros((2, 6)), move)).reshape(6, 2, 2)
    np.testing.assert_allclose(values[:, 0, 0], [0.25, -1.0, 0.5, 0.0, 0.125, -0.25], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(values[:, 1, 0], move[0])
    assert not values[:, :, 1].any()  # no move, no share


def test_derivatives():
    model = arm("irb120")
    slopes = assert_derivatives(FAMILY.terms(model), model, some_joints(1, 5)[0])
    assert np.abs(slopes[::2]).max() > 0.1
    np.testing.assert_array_equal(slopes[1::2], np.eye(6))


def test_derivatives_without_a_move_are_zero():
    model = arm("irb120")
    terms = FAMILY.terms(model)[::2]
    assert not values_of(terms, model, Motion(np.ones((2, 6)))).any()


def test_units_and_groups(tmp_path):
    terms = FAMILY.terms(rail(tmp_path))
    assert [(t.basis, t.unit) for t in terms[:4]] == [
        ("share_of_move", "m"),
        ("move", "1"),
        ("share_of_move", "rad"),
        ("move", "1"),
    ]
    assert [t.group for t in terms[:4]] == ["move_1", "move_1", "move_2", "move_2"]
