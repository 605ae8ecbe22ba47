"""The last move of each joint before each pose."""

import numpy as np
import pytest

from irbcal.measurement.last_moves import last_moves


def test_the_last_move_is_kept_while_a_joint_stands_still():
    q = np.radians([[0.0, 5.0], [10.0, 5.0], [10.0, 5.001], [10.0, 2.0], [4.0, 2.0]])
    assert np.degrees(last_moves(q)[1:]) == pytest.approx(
        np.array([[10.0, np.nan], [10.0, np.nan], [10.0, -3.001], [-6.0, -3.001]]), abs=1e-12, nan_ok=True
    )
    groups = np.array(["a", "a", "b", "b", "b"], object)
    assert np.isnan(last_moves(q, groups)[[0, 2]]).all()
    assert np.isfinite(last_moves(q, groups)[4]).all()


def test_a_group_begins_with_a_move_that_is_not_known():
    q = np.arange(4.0)[:, None]
    found = last_moves(q, np.array(["a", "a", "b", "b"], dtype=object))
    assert np.array_equal(found[:, 0], [np.nan, 1.0, np.nan, 1.0], equal_nan=True)
