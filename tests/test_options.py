"""Options: choices are checked, former names work with a warning."""

import pytest

from irbcal.errors import OptionError
from irbcal.options import checked, renamed


def test_choices():
    checked("split", "last", ("random", "last"))
    with pytest.raises(OptionError, match="split: expected random or last, found 'lst'"):
        checked("split", "lst", ("random", "last"))


@renamed(order="split")
def divide(points, *, split="random"):
    return points, split


def test_a_former_name_works_with_a_warning_that_points_at_the_caller():
    with pytest.warns(DeprecationWarning, match="order is now called split") as seen:
        assert divide(1, order="last") == (1, "last")
    assert seen[0].filename == __file__
    assert divide(1, split="last") == (1, "last")


def test_both_names_at_once_are_refused():
    with pytest.raises(OptionError, match="order is the former name of split"):
        divide(1, order="last", split="random")
