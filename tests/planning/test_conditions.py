"""Conditions of poses: each pose checked again by other means."""

import numpy as np
import pytest
from planning_support import PLACE, TARGETS, Wall, recheck, setting
from support import arm

from irbcal.errors import MeasurementError
from irbcal.io import urdf_check
from irbcal.io.robots import robot_file
from irbcal.modeling import home
from irbcal.modeling.robot import Robot
from irbcal.planning import conditions
from irbcal.planning.conditions import Setting, Targets


def test_check_keeps_all_poses_that_meet_the_conditions():
    q = home.rounded(arm(), arm().random_joints(4000, 9))
    keep, seen = conditions.check(setting(tuple(conditions.CONDITIONS)), q)
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), q)
    points = TARGETS.places @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    looks = TARGETS.directions @ np.swapaxes(T[:, :3, :3], 1, 2)
    beam = PLACE - points
    cosine = np.sum(beam * looks, axis=-1) / np.linalg.norm(beam, axis=-1)
    in_sight = (np.degrees(np.arccos(cosine)) <= 30.0) & (points[..., 1] >= 0)
    good, _ = recheck(q, in_sight)
    assert (keep == good).all()
    assert (seen[keep] == in_sight[keep]).all()
    assert not seen[~keep].any()
    assert keep.sum() > 20


def test_conditions_can_be_switched_off_and_are_off_where_nothing_is_known():
    assert setting(()).conditions == ()
    assert setting(("sight", "limits")).conditions == ("limits", "sight")  # in the order of checking
    blind = Targets(TARGETS.names, TARGETS.places)
    free = Setting(Robot(arm()), blind, PLACE, tuple(conditions.CONDITIONS), solids=Wall())
    assert free.conditions == ("limits", "collision", "sight", "way")
    q = arm().random_joints(500, 0)
    assert conditions.check(setting(()), q)[0].all()
    with pytest.raises(MeasurementError, match="unknown condition 'luck': conditions are limits, height, acceptance"):
        setting(("luck",))
    with pytest.raises(MeasurementError, match="need the robot's collision geometry"):
        setting(("sight",), solids=None)
