"""Branches of an arm that is nearly one with a closed form: a controller's own model beside the nominal arm.

The nominal arm's branches are the start, Newton's steps on the other arm make them exact; each stays the branch it was.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm, closed_form
from irbcal.modeling.inverse.branches import Branches
from irbcal.modeling.robot import Robot

LARGEST_CHANGE = 0.2
"""Radians by which a joint of a branch may differ between the two arms; more is another solution."""


def branches(nominal: Arm, T_base_tip: FloatArray, own: Arm | None = None) -> Branches:
    """All branches of poses.

    Parameters
    ----------
    nominal : Arm
        With a closed form.
    T_base_tip : ndarray, shape (n, 4, 4)
    own : Arm, optional
        The arm whose joints are wanted, near to the nominal one; that itself unless given.

    Returns
    -------
    Branches

    Raises
    ------
    RobotError
        If the nominal arm has no closed form.
    """
    found = closed_form.branches(nominal, T_base_tip)
    if own is None:
        return found
    joints = np.full(found.joints.shape, np.nan)
    row, branch = np.nonzero(found.valid)
    if len(row):
        start = found.joints[row, branch]
        solved = any_arm.solve(Robot(own), _endless(nominal), T_base_tip[row], seed=start, thorough=False)
        good = solved.converged & (np.abs(solved.joints - start).max(axis=1) <= LARGEST_CHANGE)
        joints[row[good], branch[good]] = solved.joints[good]
    return replace(found, joints=joints, valid=found.valid & np.isfinite(joints).all(axis=-1))


def _endless(arm: Arm) -> Arm:
    """The same arm without joint limits: which turn is meant is decided later."""
    wide = np.full(len(arm.lower), np.inf)
    return replace(arm, lower=-wide, upper=wide)
