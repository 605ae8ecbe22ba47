"""Gains: in proportion to the commanded joint."""

import numpy as np
from support import arm
from term_cases import assert_derivatives, rail, some_joints
from thesis_formula import ThesisMap

from irbcal.modeling.terms.gain import FAMILY
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap


def test_gains_are_those_of_the_joint_map():
    model = arm("irb120")
    gains = 1e-3 * np.array([1.0, -2.0, 0.5, 0.3, -0.7, 2.0])
    found = TermMap(model, tuple(FAMILY.terms(model)), gains)
    q = some_joints(20)
    np.testing.assert_allclose(found.effective(Motion(q)), ThesisMap(gain=gains).effective(q), rtol=0, atol=1e-15)


def test_derivatives():
    model = arm("irb120")
    np.testing.assert_array_equal(assert_derivatives(FAMILY.terms(model), model, some_joints(1)[0]), np.eye(6))


def test_a_prismatic_joint_goes_too_far_too(tmp_path):
    model = rail(tmp_path)
    terms = FAMILY.terms(model)
    assert [t.axis for t in terms] == ["tz"] + ["rz"] * 6
    q = np.array([[2.0, 0, 0, 0, 0, 0, 0]])
    found = TermMap(model, tuple(terms), np.r_[1e-3, np.zeros(6)])
    shift = found.forward(model, Motion(q)) - model.forward(q)
    assert abs(np.linalg.norm(shift[0, :3, 3]) - 0.002) < 1e-12
    np.testing.assert_allclose(shift[0, :3, :3], 0.0, atol=1e-15)
