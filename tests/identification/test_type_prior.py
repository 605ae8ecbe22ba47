"""What robots of a type show of a new one: expected terms, and whether it is like them."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import IdentificationError
from irbcal.identification import term_sets, type_prior
from irbcal.identification.evidence import type_terms
from irbcal.identification.evidence_maximisation import (
    CoefficientPrior,
    NormalEquations,
    maximise_evidence,
)
from irbcal.identification.term_sets import TermSet
from irbcal.identification.type_prior import (
    TypePrior,
    TypeTerm,
    chi_square_of_type,
    is_compared,
    like_type,
    name_of,
)
from irbcal.measurement import cleaning
from irbcal.measurement.motions import motion_of


@pytest.fixture(scope="module")
def robot():
    """SIMULATED points, their motion, the arm and the true terms."""
    found = irbcal.simulate("irb1600", random=100, robot_seed=5, seed=5)
    read = irbcal.read_measurements(found.to_frame())
    points = cleaning.clean(read).points
    return irbcal.read_urdf("irb1600").arm, points, motion_of(read, points), found


@pytest.fixture(scope="module")
def shown(robot):
    arm, points, motion, _ = robot
    return type_terms(arm, points, motion)


def test_the_terms_are_those_of_the_type_each_once(shown):
    names = [name_of(term) for term in shown.terms]
    assert len(set(names)) == len(names)
    assert {"delta_theta3", "delta_a2"} <= set(names)
    assert {term.family for term in shown.terms} == set(type_prior.families_of_type())
    assert all(is_compared(term) for term in shown.terms)


def test_its_estimate_agrees_with_the_truth_within_its_scatter(robot, shown):
    """Waves and gains, which nothing else explains; those that 100 poses show well."""
    _, _, _, found = robot
    truth = found.cell.truth()["terms"]
    away = []
    for k, term in enumerate(shown.terms):
        std = shown.covariance[k, k] ** 0.5
        if term.family in ("harmonics", "gain") and std < 0.3 * term.size:
            away.append((shown.values[k] - truth.get(term.name, 0.0)) / std)
    assert len(away) > 40
    assert np.sqrt(np.mean(np.square(away))) < 1.5


def prior(shown, mean, std):
    terms = tuple(
        TypeTerm(name=name_of(term), unit=term.unit, mean=expected, std=scatter, natural=term.size)
        for term, expected, scatter in zip(shown.terms, mean, std, strict=True)
    )
    return TypePrior(type="irb1600_6_145", nominal_urdf_sha256="0" * 64, robots=("A", "B"), simulated=True, terms=terms)


def test_a_prior_that_is_right_helps_and_one_that_is_wrong_is_seen_through(robot, shown, monkeypatch):
    monkeypatch.setattr(term_sets, "CHOICES", term_sets.CHOICES[:6])  # quick
    arm, points, motion, _ = robot
    few, rest = np.arange(points.poses) < 24, np.arange(points.poses) >= 50
    options = {"gear_scan": False}

    def error(found):
        test, moves = points.select(rest), motion.select(rest)
        mine = test.target == 0
        at = test.pose[mine]
        guess = found.robot.predict(moves.q[at], (moves.q - moves.moves)[at], test.target_names[0])
        return np.linalg.norm(test.xyz[mine] - guess.position, axis=1).mean()

    natural = np.array([term.size for term in shown.terms])
    alone = irbcal.identify_evidence(arm, points.select(few), motion.select(few), **options)
    std = np.maximum(np.diagonal(shown.covariance) ** 0.5, 0.05 * natural)
    known = prior(shown, shown.values, std)
    helped = irbcal.identify_evidence(arm, points.select(few), motion.select(few), prior=known, **options)
    assert helped.type_prior.weight == 1.0
    assert error(helped) < 0.5 * error(alone)
    assert "was taken as a prior" in helped.summary()
    wrong = prior(shown, -shown.values, std)
    found = irbcal.identify_evidence(arm, points.select(few), motion.select(few), prior=wrong, **options)
    assert found.type_prior.weight == 0.0
    np.testing.assert_allclose(found.coefficients, alone.coefficients, rtol=1e-9, atol=1e-12)
    assert found.type_prior.chi2 > 5.0 * found.type_prior.directions
    assert "stands out of its type" in found.summary()
    assert not any(row.name.endswith("type prior") for row in found.term_sets if row.weight > 0)


FLAT, TERMS, ROWS, NOISE = 3, 8, 60, 0.3
MEAN = np.array([1.0, -2.0, 0.5, 0.0, 3.0, 0.2, 0.0, 0.0])
STD = np.array([0.5, 0.3, 0.2, 1.0, 0.4, 0.1, 1.0, 1.0])
KNOWN = np.arange(TERMS) < 6
CHOICE = TermSet("", np.arange(TERMS), ("a", "b"), (~KNOWN).astype(int), prior=CoefficientPrior(MEAN, STD, KNOWN))


def against_type(rng, away=1.0):
    J = rng.standard_normal((FLAT + TERMS, ROWS))
    J[FLAT + 1] *= 1e-3  # a term that is not seen
    c = np.r_[10.0 * rng.standard_normal(FLAT), MEAN + away * STD * rng.standard_normal(TERMS)]
    y = c @ J + NOISE * rng.standard_normal(ROWS)
    sums = NormalEquations(J @ J.T, J @ y, float(y @ y), ROWS)
    found = maximise_evidence(sums, FLAT, CHOICE.group, CHOICE.caps, 1.0, prior=CHOICE.prior)
    return chi_square_of_type(sums, FLAT, CHOICE, found)


def test_robots_of_the_type_have_one_a_direction_and_strangers_more():
    rng = np.random.default_rng(3)
    own = np.array([against_type(rng) for _ in range(300)])
    assert set(own[:, 1]) == {5.0}
    assert own[:, 0].mean() == pytest.approx(5.0, rel=0.1)
    assert own[:, 0].var() == pytest.approx(10.0, rel=0.35)
    assert np.mean([like_type(chi2, int(k)) for chi2, k in own]) > 0.98
    strange = [against_type(rng, 4.0) for _ in range(50)]
    assert np.mean([like_type(chi2, k) for chi2, k in strange]) < 0.15


def test_a_term_set_without_type_prior_is_refused():
    with pytest.raises(IdentificationError, match="has no type prior"):
        chi_square_of_type(
            NormalEquations(np.eye(1), np.zeros(1), 1.0, 1), 1, TermSet("", np.arange(0), (), np.arange(0)), None
        )
