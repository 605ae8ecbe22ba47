"""Statistics: Normal, F, Student and gamma distributions for a few numbers, and the statistics of errors.

Loading scipy takes longer than all of the distributions. Statistics of errors are those of Nubiola 2011, section 7.7.
"""

from __future__ import annotations

import math
from collections.abc import KeysView, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.section import Section
from irbcal.units import DEG, MM

_SMALLEST = 1e-300
NORMAL_95 = 1.96
"""Half of the interval that holds 95 % of a normal distribution, in standard deviations."""


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
    if x in (0.0, 1.0):
        return x
    a, b = freedom_below / 2.0, freedom / 2.0
    front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    if x < (a + 1.0) / (a + b + 2.0):
        return math.exp(front) * _fraction(a, b, x) / a
    return 1.0 - math.exp(front) * _fraction(b, a, 1.0 - x) / b


@lru_cache(maxsize=64)
def student_within(share: float, freedom: float) -> float:
    """Half-width of the middle interval that holds a share, above 0 and below 1, of Student's distribution.

    Newton's method from that of the normal distribution: the share beyond is a convex function of the half-width, and
    that start is below its solution, so that no step goes too far.
    """
    from statistics import NormalDist

    half = freedom / 2.0
    scale = math.lgamma(half + 0.5) - math.lgamma(half) - 0.5 * math.log(freedom * math.pi) + math.log(2.0)
    t = NormalDist().inv_cdf(0.5 + 0.5 * share)
    while True:
        density = math.exp(scale - (half + 0.5) * math.log1p(t * t / freedom))
        step = (f_beyond(t * t, 1.0, freedom) - (1.0 - share)) / density
        if not step > 1e-15 * t:
            return t
        t += step


@lru_cache(maxsize=64)
def gamma_quantile(shape: float, share: float) -> float:
    """Where the share of the gamma distribution of unit scale below is this, above 0 and below 1.

    Half the quantile of chi squared with twice the shape as degrees of freedom. Newton's method from the cube root of
    Wilson and Hilferty, which is close for shapes from a half on.
    """
    from statistics import NormalDist

    root = 1.0 - 1.0 / (9.0 * shape) + NormalDist().inv_cdf(share) / (3.0 * math.sqrt(shape))
    x = shape * max(root, 0.05) ** 3
    for _ in range(100):
        step = (_gamma_below(shape, x) - share) / math.exp((shape - 1.0) * math.log(x) - x - math.lgamma(shape))
        x = max(x - step, 0.1 * x)
        if abs(step) < 1e-14 * x:
            break
    return x


def _gamma_below(a: float, x: float) -> float:
    """Regularised incomplete gamma function, by its series or its continued fraction (*Numerical Recipes*, 6.2)."""
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
        d = 1.0 / _away(b - m * (m - a) * d)
        c = _away(b - m * (m - a) / c)
        out *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return 1.0 - front * out


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


class NamedNumbers(Section):
    """Numbers by name: as attributes, and as a mapping has them."""

    def keys(self) -> KeysView[str]:
        """The names."""
        return type(self).model_fields.keys()

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)


class Statistics(NamedNumbers):
    """Statistics of distances between measured and predicted points, mm; ``sigma_mm`` with n - 1."""

    n: int
    mean_mm: float
    sigma_mm: float
    max_mm: float
    mean_plus_3sigma_mm: float
    rms_mm: float


class RotationStatistics(NamedNumbers):
    """Statistics of the angles between measured and predicted target frames, degrees; ``sigma_deg`` with n - 1."""

    n: int
    mean_deg: float
    sigma_deg: float
    max_deg: float


HEADINGS = {
    "n": "points",
    "mean": "mean",
    "sigma": "sigma",
    "max": "max",
    "mean_plus_3sigma": "mean+3σ",
    "rms": "rms",
    "p95": "95th percentile",
}
"""Figures of errors, and their headings in tables, pages and certificates; in results a name ends in its unit."""
FOUR = ("mean", "sigma", "max", "mean_plus_3sigma")
"""Those of the tables of Nubiola 2011, section 7.7."""


def headed(*figures: str, unit: str = "mm") -> tuple[tuple[str, str], ...]:
    """Columns of a table of figures: heading, and name in results."""
    return tuple((HEADINGS[name], name if name == "n" else f"{name}_{unit}") for name in figures)


def smallest(values: FloatArray, share: float) -> BoolArray:
    """Which values are at most the quantile ``share`` of all: ``values <= np.quantile(values, share)``, but quicker."""
    rank = int(share * (len(values) - 1))
    return np.asarray(values <= np.partition(values, rank)[rank])


def consecutive(labels: ArrayLike) -> IntArray:
    """Numbers from 0, equal ones for equal labels, shape (m,); whole numbers in order need no sorting."""
    values = np.asarray(labels).ravel()
    if values.dtype.kind in "iu" and len(values) and (values[1:] >= values[:-1]).all():
        numbers = np.zeros(len(values), dtype=np.int64)
        np.cumsum(values[1:] != values[:-1], out=numbers[1:])
        return numbers
    return np.asarray(np.unique(values, return_inverse=True)[1].ravel(), dtype=np.int64)


def statistics(distance: ArrayLike) -> Statistics | None:
    """Mean, standard deviation and maximum of distances, as the tables of Nubiola 2011, section 7.7.

    Parameters
    ----------
    distance : array_like, shape (m,)
        Metres; those of four bytes, of long files, are added up without a copy.

    Returns
    -------
    Statistics or None
        None for no distances.
    """
    d = np.asarray(distance)
    if not len(d):
        return None
    n = len(d)
    if d.dtype == np.float32:
        mean = float(d.mean(dtype=float)) / MM
        square = float(np.einsum("i,i->", d, d, dtype=float)) / n / MM**2
        sigma = float(np.sqrt(max(square - mean**2, 0.0) * n / (n - 1))) if n > 1 else 0.0
        largest = float(d.max()) / MM
    else:
        d = d.astype(float) / MM
        mean, square, sigma, largest = float(d.mean()), float(np.mean(d**2)), _sigma(d), float(d.max())
    return Statistics(
        n=n,
        mean_mm=mean,
        sigma_mm=sigma,
        max_mm=largest,
        mean_plus_3sigma_mm=mean + 3 * sigma,
        rms_mm=float(np.sqrt(square)),
    )


def statistics_by(distance: FloatArray, labels: Sequence[str] | NDArray[Any]) -> dict[str, Statistics]:
    """`statistics` of the distances of each label, as a dict in the order of the sorted labels."""
    labels = np.asarray(labels, dtype=object)
    by_label = {str(label): statistics(distance[labels == label]) for label in sorted(set(labels))}
    return {label: values for label, values in by_label.items() if values is not None}


def rotation_statistics(angles: ArrayLike) -> RotationStatistics | None:
    """Mean, standard deviation and maximum of angles, as Nubiola 2011, section 7.7.3.5.

    Parameters
    ----------
    angles : array_like, shape (m,)
        Radians.

    Returns
    -------
    RotationStatistics or None
        None for no angles.
    """
    a = np.asarray(angles, dtype=float) / DEG
    if not len(a):
        return None
    return RotationStatistics(n=len(a), mean_deg=float(a.mean()), sigma_deg=_sigma(a), max_deg=float(a.max()))


def _sigma(values: FloatArray) -> float:
    """Standard deviation with n - 1, 0 of a single value."""
    return float(values.std(ddof=1)) if len(values) > 1 else 0.0
