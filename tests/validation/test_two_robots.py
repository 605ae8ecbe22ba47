"""Poses of two robots or two tools: told apart, and none where one robot was measured."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.measurement.change_points import PoseSums
from irbcal.modeling.parameters import default_level
from irbcal.validation.two_robots import PoseEquations, contradicting_parts, mixed_poses, predicted, separate_halves


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
    assert np.allclose(np.diagonal(H.sum(axis=0)), 1.0, rtol=0, atol=1e-9), "each unknown in its own size"
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


def test_parts_of_other_joints_are_not_compared():
    """A program that moves one joint after the other has parts that differ, whatever the robot."""
    robot = random_robot(arm(), "34", np.random.default_rng(3))
    q = np.zeros((90, 6))
    for k in range(6):
        q[15 * k : 15 * k + 15, k] = np.linspace(-0.8, 0.8, 15)
    points = measured(robot, q + 0.1, 5e-5, np.random.default_rng(3))
    assert contradicting_parts(PoseEquations(arm(), points)) == []


def points_of_mixed(second, poses=60, noise=1e-4, seed=0, difference=1.0):
    """Poses of one robot, those of ``second`` (a mask) of another that errs otherwise."""
    nominal, rng = arm("irb1600"), np.random.default_rng(seed)
    one, other = (random_robot(nominal, "34", np.random.default_rng(k), size=difference) for k in (seed, seed + 50))
    other = other.replace(T_world_base=one.T_world_base, targets=one.targets)
    q = nominal.random_joints(poses, seed)
    seen, strange = (measured(robot, q, noise, rng) for robot in (one, other))
    seen.xyz.setflags(write=True)
    mine = second[seen.pose]
    seen.xyz[mine] = strange.xyz[mine]
    return seen


@pytest.mark.parametrize("share", [0.5, 0.2])
def test_two_robots_are_told_apart(share):
    second = np.random.default_rng(3).permutation(60) < 60 * share
    seen = points_of_mixed(second)
    (words,) = mixed_poses(PoseEquations(arm("irb1600"), seen))
    assert words.startswith(f"{int(second.sum())} of 60 poses (")
    names = words.partition("(")[2].partition(" …")[0].split(", ")
    assert names == [str(seen.pose_ids[k]) for k in np.flatnonzero(second)[:8]] or share == 0.5


@pytest.mark.parametrize("seed", range(3))
def test_one_robot_is_one(seed):
    assert mixed_poses(PoseEquations(arm("irb1600"), points_of_mixed(np.zeros(60, dtype=bool), seed=seed))) == []


def test_few_strange_poses_are_outliers_and_too_few_poses_tell_nothing():
    assert mixed_poses(PoseEquations(arm("irb1600"), points_of_mixed(np.arange(60) < 2))) == []
    assert mixed_poses(PoseEquations(arm("irb1600"), points_of_mixed(np.arange(30) % 2 == 1, poses=30))) == []


def test_neighbours_of_one_kind_are_a_model_that_is_too_small():
    """An error that depends on where the arm is parts poses as well; it is no second robot."""
    nominal = arm("irb1600")
    seen = points_of_mixed(np.zeros(80, dtype=bool), poses=80)
    seen.xyz.setflags(write=True)
    seen.xyz[:, 2] += np.where(seen.q[seen.pose, 0] > 0, 1e-3, -1e-3)
    assert mixed_poses(PoseEquations(nominal, seen)) == []


def test_two_lines_are_told_apart():
    """One unknown, slopes 1 and -1, by hand: every pose goes to its own, and nothing is left."""
    x = np.linspace(1.0, 2.0, 40)
    slope = np.where(np.arange(40) % 2 == 1, -1.0, 1.0)
    found = separate_halves(PoseSums((x**2)[:, None, None], (x * slope * x)[:, None], (slope * x) ** 2))
    assert found.rss_split < 1e-6 * found.rss_single
    assert found.clear_share == 1.0
    assert len(set(found.second[1::2])) == 1
    assert found.second[0] != found.second[1]


@pytest.mark.parametrize("seed", [1, 4])
def test_clean_data_of_one_robot_are_of_one_robot(seed):
    """Sixty poses of a robot with other errors than the model's are told apart well, but that predicts no pose."""
    nominal, rng = arm("irb1600"), np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng)
    equations = PoseEquations(nominal, measured(robot, nominal.random_joints(60, seed), 2e-5, rng))
    found = separate_halves(equations.sums)
    assert found.rss_split < 0.25 * found.rss_single
    assert found.clear_share > 0.9
    assert predicted(equations.sums, found.second) < 0.9
    assert mixed_poses(equations) == []
