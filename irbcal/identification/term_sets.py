"""Term sets: choices of terms that are compared by evidence and averaged.

All of them are parts of one *superset* of terms. The thesis's level (geometry, A, B, joint 6's Fourier series) is among
them: on arms that have its errors only, the average without it is a third to a half worse.

What is known of a robot before it is measured: the terms of its type, as calibrated robots of that type show them.

What one robot shows of them is a normal likelihood, saved as the estimate under a wide prior that can be taken out of
it again (`irbcal.identification.evidence.type_terms`). Together they give the mean and the scatter of each term
(`irbcal.fleet.prior`). Whether a robot is like its type is asked by chi-square.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from irbcal.arrays import BoolArray, FloatArray, IntArray, coded
from irbcal.errors import IdentificationError
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    PRIOR_C2,
    PRIOR_GAMMA,
    VARIANCE_CAP,
    CoefficientPrior,
    NormalEquations,
    Posterior,
)
from irbcal.measurement.motions import usual_centre
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.harmonics import HIGHEST, LOW, band_group, order
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.warm_up import SHARES, WarmUp
from irbcal.section import Name, Section, Sha256, Word

JOINT_MAP, ALL = "joint-map", "all"
"""Which terms take part: those that URDF and a joint map can carry (beside them warm-up, zero at use), or all."""

FRAME_FAMILIES = ("bending", "wobble")
"""Families left out of `JOINT_MAP`."""

FAMILIES = ("geometry", "gain", "gravity", "bending", "harmonics", "wobble", "thesis")
"""Families that take part whatever is known of the motion, in the order of the superset."""
HISTORY_FAMILIES = ("direction", "move")
"""Families that take part where last moves are known."""

INPUTS = "inputs"
"""Stands for the families of which terms are functions of more than joints, last move and time: `input_families`."""
_WEIGHTS = ("gravity", "gain", "own_weight", INPUTS)
_PHYSICS = (*_WEIGHTS, "bending", "harmonics")
_HISTORY = (*_PHYSICS, *HISTORY_FAMILIES)
CHOICES: tuple[tuple[tuple[str, ...], int], ...] = (
    ((), 0),
    (("thesis", INPUTS), 0),
    (("thesis", "gain", INPUTS), 0),
    (_WEIGHTS, 0),
    (_PHYSICS, LOW),
    (_HISTORY, LOW),
    ((*_HISTORY, "warm_up"), LOW),
    ((*_HISTORY, "warm_up", "wobble"), LOW),
    ((*_HISTORY, "warm_up"), 12),
    (_PHYSICS, 24),
    (_PHYSICS, HIGHEST),
    ((*_HISTORY, "warm_up"), HIGHEST),
)
"""What is compared: families beside geometry, and the highest order of harmonics."""

EVIDENCE_SHARE, OPTIMISM, LEAST_WEIGHT = 0.1, 0.2, 0.01
"""Weights are ``exp(0.1 (E - 0.2 gamma ln(1 + gamma / nu))) / loo^2``, those below 0.01 are dropped.

