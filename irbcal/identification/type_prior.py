"""What is known of a robot before it is measured: the terms of its type, as calibrated robots of that type show them.

What one robot shows of them is a normal likelihood, saved as the estimate under a wide prior that can be taken out of
it again (`irbcal.identification.evidence.type_terms`). Together they give the mean and the scatter of each term
(`irbcal.fleet.prior`). Whether a robot is like its type is asked by chi-square.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from irbcal.arrays import BoolArray, coded
from irbcal.errors import IdentificationError
from irbcal.identification import term_sets
from irbcal.identification.evidence_maximisation import CoefficientPrior, NormalEquations, Posterior
from irbcal.identification.term_sets import FRAMES, TermSet, make, members
from irbcal.modeling.terms import families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.harmonics import LOW, order
from irbcal.modeling.terms.term import Term
from irbcal.section import Name, Section, Sha256, Word

TYPE_ORDERS = 6
"""Highest order of the harmonics that robots of a type are compared by."""
OF_TYPE = " (type)"
"""What the name of a group ends with whose mean and scatter are those of the type."""
WIDE = 20.0
"""Standard deviation of the prior under which estimates are saved, natural sizes."""
INFORMED = 1.0
"""Information of a direction, in that of the prior, from which it has a say: the measurements then tell more of it."""
CHANCE = 0.001
"""Share of the robots of a type of which it would be said by chance that they stand out of it."""
Size: TypeAlias = Annotated[float, Field(gt=1e-15, lt=1e6)]
"""Standard deviation of an error parameter (metres, radians, ...): beyond these a file is damaged."""


def name_of(term: Term) -> str:
    """The same name in every model: ``delta_theta3`` for constants of the geometry, else the term's."""
    if term.family == "geometry":
        return f"delta_{DHM_COLUMNS[term.axis]}{term.joint + 1}"
    return term.name


def families_of_type() -> list[str]:
    """Families that robots of a type are compared by."""
    return [name for name, family in families().items() if family.of_type]


def is_compared(term: Term) -> bool:
    """Whether a term is one of those that robots of a type are compared by."""
    if term.family == "harmonics":
        return order(term) <= TYPE_ORDERS
    return term.family in families_of_type()


class TypeTerm(Section):
    """What to expect of a term in a new robot: its mean and scatter, and its natural size; SI units."""

    name: Name
    unit: Word
    mean: Annotated[float, Field(gt=-1e6, lt=1e6)]
    std: Size
    natural: Size


class TypePrior(Section):
    """Mean and scatter of a type's terms, as its file has them."""

    irbcal: Literal["prior of a type"] = "prior of a type"
    version: Literal[1] = 1
    type: Name
    nominal_urdf_sha256: Sha256
    """Name of the nominal robot, and of its file's content."""
    simulated: bool
    """Whether any of the robots is."""
    robots: tuple[Name, ...]
    """Ids of the robots that it is from."""
    terms: tuple[TypeTerm, ...]

    @cached_property
    def _by_name(self) -> dict[str, TypeTerm]:
        return {term.name: term for term in self.terms}

    def knows(self, term: Term) -> bool:
        """Whether it says something of a term."""
        return is_compared(term) and name_of(term) in self._by_name

    def coefficients(self, terms: Sequence[Term]) -> CoefficientPrior:
        """What it says of terms, in their natural sizes."""
        known: BoolArray = np.array([self.knows(term) for term in terms], dtype=bool)
        mean, std = np.zeros(len(terms)), np.ones(len(terms))
        for k in map(int, np.flatnonzero(known)):
            term = self._by_name[name_of(terms[k])]
            mean[k], std[k] = term.mean / terms[k].size, term.std / terms[k].size
        return CoefficientPrior(mean, std, known)


def with_type(
    terms: Sequence[Term], tau: float | None, expect: Callable[[Sequence[Term]], CoefficientPrior]
) -> list[TermSet]:
    """The term sets that have all terms of which a type's prior knows, with what it knows of them.

    Parameters
    ----------
    terms : sequence of Term
        The superset, without frame terms.
    tau : float or None
        Time constant of warm-up to take.
    expect : callable
        What is known of some terms.
    """
    everything = expect(terms)
    out: list[TermSet] = []
    for names, highest in term_sets.CHOICES:
        term_set = make(terms, [n for n in names if n not in members(FRAMES)], max(highest, TYPE_ORDERS), tau)
        in_set = np.isin(np.arange(len(terms)), term_set.terms)
        if (everything.informed & ~in_set).any() or any(
            np.array_equal(term_set.terms, earlier.terms) for earlier in out
        ):
            continue
        prior = everything.select(term_set.terms)
        labels = [
            f"{terms[k].group}{OF_TYPE}" if informed else term_set.groups[g]
            for k, g, informed in zip(term_set.terms, term_set.group, prior.informed, strict=True)
        ]
        numbers, distinct = coded(labels)
        name = f"{term_set.name}; type prior"
        out.append(TermSet(name, term_set.terms, tuple(distinct), numbers, highest > LOW, term_set.highest, prior))
    return out


def like_type(chi2: float, directions: int) -> bool:
    """Whether a robot is like its type, as far as `chi_square_of_type` can tell."""
    from scipy.special import chdtrc

    return directions == 0 or float(chdtrc(directions, chi2)) >= CHANCE


def chi_square_of_type(
    sums: NormalEquations, nuisance: int, term_set: TermSet, fit: Posterior, largest: float = np.inf
) -> tuple[float, int]:
    """Chi-square of a robot against its type, and its degrees of freedom.

    With information L and vector b of the measurements (base, targets and unknown terms left free, within what the fit
    gives them) ``b - L m`` has the covariance ``L + L T L`` for a robot drawn from ``N(m, T)``.

    Parameters
    ----------
    sums : NormalEquations
        Of the term set's columns.
    nuisance : int
    term_set : TermSet
        One with a type prior.
    fit : Posterior
        Its fit: residual variance, likelihood power and the variances of groups of which nothing is known.
    largest : float
        Residual variance without the type prior, mm^2: of a stranger what contradicts it is taken for noise by the fit.

    Returns
    -------
    chi2 : float
    directions : int
        Of which the measurements tell more than the prior.
    """
    prior = term_set.prior
    if prior is None:
        raise IdentificationError("this term set has no type prior")
    a = fit.likelihood_power / min(fit.s2, largest)
    free = np.concatenate([np.zeros(nuisance), np.where(prior.informed, 0.0, 1.0 / fit.variances[term_set.group])])
    A, b = a * sums.H + np.diag(free), a * sums.g
    of_type = np.concatenate([np.zeros(nuisance, dtype=bool), prior.informed])
    crossed = np.linalg.solve(
        A[np.ix_(~of_type, ~of_type)], np.column_stack([A[np.ix_(~of_type, of_type)], b[~of_type]])
    )
    L = A[np.ix_(of_type, of_type)] - A[np.ix_(of_type, ~of_type)] @ crossed[:, :-1]
    gradient = b[of_type] - A[np.ix_(of_type, ~of_type)] @ crossed[:, -1] - L @ prior.mean[prior.informed]
    std = prior.std[prior.informed]
    values, vectors = np.linalg.eigh(std[:, None] * (0.5 * (L + L.T)) * std)
    informed = values > INFORMED
    z = vectors[:, informed].T @ (std * gradient)
    return float(np.sum(z * z / (values[informed] * (1.0 + values[informed])))), int(informed.sum())
