"""S and T, and the forms in which they stand."""

import numpy as np
import pytest

from irbcal.correction.languages.krl.writing import integer, like, posture_of


@pytest.mark.parametrize(
    ("text", "value", "new"),
    [
        ("35", 35, "2"),
        ("'B00110010'", 50, "'B00000010'"),
        ("'b010'", 2, "'b010'"),
        ("'H1F'", 31, "'H02'"),
        ("x", None, "2"),
        ("-1", None, "2"),
    ],
)
def test_whole_numbers_keep_their_form(text, value, new):
    assert integer(text) == value
    assert like(text, 2) == new


def test_what_status_and_turn_mean():
    home = posture_of(2, 2)
    assert home[:3] == (False, False, 1)
    assert home.low == (0, -np.inf, 0, 0, 0, 0)
    assert home.high[1] == 0
    assert posture_of(16 + 1, 16)[:3] == (True, True, -1)
