"""Points of a scene: errors only where there is something to compare, nothing that can be written to."""

import numpy as np
import pytest

from irbcal.viewer.scene import Points


def points(**more):
    return Points(np.zeros(2, int), np.zeros(2, int), np.zeros((2, 3)), **more)


def test_errors_need_two_sides():
    planned = points(nominal=np.ones((2, 3)))
    assert planned.error() is None
    assert planned.distance("nominal") is None
    seen = points(measured=np.full((2, 3), 2.0))
    assert seen.error("nominal") is None
    assert seen.error().tolist() == [[2.0] * 3] * 2
    np.testing.assert_allclose(seen.distance(), np.sqrt(12.0), rtol=0, atol=1e-15)


def test_points_are_locked():
    with pytest.raises(ValueError, match="read-only"):
        points().calibrated[0, 0] = 1.0
