"""Evidence against dense Gaussian integrals."""

import ctypes

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from irbcal.errors import IdentificationError
from irbcal.identification import evidence_maximisation
from irbcal.identification.evidence_maximisation import (
    EARLY,
    KNOWN_COUNT,
    NOISE,
    NOISE_COUNT,
    VARIANCE_CAP,
    CoefficientPrior,
    NormalEquations,
    evidence_likelihood_power,
    fit_likelihood_power,
    maximise_evidence,
)

FLAT = 3
GROUP = np.array([0, 0, 0, 0, 1, 1, 1])
CAPS = np.array([4.0, 400.0])


def small_case(seed=1, rows=40):
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((FLAT + len(GROUP), rows)) * rng.uniform(0.2, 3.0, FLAT + len(GROUP))[:, None]
    c = rng.standard_normal(len(J)) * np.r_[[5.0] * FLAT, [0.8] * 4, [0.05] * 3]
    y = c @ J + 0.3 * rng.standard_normal(rows)
    return J, y, NormalEquations(J @ J.T, J @ y, float(y @ y), rows)


EXPECTED = CoefficientPrior(
    np.array([0.5, -1.0, 0.2, 0.1, 0, 0, 0]), np.array([0.1, 0.3, 2.0, 0.5, 1, 1, 1]), GROUP == 0
)


@pytest.mark.parametrize("expected_before", [None, EXPECTED])
@pytest.mark.parametrize("t", [1.0, 2 / 3, 1 / 3])
def test_log_evidence_is_the_dense_integral(t, expected_before):
    J, y, sums = small_case()
    found = maximise_evidence(sums, FLAT, GROUP, CAPS, t, prior=expected_before)
    N, F, R = len(y), J[:FLAT].T, J[FLAT:].T
    prior = found.variances[GROUP]
    if expected_before is not None:
        y, prior = y - R @ expected_before.mean, prior * expected_before.std**2
    S = found.s2 / t * np.eye(N) + R @ np.diag(prior) @ R.T
    # integral over the nuisance columns: a Gaussian about their own least-squares solution
    precision = F.T @ np.linalg.solve(S, F)
    best = np.linalg.solve(precision, F.T @ np.linalg.solve(S, y))
    expected = multivariate_normal(F @ best, S).logpdf(y)
    expected += 0.5 * (FLAT * np.log(2 * np.pi) - np.linalg.slogdet(precision)[1])
    # the tempered likelihood is a Gaussian of variance s2 / t times a constant
    expected += 0.5 * N * np.log(2 * np.pi * found.s2 / t) - 0.5 * t * N * np.log(2 * np.pi * found.s2)
    assert found.log_evidence == pytest.approx(expected, abs=1e-8)


def test_what_is_expected_is_a_normal_prior_whose_scale_is_found():
    J, y, sums = small_case()
    found = maximise_evidence(sums, FLAT, GROUP, CAPS, 1.0, tolerance=1e-12, iterations=3000, prior=EXPECTED)
    weight = np.r_[np.zeros(FLAT), 1.0 / (found.variances[GROUP] * EXPECTED.std**2)]
    mean = np.r_[np.zeros(FLAT), EXPECTED.mean]
    A = J @ J.T / found.s2 + np.diag(weight)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(A), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.c, np.linalg.solve(A, J @ y / found.s2 + weight * mean), rtol=1e-9, atol=1e-12)
    far = ((found.c - mean)[FLAT:] / EXPECTED.std) ** 2
    known, plain = far[GROUP == 0].sum(), far[GROUP == 1].sum()
    count = KNOWN_COUNT
    assert found.variances[0] == pytest.approx(min(4.0, (known + count) / (found.gammas[0] + count)), rel=1e-4)
    assert found.variances[1] == pytest.approx((plain + 0.002) / (found.gammas[1] + 0.2), rel=1e-4)


