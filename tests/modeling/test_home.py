"""What an arm is commanded: where it is at home, and how many decimals there are."""

import numpy as np
import pytest
from planning_support import gantry, setting
from support import arm

from irbcal.modeling import home
from irbcal.planning import choosing


def test_joints_are_what_can_be_commanded():
    q = np.degrees(choosing.random_poses(setting(), 30, "g", 0).q)
    assert np.abs(q - np.round(q, 4)).max() < 1e-11


def test_home_is_zero_or_the_middle_of_limits_that_leave_no_room():
    assert home.home_joints(arm()).tolist() == [0.0] * 6
    assert home.home_joints(gantry()) == pytest.approx([0.6, 0.0, 0.6])
