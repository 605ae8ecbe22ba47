"""Conditions of poses: each pose checked again by other means."""

import numpy as np
import pytest
from planning_support import PLACE, TARGETS, Wall, recheck, setting
from support import arm

from irbcal.errors import MeasurementError
from irbcal.io import urdf_check
from irbcal.io.robots import robot_file
from irbcal.modeling import commanded_joints
from irbcal.modeling.robot import Robot
from irbcal.planning import conditions
from irbcal.planning.conditions import SOLID, Setting, Targets
from irbcal.planning.plan_options import PlanOptions
from irbcal.planning.scene import open_scene
from irbcal.units import MM


def test_reflectors_from_a_file_with_and_without_directions(tmp_path):
    (tmp_path / "plain.csv").write_text("target,x_mm,y_mm,z_mm\na,10,20,30\nb,-40,0,50\n")
    plain = open_scene(PlanOptions("irb1600", targets=tmp_path / "plain.csv", ignore=SOLID))
    assert "acceptance" not in plain.setting.conditions
    assert any("directions are not known: the condition acceptance is off" in note for note in plain.tracker_notes)
    assert plain.setting.targets.positions.tolist() == pytest.approx(np.array([[10, 20, 30], [-40, 0, 50]]) * MM)
    (tmp_path / "full.csv").write_text("target,x_mm,y_mm,z_mm,nx,ny,nz\na,10,20,30,0,0,2\nb,-40,0,50,3,0,4\n")
    full = open_scene(PlanOptions("irb1600", targets=tmp_path / "full.csv", ignore=SOLID))
    assert full.setting.conditions == ("limits", "height", "acceptance")
    assert full.setting.targets.directions.tolist() == pytest.approx(np.array([[0, 0, 1], [0.6, 0, 0.8]]))
    for text, message in (
        ("target,x_mm,y_mm,z_mm,nx,ny\na,1,2,3,0,0\n", "row 1: missing column nz"),
        ("target,x_mm,y_mm,z_mm,nx,ny,nz\na,1,2,3,0,0,0\n", "row 2, columns nx, ny, nz: expected a direction"),
        (
            "target,x_mm,y_mm,z_mm,nx,ny,nz\na,1,2,3,0,q,0\n",
            "row 2, column ny: expected a part of a direction, found 'q'",
        ),
    ):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(MeasurementError, match=message):
            open_scene(PlanOptions("irb1600", targets=tmp_path / "bad.csv", ignore=SOLID))


def test_check_keeps_all_poses_that_meet_the_conditions():
    q = commanded_joints.rounded(arm(), arm().random_joints(4000, 9))
    keep, seen = conditions.check(setting(tuple(conditions.CONDITIONS)), q)
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), q)
    points = TARGETS.positions @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
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
    blind = Targets(TARGETS.names, TARGETS.positions)
    free = Setting(Robot(arm()), blind, PLACE, tuple(conditions.CONDITIONS), solids=Wall())
    assert free.conditions == ("limits", "collision", "sight", "path")
    q = arm().random_joints(500, 0)
    assert conditions.check(setting(()), q)[0].all()
    with pytest.raises(MeasurementError, match="unknown condition 'luck': conditions are limits, height, acceptance"):
        setting(("luck",))
    with pytest.raises(MeasurementError, match="need the robot's collision geometry"):
        setting(("sight",), solids=None)
