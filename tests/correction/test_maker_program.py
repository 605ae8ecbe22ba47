"""What all makers' programs share; the languages' own tests go through it end to end."""

import numpy as np
import pytest

from irbcal.correction.languages.krl import KUKA
from irbcal.correction.listing import Number
from irbcal.correction.maker_program import Found, frame, relative


def test_frames_of_six_numbers():
    T = frame(KUKA, [1000, 0, 0, 90, 0, 0])
    np.testing.assert_allclose(T[:3, :2], [[0, -1], [1, 0], [0, 0]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(relative(T, T), np.eye(4), rtol=0, atol=1e-15)


@pytest.mark.parametrize("value", [1e30, float("inf"), float("nan")])
def test_absurd_numbers_are_no_targets(value):
    assert Found("p", "pose", 0, [Number(value, 0, 1)] * 6).reasons == ["found a number that is too large"]
