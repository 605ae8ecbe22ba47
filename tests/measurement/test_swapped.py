"""Exchanged names of reflectors are found, by the tool's shape and against a robot; good names are left alone."""

from dataclasses import replace

import numpy as np
from support import TARGETS, arm, measured, random_robot

from irbcal.measurement import cleaning

NAMES = tuple(TARGETS)


def simulated(seed=1, poses=40):
    rng = np.random.default_rng(seed)
    robot = random_robot(arm(), "34", rng)
    return robot, measured(robot, arm().random_joints(poses, seed), 3e-5, rng)


def exchanged(points, poses, order):
    """The points with other names in some poses: target k is called order[k]."""
    mine = np.isin(points.pose, poses)
    return replace(points, target=np.where(mine, np.array(order)[points.target], points.target))


def shaped(points):
    seen = np.full((points.poses, 3, 3), np.nan)
    seen[points.pose, points.target] = points.xyz
    return seen


def test_by_shape():
    _, points = simulated()
    assert cleaning.by_shape(shaped(points)) == []
    found = cleaning.by_shape(shaped(exchanged(points, [3, 5, 8], [1, 0, 2])))
    assert [(p, order.tolist()) for p, order in found] == [(p, [1, 0, 2]) for p in (3, 5, 8)]
    # the cycle smr1 -> smr2 -> smr3: what is called smr2 is smr1
    ((pose, order),) = cleaning.by_shape(shaped(exchanged(points, [7], [1, 2, 0])))
    assert pose == 7
    assert order.tolist() == [2, 0, 1]


def test_a_gross_error_is_no_exchange():
    _, points = simulated()
    seen = shaped(points)
    seen[4, 1] += 0.02
    seen[9, 2] = np.nan
    assert cleaning.by_shape(seen) == []


def test_by_robot():
    """Two reflectors have one distance only: a robot tells."""
    robot, points = simulated()
    two = points.take(points.target < 2).with_seen_targets()
    assert cleaning.by_robot(robot, two) == []
    found = cleaning.by_robot(robot, exchanged(two, range(20), [1, 0, 2]))
    assert [(p, order.tolist()) for p, order in found] == [(p, [1, 0]) for p in range(20)]


def test_in_words():
    found = [(f"P{k}", np.array([1, 0, 2])) for k in range(1, 4)] + [("X", np.array([2, 0, 1]))]
    assert cleaning.in_words(found, NAMES) == [
        "smr1 and smr2 are swapped in 3 poses (P1 to P3): correct their names in the file.",
        "smr1, smr2, smr3 are in truth smr3, smr1, smr2 in pose X: correct their names in the file.",
    ]
