"""Branches of an arm that is nearly one with a closed form."""

import numpy as np
from support import arm, assert_same_poses, random_robot

from irbcal.modeling.inverse import closed_form, nearly_closed_form


def test_each_branch_is_one_of_the_other_arm():
    nominal = arm()
    own = random_robot(nominal, "26", np.random.default_rng(1), size=0.3).arm
    q = 0.6 * nominal.random_joints(60, 4)
    near = closed_form.branches(nominal, nominal.forward(q)).singular(wrist=0.1, shoulder=0.1, elbow=0.05)
    q = q[~(near["wrist"] | near["shoulder"] | near["elbow"]).any(axis=1)]
    T = own.forward(q)
    plain, found = nearly_closed_form.branches(nominal, T), nearly_closed_form.branches(nominal, T, own)
    mine = closed_form.configuration(nominal, q)
    off = found.joints[np.arange(len(q)), mine] - q
    assert np.abs(off - 2 * np.pi * np.rint(off / (2 * np.pi))).max() < 1e-8
    assert found.valid.sum() > 0.95 * plain.valid.sum()
    row, branch = np.nonzero(found.valid)
    assert_same_poses(own.forward(found.joints[row, branch]), T[row], 1e-9, 1e-9)
    assert (closed_form.configuration(nominal, found.joints[row, branch]) == branch).all()
    assert np.abs(plain.joints[row, branch] - found.joints[row, branch]).max() > 1e-4


def test_without_another_arm_they_are_the_closed_form():
    nominal = arm()
    T = nominal.forward(nominal.random_joints(5, 1))
    assert np.array_equal(nearly_closed_form.branches(nominal, T).valid, closed_form.branches(nominal, T).valid)
