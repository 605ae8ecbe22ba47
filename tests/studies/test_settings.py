"""Settings of a study: the thesis's shares and moves, seeds, refusals."""

from dataclasses import replace

import pytest

from irbcal.errors import IrbcalError, OptionError
from irbcal.studies.settings import MOVES, Settings, procedures, shares


def test_shares_and_moves_are_those_of_the_thesis():
    assert shares(120) == (18, 52, 50)  # section 7.2
    assert shares(140) == (54, 46, 40)  # section 7.5
    assert shares(200) == (54, 76, 70)  # section 7.7.3.1
    assert all(sum(shares(n)) == n and min(shares(n)[1:]) > 0 for n in range(20, 1001))
    for count, angles in MOVES.items():  # sections 7.2, 7.5 and 7.7
        assert sum(map(len, angles)) == count
    assert [len(a) for a in MOVES[158]] == [17] * 5 + [73]
    default = Settings()
    assert default.pool == 3000  # 1,000 for each of targets 1 to 3
    assert default.verified == 1000
    assert [r.measures for r in procedures(default)] == [n for n in (80, 120, 180, 200) for _ in range(5)]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"points": 500}, "expected 520 to 100000 verification points, found 500"),
        ({"procedures": (19,)}, "19 identification measurements: expected 20 to 390"),
        ({"procedures": (600,)}, "600 identification measurements: expected 20 to 390, for 520 verification points"),
        ({"procedures": ()}, "at least one number"),
        ({"each": 0}, "expected 1 to 1000 calibrations of each size, found 0"),
        ({"model": "12"}, "unknown model '12': choose one of 11, 16, 26, 34"),
        ({"method": "guess"}, "unknown method 'guess': choose one of least-squares, nelder-mead, max"),
        ({"seed": -1}, "expected a seed of 0 or more, found -1"),
    ],
)
def test_settings_that_make_no_study_are_refused(small, changes, sentence):
    with pytest.raises(IrbcalError) as caught:
        replace(small, **changes)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, OptionError)
    assert caught.value.parameter == next(iter(changes))
