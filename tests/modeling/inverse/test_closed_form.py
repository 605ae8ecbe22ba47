from dataclasses import replace

import numpy as np
import pytest
from inverse_cases import assert_all_branches_reach
from support import arm, assert_same_poses

from irbcal.errors import RobotError
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.inverse.branches import branch_number

ROBOTS = ("irb1600", "irb120")


def test_shapes_are_refused():
    with pytest.raises(RobotError, match=r"found \(4, 4\)"):
        closed_form.branches(arm(), np.eye(4))
    branches = closed_form.branches(arm(), arm().forward(np.zeros((3, 6))))
    for wrong in (8, -1, [0, 1], 0.5, [0, 1, 9]):
        with pytest.raises(RobotError, match="branch numbers"):
            closed_form.with_configuration(arm(), branches, wrong)


def test_no_poses():
    branches = closed_form.branches(arm(), np.empty((0, 4, 4)))
    assert branches.joints.shape == (0, 8, 6)
    assert closed_form.nearest(arm(), branches, np.zeros(6))[0].shape == (0, 6)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("q5", [0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-6, 1e-4, np.pi, np.pi - 1e-10])
def test_wrist_singularity(name, q5):
    nominal = arm(name)
    q = nominal.random_joints(500, 4)
    q[:, 4] = q5
    T = nominal.forward(q)
    branches = closed_form.branches(nominal, T)
    assert_all_branches_reach(nominal, branches, T)
    row, branch = np.arange(len(q)), closed_form.configuration(nominal, q)
    assert branches.singular(wrist=1e-3)["wrist"][row, branch].all()
    assert np.abs(branches.wrist[row, branch] - min(abs(q5), np.pi - q5)).max() < 1e-11
    if q5 == 0.0:
        # joint 4 stays where it is near, joint 6 takes the rest
        near = q + 0.01 * np.random.default_rng(0).uniform(-1, 1, q.shape)
        joints, _ = closed_form.nearest(nominal, branches, near, limits=False)
        assert np.abs(joints[:, 3] - near[:, 3]).max() < 1e-9
        assert np.abs(joints - near).max() < 0.05
        assert_same_poses(nominal.forward(joints), T, 1e-11, 1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_without_limits_the_nearest_turn_is_wherever_it_is(name):
    nominal = arm(name)
    q = nominal.random_joints(300, 4)
    beyond = q + 2 * np.pi * np.array([1, 0, 0, -1, 0, 2])
    branches = closed_form.branches(nominal, nominal.forward(q))
    joints, _ = closed_form.nearest(nominal, branches, beyond, limits=False)
    assert np.abs(joints - beyond).max() < 1e-9
    inside, _ = closed_form.nearest(nominal, branches, beyond)
    assert (inside >= nominal.lower - 1e-9).all()
    assert (inside <= nominal.upper + 1e-9).all()


def test_unreachable_and_bad_poses_do_not_harm_their_neighbours():
    nominal = arm()
    q = nominal.random_joints(20_000, 7)
    T = nominal.forward(q)
    good = closed_form.branches(nominal, T)
    bad = T.copy()
    bad[0, 0, 3] = 5.0
    bad[1, 1, 1] = np.nan
    bad[2, 2, 3] = np.inf
    bad[3, :3, :3] *= 1.01
    bad[4, :3, 0] *= -1.0
    bad[5] = 0.0
    bad[6, 3, 0] = np.nan
    bad[8191, :3, 3] = np.nan
    bad[8192, 2, 3] = 1e300
    broken = [0, 1, 2, 3, 4, 5, 6, 8191, 8192]
    found = closed_form.branches(nominal, bad)
    assert not found.valid[broken].any()
    assert np.isnan(found.joints[broken]).all()
    assert found.reach_margin[0].max() < -3.0
    others = np.delete(np.arange(len(T)), broken)
    assert np.array_equal(found.joints[others], good.joints[others], equal_nan=True)
    joints, branch = closed_form.nearest(nominal, found, q)
    assert (branch[broken] == -1).all()
    assert np.isnan(joints[broken]).all()
    assert not closed_form.with_configuration(nominal, found, 0)[1][broken].any()


def test_whole_turns():
    nominal = arm()
    q = np.radians([10.0, 20.0, 170.0, 190.0, 30.0, 350.0])
    reduced = np.angle(np.exp(1j * q))
    joints, inside = closed_form.into_limits(nominal, reduced[None])
    assert inside.all()
    # joint 3 reaches from -245 to 65 degrees; joints 4 and 6 stay near zero
    assert np.degrees(joints[0]) == pytest.approx([10, 20, -190, -170, 30, -10])
    joints, inside = closed_form.into_limits(nominal, reduced[None], near=q)
    assert inside.all()
    assert np.degrees(joints[0]) == pytest.approx([10, 20, -190, 190, 30, 350])
    joints, inside = closed_form.into_limits(nominal, np.radians([0, -100, 0, 0, 0, 0]))
    assert not inside
    assert np.degrees(joints[1]) == pytest.approx(-100)
    assert closed_form.into_limits(nominal, nominal.upper + 1e-12)[1]
    assert not closed_form.into_limits(nominal, np.full(6, np.nan))[1]
    free = replace(nominal, lower=np.full(6, -np.inf), upper=np.full(6, np.inf))
    joints, inside = closed_form.into_limits(free, np.zeros(6), near=np.full(6, 30.0))
    assert inside
    assert joints == pytest.approx(np.full(6, 10 * np.pi))


@pytest.mark.parametrize("name", ROBOTS)
def test_choice_of_a_branch(name):
    nominal = arm(name)
    rng = np.random.default_rng(8)
    q = nominal.random_joints(5_000, 8)
    branches = closed_form.branches(nominal, nominal.forward(q))
    branch = closed_form.configuration(nominal, q)
    row = np.arange(len(q))
    clear = (branches.wrist[row, branch] > 0.1) & (branches.shoulder > 0.05) & (branches.elbow[row, branch] > 0.01)
    joints, chosen = closed_form.nearest(nominal, branches, q + rng.uniform(-0.01, 0.01, q.shape))
    assert (chosen == branch)[clear].all()
    inner = clear & (np.abs(q) < np.minimum(nominal.upper, -nominal.lower)).all(axis=1)
    assert np.abs(joints - q)[inner].max() < 1e-9
    joints, inside = closed_form.with_configuration(nominal, branches, branch, near=q)
    assert inside[clear].all()
    assert np.abs(joints - q)[clear].max() < 1e-9
    for number, words in enumerate(closed_form.BRANCH_NAMES):
        joints, inside = closed_form.with_configuration(nominal, branches, number)
        assert inside.any()
        assert not (inside & ~branches.valid[:, number]).any()
        assert branch_number("back" in words, "down" in words, " flip" in words) == number
        assert (joints[inside] >= nominal.lower - 1e-8).all()
        assert (joints[inside] <= nominal.upper + 1e-8).all()


def test_configurations_at_known_joints():
    # stretched out to the front with a bent elbow; the arm thrown over; the elbow bent the other way; the wrist turned
    q = np.radians([[0, 0, 0, 0, 30, 0], [0, -80, -120, 0, 30, 0], [0, 60, -150, 0, 30, 0], [0, 0, 0, 180, -30, 0]])
    names = [closed_form.BRANCH_NAMES[k] for k in closed_form.configuration(arm(), q)]
    assert names == ["front up no-flip", "back down no-flip", "front down no-flip", "front up flip"]
