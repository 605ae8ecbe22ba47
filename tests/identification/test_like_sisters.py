"""The chi-square against sisters, on SIMULATED linear models: as often beyond a limit as it says."""

import numpy as np
import pytest

from irbcal.errors import IdentificationError
from irbcal.identification.evidence_maximisation import Expected, Sums, maximise_evidence
from irbcal.identification.term_sets import TermSet, chi_square_of_type, like_type

FLAT, TERMS, ROWS, NOISE = 3, 8, 60, 0.3
MEAN = np.array([1.0, -2.0, 0.5, 0.0, 3.0, 0.2, 0.0, 0.0])
STD = np.array([0.5, 0.3, 0.2, 1.0, 0.4, 0.1, 1.0, 1.0])
KNOWN = np.arange(TERMS) < 6
CHOICE = TermSet("", np.arange(TERMS), ("a", "b"), (~KNOWN).astype(int), expected=Expected(MEAN, STD, KNOWN))


def against_sisters(rng, away=1.0):
    J = rng.standard_normal((FLAT + TERMS, ROWS))
    J[FLAT + 1] *= 1e-3  # a term that is not seen
    c = np.r_[10.0 * rng.standard_normal(FLAT), MEAN + away * STD * rng.standard_normal(TERMS)]
    y = c @ J + NOISE * rng.standard_normal(ROWS)
    sums = Sums(J @ J.T, J @ y, float(y @ y), ROWS)
    found = maximise_evidence(sums, FLAT, CHOICE.group, CHOICE.caps, 1.0, expected=CHOICE.expected)
    return chi_square_of_type(sums, FLAT, CHOICE, found)


def test_sisters_have_one_a_direction_and_strangers_more():
    rng = np.random.default_rng(3)
    own = np.array([against_sisters(rng) for _ in range(300)])
    assert set(own[:, 1]) == {5.0}
    assert own[:, 0].mean() == pytest.approx(5.0, rel=0.1)
    assert own[:, 0].var() == pytest.approx(10.0, rel=0.35)
    assert np.mean([like_type(chi2, int(k)) for chi2, k in own]) > 0.98
    strange = [against_sisters(rng, 4.0) for _ in range(50)]
    assert np.mean([like_type(chi2, k) for chi2, k in strange]) < 0.15


def test_a_choice_without_sisters_is_refused():
    with pytest.raises(IdentificationError, match="knows of no sisters"):
        chi_square_of_type(Sums(np.eye(1), np.zeros(1), 1.0, 1), 1, TermSet("", np.arange(0), (), np.arange(0)), None)
