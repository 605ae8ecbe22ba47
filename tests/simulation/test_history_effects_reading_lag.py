"""The effect reading_lag: off in the shipped cells; on, readings lag and nothing else changes."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.simulation.effects import ALL, EFFECTS, MORE
from irbcal.simulation.history_effects import ReadingLag


def test_it_is_off_unless_asked_for(cell, q):
    assert "reading_lag" not in cell.on
    assert cell.measure(q).readings is None
    assert set(ALL) == {*EFFECTS, *MORE}
    assert cell.also("reading_lag").on == (*cell.on, "reading_lag")
    assert cell.also("noise").on == cell.on
    assert cell.also("reading_lag").without("reading_lag").on == cell.on
    with pytest.raises(MeasurementError, match="unknown effect 'lag'"):
        cell.also("lag")


def test_the_arm_and_the_points_stay_as_they_were(cell, q):
    plain, lagging = cell.measure(q), cell.also("reading_lag").measure(q)
    np.testing.assert_array_equal(lagging.xyz, plain.xyz)
    np.testing.assert_array_equal(lagging.T_base_tip, plain.T_base_tip)
    np.testing.assert_array_equal(lagging.q, plain.q)
    again = cell.also("reading_lag").measure(q)
    np.testing.assert_array_equal(again.readings, lagging.readings)


def test_readings_are_behind_by_one_share_of_the_last_move(cell, q):
    exact = cell.with_effect(ReadingLag(scatter_deg=0.0)).measure(q)
    move = np.diff(q, axis=0, prepend=np.zeros((1, 6)))
    share = (exact.q - exact.readings) / move
    np.testing.assert_allclose(share, share[:, :1] * np.ones(6), rtol=0, atol=1e-9)
    lag = np.degrees(share[:, 0] * np.abs(move).max(axis=1))
    assert share.min() >= 0
    assert np.median(lag) == pytest.approx(0.041, rel=0.12)
    low, high = np.percentile(lag, [25, 75])
    assert low == pytest.approx(0.0235, rel=0.2)
    assert high == pytest.approx(0.066, rel=0.2)


def test_no_reading_is_behind_the_stop_before(cell):
    still = np.zeros((20, 6))
    still[::2, 0] = 1e-6
    run = cell.with_effect(ReadingLag(scatter_deg=0.0)).measure(still)
    assert run.readings.min() >= 0
    assert run.readings.max() <= 1e-6


def test_simulated_files_have_commands_beside_readings(tmp_path):
    plain = irbcal.simulate("irb1600", random=40, seed=5)
    lagging = irbcal.simulate("irb1600", random=40, seed=5, also=["reading_lag"])
    assert not any(name.startswith("c1") for name in plain.to_frame().columns)
    assert plain.to_frame()["x_mm"].equals(lagging.to_frame()["x_mm"])
    measured, truth = lagging.save(tmp_path / "m.csv")
    seen = table.read(measured)
    np.testing.assert_allclose(seen.joints(), lagging.poses.q, rtol=0, atol=1e-8)
    assert seen.reading_lag().before_standstill
    assert '"reading_lag"' in truth.read_text()
    alone = irbcal.simulate("irb1600", lagging.poses.q, only=["reading_lag"])
    assert alone.cell.on == ("reading_lag",)
    assert irbcal.simulate("irb1600", random=3, only=["noise"], also=["reading_lag"]).cell.on == (
        "noise",
        "reading_lag",
    )


def test_a_plan_with_programmed_joints_commands_them():
    made = irbcal.simulate("irb1600", random=10, also=["reading_lag"], targets=1).to_frame()
    rows = made[made["target"] == "smr1"]
    again = irbcal.simulate("irb1600", rows[["pose", *[n for n in made.columns if n[0] in "qc" and n[1].isdigit()]]])
    np.testing.assert_allclose(np.degrees(again.poses.q[:, 0]), rows["c1_deg"], rtol=0, atol=1e-9)
