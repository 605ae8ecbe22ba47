"""Evidence against dense Gaussian integrals, and leaving out against fits without the pose."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification import leave_one_out, linearisation, mackay
from irbcal.identification.dictionaries import dictionaries, make, superset, weights
from irbcal.identification.linearisation import Linearisation
from irbcal.identification.sums import Sums
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.situation import Motion

FLAT = 3
GROUP = np.array([0, 0, 0, 0, 1, 1, 1])
CAPS = np.array([4.0, 400.0])


def small_case(seed=1, rows=40):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((FLAT + len(GROUP), rows)) * rng.uniform(0.2, 3.0, FLAT + len(GROUP))[:, None]
    c = rng.standard_normal(len(J)) * np.r_[[5.0] * FLAT, [0.8] * 4, [0.05] * 3]
    y = c @ J + 0.3 * rng.standard_normal(rows)
    return J, y, Sums(J @ J.T, J @ y, float(y @ y), rows)


@pytest.mark.parametrize("t", [1.0, 2 / 3, 1 / 3])
def test_log_evidence_is_the_dense_integral(t):
    J, y, sums = small_case()
    found = mackay.fit(sums, FLAT, GROUP, CAPS, t)
    N, F, R = len(y), J[:FLAT].T, J[FLAT:].T
    S = found.s2 / t * np.eye(N) + R @ np.diag(found.variances[GROUP]) @ R.T
    # integral over the flat columns: a Gaussian about their own least-squares solution
    precision = F.T @ np.linalg.solve(S, F)
    best = np.linalg.solve(precision, F.T @ np.linalg.solve(S, y))
    expected = multivariate_normal(F @ best, S).logpdf(y)
    expected += 0.5 * (FLAT * np.log(2 * np.pi) - np.linalg.slogdet(precision)[1])
    # the tempered likelihood is a Gaussian of variance s2 / t times a constant
    expected += 0.5 * N * np.log(2 * np.pi * found.s2 / t) - 0.5 * t * N * np.log(2 * np.pi * found.s2)
    assert found.log_evidence == pytest.approx(expected, abs=1e-8)


def test_posterior_is_ridge_regression_at_the_fixed_point():
    J, y, sums = small_case()
    found = mackay.fit(sums, FLAT, GROUP, CAPS, 1.0, tolerance=1e-12, iterations=3000)
    prior = np.r_[np.zeros(FLAT), 1.0 / found.variances[GROUP]]
    A = J @ J.T / found.s2 + np.diag(prior)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(A), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.c, np.linalg.solve(A, J @ y) / found.s2, rtol=1e-9)
    gammas = [
        (g == GROUP).sum() - np.diag(found.covariance)[FLAT:][g == GROUP].sum() / found.variances[g] for g in (0, 1)
    ]
    np.testing.assert_allclose(found.gammas, gammas, rtol=1e-6)
    squares = [np.sum(found.c[FLAT:][g == GROUP] ** 2) for g in (0, 1)]
    np.testing.assert_allclose(found.variances, (np.array(squares) + 0.002) / (found.gammas + 0.2), rtol=1e-4)
    left = y - found.c @ J
    assert found.s2 == pytest.approx(left @ left / (len(y) - found.gammas.sum() - FLAT), rel=1e-4)


def test_variances_have_caps_and_unseen_groups_shrink():
    J, _, _ = small_case()
    y = 50.0 * J[FLAT]  # one coefficient far beyond what the cap allows
    found = mackay.fit(Sums(J @ J.T, J @ y, float(y @ y), len(y)), FLAT, GROUP, CAPS, 1.0)
    assert found.variances[0] == 4.0
    J[-3:] = 0.0
    found = mackay.fit(Sums(J @ J.T, J @ y, float(y @ y), len(y)), FLAT, GROUP, CAPS, 1.0)
    assert found.variances[1] == pytest.approx(0.01, rel=0.05)
    np.testing.assert_allclose(np.diag(found.covariance)[-3:], found.variances[1])


def test_too_few_equations_are_refused():
    J, y, _ = small_case(rows=2)
    with pytest.raises(IdentificationError, match="too few"):
        mackay.fit(Sums(J @ J.T, J @ y, float(y @ y), 2), FLAT, GROUP, CAPS, 1.0)
    J, y, _ = small_case()
    J[0] = 0.0
    with pytest.raises(IdentificationError, match="do not determine"):
        mackay.fit(Sums(J @ J.T, J @ y, float(y @ y), len(y)), FLAT, GROUP, CAPS, 1.0)


def test_weights_fall_with_evidence_and_bands():
    w = weights(np.array([100.0, 90.0, 100.0, 20.0]), [False, False, True, False])
    assert w.sum() == pytest.approx(1.0)
    assert w[0] == pytest.approx(np.e * w[1])
    assert w[2] == pytest.approx(w[1])
    assert w[3] == 0.0


def linear_case(poses=30, orientations=False):
    model, rng = arm("irb120"), np.random.default_rng(7)
    robot = random_robot(model, "26", rng)
    points = measured(robot, model.random_joints(poses, 2), 5e-5, rng)
    points = points.take(rng.uniform(size=len(points)) > 0.1)  # poses see two or three targets
    if orientations:
        from dataclasses import replace

        T = (robot.T_world_base @ robot.poses(points.q))[points.pose, :3, :3].copy()
        T[rng.uniform(size=len(T)) > 0.5] = np.nan
        points = replace(points, rotation=T, u95=rng.uniform(1e-5, 4e-5, len(points)))
    motion = Motion.in_order(points.q)
    geometry = GEOMETRY.terms(model)
    problem = linearisation.geometry_problem(model, points, geometry, None)
    state = linearisation.geometry_solution(problem, motion, geometry)
    terms = superset(model, "all", True, None, [10.0])
    return problem, state, motion, terms


@pytest.mark.parametrize("orientations", [False, True])
def test_geometry_columns_are_the_jacobian_of_the_problem(orientations):
    problem, state, motion, terms = linear_case(12, orientations)
    linear = Linearisation(problem, state, motion, terms)
    k = problem.unknowns
    sums = linear.sums(np.arange(k))
    H, g, rss = problem.normal_equations(state)
    units = linear.sizes[:k] / 1e-3
    scale = np.sqrt(np.diag(sums.H))
    np.testing.assert_allclose(
        sums.H / np.outer(scale, scale), H * np.outer(units, units) / np.outer(scale, scale), atol=1e-9
    )
    # the target counts the geometry from the nominal arm
    c = np.r_[np.zeros(problem.outer), state.errors / linear.sizes[problem.outer : k]]
    left = sums.yy - 2 * c @ sums.g + c @ sums.H @ c
    assert left == pytest.approx(1e6 * rss, rel=1e-6)
    np.testing.assert_allclose((sums.g - sums.H @ c) / scale, g * units * 1e3 / scale, atol=1e-6)


def test_blocks_of_poses_add_up(monkeypatch):
    problem, state, motion, terms = linear_case(13)
    linear = Linearisation(problem, state, motion, terms)
    whole = linear.sums()
    monkeypatch.setattr(linearisation, "BLOCK", 4)
    parts = linear.sums()
    np.testing.assert_allclose(parts.H, whole.H, rtol=1e-9, atol=1e-9)
    assert parts.equations == whole.equations == 3 * problem.rows


def test_projection_takes_the_last_move_out_of_each_pose():
    problem, state, motion, terms = linear_case(12)
    chosen = make(terms, ["gravity", "gain"], 0, None)
    linear = Linearisation(problem, state, motion, terms, project=True)
    columns = chosen.columns(linear.flat)
    free = Linearisation(problem, state, motion, terms)
    # the same as one free column a pose in the dense problem: any share of the move leaves the rows as they are
    rows, plain = next(linear.blocks(columns)), next(free.blocks(columns))
    _, tail = (
        plain.J,
        free._columns(
            problem.model(state)[0],
            problem.points,
            np.arange(len(problem.points)),
            np.zeros(0, dtype=int),
            motion,
            0,
            columns,
        )[-1],
    )
    d = tail.T.ravel()
    for n in range(1, 12):
        mine = plain.pose == n
        P = np.eye(mine.sum()) - np.outer(d[mine], d[mine]) / (d[mine] @ d[mine])
        np.testing.assert_allclose(rows.J[:, mine], plain.J[:, mine] @ P, atol=1e-9)
        np.testing.assert_allclose(rows.y[mine], P @ plain.y[mine], atol=1e-9)
    assert linear.sums(columns).equations == 3 * len(problem.points) - 12


@pytest.mark.parametrize("temper", [1.0, 2 / 3])
def test_leaving_out_agrees_with_fits_without_the_poses(temper):
    problem, state, motion, terms = linear_case()
    linear = Linearisation(problem, state, motion, terms)
    chosen = make(terms, ["gravity", "gain", "direction"], 0, None)
    columns = chosen.columns(linear.flat)
    sums = linear.sums(columns)
    found = mackay.fit(sums, linear.flat, chosen.group, chosen.caps, temper)
    rows = next(linear.blocks(columns))
    prior = np.r_[np.zeros(linear.flat), 1.0 / found.variances[chosen.group]]
    a = temper / found.s2

    def without(mine):
        J, y = rows.J[:, ~mine], rows.y[~mine]
        c = np.linalg.solve(a * J @ J.T + np.diag(prior), a * J @ y)
        return rows.y[mine] - c @ rows.J[:, mine]

    u, pose = leave_one_out.residuals(linear, columns, found)
    v, _ = leave_one_out.block_residuals(linear, columns, found, 5)
    for n in (0, 7, 29):
        np.testing.assert_allclose(u[pose == n].ravel(), without(rows.pose == n), rtol=1e-5, atol=1e-6)
    for n in (0, 3):
        mine = (rows.pose >= 6 * n) & (rows.pose < 6 * (n + 1))
        np.testing.assert_allclose(
            v[np.isin(pose, np.unique(rows.pose[mine]))].ravel(), without(mine), rtol=1e-4, atol=1e-5
        )


def test_there_are_twelve_dictionaries_for_an_arm_like_the_thesis():
    terms = superset(arm("irb120"), "all", True, None, [10.0, 20.0])
    found = dictionaries(terms, "all", 20.0)
    assert [len(d.terms) + 15 for d in found] == [45, 51, 57, 81, 178, 196, 232, 352, 298, 442, 694, 748]
    assert [d.bands for d in found] == [False] * 8 + [True] * 4
    found = dictionaries(superset(arm("irb120"), "joint-map", True, None, [20.0]), "joint-map", 20.0)
    assert 159 in [len(d.terms) + 15 for d in found]
    # nothing is known of moves and time: dictionaries that would be equal appear once
    assert len(dictionaries(superset(arm("irb120"), "joint-map", False, None, []), "joint-map", None)) == 8