E is the log evidence at the best variances. It is too high, the more so the fewer coordinates nu remain beside the
gamma coefficients that they determine. loo is the root mean square of the leave-one-pose-out residuals. Tuned on 14
robots, real and simulated, with 12 to 200 poses: with shares of 0.1 to 0.15, penalties of 0.15 to 0.3 and powers of 1.5
to 3 errors of held-out poses differ by one per cent."""


TYPE_FAMILIES, TYPE_ORDERS = ("geometry", "gain", "gravity", "harmonics", *HISTORY_FAMILIES), 6
"""Terms that robots of a type are compared by, and the highest order of their harmonics."""
LIKE_COUNT = 1.0
"""Coefficients that the size of like groups is worth in `variances_of_like`. Touches of two sockets (twelve SIMULATED
robots) hold 57 to 100 % of lengths of moves with it, 37 to 99 % without."""
OF_TYPE = " (type)"
"""What the name of a group ends with whose mean and scatter are those of the type."""


@dataclass(frozen=True, eq=False)
class TermSet:
    """One choice of terms."""

    name: str
    """Its families in words."""
    terms: IntArray
    """Places in the superset."""
    groups: tuple[str, ...]
    """Names of the variances."""
    group: IntArray
    """Shape (terms,). Variance of each term."""
    bands: bool = False
    """Whether it has long series of harmonics."""
    highest: int = 0
    """Order of harmonics that it was offered."""
    prior: CoefficientPrior | None = None
    """What is known of its terms from robots of its type."""

    @property
    def caps(self) -> FloatArray:
        """Largest variance of each group."""
        return np.array([GEOMETRY_CAP if name == "geometry" else VARIANCE_CAP for name in self.groups])

    def columns(self, nuisance: int) -> IntArray:
        """Columns of a linearisation of the superset: the nuisance ones and its terms."""
        return np.concatenate([np.arange(nuisance), nuisance + self.terms])

    def longer(self, indices: Sequence[int], names: Sequence[str], highest: int) -> TermSet:
        """With harmonics of the superset up to a higher order at its end, each with the name of its group."""
        name = self.name.replace(_name_with_order("harmonics", self.highest), _name_with_order("harmonics", highest))
        return replace(self.extended(indices, names), name=name, highest=highest)

    def extended(self, indices: Sequence[int], names: Sequence[str]) -> TermSet:
        """With more terms of the superset at its end, each with the name of its group."""
        groups = list(self.groups)
        groups += [name for name in dict.fromkeys(names) if name not in groups]
        return TermSet(
            self.name,
            np.concatenate([self.terms, np.asarray(indices, dtype=int)]),
            tuple(groups),
            np.concatenate([self.group, [groups.index(name) for name in names]]).astype(int),
            self.bands,
            self.highest,
            None if self.prior is None else self.prior.extended(len(indices)),
        )


def superset(
    arm: Arm,
    kind: str,
    moved: bool,
    payload: Sequence[float] | None,
    taus: Sequence[float],
    inputs: Sequence[str] = (),
    end: float | None = None,
) -> list[Term]:
    """All terms that any term set may have, geometry first.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    kind : str
        `JOINT_MAP` or `ALL`.
    moved : bool
        Whether last moves are known.
    payload : sequence of three float, optional
        Place of the payload in the tip link, metres; where several masses were carried.
    taus : sequence of float
        Time constants of warm-up; none where the order is unknown.
    inputs : sequence of str
        What else was measured and shall be used: `irbcal.modeling.terms.inputs`.
    end : float, optional
        When the measurement ended: what drifted is counted from there.
    """
    names = [*FAMILIES, *(HISTORY_FAMILIES if moved else ())]
    names = [name for name in names if kind == ALL or name not in FRAME_FAMILIES]
    out = [term for name in names for term in families()[name].terms(arm)]
    for name in input_families():
        if name == "payload":
            out += [] if payload is None else Payload(payload).terms(arm)
        elif all(quantity.name in inputs for quantity in families()[name].inputs):
            out += families()[name].terms(arm)
    for tau in taus:
        out += WarmUp(tau, end).terms(arm)
    return out


def of_motion(
    arm: Arm, kind: str, motion: Motion, usual_kg: float | None, payload_centre: Sequence[float] | None = None
) -> tuple[list[Term], list[float]]:
    """The `superset` of what a motion tells, and the time constants of its warm-up.

    Parameters
    ----------
    arm, kind
        As of `superset`.
    motion : Motion
    usual_kg : float or None
        The load whose place counts.
    payload_centre : sequence of three float, optional
        Place of the payload in the tip link where the motion does not tell it, metres; the tip unless given.
    """
    elapsed, loads, centres = motion.elapsed, motion.inputs.get("payload_kg"), motion.inputs.get("payload_centre")
    span = 0.0 if elapsed is None else float(np.ptp(elapsed))
    taus = [share * span for share in SHARES] if span > 0.0 else []
    centre: Sequence[float] | None = None
    if loads is not None and len(np.unique(loads)) > 1:
        stated = centres is not None or payload_centre is None
        centre = usual_centre(loads, centres, usual_kg) if stated else payload_centre
    end = None if elapsed is None else float(elapsed.max())
    return superset(arm, kind, bool(motion.moves.any()), centre, taus, tuple(motion.inputs), end), taus


def input_families() -> tuple[str, ...]:
    """Families whose terms are functions of inputs such as the payload: each takes part where these are given."""
    return tuple(name for name, family in families().items() if family.inputs)


def candidates(terms: Sequence[Term], kind: str, tau: float | None) -> list[TermSet]:
    """The term sets that are compared.

    Parameters
    ----------
    terms : sequence of Term
        The superset.
    kind : str
        `JOINT_MAP` or `ALL`.
    tau : float or None
        Time constant of warm-up to take.
    """
    out: list[TermSet] = []
    for names, highest in CHOICES:
        candidate = make(terms, [n for n in names if kind == ALL or n not in FRAME_FAMILIES], highest, tau)
        if all(not np.array_equal(candidate.terms, earlier.terms) for earlier in out):
            out.append(candidate)
    return out


def make(terms: Sequence[Term], names: Sequence[str], highest: int, tau: float | None) -> TermSet:
    """One term set: geometry and some families, harmonics up to an order; families without terms do not count."""
    names = [family for name in names for family in (input_families() if name == INPUTS else (name,))]
    indices, groups = [], []
    for k, term in enumerate(terms):
        if term.family != "geometry" and term.family not in names:
            continue
        if term.family == "harmonics" and order(term) > highest:
            continue
        if term.family == "warm_up" and term.parameters["tau"] != tau:
            continue
        indices.append(k)
        groups.append(band_group(term, highest) if term.family == "harmonics" and highest > LOW else term.group)
    present = {terms[k].family for k in indices}
    numbers, distinct = coded(groups)
    texts = ["geometry", *(_name_with_order(n, highest) for n in names if n in present)]
    return TermSet(", ".join(texts), np.array(indices, dtype=int), tuple(distinct), numbers, highest > LOW, highest)


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
    for names, highest in CHOICES:
        term_set = make(terms, [n for n in names if n not in FRAME_FAMILIES], max(highest, TYPE_ORDERS), tau)
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


def tau_of(term_set: TermSet, terms: Sequence[Term]) -> float | None:
    """Time constant of a term set's warm-up; None without."""
    taus = [terms[k].parameters["tau"] for k in term_set.terms if terms[k].family == "warm_up"]
    return float(str(taus[0])) if taus else None


