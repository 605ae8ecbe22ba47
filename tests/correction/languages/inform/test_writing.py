"""RCONF."""

import pytest

from irbcal.correction.languages.inform.writing import posture_of


@pytest.mark.parametrize(
    ("rconf", "expected", "reason"),
    [
        ([0, 0, 0, 0, 0, 0, 0, 0], (False, False, -1), ""),
        ([1, 1, 0, 0, 0, 0], (False, True, 1), ""),
        ([1, 0, 1, 0, 0, 0], (None, None, None), "behind axis 1"),
        ([1, 0, 0, 1, 0, 0], (None, None, None), "beyond 180"),
        ([1, 0], (None, None, None), "not understood"),
        ([2, 0, 0, 0, 0, 0], (None, None, None), "not understood"),
    ],
)
def test_what_it_means(rconf, expected, reason):
    posture, why = posture_of(rconf)
    assert posture[:3] == expected
    assert reason in why
    assert bool(why) == bool(reason)
