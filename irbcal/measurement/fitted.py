"""Which poses a fit has seen, up to small moves and full turns of joints: they prove nothing about it."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.measurement import near
from irbcal.measurement.points import PointSet
from irbcal.units import DEG, MM

NEAR = 2.0 * DEG, 20.0 * MM
"""Revolute and prismatic joints that all agree within this, up to full turns, are no new pose. On 6 SIMULATED robots
errors at fitted poses moved by up to 0.01, 0.3, 1, 2, 5 degrees in each joint are 0.60, 0.67, 0.78, 0.81, 0.80 of those
at other poses (60 poses, model auto): beyond 2 degrees only the errors' slow part is known, as all over the workspace.
"""
SAME_LOAD = 0.1
"""Kilograms by which loads differ at least."""


def poses_of(points: PointSet, fit: PointSet, prismatic: BoolArray) -> BoolArray:
    """Which poses are at joints of the fit, within `NEAR` and up to full turns, whatever was measured there.

    Parameters
    ----------
    points, fit : PointSet
    prismatic : ndarray of bool, shape (joints,)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    if not points.poses or not fit.poses or points.q.shape[1] != fit.q.shape[1]:
        return np.zeros(points.poses, dtype=bool)
    radius = np.where(prismatic, NEAR[1], NEAR[0])
    period = np.where(prismatic, 0.0, 2.0 * np.pi) / radius
    return near.within(points.q / radius, fit.q / radius, period)


def with_fitted_load(points: PointSet, fit: PointSet) -> BoolArray:
    """Which poses carry a load that the fit has seen, shape (n,); all where one of them does not tell the load."""
    if points.payload_kg is None or fit.payload_kg is None:
        return np.ones(points.poses, dtype=bool)
    loads: FloatArray = np.unique(fit.payload_kg[np.isfinite(fit.payload_kg)])
    if not len(loads):
        return np.ones(points.poses, dtype=bool)
    differs = np.abs(points.payload_kg[:, None] - loads).min(axis=1) > SAME_LOAD
    return ~(np.isfinite(points.payload_kg) & differs)
