"""Branches of an arm that is nearly one with a closed form.

Such are a controller's own model beside the nominal arm, and a nominal arm with a small offset more. The closed
form's branches are the start, Newton's steps on the other arm make them exact; each stays the branch it was.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm, closed_form
from irbcal.modeling.inverse.branches import Branches
from irbcal.modeling.inverse.orthoparallel import OrthoParallel
from irbcal.modeling.robot import Robot

LARGEST_CHANGE = 0.2
"""Radians by which a joint of a branch may differ between the two arms; more is another solution."""

NEARLY = 0.05
"""Metres and radians by which an arm may differ from one with a closed form and take its branches as starts."""


def nearest_form(arm: Arm) -> OrthoParallel | None:
    """The closed form of an arm, or that of the nearest arm that has one; None where none is near."""
    with suppress(RobotError):
        return OrthoParallel.from_arm(arm) if closed_form.has_closed_form(arm) else OrthoParallel.from_arm(arm, NEARLY)
    return None


def branches(nominal: Arm, T_base_tip: FloatArray, controller_arm: Arm | None = None) -> Branches:
    """All branches of poses.

    Parameters
    ----------
    nominal : Arm
        With a closed form, or nearly so (`nearest_form`).
    T_base_tip : ndarray, shape (n, 4, 4)
    controller_arm : Arm, optional
        The arm whose joints are wanted, near to the nominal one; that itself unless given.

    Raises
    ------
    RobotError
        If no closed form is near the nominal arm.
    """
    form = nearest_form(nominal) or OrthoParallel.from_arm(nominal)
    nominal_branches = form.branches(T_base_tip)
    if controller_arm is None and closed_form.has_closed_form(nominal):
        return nominal_branches
    joints = np.full(nominal_branches.joints.shape, np.nan)
    row, branch = np.nonzero(nominal_branches.valid)
    if len(row):
        start = nominal_branches.joints[row, branch]
        solved = any_arm.solve(
            Robot(controller_arm or nominal), _endless(nominal), T_base_tip[row], seed=start, thorough=False
        )
        good = solved.converged & (np.abs(solved.joints - start).max(axis=1) <= LARGEST_CHANGE)
        joints[row[good], branch[good]] = solved.joints[good]
    return replace(nominal_branches, joints=joints, valid=nominal_branches.valid & np.isfinite(joints).all(axis=-1))


def _endless(arm: Arm) -> Arm:
    """The same arm without joint limits: which turn is meant is decided later."""
    wide = np.full(len(arm.lower), np.inf)
    return replace(arm, lower=-wide, upper=wide)
