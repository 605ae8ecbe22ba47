"""What stands in calibration.json is what was identified."""

import numpy as np
import pytest
from support import TARGETS

import irbcal
from irbcal.files import urdf_check


def test_three_ways_to_predict_agree(outcome, folder):
    """From the fit, from the loaded folder, and from the written URDF in Pinocchio plus the joint map."""
    loaded = irbcal.load(folder)
    q = outcome.urdf.arm.random_joints(500, 3)
    robot = loaded.robot_calibrated()
    theta = robot.joint_map.effective(q)
    T = urdf_check.poses((folder / "calibrated.urdf").read_bytes(), loaded.arm(), theta)
    for name in TARGETS:
        from_fit = outcome.fit.robot.points(q, name)
        base = np.einsum("nij,j->ni", T[:, :3, :3], robot.targets[name]) + T[:, :3, 3]
        from_pinocchio = base @ robot.T_world_base[:3, :3].T + robot.T_world_base[:3, 3]
        assert np.abs(robot.points(q, name) - from_fit).max() < 1e-9
        assert np.abs(from_pinocchio - from_fit).max() < 1e-9


def test_statistics_are_those_of_the_held_out_poses(outcome, folder):
    loaded = irbcal.load(folder)
    robot, points = loaded.robot_calibrated(), outcome.heldout_points
    distance = [
        np.linalg.norm(xyz - robot.points(q[None], name)[0])
        for q, xyz, name in zip(points.joints(), points.xyz, points.names(), strict=True)
    ]
    assert loaded.heldout.all.mean_mm == pytest.approx(np.mean(distance) * 1e3, abs=1e-9)
    assert loaded.heldout.all.max_mm == pytest.approx(np.max(distance) * 1e3, abs=1e-9)
    assert loaded.poses_fit + loaded.poses_heldout == 60
    assert set(outcome.fit_points.pose_ids).isdisjoint(points.pose_ids)


def test_every_parameter_is_listed_with_state_and_unit(folder):
    loaded = irbcal.load(folder)
    names = [p.name for p in loaded.parameters]
    assert len(names) == len(set(names))
    for expected in ("base_x", "target_smr3_z", "delta_alpha4", "stiffness_delta_L", "fourier_b2"):
        assert expected in names
    for p in loaded.parameters:
        assert (p.std is None) == (p.state != "identified")
        assert bool(p.reason) or p.state == "identified"
    assert loaded.parameter_count == 43
