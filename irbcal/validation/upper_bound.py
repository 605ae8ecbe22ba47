"""One-sided 95 % upper bounds of figures of accuracy, from proof poses that were drawn from all that are meant.

Percentiles and the largest error are bounded by order statistics, without any assumption, where there are enough places
for that (Wilks 1941): 59 for the 95th percentile, 299 for the share that `LARGEST_SHARE` asks for. With fewer places,
and for mean + 3 sigma, one model holds: tails no heavier than an exponential distribution's (the hazard rate's average
does not decrease; Barlow and Proschan 1975, "Statistical Theory of Reliability and Life Testing", section 4.2). Then
the order statistic is extrapolated along an exponential tail, and the standard error of mean + 3 sigma is taken as that
of an exponential distribution, the largest of these. ``scripts/false_pass`` counts how often the bounds are too small.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import IntArray
from irbcal.units import MM

Rule: TypeAlias = Literal["mean3sigma", "max", "percentile"]
RULES: tuple[Rule, ...] = get_args(Rule)

RISK = 0.05
"""Probability with which an upper bound may be too small."""
LARGEST_SHARE = 0.99
"""Share of all poses that must stay below what is called the largest error: no sample bounds that of all poses."""
SHARES = {"percentile": 0.95, "max": LARGEST_SHARE}
"""Share of the poses that each rule's figure must cover."""
EXPONENTIAL = 1.25
"""Relative standard error of mean + 3 sigma of n values of an exponential distribution, times the root of n (its
fourth standardised moment is 9: 25 / n is the variance of a figure of 4)."""

ASSUMED_U95 = 0.05 * MM
"""Expanded uncertainty where none is declared, metres: the permissible error of a usual laser tracker at 5 m."""

DISTRIBUTION_FREE = "order statistics, whatever the distribution"
MODEL = "under tails no heavier than an exponential distribution's"


def upper_bound(rule: Rule, figure: float, distance: ArrayLike, cluster: IntArray) -> tuple[float, str]:
    """Bound that the figure of all such poses exceeds with a probability of `RISK` at most.

    Parameters
    ----------
    rule : {"mean3sigma", "max", "percentile"}
    figure : float
        Of the errors, metres.
    distance : array_like, shape (m,)
        Errors, metres.
    cluster : ndarray of int, shape (m,)
        Place of each, at which the robot was measured several times or by several targets: errors of one place count
        together, by the largest of them for percentiles.

    Returns
    -------
    bound : float
        Metres, never below the figure.
    basis : str
        What the bound rests on, in words.
    """
    from scipy.special import stdtrit

    _, number = np.unique(cluster, return_inverse=True)
    n = int(number.max()) + 1
    if rule == "mean3sigma":
        relative = float(stdtrit(n - 1, 1.0 - RISK)) * EXPONENTIAL / math.sqrt(n)
        return figure * math.exp(relative), MODEL
    worst = np.zeros(n)
    np.maximum.at(worst, number.ravel(), np.asarray(distance, dtype=float))
    worst.sort()
    share = SHARES[rule]
    rank = _rank(n, share)
    if rank:
        return max(figure, float(worst[-rank])), DISTRIBUTION_FREE
    beyond = 1.0 - RISK ** (1.0 / n)  # with this confidence no larger share of all poses exceeds the largest
    return float(worst[-1]) * math.log(1.0 - share) / math.log(beyond), MODEL


def _rank(n: int, share: float) -> int:
    """Which of n values, from the largest on, exceeds a share of all with a probability of 1 - `RISK`; 0 for none."""
    from scipy.special import bdtr

    return int((bdtr(np.arange(n), n, 1.0 - share) <= RISK).sum())


def expanded_uncertainty(declared: ArrayLike | None, stated: float | None) -> tuple[float, str]:
    """Expanded uncertainty of a measured position, metres, and where it comes from, in words.

    Parameters
    ----------
    declared : array_like, shape (m,), or None
        What the measurements declare of each point, metres, NaN where they do not: the largest counts.
    stated : float or None
        What the user states, metres; it counts before what is declared.
    """
    if stated is not None:
        return stated, "as stated by the user"
    values = np.asarray([] if declared is None else declared, dtype=float)
    if np.isfinite(values).any():
        return float(np.nanmax(values)), "the largest u95_mm of the measurements"
    return ASSUMED_U95, "assumed for a laser tracker at 5 m, for none was declared"
