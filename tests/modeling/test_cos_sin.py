"""Cosines and sines against mpmath, by the compiled kernel and by numpy."""

import mpmath
import numpy as np
import pytest

from irbcal import kernel
from irbcal.modeling.cos_sin import cos_sin


@pytest.fixture(autouse=True, params=["as installed", "numpy"])
def path(request, monkeypatch):
    if request.param == "numpy":
        monkeypatch.setattr(kernel, "Kernel", None)


def test_against_mpmath():
    rng = np.random.default_rng(1)
    quarters = np.pi / 2 * np.arange(-40, 41)
    small = 10.0 ** rng.uniform(-18, -1, 100)
    angles = np.concatenate([rng.uniform(-1e4, 1e4, 2000), rng.uniform(-7, 7, 1000), small, -small])
    angles = np.concatenate([angles, quarters, np.nextafter(quarters, 1e9), 2**14 * quarters])
    cosine, sine = cos_sin(angles)
    with mpmath.workdps(40):
        exact = [(float(mpmath.cos(mpmath.mpf(x))), float(mpmath.sin(mpmath.mpf(x)))) for x in angles.tolist()]
    assert np.abs(np.array([cosine, sine]).T - exact).max() < 3e-16
    tiny = slice(3000, 3200)
    assert np.abs(sine[tiny] / np.array(exact)[tiny, 1] - 1.0).max() < 5e-16  # small angles keep their digits


def test_quarter_turns_and_shapes():
    c, s = cos_sin(np.pi / 2 * np.arange(5).reshape(1, 5))
    assert np.array_equal(np.round(c, 15) + 0.0, [[1, 0, -1, 0, 1]])
    assert np.array_equal(np.round(s, 15) + 0.0, [[0, 1, 0, -1, 0]])
    assert cos_sin(np.zeros(3))[0].tolist() == [1.0, 1.0, 1.0]
    with np.errstate(invalid="ignore"):
        assert np.isnan(cos_sin(np.array([np.nan, np.inf]))).all()
    assert np.array_equal(
        cos_sin(np.arange(40.0).reshape(5, 8).T), np.transpose(cos_sin(np.arange(40.0).reshape(5, 8)), (0, 2, 1))
    )
    assert [value.shape for value in cos_sin(0.5)] == [(), ()]
