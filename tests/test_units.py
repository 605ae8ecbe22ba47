"""The only conversion factors."""

import numpy as np
import pytest

from irbcal import units


def test_factors_take_surface_values_to_si():
    assert pytest.approx(0.65, abs=1e-15) == 650 * units.MM
    assert np.pi == 180 * units.DEG
    assert {si: (name, factor) for si, (name, factor) in units.UNIT_OUTSIDE.items()} == {
        "m": ("mm", units.MM),
        "rad": ("deg", units.DEG),
        "1": ("1", 1.0),
    }
