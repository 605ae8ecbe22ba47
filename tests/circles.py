"""Circles for the tests of the ballbar."""

import numpy as np

from irbcal.validation.ballbar_check import circle, tool_frame


def small(nominal, **more):
    """A circle of 150 mm about a place in front of the robot, its joints, and the tool of annex VI."""
    q = np.radians([10.0, 0, 0, 0, 90, 0])
    tool = tool_frame([0, 0.065, 0.149])
    return circle(nominal, q, 0.15, tool, **more), q, tool
