"""Registration by references, and the base fitted again to points."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy import fft, linalg, optimize
from support import assert_same_poses, random_rotation

from irbcal.errors import MeasurementError
from irbcal.measurement import registration as registrations
from irbcal.measurement.registration import register, without_noise
from irbcal.modeling import frames

PLACES = np.array([[2.4, 0.5, -0.56], [2.9, 0.8, -0.55], [2.7, 0.0, -0.57], [2.0, 0.3, -0.5]])
NAMES = ["ref1", "ref2", "ref3", "ref4"]


def seen_from(stations):
    """The places as measured from stations, shape (n, 4, 3)."""
    return np.array([frames.apply(T, PLACES) for T in stations])


def test_motions_lead_back_to_given_places():
    rng = np.random.default_rng(2)
    stations = [frames.transform(random_rotation(rng), rng.uniform(-3, 3, 3)) for _ in range(4)]
    places = dict(zip(NAMES, PLACES, strict=True))
    found = register(seen_from(stations), NAMES, "m.csv", places)
    assert_same_poses(found.T_frame_pose, frames.inverse(np.array(stations)), 1e-12, 1e-12)
    assert found.residual < 1e-12
    assert found.with_references.all()


def test_the_residual_is_the_rms_of_what_is_left():
    stations = np.tile(np.eye(4), (5, 1, 1))
    seen = seen_from(stations)
    seen[:, 0, 2] += [1e-4, -1e-4, 1e-4, -1e-4, 0]
    places = dict(zip(NAMES, PLACES, strict=True))
    found = register(seen, NAMES, "m.csv", places)
    T = frames.rigid_fit(seen, np.broadcast_to(PLACES, seen.shape))
    left = np.einsum("nij,nkj->nki", T[:, :3, :3], seen) + T[:, None, :3, 3] - PLACES
    assert found.residual == pytest.approx(np.sqrt((left**2).sum(axis=2).mean()), abs=1e-15)
    assert 1e-6 < found.residual < 1e-4


def test_too_few_references_and_references_on_a_line():
    seen = seen_from(np.tile(np.eye(4), (3, 1, 1)))
    assert register(seen[:, :2], NAMES[:2], "m.csv") is None
    seen[:, 2:] = np.nan
    assert register(seen, NAMES, "m.csv") is None
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 1e-4, 0]]) + np.zeros((5, 1, 1))
    with pytest.raises(MeasurementError, match="lie on a line") as caught:
        register(line, NAMES[:3], "m.csv")
    assert caught.value.file == "m.csv"


def test_a_registration_is_locked_and_speaks():
    found = register(seen_from(np.tile(np.eye(4), (60, 1, 1))), NAMES, "m.csv")
    for array in (found.T_frame_pose, found.with_references, found.references["ref1"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[-1]
    with pytest.raises(TypeError):
        found.references["ref1"] = np.zeros(3)
    assert "60 of 60 poses saw three of 4 references" in repr(found)
    assert len(repr(found)) < 2000
    name, *place = found.report()[1].rows[0]
    assert name == "ref1"
    assert place == pytest.approx([2400, 500, -560], abs=1e-9)
    assert replace(pickle.loads(pickle.dumps(found)), residual=1.0).with_references.all()


def drifting(poses, drift, noise, seed):
    """SIMULATED: references and a reflector from a station that wanders, set up anew half-way; its true motion."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.standard_normal((poses, 6)), axis=0) * drift * np.r_[0.3, 0.3, 0.3, 1.0, 1.0, 1.0]
    walk[poses // 2 :] += 0.3
    T = np.tile(np.eye(4), (poses, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = frames.rotation_from_vector(walk[:, :3]), walk[:, 3:]
    seen = seen_from(frames.inverse(T))
    return seen + noise * rng.standard_normal(seen.shape), T


@pytest.mark.parametrize(("drift", "share"), [(1e-6, 0.25), (2e-5, 0.5), (2e-3, 1.02)])
def test_noise_of_the_references_is_taken_out_and_drift_is_not(drift, share):
    """What a reflector among the arm's poses moves by because of the registration, against the true motion."""
    seen, T = drifting(240, drift, 2e-5, 3)
    seen[60:64] = np.nan  # nothing seen: interpolated
    raw = register(seen, NAMES, "m.csv")
    reflector = np.array([1.5, 0.3, 0.8, 1.0])
    both = raw, without_noise(raw, seen, NAMES)
    away = [(found.T_frame_pose @ frames.inverse(T) @ reflector)[:, :3] for found in both]
    rms = [float(np.sqrt(np.mean((p - p.mean(axis=0))[np.r_[:60, 64:240]] ** 2))) for p in away]
    assert 3e-5 < rms[0] < 1e-4
    assert rms[1] < share * rms[0]


def test_a_registration_without_noise_stays():
    stations = frames.inverse(drifting(40, 1e-4, 0.0, 1)[1])
    raw = register(seen_from(stations), NAMES, "m.csv")
    assert without_noise(raw, seen_from(stations), NAMES) is raw


@pytest.mark.parametrize(("n", "drift"), [(2, 1.0), (7, 0.1), (64, 1e-3), (1001, 0.05)])
def test_the_most_probable_walk_is_that_of_scipy(n, drift):
    rng = np.random.default_rng(n)
    y = np.cumsum(drift * rng.standard_normal(n)) + rng.standard_normal(n)
    variance = rng.uniform(0.5, 1.5, n)
    r, squares = variance.mean(), fft.dct(y, norm="ortho")[1:] ** 2
    spectrum = 1.0 / (2.0 - 2.0 * np.cos(np.pi * np.arange(1, n) / n))

    def unlikely(u):
        return np.sum(np.log(r * (1 + np.exp(u) * spectrum)) + squares / (r * (1 + np.exp(u) * spectrum)))

    best = optimize.minimize_scalar(
        unlikely, bounds=registrations.LOG_RATIOS, method="bounded", options={"xatol": 1e-9}
    )
    q = r * np.exp(best.x)
    banded = np.array([np.r_[0.0, np.full(n - 1, -1 / q)], 1 / variance + np.r_[1.0, np.full(n - 2, 2.0), 1.0] / q])
    expected = linalg.solveh_banded(banded, y / variance)
    np.testing.assert_allclose(registrations._smoothed(y, variance), expected, rtol=0, atol=3e-6 * np.abs(y).max())
