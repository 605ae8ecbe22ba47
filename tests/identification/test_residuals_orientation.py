"""Full poses: measured orientations beside positions, known targets, weights."""

import dataclasses

import numpy as np
import pytest
from support import TARGETS, arm, central_differences, measured, random_robot, random_rotation

from irbcal.identification.fit import identify
from irbcal.identification.problem import Problem
from irbcal.modeling import frames, parameters
from irbcal.modeling.thesis_map import ThesisMap


def with_orientations(robot, points, rng, noise=0.0, share=1.0):
    """The same points with the orientation of a target frame turned at random on the tool."""
    R_tip_target = {k: random_rotation(rng) for k in range(len(points.target_names))}
    T = robot.T_world_base @ robot.poses(points.q)
    R = np.array([T[p, :3, :3] @ R_tip_target[t] for p, t in zip(points.pose, points.target, strict=True)])
    R = np.array([frames.rotation_from_vector(noise * rng.standard_normal(3)) @ M for M in R])
    R[rng.random(len(R)) > share] = np.nan
    return dataclasses.replace(points, rotation=R), R_tip_target


def test_orientation_rows_of_the_jacobian_agree_with_central_differences():
    rng = np.random.default_rng(1)
    nominal = arm()
    robot = random_robot(nominal, "34", rng, targets={"a": [0.1, 0.0, 0.2], "b": [0.0, 0.1, 0.1]})
    points, _ = with_orientations(robot, measured(robot, nominal.random_joints(6, 1)), rng, share=0.6)
    names = [f"delta_{kind}{i}" for kind in parameters.GEOMETRIC for i in range(1, 7)]
    names += ["stiffness_A", "stiffness_B", "fourier_a1", "fourier_b2", "gain2", "gain5"]
    problem = Problem(nominal, points, [parameters.parameter(name) for name in names])
    state, _ = __import__("irbcal.identification.initial_guess", fromlist=["closed_form"]).closed_form(problem)
    state = dataclasses.replace(state, errors=1e-3 * rng.normal(size=len(names)))
    assert problem.rows == len(points) + points.oriented().sum()
    # at a state where the orientations fit, the residual's derivative is exactly that of the prediction
    moved = problem.residuals(state)
    arm_now, joint_map = problem.model(state)
    T = arm_now.forward(joint_map.effective(points.q))
    fitted = np.array(
        [
            state.T_world_base[:3, :3] @ T[p, :3, :3] @ state.rotations[t]
            for p, t in zip(points.pose, points.target, strict=True)
        ]
    )
    fitted[~points.oriented()] = np.nan
    exact = Problem(nominal, dataclasses.replace(points, rotation=fitted), problem.parameters)
    turned = slice(3 * len(points), None)
    assert np.abs(exact.residuals(state)[len(points) :]).max() < 1e-14 < np.abs(moved[len(points) :]).max()
    numeric = -central_differences(
        lambda x: exact.residuals(exact.moved(state, x)).ravel()[turned], np.zeros(exact.unknowns), 1e-3
    )
    analytic = exact.jacobian(state)[turned]
    assert np.abs(analytic - numeric).max() < 1e-9
    assert np.abs(analytic).max(axis=0)[[0, 1, 2]].min() > 0.1


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_one_target_frame_is_enough_when_its_orientation_is_measured(share):
    """Pure and mixed files; noise-free data are explained to a nanometre and a nanoradian on other poses."""
    rng = np.random.default_rng(2)
    nominal = arm()
    robot = random_robot(nominal, "34", rng, targets={"tmac": [0.05, -0.02, 0.3]})
    points, R_tip_target = with_orientations(robot, measured(robot, nominal.random_joints(60, 1)), rng, share=share)
    fit = identify(nominal, points, "34")
    q = nominal.random_joints(300, 2)
    assert np.abs(fit.robot.points(q, "tmac") - robot.points(q, "tmac")).max() < 1e-9
    found = (fit.robot.T_world_base @ fit.robot.poses(q))[:, :3, :3] @ fit.robot.target_rotations["tmac"]
    true = (robot.T_world_base @ robot.poses(q))[:, :3, :3] @ R_tip_target[0]
    assert frames.rotation_distance(found, true).max() < 1e-9
    assert {"target_tmac_rx", "target_tmac_ry", "target_tmac_rz"} < {row.name for row in fit.parameters()}


def test_orientations_make_up_for_a_point_on_axis_6():
    """A single point on axis 6 does not see joint 6; the orientation of its frame does."""
    rng = np.random.default_rng(3)
    nominal = arm()
    robot = random_robot(nominal, "34", rng, targets={"tip": [0.0, 0.0, 0.1]})
    points, _ = with_orientations(robot, measured(robot, nominal.random_joints(100, 1), 2e-5, rng), rng, noise=5e-5)
    rows = {row.name: row for row in identify(nominal, points, "34").parameters()}
    assert rows["fourier_a1"].state == "identified"
    assert abs(np.radians(rows["fourier_a1"].value) - ThesisMap.of(robot.joint_map).fourier[0]) < 4.5 * np.radians(
        rows["fourier_a1"].std
    )


def test_known_targets_stay_where_they_are_and_show_the_last_link():
    rng = np.random.default_rng(4)
    nominal = arm()
    robot = random_robot(nominal, "34", rng)
    points = measured(robot, nominal.random_joints(80, 1), 2e-5, rng)
    fit = identify(nominal, points, "34", known_targets={k: TARGETS[k] for k in ("smr1", "smr2", "smr3")})
    rows = {row.name: row for row in fit.parameters()}
    assert not any(name.startswith("target_") for name in rows)
    assert rows["delta_theta6"].state == rows["delta_d6"].state == "identified"
    assert abs(rows["delta_d6"].value * 1e-3 - (robot.table.d[5] - nominal.table.d[5])) < 5e-3 * rows["delta_d6"].std
    assert np.array_equal(fit.robot.targets["smr2"], TARGETS["smr2"])
    one = identify(nominal, points, "34", known_targets={"smr1": TARGETS["smr1"]})
    assert {row.name[:11] for row in one.parameters() if row.name.startswith("target_")} == {
        "target_smr2",
        "target_smr3",
    }


def test_points_count_by_their_uncertainty():
    rng = np.random.default_rng(5)
    nominal = arm()
    robot = random_robot(nominal, "34", rng)
    points = measured(robot, nominal.random_joints(120, 1))
    poor = rng.random(len(points)) < 0.3
    sigma = np.where(poor, 1e-3, 1e-5)
    noisy = dataclasses.replace(points, xyz=points.xyz + sigma[:, None] * rng.standard_normal(points.xyz.shape))
    q = nominal.random_joints(300, 2)

    def miss(seen):
        fit = identify(nominal, seen, "34")
        return np.sqrt(np.mean([np.sum((fit.robot.points(q, n) - robot.points(q, n)) ** 2, axis=1) for n in TARGETS]))

    weighted = miss(dataclasses.replace(noisy, u95=2 * sigma))
    assert weighted < 0.1 * miss(noisy)
    assert weighted < 2e-5
