"""Bootstrap intervals against recomputation by numpy, scipy's BCa, and their own promise."""

import numpy as np
import pytest
from scipy import stats

from irbcal.statistics import statistics
from irbcal.validation import accuracy
from irbcal.validation.accuracy import percentiles


def errors_by_pose(rng, poses=30, spread=0.3):
    """Distances (m) of one to three points of each pose, alike within a pose."""
    pose = np.repeat(np.arange(poses), rng.integers(1, 4, poses))
    level = rng.gamma(4, 1e-4, poses)
    return level[pose] * (1 + spread * rng.random(len(pose))), pose


def test_every_resample_is_recomputed_by_numpy():
    """The ends of the percentile intervals are those of resamples drawn point by point and given to numpy."""
    distance, pose = errors_by_pose(np.random.default_rng(0))
    found = accuracy.intervals(distance, pose, resamples=50, seed=3)
    counts = np.concatenate(list(accuracy.draws(30, 50, 3)))
    assert (counts.sum(axis=1) == 30).all()
    resamples = [np.repeat(distance, count[pose]) for count in counts]
    for key in ("p50_mm", "p90_mm", "p95_mm", "p99_mm"):
        values = [percentiles(sample)[key] for sample in resamples]
        assert found[key] == pytest.approx(np.percentile(values, [2.5, 97.5]), abs=1e-12)
    for key in accuracy.MOMENTS:
        values = np.array([statistics(sample)[key] for sample in resamples])
        jackknife = np.array([statistics(distance[pose != k])[key] for k in range(30)])
        expected = accuracy.bca(values, statistics(distance)[key], jackknife)
        assert found[key] == pytest.approx(expected, abs=1e-11)


def test_bca_is_that_of_scipy():
    values = np.random.default_rng(1).gamma(2, 1.0, 40)
    reference = stats.bootstrap(
        (values,), np.mean, n_resamples=20000, method="BCa", rng=np.random.default_rng(2)
    ).confidence_interval
    found = accuracy.difference(values, resamples=20000, seed=4)
    assert found == pytest.approx([reference.low, reference.high], abs=0.02), "both are random to about 0.01"


def test_same_seed_same_interval_whatever_the_block():
    distance, pose = errors_by_pose(np.random.default_rng(5))
    first = accuracy.intervals(distance, pose, resamples=200, seed=1)
    assert first == accuracy.intervals(distance, pose, resamples=200, seed=1)
    assert first != accuracy.intervals(distance, pose, resamples=200, seed=2)


def test_blocks_do_not_change_the_draws(monkeypatch):
    whole = np.concatenate(list(accuracy.draws(20, 30, 7)))
    monkeypatch.setattr(accuracy, "BLOCK", 45)
    parts = list(accuracy.draws(20, 30, 7))
    assert len(parts) == 15
    assert (np.concatenate(parts) == whole).all()


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Three points of a pose share its error: drawing points instead of poses would hold the mean in 75 % only."""
    rng = np.random.default_rng(8)
    truth = 4e-4 * 1e3
    held = []
    for _ in range(150):
        level = rng.gamma(4, 1e-4, 40)
        low, high = accuracy.intervals(np.repeat(level, 3), np.repeat(np.arange(40), 3), 300, 0)["mean_mm"]
        held.append(low <= truth <= high)
    assert 0.88 <= np.mean(held) <= 0.99


def test_too_few_poses_have_no_interval():
    assert accuracy.intervals(np.ones(27) * 1e-3, np.repeat(np.arange(9), 3)) is None
    assert accuracy.difference(np.ones(9)) is None


def test_equal_errors_have_an_interval_without_width():
    found = accuracy.intervals(np.full(20, 1e-3), np.arange(20), 50)
    assert found["mean_mm"] == pytest.approx([1.0, 1.0])
    assert found["sigma_mm"] == pytest.approx([0.0, 0.0])


def test_a_part_of_many_poses_tells_the_interval_of_all(monkeypatch):
    rng = np.random.default_rng(3)
    pose = np.repeat(np.arange(3000), 3)
    d = np.abs(rng.normal(1e-4, 3e-5, len(pose)) + rng.normal(0, 2e-5, 3000)[pose])
    monkeypatch.setattr(accuracy, "MOST_DRAWN", 10**6)
    whole, change = accuracy.intervals(d, pose, 1000), accuracy.difference(d[::3], 1000)
    monkeypatch.setattr(accuracy, "MOST_DRAWN", 500)
    part, some = accuracy.intervals(d, pose, 1000), accuracy.difference(d[::3], 1000)
    for name in ("mean_mm", "sigma_mm", "rms_mm", "p95_mm"):
        width = whole[name][1] - whole[name][0]
        assert np.abs(np.subtract(part[name], whole[name])).max() < 0.35 * width
    assert np.abs(np.subtract(some, change)).max() < 0.35 * (change[1] - change[0])
