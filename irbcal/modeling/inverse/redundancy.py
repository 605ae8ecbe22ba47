"""What an arm with more joints than a pose needs does with the rest: away from the limits, or near to given joints.

The joints that reach a pose make a curve (or more than that). Along it a criterion is brought to its least by Newton's
steps in the null space of the Jacobian, each made good by steps back to the pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm, closed_form, newton
from irbcal.modeling.inverse.poses import pose_columns
from irbcal.modeling.inverse.result import InverseResult
from irbcal.modeling.robot import Robot

CRITERIA = ("limits", "near")
MOST_STEPS = 40
LONGEST = 0.3
"""Radians (or metres) that a step may move a joint."""
SETTLED = 1e-9
STARTS = 6
TOLERANCE = 1e-10
"""Metres and radians."""

CriterionAt = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""From joints (n, joints) to values (n,), slopes (n, joints) and curvatures (n, joints): a sum over the joints."""


def criterion(name: str, arm: Arm, near: FloatArray) -> CriterionAt:
    """A criterion by its name.

    Parameters
    ----------
    name : str
        ``limits``: the sum of ``u^2 + u^8``, with u = 1 at a joint's limits and 0 in the middle; ``near``: the sum of
        squares of the distances from ``near``, in shares of the ranges.
    arm : Arm
        Whose limits hold; a joint without has a range of two turns (2 m).
    near : ndarray, shape (joints,)
    """
    free = np.where(arm.table.prismatic, 1.0, 2.0 * np.pi)
    lower = np.where(np.isfinite(arm.lower), arm.lower, -free)
    upper = np.where(np.isfinite(arm.upper), arm.upper, free)
    half = 0.5 * np.maximum(upper - lower, 1e-6)
    middle, power = (0.5 * (lower + upper), 1.0) if name == "limits" else (near, 0.0)

    def value(q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        u = (q - middle) / half
        slope = (2.0 * u + power * 8.0 * u**7) / half
        return (u**2 + power * u**8).sum(axis=1), slope, (2.0 + power * 56.0 * u**6) / half**2

    return value


def null_step(J: FloatArray, slope: FloatArray, curvature: FloatArray) -> FloatArray:
    """Newton's step of a criterion that does not move the tip, (n, joints), for Jacobians (n, 6, joints)."""
    joints = J.shape[2]
    Z = np.linalg.svd(J)[2][:, 6:].swapaxes(1, 2) if joints > 6 else np.zeros((len(J), joints, 0))
    if not Z.shape[2]:
        return np.zeros(slope.shape)
    H = np.einsum("njk,nj,njl->nkl", Z, curvature, Z)
    step = -np.linalg.solve(H, np.einsum("njk,nj->nk", Z, slope)[..., None])
    step = (Z @ step)[..., 0]
    largest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * (LONGEST / np.maximum(largest, LONGEST)), dtype=float)


def settled(
    chain: newton.CalibratedChain,
    H: FloatArray,
    q: FloatArray,
    criterion_at: CriterionAt,
    tolerance: tuple[float, float],
) -> FloatArray:
    """Joints that reach the same poses with the least of a criterion, downhill from where they are.

    Parameters
    ----------
    chain : CalibratedChain
    H : ndarray, shape (4, 3, n)
        Columns of the poses, as `irbcal.modeling.inverse.poses.pose_columns` makes them.
    q : ndarray, shape (n, joints)
        Joints that reach them.
    criterion_at : callable
        See `criterion`.
    tolerance : tuple of float
        Errors of position and rotation, metres and radians, that are good enough.

    Returns
    -------
    ndarray, shape (n, joints)
        No worse than ``q`` by the criterion.
    """
    q = np.array(q)
    share = np.ones(len(q))
    todo = np.arange(len(q))
    for _ in range(MOST_STEPS):
        if not len(todo):
            break
        value, slope, curvature = criterion_at(q[todo])
        step = null_step(chain.linearised(H[..., todo], q[todo].T)[0], slope, curvature) * share[todo][:, None]
        new, *errors, _ = newton.solve(chain, H[..., todo], (q[todo] + step).T.copy(), tolerance)
        better = (errors[0] <= tolerance[0]) & (errors[1] <= tolerance[1]) & (criterion_at(new.T)[0] < value)
        q[todo[better]] = new.T[better]
        share[todo] = np.where(better, np.minimum(1.0, 2.0 * share[todo]), 0.25 * share[todo])
        todo = todo[(np.abs(step).max(axis=1) > SETTLED) & (share[todo] > 1e-3)]
    return q


def solve(robot: Robot, nominal: Arm, T_base_tip: ArrayLike, near: FloatArray, name: str) -> InverseResult:
    """Commanded joints that reach poses with the least of a criterion.

    From `STARTS` solutions of each pose, those next to ``near`` and to random joints, the best is taken.

    Parameters
    ----------
    robot : Robot
    nominal : Arm
        Whose limits hold.
    T_base_tip : array_like, shape (n, 4, 4)
    near : ndarray, shape (joints,)
        Radians (metres for prismatic joints).
    name : str
        One of `CRITERIA`.
    """
    result = any_arm.solve(robot, nominal, T_base_tip, near)
    chain, criterion_at = newton.CalibratedChain(robot, any_arm.reach(nominal)), criterion(name, nominal, near)
    q = np.array(result.joints)
    H = pose_columns(np.asarray(T_base_tip, dtype=float))
    rows = np.flatnonzero(result.converged)
    if not len(rows):
        return result

    def good(position: FloatArray, rotation: FloatArray) -> BoolArray:
        return (position <= TOLERANCE) & (rotation <= TOLERANCE)

    repeated = np.tile(rows, 1 + STARTS)
    starts = np.repeat(nominal.random_joints(STARTS, 1), len(rows), axis=0)
    new, *errors, _ = newton.solve(
        chain, H[..., repeated], np.vstack([q[rows], starts]).T.copy(), (TOLERANCE, TOLERANCE)
    )
    candidates = closed_form.into_limits(
        nominal, np.ascontiguousarray(new.T), np.broadcast_to(near, (len(repeated), len(near)))
    )[0]
    converged = good(*errors) & good(*newton.errors(chain.tip(candidates.T), H[..., repeated]))
    candidates[converged] = settled(
        chain, H[..., repeated[converged]], candidates[converged], criterion_at, (TOLERANCE, TOLERANCE)
    )
    inside = converged & ((candidates >= nominal.lower) & (candidates <= nominal.upper)).all(axis=1)
    cost = np.where(
        inside, criterion_at(candidates)[0], np.where(converged, 1e6 + criterion_at(candidates)[0], np.inf)
    ).reshape(1 + STARTS, -1)
    best = cost.argmin(axis=0) * len(rows) + np.arange(len(rows))
    take = np.isfinite(cost.min(axis=0))
    q[rows[take]] = candidates[best[take]]
    within = np.array(result.inside)
    within[rows[take]] = inside[best[take]]
    left_there = newton.errors(chain.tip(q[rows].T), H[..., rows])
    position, rotation = np.array(result.position_residual), np.array(result.rotation_residual)
    position[rows], rotation[rows] = left_there
    return replace(result, joints=q, inside=within, position_residual=position, rotation_residual=rotation)
