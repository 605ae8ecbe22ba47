"""Statistics against numbers worked out by hand."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.validation import accuracy


def test_statistics_by_hand():
    found = accuracy.statistics(np.array([1.0, 2.0, 6.0]) * 1e-3)
    assert found["n"] == 3
    assert found["mean_mm"] == pytest.approx(3.0)
    assert found["sigma_mm"] == pytest.approx(np.sqrt((4 + 1 + 9) / 2))
    assert found["max_mm"] == pytest.approx(6.0)
    assert found["mean_plus_3sigma_mm"] == pytest.approx(3 + 3 * np.sqrt(7))
    assert found["rms_mm"] == pytest.approx(np.sqrt(41 / 3))


def test_no_points_have_no_statistics():
    assert accuracy.statistics([]) is None
    assert accuracy.statistics([2e-3])["sigma_mm"] == 0.0


def test_statistics_by_label():
    found = accuracy.statistics_by(np.array([1e-3, 3e-3, 5e-3]), ["b", "a", "b"])
    assert list(found) == ["a", "b"]
    assert found["b"]["mean_mm"] == pytest.approx(3.0)


def test_distances_are_those_of_shifted_points():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(0))
    points = measured(robot, nominal.random_joints(10, 0))
    points.xyz[4] += [3e-3, 0, 4e-3]
    distance = accuracy.distances(robot, points)
    assert distance[4] == pytest.approx(5e-3, abs=1e-12)
    assert np.delete(distance, 4).max() < 1e-13
