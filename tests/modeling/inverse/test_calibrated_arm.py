from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from inverse_cases import assert_solved, like_table_6_1
from support import arm, assert_same_poses, random_robot, with_thesis

from irbcal.errors import RobotError
from irbcal.modeling.inverse import calibrated_arm, closed_form
from irbcal.modeling.inverse.result import Method, Reason
from irbcal.modeling.robot import Robot

MANY = 20_000


@pytest.mark.parametrize("millimetres", [1.2, 2.4, 3.9])
@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_no_pose_is_lost(name, millimetres):
    nominal, robot = like_table_6_1(name, millimetres)
    q = nominal.random_joints(MANY, 1)
    T, branch = robot.poses(q), closed_form.configuration(nominal, q)
    result = calibrated_arm.solve(robot, nominal, T, configuration=branch)
    # two singularities at once may remain: they are flagged, never wrong
    flagged = ~result.converged
    assert flagged.sum() <= 1
    assert np.isnan(result.joints[flagged]).all()
    assert (result.reason[flagged] >= Reason.OUT_OF_REACH).all()
    assert_solved(robot, result, T, ~flagged)
    # a solution in another branch, or beyond a limit, is only taken next to a singularity
    assert result.branch_kept.sum() >= MANY - 3
    assert result.inside.sum() >= MANY - 5
    fixed = result.method == Method.FIXED_POINT
    assert fixed.mean() > 0.94
    assert np.median(result.iterations) <= 6
    assert result.branch_kept[fixed].all()
    assert result.position_residual[~flagged].max() <= 1e-10
    assert result.rotation_residual[~flagged].max() <= 1e-10


def test_joints_away_from_singularities_are_those_that_made_the_pose():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q = nominal.random_joints(5_000, 2)
    T, branch = robot.poses(q), closed_form.configuration(nominal, q)
    branches = closed_form.branches(nominal, T)
    row = np.arange(len(q))
    clear = (branches.wrist[row, branch] > 0.1) & (branches.shoulder > 0.1) & (branches.elbow[row, branch] > 0.01)
    seeded = calibrated_arm.solve(robot, nominal, T, seed=q + np.random.default_rng(0).uniform(-0.02, 0.02, q.shape))
    assert np.abs(seeded.joints - q)[clear].max() < 1e-8
    assert (seeded.configuration == branch)[clear].all()
    # without a seed the turns may differ, and only they
    free = calibrated_arm.solve(robot, nominal, T, configuration=branch)
    turns = (free.joints - q)[clear] / (2 * np.pi)
    assert np.abs(turns - np.rint(turns)).max() < 1e-8
    assert free.inside[clear].all()


