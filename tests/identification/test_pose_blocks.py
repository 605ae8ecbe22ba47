"""Blocks of poses: every point stands in one place, at the frame of its own pose."""

import dataclasses

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.identification import initial_guess, problem
from irbcal.identification.problem import Problem
from irbcal.modeling import parameters
from irbcal.modeling.thesis_map import fourier_terms, stiffness_terms

POSES = 11
PHASES = np.array([0.3, 1.2])
KINDS = {"stiffness", "fourier"}


@pytest.fixture
def points():
    nominal = arm()
    return measured(random_robot(nominal, "34", np.random.default_rng(0)), nominal.random_joints(POSES, 1))


def some(points, keep):
    rows = {name: getattr(points, name)[keep] for name in ("pose", "target", "xyz")}
    return dataclasses.replace(points, **rows)


def oriented(points, share):
    turned = np.random.default_rng(1).random(len(points)) < share
    rotation = np.where(turned[:, None, None], np.eye(3), np.nan)
    return dataclasses.replace(points, rotation=rotation)


def cut(points, session=None):
    session = np.zeros(len(points), dtype=int) if session is None else session
    return problem.cut(points, points.oriented(), session, PHASES, KINDS)


def assert_every_point_at_home(points, blocks):
    m, turned = len(points), np.flatnonzero(points.oriented())
    rows = np.concatenate([block.rows for block in blocks])
    assert sorted(rows.tolist()) == list(range(m + len(turned)))
    for block in blocks:
        t, f = block.target.shape
        own, angles = block.rows[: t * f], block.rows[t * f :] - m
        q = np.tile(block.q[block.frames], (t, 1))
        np.testing.assert_array_equal(q, points.q[points.pose[own]])
        np.testing.assert_array_equal(block.target.ravel(), points.target[own])
        np.testing.assert_array_equal(block.xyz.T, points.xyz[own])
        np.testing.assert_array_equal(turned[angles], own[block.turned])
        np.testing.assert_array_equal(block.stiffness, np.asarray(stiffness_terms(q[:f], PHASES)))
        np.testing.assert_array_equal(block.fourier, fourier_terms(q[:f]))


@pytest.mark.parametrize("size", [2048, 4, 1])
@pytest.mark.parametrize(
    "kind", ["all", "one target", "some missing", "one missing", "no pose 4", "oriented", "some oriented"]
)
def test_every_point_stands_once_and_at_its_own_pose(points, kind, size, monkeypatch):
    monkeypatch.setattr(problem, "BLOCK", size)
    everywhere = np.arange(len(points))
    points = {
        "all": lambda: points,
        "one target": lambda: some(points, points.target == 1),
        "some missing": lambda: some(points, np.random.default_rng(2).random(len(points)) < 0.6),
        "one missing": lambda: some(points, everywhere != 7),
        "no pose 4": lambda: some(points, points.pose != 4),
        "oriented": lambda: oriented(points, 1.0),
        "some oriented": lambda: oriented(points, 0.3),
    }[kind]()
    blocks = cut(points)
    assert max(len(block.q) for block in blocks) <= size
    assert_every_point_at_home(points, blocks)


def test_frames_are_shared_where_poses_have_as_many_points(points):
    (block,) = cut(points)
    assert block.target.shape == (3, POSES)
    # one target each: which one may change from pose to pose
    (block,) = cut(some(points, points.target == points.pose % 3))
    assert block.target.shape == (1, POSES)
    assert set(block.target.ravel()) == {0, 1, 2}
    # as many points as three each would be, but one pose has a second measurement of a target, another lacks one
    order = np.sort(np.r_[np.delete(np.arange(len(points)), 4), 30])
    most, others = cut(some(points, order))
    assert most.target.shape == (3, POSES - 2)
    assert others.target.shape == (1, 6)
    assert_every_point_at_home(some(points, order), [most, others])
    # where hardly two poses are alike nothing is shared
    few = some(points, points.target <= points.pose % 5)
    (block,) = cut(some(few, few.pose < 3))
    assert block.target.shape == (1, 6)


def test_no_points(points):
    assert cut(some(points, points.pose < 0)) == []


def test_sessions_go_with_the_rows(points):
    session = (points.pose >= 5).astype(int)
    for some_points in (points, oriented(points, 0.4)):
        (block,) = cut(some_points, session)
        at = np.concatenate([np.arange(len(points)), np.flatnonzero(some_points.oriented())])
        np.testing.assert_array_equal(block.session, session[at[block.rows]])


def test_shared_frames_give_the_residuals_and_derivatives_of_frames_at_every_point(points):
    """With an orientation at a single point frames are taken at every point: its rows but for that one are the same."""
    chosen = parameters.level_parameters("34")
    alone = np.zeros(len(points), dtype=bool)
    alone[4] = True
    rotation = np.where(alone[:, None, None], np.eye(3), np.nan)
    shared, each = (Problem(arm(), p, chosen) for p in (points, dataclasses.replace(points, rotation=rotation)))
    state = dataclasses.replace(
        initial_guess.closed_form(shared)[0], errors=1e-3 * np.random.default_rng(3).standard_normal(len(chosen))
    )
    np.testing.assert_allclose(shared.residuals(state), each.residuals(state)[: len(points)], rtol=0, atol=1e-14)
    outer = [*range(shared.others), *range(each.others, each.unknowns)]
    J = each.jacobian(state)[: 3 * len(points), outer]
    np.testing.assert_allclose(shared.jacobian(state), J, rtol=0, atol=1e-13)
