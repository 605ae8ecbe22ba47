"""Which poses a fit has seen: the same joints up to small moves and full turns, whatever was measured there."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.measurement import fitted
from irbcal.units import DEG, MM

REVOLUTE = np.zeros(6, dtype=bool)


def simulated(n=30):
    nominal = arm()
    rng = np.random.default_rng(4)
    return measured(random_robot(nominal, "34", rng), nominal.random_joints(n, 3), 3e-5, rng)


def turned(points):
    q = points.q.copy()
    q[:, 5] += 2.0 * np.pi
    q[::2, 3] -= 2.0 * np.pi
    return replace(points, q=q)


@pytest.mark.parametrize(
    "again",
    [
        lambda p, rng: replace(p, xyz=np.round(p.xyz, 5), q=np.round(p.q, 8)),
        lambda p, rng: replace(p, xyz=p.xyz + rng.normal(0.0, 1e-3, p.xyz.shape)),
        lambda p, rng: replace(p, q=p.q + rng.uniform(-1.99, 1.99, p.q.shape) * DEG),
        lambda p, rng: turned(p),
    ],
    ids=["rounded", "measured anew", "moved by less than two degrees", "full turns"],
)
def test_fitted_poses_stay_fitted(again):
    points = simulated()
    fit = points.select(np.arange(points.poses) < 10)
    found = fitted.poses_of(again(points, np.random.default_rng(1)), fit, REVOLUTE)
    np.testing.assert_array_equal(found, np.arange(points.poses) < 10)


def test_one_joint_more_than_two_degrees_away_is_another_pose():
    points = simulated()
    q = points.q.copy()
    q[:, 4] += 2.01 * DEG
    assert not fitted.poses_of(replace(points, q=q), points, REVOLUTE).any()


def test_prismatic_joints_have_no_turns():
    points = simulated(5)
    slides = REVOLUTE | (np.arange(6) == 5)
    for shift, same in ((2.0 * np.pi, False), (19.0 * MM, True), (21.0 * MM, False)):
        q = points.q.copy()
        q[:, 5] += shift
        assert (fitted.poses_of(replace(points, q=q), points, slides) == same).all()


def test_other_arms_and_empty_sets_have_nothing_in_common():
    points = simulated(5)
    none = points.select(np.zeros(5, dtype=bool))
    assert not fitted.poses_of(points, none, REVOLUTE).any()
    assert len(fitted.poses_of(none, points, REVOLUTE)) == 0
    seven = replace(points, q=np.column_stack([points.q, points.q[:, 0]]))
    assert not fitted.poses_of(points, seven, np.zeros(7, dtype=bool)).any()


@pytest.mark.parametrize(("known", "expected"), [((0.0, 5.0), [True, True, False, True]), (None, [True] * 4)])
def test_a_load_that_was_never_fitted(known, expected):
    points = replace(simulated(4), payload_kg=np.array([0.0, 5.05, 12.0, np.nan]))
    fit = simulated(2)
    fit = fit if known is None else replace(fit, payload_kg=np.array(known))
    np.testing.assert_array_equal(fitted.with_fitted_load(points, fit), expected)
