"""A tracker that was moved, or that drifts, is named; good runs are not accused."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.measurement.moved import moved, moved_notes


def fitted(points):
    robot = identify(arm(), points, "26").robot
    return robot, points.xyz - points.predicted(robot)


def simulated(seed, poses=60):
    """A robot with all errors of level 34, of which level 26 leaves some: residuals that depend on the pose."""
    rng = np.random.default_rng(seed)
    return measured(random_robot(arm(), "34", rng), arm().random_joints(poses, seed), 5e-5, rng)


def said(points):
    robot, residuals = fitted(points)
    return moved(points, residuals, robot.T_world_base[:3, :3])


@pytest.mark.parametrize("seed", range(8))
def test_good_runs_are_not_accused(seed):
    assert said(simulated(seed)) is None


@pytest.mark.parametrize("shift", [(2e-3, 0.0, 0.0), (0.0, -5e-3, 0.0), (0.0, 0.0, 8e-3)])
def test_a_jump_is_named_with_its_pose_and_size(shift):
    points = simulated(1)
    robot, _ = fitted(points)
    late = points.pose >= 37
    found = said(replace(points, xyz=points.xyz + late[:, None] * np.array(shift)))
    assert found.kind == "jump"
    assert abs(list(points.pose_ids).index(int(found.pose)) - 37) <= 2
    np.testing.assert_allclose(found.shift, shift, rtol=0, atol=0.3 * np.linalg.norm(shift))
    np.testing.assert_allclose(found.shift_base, robot.T_world_base[:3, :3].T @ found.shift, rtol=0, atol=1e-4)
    assert found.rms_with < 0.85 * found.rms_without


def test_a_drift_is_named_with_its_size():
    points = simulated(2)
    found = said(replace(points, xyz=points.xyz + np.outer(points.pose / 59, [0.0, 4e-3, 0.0])))
    assert found.kind == "drift"
    np.testing.assert_allclose(found.shift, [0.0, 4e-3, 0.0], rtol=0, atol=6e-4)


def test_a_turn_alone_is_found():
    points = simulated(3)
    middle = points.xyz.mean(axis=0)
    turned = np.cross([0.0, 0.0, 4e-3], points.xyz - middle) * (points.pose >= 30)[:, None]
    found = said(replace(points, xyz=points.xyz + turned))
    assert found.kind == "jump"
    assert found.turn == pytest.approx(4e-3, rel=0.2)


def test_few_poses_tell_nothing():
    points = simulated(4, 19)
    assert moved(points, np.random.default_rng(0).normal(0, 1e-3, points.xyz.shape), np.eye(3)) is None


def test_sessions_are_looked_at_one_by_one():
    """Between sessions everything may move; within one it must not."""
    points = simulated(5, 80)
    robot, _ = fitted(points)
    session = np.where(np.arange(80) < 40, "a", "b").astype(object)
    apart = replace(points, xyz=points.xyz + (points.pose >= 40)[:, None] * [5e-3, 0.0, 0.0])
    assert len(moved_notes(apart, robot)) == 1
    assert moved_notes(replace(apart, session=session), robot) == []
    jump = replace(apart, xyz=apart.xyz + (points.pose >= 60)[:, None] * [0.0, 5e-3, 0.0], session=session)
    (note,) = moved_notes(jump, robot)
    assert "farther by about" in note
    assert "most of it along y of the measuring frame" in note


@pytest.mark.parametrize("seed", range(6))
def test_repeats_in_a_row_are_one_pose(seed):
    """Eight places, each measured ten times: every change of the place is a jump of the residuals, and no more."""
    rng = np.random.default_rng(seed)
    q = np.repeat(arm().random_joints(8, seed), 10, axis=0)
    assert said(measured(random_robot(arm(), "34", rng), q, 5e-5, rng)) is None
    q = np.repeat(arm().random_joints(24, seed), 10, axis=0)
    assert said(measured(random_robot(arm(), "34", rng), q, 5e-5, rng)) is None