def test_posterior_is_ridge_regression_at_the_fixed_point():
    J, y, sums = small_case()
    found = maximise_evidence(sums, FLAT, GROUP, CAPS, 1.0, tolerance=1e-12, iterations=3000)
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
    known, count = NOISE_COUNT * NOISE**2, NOISE_COUNT
    assert found.s2 == pytest.approx((left @ left + known) / (len(y) - found.gammas.sum() - FLAT + count), rel=1e-4)


def test_a_fit_that_passes_through_every_point_does_not_seem_certain():
    rng = np.random.default_rng(4)
    J = rng.standard_normal((60, 24))  # more terms than equations
    y = 0.3 * rng.standard_normal(24)
    sums = NormalEquations(J @ J.T, J @ y, float(y @ y), len(y))
    found = maximise_evidence(sums, 1, np.zeros(59, dtype=int), np.array([VARIANCE_CAP]), 1.0, iterations=500)
    assert np.sqrt(found.s2) > 0.1 * NOISE


def test_variances_have_caps_and_unseen_groups_shrink():
    J, _, _ = small_case()
    y = 50.0 * J[FLAT]  # one coefficient far beyond what the cap allows
    found = maximise_evidence(NormalEquations(J @ J.T, J @ y, float(y @ y), len(y)), FLAT, GROUP, CAPS, 1.0)
    assert found.variances[0] == 4.0
    J[-3:] = 0.0
    found = maximise_evidence(NormalEquations(J @ J.T, J @ y, float(y @ y), len(y)), FLAT, GROUP, CAPS, 1.0)
    assert found.variances[1] == pytest.approx(0.01, rel=0.05)
    np.testing.assert_allclose(np.diag(found.covariance)[-3:], found.variances[1], rtol=1e-12)


@pytest.mark.parametrize("nuisance", [0, FLAT])
def test_without_terms_there_are_nuisance_columns_and_noise_alone(nuisance, capfd):
    """A closed form: the dense integral over the nuisance columns; and LAPACK has nothing to complain of."""
    J, y, _ = small_case()
    F = J[:nuisance].T
    sums, nothing = NormalEquations(F.T @ F, F.T @ y, float(y @ y), len(y)), np.zeros(0, dtype=int)
    found = maximise_evidence(sums, nuisance, nothing, np.zeros(0), 1.0, variances=np.zeros(0), s2=1.0)
    best = np.linalg.lstsq(F, y, rcond=None)[0] if nuisance else np.zeros(0)
    expected = multivariate_normal(F @ best, found.s2 * np.eye(len(y))).logpdf(y)
    expected += 0.5 * (nuisance * np.log(2 * np.pi * found.s2) - np.linalg.slogdet(F.T @ F)[1])
    assert found.log_evidence == pytest.approx(expected, abs=1e-8)
    ctypes.CDLL(None).fflush(None)  # of LAPACK's own output
    assert capfd.readouterr() == ("", "")


def test_too_few_equations_are_refused():
    J, y, _ = small_case(rows=2)
    with pytest.raises(IdentificationError, match="too few"):
        maximise_evidence(NormalEquations(J @ J.T, J @ y, float(y @ y), 2), FLAT, GROUP, CAPS, 1.0)
    J, y, _ = small_case()
    J[0] = 0.0
    with pytest.raises(IdentificationError, match="do not determine"):
        maximise_evidence(NormalEquations(J @ J.T, J @ y, float(y @ y), len(y)), FLAT, GROUP, CAPS, 1.0)


def test_variances_are_those_of_the_largest_evidence():
    # without what keeps variances from zero, the fixed point is where the evidence no longer grows
    sums = small_case(4, 200)[2]
    found = maximise_evidence(sums, FLAT, GROUP, np.full(2, 1e9), 1.0, tolerance=1e-13, iterations=5000)

    def evidence(variances, s2):
        return maximise_evidence(sums, FLAT, GROUP, CAPS, 1.0, np.array(variances), s2, iterations=1).log_evidence

    best = evidence(found.variances, found.s2)
    for k in range(2):
        for factor in (0.7, 1.4):
            v = found.variances.copy()
            v[k] *= factor
            assert evidence(v, found.s2) < best
    assert evidence(found.variances, 1.2 * found.s2) < best
    assert evidence(found.variances, found.s2 / 1.2) < best


