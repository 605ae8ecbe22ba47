"""The gear scan against dense fits, and its verdict on simulated gears and on noise."""

import numpy as np
import pytest
from evidence_cases import Truth, linear_case, rows_of

from irbcal.identification import gear_scan
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.evidence_maximisation import VARIANCE_CAP, maximise_evidence
from irbcal.identification.linear_model import Linearisation
from irbcal.identification.term_sets import make
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.situation import Motion

PAIRS = [(3, 242), (0, 11)]
"""Frequencies that the scan has taken already: joint from 0, cycles per turn."""


@pytest.fixture(scope="module")
def fitted():
    problem, state, motion, terms = linear_case(40)
    linear = Linearisation(problem, state, motion, terms)
    chosen = make(terms, ["gravity", "gain"], 0, None)
    columns = chosen.columns(linear.nuisance)
    sums = linear.sums(columns)
    found = maximise_evidence(sums, linear.nuisance, chosen.group, chosen.caps, 2 / 3)
    return linear, chosen, columns, sums, found


def dense(linear, columns, waves):
    """Rows of the chosen columns, then of the waves' two columns each, by another linearisation; and the target."""
    gears = [term for pair in waves for term in gear_terms(*pair)]
    wide = Linearisation(linear.problem, linear.state, linear.motion, [*linear.terms, *gears])
    places = linear.nuisance + len(linear.terms) + np.arange(len(gears))
    block = rows_of(wide, np.concatenate([columns, places]))
    return block.J, block.y


def test_sums_with_frequencies_are_those_of_their_columns(fitted):
    linear, _, columns, sums, _ = fitted
    reduced = gear_scan.WaveSums(linear, columns, list(range(6)))
    J, y = dense(linear, columns, PAIRS)
    wide = reduced.extended(sums, PAIRS)
    scale = np.sqrt(np.diag(J @ J.T))
    np.testing.assert_allclose(wide.H / np.outer(scale, scale), J @ J.T / np.outer(scale, scale), rtol=0, atol=1e-9)
    np.testing.assert_allclose(wide.g / scale, J @ y / scale, rtol=0, atol=1e-9)
    assert reduced.extended(sums, []) is sums


@pytest.mark.parametrize("taken", [0, 1, 2])
def test_chi2_is_what_a_fit_with_the_frequency_gains(fitted, taken):
    linear, chosen, columns, sums, _ = fitted
    pairs = PAIRS[:taken]
    reduced = gear_scan.WaveSums(linear, columns, list(range(6)))
    group = np.concatenate([chosen.group, np.repeat(len(chosen.caps) + np.arange(taken), 2)]).astype(int)
    caps = np.append(chosen.caps, np.full(taken, VARIANCE_CAP))
    found = maximise_evidence(reduced.extended(sums, pairs), linear.nuisance, group, caps, 2 / 3)
    cycles = np.array([7.0, 100.0, 241.0, 400.0])
    strength = reduced.chi2(cycles, pairs, found)
    a, prior = found.likelihood_power / found.s2, np.r_[np.zeros(linear.nuisance), 1.0 / found.variances[group]]

    def least(J, y, extra):
        """Smallest a |y - c J|^2 + c' P c; the ``extra`` last columns have no prior."""
        P = np.r_[prior, np.zeros(extra)]
        rows = np.vstack([np.sqrt(a) * J.T, np.diag(np.sqrt(P))])
        target = np.r_[np.sqrt(a) * y, np.zeros(len(P))]
        unit = np.linalg.norm(rows, axis=0)
        c = np.linalg.lstsq(rows / unit, target, rcond=None)[0]
        return np.sum((target - rows / unit @ c) ** 2)

    before = least(*dense(linear, columns, pairs), 0)
    for joint in (0, 3, 5):
        for k, cycle in enumerate(cycles):
            after = least(*dense(linear, columns, [*pairs, (joint, int(cycle))]), 2)
            assert strength[joint, k] == pytest.approx(before - after, rel=1e-4, abs=1e-4)


def test_gears_are_found_in_words():
    gears = [(t, c) for t, c in zip(gear_terms(3, 242), (6e-5, -3e-5), strict=True)]
    truth = Truth(["gravity", "gain"], extra=gears)
    motion = Motion(truth.nominal.random_joints(120, 3))
    told = []
    found = identify_evidence(truth.nominal, truth.measured(motion, 1e-5), motion, progress=told.append)
    assert [(g.joint, g.cycles_per_turn) for g in found.average.gears] == [(4, 242)]
    (sentence,) = found.gear_sentences()
    assert "joint 4: 242 cycles per turn, 0.0038 degrees" in sentence
    assert sentence in found.summary()
    assert found.average.gears[0].evidence_gain > 5.0
    assert any(text.startswith("joint 4: 242 per turn") for text in told)


def test_no_gears_are_found_in_noise():
    truth = Truth(["gravity", "gain"])
    motion = Motion(truth.nominal.random_joints(80, 3))
    assert not identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion).average.gears
