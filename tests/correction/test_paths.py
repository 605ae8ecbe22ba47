"""Lines and circles against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, random_robot, random_rotation

from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.paths import (
    Circle,
    Ends,
    PathMove,
    StraightMove,
    cut_move,
    distance_to_path,
    joint_history,
    reversals,
)
from irbcal.errors import RobotError
from irbcal.modeling import frames


def pose(p, R=None):
    return frames.transform(R, p)


def test_line_is_straight_and_turns_evenly():
    R = frames.rotation_from_vector([0.0, 0.0, 1.2])
    line = StraightMove(pose([1, 0, 0]), pose([1, 2, 0], R))
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
    line = StraightMove(pose([0, 0, 0]), pose([2, 0, 0]))
    assert distance_to_path(line, [[1, 0.5, 0], [3, 0, 0], [-3, 4, 0]]) == pytest.approx([0.5, 1.0, 5.0])
    half = Circle.through(pose([1, 0, 0]), [0, 1, 0], pose([-1, 0, 0]))
    assert distance_to_path(half, [[0, 2, 0], [0, 1, 3], [0.5, -2, 0]]) == pytest.approx([1.0, 3.0, np.hypot(0.5, 2)])
    whole = Circle.full(pose([1, 0, 0]), [0, 0, 0], [0, 0, 1])
    assert distance_to_path(whole, [[0, -1.5, 0]]) == pytest.approx([0.5])


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


def test_a_reversal_halfway_between_two_places():
    """Both have the same joint then, exactly; the parabola's top lies between them."""
    k = np.arange(10.0)
    q = np.zeros((10, 6))
    q[:, 1] = 1.0 - 0.01 * (k - 4.5) ** 2
    (top,) = reversals(q, k)
    assert (top.joint, top.kind) == (2, "max")
    assert (top.s, top.angle) == pytest.approx((4.5, 1.0))


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


Q = np.radians([[-30, -10, 20, 0, 40, 10], [0, -10, 20, 5, 45, 15], [30, 10, 10, 10, 50, 20], [30, 10, 10, 10, 50, 20]])


@pytest.fixture(scope="module")
def robots():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(1), size=0.3)
    fake = correct_joints(robot, nominal, Q)
    return nominal, robot, {k: Ends(fake.T_wanted[k], Q[k], fake.q[k], fake.T_fake[k]) for k in range(len(Q))}


def move(start=0, to=2, via=None, zones=(0.0, 0.0), why=""):
    return PathMove(1, "MoveL p", start, via, to, frames.transform(None, [0, 0, 0.1]), zones, why)


@pytest.mark.parametrize("via", [None, 1])
def test_one_piece_less_would_not_do(robots, via):
    nominal, robot, ends = robots
    found = cut_move(move(via=via), ends, robot, nominal, 5e-5)
    assert found.reason == ""
    assert found.deviation <= 5e-5 < found.uncut
    assert found.pieces > 1
    less = cut_move(move(via=via), ends, robot, nominal, found.deviation * 1.0001)
    assert less.pieces == found.pieces
    assert cut_move(move(via=via), ends, robot, nominal, 0.9999 * found.deviation).pieces > found.pieces


@pytest.mark.parametrize(
    ("wish", "tolerance", "words"),
    [
        ({"start": None}, 1e-4, "does not tell where it starts"),
        ({"to": 9}, 1e-4, "not all of its points are corrected"),
        ({"via": 3}, 1e-4, "do not lie on a line"),
        ({}, 1e-9, "pieces of 2 mm still leave the path"),
        ({"zones": (0.2, 0.2)}, 1e-5, "outside the zones of its ends"),
        ({"why": "there are external axes"}, 1e-5, "mm, and there are external axes"),
    ],
)
def test_why_a_move_is_not_cut(robots, wish, tolerance, words):
    nominal, robot, ends = robots
    found = cut_move(move(**wish), ends, robot, nominal, tolerance)
    assert words in found.reason
    assert found.pieces == 1


def test_a_move_that_goes_nowhere(robots):
    nominal, robot, ends = robots
    found = cut_move(move(2, 3), ends, robot, nominal, 1e-6)
    assert (found.deviation, found.reason) == (0.0, "")
