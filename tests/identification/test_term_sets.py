"""Dictionaries: what is in each, and their weights by hand."""

import numpy as np
import pytest
from evidence_cases import Truth
from hypothesis import given
from hypothesis import strategies as st
from support import arm, example_robot

import irbcal
from irbcal.errors import IdentificationError
from irbcal.identification import term_sets
from irbcal.identification import term_sets as module
from irbcal.identification.evidence import identify_evidence, type_terms
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    VARIANCE_CAP,
    CoefficientPrior,
    NormalEquations,
    Posterior,
    maximise_evidence,
)
from irbcal.identification.term_sets import (
    ALL,
    FRAME_FAMILIES,
    JOINT_MAP,
    LEAST_WEIGHT,
    TermSet,
    TypePrior,
    TypeTerm,
    candidates,
    chi_square_of_type,
    is_compared,
    like_type,
    make,
    name_of,
    superset,
    tau_of,
    variances_of_like,
    weights,
    with_tau,
)
from irbcal.io import urdf
from irbcal.measurement import cleaning
from irbcal.measurement.motions import motion_of
from irbcal.modeling.terms.situation import Motion


def posterior(evidence, gamma=0.0, freedom=100.0):
    """A fit of which only what weighs it is known."""
    none = np.zeros(0)
    return Posterior(none, none, none, np.array([gamma]), 1.0, evidence, 1, 1.0, freedom)


def test_weights_fall_with_evidence_and_with_what_it_is_too_high_by():
    w = weights(
        [posterior(100.0), posterior(90.0), posterior(100.0, 50.0 / np.log(2.0), 50.0 / np.log(2.0)), posterior(20.0)]
    )
    assert w.sum() == pytest.approx(1.0)
    assert w[0] == pytest.approx(np.e * w[1])
    assert w[2] == pytest.approx(w[1])  # 0.2 x 50 nats
    assert w[3] == 0.0


def test_there_are_twelve_dictionaries_for_an_arm_like_the_thesis():
    terms = superset(arm("irb120"), "all", True, None, [10.0, 20.0])
    found = candidates(terms, "all", 20.0)
    assert [len(d.terms) + 15 for d in found] == [45, 51, 57, 81, 178, 196, 232, 352, 352, 442, 694, 748]
    assert [d.bands for d in found] == [False] * 8 + [True] * 4
    found = candidates(superset(arm("irb120"), "joint-map", True, None, [20.0]), "joint-map", 20.0)
    assert 159 in [len(d.terms) + 15 for d in found]
    # nothing is known of moves and time: dictionaries that would be equal appear once
    assert len(candidates(superset(arm("irb120"), "joint-map", False, None, []), "joint-map", None)) == 8


@given(st.lists(st.tuples(st.floats(-1e4, 1e4), st.floats(0.0, 100.0)), min_size=1, max_size=14), st.floats(-1e4, 1e4))
def test_weights_sum_to_one_whatever_the_unit_of_evidence(rows, shift):
    w = weights([posterior(evidence, gamma) for evidence, gamma in rows])
    assert w.sum() == pytest.approx(1.0)
    assert ((w == 0.0) | (w >= LEAST_WEIGHT)).all()
    np.testing.assert_allclose(weights([posterior(evidence + shift, gamma) for evidence, gamma in rows]), w, atol=1e-6)
    assert w[np.argmax([evidence - 0.2 * gamma * np.log1p(gamma / 100.0) for evidence, gamma in rows])] == w.max()


def test_a_dictionary_is_its_families_and_geometry():
    terms = superset(arm("irb120"), ALL, True, None, [10.0, 20.0])
    for d in candidates(terms, ALL, 20.0):
        assert len(np.unique(d.terms)) == len(d.terms) == len(d.group)
        assert [terms[k].family for k in d.terms[:30]] == ["geometry"] * 30
        assert set(d.group) == set(range(len(d.groups)))
        np.testing.assert_array_equal(d.caps, [GEOMETRY_CAP if g == "geometry" else VARIANCE_CAP for g in d.groups])
        families = {terms[k].family for k in d.terms}
        assert all(name.replace("_", "-") in d.name for name in families)
        assert not ("thesis" in families and "gravity" in families)  # the one is part of the other
    some = make(terms, ["gravity"], 0, None)
    np.testing.assert_array_equal(some.columns(15)[:16], np.arange(16))
    assert [terms[k - 15].family for k in some.columns(15)[45:]] == ["gravity"] * 30


