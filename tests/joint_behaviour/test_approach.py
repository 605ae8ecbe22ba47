"""Residuals by the direction of approach: the step between both directions is the backlash."""

import numpy as np
import pytest
from moving import random_commands, simulated

from irbcal.joint_behaviour import approach

PLAY = np.radians([0.04, 0, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def found():
    points, step, robot = simulated(random_commands(120, 0), None, PLAY, noise=3e-5, rng=np.random.default_rng(0))
    return approach.analyse(robot, points, np.sign(np.nan_to_num(step)))


def test_the_step_between_directions_is_the_backlash(found):
    first = found.terms[0]
    assert first.low[0] < PLAY[0] < first.high[0]
    below, above = found.by_angle(0, 1.0), found.by_angle(0, -1.0)
    assert np.average(above[:, 1]) - np.average(below[:, 1]) == pytest.approx(PLAY[0], rel=0.2)
    assert (below[:, 2] < 0.2 * PLAY[0]).all()
    assert (np.diff(below[:, 0]) > 0).all()
    assert "joints: 1" in repr(found)


def test_small_bins_are_left_out(found):
    few = approach.Approach(
        found.robot,
        found.points,
        np.where(np.arange(120)[:, None] < 4, 1.0, 0.0) * np.ones(6),
        found.terms,
        found.angle,
    )
    assert few.by_angle(0, 1.0).shape == (0, 3)
