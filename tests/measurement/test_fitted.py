"""Which poses a fit has seen: rows of it, and the same joints measured anew."""

from dataclasses import replace

import numpy as np
from support import arm, measured, random_robot

from irbcal.measurement import fitted


def simulated(n=30):
    nominal = arm()
    rng = np.random.default_rng(4)
    return measured(random_robot(nominal, "34", rng), nominal.random_joints(n, 3), 3e-5, rng)


def test_rows_of_the_fit_are_found_in_any_order_and_rounded():
    points = simulated()
    mask = np.arange(points.poses) % 3 == 0
    fit = points.select(mask)
    written = replace(points, xyz=np.round(points.xyz, 7), q=np.round(points.q, 8))
    np.testing.assert_array_equal(fitted.rows_of(written, fit), mask)
    back = np.arange(points.poses)[::-1]
    turned = replace(written, q=written.q[back], pose=back[written.pose][::-1], target=points.target[::-1],
                     xyz=written.xyz[::-1])  # fmt: skip
    np.testing.assert_array_equal(fitted.rows_of(turned, fit), mask[back])


def test_the_same_joints_measured_anew_are_places_not_rows():
    points = simulated()
    fit = points.select(np.arange(points.poses) < 10)
    noise = np.random.default_rng(1).normal(0.0, 3e-5, points.xyz.shape)
    anew = replace(points, xyz=points.xyz + noise)
    assert not fitted.rows_of(anew, fit).any()
    np.testing.assert_array_equal(fitted.places_of(anew, fit), np.arange(points.poses) < 10)


def test_other_arms_and_empty_sets_have_nothing_in_common():
    points = simulated(5)
    none = points.select(np.zeros(5, dtype=bool))
    assert not fitted.rows_of(points, none).any()
    assert len(fitted.rows_of(none, points)) == 0
    seven = replace(points, q=np.column_stack([points.q, points.q[:, 0]]))
    assert not fitted.rows_of(points, seven).any()
    assert not fitted.places_of(points, seven).any()
