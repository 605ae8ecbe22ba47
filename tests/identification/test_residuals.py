"""Analytic derivatives against central differences, and the blocked sums against one big Jacobian."""

import dataclasses

import numpy as np
import pytest
from support import TARGETS, arm, central_differences, measured, random_robot

from irbcal.identification import problem as problem_module
from irbcal.identification.problem import Problem, State
from irbcal.io import urdf
from irbcal.modeling import frames, parameters
from irbcal.modeling.parameters import Parameter


def every_parameter():
    geometric = [f"delta_{kind}{i}" for kind in parameters.GEOMETRIC for i in range(1, 7)]
    others = [
        "stiffness_A",
        "stiffness_B",
        *(f"fourier_{n}" for n in parameters.FOURIER),
        *(f"gain{i}" for i in range(1, 7)),
    ]
    return [parameters.parameter(name) for name in geometric + others]


def skewed_arm():
    """A calibrated-looking arm with offsets before frame 0 and after frame 6, so that no derivative is hidden by zeros."""
    nominal = arm()
    rng = np.random.default_rng(5)
    changes = {k: getattr(nominal.table, k) + 0.05 * rng.normal(size=6) for k in parameters.GEOMETRIC}
    return dataclasses.replace(
        nominal,
        table=dataclasses.replace(nominal.table, **changes),
        T_base_0=frames.from_xyz_angles([0.1, -0.2, 0.3, 0.4, -0.5, 0.6]),
        T_last_tip=frames.from_xyz_angles([0.02, 0.03, -0.04, -0.3, 0.2, 1.0]),
    )


def problem_and_state(poses=7):
    rng = np.random.default_rng(6)
    model = skewed_arm()
    robot = random_robot(arm(), "34", rng)
    points = measured(robot, model.random_joints(poses, 1))
    problem = Problem(model, points, every_parameter())
    state = State(robot.T_world_base, np.array(list(TARGETS.values())), 0.01 * rng.normal(size=len(problem.parameters)))
    return problem, state


def test_jacobian_agrees_with_central_differences():
    problem, state = problem_and_state()
    analytic = problem.jacobian(state)
    # residual = measured - predicted, so its derivative is the negative of the point's
    numeric = -central_differences(
        lambda x: problem.residuals(problem.moved(state, x)).ravel(), np.zeros(problem.unknowns), 1e-3
    )
    scale = np.abs(analytic).max(axis=0)
    assert scale.min() > 1e-3, "every parameter must move some point"
    # the base moves after the prediction: its columns are exact for the point, first order for the residual
    assert (np.abs(analytic - numeric) / scale)[:, 6:].max() < 1e-7


def test_jacobian_of_sessions_agrees_with_central_differences():
    one, state = problem_and_state(poses=9)
    session = np.array([*"aabcacbcb"], dtype=object)
    problem = Problem(one.arm, dataclasses.replace(one.points, session=session), one.parameters)
    assert problem.sessions == ("a", "c", "b")  # that of the last pose is last
    rng = np.random.default_rng(8)
    others = np.array([frames.from_xyz_angles(rng.normal(size=6)) for _ in range(2)])
    state = dataclasses.replace(state, others=others)
    # points of the other sessions as they are seen from there
    T = np.stack([*others, state.T_world_base])[problem.session_of_points()]
    xyz = np.einsum(
        "mij,mj->mi", T[:, :3, :3] @ state.T_world_base[:3, :3].T, one.points.xyz - state.T_world_base[:3, 3]
    )
    points = dataclasses.replace(problem.points, xyz=xyz + T[:, :3, 3])
    problem = Problem(one.arm, points, one.parameters)
    np.testing.assert_allclose(
        problem.residuals(state), one.residuals(dataclasses.replace(state, others=np.zeros((0, 4, 4)))), atol=1e-12
    )
    analytic = problem.jacobian(state)
    numeric = -central_differences(
        lambda x: problem.residuals(problem.moved(state, x)).ravel(), np.zeros(problem.unknowns), 1e-3
    )
    bases = np.r_[0:6, problem.others : problem.outer]
    scale = np.abs(analytic).max(axis=0)
    assert (np.abs(np.delete(analytic - numeric, bases, axis=1)) / np.delete(scale, bases)).max() < 1e-7
    # bases: exact for the point, first order for the residual, whose size is some centimetres here
    assert np.abs((analytic - numeric)[:, bases]).max() < 1.5 * np.abs(problem.residuals(state)).max()
    of_c = np.repeat(problem.session_of_points() == 1, 3)
    np.testing.assert_array_equal(analytic[~of_c, problem.others + 6 : problem.others + 12], 0.0)
    np.testing.assert_array_equal(analytic[of_c, :6], 0.0)
    np.testing.assert_array_equal(
        analytic[of_c, problem.others + 6 : problem.others + 12],
        one.jacobian(dataclasses.replace(state, others=np.zeros((0, 4, 4))))[of_c, :6],
    )


