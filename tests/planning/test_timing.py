"""How long a plan takes, by hand."""

import numpy as np
import pytest

from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import make
from irbcal.planning.scene import open_scene
from irbcal.planning.wish import Wish


def test_times_follow_from_speed_wait_and_readings():
    """The first axis move: 30 degrees with the tip 815 mm from axis 1, at 250 mm/s."""
    scene = open_scene("irb1600", without=SOLID)
    made = make(scene, Wish(cube=0, all_range=0, level="nominal", speed=0.25, wait_s=3.0, references=0))
    _, _, _, time = made.expected()
    first = np.pi / 6 * 0.815 / 0.25
    assert time[:4] == pytest.approx([first + 3, first + 5.5, first + 8, first + 10.5 + first + 3], rel=1e-3)
    quick = make(scene, Wish(cube=0, all_range=0, level="nominal", speed=7.0, wait_s=3.0))
    assert quick.stops[0] == pytest.approx(30 / 150)  # joint 1 turns 150 degrees a second
