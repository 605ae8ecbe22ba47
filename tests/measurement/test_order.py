"""Errors tell whether the order of the file is that of the robot's way."""

from dataclasses import replace

import numpy as np
from history_cases import sided_points, sided_robot
from support import measured, random_robot

from irbcal.measurement.order import shown_share, with_last_moves
from irbcal.measurement.points import distances


def test_last_moves_are_used_where_the_order_is_right():
    robot = sided_robot()
    points = sided_points(robot, noise=1e-5)
    share, std = shown_share(robot, points)
    assert abs(share - 1.0) < 3 * std
    assert std < 0.05
    found, notes = with_last_moves(robot, points)
    assert found is points
    assert "39 of 40 poses" in notes[0]


def test_last_moves_are_dropped_where_they_make_errors_larger():
    robot = sided_robot()
    points = sided_points(robot, noise=1e-5)
    wrong = replace(points, previous=2 * points.q - points.previous)  # every joint from the other side
    assert shown_share(robot, wrong)[0] < -0.5
    found, notes = with_last_moves(robot, wrong)
    assert found.previous is None
    assert "not the order of measuring" in notes[0]
    assert distances(robot, found).mean() < distances(robot, wrong).mean()


def test_a_shuffled_file_makes_errors_no_larger():
    robot = sided_robot()
    points = sided_points(robot, n=300, noise=1e-5)
    order = np.random.default_rng(0).permutation(points.poses)
    before = np.full(points.q.shape, np.nan)
    before[order[1:]] = points.q[order[:-1]]
    mixed = replace(points, previous=before)
    found, _ = with_last_moves(robot, mixed)
    unknown = distances(robot, replace(points, previous=None))
    assert distances(robot, found).mean() <= 1.01 * unknown.mean()
    assert distances(robot, points).mean() < 0.1 * unknown.mean()


def test_robots_without_history_and_files_without_order_say_so():
    thesis = random_robot(sided_robot().arm, "34", np.random.default_rng(2))
    q = thesis.arm.random_joints(5, 1)
    assert with_last_moves(thesis, measured(thesis, q))[1] == []
    points = replace(sided_points(sided_robot()), previous=None)
    assert "not known" in with_last_moves(sided_robot(), points)[1][0]
