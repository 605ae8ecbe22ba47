"""A real robot's tracker points as distances from some stands."""

import numpy as np
import pandas as pd

from irbcal.identification.feature_fit import identify_features
from irbcal.measurement import features
from irbcal.modeling.frames import rigid_fit

STANDS = np.array([[0.0, 0.0, 0.0], [2.2, -2.5, 0.5], [2.4, 0.3, 2.5]])
"""Where the tracker stood, and two more places, in its frame, metres."""


def rows(points, stands):
    """The points as rows, of kind radius from each stand (None: as a tracker sees them)."""
    joints = {f"c{j}_deg": column for j, column in enumerate(np.degrees(points.q[points.pose]).T, 1)}
    base = pd.DataFrame(joints).assign(pose=points.pose_ids[points.pose].astype(str), target=points.names())
    if stands is None:
        return base.assign(
            feature="", x_mm=points.xyz[:, 0] * 1e3, y_mm=points.xyz[:, 1] * 1e3, z_mm=points.xyz[:, 2] * 1e3
        )
    parts = [
        base.assign(feature=f"stand {k}", value_mm=1e3 * np.linalg.norm(points.xyz - stand, axis=1))
        for k, stand in enumerate(stands)
    ]
    return pd.concat(parts, ignore_index=True)


def heldout(measured, stands, fitted=200, choices=None):
    """Errors of the poses after the first ones, metres: the robot put where it fits the fitted points best."""
    mine = np.arange(measured.points.poses) < fitted
    fit, rest = measured.points.select(mine), measured.points.select(~mine)
    count = 0 if stands is None else len(stands)
    known = pd.DataFrame([{"feature": f"stand {k}", "kind": "radius", "offset_mm": "0"} for k in range(count)])
    seen = features.read(rows(fit, stands), known if count else None, measured.model)
    found = identify_features(measured.model, seen, choices=choices)
    robot = found.robot

    def predicted(points, motion):
        T = robot.forward(points.q, points.q - motion.moves)[points.pose]
        place = np.array([robot.targets[name] for name in points.names()])
        return np.einsum("mij,mj->mi", T[:, :3, :3], place) + T[:, :3, 3]

    motion = measured.motion.select(mine)
    warmth = found.warmth(fit, motion.elapsed)
    away = 0.0 if warmth is None else warmth @ robot.T_world_base[:3, :3]
    T = rigid_fit(predicted(fit, motion) + away, fit.xyz)
    at = predicted(rest, measured.motion.select(~mine))
    return np.linalg.norm(at @ T[:3, :3].T + T[:3, 3] - rest.xyz, axis=1)
