"""Analytic derivatives against central differences, and the blocked sums against one big Jacobian."""

import dataclasses

import numpy as np
import pytest
from support import TARGETS, arm, central_differences, measured, random_robot, random_rotation
from thesis_formula import ThesisMap

from irbcal.identification import initial_guess, problem
from irbcal.identification import problem as problem_module
from irbcal.identification.fit import identify
from irbcal.identification.problem import Problem, State
from irbcal.io import urdf
from irbcal.modeling import frames, parameters
from irbcal.modeling.parameters import Parameter
from irbcal.modeling.terms.situation import Motion


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
    # gravity's levers are those of the nominal arm: the skewed one does not bend like the thesis's
    terms = [parameters.term_of(item, arm()) for item in every_parameter()]
    problem = Problem(model, points, every_parameter()[:36]).with_terms(terms, Motion(points.q))
    state = State(robot.T_world_base, np.array(list(TARGETS.values())), 0.01 * rng.normal(size=len(terms)))
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
    points = dataclasses.replace(one.points, session=session)
    problem = Problem(one.arm, points, one.parameters).with_terms(one.terms, one.motion)
    assert problem.sessions == ("a", "c", "b")  # that of the last pose is last
    rng = np.random.default_rng(8)
    others = np.array([frames.from_xyz_angles(rng.normal(size=6)) for _ in range(2)])
    state = dataclasses.replace(state, earlier_bases=others)
    # points of the other sessions as they are seen from there
    T = np.stack([*others, state.T_world_base])[problem.session_of_points()]
    xyz = np.einsum(
        "mij,mj->mi", T[:, :3, :3] @ state.T_world_base[:3, :3].T, one.points.xyz - state.T_world_base[:3, 3]
    )
    points = dataclasses.replace(problem.points, xyz=xyz + T[:, :3, 3])
    problem = Problem(one.arm, points, one.parameters).with_terms(one.terms, one.motion)
    np.testing.assert_allclose(
        problem.residuals(state),
        one.residuals(dataclasses.replace(state, earlier_bases=np.zeros((0, 4, 4)))),
        atol=1e-12,
    )
    analytic = problem.jacobian(state)
    numeric = -central_differences(
        lambda x: problem.residuals(problem.moved(state, x)).ravel(), np.zeros(problem.unknowns), 1e-3
    )
    bases = np.r_[0:6, problem.earlier_bases_start : problem.nuisance]
    scale = np.abs(analytic).max(axis=0)
    assert (np.abs(np.delete(analytic - numeric, bases, axis=1)) / np.delete(scale, bases)).max() < 1e-7
    # bases: exact for the point, first order for the residual, whose size is some centimetres here
    assert np.abs((analytic - numeric)[:, bases]).max() < 1.5 * np.abs(problem.residuals(state)).max()
    of_c = np.repeat(problem.session_of_points() == 1, 3)
    np.testing.assert_array_equal(
        analytic[~of_c, problem.earlier_bases_start + 6 : problem.earlier_bases_start + 12], 0.0
    )
    np.testing.assert_array_equal(analytic[of_c, :6], 0.0)
    np.testing.assert_array_equal(
        analytic[of_c, problem.earlier_bases_start + 6 : problem.earlier_bases_start + 12],
        one.jacobian(dataclasses.replace(state, earlier_bases=np.zeros((0, 4, 4))))[of_c, :6],
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
    fewer = Problem(problem.arm, part, problem.parameters).with_terms(problem.terms, problem.motion)
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
    arm_now, terms = problem.model(state)
    T = terms.forward(arm_now, Motion(points.q))
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
    assert abs(
        np.radians(rows["fourier_a1"].value) - ThesisMap.from_joint_map(robot.joint_map).fourier[0]
    ) < 4.5 * np.radians(rows["fourier_a1"].std)


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


POSES = 11


@pytest.fixture
def points():
    nominal = arm()
    return measured(random_robot(nominal, "34", np.random.default_rng(0)), nominal.random_joints(POSES, 1))


def some(points, keep):
    rows = {name: getattr(points, name)[keep] for name in ("pose", "target", "xyz")}
    return dataclasses.replace(points, **rows)


def oriented(points, share):
    turned = np.random.default_rng(1).random(len(points)) < share
    rotation = np.where(turned[:, None, None], np.eye(3), np.nan)
    return dataclasses.replace(points, rotation=rotation)


def cut(points, session=None):
    session = np.zeros(len(points), dtype=int) if session is None else session
    return problem.cut(points, points.oriented(), session, problem.BLOCK)


def assert_every_point_at_home(points, blocks):
    m, turned = len(points), np.flatnonzero(points.oriented())
    rows = np.concatenate([block.rows for block in blocks])
    assert sorted(rows.tolist()) == list(range(m + len(turned)))
    for block in blocks:
        t, f = block.target.shape
        own, angles = block.rows[: t * f], block.rows[t * f :] - m
        q = np.tile(block.q[block.frames], (t, 1))
        np.testing.assert_array_equal(q, points.q[points.pose[own]])
        np.testing.assert_array_equal(block.target.ravel(), points.target[own])
        np.testing.assert_array_equal(block.xyz.T, points.xyz[own])
        np.testing.assert_array_equal(turned[angles], own[block.turned])
        np.testing.assert_array_equal(block.q, points.q[block.poses])


@pytest.mark.parametrize("size", [2048, 4, 1])
@pytest.mark.parametrize(
    "kind", ["all", "one target", "some missing", "one missing", "no pose 4", "oriented", "some oriented"]
)
def test_every_point_stands_once_and_at_its_own_pose(points, kind, size, monkeypatch):
    monkeypatch.setattr(problem, "BLOCK", size)
    everywhere = np.arange(len(points))
    points = {
        "all": lambda: points,
        "one target": lambda: some(points, points.target == 1),
        "some missing": lambda: some(points, np.random.default_rng(2).random(len(points)) < 0.6),
        "one missing": lambda: some(points, everywhere != 7),
        "no pose 4": lambda: some(points, points.pose != 4),
        "oriented": lambda: oriented(points, 1.0),
        "some oriented": lambda: oriented(points, 0.3),
    }[kind]()
    blocks = cut(points)
    assert max(len(block.q) for block in blocks) <= size
    assert_every_point_at_home(points, blocks)


def test_frames_are_shared_where_poses_have_as_many_points(points):
    (block,) = cut(points)
    assert block.target.shape == (3, POSES)
    # one target each: which one may change from pose to pose
    (block,) = cut(some(points, points.target == points.pose % 3))
    assert block.target.shape == (1, POSES)
    assert set(block.target.ravel()) == {0, 1, 2}
    # as many points as three each would be, but one pose has a second measurement of a target, another lacks one
    order = np.sort(np.r_[np.delete(np.arange(len(points)), 4), 30])
    most, others = cut(some(points, order))
    assert most.target.shape == (3, POSES - 2)
    assert others.target.shape == (1, 6)
    assert_every_point_at_home(some(points, order), [most, others])
    # where hardly two poses are alike nothing is shared
    few = some(points, points.target <= points.pose % 5)
    (block,) = cut(some(few, few.pose < 3))
    assert block.target.shape == (1, 6)


def test_no_points(points):
    assert cut(some(points, points.pose < 0)) == []


def test_sessions_go_with_the_rows(points):
    session = (points.pose >= 5).astype(int)
    for some_points in (points, oriented(points, 0.4)):
        (block,) = cut(some_points, session)
        at = np.concatenate([np.arange(len(points)), np.flatnonzero(some_points.oriented())])
        np.testing.assert_array_equal(block.session, session[at[block.rows]])


def test_shared_frames_give_the_residuals_and_derivatives_of_frames_at_every_point(points):
    """With an orientation at a single point frames are taken at every point: its rows but for that one are the same."""
    chosen = parameters.level_parameters("34")
    alone = np.zeros(len(points), dtype=bool)
    alone[4] = True
    rotation = np.where(alone[:, None, None], np.eye(3), np.nan)
    shared, each = (Problem(arm(), p, chosen) for p in (points, dataclasses.replace(points, rotation=rotation)))
    state = dataclasses.replace(
        initial_guess.closed_form(shared)[0], errors=1e-3 * np.random.default_rng(3).standard_normal(len(chosen))
    )
    np.testing.assert_allclose(shared.residuals(state), each.residuals(state)[: len(points)], rtol=0, atol=1e-14)
    nuisance = [*range(shared.earlier_bases_start), *range(each.earlier_bases_start, each.unknowns)]
    J = each.jacobian(state)[: 3 * len(points), nuisance]
    np.testing.assert_allclose(shared.jacobian(state), J, rtol=0, atol=1e-13)
