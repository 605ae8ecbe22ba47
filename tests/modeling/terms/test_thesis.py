"""The thesis's joint map as terms."""

import numpy as np
import pytest
from support import arm, example_robot
from term_cases import assert_derivatives, some_joints
from thesis_formula import ThesisMap

from irbcal.io import urdf
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.thesis import FAMILY


@pytest.mark.parametrize("name", ["irb120", "irb1600"])
def test_thesis_terms_are_the_joint_map_of_the_thesis(name):
    model = arm(name)
    phases, _ = model.stiffness_geometry()
    q = model.random_joints(20, 5)
    coefficients = 1e-3 * np.array([1.0, -0.7, 0.4, 0.3, -0.2, 0.6])
    A, B, a_1, b_1, a_2, b_2 = coefficients
    expected = ThesisMap(stiffness=[A, B], phases=phases, fourier=[a_1, b_1, a_2, b_2])
    found = TermMap(model, tuple(FAMILY.terms(model)), coefficients)
    np.testing.assert_allclose(found.effective(Motion(q)), expected.effective(q), rtol=0, atol=1e-15)


def test_derivatives():
    model = arm("irb120")
    assert_derivatives(FAMILY.terms(model), model, some_joints(1)[0])


def test_arms_that_it_does_not_fit_have_none():
    panda = urdf.read(example_robot("panda_description/urdf/panda.urdf"), None, "panda_link8").arm
    assert FAMILY.terms(panda) == []
