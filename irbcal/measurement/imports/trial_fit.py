"""The nominal robot fitted to points with unknown base and tool: whether joints and points belong together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.measurement.column_names import POSITION, joint_columns, joint_units
from irbcal.modeling.arm import Arm
from irbcal.units import MM

STILL = 1e-4
"""Metres within which a target that is fixed to the ground is found again and again."""

AGREES = 0.05
"""Share of the points' spread within which a trial fit agrees with a robot."""

SCALE_TOLERANCE = 0.1


class TrialFit(NamedTuple):
    """How well a robot explains points."""

    residual: float
    """Typical distance (m) of the middle of all points."""
    spread: float
    """Root mean square distance of the points from their mean, m."""
    scale: float
    """Metres that a metre of the file is."""
    rows: int
    """Points."""

    @property
    def share(self) -> float:
        """Residual over spread."""
        return self.residual / self.spread if self.spread > 0.0 else np.inf

    @property
    def agrees(self) -> bool:
        """Whether the robot explains them, but for the unit of length."""
        return self.share < AGREES


def trial_fit(arm: Arm, q: FloatArray, pose: IntArray, target: IntArray, points: FloatArray) -> TrialFit | None:
    """Fit base and tool of a nominal robot to measured points by linear least squares, with a free unit of length.

    With the tip pose ``T_base_tip = (R_i, t_i)`` and an affine map ``A x + c`` from tracker to base, a target ``p_k``
    on the tool has ``A x_ik + c - R_i p_k = t_i``: linear in all unknowns. A is a rotation times the unit of length, so
    that ``det(A)^(1/3)`` is that unit, and a fit that needs a mirror or a shear contradicts the file. Points beyond
    five times the median residual are left out twice.

    Parameters
    ----------
    arm : Arm
    q : ndarray, shape (poses, joints)
        Joints as the controller counts them, radians and metres.
    pose, target : ndarray of int, shape (rows,)
        Numbers from 0.
    points : ndarray, shape (rows, 3)
        Measured positions, in any unit.

    Returns
    -------
    TrialFit or None
        None: too few points, or points from which base and tool cannot be told apart.
    """
    count = int(target.max(initial=0)) + 1
    unknowns = 12 + 3 * count
    if 3 * len(points) < 1.5 * unknowns:
        return None
    T = arm.forward(arm.from_controller(q))[pose]
    centre = points.mean(axis=0)
    spread = float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean()))
    if spread <= 0.0:
        return None
    x = (points - centre) / spread
    rows = np.zeros((len(points), 3, unknowns))
    for axis in range(3):
        rows[:, axis, 3 * axis : 3 * axis + 3] = x
        rows[:, axis, 9 + axis] = 1.0
    for k in range(count):
        rows[target == k, :, 12 + 3 * k : 15 + 3 * k] = -T[target == k, :3, :3]
    left, right = rows, T[:, :3, 3]
    solution: FloatArray = np.zeros(unknowns)
    residual: FloatArray = np.zeros(len(points))
    used: BoolArray = np.ones(len(points), dtype=bool)
    for _ in range(3):
        flat = left[used].reshape(-1, unknowns)
        solution = np.asarray(np.linalg.lstsq(flat, right[used].ravel(), rcond=1e-10)[0], dtype=np.float64)
        residual = np.asarray(np.linalg.norm(left @ solution - right, axis=1))
        used = np.asarray(residual <= max(5.0 * float(np.median(residual)), 1e-6))
        if 3 * used.sum() < 1.5 * unknowns:
            return None
    A = solution[:9].reshape(3, 3) / spread
    size = float(np.cbrt(np.linalg.det(A)))
    values = np.linalg.svd(A, compute_uv=False)
    spread_base = float(np.sqrt(((right - right.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if size <= 0.0 or np.ptp(values) > 2 * SCALE_TOLERANCE * size:
        return TrialFit(spread_base, spread_base, abs(size), len(points))
    return TrialFit(float(np.median(residual)), spread_base, size, len(points))


def fit_of_table(arm: Arm, frame: pd.DataFrame) -> TrialFit | None:
    """`trial_fit` of an imported table; of its sessions, which have a base and tool each, the one that agrees least."""
    sessions = [rows for _, rows in frame.groupby("session")] if "session" in frame.columns else [frame]
    fits = [fit for rows in sessions if (fit := _fit_of_session(arm, rows)) is not None]
    return max(fits, key=lambda fit: fit.share, default=None)


def _fit_of_session(arm: Arm, frame: pd.DataFrame) -> TrialFit | None:
    have = frame[frame["x_mm"].notna()]
    names = joint_columns(have.columns)
    if len(names) != len(arm.joint_names):
        return None
    points, moving = have[POSITION].to_numpy() * MM, np.ones(len(have), dtype=bool)
    targets = have["target"].to_numpy()
    for name in _fixed_to_ground(have, None):
        moving &= targets != name
    if moving.sum() < 6:
        return None
    joints = have[names].to_numpy()[moving] * joint_units(names)
    number, pose = np.unique(joints, axis=0, return_inverse=True)
    return trial_fit(arm, number, pose.ravel(), pd.factorize(targets[moving])[0], points[moving])


def still_targets(frame: pd.DataFrame) -> list[str]:
    """Targets that do not move while others do: nine points of ten of a session lie within `STILL` of their median."""
    return _fixed_to_ground(frame, STILL)


def _fixed_to_ground(frame: pd.DataFrame, limit: float | None) -> list[str]:
    """As `still_targets`; without a limit, as the unit of length is open, those that hardly move beside the others."""
    reach: dict[str, float] = {}
    session = frame["session"] if "session" in frame.columns else pd.Series("", index=frame.index)
    for (name, _), group in frame.groupby(["target", session], sort=False):
        xyz = group[POSITION].to_numpy() * MM
        xyz = xyz[np.isfinite(xyz).all(axis=1)]
        if len(xyz) >= 3:
            farthest = float(np.quantile(np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1), 0.9))
            reach[str(name)] = max(reach.get(str(name), 0.0), farthest)
    largest = max(reach.values(), default=0.0)
    limit = 0.01 * largest if limit is None else limit
    return [name for name, distance in reach.items() if distance <= limit] if largest > 100 * limit / 2 else []
