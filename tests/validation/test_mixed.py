"""Poses of two robots in one file: told apart where there are two, and never where there is one."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.validation.doubts import PoseEquations, mixed_poses, predicted, told_apart


def points(second, poses=60, noise=1e-4, seed=0, difference=1.0):
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
    seen = points(second)
    (words,) = mixed_poses(PoseEquations(arm("irb1600"), seen))
    assert words.startswith(f"{int(second.sum())} of 60 poses (")
    names = words.partition("(")[2].partition(" …")[0].split(", ")
    assert names == [str(seen.pose_ids[k]) for k in np.flatnonzero(second)[:8]] or share == 0.5


@pytest.mark.parametrize("seed", range(3))
def test_one_robot_is_one(seed):
    assert mixed_poses(PoseEquations(arm("irb1600"), points(np.zeros(60, dtype=bool), seed=seed))) == []


def test_few_strange_poses_are_gross_errors_and_too_few_poses_tell_nothing():
    assert mixed_poses(PoseEquations(arm("irb1600"), points(np.arange(60) < 2))) == []
    assert mixed_poses(PoseEquations(arm("irb1600"), points(np.arange(30) % 2 == 1, poses=30))) == []


def test_neighbours_of_one_kind_are_a_model_that_is_too_small():
    """An error that depends on where the arm is parts poses as well; it is no second robot."""
    nominal = arm("irb1600")
    seen = points(np.zeros(80, dtype=bool), poses=80)
    seen.xyz.setflags(write=True)
    seen.xyz[:, 2] += np.where(seen.q[seen.pose, 0] > 0, 1e-3, -1e-3)
    assert mixed_poses(PoseEquations(nominal, seen)) == []


def test_two_lines_are_told_apart():
    """One unknown, slopes 1 and -1, by hand: every pose goes to its own, and nothing is left."""
    x = np.linspace(1.0, 2.0, 40)
    slope = np.where(np.arange(40) % 2 == 1, -1.0, 1.0)
    found = told_apart((x**2)[:, None, None], (x * slope * x)[:, None], (slope * x) ** 2)
    assert found.two < 1e-6 * found.one
    assert found.sure == 1.0
    assert len(set(found.second[1::2])) == 1
    assert found.second[0] != found.second[1]


@pytest.mark.parametrize("seed", [1, 4, 5])
def test_clean_data_of_one_robot_are_of_one_robot(seed):
    """Sixty poses of a robot with other errors than the model's are told apart well, but that predicts no pose."""
    nominal, rng = arm("irb1600"), np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng)
    equations = PoseEquations(nominal, measured(robot, nominal.random_joints(60, seed), 2e-5, rng))
    found = told_apart(*equations.sums)
    assert found.two < 0.25 * found.one
    assert found.sure > 0.9
    assert predicted(*equations.sums, found.second) < 0.9
    assert mixed_poses(equations) == []
