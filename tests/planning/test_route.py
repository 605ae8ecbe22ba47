"""Orders of poses: short, complete, and round what is in the way."""

import itertools

import numpy as np
import pytest

from irbcal.planning import route
from irbcal.units import DEG


def length(q, order, start):
    places = np.concatenate([start[None], q[list(order)]])
    return np.abs(np.diff(places, axis=0)).max(axis=1).sum()


def test_orders_are_permutations_near_the_shortest_of_all():
    rng = np.random.default_rng(1)
    excess = []
    for _ in range(8):
        q = rng.uniform(-1, 1, (7, 6))
        order, bad = route.shortest_order(q, np.zeros(6), np.ones(6))
        assert sorted(order) == list(range(7))
        assert not len(bad)
        best = min(length(q, p, np.zeros(6)) for p in itertools.permutations(range(7)))
        excess.append(length(q, order, np.zeros(6)) / best - 1)
    assert min(excess) >= -1e-12
    assert max(excess) < 0.15
    assert np.mean(excess) < 0.05


def test_orders_are_far_shorter_than_random_ones():
    rng = np.random.default_rng(2)
    q = rng.uniform(-1, 1, (100, 6))
    order, _ = route.shortest_order(q, np.zeros(6), np.ones(6))
    assert length(q, order, np.zeros(6)) < 0.6 * min(length(q, rng.permutation(100), np.zeros(6)) for _ in range(20))


def test_a_part_of_a_way_is_turned_where_that_makes_it_shorter():
    cost = np.abs(np.subtract.outer(np.arange(6.0), np.arange(6.0)))
    assert route._two_opt(cost, np.array([0, 1, 4, 3, 2, 5])).tolist() == [0, 1, 2, 3, 4, 5]
    assert route._two_opt(cost, np.array([0, 5, 4, 3, 2, 1])).tolist() == [0, 1, 2, 3, 4, 5]  # the end is open


def test_ways_go_round_what_is_in_the_way():
    """Poses on both sides of a wall at zero of joint 1, with a gap where joint 2 is above 0.9."""
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(0.2, 1, 24) * np.tile([1, -1], 12), rng.uniform(-1, 0.8, 24)])
    q = np.concatenate([q, [[0.1, 1.0], [-0.1, 1.0]]])

    def blocked(a, b):
        crossing = a[:, 0] * b[:, 0] < 0
        with np.errstate(divide="ignore", invalid="ignore"):
            height = a[:, 1] + (b[:, 1] - a[:, 1]) * a[:, 0] / (a[:, 0] - b[:, 0])
        return crossing & (height < 0.9)

    start = np.array([0.5, 0.0])
    moves = []

    def noted(a, b):
        moves.extend(frozenset((tuple(x), tuple(y))) for x, y in zip(a.tolist(), b.tolist(), strict=True))
        return blocked(a, b)

    order, bad = route.shortest_order(q, start, np.ones(2), noted)
    assert len(moves) == len(set(moves)) > len(q)  # collisions take long: a move is asked for once
    places = np.concatenate([start[None], q[order]])
    assert sorted(order) == list(range(26))
    assert not len(bad)
    assert not blocked(places[:-1], places[1:]).any()
    no_gap = route.shortest_order(q[:24], start, np.ones(2), blocked)
    places = np.concatenate([start[None], q[no_gap[0]]])
    assert np.flatnonzero(blocked(places[:-1], places[1:])).tolist() == no_gap[1].tolist() != []


def test_moves_are_looked_at_in_small_steps_from_end_to_end():
    q, starts = route.between(
        np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.5, 0.01], [1.0, 0.0]]), np.array([False, False])
    )
    assert np.abs(np.diff(q[: starts[1]], axis=0)).max() <= 4 * DEG
    assert q[0].tolist() == [0, 0]
    assert q[starts[1] - 1] == pytest.approx([0.5, 0.01])
    assert q[starts[1] :].tolist() == [[1, 0], [1, 0]]
