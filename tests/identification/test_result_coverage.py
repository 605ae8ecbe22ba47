"""Intervals of base and targets hold their promise, each by itself: as many repetitions hold the truth as they say."""

import numpy as np
from support import arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.modeling import frames

REPETITIONS = 1500
"""A true share of 0.95 gives 0.933 to 0.967 by chance (three standard deviations)."""


def test_intervals_of_each_parameter_hold_as_often_as_they_say():
    rng = np.random.default_rng(11)
    turned = frames.from_xyz_angles([1.5, -0.8, 0.6, 0.7, 1.0, -0.5])  # far from where angles are rotation vectors
    truth = random_robot(arm(), "nominal", rng, T_world_base=turned)
    q = arm().random_joints(12, 3)
    true = dict(
        zip(("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz"), frames.to_xyz_angles(turned), strict=True)
    )
    true |= {
        f"target_{name}_{axis}": p
        for name, place in truth.targets.items()
        for axis, p in zip("xyz", place, strict=True)
    }
    inside = dict.fromkeys(true, 0)
    for _ in range(REPETITIONS):
        for row in identify(arm(), measured(truth, q, 1e-4, rng), "nominal").parameters():
            unit = {"mm": 1e-3, "deg": np.pi / 180}[row.unit]
            inside[row.name] += abs(row.value * unit - true[row.name]) < 1.96 * row.std * unit
    share = {name: count / REPETITIONS for name, count in inside.items()}
    assert min(share.values()) >= 0.93, share
    assert max(share.values()) <= 0.97, share