def with_tau(term_set: TermSet, terms: Sequence[Term], tau: float) -> TermSet:
    """The same term set with another time constant of warm-up."""
    warm = [k for k, term in enumerate(terms) if term.family == "warm_up" and term.parameters["tau"] == tau]
    indices = term_set.terms.copy()
    indices[[terms[k].family == "warm_up" for k in indices]] = warm
    return replace(term_set, terms=indices)


def _name_with_order(family: str, highest: int) -> str:
    if family == "harmonics":
        return f"harmonics to {highest}"
    return family.replace("_", "-")


def share(gain: float) -> float:
    """Weight of a type's prior, by the nats that the evidence gains with it; zero or one where that is clear."""
    value = float(1.0 / (1.0 + np.exp(-np.clip(gain, -50.0, 50.0))))
    return 0.0 if value < LEAST_WEIGHT else 1.0 if value > 1.0 - LEAST_WEIGHT else value


def variances_of_like(fit: Posterior, term_set: TermSet) -> FloatArray:
    """Variances (groups,) of a fit: where data leave one open, towards that of like groups; none gets smaller.

    Groups are like one another where they are those of one family and band at several joints: how large the waves of
    other joints are tells how large those of a joint may be that no row turns enough.
    """
    groups = len(term_set.groups)
    squares = np.bincount(term_set.group, fit.c[-len(term_set.group) :] ** 2, groups)
    _, like = np.unique([re.sub(r"_\d+", "", name, count=1) for name in term_set.groups], return_inverse=True)
    pooled = (np.bincount(like, squares) + PRIOR_C2) / (np.bincount(like, fit.gammas) + PRIOR_GAMMA)
    variances = (squares + LIKE_COUNT * pooled[like]) / (fit.gammas + LIKE_COUNT)
    return np.asarray(np.clip(variances, fit.variances, np.maximum(term_set.caps, fit.variances)))


def weights(fits: Sequence[Posterior]) -> FloatArray:
    """Weight of each term set by its evidence, shape (term sets,); they sum to one."""
    gamma = np.array([fit.gammas.sum() for fit in fits])
    evidence, freedom = np.array([(fit.log_evidence, fit.freedom) for fit in fits]).T
    score = EVIDENCE_SHARE * (evidence - OPTIMISM * gamma * np.log1p(gamma / freedom))
    return shares(np.exp(score - score.max()))


def shares(weight: FloatArray) -> FloatArray:
    """Weights in shares of their sum, small ones dropped."""
    w = weight / weight.sum()
    w[w < LEAST_WEIGHT] = 0.0
    return np.asarray(w / w.sum())


WIDE = 20.0
"""Standard deviation of the prior under which estimates are saved, natural sizes."""


def name_of(term: Term) -> str:
    """The same name in every model: ``delta_theta3`` for constants of the geometry, else the term's."""
    if term.family == "geometry":
        return f"delta_{DHM_COLUMNS[term.axis]}{term.joint + 1}"
    return term.name


def is_compared(term: Term) -> bool:
    """Whether a term is one of those that robots of a type are compared by."""
    if term.family == "harmonics":
        return order(term) <= TYPE_ORDERS
    return term.family in TYPE_FAMILIES


Size: TypeAlias = Annotated[float, Field(gt=1e-15, lt=1e6)]
"""Standard deviation of an error parameter (metres, radians, ...): beyond these a file is damaged."""


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


INFORMED = 1.0
"""Information of a direction, in that of the prior, from which it has a say: the measurements then tell more of it."""


CHANCE = 0.001
"""Share of the robots of a type of which it would be said by chance that they stand out of it."""


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
