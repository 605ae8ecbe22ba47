"""Families are found by themselves: one module each, also one that somebody adds."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, every_term, motion_at, some_joints

from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import bases, families
from irbcal.modeling.terms.term_map import TermMap


def test_families_are_found_and_have_as_many_terms_as_counted_by_hand():
    model = arm("irb120")
    assert {"geometry", "gain", "gravity", "bending", "harmonics", "direction", "move"} <= set(families())
    assert {"warm_up", "wobble", "gear", "payload", "thesis", "own_weight"} <= set(families())
    counts = {name: len(family.terms(model)) for name, family in families().items()}
    # gravity: none about the vertical axis 1; each link adds two to each axis below it, parallel axes share them
    assert counts["gravity"] == 2 + 4 + 6 + 8 + 10
    assert counts["geometry"] == 30
    assert counts["harmonics"] == 6 * 2 * 45
    assert counts["wobble"] == 6 * 5 * 4
    assert counts["warm_up"] == 36
    assert counts["bending"] == 73
    assert counts["thesis"] == 6
    assert counts["gear"] == 0


def test_names_of_terms_are_unique():
    terms = [t for t in every_term(arm("irb120")) if t.family not in ("thesis", "gear")]
    terms = [t for t in terms if not (t.basis == "decay" and t.parameters["tau"] == 20.0)]
    terms = [t for t in terms if t.parameters.get("place") != (0.1, -0.05, 0.2)]
    assert len({t.name for t in terms}) == len(terms)


def test_terms_bear_the_name_of_their_family_and_a_basis_that_exists():
    model = arm("irb120")
    for name, family in families().items():
        for term in family.terms(model):
            assert term.family == name
            assert term.basis in bases()
            assert term.size > 0.0


def test_a_new_module_is_a_new_family(creep):
    model = arm("irb120")
    terms = tuple(creep.terms(model))
    assert_derivatives(terms, model, some_joints(1)[0])
    found = TermMap(model, terms, 1e-4 * np.arange(1, 7))
    motion = motion_at(some_joints())
    np.testing.assert_allclose(found.effective(motion) - motion.q, 1e-4 * np.arange(1, 7) * motion.q**3, atol=1e-15)
    again = TermMap.of_entries(model, found.entries())
    np.testing.assert_array_equal(again.effective(motion), found.effective(motion))
    np.testing.assert_allclose(JointMap(found).commanded(found.effective(motion)), motion.q, rtol=0, atol=1e-12)


def test_it_is_gone_when_its_module_is():
    assert "creep" not in families()
