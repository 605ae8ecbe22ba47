"""The main job: which poses are held out, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import arm, measured, random_robot

from irbcal.calibrating import Options, split
from irbcal.errors import MeasurementError, OptionError


@pytest.fixture(scope="module")
def points():
    nominal = arm()
    return measured(random_robot(nominal, "11", np.random.default_rng(1)), nominal.random_joints(20, 1))


@given(st.floats(0.0, 0.94), st.integers(0, 2**32 - 1))
def test_a_fraction_is_drawn_with_the_seed(points, fraction, seed):
    mask = split(points, fraction, "random", seed)
    assert mask.sum() == round(fraction * 20)
    assert (mask == split(points, fraction, "random", seed)).all()


def test_another_seed_draws_others(points):
    assert (split(points, 10, "random", 1) != split(points, 10, "random", 2)).any()


def test_the_last_poses(points):
    assert np.flatnonzero(split(points, 3, "last")).tolist() == [17, 18, 19]


@pytest.mark.parametrize("holdout", [20, 25, 0.99, -0.1])
def test_some_poses_must_be_left(points, holdout):
    with pytest.raises(MeasurementError, match="some must be left for the fit"):
        split(points, holdout)


@pytest.mark.parametrize(
    ("options", "parameter"),
    [
        ({"split": "first"}, "split"),
        ({"holdout": 2.5}, "holdout"),
        ({"holdout": float("inf")}, "holdout"),
        ({"free": "gain*"}, "free"),
        ({"model": "99"}, "model"),
    ],
)
def test_wrong_options_are_named(options, parameter):
    with pytest.raises(OptionError) as refused:
        Options(**options)
    assert refused.value.parameter == parameter
