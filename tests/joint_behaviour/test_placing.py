"""Robots that the points were not measured on, and too few poses."""

import numpy as np
from moving import TARGETS, random_commands, refusal, simulated

from irbcal.joint_behaviour.residuals import analyse_residuals


def test_refusals_are_one_sentence():
    points, step, robot = simulated(random_commands(20, 0))
    other = robot.replace(targets={name: 3 * np.array(place) for name, place in TARGETS.items()})
    assert "not measured on this robot with this tool" in refusal(analyse_residuals, other, points, step)
    few = points.select(np.arange(20) < 5)
    assert "5 poses are too few" in refusal(analyse_residuals, robot, few, step[:5])
