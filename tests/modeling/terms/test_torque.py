"""Terms of measured torques."""

import numpy as np
from support import arm
from term_cases import some_joints, values_of

from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term_map import basis_slopes
from irbcal.modeling.terms.torque import FAMILY, SIZE


def test_each_joint_gives_way_under_its_own_torque():
    model, q = arm("irb120"), some_joints(4)
    terms, torques = FAMILY.terms(model), np.random.default_rng(1).normal(0.0, 30.0, q.shape)
    motion = Motion(q, inputs={"torques": torques})
    assert np.array_equal(values_of(terms, model, motion), torques.T)
    assert {(t.axis, t.unit, t.size, t.group) for t in terms} == {("rz", "rad/(N m)", SIZE, "torque")}
    assert not basis_slopes(terms, Situation(model, motion)).any()
    assert np.array_equal(motion.select(slice(1, 3)).inputs["torques"], torques[1:3])


def test_torques_that_are_not_told_are_zero():
    model = arm("irb120")
    assert not values_of(FAMILY.terms(model), model, Motion(some_joints(2))).any()
