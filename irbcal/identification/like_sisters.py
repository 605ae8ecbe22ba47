"""Is a robot like its sisters? What its measurements show against what a prior of its type expects, by chi-square."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification.dictionaries import Dictionary
from irbcal.identification.mackay import Expected, Posterior
from irbcal.identification.sums import Sums
from irbcal.modeling.terms.term import Term

SHOWN = 1.0
"""Information of a direction, in that of the prior, from which it has a say: the measurements then tell more of it."""


CHANCE = 0.001
"""Share of the robots of a type of which it would be said by chance that they stand out of it."""


class Prior(Protocol):
    """What `irbcal.identification.type_prior.TypePrior` says."""

    @property
    def type(self) -> str:
        """Name of the nominal robot."""

    @property
    def sisters(self) -> Sequence[str]:
        """Those that it is from."""

    @property
    def simulated(self) -> bool:
        """Whether any of them is."""

    def expected(self, terms: Sequence[Term]) -> Expected:
        """Of terms, in their natural sizes."""


def alike(chi2: float, directions: int) -> bool:
    """Whether a robot is like its sisters, as far as `against` can tell."""
    from scipy.special import chdtrc

    return directions == 0 or float(chdtrc(directions, chi2)) >= CHANCE


def against(
    sums: Sums, flat: int, dictionary: Dictionary, found: Posterior, largest: float = np.inf
) -> tuple[float, int]:
    """Chi-square of a robot against its sisters, and its degrees of freedom.

    With information L and vector b of the measurements (base, targets and unknown terms left free, within what the fit
    gives them) ``b - L m`` has the covariance ``L + L T L`` for a robot drawn from ``N(m, T)``.

    Parameters
    ----------
    sums : Sums
        Of the dictionary's columns.
    flat : int
    dictionary : Dictionary
        One that knows of sisters.
    found : Posterior
        Its fit: residual variance, tempering and the variances of groups of which nothing is known.
    largest : float
        Residual variance without sisters, mm^2: of a stranger what contradicts them is taken for noise by the fit.

    Returns
    -------
    chi2 : float
    directions : int
        Of which the measurements tell more than the prior.
    """
    expected = dictionary.expected
    if expected is None:
        raise IdentificationError("this choice of terms knows of no sisters")
    a = found.temper / min(found.s2, largest)
    free = np.concatenate([np.zeros(flat), np.where(expected.known, 0.0, 1.0 / found.variances[dictionary.group])])
    A, b = a * sums.H + np.diag(free), a * sums.g
    known = np.concatenate([np.zeros(flat, dtype=bool), expected.known])
    crossed = np.linalg.solve(A[np.ix_(~known, ~known)], np.column_stack([A[np.ix_(~known, known)], b[~known]]))
    L = A[np.ix_(known, known)] - A[np.ix_(known, ~known)] @ crossed[:, :-1]
    left = b[known] - A[np.ix_(known, ~known)] @ crossed[:, -1] - L @ expected.mean[expected.known]
    std = expected.std[expected.known]
    values, vectors = np.linalg.eigh(std[:, None] * (0.5 * (L + L.T)) * std)
    shown = values > SHOWN
    z = vectors[:, shown].T @ (std * left)
    return float(np.sum(z * z / (values[shown] * (1.0 + values[shown])))), int(shown.sum())
