"""What is known of a robot before it is measured: the terms of its type, as its calibrated sisters show them.

What one robot shows of them is a normal likelihood, saved as the estimate under a wide prior that can be taken out of
it again (`seen`). Sisters together give the mean and the scatter of each term (`irbcal.fleet.prior`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.identification import dictionaries, mackay
from irbcal.identification.evidence import prepared
from irbcal.identification.mackay import Expected
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.harmonics import order
from irbcal.modeling.terms.situation import Motion
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
        return order(term) <= dictionaries.TYPE_ORDERS
    return term.family in dictionaries.TYPE_FAMILIES


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


@dataclass(frozen=True, eq=False)
class Seen:
    """What one robot's measurements show of the terms.

    Attributes
    ----------
    terms : tuple of Term
    values, covariance : ndarray, shape (k,), (k, k)
        The estimate under a prior of `WIDE` natural sizes about zero, SI units.
    """

    terms: tuple[Term, ...]
    values: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        lock(self)


def seen(arm: Arm, points: PointSet, motion: Motion) -> Seen:
    """What measurements show of a type's terms; base, tool and warm-up are left free, a pose counts as one vector.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
    motion : Motion
        Of its poses.

    Returns
    -------
    Seen

    Raises
    ------
    IdentificationError
        If the poses do not determine base and targets.
    """
    work = prepared(arm, points, motion)
    superset, flat = work.superset, work.linear.flat
    names = [*dictionaries.TYPE_FAMILIES, "warm_up"]
    choice = dictionaries.make(superset, names, dictionaries.TYPE_ORDERS, work.taus[-1] if work.taus else None)
    sums = work.sums.part(choice.columns(flat))
    t = mackay.evidence_temper(work.linear.per_pose)
    found = mackay.fit(sums, flat, choice.group, choice.caps, t)
    terms = [superset[k] for k in choice.terms]
    mine = np.array([taken(term) for term in terms], dtype=bool)
    prior = np.where(mine, WIDE**-2.0, 1.0 / found.variances[choice.group])
    A = (t / found.s2) * sums.H + np.diag(np.concatenate([np.zeros(flat), prior]))
    own = np.concatenate([np.zeros(flat, dtype=bool), mine])
    covariance = np.linalg.inv(A)
    values = covariance @ ((t / found.s2) * sums.g)
    size = np.array([term.size for term in terms])[mine]
    return Seen(
        tuple(term for term, own_term in zip(terms, mine, strict=True) if own_term),
        size * values[own],
        np.outer(size, size) * covariance[np.ix_(own, own)],
    )
