"""Posing times by hand: moves that begin and end at instants that are known."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError, OptionError
from irbcal.validation.settling import posing_times


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


def test_refusals(tmp_path):
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