def test_the_joint_map_has_no_frame_terms_but_warm_up():
    terms = superset(arm("irb120"), JOINT_MAP, True, None, [10.0])
    assert not {t.family for t in terms} & set(FRAME_FAMILIES)
    assert {t.family for t in terms if t.axis != "rz"} == {"geometry", "warm_up"}


def test_what_is_not_known_takes_no_part():
    terms = superset(arm("irb120"), ALL, False, None, [])
    assert not {t.family for t in terms} & {"direction", "move", "warm_up", "payload"}
    assert "payload" in {t.family for t in superset(arm("irb120"), ALL, False, (0, 0, 0), [])}


def test_arms_that_the_thesis_does_not_fit_have_no_thesis():
    panda = urdf.read(example_robot("panda_description/urdf/panda.urdf"), None, "panda_link8").arm
    names = [d.name for d in candidates(superset(panda, ALL, True, None, [10.0]), ALL, 10.0)]
    assert names[:3] == ["geometry", "geometry, gain", "geometry, gravity, gain"]
    assert "thesis" not in " ".join(names)


def test_time_constants_are_exchanged_and_groups_added():
    terms = superset(arm("irb120"), ALL, True, None, [10.0, 20.0])
    warm = next(d for d in candidates(terms, ALL, 20.0) if "warm-up" in d.name)
    assert tau_of(warm, terms) == 20.0
    other = with_tau(warm, terms, 10.0)
    assert tau_of(other, terms) == 10.0
    assert tau_of(warm, terms) == 20.0
    assert [(terms[k].joint, terms[k].axis) for k in other.terms] == [
        (terms[k].joint, terms[k].axis) for k in warm.terms
    ]
    wide = other.extended([900, 901, 902], ["gear_1_9", "gear_1_9", "geometry"])
    assert wide.groups == (*other.groups, "gear_1_9")
    assert list(wide.group[-3:]) == [len(other.groups), len(other.groups), wide.groups.index("geometry")]
    assert tau_of(make(terms, ["gain"], 0, None), terms) is None


def test_a_new_family_takes_part(creep, monkeypatch):
    truth = Truth(["gravity"], extra=[(t, 3e-5 * (t.joint + 1)) for t in creep.terms(arm("irb120"))])
    motion = Motion(truth.nominal.random_joints(80, 3))
    points = truth.measured(motion, 1e-5)
    without = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    monkeypatch.setattr(module, "FAMILIES", (*module.FAMILIES, "creep"))
    monkeypatch.setattr(module, "CHOICES", (*module.CHOICES[:6], (("gravity", "gain", "creep"), 0)))
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    best = max(found.term_sets, key=lambda row: row.weight)
    assert best.name == "geometry, gravity, gain, creep"
    assert best.weight > 0.99
    assert found.average.sigma_mm < 0.9 * without.average.sigma_mm
    (seen,) = (row.determined for row in found.average.groups if row.name == "creep")
    assert seen > 4.5
    for t, c, std in zip(found.terms, found.coefficients, found.std, strict=True):
        if t.family == "creep":
            assert abs(c - 3e-5 * (t.joint + 1)) < 4.0 * std < 2e-4


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


def test_an_open_group_may_be_as_large_as_those_of_other_joints():
    groups = ("geometry", "harmonics_1", "harmonics_2", "gain")
    group = np.array([0, 1, 1, 2, 2, 3])
    fit = Posterior(
        c=np.array([9.0, 0.5, 1.0, 1.0, 0.0, 0.0, 0.01]),  # a base, then terms
        factor=np.eye(7),
        variances=np.array([0.3, 1.0, 0.01, 0.01]),
        gammas=np.array([1.0, 1.8, 0.0, 0.5]),
        s2=1.0,
        log_evidence=0.0,
        iterations=1,
        likelihood_power=1.0,
    )
    of_waves = (2.0 + 0.002) / (1.8 + 0.2)  # squares of both joints by what is determined of them
    of_gain = (1e-4 + (1e-4 + 0.002) / 0.7) / 1.5
    expected = [0.3, (2.0 + of_waves) / 2.8, of_waves, 0.01]  # none smaller than in the fit
    assert of_gain < 0.01
    found = variances_of_like(fit, TermSet("", np.arange(6), groups, group))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
