"""The order in which poses are visited: short motion, and no move through something."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.units import DEG, MM

STEP = (4 * DEG, 20 * MM)
"""Longest step of a move that is looked at, of revolute and prismatic joints."""

ROUNDS = 60
"""How often a route with blocked moves is searched again."""

BLOCKED = 1e3
"""Seconds that a blocked move counts for."""


def move_times(q_from: FloatArray, q_to: FloatArray, speed: FloatArray) -> FloatArray:
    """Time of the slowest joint, seconds; shapes of the joints broadcast, ``speed`` is (joints,) in SI units."""
    return (np.abs(q_to - q_from) / speed).max(axis=-1)


def shortest_order(
    q: FloatArray,
    start: FloatArray,
    speed: FloatArray,
    blocked: Callable[[FloatArray, FloatArray], BoolArray] | None = None,
) -> tuple[IntArray, IntArray]:
    """An order of poses that keeps motion short: nearest neighbour first, then 2-opt.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    start : ndarray, shape (joints,)
        Where the robot comes from; it may end anywhere.
    speed : ndarray, shape (joints,)
        Of the joints, SI units.
    blocked : callable, optional
        From joints before and after moves, (m, joints) each, to a mask (m,) of moves that cannot be made, in neither
        direction. Each move is asked for once.

    Returns
    -------
    order : ndarray of int, shape (n,)
    bad : ndarray of int
        Places in the order whose move to them is blocked: no way around was found.
    """
    q_all = np.concatenate([start[None], q])
    cost = move_times(q_all[:, None], q_all[None], speed)
    path = _nearest_neighbour(cost)
    checked = np.zeros(cost.shape, dtype=bool)
    for _ in range(ROUNDS):
        path = _two_opt(cost, path)
        if blocked is None or len(path) < 2:
            bad = np.zeros(0, dtype=int)
            break
        first, second = path[:-1], path[1:]
        is_blocked = cost[first, second] >= BLOCKED
        open_moves = np.flatnonzero(~checked[first, second])
        new = open_moves[blocked(q_all[first[open_moves]], q_all[second[open_moves]])]
        checked[first, second] = checked[second, first] = True
        bad = np.sort(np.concatenate([np.flatnonzero(is_blocked), new]))
        if not len(new):
            break
        cost[first[new], second[new]] += BLOCKED
        cost[second[new], first[new]] += BLOCKED
    return path[1:] - 1, bad


def _nearest_neighbour(cost: FloatArray) -> IntArray:
    unvisited = np.ones(len(cost), dtype=bool)
    path = [0]
    unvisited[0] = False
    while unvisited.any():
        path.append(int(np.argmin(np.where(unvisited, cost[path[-1]], np.inf))))
        unvisited[path[-1]] = False
    return np.array(path)


def _two_opt(cost: FloatArray, path: IntArray) -> IntArray:
    """Reverse parts of an open path that starts where it does, as long as one makes it shorter."""
    n = len(path)
    upper = np.triu(np.ones((n - 1, n - 1), dtype=bool))
    while n > 2:
        C = cost[np.ix_(path, path)]
        step = np.append(np.diagonal(C, 1), 0.0)  # from each place to the next; none after the last
        last = np.column_stack([C[1:, 1:], np.zeros(n - 1)])[:, 1:]  # from i + 1 to j + 1
        # parts i + 1 ... j turned round, rows i from 0 and columns j from 1
        gain = step[:-1, None] + step[None, 1:] - C[:-1, 1:] - last
        gain[~upper] = 0.0
        i, j = np.unravel_index(np.argmax(gain), gain.shape)
        if gain[i, j] < 1e-9:
            break
        path = np.concatenate([path[: i + 1], path[i + 1 : j + 2][::-1], path[j + 2 :]])
    return path


def between(
    q_from: FloatArray, q_to: FloatArray, prismatic: BoolArray, coarser: float = 1.0
) -> tuple[FloatArray, IntArray]:
    """Joints along moves, both ends included, in steps of at most `STEP`.

    Parameters
    ----------
    q_from, q_to : ndarray, shape (m, joints)
    prismatic : ndarray of bool, shape (joints,)
    coarser : float
        Factor on the steps.

    Returns
    -------
    q : ndarray, shape (k, joints)
    starts : ndarray of int, shape (m,)
        First row of each move.
    """
    if not len(q_from):
        return np.zeros((0, len(prismatic))), np.zeros(0, dtype=int)
    step = coarser * np.where(prismatic, STEP[1], STEP[0])
    count = np.ceil((np.abs(q_to - q_from) / step).max(axis=1)).astype(int) + 1
    count = np.maximum(count, 2)
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    move = np.repeat(np.arange(len(q_from)), count)
    share = (np.arange(len(move)) - starts[move]) / (count[move] - 1)
    return q_from[move] + share[:, None] * (q_to - q_from)[move], starts
