"""Arms with joints to spare: the criterion's least against scipy's constrained optimum."""

import numpy as np
import pytest
from scipy.optimize import minimize
from support import arm, central_differences, example_robot, on_a_rail, random_robot

from irbcal.io import urdf
from irbcal.modeling.inverse import redundancy


def an_arm(name, folder):
    """A real arm of seven joints, or one of six on a rail."""
    if name == "rail":
        return urdf.read(on_a_rail(folder / "rail.urdf"), "rail_base", "tool0").arm
    if name == "xarm7":
        return urdf.read(example_robot("xarm_description/urdf/xarm7.urdf")).arm
    return urdf.read(example_robot("panda_description/urdf/panda.urdf"), tip_link="panda_link8").arm


@pytest.mark.parametrize("wanted", redundancy.CRITERIA)
@pytest.mark.parametrize("name", ["panda", "rail"])
def test_it_is_a_least_of_the_criterion_at_the_pose(name, wanted, tmp_path):
    nominal = an_arm(name, tmp_path)
    robot = random_robot(nominal, "placement", np.random.default_rng(3), size=0.2)
    middle = 0.5 * (nominal.lower + nominal.upper)
    q = middle + 0.6 * (nominal.random_joints(20, 5) - middle)
    near = middle + 0.2 * (nominal.upper - middle)
    found = redundancy.solve(robot, nominal, robot.poses(q), near, wanted)
    assert found.converged.all()
    assert found.inside.all()
    assert np.abs(robot.poses(found.joints) - robot.poses(q)).max() < 1e-9
    value = redundancy.criterion(wanted, nominal, near)
    cost, slope, _ = value(found.joints)
    assert (cost <= value(q)[0] + 1e-9).mean() > 0.8  # other solutions of the arm may have a lower one
    for row in range(3):
        x = found.joints[row]
        J = central_differences(lambda p: robot.forward(p[None])[0, :3].ravel(), x, 1e-4)
        null = np.linalg.svd(J)[2][6:]
        assert np.abs(null @ slope[row]).max() < 1e-5
        target = robot.poses(x)[0, :3].ravel()
        best = minimize(
            lambda p: value(p[None])[0][0],
            x + 1e-3,
            constraints={
                "type": "eq",
                "fun": lambda p, t=target: (
                    robot.forward(p[None])[0, :3].ravel()[[3, 7, 11, 1, 2, 6]] - t[[3, 7, 11, 1, 2, 6]]
                ),
            },
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 200},
        )
        assert cost[row] < best.fun + 1e-6


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_limits_are_farther_than_without_it(name):
    nominal = an_arm(name, None)
    robot = random_robot(nominal, "placement", np.random.default_rng(3), size=0.2)
    q = nominal.random_joints(20, 7)
    middle, half = 0.5 * (nominal.lower + nominal.upper), 0.5 * (nominal.upper - nominal.lower)
    found = redundancy.solve(robot, nominal, robot.poses(q), middle, "limits")
    share = [np.abs((x - middle) / half).max(axis=1) for x in (q, found.joints)]
    assert np.median(share[1]) < 0.85 * np.median(share[0])
    assert found.inside.mean() >= 0.95


def test_arms_without_joints_to_spare_do_not_move():
    nominal = arm("irb120")
    q = nominal.random_joints(5, 1)
    _, slope, curvature = redundancy.criterion("limits", nominal, q[0])(q)
    assert not redundancy.null_step(np.random.default_rng(1).standard_normal((5, 6, 6)), slope, curvature).any()


def test_slopes_and_curvatures_are_central_differences():
    nominal = arm("irb120")
    q = nominal.random_joints(1, 1)[0]
    for name in redundancy.CRITERIA:
        value = redundancy.criterion(name, nominal, np.full(6, 0.1))
        slope = central_differences(lambda p, f=value: f(p[None])[0], q, 1e-4)[0]
        bend = np.diag(central_differences(lambda p, f=value: f(p[None])[1][0], q, 1e-4))
        assert value(q[None])[1][0] == pytest.approx(slope, abs=1e-7)
        assert value(q[None])[2][0] == pytest.approx(bend, abs=1e-6)
