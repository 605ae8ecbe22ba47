"""Options: choices and numbers are checked, one sentence each."""

import numpy as np
import pytest

from irbcal import option_values
from irbcal.errors import OptionError
from irbcal.option_values import checked


def test_choices():
    checked("split", "last", ("random", "last"))
    with pytest.raises(OptionError, match="split: expected random or last, found 'lst'"):
        checked("split", "lst", ("random", "last"))


@pytest.mark.parametrize(
    ("value", "limits", "words"),
    [
        ("8", {}, "expected a number, found '8'"),
        (True, {}, "expected a number, found True"),
        (float("nan"), {}, "expected a number, found nan"),
        (None, {"low": 0}, "expected a number of at least 0, found None"),
        (-3, {"low": 0}, "expected a number of at least 0, found -3"),
        (11, {"high": 10}, "expected a number of at most 10, found 11"),
        (1.5, {"low": 1, "high": 4, "whole": True}, "expected a whole number from 1 to 4, found 1.5"),
    ],
)
def test_numbers_are_checked_in_one_sentence(value, limits, words):
    with pytest.raises(OptionError) as refused:
        option_values.number("power", value, **limits)
    assert str(refused.value) == f"power: {words}"
    assert refused.value.parameter == "power"


def test_numbers_of_numpy_are_numbers():
    assert option_values.number("power", np.float32(2.5)) == 2.5
    assert type(option_values.number("count", np.int64(3), whole=True)) is int
    assert option_values.seed(7.0) == 7


@pytest.mark.parametrize("value", [-1, "0", 0.5, None])
def test_seeds_are_whole_numbers_from_zero(value):
    with pytest.raises(OptionError, match="seed: expected a whole number of at least 0") as refused:
        option_values.seed(value)
    assert refused.value.parameter == "seed"


@pytest.mark.parametrize(("value", "meant"), [("backlash", "['backlash']"), ("a, b", "['a', 'b']")])
def test_one_text_is_no_sequence_of_names(value, meant):
    with pytest.raises(OptionError) as refused:
        option_values.names("only", value)
    assert str(refused.value) == f"only: expected a sequence of names, found one text: give {meant}"
    assert refused.value.parameter == "only"


def test_names_are_texts():
    assert option_values.names("only", ["a", "b"]) == ("a", "b")
    for value in (None, [1], 3):
        with pytest.raises(OptionError, match="only: expected a sequence of names, found"):
            option_values.names("only", value)


def test_metres_that_look_like_millimetres_are_refused():
    assert option_values.length("bar", 0.15) == 0.15
    np.testing.assert_array_equal(option_values.point_in_metres("tracker", (1.5, 0, -100)), [1.5, 0.0, -100.0])
    sentence = "metres expected, at most 100, found 150: this looks like millimetres"
    for check, value in ((option_values.length, 150), (option_values.point_in_metres, (0, 150, 1))):
        with pytest.raises(OptionError, match=sentence) as refused:
            check("bar", value)
        assert refused.value.parameter == "bar"


@pytest.mark.parametrize("value", ["abc", (0, 0), [[0, 0, 0]], (0, 0, float("nan")), None])
def test_places_are_three_numbers(value):
    with pytest.raises(OptionError, match="center: expected x, y, z in metres, found"):
        option_values.point_in_metres("center", value)
