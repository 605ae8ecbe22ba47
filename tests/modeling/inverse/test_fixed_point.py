"""The fixed point: moved zeros, slow poses, and the thesis's table of it."""

import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inverse_cases import assert_solved, like_table_6_1
from support import arm

from irbcal.modeling import frames
from irbcal.modeling.inverse import calibrated_arm, closed_form
from irbcal.modeling.inverse.result import Method
from irbcal.modeling.robot import Robot

TABLE_6_1 = Path(__file__).parents[3] / "scripts" / "thesis" / "table_6_1"


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


def test_history_and_its_table():
    nominal, robot = like_table_6_1("irb1600", 2.4)
    q = nominal.random_joints(1000, 7)
    T = nominal.forward(q)
    history = runpy.run_path(str(TABLE_6_1))["history"]
    position, rotation = history(robot, nominal, T, closed_form.configuration(nominal, q), 3)
    calibrated = robot.poses(closed_form.into_limits(nominal, q)[0])
    assert position[0] == pytest.approx(np.linalg.norm((calibrated - T)[:, :3, 3], axis=1), abs=1e-8)
    assert rotation[0] == pytest.approx(frames.rotation_distance(calibrated[:, :3, :3], T[:, :3, :3]), abs=1e-8)
    assert np.nanmedian(position[2]) < 1e-2 * np.nanmedian(position[1]) < 1e-3 * np.nanmedian(position[0])
    run = subprocess.run(
        [sys.executable, str(TABLE_6_1), "--poses", "300"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line for line in run.stdout.splitlines() if line.startswith(("| 1 | position", "| 3 | position"))]
    assert "| 1.176 |" in rows[0]
    assert "| 3.881 |" in rows[1]


def test_slow_poses_go_on():
    """Of an arm far from the nominal one some poses need many iterations."""
    nominal = arm()
    rng = np.random.default_rng(1)
    columns = ("alpha", "a", "theta", "d", "beta")
    changes = {name: getattr(nominal.table, name) + 0.012 * rng.uniform(-1.0, 1.0, 6) for name in columns}
    robot = Robot(nominal.with_table(replace(nominal.table, **changes)))
    q = 0.5 * nominal.random_joints(300, 3)
    T = robot.poses(q)
    result = calibrated_arm.solve(robot, nominal, T, configuration=closed_form.configuration(nominal, q))
    assert_solved(robot, result, T)
    slow = result.iterations[result.method == Method.FIXED_POINT] > 12
    assert slow.sum() > 10
