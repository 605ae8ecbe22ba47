"""How long a measuring plan takes."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.planning import route
from irbcal.planning.scene import Scene
from irbcal.planning.wish import Wish


def stops(
    scene: Scene, wish: Wish, q: FloatArray, measured: BoolArray, start: FloatArray, over_home: BoolArray
) -> FloatArray:
    """When the robot stands still in each pose, seconds from the start, shape (n,).

    Moves are as quick as the slowest joint, or as the tip (Nubiola 2011, section 7.1: 500 mm/s, four seconds of rest).
    """
    q_before = np.concatenate([start[None], q[:-1]])
    home = np.broadcast_to(start, q.shape)
    direct = move_times(scene, wish, q_before, q)
    around = move_times(scene, wish, q_before, home) + move_times(scene, wish, home, q)
    hold = wish.hold_s(measured)
    times: FloatArray = np.cumsum(np.where(over_home, around, direct) + np.concatenate([[0.0], hold[:-1]]))
    return times


def move_times(scene: Scene, wish: Wish, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Seconds of each move, shape (m,)."""
    q_between, starts = route.between(q_from, q_to, scene.setting.arm.table.prismatic)
    tip = scene.setting.places(q_between)[0]
    pieces = np.append(np.linalg.norm(np.diff(tip, axis=0), axis=1), 0.0)
    pieces[starts[1:] - 1] = 0.0
    by_joint = route.move_times(q_from, q_to, scene.joint_speed)
    return np.maximum(by_joint, np.add.reduceat(pieces, starts) / wish.speed)
