"""Stabilisation against values worked out by hand and a damped oscillation."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.validation import settling
from irbcal.validation.settling import posing_times, settle


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
    path = written(tmp_path / "one.csv", "time_s,x_mm,y_mm,z_mm\n0,1,2,3\n1,1,2,4\n2,1,2,4\n")
    run = settle(path, 0.5e-3, rest=1.0).runs
    assert list(run) == ["1"]
    assert run["1"].instant.tolist() == [0.0, 1.0, 2.0]
    assert run["1"].distance == pytest.approx([1e-3, 0.0, 0.0])


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


def moves(path, cycles=((1.0, 2.0), (1.0, 2.1)), length=100.0, extra="", swing=0.0):
    """Moves along x at constant speed between two instants, with a swing after arriving, sampled at 1 kHz, in mm."""
    t = np.arange(0, 4, 1e-3)
    lines = [f"move,cycle,time_s,x_mm,y_mm,z_mm{extra and ',simulated'}"]
    for c, (start, end) in enumerate(cycles, 1):
        x = length * np.clip((t - start) / (end - start), 0, 1)
        x = x + swing * np.exp(-10 * (t - end)) * np.sin(20 * np.pi * (t - end)) * (t > end)
        lines += [f"long,{c},{a:.3f},{b:.9f},5,7{extra}" for a, b in zip(t, x, strict=True)]
    return written(path, "\n".join(lines))


def test_a_constant_speed_leaves_and_reaches_the_bands_when_it_must(tmp_path):
    found = posing_times(moves(tmp_path / "m.csv"), 1e-3)
    # 1 mm of 100 mm at either end: 0.98 of the time between
    assert found.moves["long"].times == pytest.approx([0.98, 0.98 * 1.1], abs=1e-5)
    assert found.moves["long"].departure == pytest.approx([1.01, 1.011], abs=1e-5)
    assert found.to_frame()["distance_mm"].tolist() == pytest.approx([100.0], abs=0.02)
    assert "Posing time from rest to rest, limit band 1 mm" in found.summary()
    assert "SIMULATED" not in repr(found)


def test_settling_is_part_of_it_and_simulated_data_are_named(tmp_path):
    found = posing_times(moves(tmp_path / "m.csv", ((1.0, 2.0),), extra=",yes", swing=5.0), 1e-3)
    late = np.arange(2.0, 2.6, 1e-5)
    swing = np.abs(5.0 * np.exp(-10 * (late - 2)) * np.sin(20 * np.pi * (late - 2)))
    settled = late[np.flatnonzero(swing > 1.0)[-1]]
    assert found.moves["long"].arrival == pytest.approx([settled], abs=1e-3)
    assert repr(found).startswith("<PosingTimes: SIMULATED data: posing times of 1 moves")
    assert found.to_dict()["simulated"]
    assert found.to_dict()["moves"][0]["angle_deg"] is None
    assert "SIMULATED data" in found.plot().svg()


def test_the_turn_is_told_where_it_was_measured(tmp_path):
    half = np.radians(15.0)
    rows = ["move,time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz"]
    for k, t in enumerate(np.arange(0, 2, 0.1)):
        x, q = (0, "1,0,0,0") if k < 8 else (50, f"{np.cos(half):.15g},0,0,{np.sin(half):.15g}")
        rows.append(f"a,{t:.1f},{x},1,1,{q}")
    found = posing_times(written(tmp_path / "m.csv", "\n".join(rows)), 1e-3)
    assert found.to_frame()["angle_deg"].tolist() == pytest.approx([30.0])


def test_refusals_of_posing_time(tmp_path):
    file = moves(tmp_path / "m.csv", ((1.0, 2.0),))
    with pytest.raises(MeasurementError, match=r"row 2: move long: it goes .* mm far, no farther than twice"):
        posing_times(file, 0.2)
    with pytest.raises(MeasurementError, match=r"3 readings or more at rest .* found 1 within the limit band of 1 mm"):
        posing_times(moves(tmp_path / "n.csv", ((-0.5, 2.0),), 10000.0), 1e-3)
    text = file.read_text().splitlines()
    back = written(tmp_path / "b.csv", "\n".join([*text[:3], text[2], *text[3:]]))
    with pytest.raises(MeasurementError, match=r"row 4, column time_s: expected a later time"):
        posing_times(back, 1e-3)
    with pytest.raises(OptionError, match=r"above zero"):
        posing_times(file, 0.0)
