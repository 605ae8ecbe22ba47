"""Correlation of two series in time, with an interval that knows that neighbours in time are alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.chance import normal_quantile


@dataclass(frozen=True)
class Correlation:
    """Correlation of two series.

    Attributes
    ----------
    r : float
        Pearson's.
    n_eff : float
        How many independent readings the series are worth.
    interval : tuple of float, or None
        Low and high end; None where ``n_eff`` is below 4.
    told : bool
        Whether the interval leaves out zero.
    """

    r: float
    n_eff: float
    interval: tuple[float, float] | None
    told: bool

    def to_dict(self) -> dict[str, Any]:
        """The same by name."""
        return {**vars(self), "interval": None if self.interval is None else list(self.interval)}


def correlation(first: FloatArray, second: FloatArray, level: float = 0.95) -> Correlation:
    """Correlation of two series and its interval.

    Slow series repeat themselves, so n readings are worth fewer: ``n_eff = n / (1 + 2 sum_k r_1(k) r_2(k))`` with the
    autocorrelations (Bartlett 1946), up to the lag at which that of the slower series is no longer positive. The
    interval is that of Fisher's z with n_eff readings; where there is none, ``n_eff`` is below 4.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
        In order of time, about evenly spaced.
    level : float

    Returns
    -------
    Correlation
    """
    a, b = first - first.mean(), second - second.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    r = float(a @ b / scale) if scale > 0 else 0.0
    own = [_autocorrelation(series) for series in (a, b)]
    end = max(int(np.argmax(c <= 0)) if (c <= 0).any() else len(c) for c in own)
    shared = float(own[0][1:end] @ own[1][1:end])
    effective = len(a) / (1 + 2 * max(0.0, shared))
    if effective < 4 or abs(r) >= 1:
        return Correlation(r, effective, None, bool(abs(r) >= 1))
    half = normal_quantile(0.5 + level / 2) / np.sqrt(effective - 3)
    low, high = (float(end) for end in np.tanh([np.arctanh(r) - half, np.arctanh(r) + half]))
    return Correlation(r, effective, (low, high), low > 0 or high < 0)


def _autocorrelation(x: FloatArray) -> FloatArray:
    """Autocorrelation of a series of mean zero at the lags 0 ... n - 1, by Fourier transform."""
    power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    c = np.fft.irfft(power)[: len(x)]
    return c / c[0] if c[0] > 0 else np.eye(1, len(x))[0]
