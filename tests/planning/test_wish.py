"""What a plan should hold: times of standing still, and wishes that make no sense."""

import numpy as np
import pytest

from irbcal.errors import OptionError
from irbcal.planning.choosing import READINGS_S, Wish


def test_the_robot_stands_still_for_rest_and_readings():
    asked = np.array([[True, True, False], [False, False, True]])
    assert Wish(wait_s=3.0, references=2).hold_s(asked).tolist() == [3.0 + 4 * READINGS_S, 3.0 + 3 * READINGS_S]


@pytest.mark.parametrize(("name", "value"), [("cube", -1), ("candidates", 1), ("references", -2), ("speed", 0.0)])
def test_numbers_below_the_least_are_refused(name, value):
    with pytest.raises(OptionError, match=f"{name}: expected ") as refusal:
        Wish(**{name: value})
    assert refusal.value.parameter == name


@pytest.mark.parametrize(
    ("name", "value"),
    [("seed", -1), ("optimal", "x"), ("cube", 99_999_999_999), ("cube", 1.5), ("wait_s", -1), ("speed", "x")],
)
def test_what_is_no_number_or_too_large_is_refused(name, value):
    with pytest.raises(OptionError, match=f"{name}: expected a .*found") as refused:
        Wish(**{name: value})
    assert refused.value.parameter == name
