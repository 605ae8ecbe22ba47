"""Round numbers."""

import numpy as np
import pytest

from irbcal.units import MM
from irbcal.viewer import building


def test_round_numbers():
    assert [building.nice(v) for v in (1.0, 1.99, 2.0, 4.9, 7.0, 0.03)] == pytest.approx([1, 1, 2, 2, 5, 0.02])
    assert building.nice(3.0, up=True) == 5.0
    # 1 m of robot and 1 mm of mean error: vectors of 50 mm
    assert building.default_magnification([np.full(5, 1 * MM), np.full(5, 0.2 * MM)], 1.0) == 50.0
    assert building.scale_top([np.linspace(0, 2.3 * MM, 500), np.zeros(500)]) == pytest.approx(3 * MM)
    outlier = np.concatenate([np.linspace(0, 0.9 * MM, 1000), [80 * MM]])
    assert building.scale_top([outlier]) <= 1 * MM  # one outlier does not turn all others blue
