"""The tracker: which reflectors it can see."""

import numpy as np

from irbcal.simulation.tracker import behind_arm, turned_away


def test_reflector_returns_no_beam_beyond_its_acceptance():
    place = np.array([3.0, 0.0, 0.0])
    angles = np.radians([0.0, 29.9, 30.1, 180.0])
    look = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    assert turned_away(np.tile([1.0, 0, 0], (4, 1)), look, place).tolist() == [False, False, True, True]


def test_a_link_between_target_and_tracker_hides_it():
    # an upright link of 1 m, another to (0.5, 0, 1), and the tool's link, which hides nothing
    origins = np.array([[[0, 0, 0], [0, 0, 1.0], [0.5, 0, 1.0], [0.5, 0, 0.5]]])
    points = np.array([[[-1, 0, 0.5], [-1, 0.3, 0.5], [-1, 0.0, 4.0], [0.3, -1.0, 1.0], [0.6, -1.0, 0.6]]])
    place = np.array([1.0, 0.0, 0.5])
    # beams: through the upright; past it at 0.148 m; over the elbow at 0.186 m; from in front of all; from below
    assert behind_arm(points, origins, place, 0.1).tolist() == [[True, False, False, False, False]]
    # the second beam passes at 0.3 * 1 / |(2, -0.3)| = 0.1483 m
    for radius, hidden in ((0.1482, False), (0.1485, True)):
        assert behind_arm(points[:, 1:2], origins, place, radius).tolist() == [[hidden]]
