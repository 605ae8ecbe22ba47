"""Simulated cycles of the ISO 9283 pose tests, and the measurement files that they make."""

import csv

import numpy as np
from support import arm

from irbcal.modeling import frames
from irbcal.validation.pose_check import five_poses

CYCLES = 12


def cycles(robot, shift=(1e-4, 0, 0), turn=(0, 0, 5e-4), seed=0):
    """Flange poses (5 test poses x cycles), off by a shift and a turn, with scatter of 20 um and 0.1 mrad."""
    rng = np.random.default_rng(seed)
    q = five_poses(arm()).q
    T = np.repeat((robot.T_world_base @ robot.poses(q))[:, None], CYCLES, axis=1)
    away = 2e-5 * rng.standard_normal((5, CYCLES, 3))
    turned = np.asarray(turn) + 1e-4 * rng.standard_normal((5, CYCLES, 3))
    for p in range(5):
        for c in range(CYCLES):
            T[p, c, :3, :3] = frames.rotation_from_vector(turned[p, c]) @ T[p, c, :3, :3]
    T[..., :3, 3] += np.asarray(shift) + away
    return q, T, away, turned


def write(path, robot, q, T, targets=("smr1", "smr2", "smr3"), group="iso9283", extra=(), columns=()):
    """Measurement file of target places for poses T (poses, cycles, 4, 4)."""
    with open(path, "w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(
            ["pose", *(f"q{i}_deg" for i in range(1, 7)), "group", "cycle", "target", "x_mm", "y_mm", "z_mm", *columns]
        )
        for c in range(T.shape[1]):
            for p in range(len(T)):
                for name in targets:
                    xyz = (T[p, c, :3, :3] @ robot.targets[name] + T[p, c, :3, 3]) * 1e3
                    values = [f"{v:.7f}" for v in (*np.degrees(q[p]), *xyz)]
                    more = extra[p][c] if len(extra) else ()
                    out.writerow([f"P{p + 1}", *values[:6], group, c + 1, name, *values[6:], *more])
    return path
