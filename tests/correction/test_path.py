"""Lines and circles against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import random_rotation

from irbcal.correction.path import Circle, Line, distance_to_path
from irbcal.errors import RobotError
from irbcal.modeling import frames


def pose(p, R=None):
    return frames.transform(R, p)


def test_line_is_straight_and_turns_evenly():
    R = frames.rotation_from_vector([0.0, 0.0, 1.2])
    line = Line(pose([1, 0, 0]), pose([1, 2, 0], R))
    T = line.poses([0, 0.25, 1])
    assert line.length == 2.0
    assert np.abs(T[:, :3, 3] - [[1, 0, 0], [1, 0.5, 0], [1, 2, 0]]).max() < 1e-15
    assert frames.rotation_distance(T[1, :3, :3], frames.rot_z(0.3)) < 1e-15
    assert frames.rotation_distance(T[2, :3, :3], R) < 1e-15


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 6.1), st.floats(0.05, 0.95))
def test_circle_through_three_points(seed, angle, middle):
    rng = np.random.default_rng(seed)
    R, center, radius = random_rotation(rng), rng.uniform(-1, 1, 3), rng.uniform(0.1, 1)
    at = center + radius * (R @ [np.cos([0, middle * angle, angle]), np.sin([0, middle * angle, angle]), [0, 0, 0]]).T
    arc = Circle.through(pose(at[0]), at[1], pose(at[2]))
    assert np.abs(arc.center - center).max() < 1e-6
    assert abs(arc.angle - angle) < 1e-6
    assert abs(arc.length - radius * angle) < 1e-6
    T = arc.poses([0, middle, 1])
    assert np.abs(T[:, :3, 3] - at).max() < 1e-6


def test_points_on_a_line_make_no_circle():
    with pytest.raises(RobotError, match="three points that do not lie on a line"):
        Circle.through(pose([0, 0, 0]), [1, 0, 0], pose([2, 0, 0]))


def test_distances_from_paths():
    line = Line(pose([0, 0, 0]), pose([2, 0, 0]))
    assert distance_to_path(line, [[1, 0.5, 0], [3, 0, 0], [-3, 4, 0]]) == pytest.approx([0.5, 1.0, 5.0])
    half = Circle.through(pose([1, 0, 0]), [0, 1, 0], pose([-1, 0, 0]))
    assert distance_to_path(half, [[0, 2, 0], [0, 1, 3], [0.5, -2, 0]]) == pytest.approx([1.0, 3.0, np.hypot(0.5, 2)])
    whole = Circle.full(pose([1, 0, 0]), [0, 0, 0], [0, 0, 1])
    assert distance_to_path(whole, [[0, -1.5, 0]]) == pytest.approx([0.5])
