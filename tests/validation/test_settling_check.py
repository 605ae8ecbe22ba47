"""Approaches from files: runs, means, and refusals."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.validation.settling import read_approaches, settle


def approaches(path, runs=(1, 2, 3), end=12.0):
    """Each run enters a band of 1 mm, leaves it once at 2 s for a peak of 1.5 mm, and stays from 2.5 s on."""
    time = np.arange(0, end, 0.5)
    rows = ["run,time_s,x_mm,y_mm,z_mm"]
    for run in runs:
        away = np.where(time < 1, 5.0, np.where(time == 2.0, 1.0 + 0.5 * run, 0.0))
        rows += [f"{run},{t},{100 + a},50,7" for t, a in zip(time, away, strict=True)]
    return written(path, "\n".join(rows) + "\n")


def test_means_over_runs(tmp_path):
    found = settle(approaches(tmp_path / "s.csv", (1, 2)), 1e-3)
    # entries on the straight line of the distance: 5 -> 0 between 0.5 and 1 s, 1.5 or 2 -> 0 between 2 and 2.5 s
    first = 0.5 + 0.5 * 4 / 5
    settled = [2 + 0.5 * 0.5 / 1.5, 2 + 0.5 * 1.0 / 2.0]
    assert [run.first_entry for run in found.runs.values()] == pytest.approx([first, first])
    assert [run.settled for run in found.runs.values()] == pytest.approx(settled)
    assert found.time == pytest.approx(np.mean(settled) - first)
    assert found.overshoot == pytest.approx(2e-3)
    data = found.to_dict()
    assert list(data) == ["check", "band_mm", "after_s", "PSt_s", "overshoot_mm", "runs", "simulated"]
    assert (data["band_mm"], data["overshoot_mm"]) == (pytest.approx(1.0), pytest.approx(2.0))
    assert data["runs"]["2"]["distance_mm"][:5] == pytest.approx([5, 5, 0, 0, 2])
    assert found.headline() == f"PSt {found.time:.2f} s (mean), overshoot 2.000 mm (largest)"
    assert found.to_frame().columns.tolist() == ["run", "time_s", "distance_mm"]
    assert len(found.to_frame()) == 2 * 24


def test_what_never_was_is_none(tmp_path):
    time = np.arange(0, 12, 0.5)
    text = "time_s,x_mm,y_mm,z_mm\n" + "".join(f"{t},{5 * (k % 2)},0,1\n" for k, t in enumerate(time))
    restless = settle(written(tmp_path / "r.csv", text), 1e-3)
    assert (restless.time, restless.overshoot) == (None, None)
    data = restless.to_dict()
    assert [data["runs"]["1"][key] for key in ("PSt_s", "first_entry_s", "settled_s", "overshoot_mm")] == [None] * 4
    assert "a run never settled, overshoot – mm" in restless.summary()


def test_one_run_needs_no_name(tmp_path):
    found = read_approaches(written(tmp_path / "one.csv", "time_s,x_mm,y_mm,z_mm\n0,1,2,3\n1,1,2,4\n"))
    assert list(found) == ["1"]
    time, xyz = found["1"]
    assert time.tolist() == [0.0, 1.0]
    assert xyz == pytest.approx(np.array([[1, 2, 3], [1, 2, 4]]) * 1e-3)


def test_refusals(tmp_path):
    path = approaches(tmp_path / "short.csv", (7,), 6.0)
    with pytest.raises(MeasurementError, match=r"short.csv: run 7: the readings end at 5.5 s") as refused:
        settle(path, 1e-3)
    assert refused.value.file == str(path)
    settle(path, 1e-3, rest=4.0)
    back = written(tmp_path / "back.csv", "run,time_s,x_mm,y_mm,z_mm\n1,0,1,1,1\n1,2,1,1,1\n1,1,1,1,1\n")
    with pytest.raises(
        MeasurementError, match="row 4, column time_s: expected a later time than in the row before, found '1'"
    ):
        settle(back, 1e-3)
    with pytest.raises(OptionError, match="above zero"):
        settle(path, 0.0)
