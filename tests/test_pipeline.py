"""The main job: which poses are held out, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import arm, measured, random_robot

from irbcal.errors import MeasurementError, OptionError
from irbcal.pipeline import Options, held_out


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


@pytest.mark.parametrize(
    ("options", "parameter", "words"),
    [
        ({"holdout": "abc"}, "holdout", "holdout: expected a fraction below 1 or a whole number, found 'abc'"),
        ({"holdout": -1}, "holdout", "holdout: expected a fraction below 1 or a whole number, found -1"),
        ({"seed": -1}, "seed", "seed: expected a whole number of at least 0, found -1"),
        ({"power": "8"}, "power", "power: expected a number of at least 2, found '8'"),
        ({"frame": "ref1,ref2,ref3"}, "frame", "one text: give ['ref1', 'ref2', 'ref3']"),
        ({"frame": ("ref1", "ref2")}, "frame", "three reference points, found 2"),
        ({"hold": "gain*"}, "hold", "hold: expected a sequence of names"),
        ({"free": ["gain1", "gain2"], "hold": ["gain2"]}, "hold", "hold: gain2 is to be freed, too"),
        ({"verify": "v.csv", "holdout": 0.25}, "holdout", "leave one out"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_sentence(options, parameter, words):
    with pytest.raises(OptionError) as refused:
        Options(**options)
    assert words in str(refused.value)
    assert refused.value.parameter == parameter


def test_the_share_held_out_is_a_quarter_unless_given():
    assert (Options().share, Options(holdout=5).share, Options(verify="v.csv").share) == (0.25, 5, 0.25)


def test_a_level_may_be_given_as_a_number():
    assert Options(model=34).model == "34"
    with pytest.raises(OptionError, match="found '35'"):
        Options(model=35)
