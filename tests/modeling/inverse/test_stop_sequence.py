"""Commands of sequences of stops, against one stop after the other by bisection-free plain iteration."""

import numpy as np
import pytest
from history_cases import sided_robot

from irbcal.errors import RobotError
from irbcal.modeling.inverse.stop_sequence import commanded_in_order, stops_before

TURNS = np.zeros(6, dtype=bool)


@pytest.fixture(scope="module")
def robot():
    """An IRB 120 whose joints lean to the side that they come from."""
    return sided_robot(others=("gain", "gravity", "harmonics"))


def test_a_thousand_random_sequences_converge(robot):
    rng = np.random.default_rng(3)
    lengths = rng.integers(2, 12, 1000)
    n = int(lengths.sum())
    theta = robot.arm.random_joints(n, 5)
    first = np.r_[True, np.zeros(n - 1, dtype=bool)]
    first[np.cumsum(lengths)[:-1]] = True
    target = np.arange(n)
    before = np.where(first, -1, target - 1)
    q = commanded_in_order(robot.joint_map, theta, target, before)
    previous = np.where(first[:, None], np.nan, np.roll(q, 1, axis=0))
    assert np.abs(robot.joint_map.effective(q, previous) - theta).max() < 1e-12
    assert np.abs(robot.joint_map.effective(q) - theta)[~first].max() > 1e-4


def test_sweeps_give_what_one_stop_after_the_other_gives(robot):
    theta = robot.arm.random_joints(30, 6)
    q = commanded_in_order(robot.joint_map, theta, np.arange(30), np.arange(30) - 1)
    one = [robot.joint_map.commanded(theta[:1])[0]]
    for k in range(1, 30):
        one.append(robot.joint_map.commanded(theta[k : k + 1], one[-1])[0])
    assert np.abs(q - one).max() < 1e-13


def test_a_target_with_several_stops_gets_the_middle(robot):
    theta = robot.arm.random_joints(3, 7)
    q = commanded_in_order(robot.joint_map, theta, np.array([0, 2, 1, 2]), np.array([-1, 0, 2, 1]))
    sides = robot.joint_map.effective(q[[2, 2]], q[[0, 1]]) - theta[2]
    assert np.abs(sides.sum(axis=0)).max() < 1e-13
    assert np.abs(sides).max() > 1e-5
    alone = commanded_in_order(robot.joint_map, theta, np.array([0]), np.array([-1]))
    assert np.abs(alone - robot.joint_map.commanded(theta)).max() < 1e-14


def test_maps_that_cannot_be_inverted_are_refused():
    wild = sided_robot(size=300.0)
    theta = wild.arm.random_joints(20, 1)
    with pytest.raises(RobotError, match="cannot be inverted"):
        commanded_in_order(wild.joint_map, 1e-3 * theta, np.arange(20), np.arange(20) - 1)


def test_stops_before_are_those_of_the_order():
    theta = np.arange(5.0)[:, None] * np.ones(6)
    yes = np.ones(5, dtype=bool)
    assert stops_before(theta, np.arange(5), yes, TURNS).tolist() == [-1, 0, 1, 2, 3]
    follows = np.array([True, True, False, True, True])
    assert stops_before(theta, np.arange(5), follows, TURNS).tolist() == [-1, 0, -1, 2, 3]
    assert stops_before(theta, np.array([0, -1, 1, 2, 0]), yes, TURNS).tolist() == [-1, -1, -1, 1, 2]


def test_stops_without_a_move_keep_the_side_they_lean_to():
    theta = np.array([[0.0], [1.0], [1.0005], [1.0], [2.0]]) * np.ones(6)
    found = stops_before(theta, np.arange(5), np.ones(5, dtype=bool), TURNS)
    assert found.tolist() == [-1, 0, 0, 0, 3]
    path = 0.001 * np.arange(9.0)[:, None] * np.ones(6)  # the last one at least 0.2 degrees away
    found = stops_before(path, np.arange(9), np.ones(9, dtype=bool), TURNS)
    assert found.tolist() == [-1, -1, -1, -1, 0, 1, 2, 3, 4]
    assert stops_before(path, np.arange(9), np.arange(9) != 3, TURNS).tolist() == [-1] * 7 + [3, 4]
    slides = np.ones(6, dtype=bool)
    assert stops_before(theta, np.arange(5), np.ones(5, dtype=bool), slides).tolist() == [-1, 0, 1, 2, 3]
