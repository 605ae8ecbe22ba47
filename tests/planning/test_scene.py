"""Where a plan is made for: the tracker's place and turn."""

import pytest

from irbcal.planning.conditions import SOLID
from irbcal.planning.scene import open_scene
from irbcal.units import DEG


def test_the_tracker_stands_where_it_is_said_to_stand():
    scene = open_scene("irb1600", tracker=[2.0, 1.0, 0.5, 90 * DEG], without=SOLID)
    assert scene.setting.place == pytest.approx([2.0, 1.0, 0.5])
    # its x axis points along y of the base: what is 1 m from it along y is at (1, 0, 0)
    assert scene.T_world_base @ [2.0, 2.0, 0.5, 1.0] == pytest.approx([1.0, 0.0, 0.0, 1.0])
    assert not any("--tracker" in note for note in scene.notes)
