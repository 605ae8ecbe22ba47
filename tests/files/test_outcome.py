"""An outcome: short in print, locked, and whole after a process boundary."""

import pickle

import numpy as np
import pytest


def test_it_is_printed_short(outcome):
    assert repr(outcome) == "<Outcome of irb1600_6_145.urdf, model 34: 42 fitted and 18 held-out poses>"


def test_its_urdf_and_fit_are_pickled(outcome):
    again = pickle.loads(pickle.dumps(outcome))
    q = outcome.urdf.arm.random_joints(20, 3)
    assert np.abs(again.fit.robot.points(q, "smr1") - outcome.fit.robot.points(q, "smr1")).max() == 0.0
    assert again.urdf.tree.getroot().get("name") == outcome.urdf.tree.getroot().get("name")
    assert np.abs(again.urdf.T_dhm_link - outcome.urdf.T_dhm_link).max() == 0.0


def test_it_cannot_be_changed(outcome):
    with pytest.raises(ValueError, match="read-only"):
        outcome.urdf.T_dhm_link[0, 0, 0] = 2.0
    assert isinstance(outcome.notes, tuple)
    assert isinstance(outcome.excluded, tuple)
