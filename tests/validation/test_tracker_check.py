"""The door to the checks of the tracker: which check a file is for, and options."""

import pickle
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.validation.settling import Settling
from irbcal.validation.tracker_check import (
    CHECKS,
    PointDrift,
    PointRepeatability,
    ScaleBar,
    correlation,
    drift,
    kind,
    repeatability,
    scale_bar,
    tracker,
)

N = 60
X, Y, Z = np.round(np.random.default_rng(0).normal(0, 0.004, (3, N)), 6)
END = np.tile(["A", "B"], N // 2)
TIME = np.tile(np.arange(20) * 0.75, 3)
TABLES = {
    "bar": {"end": END, "x_mm": X + 1000 * (END == "B"), "y_mm": Y, "z_mm": Z},
    "repeat": {"x_mm": X + 900, "y_mm": Y, "z_mm": Z},
    "drift": {"time_s": 17 * np.arange(N), "x_mm": X + 5, "y_mm": Y, "z_mm": Z, "temperature_c": 22 + X},
    "settle": {
        "run": np.repeat([1, 2, 3], 20),
        "time_s": TIME,
        "x_mm": 1 + np.exp(-2 * TIME),
        "y_mm": 0 * Y + 3,
        "z_mm": 0 * Z,
    },
}
KINDS = {"bar": ScaleBar, "repeat": PointRepeatability, "drift": PointDrift, "settle": Settling}


def file_of(folder, name):
    pd.DataFrame(TABLES[name]).to_csv(folder / f"{name}.csv", index=False)
    return folder / f"{name}.csv"


@pytest.mark.parametrize("name", CHECKS)
def test_the_columns_tell_which_check(name, tmp_path):
    path = file_of(tmp_path, name)
    assert kind(path) == name
    found = tracker(path, length=1.0)
    assert isinstance(found, KINDS[name])
    assert found.to_dict()["check"] == name
    assert len(found.to_frame()) == (N // 2 if name == "bar" else N)
    assert len(repr(found)) < 2000
    assert found.headline()
    assert found._repr_html_().startswith("<div>")
    assert pickle.loads(pickle.dumps(found)).to_dict() == found.to_dict()
    assert found.plot().content("png").startswith(b"\x89PNG")


@pytest.mark.parametrize("name", CHECKS)
def test_frames_serve_as_files_do(name, tmp_path):
    from_file, from_frame = (
        tracker(source, length=1.0) for source in (file_of(tmp_path, name), pd.DataFrame(TABLES[name]))
    )
    assert from_frame.to_dict() == from_file.to_dict()


@pytest.mark.parametrize("name", CHECKS)
def test_simulated_readings_are_named(name):
    readings = pd.DataFrame(TABLES[name])
    simulated, measured = (tracker(readings.assign(simulated=answer), length=1.0) for answer in ("yes", "no"))
    assert simulated.simulated
    assert simulated.to_dict()["simulated"]
    assert simulated.headline() == f"SIMULATED data: {measured.headline()}"
    assert simulated.plot().mark
    assert not measured.simulated
    assert not measured.to_dict()["simulated"]
    assert not measured.plot().mark


def test_options(tmp_path):
    path = file_of(tmp_path, "settle")
    assert tracker(path).band == 2e-5
    assert tracker(path, band=1e-3, rest=3.0).at_rest_after == 3.0
    assert isinstance(tracker(path, check="repeat"), PointRepeatability), "if that is what is asked for"
    with pytest.raises(OptionError, match="certified length") as refused:
        tracker(file_of(tmp_path, "bar"))
    assert refused.value.parameter == "length"
    with pytest.raises(OptionError, match="check: expected bar, repeat, drift or settle, found 'ball'"):
        tracker(path, check="ball")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"length": 1050.688}, "metres expected, at most 100, found 1050.69: this looks like millimetres"),
        ({"length": "1"}, "expected a number, found '1'"),
        ({"band": 200}, "looks like millimetres"),
        ({"rest": -1}, "at least 0, found -1"),
    ],
)
def test_sizes_are_numbers_in_metres(tmp_path, options, words):
    with pytest.raises(OptionError, match=words) as refused:
        tracker(file_of(tmp_path, "bar"), **options)
    assert refused.value.parameter == next(iter(options))


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
    found = scale_bar(path, 1.050688).to_dict()
    assert found["error_mm"] == pytest.approx([0.002, -0.004, 0.003], abs=1e-9)
    assert found["mean_mm"] == pytest.approx(0.001 / 3, abs=1e-9)
    assert found["max_abs_mm"] == pytest.approx(0.004, abs=1e-9)
    assert found["per_position"]["1"]["mean_mm"] == pytest.approx(-0.001, abs=1e-9)
    assert found["per_position"]["1"]["sigma_mm"] == pytest.approx(0.006 / np.sqrt(2), abs=1e-9)
    assert found["per_position"]["2"]["n"] == 1
    with pytest.raises(MeasurementError, match="another bar"):
        scale_bar(path, 2.3)


