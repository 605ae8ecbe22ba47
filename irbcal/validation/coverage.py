"""Do the intervals hold? Measured coordinates within the 95 % intervals that a calibrated robot predicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.measurement.points import PointSet
from irbcal.modeling.robot import Robot
from irbcal.units import MM

EXPECTED = 0.95
"""Share of a coordinate's errors that an interval is made to hold."""

MOST_POSES = 5000
"""Poses whose intervals are counted; of more, ones drawn at random."""


def predictions(robot: Robot, points: PointSet) -> tuple[FloatArray, FloatArray] | None:
    """Where a calibrated robot expects measured points, and how well it knows that.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In its measuring frame; their last moves and loads count.

    Returns
    -------
    position, interval : ndarray, shape (m, 3)
        Metres; the second is the half-width that holds 95 % of a coordinate's errors.

    ``None`` in place of both where too little is known of the robot's certainty.
    """
    certainty = robot.certainty
    if (
        certainty is None
        or not len(points)
        or any(certainty.left_out(points.target_names[k]) is None for k in set(points.target))
    ):
        return None
    position, width = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    for k in np.unique(points.target):
        rows_of_target = points.target == k
        rows = points.pose[rows_of_target]
        previous = None if points.previous is None else points.previous[rows]
        load: dict[str, Any] = {key: None if value is None else value[rows] for key, value in points.load().items()}
        predicted = robot.predict(points.q[rows], previous, points.target_names[k], **load)
        position[rows_of_target], width[rows_of_target] = predicted.position, predicted.interval
    return position, width


def coverage(robot: Robot, points: PointSet) -> dict[str, Any] | None:
    """How many measured coordinates lie within the predicted intervals.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In its measuring frame; not those of its fit.

    Returns
    -------
    dict or None
        ``expected`` share and ``parts``: for ``all``, for poses ``within`` and ``outside`` the joint ranges of the fit
        and for each target the number ``n`` of coordinates, the share ``inside`` and the median half-width ``u95_mm``.
        None where nothing is known of the robot's certainty.
    """
    if points.poses > MOST_POSES:
        drawn = np.random.default_rng(0).permutation(points.poses)[:MOST_POSES]
        points = points.select(np.isin(np.arange(points.poses), drawn))
    predicted = predictions(robot, points)
    if predicted is None or robot.certainty is None:
        return None
    position, width = predicted
    inside = np.abs(points.xyz - position) < width
    outside = robot.certainty.outside(points.q)[points.pose]
    masks: dict[str, BoolArray] = {"all": np.ones(len(points), dtype=bool), "within": ~outside, "outside": outside}
    masks |= {name: points.target == k for k, name in enumerate(points.target_names)}
    shares = {
        name: {
            "n": 3 * int(mask.sum()),
            "inside": float(inside[mask].mean()),
            "u95_mm": float(np.median(width[mask])) / MM,
        }
        for name, mask in masks.items()
        if mask.any()
    }
    return {"expected": EXPECTED, "parts": shares}


def coverage_in_words(coverage: Mapping[str, Any]) -> str:
    """One sentence on what `coverage` found."""
    ranges = coverage["parts"]
    total = ranges["all"]
    text = (
        f"{total['inside']:.1%} of {total['n']} measured coordinates lie within their predicted 95 % intervals (median "
        f"half-width {total['u95_mm']:.3f} mm)"
    )
    if "outside" in ranges:
        inner = f"{ranges['within']['inside']:.1%} within the joint ranges of the fit, " if "within" in ranges else ""
        text += f": {inner}{ranges['outside']['inside']:.1%} outside"
    return text + "."
