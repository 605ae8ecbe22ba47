"""Calibrated robots for tests of the inverse, and what a solution has to be."""

import numpy as np
from support import arm, assert_same_poses, random_robot

from irbcal.modeling.inverse.result import Method, Reason


def largest_error(nominal, robot):
    q = nominal.random_joints(1000, 0)
    return np.linalg.norm((robot.poses(q) - nominal.forward(q))[:, :3, 3], axis=1).max()


def like_table_6_1(name, millimetres, seed=0):
    """A level-34 robot whose nominal errors reach about so many millimetres."""
    nominal = arm(name)
    size = 0.1
    for _ in range(4):
        robot = random_robot(nominal, "34", np.random.default_rng(seed), size)
        size *= millimetres * 1e-3 / largest_error(nominal, robot)
    return nominal, robot


def assert_all_branches_reach(nominal, branches, T):
    for k in range(8):
        valid = branches.valid[:, k]
        assert np.isfinite(branches.joints[valid, k]).all()
        if valid.any():
            assert_same_poses(nominal.forward(branches.joints[valid, k]), T[valid], 1e-11, 1e-11)
    assert np.isnan(branches.joints[~branches.valid]).all()


def assert_solved(robot, result, T, rows=slice(None), tolerance=1e-9):
    assert result.converged[rows].all()
    assert_same_poses(robot.poses(result.joints[rows]), T[rows], tolerance, tolerance)
    assert (result.reason[rows] == Reason.CONVERGED).all()
    assert (result.method[rows] != Method.NONE).all()