def test_scale_bar_refusals(tmp_path):
    path = written(tmp_path / "odd.csv", "end,x_mm,y_mm,z_mm\nA,1,0,0\nB,2,0,0\nA,1,0,0\n")
    with pytest.raises(MeasurementError, match="end A has 2 readings, end B has 1 reading, lost ones included"):
        scale_bar(path, 1e-3)
    path = written(tmp_path / "one.csv", "end,x_mm,y_mm,z_mm\nA,1,0,0\n")
    with pytest.raises(MeasurementError, match="expected two names, found A"):
        scale_bar(path, 1e-3)
    path = written(tmp_path / "d.csv", "distance_mm\n1000.001\n999.998\n")
    assert scale_bar(path, 1.0).to_dict()["error_mm"] == pytest.approx([0.001, -0.002], abs=1e-9)


def test_lost_readings_do_not_pair_the_ends_of_different_places(tmp_path):
    """One bar at eight places of a file that does not name them: B of the second and A of the fifth are lost."""
    rng = np.random.default_rng(2)
    first, turn = rng.uniform(-500.0, 500.0, (8, 3)), rng.normal(size=(8, 3))
    second = first + 1000.0 * turn / np.linalg.norm(turn, axis=1, keepdims=True)
    rows = pd.DataFrame(np.hstack([first, second]).reshape(-1, 3), columns=["x_mm", "y_mm", "z_mm"])
    rows.insert(0, "end", ["A", "B"] * 8)
    rows.loc[3, ["x_mm", "y_mm", "z_mm"]] = np.nan
    rows.loc[8, ["x_mm", "y_mm", "z_mm"]] = 0.0
    found = scale_bar(rows, 1.0)
    assert (len(found.error), found.lost, found.to_dict()["lost"]) == (6, 2, 2)
    assert np.abs(found.error).max() < 1e-9
    assert found.report()[-1] == "Left out: 2 distances with a lost reading"
    alone = scale_bar(rows[:4], 1.0)
    assert alone.headline().startswith("1 distance of a scale bar")
    assert alone.to_dict()["sigma_mm"] is None
    assert alone.report()[1].cells()[0][3] == "–"
    with pytest.raises(MeasurementError, match="every distance lacks a reading"):
        scale_bar(rows[2:4], 1.0)


def test_an_end_that_was_measured_again_is_paired_with_its_position_or_refused():
    """A bar at three places; A of the second was measured again, and B of the third: as many readings of each end."""
    rows = pd.DataFrame(
        [(end, x, y, 5.0, n) for n, y in enumerate((100.0, 500.0, 900.0), 1) for end, x in (("A", 7.0), ("B", 1007.0))],
        columns=["end", "x_mm", "y_mm", "z_mm", "position"],
    )
    again = rows.iloc[[0, 1, 2, 3, 2, 4, 5, 5]].reset_index(drop=True)
    with pytest.raises(MeasurementError, match="position 2: end A has 2 readings, end B has 1 reading"):
        scale_bar(again, 1.0)
    with pytest.raises(MeasurementError, match=r"near 1000\.000 mm.*found 1077\.033 mm: .* column position") as refused:
        scale_bar(again.drop(columns="position"), 1.0)
    assert refused.value.row == 7  # A of the second place, again, with B of the third
    with pytest.raises(MeasurementError, match=r"found 1077\.033 mm") as refused:
        scale_bar(pd.DataFrame({"distance_mm": [1000.0, 999.999, 1077.033]}), 1.0)
    assert refused.value.row == 3
    both = scale_bar(rows.iloc[[0, 1, 2, 3, 2, 3, 4, 5]], 1.0)
    assert np.abs(both.error).max() < 1e-12
    assert [both.per_position[name]["n"] for name in both.positions()] == [1, 2, 1]


