"""The ways between the poses of a plan: which are free, and in which order the poses are visited."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.home import home_joints
from irbcal.planning import route
from irbcal.planning.conditions import Setting, touching_on
from irbcal.planning.sources import Poses


def ordered(setting: Setting, poses: Poses, start: FloatArray, speed: FloatArray) -> tuple[Poses, BoolArray, BoolArray]:
    """Random poses in an order that keeps motion short, with no move through the arm itself or below the heights.

    Parameters
    ----------
    setting : Setting
    poses : Poses
    start : ndarray, shape (joints,)
        Where the robot comes from.
    speed : ndarray, shape (joints,)

    Returns
    -------
    Poses
    over_home : ndarray of bool, shape (n,)
        Poses to which the direct way is not free, but that over `home_joints` is.
    blocked : ndarray of bool, shape (n,)
        Poses to which neither is free.
    """
    rows, bad = route.shortest_order(poses.q, start, speed, lambda a, b: blocked_moves(setting, a, b))
    poses = poses.take(rows)
    places = np.concatenate([start[None], poses.q])
    home = np.broadcast_to(home_joints(setting.arm), (len(bad), len(start)))
    stuck = blocked_moves(setting, places[bad], home) | blocked_moves(setting, home, places[bad + 1])
    over_home, blocked = np.zeros((2, len(poses.q)), dtype=bool)
    over_home[bad[~stuck]], blocked[bad[stuck]] = True, True
    return poses, over_home, blocked


def blocked_moves(setting: Setting, q_from: FloatArray, q_to: FloatArray) -> BoolArray:
    """Moves, linear in the joints, on which the robot touches itself or goes below the heights; shape (m,)."""
    if not len(q_from):
        return np.zeros(0, dtype=bool)
    q, starts = route.between(q_from, q_to, setting.arm.table.prismatic)
    bad = np.zeros(len(q), dtype=bool)
    if "height" in setting.conditions:
        tip, points, _ = setting.places(q)
        own = setting.high(*setting.places(q_from)[:2]) & setting.high(*setting.places(q_to)[:2])
        move = np.repeat(np.arange(len(starts)), np.diff([*starts, len(q)]))
        bad |= ~setting.high(tip, points) & own[move]  # ends that are low themselves are known to be
    bad = np.logical_or.reduceat(bad, starts)
    return bad | touching_on(setting, q, starts) if "collision" in setting.conditions else bad