def test_base_columns_are_the_derivative_of_the_moved_prediction():
    problem, state = problem_and_state()
    predicted = problem.points.xyz - problem.residuals(state) @ state.T_world_base[:3, :3].T  # in the measuring frame

    def moved_prediction(step):
        shifted = problem.moved(state, np.concatenate([step, np.zeros(problem.unknowns - 6)]))
        base = frames.apply(frames.inverse(state.T_world_base), predicted)
        return frames.apply(frames.inverse(state.T_world_base), frames.apply(shifted.T_world_base, base)).ravel()

    numeric = central_differences(moved_prediction, np.zeros(6), 1e-3)
    analytic = problem.jacobian(state)[:, :6]
    assert np.abs(analytic - numeric).max() < 1e-7 * np.abs(analytic).max()


def test_normal_equations_are_the_sums_of_the_jacobian(monkeypatch):
    monkeypatch.setattr(problem_module, "BLOCK", 3)
    problem, state = problem_and_state(poses=11)
    J, r = problem.jacobian(state), problem.residuals(state).ravel()
    H, g, rss = problem.normal_equations(state)
    assert np.abs(H - J.T @ J).max() < 1e-12 * np.abs(H).max()
    assert np.abs(g - J.T @ r).max() < 1e-12 * np.abs(J.T @ np.abs(r)).max()
    assert rss == pytest.approx(r @ r, rel=1e-13)


def test_a_gradient_with_the_derivatives_of_the_state_itself_is_that_of_the_sums(monkeypatch):
    problem, state = problem_and_state(poses=11)
    problem.weights = np.random.default_rng(3).uniform(0.5, 2.0, problem.rows)
    slopes = []
    _, g, rss = problem.normal_equations(state, slopes=slopes)
    near, same = problem.gradient_near(state, slopes)
    assert np.abs(near - g).max() < 1e-12 * np.abs(g).max()
    assert same == pytest.approx(rss, rel=1e-13)
    monkeypatch.setattr(problem_module, "BLOCK", 3)
    problem, state = problem_and_state(poses=11)
    problem.normal_equations(state, slopes=(none := []))
    assert none == []


def test_targets_seen_in_some_poses_only():
    problem, state = problem_and_state(poses=9)
    points = problem.points
    keep = np.ones(len(points), dtype=bool)
    keep[[0, 4, 8, 9, 10, 20]] = False
    part = dataclasses.replace(points, pose=points.pose[keep], target=points.target[keep], xyz=points.xyz[keep])
    fewer = Problem(problem.arm, part, problem.parameters)
    rows = np.repeat(keep, 3)
    assert np.abs(fewer.jacobian(state) - problem.jacobian(state)[rows]).max() < 1e-15
    assert np.abs(fewer.residuals(state) - problem.residuals(state)[keep]).max() < 1e-15


def test_residuals_do_not_depend_on_the_arm_being_shipped():
    """A UR-like arm with three parallel axes goes through the same derivatives."""
    model = urdf.read("irb120").arm
    robot = random_robot(model, "26", np.random.default_rng(0))
    points = measured(robot, model.random_joints(5, 2))
    problem = Problem(model, points, (Parameter("delta_a3", "a", 2, "m", 5e-3),))
    state = State(robot.T_world_base, np.array(list(TARGETS.values())), np.zeros(1))
    numeric = -central_differences(
        lambda x: problem.residuals(problem.moved(state, np.r_[np.zeros(15), x])).ravel(), np.zeros(1), 1e-3
    )
    assert np.abs(problem.jacobian(state)[:, 15:] - numeric).max() < 1e-10
