"""Joint readings beside programmed joints: the lag is found where it is, and nowhere else."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import validated_of

from irbcal.error_statistics import statistics
from irbcal.measurement import cleaning, table
from irbcal.measurement.points import distances
from irbcal.measurement.reading_lag import VERDICT, mixed_use, reading_lag

SIX = [f"c{k}_deg" for k in range(1, 7)]


def commands(rng, n=60, joints=6):
    return rng.uniform(-1.5, 1.5, (n, joints))


def lagged(q, rng, noise=0.0):
    """Readings behind by a share of the last move, one for all joints of a pose."""
    move = np.diff(q, axis=0, prepend=q[:1])
    share = rng.gamma(2.0, 2.5e-4, len(q))
    return q - share[:, None] * move + noise * rng.standard_normal(q.shape), share


@given(st.integers(0, 10_000), st.integers(2, 7), st.integers(12, 80))
def test_a_lag_is_found_to_the_last_digit(seed, joints, n):
    rng = np.random.default_rng(seed)
    q = commands(rng, n, joints)
    readings, share = lagged(q, rng)
    found = reading_lag(readings, q, [f"c{k + 1}_deg" for k in range(joints)])
    assert np.isnan(found.factor[0])
    np.testing.assert_allclose(found.factor[1:], share[1:], rtol=0, atol=1e-11)
    assert found.before_standstill
    assert found.explained.min() > 1 - 1e-9
    assert found.foretold_by_others > 1 - 1e-9
    np.testing.assert_allclose(found.slope, 1.0, rtol=0, atol=1e-6)


@given(st.integers(0, 10_000), st.sampled_from(["noise", "offset", "gain", "ahead", "backlash"]))
def test_what_is_no_lag_is_not_called_one(seed, kind):
    rng = np.random.default_rng(seed)
    q = commands(rng)
    move = np.diff(q, axis=0, prepend=q[:1])
    readings = {
        "noise": q + 1e-4 * rng.standard_normal(q.shape),
        "offset": q + 1e-4 * rng.standard_normal(6),
        "gain": q * (1 - 1e-4),
        "ahead": q + 3e-4 * move,
        "backlash": q - 1e-4 * rng.uniform(0.2, 1.0, 6) * np.sign(move) * rng.choice([-1, 1], len(q))[:, None],
    }[kind]
    found = reading_lag(readings, q, SIX)
    assert not found.before_standstill
    assert "it is not shown that" in " ".join(found.notes("m.csv"))


def test_a_lag_shows_through_noise_and_drowns_in_it():
    rng = np.random.default_rng(3)
    q = commands(rng, 200)
    assert reading_lag(lagged(q, rng, 1e-4)[0], q, SIX).before_standstill
    assert not reading_lag(lagged(q, rng, 2e-3)[0], q, SIX).before_standstill


def test_the_interval_of_the_slope_covers_one():
    rng = np.random.default_rng(4)
    inside = []
    for _ in range(100):
        q = commands(rng, 100)
        found = reading_lag(lagged(q, rng, 2e-5)[0], q, SIX)
        inside.append(np.abs(found.slope - 1.0) < found.slope_interval)
    assert 0.85 < np.mean(inside) <= 0.99


def test_few_poses_one_joint_and_unknown_moves_tell_nothing():
    rng = np.random.default_rng(5)
    q = commands(rng, 9)
    assert not reading_lag(lagged(q, rng)[0], q, SIX).before_standstill
    one = commands(rng, 50, 1)
    alone = reading_lag(lagged(one, rng)[0], one, SIX[:1])
    assert alone.explained[0] == pytest.approx(1.0)
    assert np.isnan(alone.foretold_by_others)
    assert not alone.before_standstill
    assert len(alone.notes("m.csv")) == 1
    q = commands(rng, 40)
    fresh = reading_lag(lagged(q, rng)[0], q, SIX, np.arange(40).astype(str).astype(object))
    assert np.isnan(fresh.factor).all()
    assert not fresh.before_standstill
    still = np.repeat(q[:1], 40, axis=0)
    assert np.isnan(reading_lag(still + 1e-4, still, SIX).factor).all()


def test_first_poses_of_groups_follow_unknown_moves():
    rng = np.random.default_rng(6)
    q = commands(rng, 40)
    readings, _ = lagged(q, rng)
    readings[20] += 1.0
    found = reading_lag(readings, q, SIX, np.array(["a"] * 20 + ["b"] * 20, dtype=object))
    assert np.flatnonzero(np.isnan(found.factor)).tolist() == [0, 20]
    assert found.before_standstill


def test_units_of_sliding_joints_and_what_is_told():
    rng = np.random.default_rng(7)
    q = commands(rng, 50, 3)
    readings = lagged(q, rng)[0]
    found = reading_lag(readings, q, ["c1_mm", "c2_deg", "c3_deg"])
    note = " ".join(found.notes("/somewhere/m.csv"))
    off = np.abs(readings - q)
    assert note.startswith(
        "The model takes the programmed joints (c1_mm …) of m.csv; its joint readings differ by up to"
    )
    assert f"{np.degrees(off[:, 1:]).max():.2g} degrees" in note
    assert f"{1e3 * off[:, 0].max():.2g} mm" in note
    assert note.endswith(f"{VERDICT}.")
    assert "The readings were taken before the arm stood still." in found.summary()
    frame = found.to_frame()
    assert list(frame.columns) == ["factor", "q1_mm_minus_command", "q2_deg_minus_command", "q3_deg_minus_command"]
    np.testing.assert_allclose(frame["q1_mm_minus_command"], 1e3 * (readings - q)[:, 0], rtol=0, atol=1e-12)
    assert found.to_dict()["before_standstill"] is True
    assert len(repr(found)) < 2000
    assert pickle.loads(pickle.dumps(found)).before_standstill
    with pytest.raises(ValueError, match="read-only"):
        found.difference[0] = 0.0


def test_readings_that_are_the_commands():
    q = commands(np.random.default_rng(8))
    found = reading_lag(q, q, SIX)
    assert found.notes("m.csv") == [
        "The model takes the programmed joints (c1_deg …) of m.csv; its joint readings are equal to them."
    ]
    assert not found.before_standstill
    assert None in found.to_dict()["explained"]


def test_mixed_use_is_said_both_ways():
    assert mixed_use(True, True, "m.csv") == mixed_use(False, False, "m.csv") == []
    assert "m.csv has joint readings only" in mixed_use(True, False, "/a/m.csv")[0]
    assert "m.csv has programmed joints" in mixed_use(False, True, "/a/m.csv")[0]


# --- a real IRB 120 ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real_file(shared_data):
    return shared_data / "irb120_laser_tracker" / "measurements_with_commands.csv"


def test_the_readings_of_the_real_robot_lag(real_file):
    seen = table.read(real_file)
    found = seen.reading_lag()
    assert found.before_standstill
    assert found.explained.min() > 0.97
    assert found.explained.max() < 0.995
    assert 0.96 < found.foretold_by_others < 0.97
    assert np.nanmedian(found.factor) == pytest.approx(0.0004, abs=2e-5)
    assert np.degrees(np.abs(found.difference).max()) == pytest.approx(0.271, abs=1e-3)
    assert any(VERDICT in note for note in cleaning.clean(seen).notes)


def test_readings_put_for_commands_tell_nothing(real_file):
    """The same poses without what distinguishes them: no verdict."""
    frame = table.read(real_file).to_frame()
    frame[[f"c{k}_deg" for k in range(1, 7)]] = frame[[f"q{k}_deg" for k in range(1, 7)]].to_numpy()
    assert not table.read(frame).reading_lag().before_standstill


@pytest.mark.parametrize(("level", "mean", "largest"), [("34", 0.165, 0.90), ("34b", 0.148, 0.50)])
def test_held_out_accuracy_with_programmed_joints(real_file, level, mean, largest):
    """Readings: 0.438/2.26 and 0.430/2.08 mm."""
    validated = validated_of(real_file, "irb120", level, holdout=296, split="last")
    assert validated.fit_points.poses == 200
    found = statistics(distances(validated.fit.robot, validated.heldout_points))
    assert found["mean_mm"] <= mean
    assert found["max_mm"] <= largest
    assert any(VERDICT in note for note in validated.notes)
