"""From which side each joint came."""

import numpy as np

from irbcal.measurement.last_moves import STILL, last_moves

NAN = np.nan


def test_a_joint_that_stands_still_keeps_its_last_move():
    q = np.array([[0.0, 0.0], [0.1, 0.0], [0.1 + STILL / 2, -0.2], [0.0, -0.2]])
    found = last_moves(q)
    assert np.isnan(found[0]).all()
    assert np.array_equal(np.isnan(found[1]), [False, True])
    assert np.abs(found[1:, 0] - [0.1, 0.1, -0.1 - STILL / 2]).max() < 1e-12
    assert np.abs(found[2:, 1] - [-0.2, -0.2]).max() < 1e-12


def test_a_group_begins_with_a_move_that_is_not_known():
    q = np.arange(4.0)[:, None]
    found = last_moves(q, np.array(["a", "a", "b", "b"], dtype=object))
    assert np.array_equal(found[:, 0], [NAN, 1.0, NAN, 1.0], equal_nan=True)
