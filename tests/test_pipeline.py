"""The main job: which poses are held out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import arm, measured, random_robot

from irbcal.errors import MeasurementError
from irbcal.pipeline import held_out


@pytest.fixture(scope="module")
def points():
    nominal = arm()
    return measured(random_robot(nominal, "11", np.random.default_rng(1)), nominal.random_joints(20, 1))


@given(st.floats(0.0, 0.94), st.integers(0, 2**32 - 1))
def test_a_fraction_is_drawn_with_the_seed(points, fraction, seed):
    mask = held_out(points, fraction, "random", seed)
    assert mask.sum() == round(fraction * 20)
    assert (mask == held_out(points, fraction, "random", seed)).all()


def test_another_seed_draws_others(points):
    assert (held_out(points, 10, "random", 1) != held_out(points, 10, "random", 2)).any()


def test_the_last_poses(points):
    assert np.flatnonzero(held_out(points, 3, "last")).tolist() == [17, 18, 19]


def test_repeats_are_held_out_together(points):
    thrice = measured(random_robot(arm(), "11", np.random.default_rng(1)), np.tile(points.q, (3, 1)))
    mask = held_out(thrice, 4, "random", 7)
    assert mask.sum() == 12
    assert (mask.reshape(3, 20) == mask[:20]).all()
    assert np.flatnonzero(held_out(thrice, 0.1, "last")).tolist() == [18, 19, 38, 39, 58, 59]
    with pytest.raises(MeasurementError, match="20 usable places"):
        held_out(thrice, 20)


@pytest.mark.parametrize("holdout", [20, 25, 0.99, -0.1])
def test_some_poses_must_be_left(points, holdout):
    with pytest.raises(MeasurementError, match="some must be left for the fit"):
        held_out(points, holdout)
