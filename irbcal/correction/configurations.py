"""Configuration data of poses: which of the solutions a controller takes, and how the taken one is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, own_model

QUADRANT_TOLERANCE = 1e-6
"""Radians by which rounding may put an axis beyond the edge of its quadrant."""


class ConfData(NamedTuple):
    """Configuration of a pose: quadrants of axes 1, 4 and 6, and the branch number ``cfx``.

    The quadrant of an axis is ``floor(angle / 90 degrees)``.
    """

    cf1: int
    cf4: int
    cf6: int
    cfx: int


def quadrants(q: ArrayLike) -> IntArray:
    """Quadrants of joints 1, 4 and 6: ``floor(angle / 90 degrees)``, shape (..., 3)."""
    return np.floor(np.asarray(q)[..., [0, 3, 5]] / (np.pi / 2) + 1e-12).astype(int)


def configuration_of(q: ArrayLike, cfx: int) -> ConfData:
    """Configuration data of joints (6,) in radians; ``cfx`` is kept."""
    cf1, cf4, cf6 = quadrants(q)
    return ConfData(int(cf1), int(cf4), int(cf6), cfx)


def seeds_of(
    nominal: Arm, T_base_tip: FloatArray, configurations: Sequence[ConfData | None], own: Arm | None = None
) -> tuple[FloatArray, BoolArray]:
    """Joints that the controller takes for poses with configuration data.

    Of the solutions within the joint limits, turned so that axes 1, 4 and 6 stand in their quadrants, the one with
    the branch number ``cfx``, else the one nearest to zero joints. Poses without configuration data take the solution
    nearest to zero joints.

    Parameters
    ----------
    nominal : Arm
    T_base_tip : ndarray, shape (n, 4, 4)
    configurations : sequence of ConfData or None, length n
    own : Arm, optional
        What the controller computes with where that is not the nominal arm.

    Returns
    -------
    q : ndarray, shape (n, 6)
        Radians; NaN where the pose is out of reach or nothing fits.
    told : ndarray of bool, shape (n,)
        False where the pose can be reached, but not with its configuration data.
    """
    branches = own_model.branches(nominal, T_base_tip, own)
    nearest, _ = closed_form.nearest(nominal, branches, np.zeros(6))
    n = len(nearest)
    wanted = np.array([[c.cf1, c.cf4, c.cf6] if c else [0, 0, 0] for c in configurations]).reshape(n, 3)
    cfx = np.array([c.cfx if c else -1 for c in configurations])
    given = np.array([c is not None for c in configurations], dtype=bool)
    q = branches.joints.copy()
    axes = [0, 3, 5]
    middle = (wanted[:, None, :] + 0.5) * (np.pi / 2)
    q[..., axes] += 2 * np.pi * np.round((middle - q[..., axes]) / (2 * np.pi))
    fits = (np.abs(q[..., axes] - middle) <= np.pi / 4 + QUADRANT_TOLERANCE).all(axis=-1)
    inside = ((q >= nominal.lower - 1e-9) & (q <= nominal.upper + 1e-9)).all(axis=-1)
    usable: BoolArray = branches.valid & fits & inside
    cost = np.where(usable, np.sum(np.nan_to_num(q) ** 2, axis=-1), np.inf)
    cost[np.arange(n), np.clip(cfx, 0, 7)] -= np.where((cfx >= 0) & (cfx <= 7), 1e6, 0.0)
    cost[~usable] = np.inf
    best = np.argmin(cost, axis=1)
    found: BoolArray = np.any(usable, axis=1)
    chosen = np.where(found[:, None], q[np.arange(n), best], np.nan)
    reachable = np.isfinite(nearest).all(axis=1)
    return np.where(given[:, None], chosen, nearest), found | ~given | ~reachable
