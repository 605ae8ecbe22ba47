"""Corners by hand: an arc that cuts one off, a path that runs past one, slanted legs."""

import numpy as np
import pytest

from irbcal.validation.path_check import cornering

LEGS = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.1, 0, 0], [0.1, 0.05, 0], [0.1, 0.1, 0]])
"""Along x, then along y, metres."""


def test_an_arc_of_known_radius_cuts_the_corner():
    r = 0.01
    turn = np.linspace(-np.pi / 2, 0, 2001)
    arc = np.column_stack([0.09 + r * np.cos(turn), r + r * np.sin(turn), 0 * turn])
    path = np.vstack([[[0.0, 0, 0]], arc, [[0.1, 0.1, 0]]])
    (corner,) = cornering([path], LEGS)
    assert pytest.approx(r * (np.sqrt(2) - 1), abs=1e-8) == corner.CR
    assert pytest.approx(0.0, abs=1e-12) == corner.CO
    assert (corner.way, corner.turn) == (pytest.approx(0.1), pytest.approx(np.pi / 2))


def test_running_past_the_corner_is_overshoot_and_the_worst_cycle_counts():
    def past(by, aside=0.0):
        return np.array([[0.0, 0, 0], [0.1, 0, aside], [0.1 + by, 0.002, aside], [0.1, 0.02, 0], [0.1, 0.1, 0]])

    (corner,) = cornering([past(3e-4), past(4e-4, 3e-4)], LEGS)
    assert corner.overshoot == pytest.approx([3e-4, 5e-4])
    assert pytest.approx(5e-4) == corner.CO
    assert corner.round_off[0] == pytest.approx(0.0, abs=1e-12)


def test_the_far_half_of_the_second_leg_belongs_to_the_next_corner():
    zigzag = np.vstack([LEGS, [[0.15, 0.1, 0]]])
    late = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.06, 0], [0.11, 0.09, 0], [0.15, 0.1, 0]])
    first, second = cornering([late], zigzag)
    assert pytest.approx(0.0, abs=1e-12) == first.CO, "what cuts the second corner is no overshoot of the first"
    assert second.way == pytest.approx(0.2)
    # distance of (100, 100) mm from the line through (100, 60) and (110, 90), or from that to (150, 100)
    assert pytest.approx(min(0.04 / np.sqrt(10), np.hypot(0.01, 0.01)), abs=0.003) == second.CR


def test_a_circle_told_by_points_has_no_corner():
    turn = np.linspace(0, 2 * np.pi, 13)
    assert cornering([LEGS], np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])) == ()
