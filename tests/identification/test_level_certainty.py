"""What is known of the robot of a level: against the fit's own derivatives, fits without a pose, simulated truth."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_cases import irb120
from support import arm, measured, random_robot

from irbcal.identification.fit import certainty_of, identify, left_out, term_of
from irbcal.modeling.parameters import GEOMETRIC, all_names, apply, parameter, selected_parameters
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term_map import basis_values, term_columns
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.validation.coverage import coverage


def with_certainty(fit):
    return fit.robot.replace(certainty=certainty_of(fit))


def cell(level="34", seed=1, poses=60, noise=3e-5, model="irb120"):
    nominal, rng = arm(model), np.random.default_rng(seed)
    robot = random_robot(nominal, level, rng)
    return nominal, robot, measured(robot, nominal.random_joints(poses, seed), noise, rng), rng


@pytest.mark.parametrize("name", all_names())
def test_terms_move_points_as_their_parameters_do(name):
    nominal = arm()
    phases, _ = nominal.stiffness_geometry()
    item, place, q = parameter(name), np.array([0.1, -0.05, 0.2]), nominal.random_joints(6, 2)
    there = []
    for step in (1e-5, -1e-5):
        table, joint_map = apply([item], [step], nominal.table, ThesisMap(phases=phases))
        T = nominal.with_table(table).forward(joint_map.effective(q))
        there.append(T[:, :3, :3] @ place + T[:, :3, 3])
    path = chain.walk(nominal, q)
    p = path.tip[3] + np.einsum("acn,a->cn", path.tip[:3], place)
    term = term_of(item, nominal)
    columns = chain.point_columns(path, p, np.arange(6), item.kind in GEOMETRIC)
    found = term_columns([term], columns, basis_values([term], Situation(nominal, Motion(q))), np.arange(6))
    np.testing.assert_allclose(found[0].T, (there[0] - there[1]) / 2e-5, rtol=0, atol=1e-8)


@pytest.mark.parametrize("level", ["nominal", "16", "34b", "placement"])
def test_covariance_is_that_of_the_fit(level):
    nominal, _, points, _ = cell()
    fit = identify(nominal, points, level)
    q = nominal.random_joints(15, 8)
    for name in points.target_names:
        expected = fit.predicted_covariance(q, name)
        seen = with_certainty(fit).predict(q, target=name)
        np.testing.assert_allclose(seen.covariance, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_known_targets_and_orientations_have_their_columns():
    nominal, robot, points, rng = cell(poses=40)
    T = (robot.T_world_base @ robot.poses(points.q))[points.pose, :3, :3].copy()
    T[rng.uniform(size=len(T)) > 0.5] = np.nan
    points = replace(points, rotation=T, u95=rng.uniform(1e-5, 4e-5, len(points)))
    fit = identify(nominal, points, "26", known_targets={"smr2": robot.targets["smr2"]})
    q = nominal.random_joints(10, 8)
    for name in points.target_names:
        expected = fit.predicted_covariance(q, name)
        seen = with_certainty(fit).predict(q, target=name)
        np.testing.assert_allclose(seen.covariance, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_left_out_residuals_are_those_of_fits_without_the_pose():
    nominal, _, points, _ = cell("26", poses=25)
    fit = identify(nominal, points, "26")
    single, fifths, _ = left_out(fit, fit.solution.information.covariance())
    for k in (0, 7, 24):
        rest = identify(nominal, points.select(np.arange(25) != k), "26")
        expected = (points.xyz - points.predicted(rest.robot))[points.pose == k] @ rest.robot.T_world_base[:3, :3]
        np.testing.assert_allclose(single[points.pose == k], expected, rtol=0, atol=2e-6)
    block = np.arange(25) // 5 == 2
    rest = identify(nominal, points.select(~block), "26")
    mine = block[points.pose]
    expected = (points.xyz - points.predicted(rest.robot))[mine] @ rest.robot.T_world_base[:3, :3]
    np.testing.assert_allclose(fifths[mine], expected, rtol=0, atol=5e-6)


def test_repeats_are_left_out_together():
    nominal, robot, points, rng = cell("26", poses=20)
    q = np.repeat(points.q, 3, axis=0)
    fit = identify(nominal, measured(robot, q, 3e-5, rng), "26")
    rest = identify(nominal, fit.problem.points.select(np.arange(60) // 3 != 4), "26")
    mine = fit.problem.points.pose // 3 == 4
    seen = fit.problem.points
    expected = (seen.xyz - seen.predicted(rest.robot))[mine] @ rest.robot.T_world_base[:3, :3]
    found = left_out(fit, fit.solution.information.covariance())[0][mine]
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_intervals_hold_on_simulated_robots():
    shares = []
    for seed in range(1, 7):
        nominal, robot, points, rng = cell(seed=seed, poses=50)
        test = measured(robot, nominal.random_joints(100, 50 + seed), 3e-5, rng)
        fit = identify(nominal, points, "34")
        shares.append(coverage(with_certainty(fit), test)["parts"]["all"]["inside"])
    assert 0.92 < np.mean(shares) < 0.98


def test_freed_gains_and_another_level_take_part():
    nominal, _, points, _ = cell("26")
    fit = identify(nominal, points, "26", parameters=selected_parameters("26", ["gain[23]"], [], nominal))
    known = certainty_of(fit)
    assert [term.basis for term in known.terms[-2:]] == ["q", "q"]
    np.testing.assert_array_equal(known.ranges, [points.q.min(axis=0), points.q.max(axis=0)])


@pytest.mark.parametrize("level", ["nominal", "34", "34b", "placement"])
def test_intervals_hold_on_a_real_robot(shared_data, level):
    seen = irb120(shared_data)
    rows = np.arange(seen.points.poses) < 200
    fit = identify(seen.model, seen.points.select(rows), level)
    parts = coverage(with_certainty(fit), seen.points.select(~rows))["parts"]
    assert 0.92 < parts["all"]["inside"] < 0.98


def test_some_places_tell_what_all_do(monkeypatch):
    nominal, _, points, _ = cell(poses=150)
    fit = identify(nominal, points, "34")
    whole = certainty_of(fit)
    monkeypatch.setattr("irbcal.identification.fit.MOST_PLACES", 75)
    some = certainty_of(fit)
    for name, value in whole.loo.items():
        assert abs(some.loo[name] / value - 1.0) < 0.15
        assert abs(some.loo_blocks[name] / whole.loo_blocks[name] - 1.0) < 0.15
    with monkeypatch.context() as patch:
        patch.setattr("irbcal.identification.fit.MOST_PLACES", 149)
        single, _, mine = left_out(fit, whole.covariance)
        every = left_out_of_all(fit, whole.covariance, patch)
        assert np.abs(single - every[np.isin(points.pose_ids, mine.pose_ids)[points.pose]]).max() < 1e-9


def left_out_of_all(fit, covariance, patch):
    patch.setattr("irbcal.identification.fit.MOST_PLACES", 10**6)
    return left_out(fit, covariance)[0]
