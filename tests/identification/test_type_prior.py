"""What a robot shows of its type's terms, and what a prior does to its identification."""

from dataclasses import replace

import numpy as np
import pytest

import irbcal
from irbcal.identification import term_sets
from irbcal.identification.evidence import type_terms
from irbcal.identification.term_sets import TypePrior, name_of, taken
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
    assert {term.family for term in shown.terms} == set(term_sets.TYPE_FAMILIES)
    assert all(taken(term) for term in shown.terms)


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
    natural = np.array([term.size for term in shown.terms])
    names, units = tuple(map(name_of, shown.terms)), tuple(term.unit for term in shown.terms)
    return TypePrior("irb1600_6_145", "", ("A", "B"), True, names, units, mean, std, natural)


def test_a_prior_that_is_right_helps_and_one_that_is_wrong_is_seen_through(robot, shown, monkeypatch):
    monkeypatch.setattr(term_sets, "CHOICES", term_sets.CHOICES[:6])  # quick
    arm, points, motion, _ = robot
    few, rest = np.arange(points.poses) < 24, np.arange(points.poses) >= 50
    options = {"gear_scan": False}

    def error(found):
        test, moves = points.select(rest), motion.select(rest)
        mine = test.target == 0
        at = test.pose[mine]
        guess = found.predict(moves.q[at], (moves.q - moves.moves)[at], test.target_names[0])
        return np.linalg.norm(test.xyz[mine] - guess.position, axis=1).mean()

    natural = np.array([term.size for term in shown.terms])
    alone = irbcal.identify_evidence(arm, points.select(few), motion.select(few), **options)
    known = prior(shown, shown.values, np.maximum(np.diagonal(shown.covariance) ** 0.5, 0.05 * natural))
    helped = irbcal.identify_evidence(arm, points.select(few), motion.select(few), prior=known, **options)
    assert helped.type_prior.weight == 1.0
    assert error(helped) < 0.5 * error(alone)
    assert "was taken as a prior" in helped.summary()
    wrong = replace(known, mean=-shown.values)
    found = irbcal.identify_evidence(arm, points.select(few), motion.select(few), prior=wrong, **options)
    assert found.type_prior.weight == 0.0
    np.testing.assert_allclose(found.coefficients, alone.coefficients, rtol=1e-9, atol=1e-12)
    assert found.type_prior.chi2 > 5.0 * found.type_prior.directions
    assert "stands out of its type" in found.summary()
    assert "as its sisters" not in [row.name for row in found.term_sets if row.weight > 0]
