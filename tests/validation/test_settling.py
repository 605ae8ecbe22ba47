"""Stabilisation against values worked out by hand and a damped oscillation."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.validation import settling


def series(distance):
    return np.column_stack([distance, 0 * distance, 0 * distance])


def test_stabilisation_by_hand():
    time = np.arange(8.0)
    distance = np.array([10.0, 4.0, 0.0, 3.0, 2.0, 0.5, 0.2, 0.1])
    found = settling.stabilisation(time, series(distance), np.zeros(3), 1.0)
    assert found.first_entry == pytest.approx(1.75), "on the way from 4 to 0"
    assert found.settled == pytest.approx(4 + 1 / 1.5), "on the way from 2 to 0.5"
    assert found.time == pytest.approx(4 + 1 / 1.5 - 1.75)
    assert found.overshoot == found.largest == 3.0
    calm = settling.stabilisation(time, series(distance[::-1] * 0 + 0.5), np.zeros(3), 1.0)
    assert (calm.first_entry, calm.settled, calm.overshoot) == (0.0, 0.0, 0.0)
    restless = settling.stabilisation(time, series(np.array([5.0, 0, 0, 0, 0, 0, 0, 5.0])), np.zeros(3), 1.0)
    assert np.isnan(restless.settled)
    never = settling.stabilisation(time, series(distance + 5), np.zeros(3), 1.0)
    assert np.isnan(never.first_entry)


def test_stabilisation_of_a_damped_oscillation():
    """Its envelope leaves the band for the last time where the closed form says."""
    time = np.arange(0, 12, 0.001)
    decay, frequency = 1.2, 2 * np.pi * 3
    signed = 2e-3 * np.exp(-decay * time) * np.cos(frequency * time)
    xyz = series(signed) + np.array([1.0, 2.0, 3.0])
    final = settling.final_position(time, xyz, 10.0)
    assert np.abs(final - [1.0, 2.0, 3.0]).max() < 2e-8
    found = settling.stabilisation(time, xyz, final, 1e-4)
    # last half swing whose peak is above the band; then the crossing on its far side
    from scipy.optimize import brentq

    peaks = np.flatnonzero(np.abs(signed) > 1e-4)
    exact = brentq(lambda t: 2e-3 * np.exp(-decay * t) * abs(np.cos(frequency * t)) - 1e-4, *time[peaks[-1] + [0, 1]])
    assert found.settled == pytest.approx(exact, abs=2e-5)
    assert found.overshoot == pytest.approx(2e-3 * np.exp(-decay / 6), rel=0.02), "first swing to the other side"


def test_final_position_needs_late_readings():
    with pytest.raises(MeasurementError, match="end at 5 s"):
        settling.final_position(np.array([0.0, 5.0]), np.zeros((2, 3)), 10.0)


def test_final_position_is_the_mean_of_the_first_late_readings():
    """Annex V: a hundred, from ten seconds on."""
    time = np.arange(0, 20, 0.05)
    xyz = series(np.where(time < 10, 50.0, time))
    late = time[time >= 10]
    assert settling.final_position(time, xyz)[0] == pytest.approx(late[:100].mean())
    assert settling.final_position(time, xyz, 15.0, 3)[0] == pytest.approx(15.05)
    assert settling.final_position(np.array([0.0, 10.0]), series(np.array([1.0, 2.0])))[0] == 2.0, "at ten seconds, too"


def test_the_edge_of_the_band_is_inside():
    time = np.arange(4.0)
    found = settling.stabilisation(time, series(np.array([3.0, 1.0, 0.0, 1.0])), np.zeros(3), 1.0)
    assert (found.first_entry, found.settled) == (1.0, 1.0)
    assert (found.overshoot, found.largest) == (0.0, 1.0)
    assert found.instant.tolist() == time.tolist()
    with pytest.raises(ValueError, match="read-only"):
        found.distance[0] = 0.0
