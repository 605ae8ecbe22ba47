"""CONFIG in words."""

import numpy as np
import pytest

from irbcal.correction.languages.fanuc.writing import config


def test_letters_and_turns():
    posture, spans, reason = config(" F D T, 0, 1, -1 ", 10)
    assert posture[:3] == (False, True, 1)
    assert (posture.low[3], posture.high[3]) == (np.pi, 3 * np.pi)
    assert posture.high[5] == -np.pi
    assert posture.low[1] == -np.inf
    assert spans == ((18, 19), (21, 22), (24, 26))
    assert reason == ""


@pytest.mark.parametrize("text", ["", "N U", "L, 0, 0, 0", "N U T, 0, 0", "N U B, 0, 0, 0", "n u t, 0, 0, 0"])
def test_what_means_nothing_here(text):
    assert config(text, 0)[0] is None
    assert config(text, 0)[2]