def test_a_solution_next_to_the_seed_ends_the_search():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q, rng = nominal.random_joints(4_000, 5), np.random.default_rng(0)
    q[::2, 4] = rng.uniform(-1e-3, 1e-3, len(q) // 2)  # the wrist singular
    q[1::4] = np.clip(q[1::4], nominal.lower + 0.01, nominal.upper - 0.01)
    T = robot.poses(q)
    result = calibrated_arm.solve(robot, nominal, T, seed=q + rng.uniform(-0.01, 0.01, q.shape))
    assert_solved(robot, result, T)
    assert result.inside.all()
    assert (result.iterations > 300).sum() <= 4  # a search from many starts takes 700 and more


def test_every_branch_of_one_pose():
    nominal, robot = like_table_6_1("irb120", 2.4)
    q = np.radians([[20.0, 10.0, -20.0, 30.0, 40.0, 50.0]])
    T = np.repeat(robot.poses(q), 8, axis=0)
    result = calibrated_arm.solve(robot, nominal, T, configuration=np.arange(8))
    assert_solved(robot, result, T)
    assert (result.configuration == np.arange(8)).all()


def test_turns_are_kept_with_joint_gains():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    robot = robot.replace(joint_map=with_thesis(robot.joint_map, gain=np.full(6, 2e-3)))
    q = np.radians([[10.0, 20.0, -30.0, 20.0, 40.0, 30.0], [10.0, 20.0, -30.0, 20.0, 40.0, -330.0]])
    T = robot.poses(q)
    assert np.abs(T[0] - T[1]).max() > 1e-3
    result = calibrated_arm.solve(robot, nominal, T, seed=q)
    assert_solved(robot, result, T)
    assert np.abs(result.joints - q).max() < 1e-9


@pytest.mark.parametrize("q5", [0.0, 1e-12, 1e-6, 1e-4, 1e-3])
def test_wrist_singularity_changes_over_to_newton(q5):
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q = nominal.random_joints(300, 3)
    q[:, 4] = q5
    T = robot.poses(q)
    result = calibrated_arm.solve(robot, nominal, T, configuration=closed_form.configuration(nominal, q))
    assert_solved(robot, result, T, result.converged)
    assert result.converged.sum() >= 299
    if q5 < 1e-3:
        assert (result.method == Method.NEWTON).mean() > 0.5


def test_stretched_arm_beyond_the_nominal_reach():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q = nominal.random_joints(300, 4)
    q[:, 2], q[:, 4] = -np.pi / 2, 1.0
    longer = robot.replace(arm=nominal.with_table(replace(robot.table, d=robot.table.d + [0, 0, 0, 2e-3, 0, 0])))  # noqa: RUF005
    T = longer.poses(q)
    branch = closed_form.configuration(nominal, q)
    margin = closed_form.branches(nominal, T).reach_margin[np.arange(300), branch // 4]
    assert (margin < 0).mean() > 0.9
    result = calibrated_arm.solve(longer, nominal, T, configuration=branch)
    assert_solved(longer, result, T)
    assert (result.method == Method.NEWTON).all()
    # the shorter robot cannot get there, and says so
    result = calibrated_arm.solve(robot, nominal, T, configuration=branch)
    assert (result.reason[~result.converged] == Reason.OUT_OF_REACH).all()
    assert (~result.converged).mean() > 0.9
    assert 1e-4 < np.median(result.position_residual) < 5e-3


def test_reasons():
    nominal, robot = like_table_6_1("irb1600", 1.2)
    q = nominal.random_joints(9_000, 5)
    T, seed = robot.poses(q), q.copy()
    T[0, 0, 0] = np.nan
    T[1, :3, 3] = 10.0
    T[2, :3, :3] *= 1.1
    T[8192, :3, 3] = 1e300
    T[8193, 1, 3] = np.inf
    seed[3] = np.nan
    result = calibrated_arm.solve(robot, nominal, T, seed=seed)
    broken = [0, 1, 2, 3, 8192, 8193]
    assert [Reason(k) for k in result.reason[broken]] == [
        Reason.NOT_A_POSE,
        Reason.OUT_OF_REACH,
        Reason.NOT_A_POSE,
        Reason.BAD_SEED,
        Reason.OUT_OF_REACH,
        Reason.NOT_A_POSE,
    ]
    assert not result.converged[broken].any()
    assert not result.inside[broken].any()
    assert np.isnan(result.joints[broken]).all()
    assert (result.method[broken] == Method.NONE).all()
    assert (result.configuration[broken] == -1).all()
    assert result.position_residual[1] > 10.0
    others = np.delete(np.arange(len(q)), broken)
    assert_solved(robot, result, T, others[result.converged[others]])
    assert result.converged[others].sum() >= len(others) - 1
    assert len({reason.in_words for reason in Reason}) == len(Reason)
    assert "2 where the target is out of the robot's reach" in result.summary()
    assert "9000 poses" in result.summary()


def test_result_of_a_pose_does_not_depend_on_its_neighbours():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q = nominal.random_joints(300, 3)
    q[:100, 4] = 1e-5
    T, branch = robot.poses(q), closed_form.configuration(nominal, q)
    together = calibrated_arm.solve(robot, nominal, T, configuration=branch)
    for part in (slice(0, 7), slice(95, 300)):
        alone = calibrated_arm.solve(robot, nominal, T[part], configuration=branch[part])
        assert (alone.converged == together.converged[part]).all()
        assert_same_poses(robot.poses(alone.joints), robot.poses(together.joints[part]), 3e-10, 3e-10)


def test_poses_of_which_none_can_be_used():
    nominal, robot = like_table_6_1("irb1600", 1.2)
    T = np.full((3, 4, 4), np.nan)
    result = calibrated_arm.solve(robot, nominal, T)
    assert (result.reason == Reason.NOT_A_POSE).all()
    assert (result.iterations == 0).all()
    assert np.isnan(result.joints).all()
    calibrated_arm.solve(robot, nominal, nominal.forward(np.zeros((3, 6))), seed=np.full(6, np.nan))


@pytest.mark.parametrize("by", ["kernel", "numpy"])
@pytest.mark.parametrize("end", ["lower", "upper"])
def test_joints_at_their_limits_are_within_them(end, by, monkeypatch):
    nominal, robot = like_table_6_1("irb1600", 2.4)
    if by == "numpy":
        monkeypatch.setattr(calibrated_arm, "kernel_of", lambda robot, nominal: None)
    q = nominal.random_joints(12, 3)
    q[np.arange(12), np.arange(12) % 6] = np.resize(getattr(nominal, end), 12)
    result = calibrated_arm.solve(robot, nominal, robot.poses(q), seed=q)
    assert np.abs(result.joints - q).max() < 1e-8
    assert result.inside.all()


def test_limits_of_many_turns():
    """Joints of many turns are found; as seeds they would look like degrees."""
    nominal, robot = like_table_6_1("irb1600", 2.4)
    wide = replace(nominal, lower=np.full(6, -40.0), upper=np.full(6, 40.0))
    q = nominal.random_joints(200, 11)
    q[:, 4] = 1e-6
    T, branch = robot.poses(q), closed_form.configuration(nominal, q)
    assert_solved(robot, calibrated_arm.solve(robot, wide, T, configuration=branch), T)


def test_shapes_are_refused():
    nominal, robot = like_table_6_1("irb1600", 1.2)
    T = nominal.forward(np.zeros((3, 6)))
    for bad in ({"seed": np.zeros((2, 6))}, {"seed": np.zeros((3, 5))}, {"configuration": 9}, {"configuration": [0]}):
        with pytest.raises(RobotError):
            calibrated_arm.solve(robot, nominal, T, **bad)
    with pytest.raises(RobotError, match=r"shape \(n, 4, 4\)"):
        calibrated_arm.solve(robot, nominal, T[0])
    crooked = nominal.with_table(replace(nominal.table, alpha=nominal.table.alpha + 0.1))
    with pytest.raises(RobotError, match="alpha2"):
        calibrated_arm.solve(robot, crooked, T)
    assert len(calibrated_arm.solve(robot, nominal, np.empty((0, 4, 4)))) == 0


def test_identity_needs_one_iteration():
    nominal = arm()
    q = nominal.random_joints(1000, 6)
    T = nominal.forward(q)
    result = calibrated_arm.solve(Robot(nominal), nominal, T, seed=q)
    assert_solved(Robot(nominal), result, T)
    assert (result.iterations == 1).mean() > 0.99


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6),
    st.sampled_from(["irb1600", "irb120"]),
    st.integers(0, 2**20),
    st.floats(0.0, 0.5),
)
def test_any_pose_of_any_robot(part, name, seed, size):
    nominal = arm(name)
    robot = random_robot(nominal, "34b", np.random.default_rng(seed), size)
    q = nominal.lower + (nominal.upper - nominal.lower) * np.array(part)[None]
    T, branch = robot.poses(q), closed_form.configuration(nominal, q)
    closed = closed_form.branches(nominal, nominal.forward(q))
    assume(not any(mask[0, branch[0]] for mask in closed.singular(0.01, 0.01, 0.005).values()))
    result = calibrated_arm.solve(robot, nominal, T, configuration=branch)
    assert_solved(robot, result, T)
    assert result.branch_kept.all()
