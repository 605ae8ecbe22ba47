"""Normal, F, Student's and gamma distributions, for a few numbers: loading scipy takes longer than all of them."""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray

_SMALLEST = 1e-300
NORMAL_95 = 1.96
"""Half of the interval that holds 95 % of a normal distribution, in standard deviations."""


def normal_cdf(z: ArrayLike) -> FloatArray:
    """Cumulative distribution function of the standard normal distribution at z, any shape."""
    return np.vectorize(lambda value: 0.5 * math.erfc(-value / math.sqrt(2.0)), otypes=[float])(z)


def normal_quantile(probability: ArrayLike) -> FloatArray:
    """Quantile of the standard normal distribution at a probability between 0 and 1, any shape."""
    return np.vectorize(NormalDist().inv_cdf, otypes=[float])(probability)


def f_survival(value: float, freedom: float, freedom_below: float) -> float:
    """Survival function of the F distribution: the probability of a number above a value.

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
    if x in (0.0, 1.0):
        return x
    a, b = freedom_below / 2.0, freedom / 2.0
    front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    if x < (a + 1.0) / (a + b + 2.0):
        return math.exp(front) * _fraction(a, b, x) / a
    return 1.0 - math.exp(front) * _fraction(b, a, 1.0 - x) / b


@lru_cache(maxsize=64)
def student_within(coverage: float, freedom: float) -> float:
    """Half-width of the central interval of Student's t distribution with a coverage between 0 and 1.

    Newton's method from that of the normal distribution: the probability outside is a convex function of the
    half-width, and that start is below its solution, so that no step goes too far.
    """
    half = freedom / 2.0
    scale = math.lgamma(half + 0.5) - math.lgamma(half) - 0.5 * math.log(freedom * math.pi) + math.log(2.0)
    t = NormalDist().inv_cdf(0.5 + 0.5 * coverage)
    while True:
        density = math.exp(scale - (half + 0.5) * math.log1p(t * t / freedom))
        step = (f_survival(t * t, 1.0, freedom) - (1.0 - coverage)) / density
        if not step > 1e-15 * t:
            return t
        t += step


@lru_cache(maxsize=64)
def gamma_quantile(shape: float, probability: float) -> float:
    """Quantile of the gamma distribution of unit scale at a probability between 0 and 1.

    Half the quantile of chi squared with twice the shape as degrees of freedom. Newton's method from the cube root of
    Wilson and Hilferty, which is close for shapes from a half on.
    """
    root = 1.0 - 1.0 / (9.0 * shape) + NormalDist().inv_cdf(probability) / (3.0 * math.sqrt(shape))
    x = shape * max(root, 0.05) ** 3
    for _ in range(100):
        step = (_gamma_cdf(shape, x) - probability) / math.exp((shape - 1.0) * math.log(x) - x - math.lgamma(shape))
        x = max(x - step, 0.1 * x)
        if abs(step) < 1e-14 * x:
            break
    return x


def _gamma_cdf(a: float, x: float) -> float:
    """Cumulative distribution function of the same, the regularised incomplete gamma function.

    By its series or its continued fraction (*Numerical Recipes*, 6.2).
    """
    front = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        while term > 1e-16 * total:
            a += 1.0
            term *= x / a
            total += term
        return front * total
    b, c = x + 1.0 - a, 1.0 / _SMALLEST
    d = out = 1.0 / b
    for m in range(1, 1_000_000):
        b += 2.0
        d = 1.0 / _nonzero(b - m * (m - a) * d)
        c = _nonzero(b - m * (m - a) / c)
        out *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return 1.0 - front * out


def _fraction(a: float, b: float, x: float) -> float:
    c, d = 1.0, 1.0 / _nonzero(1.0 - (a + b) * x / (a + 1.0))
    out = d
    for m in range(1, 1000):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 / _nonzero(1.0 + term * d)
            c = _nonzero(1.0 + term / c)
            out *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return out


def _nonzero(value: float) -> float:
    """The value, or the smallest number that can be divided by."""
    return value if abs(value) > _SMALLEST else _SMALLEST
