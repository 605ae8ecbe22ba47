"""Repeats of one stop averaged: they tell of the tracker's noise, not of the robot's errors elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from irbcal.measurement.points import PointSet
from irbcal.modeling.terms.situation import Motion

SAME = 1e-6
"""Joints and last moves that agree within this are the same stop, radians or metres."""


def averaged(points: PointSet, motion: Motion) -> tuple[PointSet, Motion]:
    """Points and motion with repeats of one joint vector, reached by the same move, averaged into one pose.

    Poses with measured orientations are left as they are, and so are stops reached from another side: their difference
    shows the direction terms.

    Parameters
    ----------
    points : PointSet
    motion : Motion
        Of the points' poses.

    Returns
    -------
    points : PointSet
    motion : Motion
    """
    keys = np.round(np.column_stack([motion.q, motion.moves]) / SAME)
    if motion.payload_kg is not None:
        keys = np.column_stack([keys, motion.payload_kg])
    if motion.payload_place is not None:
        keys = np.column_stack([keys, motion.payload_place])
    if points.session is not None:
        keys = np.column_stack([keys, np.unique(points.session.astype(str), return_inverse=True)[1]])
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(keys) or points.oriented().any():
        return points, motion
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))  # in the order of the first of each
    pose = rank[which.ravel()]
    first = np.sort(first)
    count = np.bincount(pose)
    cell = pose[points.pose] * len(points.target_names) + points.target
    cells, where = np.unique(cell, return_inverse=True)
    where = where.ravel()
    seen = np.bincount(where)
    xyz = np.column_stack([np.bincount(where, points.xyz[:, k]) for k in range(3)]) / seen[:, None]
    u95 = None if points.u95 is None else np.bincount(where, points.u95) / seen
    load: dict[str, Any] = {k: v if v is None else v[first] for k, v in points.load().items()}
    merged = replace(
        points,
        q=motion.q[first],
        pose=cells // len(points.target_names),
        target=cells % len(points.target_names),
        xyz=xyz,
        pose_ids=points.pose_ids[first],
        groups=points.groups[first],
        previous=None if points.previous is None else points.previous[first],
        session=None if points.session is None else points.session[first],
        rotation=None,
        u95=u95,
        **load,
    )
    elapsed = None if motion.elapsed is None else np.bincount(pose, motion.elapsed) / count
    torques = motion.torques
    if torques is not None:
        torques = np.column_stack([np.bincount(pose, felt) / count for felt in torques.T])
    return merged, replace(motion.select(first), move=motion.moves[first], elapsed=elapsed, torques=torques)
