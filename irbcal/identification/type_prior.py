"""What is known of a robot before it is measured: the terms of its type, as calibrated robots of that type show them.

What one robot shows of them is a normal likelihood, saved as the estimate under a wide prior that can be taken out of
it again (`irbcal.identification.evidence.type_terms`). Together they give the mean and the scatter of each term
(`irbcal.fleet.prior`). Whether a robot is like its type is asked by chi-square.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import term_sets
from irbcal.identification.evidence_maximisation import Expected, Posterior, Sums
from irbcal.identification.term_sets import TermSet
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.harmonics import order
from irbcal.modeling.terms.term import Term

WIDE = 20.0
"""Standard deviation of the prior under which estimates are saved, natural sizes."""


def name_of(term: Term) -> str:
    """The same name in every model: ``delta_theta3`` for constants of the geometry, else the term's."""
    if term.family == "geometry":
        return f"delta_{DHM_COLUMNS[term.axis]}{term.joint + 1}"
    return term.name


def taken(term: Term) -> bool:
    """Whether a term is one of those that sisters are compared by."""
    if term.family == "harmonics":
        return order(term) <= term_sets.TYPE_ORDERS
    return term.family in term_sets.TYPE_FAMILIES


@dataclass(frozen=True, eq=False)
class TypePrior:
    """Mean and scatter of a type's terms.

    Attributes
    ----------
    type, nominal_sha256 : str
        Name of the nominal robot, and of its file's content.
    sisters : tuple of str
        Ids of the robots that it is from.
    simulated : bool
        Whether any of them is.
    names, units : tuple of str
    mean, std, natural : ndarray, shape (k,)
        What to expect of a new sister, and natural sizes, SI units.
    """

    type: str
    nominal_sha256: str
    sisters: tuple[str, ...]
    simulated: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: FloatArray
    std: FloatArray
    natural: FloatArray
    place: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", {name: k for k, name in enumerate(self.names)})
        lock(self)

    def knows(self, term: Term) -> bool:
        """Whether it says something of a term."""
        return taken(term) and name_of(term) in self.place

    def expected(self, terms: Sequence[Term]) -> Expected:
        """What it says of terms, in their natural sizes."""
        known: BoolArray = np.array([self.knows(term) for term in terms], dtype=bool)
        mean, std = np.zeros(len(terms)), np.ones(len(terms))
        for k in map(int, np.flatnonzero(known)):
            row = self.place[name_of(terms[k])]
            mean[k], std[k] = self.mean[row] / terms[k].size, self.std[row] / terms[k].size
        return Expected(mean, std, known)


INFORMED = 1.0
"""Information of a direction, in that of the prior, from which it has a say: the measurements then tell more of it."""


CHANCE = 0.001
"""Share of the robots of a type of which it would be said by chance that they stand out of it."""


def like_type(chi2: float, directions: int) -> bool:
    """Whether a robot is like its sisters, as far as `chi_square_of_type` can tell."""
    from scipy.special import chdtrc

    return directions == 0 or float(chdtrc(directions, chi2)) >= CHANCE


def chi_square_of_type(
    sums: Sums, flat: int, dictionary: TermSet, found: Posterior, largest: float = np.inf
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
    shown = values > INFORMED
    z = vectors[:, shown].T @ (std * left)
    return float(np.sum(z * z / (values[shown] * (1.0 + values[shown])))), int(shown.sum())