def test_what_a_scale_bar_tells(tmp_path):
    path = written(tmp_path / "d.csv", "position,distance_mm\nA,1000.001\nA,999.998\nB,1000.002\nB,1000\n")
    found = scale_bar(path, 1.0)
    assert found.positions() == ["A", "B"]
    assert found.to_frame()["error_mm"].tolist() == pytest.approx([0.001, -0.002, 0.002, 0.0], abs=1e-9)
    assert repr(found) == "<ScaleBar: 4 distances of a scale bar: errors of +0.0003 mm on average, 0.0020 mm at most.>"
    lines = found.summary().splitlines()
    assert "scale bar of 1000 mm, mm" in lines[1]
    assert lines[-1].split() == ["B", "2", "0.0010", "0.0014", "0.0020", "0.0014"]
    with pytest.raises(ValueError, match="read-only"):
        found.error[0] = 0.0
    with pytest.raises(OptionError, match="above zero"):
        scale_bar(path, 0.0)
    with pytest.raises(
        MeasurementError, match="row 3, column distance_mm: expected a number, found nothing"
    ) as refused:
        scale_bar(written(tmp_path / "gap.csv", "position,distance_mm\nA,1000.001\nA,\n"), 1.0)
    assert (refused.value.row, refused.value.column) == (3, "distance_mm")


def test_repeatability_by_hand(tmp_path):
    path = written(
        tmp_path / "repeat.csv",
        "position,x_mm,y_mm,z_mm\nP1,1,0,9\nP1,-1,0,9\nP2,5,5,1\nP1,0,2,9\nP1,0,-2,9\nP2,5,5,3\nP2,0,0,0\n",
    )
    found = repeatability(path).to_dict()
    first, second = found["per_position"]["P1"], found["per_position"]["P2"]
    assert (first["n"], second["n"], found["lost"]) == (4, 2, 1)
    assert first["mean_mm"] == pytest.approx(1.5)
    assert first["mean_plus_3sigma_mm"] == pytest.approx(1.5 + 3 * np.sqrt(1 / 3))
    assert [second[k] for k in ("x_mm", "y_mm", "z_mm", "max_mm")] == pytest.approx([5, 5, 2, 1])
    one = repeatability(written(tmp_path / "one.csv", "x_mm,y_mm,z_mm\n1,2,3\n1,2,5\n")).headline()
    assert one.startswith("2 readings of 1 point: ")
    with pytest.raises(MeasurementError, match="one reading only"):
        repeatability(written(tmp_path / "r1.csv", "x_mm,y_mm,z_mm\n1,2,3\n"))


def test_what_repeatability_tells(tmp_path):
    text = "position,x_mm,y_mm,z_mm\nP1,1,0,9\nP1,-1,0,9\nP2,5,5,1\nP2,5,5,5\nP2,0,0,0\n"
    found = repeatability(written(tmp_path / "r.csv", text))
    assert (
        found.headline() == "4 readings of 2 points: mean + 3σ of the distances from the mean 2.0000 mm at most (P2)."
    )
    assert found.report()[-1] == "Left out: 1 lost reading"
    table = found.to_frame()
    assert table.columns.tolist() == ["position", "x_mm", "y_mm", "z_mm", "error_mm"]
    assert table["error_mm"].tolist() == pytest.approx([1, 1, 2, 2])
    assert len(repr(found)) < 2000


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
    assert x["significant"]
    assert x["n_eff"] < 100, "a slow swing is seen a few times only, however often it is read"
    assert not found["correlation"]["temperature_c"]["y"]["significant"]
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
        *("hours", "error_mm", "dx_mm", "dy_mm", "dz_mm", "temperature_c", "pressure_mmhg")
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


def test_correlation_interval_is_fishers_for_white_noise_and_honest_for_slow_series():
    rng = np.random.default_rng(3)
    a = rng.standard_normal(4000)
    b = 0.3 * a + rng.standard_normal(4000)
    interval = correlation(a, b).interval
    reference = stats.pearsonr(a, b).confidence_interval()
    assert interval == pytest.approx([reference.low, reference.high], abs=0.01)
    # unrelated slow series: the textbook's interval would call about two thirds of them related
    told = []
    for _ in range(100):
        walk = rng.standard_normal((2, 600))
        for k in range(1, 600):
            walk[:, k] += 0.95 * walk[:, k - 1]
        told.append(correlation(*walk).significant)
    assert np.mean(told) < 0.15
