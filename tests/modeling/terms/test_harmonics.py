"""Harmonics: waves of the joint's own angle, in bands."""

import numpy as np
import pytest
from support import arm
from term_cases import assert_derivatives, rail, some_joints, values_of

from irbcal.modeling.terms.harmonics import FAMILY, HIGHEST, band_group, bands, order, pair
from irbcal.modeling.terms.situation import Motion


def test_waves_by_hand():
    model = arm("irb120")
    q = np.zeros((4, 6))
    q[:, 2] = np.radians([0.0, 30.0, 90.0, -45.0])
    values = values_of(pair(2, 2, "rz", 1.0, "", ""), model, Motion(q))
    half = np.sqrt(3) / 2
    np.testing.assert_allclose(values, [[1.0, 0.5, -1.0, 0.0], [0.0, half, 0.0, -1.0]], rtol=0, atol=1e-15)


def test_derivatives():
    model = arm("irb120")
    terms = [t for t in FAMILY.terms(model) if order(t) in (1, 5, 45)]
    slopes = assert_derivatives(terms, model, some_joints(1)[0])
    assert np.abs(slopes).max() > 20.0
    assert (np.count_nonzero(slopes, axis=1) <= 1).all()


@pytest.mark.parametrize("highest", [12, 24, 45])
def test_bands_hold_every_order_once(highest):
    edges = bands(highest)
    assert edges[-1] == highest
    assert max(np.diff([0, *edges])) <= 5
    model = arm("irb120")
    terms = [t for t in FAMILY.terms(model) if order(t) <= highest and t.joint == 1]
    for t in terms:
        joint, lower, upper = map(int, band_group(t, highest).removeprefix("harmonics_").split("_"))
        assert joint == 2
        assert lower <= order(t) <= upper
        assert upper in edges
    assert len({band_group(t, highest) for t in terms}) == len(edges)


def test_only_joints_that_turn_have_them(tmp_path):
    terms = FAMILY.terms(rail(tmp_path))
    assert {t.joint for t in terms} == set(range(1, 7))
    assert {order(t) for t in terms} == set(range(1, HIGHEST + 1))
