"""Warm-up: an exponential in time, gone at use."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, some_joints, values_of

from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import AXES
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.warm_up import SHARES, WarmUp


def moved(found, motion):
    """The joints' own motions, then those of their frames, (n, joints, 7)."""
    effective, xi = found.split(motion)
    return np.concatenate([(effective - motion.q)[..., None], xi], axis=2)


def test_warm_up_is_zero_at_use():
    model = arm("irb120")
    terms = tuple(WarmUp(20.0).terms(model))
    found = TermMap(model, terms, np.ones(len(terms)))
    assert not moved(found, Motion(some_joints(2))).any()
    first = moved(found, Motion(np.zeros((2, 6)), elapsed=np.array([0.0, 20.0])))
    assert first[0, :, [0, 1, 2, 4, 5, 6]].all()
    np.testing.assert_allclose(first[1], first[0] / np.e, rtol=1e-12)


def test_the_drift_counts_from_the_end_of_the_measurement():
    """At the end it is as at use; before, what the arm still had to go from there."""
    model = arm("irb120")
    terms = tuple(WarmUp(20.0, 50.0).terms(model))
    found = TermMap(model, terms, np.ones(len(terms)))
    motion = moved(found, Motion(np.zeros((3, 6)), elapsed=np.array([0.0, 30.0, 50.0])))
    np.testing.assert_allclose(motion[:, 0, 0], [1 - np.exp(-2.5), np.exp(-1.5) - np.exp(-2.5), 0.0], atol=1e-15)
    assert not moved(found, Motion(some_joints(2))).any()


def test_each_time_constant_decays_by_itself():
    model = arm("irb120")
    terms = [*WarmUp(20.0).terms(model), *WarmUp(5.0).terms(model)]
    t = np.array([0.0, 5.0, 30.0])
    values = values_of(terms, model, Motion(np.zeros((3, 6)), elapsed=t))
    np.testing.assert_allclose(values[:36], np.tile(np.exp(-t / 20.0), (36, 1)), rtol=1e-14)
    np.testing.assert_allclose(values[36:], np.tile(np.exp(-t / 5.0), (36, 1)), rtol=1e-14)


def test_all_motions_of_all_joints_and_no_derivative_by_joints():
    model = arm("irb120")
    terms = WarmUp(20.0).terms(model)
    assert [(t.joint, t.axis) for t in terms] == [(j, a) for j in range(6) for a in AXES]
    assert {t.unit for t in terms if t.axis[0] == "t"} == {"m"}
    assert not assert_derivatives(terms, model, some_joints(1)[0]).any()


def test_no_drift_is_longer_than_half_of_the_measurement():
    assert max(SHARES) <= 0.5
    assert tuple(sorted(SHARES)) == SHARES
