"""Tracker checks on small tables worked out by hand and on simulated series."""

import numpy as np
import pytest
from scipy import stats

from irbcal.errors import MeasurementError
from irbcal.validation import tracker


def written(path, text):
    path.write_text(text.replace(" ", ""))
    return path


def test_scale_bar_by_hand(tmp_path):
    path = written(
        tmp_path / "bar.csv",
        """position,end,x_mm,y_mm,z_mm
        1,A,1000,0,0
        1,B,2050.690,0,0
        1,A,1000,0,0
        1,B,2050.684,0,0
        2,A,0,500,7
        2,B,0,1550.691,7
        """,
    )
    assert tracker.kind(path) == "bar"
    found = tracker.scale_bar(path, 1.050688)
    assert found["error_mm"] == pytest.approx([0.002, -0.004, 0.003], abs=1e-9)
    assert found["mean_mm"] == pytest.approx(0.001 / 3, abs=1e-9)
    assert found["max_abs_mm"] == pytest.approx(0.004, abs=1e-9)
    assert found["per_position"]["1"]["mean_mm"] == pytest.approx(-0.001, abs=1e-9)
    assert found["per_position"]["1"]["sigma_mm"] == pytest.approx(0.006 / np.sqrt(2), abs=1e-9)
    assert found["per_position"]["2"]["n"] == 1
    with pytest.raises(MeasurementError, match="another bar"):
        tracker.scale_bar(path, 2.3)


def test_scale_bar_refusals(tmp_path):
    path = written(tmp_path / "odd.csv", "end,x_mm,y_mm,z_mm\nA,1,0,0\nB,2,0,0\nA,1,0,0\n")
    with pytest.raises(MeasurementError, match="end A was measured 2 times, end B 1 times"):
        tracker.scale_bar(path, 1e-3)
    path = written(tmp_path / "one.csv", "end,x_mm,y_mm,z_mm\nA,1,0,0\n")
    with pytest.raises(MeasurementError, match="expected two names, found A"):
        tracker.scale_bar(path, 1e-3)
    path = written(tmp_path / "d.csv", "distance_mm\n1000.001\n999.998\n")
    assert tracker.scale_bar(path, 1.0)["error_mm"] == pytest.approx([0.001, -0.002], abs=1e-9)


def test_repeatability_by_hand(tmp_path):
    path = written(
        tmp_path / "repeat.csv",
        "position,x_mm,y_mm,z_mm\nP1,1,0,9\nP1,-1,0,9\nP2,5,5,1\nP1,0,2,9\nP1,0,-2,9\nP2,5,5,3\nP2,0,0,0\n",
    )
    assert tracker.kind(path) == "repeat"
    found = tracker.repeatability(path)
    first, second = found["per_position"]["P1"], found["per_position"]["P2"]
    assert (first["n"], second["n"], found["lost"]) == (4, 2, 1)
    assert first["mean_mm"] == pytest.approx(1.5)
    assert first["mean_plus_3sigma_mm"] == pytest.approx(1.5 + 3 * np.sqrt(1 / 3))
    assert [second[k] for k in ("x_mm", "y_mm", "z_mm", "max_mm")] == pytest.approx([5, 5, 2, 1])
    with pytest.raises(MeasurementError, match="one reading only"):
        tracker.repeatability(written(tmp_path / "r1.csv", "x_mm,y_mm,z_mm\n1,2,3\n"))


def long_series(path, follow, n=1500, seed=0):
    """Simulated: 17 s apart, 5 um noise, and x following the temperature by ``follow`` um per degree."""
    rng = np.random.default_rng(seed)
    time = 17.0 * np.arange(n)
    air = 22 + np.sin(time / 9000) + 0.01 * rng.standard_normal(n)
    xyz = [1586.937, 517.974, -216.203] + 5e-3 * rng.standard_normal((n, 3))
    xyz[:, 0] += 1e-3 * follow * (air - 22)
    rows = np.column_stack([time, xyz, air, np.full(n, 768.0)])
    np.savetxt(path, rows, "%.12g", ",", header="time_s,x_mm,y_mm,z_mm,temperature_c,pressure_mmhg", comments="")
    return path, xyz, air


def test_drift_statistics_and_correlations_are_those_of_numpy(tmp_path):
    path, xyz, air = long_series(tmp_path / "d.csv", follow=8.0)
    assert tracker.kind(path) == "drift"
    found = tracker.drift(path)
    error = np.linalg.norm(xyz - xyz.mean(axis=0), axis=1)
    assert found["mean_mm"] == pytest.approx(error.mean(), abs=1e-6)
    assert found["max_mm"] == pytest.approx(error.max(), abs=1e-6)
    x = found["correlation"]["temperature_c"]["x"]
    assert x["r"] == pytest.approx(np.corrcoef(air, xyz[:, 0])[0, 1], abs=1e-4)
    assert x["told"]
    assert x["n_eff"] < 100, "a slow swing is seen a few times only, however often it is read"
    assert not found["correlation"]["temperature_c"]["y"]["told"]
    assert set(found["correlation"]["pressure_mmhg"]) == {"low", "high"}, "a constant has no correlation"
    assert found["hours"] == pytest.approx(17 * 1499 / 3600)


def test_trend_is_found(tmp_path):
    time = np.arange(0, 7200, 60.0)
    xyz = np.column_stack([100 + 0.003 * time / 3600, 200 - 0.004 * time / 3600, 300 + 0 * time])
    np.savetxt(
        tmp_path / "t.csv", np.column_stack([time, xyz]), "%.9f", ",", header="time_s,x_mm,y_mm,z_mm", comments=""
    )
    rate = tracker.drift(tmp_path / "t.csv")["rate_mm_per_hour"]
    assert [rate[k] for k in ("x", "y", "z", "total")] == pytest.approx([0.003, -0.004, 0, 0.005], abs=1e-6)


def test_correlation_interval_is_fishers_for_white_noise_and_honest_for_slow_series():
    rng = np.random.default_rng(3)
    a = rng.standard_normal(4000)
    b = 0.3 * a + rng.standard_normal(4000)
    found = tracker.correlation(a, b)
    reference = stats.pearsonr(a, b).confidence_interval()
    assert found["interval"] == pytest.approx([reference.low, reference.high], abs=0.01)
    # unrelated slow series: the textbook's interval would call about two thirds of them related
    told = []
    for _ in range(100):
        walk = rng.standard_normal((2, 600))
        for k in range(1, 600):
            walk[:, k] += 0.95 * walk[:, k - 1]
        told.append(tracker.correlation(*walk)["told"])
    assert np.mean(told) < 0.15
