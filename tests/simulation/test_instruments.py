"""Where the thesis measured: the numbers fit one another."""

import numpy as np
import pytest
from support import arm

from irbcal.simulation import instruments


def test_p1_brings_the_tip_to_the_centre_of_the_cube():
    centre, edge = instruments.IRB1600_CUBE
    T = arm().forward(instruments.IRB1600_P1)[0]
    np.testing.assert_allclose(T[:3, 3], centre, rtol=0, atol=2e-6)
    np.testing.assert_allclose(T[:3, 2], [1, 0, 0], rtol=0, atol=1e-12)
    assert edge == pytest.approx(0.65, abs=1e-15)


def test_the_cube_begins_in_front_and_above_the_front_limit():
    centre, edge = instruments.IRB1600_CUBE
    front, back = instruments.IRB1600_HEIGHTS
    assert centre[0] - edge / 2 > instruments.FRONT
    assert front < centre[2] - edge / 2 < back


def test_constants_cannot_be_changed():
    for array in (instruments.IRB1600_CUBE[0], instruments.IRB1600_P1):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
