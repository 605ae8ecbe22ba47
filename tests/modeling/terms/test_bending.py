"""Bending against levers known by hand."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, motion_at, some_joints, two_links, values_of

from irbcal.modeling.terms.bending import FAMILY, SIZE
from irbcal.modeling.terms.situation import Motion


def test_terms_are_about_the_axes_that_the_joint_does_not_turn_about():
    terms = FAMILY.terms(arm("irb120"))
    assert {t.axis for t in terms} == {"rx", "ry"}
    assert {t.size for t in terms} == {SIZE}
    assert {t.group for t in terms} == {f"bending_{j}" for j in range(1, 7)}


def test_two_links_in_a_plane_bend_out_of_it():
    # a mass beside the plane twists joint 2's frame with the horizontal part of its x and y axes, cos and sin of joint 1
    model = two_links()
    terms = FAMILY.terms(model)
    assert [(t.joint, t.axis) for t in terms] == [(1, "rx"), (1, "ry")]
    q = model.random_joints(20, 2)
    values = values_of(terms, model, Motion(q))
    np.testing.assert_allclose((values**2).sum(axis=0), 1.0, rtol=0, atol=1e-12)
    angle = np.unwrap(np.arctan2(values[1], values[0])[np.argsort(q[:, 0])])
    np.testing.assert_allclose(np.abs(angle - angle[0]), np.sort(q[:, 0]) - q[:, 0].min(), rtol=0, atol=1e-12)


def test_derivatives():
    model = arm("irb120")
    assert np.abs(assert_derivatives(FAMILY.terms(model), model, some_joints(1)[0], motion=motion_at)).max() > 0.1