def test_true_variances_are_found():
    rng = np.random.default_rng(2)
    group = np.repeat([0, 1], 200)
    J = rng.standard_normal((402, 3000))
    c = np.r_[3.0, -2.0, 0.9 * rng.standard_normal(200), 0.04 * rng.standard_normal(200)]
    y = c @ J + 0.5 * rng.standard_normal(3000)
    found = maximise_evidence(NormalEquations(J @ J.T, J @ y, float(y @ y), 3000), 2, group, CAPS, 1.0)
    np.testing.assert_allclose(np.sqrt(found.variances), [0.9, 0.04], rtol=0.15)
    assert np.sqrt(found.s2) == pytest.approx(0.5, rel=0.05)
    assert np.mean(np.abs(found.c - c) < 1.96 * np.sqrt(np.diag(found.covariance))) > 0.92


def test_likelihood_powers_count_a_pose_as_six_numbers_and_as_one_vector():
    assert [fit_likelihood_power(m) for m in (1, 2, 3, 6)] == [1.0, 1.0, pytest.approx(2 / 3), pytest.approx(1 / 3)]
    assert [evidence_likelihood_power(m) for m in (0.5, 1, 3)] == [1.0, 1.0, pytest.approx(1 / 3)]


def test_a_hopeless_fit_is_given_up_early():
    _, _, sums = small_case()
    whole = maximise_evidence(sums, FLAT, GROUP, CAPS, 1.0, tolerance=0.0)
    early = maximise_evidence(sums, FLAT, GROUP, CAPS, 1.0, tolerance=0.0, evidence_floor=whole.log_evidence + 1.0)
    assert early.iterations < EARLY < whole.iterations
    near = maximise_evidence(sums, FLAT, GROUP, CAPS, 1.0, tolerance=0.0, evidence_floor=whole.log_evidence - 1.0)
    assert near.iterations == whole.iterations


def test_more_terms_than_the_poses_are_worth_do_not_keep_it_going_round():
    """From two starts to one top, where MacKay's own fixed point does not settle in 400 steps."""
    rng = np.random.default_rng(8)
    group = np.repeat(np.arange(12), 5)
    J = rng.standard_normal((FLAT + 60, 90))
    J[FLAT + 30 :] += 0.9 * J[FLAT : FLAT + 30]  # groups that can stand in for one another
    y = 0.3 * rng.standard_normal(5) @ J[FLAT : FLAT + 5] + 0.2 * rng.standard_normal(90)
    sums = NormalEquations(J @ J.T, J @ y, float(y @ y), 90)
    caps = np.full(12, 4.0)
    one = maximise_evidence(sums, FLAT, group, caps, 1 / 3)
    other = maximise_evidence(sums, FLAT, group, caps, 1 / 3, np.full(12, 0.03), 1.0, tolerance=1e-9, iterations=400)
    assert one.iterations < 25
    assert other.iterations < 400
    assert one.log_evidence == pytest.approx(other.log_evidence, abs=0.1)


@pytest.mark.parametrize("expected_before", [None, EXPECTED])
def test_the_curvature_is_how_the_slope_changes(expected_before):
    problem = evidence_maximisation._VarianceProblem.from_sums(
        small_case()[2], FLAT, GROUP, 2, 2 / 3, NOISE, expected_before
    )
    x = np.log([0.3, 0.02, 0.08])

    def slope(x):
        moment = problem.at(np.exp(x[:-1]), float(np.exp(x[-1])))
        return 0.5 * (moment.up * np.exp(-x) - moment.down)

    curvature = problem.curvature(
        problem.at(np.exp(x[:-1]), float(np.exp(x[-1]))), np.exp(x[:-1]), float(np.exp(x[-1]))
    )
    for k, change in enumerate(1e-2 * np.eye(3)):  # sizes of steps are known to single precision
        np.testing.assert_allclose(curvature[k], (slope(x - change) - slope(x + change)) / 2e-2, rtol=1e-3, atol=1e-4)


