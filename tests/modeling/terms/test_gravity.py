"""Gravity's levers against hand calculation."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm
from term_cases import assert_derivatives, rail, some_joints, two_links, values_of

from irbcal.modeling import frames
from irbcal.modeling.terms import families
from irbcal.modeling.terms.gravity import FAMILY, Gravity, independent_levers
from irbcal.modeling.terms.payload import STANDARD_GRAVITY, Payload
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import basis_slopes, basis_values


def lever(joint, link, vector):
    return Term(joint, "rz", "gravity", 1.0, "", "", "rad", {"link": link, "vector": vector})


def test_levers_of_two_links_by_hand():
    # both joints turn the links downwards from the horizontal: a mass along link 1 pulls with cos q1,
    # one along link 2 with cos(q1 + q2) about both axes, one above them with the sine
    model = two_links()
    q = model.random_joints(15, 3)
    first, both = q[:, 0], q.sum(axis=1)
    motion = Motion(q)
    here = Situation(model, Motion(np.zeros((1, 2))))
    along = [here.axes_after_joint[k, :, 0, 0] for k in range(2)]  # base x in the links' axes at zero
    up = [here.axes_after_joint[k, :, 2, 0] for k in range(2)]
    terms = [lever(j, k + 1, tuple(v[k])) for j, k in ((0, 0), (0, 1), (1, 1)) for v in (along, up)]
    expected = [np.cos(first), np.sin(first), np.cos(both), np.sin(both), np.cos(both), np.sin(both)]
    np.testing.assert_allclose(values_of(terms, model, motion), expected, rtol=0, atol=1e-12)
    # and the family keeps as many: two a link and joint, none out of the plane
    assert sorted((t.joint, t.parameters["link"]) for t in FAMILY.terms(model)) == [
        (0, 1),
        (0, 1),
        (0, 2),
        (0, 2),
        (1, 2),
        (1, 2),
    ]


def test_slopes_of_two_links_by_hand():
    model = two_links()
    q = model.random_joints(5, 4)
    here = Situation(model, Motion(np.zeros((1, 2))))
    term = lever(0, 2, tuple(here.axes_after_joint[1, :, 0, 0]))
    slopes = basis_slopes([term], Situation(model, Motion(q)))[0]
    np.testing.assert_allclose(slopes, -np.sin(q.sum(axis=1))[:, None] * np.ones(2), rtol=0, atol=1e-12)


def test_levers_of_parallel_axes_count_once():
    # axes 2 and 3 of the arm are parallel: link 1's lever about axis 2 is constant, links 2 to 6 add two each
    found = independent_levers(arm("irb120"), "rz")
    assert {j: sum(item[0] == j for item in found) for j in range(6)} == {0: 0, 1: 10, 2: 8, 3: 6, 4: 4, 5: 2}


def test_gravity_about_another_direction():
    # an arm on a wall: gravity along -x pulls a stretched first link not at all, a hanging one fully
    model = two_links()
    term = FAMILY.terms(model)[:2]
    here = Situation(model, Motion(np.zeros((2, 2))), gravity=(0.0, -1.0, 0.0))
    np.testing.assert_allclose(basis_values(term, here), 0.0, atol=1e-15)  # gravity along the axes


@pytest.mark.parametrize("part", ["alpha", "beta", "theta", "prismatic", "T_base_0"])
def test_levers_are_those_of_the_arm_at_hand(part):
    """Not those of an arm that turns otherwise, which are known already."""
    model = arm("irb120")
    terms, motion = FAMILY.terms(model), Motion(model.random_joints(5, 1))
    basis_values(terms, Situation(model, motion))
    if part == "T_base_0":
        other = replace(model, T_base_0=model.T_base_0 @ frames.transform(frames.rot_x(0.3)))
    else:
        column = getattr(model.table, part)
        changed = np.arange(6) == 2 if part == "prismatic" else column + 0.1
        other = model.with_table(replace(model.table, **{part: changed}))
    there = Situation(other, motion)
    np.testing.assert_allclose(basis_values(terms, there), Gravity().values(terms, there), rtol=0, atol=1e-12)


def test_gravity_of_a_mass_by_hand():
    # a mass along the upper arm of the IRB 120 weighs on axis 2 (along y) with the sine of joint 2
    model = arm("irb120")
    q = np.zeros((3, 6))
    q[:, 1] = [0.0, 0.5, -1.1]
    term = families()["thesis"].terms(model)[0]
    values = basis_values([term], Situation(model, Motion(q)))[0]
    np.testing.assert_allclose(values, np.sin(q[:, 1]), atol=1e-12)
    # torque of a mass m at p about an axis z through o is z . ((p - o) x m g): here of 3 kg at the tool
    load = Payload().terms(model)[1]
    tip = model.forward(q)[:, :3, 3]
    torque = basis_values([load], Situation(model, Motion(q, inputs={"payload_kg": np.full(3, 3.0)})))[0]
    np.testing.assert_allclose(torque, 3.0 * STANDARD_GRAVITY * tip[:, 0], atol=1e-9)  # axis 2 stands above the origin


@pytest.mark.parametrize(("joint", "link"), [(2, 4), (1, 1), (4, 5), (3, 3)])
def test_gravity_terms_are_the_torques_of_masses_on_links(joint, link):
    # any mass anywhere on a link loads an axis before it with a sum of gravity terms of that joint and a constant
    model = arm("irb120")
    q = model.random_joints(60, 4)
    here = Situation(model, Motion(q))
    place = np.array([0.03, -0.2, 0.11])
    p = np.einsum("a,acn->cn", place, here.axes_after_joint[link]) + here.origins[link]
    torque = np.einsum(
        "cn,cn->n", here.axes_before_joint[joint, 2], np.cross((p - here.origins[joint]).T, [0.0, 0.0, -1.0]).T
    )
    terms = [t for t in families()["gravity"].terms(model) if t.joint == joint]
    basis = np.vstack([basis_values(terms, here), np.ones(len(q))])
    left = torque - basis.T @ np.linalg.lstsq(basis.T, torque, rcond=None)[0]
    assert np.abs(left).max() < 1e-12 < np.abs(torque).max()


def test_derivatives(tmp_path):
    model = arm("irb120")
    assert np.abs(assert_derivatives(FAMILY.terms(model), model, some_joints(1, 8)[0])).max() > 0.5
    model = rail(tmp_path)
    q = np.r_[0.7, some_joints(1)[0]]
    slopes = assert_derivatives(FAMILY.terms(model), model, q, np.ones(7), lambda x: Motion(x))
    assert not slopes[:, 0].any()  # travel turns nothing
    assert 0 not in {t.joint for t in FAMILY.terms(model)}
