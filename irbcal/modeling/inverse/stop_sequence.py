"""Commands of a sequence of stops: each depends on the command of the stop before, which is a correction itself."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, group_means
from irbcal.errors import RobotError
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms.situation import at_rows
from irbcal.units import DEG, MM

STILL = {True: 0.2 * MM, False: 0.2 * DEG}
"""Moves of all joints, prismatic or not, that are too short to change the side to which they lean."""

LOOK_BACK = 100
"""Stops among which one far enough away is looked for."""

MOST_STEPS = 200
CONVERGED, GOOD_ENOUGH = 3e-14, 1e-11


def stops_before(theta: FloatArray, target: IntArray, follows: BoolArray, prismatic: BoolArray) -> IntArray:
    """The stop from which each stop of a sequence is approached.

    Where the one before lies next to it, the last one that does not is taken: the arm still leans to the side it came
    from.

    Parameters
    ----------
    theta : ndarray, shape (n, joints)
        Joints of each target, radians (metres for prismatic joints).
    target : ndarray of int, shape (m,)
        Target of each stop, in the order of the program; -1 where it is not known.
    follows : ndarray of bool, shape (m,)
        Whether a stop is known to follow the one above it.
    prismatic : ndarray of bool, shape (joints,)

    Returns
    -------
    ndarray of int, shape (m,)
        Targets, -1 where they are not known.
    """
    out = np.full(len(target), -1)
    still = np.array([STILL[bool(slides)] for slides in prismatic])
    waiting = np.flatnonzero(target >= 0)
    for step in range(1, LOOK_BACK + 1):
        waiting = waiting[waiting >= step]
        waiting = waiting[follows[waiting - step + 1] & (target[waiting - step] >= 0)]
        if not len(waiting):
            break
        earlier = target[waiting - step]
        far = (np.abs(theta[target[waiting]] - theta[earlier]) >= still).any(axis=1)
        out[waiting[far]] = earlier[far]
        waiting = waiting[~far]
    return out


def commanded_in_order(
    joint_map: JointMap,
    theta: FloatArray,
    target: IntArray,
    before: IntArray,
    fixed: BoolArray | None = None,
    inputs: Mapping[str, FloatArray] | None = None,
) -> FloatArray:
    """Commanded joints that give effective ones at stops that follow one another.

    ``q <- theta - f(q, q - q_before)`` with the commands of the stops before of the last sweep, for the whole sequence
    at a time: a contraction by about one tenth a sweep.

    Parameters
    ----------
    joint_map : JointMap
    theta : ndarray, shape (n, joints)
        Effective joints of n targets, radians (metres for prismatic joints).
    target, before : ndarray of int, shape (m,)
        Which target each of m stops goes to, and from which one; -1 where that is not known. A target with several
        stops gets the command in the middle: minus the mean of what its last moves do.
    fixed : ndarray of bool, shape (n,), optional
        Targets whose commands are not to be found: ``theta`` holds them.
    inputs : dict of str to ndarray, optional
        Inputs of the joint map's terms at each target, where they are not the usual ones.

    Returns
    -------
    ndarray, shape (n, joints)
        Targets without stops are taken with unknown last moves.

    Raises
    ------
    RobotError
        If the map is so far from the identity that the iteration does not converge.
    """
    q = joint_map.commanded_unchecked(theta)
    if fixed is not None:
        q[fixed] = theta[fixed]
    if not (joint_map.has_history or inputs) or not len(theta):
        return q
    idle = np.setdiff1d(np.arange(len(theta)), target)
    target, before = np.concatenate([target, idle]), np.concatenate([before, np.full(len(idle), -1)])
    change = np.inf
    for _ in range(MOST_STEPS):
        previous = np.where(before[:, None] >= 0, q[before], np.nan)
        reached = joint_map.effective_unchecked(q[target], previous, **at_rows(inputs or {}, target)) - q[target]
        new = theta - group_means(reached, target, len(theta))
        if fixed is not None:
            new[fixed] = theta[fixed]
        change, q = np.abs(new - q).max(), new
        if change < CONVERGED:
            break
    if not change < GOOD_ENOUGH:
        raise RobotError(f"the joint map cannot be inverted in order: {change:.3g} rad left after {MOST_STEPS} sweeps")
    return q
