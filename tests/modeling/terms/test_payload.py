"""Torque of a payload by hand, and its derivatives."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, rail, some_joints, two_links, values_of

from irbcal.modeling.terms.payload import STANDARD_GRAVITY, Payload
from irbcal.modeling.terms.situation import Motion


def test_torques_of_two_links_by_hand():
    # 2 kg, 0.1 m beyond the tip: about joint 1 with the whole reach, about joint 2 with 0.4 m
    model = two_links()
    place = np.array([0.1, 0.0, 0.0])
    q = model.random_joints(12, 6)
    torque = values_of(Payload(place).terms(model), model, Motion(q, payload_kg=np.full(12, 2.0)))
    both = q.sum(axis=1)
    reach = 0.4 * np.cos(both)
    weight = 2.0 * STANDARD_GRAVITY
    expected = [weight * (0.4 * np.cos(q[:, 0]) + reach), weight * reach]
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12)


def test_no_mass_no_torque_and_twice_the_mass_twice_the_torque():
    model = arm("irb120")
    terms, q = Payload((0.1, 0.0, 0.2)).terms(model), some_joints(3)
    assert not values_of(terms, model, Motion(q)).any()
    once, twice = (values_of(terms, model, Motion(q, payload_kg=np.full(3, m))) for m in (1.5, 3.0))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-14)
    assert {t.unit for t in terms} == {"rad/(N m)"}


def test_derivatives(tmp_path):
    model = arm("irb120")
    assert np.abs(assert_derivatives(Payload((0.1, -0.05, 0.2)).terms(model), model, some_joints(1)[0])).max() > 1.0
    model = rail(tmp_path)
    q = np.r_[0.7, some_joints(1)[0]]

    def motion(x):
        return Motion(x, payload_kg=np.full(len(np.atleast_2d(x)), 4.0))

    slopes = assert_derivatives(Payload((0.1, -0.05, 0.2)).terms(model), model, q, 0.3 * np.ones(7), motion)
    assert np.abs(slopes[:, 0]).max() < 1e-12  # the rail carries axes and mass alike
