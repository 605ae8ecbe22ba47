"""Leaving out against fits without the poses."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_cases import linear_case, rows_of
from support import arm, measured, random_robot

from irbcal.identification import leave_one_out, linear_model, problem
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.evidence_maximisation import maximise_evidence
from irbcal.identification.linear_model import Linearisation
from irbcal.identification.term_sets import make
from irbcal.measurement.points import distances
from irbcal.modeling.terms.situation import Motion


@pytest.mark.parametrize(("likelihood_power", "families"), [(1.0, []), (2 / 3, ["gravity", "gain", "direction"])])
def test_leaving_out_agrees_with_fits_without_the_poses(likelihood_power, families):
    """With fewer columns than a block has rows, and with more."""
    case_problem, state, motion, terms = linear_case()
    linear = Linearisation(case_problem, state, motion, terms)
    chosen = make(terms, families, 0, None)
    columns = chosen.columns(linear.nuisance)
    found = maximise_evidence(linear.sums(columns), linear.nuisance, chosen.group, chosen.caps, likelihood_power)
    rows = rows_of(linear, columns)
    prior = np.r_[np.zeros(linear.nuisance), 1.0 / found.variances[chosen.group]]
    a = likelihood_power / found.s2

    def without(mine):
        J, y = rows.J[:, ~mine], rows.y[~mine]
        c = np.linalg.solve(a * J @ J.T + np.diag(prior), a * J @ y)
        return rows.y[mine] - c @ rows.J[:, mine]

    u, pose, _ = leave_one_out.residuals(linear, columns, found)
    order = np.argsort(pose[::3], kind="stable")
    u, pose = u.reshape(-1, 3)[order], pose[::3][order]
    v = leave_one_out.block_residuals(linear, columns, found, 5).reshape(-1, 3)[order]
    for n in (0, 7, 29):
        np.testing.assert_allclose(u[pose == n].ravel(), without(rows.pose == n), rtol=1e-5, atol=1e-6)
    for n in (0, 3):
        mine = (rows.pose >= 6 * n) & (rows.pose < 6 * (n + 1))
        np.testing.assert_allclose(
            v[np.isin(pose, np.unique(rows.pose[mine]))].ravel(), without(mine), rtol=1e-4, atol=1e-5
        )


def test_residuals_are_the_same_in_any_blocks(monkeypatch):
    case = linear_case(14, orientations=True)
    chosen = make(case[-1], ["gravity"], 0, None)
    found, out = None, []
    for size in (2048, 4):
        monkeypatch.setattr(problem, "BLOCK", size)
        linear = Linearisation(*case)
        columns = chosen.columns(linear.nuisance)
        found = found or maximise_evidence(linear.sums(columns), linear.nuisance, chosen.group, chosen.caps, 1.0)
        u, pose, row = leave_one_out.residuals(linear, columns, found)
        assert sorted(row[::3]) == list(range(case[0].rows))
        order = np.lexsort([row, pose])
        out.append((pose[order], row[order], u[order], leave_one_out.block_residuals(linear, columns, found)[order]))
    for first, second in zip(*out, strict=True):
        np.testing.assert_allclose(first, second, rtol=0, atol=1e-8)


def test_left_out_errors_are_larger_than_residuals():
    case_problem, state, motion, terms = linear_case(20)
    linear = Linearisation(case_problem, state, motion, terms)
    chosen = make(terms, ["gravity", "gain"], 0, None)
    columns = chosen.columns(linear.nuisance)
    found = maximise_evidence(linear.sums(columns), linear.nuisance, chosen.group, chosen.caps, 2 / 3)
    rows = rows_of(linear, columns)
    fitted = leave_one_out.rms_length((rows.y - found.c @ rows.J).reshape(-1, 3))
    one = leave_one_out.rms_length(leave_one_out.residuals(linear, columns, found)[0].reshape(-1, 3))
    block = leave_one_out.rms_length(leave_one_out.block_residuals(linear, columns, found).reshape(-1, 3))
    assert 1.1 * fitted < one < 1.1 * block


def test_root_mean_square_length_by_hand():
    assert leave_one_out.rms_length(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])) == pytest.approx(np.sqrt(12.5))


def test_repeats_of_a_place_are_left_out_together(monkeypatch):
    monkeypatch.setattr(problem, "BLOCK", 8)
    case = linear_case()
    terms, linear = case[-1], Linearisation(*case)
    chosen = make(terms, ["gravity", "gain"], 0, None)
    columns = chosen.columns(linear.nuisance)
    found = maximise_evidence(linear.sums(columns), linear.nuisance, chosen.group, chosen.caps, 1.0)
    rows = rows_of(linear, columns)
    prior = np.r_[np.zeros(linear.nuisance), 1.0 / found.variances[chosen.group]]
    place = np.arange(30)
    place[[9, 21]] = 2
    monkeypatch.setattr(linear_model, "repeat_groups", lambda points: place)
    u, pose, _ = leave_one_out.residuals(linear, columns, found)
    order = np.argsort(pose[::3], kind="stable")
    u, pose = u.reshape(-1, 3)[order], pose[::3][order]
    for n in ([2, 9, 21], [3]):
        mine = np.isin(rows.pose, n)
        J, y = rows.J[:, ~mine], rows.y[~mine]
        c = np.linalg.solve(J @ J.T / found.s2 + np.diag(prior), J @ y / found.s2)
        expected = rows.y[mine] - c @ rows.J[:, mine]
        np.testing.assert_allclose(u[np.isin(pose, n)].ravel(), expected, rtol=1e-5, atol=1e-6)


def test_blocks_are_fifths_of_each_session():
    place = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 3, 13, 14])
    whole = leave_one_out.block_numbers(place, None)
    assert whole.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 1, 4, 4]
    session = np.array(["mon"] * 10 + ["tue"] * 6, dtype=object)
    own = leave_one_out.block_numbers(place, session)
    # pose 13 repeats a place of the first session, and goes with it
    assert own.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 0, 1, 2, 1, 3, 4]


def test_only_rows_that_depend_on_an_open_direction_are_infinite():
    """The last of four columns is in the last three rows alone; against a fit of the other rows by a pseudo-inverse."""
    rng = np.random.default_rng(5)
    J = rng.normal(size=(4, 30))
    J[3, :27] = 0.0
    y = rng.normal(size=30)
    C = np.linalg.inv(J @ J.T)
    e = y - (C @ J @ y) @ J
    mine = np.arange(30) >= 21
    known = np.arange(30)[mine] < 27
    W = leave_one_out.root(C)
    (without,) = leave_one_out.LeftOutSolution.per_pose(W, [J[:, mine] @ J[:, mine].T], [J[:, mine] @ e[mine]])
    expected = (y - (np.linalg.pinv(J[:, ~mine].T) @ y[~mine]) @ J)[mine]
    together = without.residuals(J[:, mine], e[mine], 1.0)
    alone = leave_one_out.single(W @ J, e, np.where(mine, 99, np.arange(30)), 1.0)[mine]
    for found in (together, alone):
        assert np.isinf(found).tolist() == (~known).tolist()
        np.testing.assert_allclose(found[known], expected[known], rtol=0, atol=1e-10)
    assert leave_one_out.closed(leave_one_out.rms_length(together.reshape(-1, 3))) is None


@pytest.mark.parametrize("off", [0.0, 3e-3])
def test_points_that_contradict_all_others_are_outlying(off):
    """Also one that is less than half as far off as the other: it is seen once that one is left out."""
    model, rng = arm("irb120"), np.random.default_rng(5)
    points = measured(random_robot(model, "34", rng), model.random_joints(46, 3), 3e-5, rng)
    moved_by = np.zeros(len(points))
    moved_by[[17, 90]] = off, 0.3 * off
    moved = replace(points, xyz=points.xyz + moved_by[:, None] * np.array([0.6, 0.0, 0.8]))
    found = identify_evidence(model, moved, Motion.in_order(points.q), gear_scan=False)
    np.testing.assert_allclose(found.outlier_distance, moved_by, rtol=0.2, atol=0.0)


def test_a_pose_that_no_other_checks_is_named():
    """One pose far from all others and 5 mm off: how far it is from where a fit without it puts it."""
    near = arm().random_joints(25, 1) * 0.15 + np.radians([0, 20, 10, 20, 40, 0])
    far = near[:1] + np.radians([120, 50, -50, 120, -80, 160])
    robot = random_robot(arm(), "34", np.random.default_rng(4))
    points = measured(robot, np.vstack([near, far]), 3e-5, np.random.default_rng(2))
    moved = replace(points, xyz=points.xyz + 5e-3 * (points.pose == 25)[:, None])
    fit = identify_evidence(arm(), moved, gear_scan=False)
    assert fit.leverage_pose[0] == 25
    without = identify_evidence(arm(), moved.select(np.arange(26) < 25), gear_scan=False)
    assert without.leverage_pose is None
    distance = distances(without.robot, moved.select(np.arange(26) == 25))
    # sizes of groups and weights of the term sets are other without it
    assert fit.leverage_pose[1] == pytest.approx(np.sqrt(np.mean(distance**2)), rel=0.2)
