"""Branches: their numbers, their distance from singularities, and what they say of themselves."""

import pickle

import numpy as np
import pytest
from support import arm

from irbcal.modeling.inverse import closed_form
from irbcal.modeling.inverse.branches import branch_number


def test_numbers_are_four_back_two_down_one_flip():
    assert branch_number() == 0
    assert branch_number(back=True, flip=True) == 5
    numbers = branch_number(*np.array(np.meshgrid([False, True], [False, True], [False, True], indexing="ij")))
    assert numbers.ravel().tolist() == list(range(8))


def test_distances_from_singularities():
    nominal = arm()
    q = np.radians([[10.0, 20, -30, 20, 1e-5, 30], [10, 20, -30, 20, 40, 30]])
    found = closed_form.branches(nominal, nominal.forward(q))
    branch = closed_form.configuration(nominal, q)
    assert found.wrist[[0, 1], branch] == pytest.approx(np.radians([1e-5, 40]), abs=1e-9)
    assert np.array_equal(found.elbow, np.repeat(found.reach_margin, 4, axis=1))
    assert found.singular()["wrist"][0, branch[0]]
    assert not found.singular()["wrist"][1].any()
    for mask in found.singular(wrist=9, shoulder=9, elbow=9).values():
        assert np.array_equal(mask, found.valid), "no singularity of a branch that does not reach"


def test_branches_speak_are_locked_and_can_be_pickled():
    nominal = arm()
    T = nominal.forward(nominal.random_joints(1000, 0))
    T[0, 0, 3] = 9.0
    found = closed_form.branches(nominal, T)
    assert found.summary().startswith(f"1000 poses of {nominal.name}, 999 of them reached, by ")
    assert f"{found.valid.sum()} branches" in repr(found)
    assert repr(found.arm) == f"<OrthoParallel of {nominal.name}>"
    with pytest.raises(ValueError, match="read-only"):
        found.joints[0] = 0.0
    again = pickle.loads(pickle.dumps(found))
    assert np.array_equal(again.joints, found.joints, equal_nan=True)
    assert np.array_equal(again.wrist, found.wrist, equal_nan=True)
