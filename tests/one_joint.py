"""Moves of one joint at a time, and robots that they are made for."""

from dataclasses import replace

import numpy as np
from support import random_robot

from irbcal.identification import axes


def one_joint_moves(home=0.0, seed=0, degrees=(-30, 0, 30)):
    """Joints (n, 6) and groups of moves of one joint at a time, each group from its own home pose."""
    rng = np.random.default_rng(seed)
    q, groups = [], []
    for k in range(6):
        pose = home * rng.uniform(-1, 1, 6)
        for angle in np.radians(degrees):
            pose[k] = angle
            q.append(pose.copy())
            groups.append(f"axis{k + 1}")
    return np.array(q), groups


def true_robot(nominal, seed, tilt=0.005, **kwargs):
    """Errors of level 26 with Hayati's tilt of axis 3 (``tilt=0``: axes 2 and 3 exactly parallel)."""
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "26", rng, **kwargs)
    beta, alpha = robot.table.beta.copy(), robot.table.alpha.copy()
    beta[2] = tilt * rng.uniform(-1, 1)
    if tilt == 0:
        alpha[2] = nominal.table.alpha[2]
    return robot.replace(arm=nominal.with_table(replace(robot.table, alpha=alpha, beta=beta)))


def own_circles(points):
    """Each reflector's own circle: (joint, target) -> AxisFit."""
    fits = {}
    for k in range(6):
        group = points.select(points.groups == f"axis{k + 1}")
        for t in range(3):
            mine = group.target == t
            fits[k, t] = axes.fit_axis(group.xyz[mine], group.target[mine], group.joints()[mine, k])
    return fits
