"""Term sets: choices of terms that are compared by evidence and averaged.

All of them are parts of one *superset* of terms. The thesis's level (geometry, A, B, joint 6's Fourier series) is among
them: on arms that have its errors only, the average without it is a third to a half worse.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import FloatArray, IntArray, coded
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    PRIOR_C2,
    PRIOR_GAMMA,
    VARIANCE_CAP,
    CoefficientPrior,
    Posterior,
)
from irbcal.measurement.motions import usual_centre
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import families
from irbcal.modeling.terms.harmonics import HIGHEST, LOW, band_group, order
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.warm_up import SHARES, WarmUp

JOINT_MAP, ALL = "joint-map", "all"
"""Which terms take part: those that URDF and a joint map can carry (beside them warm-up, zero at use), or all."""

FAMILIES = ("geometry", "gain", "gravity", "bending", "harmonics", "wobble", "thesis")
"""Families that take part whatever is known of the motion, in the order of the superset."""

INPUTS, MOVES, FRAMES = "inputs", "of_moves", "moves_frames"
"""Stand for all families that declare such a thing (`irbcal.modeling.terms.term.Family`): see `members`. Those of
`INPUTS` and `MOVES` take part where inputs and last moves are known, those of `FRAMES` not in `JOINT_MAP`."""
_WEIGHTS = ("gravity", "gain", "own_weight", INPUTS)
_PHYSICS = (*_WEIGHTS, "bending", "harmonics")
_HISTORY = (*_PHYSICS, MOVES)
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


LIKE_COUNT = 1.0
"""Coefficients that the size of like groups is worth in `variances_of_like`. Touches of two sockets (twelve SIMULATED
robots) hold 57 to 100 % of lengths of moves with it, 37 to 99 % without."""


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
    names = [*FAMILIES, *(members(MOVES) if moved else ())]
    names = [name for name in names if kind == ALL or name not in members(FRAMES)]
    out = [term for name in names for term in families()[name].terms(arm)]
    for name in members(INPUTS):
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


def members(name: str) -> tuple[str, ...]:
    """The families that a name of `CHOICES` stands for: one, or all that declare it."""
    if name not in (INPUTS, MOVES, FRAMES):
        return (name,)
    return tuple(member for member, family in families().items() if getattr(family, name))


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
        candidate = make(terms, [n for n in names if kind == ALL or n not in members(FRAMES)], highest, tau)
        if all(not np.array_equal(candidate.terms, earlier.terms) for earlier in out):
            out.append(candidate)
    return out


def make(terms: Sequence[Term], names: Sequence[str], highest: int, tau: float | None) -> TermSet:
    """One term set: geometry and some families, harmonics up to an order; families without terms do not count."""
    names = [family for name in names for family in members(name)]
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
