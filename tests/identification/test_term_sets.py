"""Dictionaries: what is in each, and their weights by hand."""

import numpy as np
import pytest
from evidence_cases import Truth
from hypothesis import given
from hypothesis import strategies as st
from support import arm, example_robot

from irbcal.identification import term_sets as module
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    VARIANCE_CAP,
    Posterior,
)
from irbcal.identification.term_sets import (
    ALL,
    JOINT_MAP,
    LEAST_WEIGHT,
    TermSet,
    candidates,
    make,
    superset,
    tau_of,
    variances_of_like,
    weights,
    with_tau,
)
from irbcal.io import urdf
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
    assert not {t.family for t in terms} & {"bending", "wobble"}
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


def test_a_new_family_of_last_moves_is_compared_where_these_are_known_and_named_nowhere(creep, monkeypatch):
    monkeypatch.setattr(type(creep), "of_moves", True)
    for moved in (True, False):
        terms = superset(arm("irb120"), JOINT_MAP, moved, None, [])
        assert ("creep" in {t.family for t in terms}) is moved
        assert any("creep" in d.name for d in candidates(terms, JOINT_MAP, None)) is moved
    monkeypatch.setattr(type(creep), "moves_frames", True)
    assert "creep" not in {t.family for t in superset(arm("irb120"), JOINT_MAP, True, None, [])}
    assert "creep" in {t.family for t in superset(arm("irb120"), ALL, True, None, [])}


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
