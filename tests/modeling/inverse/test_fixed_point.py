"""The fixed point: products and sums, poses that are done, and the thesis's table of it."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inverse_cases import assert_solved, like_table_6_1
from support import arm

from irbcal.modeling import frames
from irbcal.modeling.inverse import calibrated_arm, closed_form, fixed_point
from irbcal.modeling.inverse.result import Method
from irbcal.modeling.robot import Robot

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("seeded", [False, True])
def test_poses_that_are_done_stay_as_they_are(monkeypatch, seeded):
    """Whether they are taken out at once or go along until the others are done, when some of them stalled."""
    nominal, robot = like_table_6_1("irb120", 3.9)
    q = nominal.random_joints(4_000, 8)
    T = robot.poses(q)
    branch = {"seed": q} if seeded else {"configuration": closed_form.configuration(nominal, q)}
    found = []
    for most in (0.0, 1.0):
        monkeypatch.setattr(fixed_point, "MOST", most)
        found.append(calibrated_arm.solve(robot, nominal, T, **branch, thorough=False))
    along, out = found
    assert 10 < (out.method == Method.NEWTON).sum() < 1_000
    assert (along.method == out.method).all()
    assert (along.iterations == out.iterations).mean() > 0.999
    assert np.nanmax(np.abs(along.joints - out.joints)) < 1e-6
    assert (np.isnan(along.joints) == np.isnan(out.joints)).all()


@pytest.mark.parametrize("degrees", [0.2, 5.0])
@pytest.mark.parametrize("joint", [0, 2])
def test_a_moved_zero_takes_two_iterations(joint, degrees):
    """The first next fake target makes it good: afterwards the nominal inverse is the robot's own."""
    nominal = arm()
    theta = nominal.table.theta.copy()
    theta[joint] += np.radians(degrees)
    robot = Robot(nominal.with_table(replace(nominal.table, theta=theta)))
    q = 0.9 * nominal.random_joints(2_000, 9)
    T = robot.poses(q)
    result = calibrated_arm.solve(robot, nominal, T, seed=q, thorough=False)
    assert_solved(robot, result, T)
    assert (result.iterations <= 2).mean() > 0.995
    assert (result.method == Method.FIXED_POINT).all()


def test_sums_and_products_come_to_the_same_joints(monkeypatch):
    nominal, robot = like_table_6_1("irb1600", 1.2)
    q = nominal.random_joints(3_000, 10)
    T = robot.poses(q)
    found = []
    for turn in (0.0, 1.0):
        monkeypatch.setattr(fixed_point, "SUMS", turn)
        found.append(calibrated_arm.solve(robot, nominal, T, seed=q))
        assert_solved(robot, found[-1], T)
    products, sums = found
    assert (products.iterations != sums.iterations).any()
    # those that take longer go on as they began: sums in which products follow would start anew
    assert all(0 < (result.method == Method.NEWTON).sum() < 12 for result in found)
    assert sums.iterations.mean() < 1.05 * products.iterations.mean()
    apart = np.abs(products.joints - sums.joints).max(axis=1)
    assert np.median(apart) < 1e-9


def test_the_better_of_two_iterations_is_kept():
    q, errors = np.arange(12.0).reshape(2, 6, 1), np.array([[1e-3], [1e-2]])
    for better in (True, False):
        state = fixed_point.FixedPointState(1)
        now, before = ((q[k], errors[k], 2 * errors[k]) for k in (0, 1))
        state.keep(np.array([0]), np.array([True]), np.array([better]), now, before, 3)
        assert (state.q == q[0 if better else 1]).all()
        assert state.position[0] == 0.5 * state.rotation[0] == errors[0 if better else 1, 0]
        assert state.iterations[0] == 3


def test_history_and_its_table():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q = nominal.random_joints(1000, 7)
    T = nominal.forward(q)
    position, rotation = fixed_point.history(robot, nominal, T, closed_form.configuration(nominal, q), 3)
    calibrated = robot.poses(closed_form.into_limits(nominal, q)[0])
    assert position[0] == pytest.approx(np.linalg.norm((calibrated - T)[:, :3, 3], axis=1), abs=1e-8)
    assert rotation[0] == pytest.approx(frames.rotation_distance(calibrated[:, :3, :3], T[:, :3, :3]), abs=1e-8)
    assert np.nanmedian(position[2]) < 1e-2 * np.nanmedian(position[1]) < 1e-3 * np.nanmedian(position[0])
    run = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "thesis" / "table_6_1"), "--poses", "300"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line for line in run.stdout.splitlines() if line.startswith(("| 1 | position", "| 3 | position"))]
    assert "| 1.176 |" in rows[0]
    assert "| 3.881 |" in rows[1]


@pytest.mark.parametrize("one_round", [10, 12])
def test_slow_poses_of_all_blocks_go_on_together(monkeypatch, one_round):
    """Of an arm far from the nominal one some poses need more iterations than one round has, which 10 just end."""
    monkeypatch.setattr(fixed_point, "ITERATIONS", one_round)
    nominal = arm()
    rng = np.random.default_rng(1)
    columns = ("alpha", "a", "theta", "d", "beta")
    changes = {name: getattr(nominal.table, name) + 0.012 * rng.uniform(-1.0, 1.0, 6) for name in columns}
    robot = Robot(nominal.with_table(replace(nominal.table, **changes)))
    q = 0.5 * nominal.random_joints(300, 3)
    T = robot.poses(q)
    result = calibrated_arm.solve(robot, nominal, T, configuration=closed_form.configuration(nominal, q))
    assert_solved(robot, result, T)
    slow = result.iterations[result.method == Method.FIXED_POINT] > one_round
    assert slow.sum() > 10
