"""Figures of pose errors show what was measured."""

import numpy as np
import pytest


def test_normal_quantiles_of_normal_errors_lie_on_a_line():
    from irbcal.figures.pose_errors import normal_quantiles

    value = np.random.default_rng(1).normal(3.0, 0.5, 5000)
    quantile, shown = normal_quantiles(value)
    assert len(shown) < 250
    assert shown[-1] == value.max()
    assert np.polyfit(quantile, shown, 1) == pytest.approx([0.5, 3.0], abs=0.02)
