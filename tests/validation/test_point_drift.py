"""Drift of a fixed target on simulated series."""

import re

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError
from irbcal.validation.tracker_check import drift


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
    found = drift(path).to_dict()
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
    rate = drift(tmp_path / "t.csv").to_dict()["rate_mm_per_hour"]
    assert [rate[k] for k in ("x", "y", "z", "total")] == pytest.approx([0.003, -0.004, 0, 0.005], abs=1e-6)


def test_time_goes_on_whatever_the_order_of_the_rows(tmp_path):
    path, *_ = long_series(tmp_path / "d.csv", follow=8.0, n=40)
    header, *rows = path.read_text().splitlines()
    mixed = written(tmp_path / "m.csv", "\n".join([header, *rows[20:], *rows[:20]]))
    first, second = drift(path), drift(mixed)
    assert second.to_dict() == first.to_dict()
    assert second.time.tolist() == (17.0 * np.arange(40)).tolist()


def test_what_drift_tells(tmp_path):
    found = drift(long_series(tmp_path / "d.csv", follow=8.0)[0])
    assert found.headline().startswith("1500 readings over 7.08 hours: error mean 0.00")
    text = found.summary()
    assert re.search(r"pressure_mmhg +constant", text)
    assert "Of twenty such intervals" in text
    assert found.to_frame().columns.tolist() == [
        *("hours", "error_mm", "dx_mm", "dy_mm", "dz_mm", "temperature_c", "pressure_mmhg"),
    ]
    assert found.air["pressure_mmhg"].tolist() == [768.0] * 1500


def test_refusals(tmp_path):
    rows = "".join(f"{k},1,2,{k},smr1\n" for k in range(12))
    header = "time_s,x_mm,y_mm,z_mm,target\n"
    with pytest.raises(MeasurementError, match="9 readings are too few"):
        drift(written(tmp_path / "few.csv", header + "".join(f"{k},1,2,{k},a\n" for k in range(9))))
    with pytest.raises(
        MeasurementError, match="column target: expected the readings of one fixed target, found smr1, smr2"
    ):
        drift(written(tmp_path / "two.csv", header + rows + "13,1,2,3,smr2\n"))
    with pytest.raises(MeasurementError, match="column time_s: all readings are of the same time"):
        drift(written(tmp_path / "still.csv", header + 12 * "5,1,2,3,a\n"))
