"""Joints along paths against the robot, and their reversals against known curves."""

import numpy as np
from support import arm

from irbcal.correction.joints_along import joint_history, reversals
from irbcal.correction.path import Circle


def test_reversals_of_known_curves():
    s = np.linspace(0, 1, 361)
    q = np.zeros((361, 6))
    q[:, 0] = 0.5 * np.sin(2 * np.pi * s)
    q[:, 3] = -0.2 * np.cos(2 * np.pi * (s - 0.1))
    q[:, 4] = s  # never turns back
    q[:, 5] = 1e-6 * np.sin(9 * s)  # does not really move
    found = [(r.joint, r.kind) for r in reversals(q, s)]
    assert found == [(4, "min"), (1, "max"), (4, "max"), (1, "min")]
    places = [r.s for r in reversals(q, s)]
    assert np.abs(np.array(places) - [0.1, 0.25, 0.6, 0.75]).max() < 1e-5
    assert np.abs(np.array([r.angle for r in reversals(q, s)]) - [-0.2, 0.5, 0.2, -0.5]).max() < 1e-6


def small_circle(nominal):
    """The circle of annex VI, first test: radius 300 mm about a point in front of the robot, horizontal."""
    seed = np.radians([-3.984, 5.733483, 4.519, -0.017, 79.885, -273.988])
    T = nominal.forward(seed[None])[0]
    start = T.copy()
    start[0, 3] += 0.15
    return Circle.full(start, T[:3, 3], [0, 0, 1]), seed


def test_joint_history_follows_the_path_without_jumps():
    nominal = arm()
    circle, seed = small_circle(nominal)
    s = np.linspace(0, 1, 721)
    q = joint_history(circle, nominal, seed, s)
    assert np.abs(np.diff(q, axis=0)).max() < 0.02
    assert np.abs(nominal.forward(q) - circle.poses(s)).max() < 1e-12
    assert np.abs(q[-1] - q[0]).max() < 1e-9
    turned = reversals(q, s)
    assert {r.joint for r in turned} >= {1, 2, 3, 5}
    for r in turned:
        # at a reversal the joint's speed along the path is zero (the speed elsewhere is of the order of one)
        h = 1e-4
        ends = joint_history(circle, nominal, seed, np.array([r.s - h, r.s + h]) % 1.0)[:, r.joint - 1]
        assert abs(ends[1] - ends[0]) / (2 * h) < 2e-3
