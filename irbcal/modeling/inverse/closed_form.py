"""Inverse kinematics of ortho-parallel arms with a spherical wrist: all branches, limits and choices.

`branches` gives the up to eight branches of each pose (Nubiola 2011, section 6.1; the arms that qualify are described
in `irbcal.modeling.inverse.orthoparallel`, the branches in `irbcal.modeling.inverse.branches`). Joints are then brought
into the limits by whole turns (`into_limits`), and one branch is chosen: the `nearest` to given joints, or one
`with_configuration`. The inverse of a calibrated robot is in `irbcal.modeling.inverse.calibrated_arm`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse.branches import Branches
from irbcal.modeling.inverse.orthoparallel import TAU, OrthoParallel

LIMIT_TOLERANCE = 1e-9
"""Radians by which rounding may put a joint beyond its limit."""
ALIGNED = 1e-10
"""Angle between axes 4 and 6, radians, up to which they are one axis: `nearest` leaves joint 4 where it is."""

BRANCH_NAMES = tuple(f"{s} {e} {w}" for s in ("front", "back") for e in ("up", "down") for w in ("no-flip", "flip"))
"""Names of the branches 0 to 7."""


def branches(arm: Arm, T_base_tip: ArrayLike) -> Branches:
    """All branches of the inverse kinematics of an ortho-parallel arm (Nubiola 2011, section 6.1).

    Parameters
    ----------
    arm : Arm
    T_base_tip : array_like, shape (n, 4, 4)

    Raises
    ------
    RobotError
        If the arm's DHM table has no closed form; the message says which entry does not fit.
    """
    return OrthoParallel.from_arm(arm).branches(T_base_tip)


def into_limits(
    arm: Arm, joints: ArrayLike, near: ArrayLike | None = None, slack: float = LIMIT_TOLERANCE
) -> tuple[FloatArray, BoolArray]:
    """Shift revolute joints by whole turns into the limits.

    Parameters
    ----------
    arm : Arm
    joints : array_like, shape (..., joints)
        Radians (metres for prismatic joints).
    near : array_like, shape (..., joints), optional
        Where several turns lie within the limits, the one nearest to these joints is taken; zero unless given.
    slack : float
        Radians (metres) beyond a limit that still count as within it.

    Returns
    -------
    joints : ndarray, shape (..., joints)
        Joints that no whole turn brings inside are at the turn nearest to ``near``.
    inside : ndarray of bool, shape (...)
        Whether all are within the limits, but for the slack; False for NaN.
    """
    joints = np.asarray(joints, dtype=float)
    lower, upper = arm.lower - slack, arm.upper + slack
    turns, fits = whole_turns(lower, upper, joints, 0.0 if near is None else np.asarray(near, dtype=float))
    slides = arm.table.prismatic
    if slides.any():
        turns[..., slides] = 0.0
        travel = joints[..., slides]
        fits[..., slides] = (travel >= lower[slides]) & (travel <= upper[slides])
    return joints + TAU * turns, np.asarray(fits.all(axis=-1))


def whole_turns(
    lower: FloatArray, upper: FloatArray, joints: FloatArray, near: FloatArray | float
) -> tuple[FloatArray, BoolArray]:
    """Whole turns that bring joints within limits, nearest to ``near``, and whether there are any (else the nearest).

    All radians, of shapes that go together.
    """
    first = np.ceil((lower - joints) * (1.0 / TAU))
    last = np.floor((upper - joints) * (1.0 / TAU))
    turns = np.rint((near - joints) * (1.0 / TAU))
    fits = np.asarray(first <= last)
    return np.where(fits, np.minimum(np.maximum(turns, first), last), turns), fits


def has_closed_form(arm: Arm) -> bool:
    """Whether `branches` takes this arm."""
    try:
        OrthoParallel.from_arm(arm)
    except RobotError:
        return False
    return True


def nearest(arm: Arm, branches: Branches, near: ArrayLike, limits: bool = True) -> tuple[FloatArray, IntArray]:
    """The branch nearest to given joints, and the turns nearest to them.

    At the wrist singularity, where only the sum (or difference) of joints 4 and 6 is determined, joint 4 stays
    where it is near (Nubiola 2011, section 6.1.5, sets it to zero).

    Parameters
    ----------
    arm : Arm
    branches : Branches
        Of n poses.
    near : array_like, shape (n, 6) or (6,)
        Radians.
    limits : bool
        Regard only branches within the joint limits, in turns within them; else the nearest turn, wherever it is.

    Returns
    -------
    joints : ndarray, shape (n, 6)
        Least Euclidean distance from ``near``; NaN where no branch is left.
    branch : ndarray of int, shape (n,)
        -1 where no branch is left.
    """
    around = np.broadcast_to(np.asarray(near, dtype=float), (len(branches.joints), 6))
    around = np.ascontiguousarray(around.T).T[:, None, :]  # in memory as the branches are
    joints = branches.joints
    singular = branches.valid & (branches.wrist <= ALIGNED)
    if singular.any():
        joints = joints.copy()
        closed = branches.arm
        rows = joints[singular]
        turn = np.broadcast_to(around, joints.shape)[singular][:, 3] - rows[:, 3]
        # axes 4 and 6 along one another at q5 = 0, against one another at 180 degrees
        along = np.where(np.cos(closed.angle(rows, 4)) > 0, 1.0, -1.0) * closed.signs[3] * closed.signs[5]
        rows[:, 3] += turn
        rows[:, 5] -= along * turn
        joints[singular] = rows
    if limits:
        joints, inside = into_limits(arm, joints, around)
        usable = branches.valid & inside
    else:
        joints, usable = joints + TAU * np.rint((around - joints) / TAU), branches.valid
    distance = np.where(usable, ((joints - around) ** 2).sum(axis=-1), np.inf)
    best = np.argmin(distance, axis=1)
    reachable = np.isfinite(distance[np.arange(len(best)), best])
    chosen = joints[np.arange(len(best)), best]
    return np.where(reachable[:, None], chosen, np.nan), np.where(reachable, best, -1)


def with_configuration(
    arm: Arm, branches: Branches, configuration: ArrayLike, near: ArrayLike | None = None
) -> tuple[FloatArray, BoolArray]:
    """The branch of a given configuration, shifted by whole turns into the limits.

    Parameters
    ----------
    arm : Arm
    branches : Branches
        Of n poses.
    configuration : array_like of int, shape () or (n,)
        Branch numbers (see `branch_number`).
    near : array_like, shape (n, 6) or (6,), optional
        As for `into_limits`.

    Returns
    -------
    joints : ndarray, shape (n, 6)
        NaN where the branch does not reach the pose.
    inside : ndarray of bool, shape (n,)
        Whether there is a solution within the joint limits.
    """
    branch = check_configuration(configuration, len(branches.joints))
    return into_limits(arm, branches.joints[np.arange(len(branch)), branch], near)


def check_configuration(configuration: ArrayLike, n: int) -> IntArray:
    """Branch numbers for n poses from one or n of them; refuse anything else."""
    branch = np.asarray(configuration)
    if branch.shape not in ((), (n,)) or branch.dtype.kind not in "iu":
        raise RobotError(
            f"configurations need to be branch numbers, one or {n}, found shape {branch.shape}",
            parameter="configuration",
        )
    if branch.size and not (branch.min() >= 0 and branch.max() <= 7):
        raise RobotError(
            f"branch numbers go from 0 to 7, found {branch.min()} to {branch.max()}", parameter="configuration"
        )
    return np.broadcast_to(branch, (n,))


def configuration(arm: Arm, joints: ArrayLike) -> IntArray:
    """Branch that joint angles lie in, 0 to 7: `OrthoParallel.configuration` of an arm, joints (..., 6) radians."""
    return OrthoParallel.from_arm(arm).configuration(joints)
