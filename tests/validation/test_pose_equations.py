"""What each pose says of all unknowns: against the fit itself."""

import numpy as np
from support import arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.modeling.parameters import default_level
from irbcal.validation.doubts import PoseEquations


def some(poses=50):
    nominal, rng = arm("irb1600"), np.random.default_rng(1)
    return nominal, measured(random_robot(nominal, "34", rng), nominal.random_joints(poses, 1), 1e-4, rng)


def test_they_are_those_of_the_fit():
    nominal, points = some()
    found = PoseEquations(nominal, points)
    fit = identify(nominal, points, default_level(nominal))
    H, g, yy = found.sums
    assert abs(yy.sum() / len(points) - fit.rms**2) < 1e-12
    one_pose = np.abs(g).max()
    assert np.abs(g.sum(axis=0)).max() < 1e-3 * one_pose, "at the best fit the poses pull against one another"
    assert np.allclose(H, H.transpose(0, 2, 1), atol=1e-12)
    assert np.allclose(np.diagonal(H.sum(axis=0)), 1.0), "each unknown in its own size"
    assert H.shape[1] == found.sums.unknowns
    assert found.sums is found.sums, "fitted once"


def test_evenly_chosen_poses():
    nominal, points = some()
    found = PoseEquations(nominal, points)
    assert found.of_most(50) is found
    few = found.of_most(11)
    assert few.points.pose_ids.tolist() == points.pose_ids[[0, 4, 9, 14, 19, 24, 29, 34, 39, 44, 49]].tolist()


def test_too_few_poses_tell_nothing():
    nominal, points = some(50)
    assert PoseEquations(nominal, points.select(np.arange(50) < 1)).sums is None
