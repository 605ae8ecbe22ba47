"""What counts as a pose: matrices against their own products."""

import numpy as np
import pytest
from support import arm, random_rotation

from irbcal.errors import RobotError
from irbcal.modeling.inverse import any_arm, calibrated_arm, closed_form
from irbcal.modeling.inverse.poses import check_poses, has_last_row, is_rotation, pose_columns
from irbcal.modeling.inverse.result import Reason
from irbcal.modeling.robot import Robot


def test_rotations_are_told_from_other_matrices():
    rng = np.random.default_rng(3)
    T = np.tile(np.eye(4), (8, 1, 1))
    T[:, :3, :3] = [random_rotation(rng) for _ in T]
    T[1, 0, 2] += 1e-4
    T[2, :3, :3] *= 1.001
    T[3, :3, 0] *= -1.0  # a mirror
    T[4, 1, 1] = np.nan
    T[5, :3, :3] = np.diag([np.sqrt(3.0), 0.0, 0.0])
    T[6, 0, 2] += 1e-9
    rotations = np.where(np.isnan(T[:, :3, :3]), 0.0, T[:, :3, :3])
    good = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) < 1e-6
    good &= np.linalg.det(rotations) > 0
    assert is_rotation(pose_columns(T).reshape(12, -1)).tolist() == good.tolist()
    assert good.tolist() == [True, False, False, False, False, False, True, True]


def test_other_shapes_are_refused():
    with pytest.raises(RobotError, match=r"poses need shape \(n, 4, 4\), found \(4, 4\)"):
        check_poses(np.eye(4))


def test_the_last_row_is_that_of_a_rigid_transform():
    T = np.tile(np.eye(4), (7, 1, 1))
    for k, row in enumerate([(0, 0, 0, 2), (0.5, -0.5, 0, 1), (5, -4, 0, 0), (np.nan, 0, 0, 1), (0, 0, np.inf, 1)]):
        T[k, 3] = row
    T[5, 3, 0] = 1e-9
    assert has_last_row(T).tolist() == [False] * 5 + [True, True]
    nominal = arm()
    T = np.tile(nominal.forward(np.full((1, 6), 0.3)), (7, 1, 1))
    T[:, 3] = np.eye(4)[3]
    T[:2, 3] = (9, -8, 0, 0), (0, 0, 0, np.nan)
    assert closed_form.branches(nominal, T).valid.any(axis=1).tolist() == [False] * 2 + [True] * 5
    for found in (
        calibrated_arm.solve(Robot(nominal), nominal, T),
        any_arm.solve(Robot(nominal), nominal, T, np.full(6, 0.2)),
    ):
        assert (found.reason[:2] == Reason.NOT_A_POSE).all()
        assert found.converged[2:].all()
