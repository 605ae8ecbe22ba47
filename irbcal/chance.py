"""Normal, F and Student distributions for a few numbers: loading scipy takes longer than all of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray

_SMALLEST = 1e-300


def normal_below(z: ArrayLike) -> FloatArray:
    """Share of the standard normal distribution below z, any shape."""
    return np.vectorize(lambda value: 0.5 * math.erfc(-value / math.sqrt(2.0)), otypes=[float])(z)


def normal_quantile(share: ArrayLike) -> FloatArray:
    """Where the share of the standard normal distribution below is this, above 0 and below 1; any shape."""
    from statistics import NormalDist

    return np.vectorize(NormalDist().inv_cdf, otypes=[float])(share)


def f_beyond(value: float, freedom: float, freedom_below: float) -> float:
    """Probability that an F-distributed number is above a value.

    Parameters
    ----------
    value : float
    freedom, freedom_below : float
        Degrees of freedom of numerator and denominator.

    Notes
    -----
    The regularised incomplete beta function by its continued fraction, evaluated by Lentz's method (W. H. Press and
    others, *Numerical Recipes*, section 6.4).
    """
    if not value > 0.0:
        return 1.0 if value <= 0.0 else math.nan
    x = freedom_below / (freedom_below + freedom * value)
    a, b = freedom_below / 2.0, freedom / 2.0
    front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    if x < (a + 1.0) / (a + b + 2.0):
        return math.exp(front) * _fraction(a, b, x) / a
    return 1.0 - math.exp(front) * _fraction(b, a, 1.0 - x) / b


def student_within(share: float, freedom: float) -> float:
    """Half-width of the middle interval that holds a share, above 0 and below 1, of Student's distribution."""
    low, high = 0.0, 1.0
    while f_beyond(high * high, 1.0, freedom) > 1.0 - share:
        low, high = high, 2.0 * high
    while (middle := 0.5 * (low + high)) not in (low, high):
        if f_beyond(middle * middle, 1.0, freedom) > 1.0 - share:
            low = middle
        else:
            high = middle
    return middle


def _fraction(a: float, b: float, x: float) -> float:
    c, d = 1.0, 1.0 / _away(1.0 - (a + b) * x / (a + 1.0))
    out = d
    for m in range(1, 1000):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 / _away(1.0 + term * d)
            c = _away(1.0 + term / c)
            out *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return out


def _away(value: float) -> float:
    """A number that can be divided by."""
    return value if abs(value) > _SMALLEST else _SMALLEST