def test_a_step_is_newton_s_where_the_top_is_round_and_mackay_s_measure_bounds_it_elsewhere():
    slope, mackay = np.array([3.0, 2.0]), np.array([3.0, 0.5])  # MacKay's curvatures: 1 and 4
    step = evidence_maximisation._newton
    round_top = np.array([[5.0, 1.0], [1.0, 8.0]])
    np.testing.assert_allclose(step(slope, mackay, round_top), np.linalg.solve(round_top, slope), rtol=0, atol=1e-12)
    np.testing.assert_allclose(step(slope, mackay, np.diag([-5.0, 0.0])), [0.6, 0.5 / 0.3], rtol=0, atol=1e-12)
    assert step(slope, mackay, np.diag([0.9, 4.0])).tolist() == [3.0, 0.5]


@given(st.lists(st.integers(0, 7), min_size=1, max_size=8, unique=True), st.integers(0, 1000))
def test_a_part_is_what_its_columns_give(columns, seed):
    rng = np.random.default_rng(seed)
    J, y = rng.standard_normal((8, 20)), rng.standard_normal(20)
    whole = NormalEquations(J @ J.T, J @ y, float(y @ y), 20)
    part = whole.select(np.array(columns))
    np.testing.assert_allclose(part.H, J[columns] @ J[columns].T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(part.g, J[columns] @ y, rtol=1e-12, atol=1e-12)
    assert (part.yy, part.equations) == (whole.yy, 20)
    # least squares from the sums is numpy's least squares of the rows
    c, left, *_ = np.linalg.lstsq(J[columns].T, y, rcond=None)
    np.testing.assert_allclose(np.linalg.solve(part.H, part.g), c, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(part.yy - c @ part.g, left[0], rtol=1e-6)


def test_scipy_laid_out_in_another_way(monkeypatch):
    A = np.random.default_rng(0).standard_normal((90, 90))
    A = A @ A.T + np.eye(90)
    monkeypatch.setattr(evidence_maximisation.PathFinder, "find_spec", lambda name, path=None: None)
    monkeypatch.setattr(evidence_maximisation, "_linear_algebra", evidence_maximisation._linear_algebra.__wrapped__)
    W = evidence_maximisation._inverse(evidence_maximisation._cholesky(np.asfortranarray(A)))
    assert np.abs(W.T @ W @ A - np.eye(90)).max() < 1e-10


def test_terms_that_stand_in_for_one_another_are_determined_as_exact_numbers_say():
    """Pairs of equal columns in two groups, a million times above the noise: the precision is nearly singular."""
    rng = np.random.default_rng(6)
    J = rng.standard_normal((FLAT + 80, 300))
    J[FLAT + 40 :] = J[FLAT : FLAT + 40]
    group, v, s2 = np.repeat([0, 1], 40), np.array([2.0, 0.5]), 1e-4
    y = rng.standard_normal(len(J)) @ J
    problem = evidence_maximisation._VarianceProblem.from_sums(
        NormalEquations(J @ J.T, J @ y, float(y @ y), 300), FLAT, group, 2, 1.0, NOISE, None
    )
    moment = problem.at(v, s2)
    # of a pair the data determine the sum alone: its prior variance 2.5 falls to next to nothing
    np.testing.assert_allclose(moment.gammas, [40 * 2.0 / 2.5, 40 * 0.5 / 2.5], rtol=1e-4)


def test_covariance_with_other_variances_is_that_of_the_fit_with_them():
    _, _, sums = small_case()
    found = maximise_evidence(sums, FLAT, GROUP, CAPS, 2 / 3)
    others = found.variances * [3.0, 0.5]
    precision = found.likelihood_power / found.s2 * sums.H + np.diag(np.r_[np.zeros(FLAT), 1.0 / others[GROUP]])
    np.testing.assert_allclose(
        found.with_variances(others, GROUP).covariance, np.linalg.inv(precision), rtol=1e-9, atol=1e-12
    )
