"""Path velocity by hand: straight lines with velocities that are known, and the noise of a tracker."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.validation.path_check import path_velocity, way_along

LINE = np.column_stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)])


def run(speed, step=0.01):
    """A cycle along the line at a constant speed, sampled over one metre."""
    t = np.arange(0, 1 / speed, step)
    return t, np.column_stack([speed * t, np.zeros_like(t), np.zeros_like(t)])


def test_three_constant_velocities_by_hand():
    times, paths = zip(*(run(v) for v in (0.24, 0.25, 0.27)), strict=True)
    found = path_velocity(times, paths, LINE, 0.25)
    assert found.mean == pytest.approx([0.24, 0.25, 0.27])
    mean = (0.24 + 0.25 + 0.27) / 3
    spread = np.sqrt(sum((v - mean) ** 2 for v in (0.24, 0.25, 0.27)) / 2)
    assert pytest.approx((mean - 0.25) / 0.25) == found.AV
    assert pytest.approx(3 * spread / 0.25) == found.RV
    assert pytest.approx(0.0, abs=1e-12) == found.FV
    assert path_velocity(times, paths, LINE).AV is None


def test_only_the_middle_half_counts_and_fluctuation_is_the_worst_cycle():
    # s = 0.25 t + a sin(t), so v = 0.25 + a cos(t), between 0.25 +- a over the middle half, t from 1 to 3
    t = np.arange(0, 4, 1e-3)
    ramp = np.clip(t / 0.5, 0, 1)  # starts from rest, in the first quarter
    paths = [np.column_stack([np.cumsum(ramp * (0.25 + a * np.cos(t))) * 1e-3, 0 * t, 0 * t]) for a in (0.01, 0.02)]
    found = path_velocity([t, t], paths, LINE, 0.25)
    for k, a in enumerate((0.01, 0.02)):
        middle = (paths[k][:, 0] > 0.25) & (paths[k][:, 0] < 0.75)
        v = 0.25 + a * np.cos(t[middle])
        assert found.highest[k] == pytest.approx(v.max(), abs=5e-5)
        assert found.lowest[k] == pytest.approx(v.min(), abs=5e-5)
    assert pytest.approx((found.highest - found.lowest)[1]) == found.FV


def test_a_window_takes_the_noise_of_the_tracker():
    rng = np.random.default_rng(0)
    t, path = run(0.25, 1e-3)
    noisy = [path + 2e-5 * rng.standard_normal(path.shape) for _ in range(2)]
    rough, smooth = (path_velocity([t, t], noisy, LINE, 0.25, window) for window in (0.0, 0.05))
    assert rough.FV > 0.1
    # slope of 51 samples of 20 um, 1 ms apart: 20 um sqrt(12 / 51^3) / 1 ms = 0.19 mm/s, some seven times that
    assert 0.8e-3 < smooth.FV < 2e-3
    assert abs(smooth.AV) < 1e-4


def test_way_along_a_path_with_a_corner():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    seen = np.array([[0.5, 0.01, 0], [1.02, -0.01, 0], [1.3, 0.5, 0], [1, 1.2, 0]])
    assert way_along(seen, corner) == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_too_little():
    t, path = run(0.25)
    with pytest.raises(MeasurementError, match="two cycles or more"):
        path_velocity([t], [path], LINE)
    with pytest.raises(MeasurementError, match="cycle 2 has fewer than two velocities on the middle half"):
        path_velocity([t, t[:20]], [path, path[:20]], LINE)
