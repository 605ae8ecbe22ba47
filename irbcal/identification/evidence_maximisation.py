"""Evidence: coefficients with one prior variance a group, and those variances from the data.

The model is ``y = J c + noise`` with noise of variance ``s2 / t`` a coordinate, prior ``N(0, v_g)`` on the coefficients
of group g, none on the nuisance columns (base, tool, features). ``t`` (the power of the likelihood) says how much a
coordinate counts: those of one pose are not independent. All lengths in millimetres, coefficients in units of their
natural sizes.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.errors import IdentificationError
from irbcal.units import MM


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of all columns, nuisance ones first."""

    H: FloatArray
    """Shape (columns, columns). ``J^T J``, mm^2."""
    g: FloatArray
    """Shape (columns,). ``J^T y``, mm^2."""
    yy: float
    """``y^T y``, mm^2."""
    equations: int

    @staticmethod
    def total(parts: Iterable[NormalEquations], columns: int) -> NormalEquations:
        """The sums of all parts of the rows, of so many columns each."""
        H, g, yy, equations = np.zeros((columns, columns)), np.zeros(columns), 0.0, 0
        for part in parts:
            H += part.H
            g += part.g
            yy += part.yy
            equations += part.equations
        return NormalEquations(H, g, yy, equations)

    def select(self, columns: IntArray) -> NormalEquations:
        """The sums of some columns."""
        return NormalEquations(self.H[np.ix_(columns, columns)], self.g[columns], self.yy, self.equations)


VARIANCE_CAP, GEOMETRY_CAP = 4.0, 400.0
"""Largest variances, in squared natural sizes: without them a fit on one corner of the workspace ran off."""
PRIOR_C2, PRIOR_GAMMA = 0.002, 0.2
"""What keeps a group's variance from zero: ``v = (|c|^2 + .002) / (gamma + .2)``."""
NOISE, NOISE_COUNT = 0.01, 5.0
"""Residual standard deviation of a coordinate that is plausible before anything is measured, mm (trackers and the
repeatability of arms), and how many coordinates that knowledge is worth. Without it, long series of terms that pass
through the few points of a small set leave no residuals, and seem certain."""
ITERATIONS = 60
EARLY = 5
"""Iterations before which a start is too far from the top for curvature to say much."""
FURTHER = 3.0
"""How many times what MacKay's next step promises the log evidence still grows: in 240 fits of six robots, real and
SIMULATED, it was at most 13 nats more."""
TOLERANCE = 0.005
"""What the next step would add to the log evidence (with what is known before) where it has converged, nats."""
RENEWED = 0.3
"""Change of the log evidence, nats, up to which a curvature still serves."""
LEAST_CURVATURE, LONGEST_STEP = 0.3, 3.0
"""Of Newton's steps: curvature along a direction, in that of a step of MacKay's, and change of a logarithm."""

KNOWN_COUNT = 4.0
"""Coefficients that the scatter in `CoefficientPrior` is worth where the variance of a group is estimated."""


@dataclass(frozen=True, eq=False)
class CoefficientPrior(Locked):
    """What was known of coefficients before, from elsewhere: normal, each by itself."""

    mean: FloatArray
    std: FloatArray
    """Shape (k - nuisance,). In natural sizes: zero and one where nothing is known."""
    informed: BoolArray
    """Shape (k - nuisance,). Whether something is; the same for all coefficients of a group."""

    def select(self, chosen: BoolArray | IntArray) -> CoefficientPrior:
        """Of some of the coefficients."""
        return CoefficientPrior(self.mean[chosen], self.std[chosen], self.informed[chosen])

    def extended(self, count: int) -> CoefficientPrior:
        """With so many more of which nothing is known."""
        none = np.zeros(count)
        return CoefficientPrior(np.r_[self.mean, none], np.r_[self.std, none + 1.0], np.r_[self.informed, none > 0.0])


def fit_likelihood_power(per_pose: float) -> float:
    """Power of the likelihood in a fit with so many measured vectors a pose: a pose counts as six numbers at most."""
    return min(1.0, 6.0 / (3.0 * per_pose))


def evidence_likelihood_power(per_pose: float) -> float:
    """Power of the likelihood in the log evidence: a pose counts as one vector."""
    return min(1.0, 1.0 / per_pose)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Outcome of a fit; columns are ordered as in the sums, nuisance ones first."""

    c: FloatArray
    """Shape (k,). Coefficients."""
    factor: FloatArray
    """Shape (k, k). Lower Cholesky factor of the coefficients' precision."""
    variances: FloatArray
    gammas: FloatArray
    """Shape (groups,). Prior variance of each group and number of its coefficients that the data determine."""
    s2: float
    """Residual variance of a coordinate, mm^2."""
    log_evidence: float
    """At these variances."""
    iterations: int
    likelihood_power: float
    freedom: float = np.inf
    """Coordinates that ``s2`` rests on, what was known of it before included."""

    @cached_property
    def whitened(self) -> FloatArray:
        """Inverse W of the factor, lower triangular, shape (k, k): ``W^T W`` is the covariance."""
        return _inverse(self.factor)

    def whiten(self, J: FloatArray) -> FloatArray:
        """Derivatives W J, shape (k, rows)."""
        return np.asarray(_linear_algebra()[0].dtrmm(1.0, self.whitened, J.T, side=1, lower=1, trans_a=1).T)

    def with_variances(self, variances: FloatArray, group: IntArray) -> Posterior:
        """The same coefficients with other prior variances (groups,) of the last columns, whose groups are given."""
        precision = self.factor @ self.factor.T
        np.einsum("ii->i", precision)[-len(group) :] += (1.0 / variances - 1.0 / self.variances)[group]
        return replace(self, factor=_cholesky(precision), variances=variances)

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the coefficients, shape (k, k): few fits are asked for it."""
        lower = np.tril(_linear_algebra()[1].dlauum(self.whitened, lower=1)[0])
        out = lower + lower.T
        np.einsum("ii->i", out)[:] = np.diagonal(lower)
        return np.asarray(out)


def maximise_evidence(
    sums: NormalEquations,
    nuisance: int,
    group: IntArray,
    caps: FloatArray,
    t: float,
    variances: FloatArray | None = None,
    s2: float | None = None,
    tolerance: float = TOLERANCE,
    iterations: int = ITERATIONS,
    evidence_floor: float = -np.inf,
    noise: float = NOISE,
    prior: CoefficientPrior | None = None,
) -> Posterior:
    """Iterate to the variances that make the data most probable.

    Newton's steps in the logarithms of the variances, measured by those of MacKay's fixed point; a step that makes the
    data less probable is taken back for MacKay's.

    Parameters
    ----------
    sums : NormalEquations
    nuisance : int
        Number of columns without a prior; they stand first.
    group : ndarray of int, shape (k - nuisance,)
        Group of each other column.
    caps : ndarray, shape (groups,)
        Largest variance of each.
    t : float
        Power of the likelihood.
    variances, s2 : optional
        Start; one, and what is left by ridge, unless given.
    tolerance : float
        Of the log evidence, nats.
    iterations : int
    evidence_floor : float
        Log evidence; a fit that will not come near it is not brought to its end.
    noise : float
        Standard deviation of a coordinate that is plausible before anything is measured, mm.
    prior : CoefficientPrior, optional
        Means and standard deviations of the coefficients; the variances of the groups are then counted in theirs.

    Raises
    ------
    IdentificationError
        If the data do not determine base and targets.
    """
    problem = _VarianceProblem.from_sums(sums, nuisance, group, len(caps), t, noise, prior)
    v = np.ones(len(caps)) if variances is None else variances
    s2 = problem.start_variance if s2 is None else s2
    x, highest = np.log(np.append(v, s2)), np.append(np.log(caps), np.inf)
    plain, last, curved = None, -np.inf, -np.inf
    for iteration in range(1, iterations + 1):
        v, s2 = np.exp(x[:-1]), float(np.exp(x[-1]))
        moment = problem.at(v, s2)
        if plain is not None and moment.goal < last - 1e-9 and iteration < iterations:
            x, plain = plain, None
            continue
        # rounding alone makes it negative, where data determine next to nothing
        mackay = np.log(np.maximum(moment.up / moment.down, np.finfo(float).tiny)) - x
        slope = 0.5 * moment.down * np.expm1(mackay)
        free = (x < highest) | (slope < 0.0)
        gain = 0.5 * float(slope[free] @ mackay[free])
        if moment.evidence + FURTHER * gain < evidence_floor or gain < LEAST_CURVATURE * tolerance:
            break
        last, plain = moment.goal, np.minimum(x + mackay, highest)
        if variances is None and iteration < EARLY:  # far from the top curvature says less
            x = plain
            continue
        if moment.goal > curved + RENEWED:
            curvature, curved = problem.curvature(moment, v, s2), moment.goal
        step = np.zeros(len(x))
        step[free] = _newton(slope[free], mackay[free], curvature[np.ix_(free, free)])
        if 0.5 * float(slope @ step) < tolerance or iteration == iterations:
            break
        x = np.minimum(x + step, highest)
    c, factor = problem.with_nuisance(moment, s2)
    c[nuisance:] += 0.0 if prior is None else prior.mean
    freedom = float(moment.down[-1])
    return Posterior(c, factor, v, moment.gammas, s2, moment.evidence, iteration, t, freedom)


class FamilyEvidence(NamedTuple):
    """What the data say of a part of the coefficients, beside all others."""

    evidence: float
    """Log evidence that is lost without it, nats."""
    moves: float
    """Root mean square distance by which the fitted points move without it, metres."""
    determined: float
    """Number of its coefficients that the data determine."""


def evidence_of_each(
    sums: NormalEquations,
    fit: Posterior,
    nuisance: int,
    labels: Sequence[Hashable],
    group: IntArray,
    caps: FloatArray,
    prior: CoefficientPrior | None = None,
) -> dict[Hashable, FamilyEvidence]:
    """Fit again without each part of the coefficients.

    Parameters
    ----------
    sums : NormalEquations
    fit : Posterior
        The fit with all of them.
    nuisance : int
    labels : sequence of hashable, length k - nuisance
        Which part each coefficient belongs to; those of ``None`` always stay.
    group, caps, prior
        As `maximise_evidence`; parts have groups that no other part has.

    Returns
    -------
    dict
        In the order of the labels.
    """
    out: dict[Hashable, FamilyEvidence] = {}
    for label in dict.fromkeys(labels):
        if label is None:
            continue
        stays = np.array([other != label for other in labels], dtype=bool)
        groups = np.unique(group[stays])
        columns = np.concatenate([np.arange(nuisance), nuisance + np.flatnonzero(stays)])
        remaining = None if prior is None else prior.select(stays)
        without = maximise_evidence(
            sums.select(columns),
            nuisance,
            np.searchsorted(groups, group[stays]),
            caps[groups],
            fit.likelihood_power,
            fit.variances[groups],
            fit.s2,
            prior=remaining,
        )
        change = fit.c.copy()
        change[columns] -= without.c
        moved = np.sqrt(max(3.0 * float(change @ sums.H @ change) / sums.equations, 0.0)) * MM
        lost = float(fit.log_evidence - without.log_evidence)
        out[label] = FamilyEvidence(lost, float(moved), float(fit.gammas[np.unique(group[~stays])].sum()))
    return out


@dataclass(frozen=True, eq=False)
class _Moment:
    """A fit with given variances; nuisance columns are left out."""

    c: FloatArray
    """Shape (p,)."""
    factor: FloatArray
    """Shape (p, p). Lower Cholesky factor of the precision."""
    whitened: FloatArray
    """Shape (p, p). Its inverse, in single precision: sizes of steps need few digits of it."""
    gammas: FloatArray
    """Shape (groups,)."""
    evidence: float
    goal: float
    """What is made largest: the log evidence with what is known of the variances before."""
    up: FloatArray
    down: FloatArray
    """Shape (groups + 1,). Each variance (the residuals' is the last) should be the quotient; half of ``up / variance -
    down`` is the slope of the goal along its logarithm.
    """


@dataclass(frozen=True, eq=False)
class _VarianceProblem:
    """What stays the same while variances are looked for. The nuisance columns, which have no prior, are eliminated."""

    sums: NormalEquations
    """Of the p other columns and of the measurements, less what the nuisance columns explain of them."""
    eliminated: FloatArray
    explained: FloatArray
    """Shapes (nuisance + p, nuisance), (nuisance,). Cholesky columns of the nuisance columns in the sums of all, and
    the measurements in the directions of these.
    """
    group: IntArray
    unit: FloatArray
    t: float
    square: FloatArray
    count: FloatArray
    noise: float
    members: FloatArray
    """Shape (p, groups). The unit of each coefficient in the column of its group, else zero."""

    @property
    def spare(self) -> float:
        """How many numbers the data tell beyond the nuisance columns."""
        return self.t * self.sums.equations - len(self.explained)

    @property
    def start_variance(self) -> float:
        """Residual variance of base and targets alone, in part: a start between that and the end."""
        return max(0.01 * self.t * self.sums.yy / self.spare, 1e-8)

    @staticmethod
    def from_sums(
        sums: NormalEquations,
        nuisance: int,
        group: IntArray,
        groups: int,
        t: float,
        noise: float,
        prior: CoefficientPrior | None,
    ) -> _VarianceProblem:
        """The problem with coefficients counted from the means of their prior.

        Raises
        ------
        IdentificationError
            If the data do not determine base and targets.
        """
        if t * sums.equations <= nuisance:
            raise IdentificationError(
                f"{sums.equations} equations are too few for base and targets: measure more poses"
            )
        unit = np.ones(len(group)) if prior is None else prior.std**-2.0
        sums = sums if prior is None else _about(sums, nuisance, prior)
        L = _cholesky(sums.H[:nuisance, :nuisance].copy(order="F"))
        columns, explained = sums.H[:, :nuisance], sums.g[:nuisance]
        if nuisance:  # errors of single joints have neither base nor targets
            columns = _linear_algebra()[0].dtrsm(1.0, L, columns, side=1, lower=1, trans_a=1)
            explained = _linear_algebra()[0].dtrsv(L, explained, lower=1)
        below = columns[nuisance:]
        rest = NormalEquations(
            sums.H[nuisance:, nuisance:] - below @ below.T,
            sums.g[nuisance:] - below @ explained,
            sums.yy - float(explained @ explained),
            sums.equations,
        )
        members = (unit[:, None] * (group[:, None] == np.arange(groups))).astype(np.float32)
        kept = _kept_from_zero(group, groups, prior)
        return _VarianceProblem(rest, columns, explained, group, unit, t, *kept, noise, members)

    def at(self, v: FloatArray, s2: float) -> _Moment:
        """Fit with given variances."""
        sums, group, unit, t, groups = self.sums, self.group, self.unit, self.t, len(v)
        N, nuisance, weight, precision = sums.equations, len(self.explained), t / s2, unit / v[group]
        A = weight * sums.H.T  # symmetric: by columns, as LAPACK has them
        np.einsum("ii->i", A)[:] += precision
        factor = _cholesky(A)
        b = weight * sums.g
        c = _linear_algebra()[1].dpotrs(factor, b, lower=1)[0] if len(b) else b
        penalty = float(c @ (precision * c))
        # A c = b spares the product H c
        rss = max(sums.yy - 2.0 * float(c @ sums.g) + (float(c @ b) - penalty) / weight, 0.0)
        counts = np.bincount(group, minlength=groups).astype(float)
        log_det = 2.0 * float(np.log(np.diagonal(factor)).sum() + np.log(np.diagonal(self.eliminated)).sum())
        log_det += nuisance * np.log(weight / (2 * np.pi)) + float(counts @ np.log(v)) - float(np.log(unit).sum())
        evidence = -0.5 * (t * N * np.log(2 * np.pi * s2) + t * rss / s2 + penalty + log_det)
        whitened = _inverse(factor.astype(np.float32))
        gammas = counts - np.bincount(group, unit * np.einsum("ij,ij->j", whitened, whitened), groups) / v
        known = float((self.count * np.log(v) + self.square / v).sum())
        known += NOISE_COUNT * float(np.log(s2) + self.noise**2 / s2)
        squares = np.bincount(group, unit * c**2, groups)
        up = np.append(squares + self.square, t * rss + NOISE_COUNT * self.noise**2)
        down = np.append(gammas + self.count, max(self.spare - float(gammas.sum()), 0.0) + NOISE_COUNT)
        return _Moment(c, factor, whitened, gammas, float(evidence), float(evidence) - 0.5 * known, up, down)

    def with_nuisance(self, moment: _Moment, s2: float) -> tuple[FloatArray, FloatArray]:
        """Coefficients (nuisance + p,) and Cholesky factor of their precision with the nuisance columns."""
        nuisance = len(self.explained)
        below = self.eliminated[nuisance:]
        first = self.explained - moment.c @ below
        if nuisance:
            first = _linear_algebra()[0].dtrsv(self.eliminated[:nuisance], first, lower=1, trans=1)
        factor = np.zeros((len(self.eliminated),) * 2, order="F")
        factor[:, :nuisance] = np.sqrt(self.t / s2) * self.eliminated
        factor[nuisance:, nuisance:] = moment.factor
        return np.concatenate([first, moment.c]), factor

    def curvature(self, moment: _Moment, v: FloatArray, s2: float) -> FloatArray:
        """Second derivatives of the goal by the logarithms of all variances, with their sign turned."""
        groups, c = len(v), moment.c.astype(np.float32)
        # LAPACK refuses a matrix without rows: there are no terms
        lower = _linear_algebra()[1].slauum(moment.whitened, lower=1)[0] if len(c) else moment.whitened
        diagonal = self.unit * np.diagonal(lower)
        twice = np.bincount(self.group, diagonal * (diagonal + 2.0 * self.unit * c**2), groups)
        traces = np.bincount(self.group, diagonal, groups) / v
        product = lower * (lower + np.outer(2.0 * c, c).T)  # by columns, all of it
        product_of_members = self.members.T @ _linear_algebra()[0].strmm(1.0, product, self.members, lower=1)
        product_of_members = (product_of_members + product_of_members.T - np.diag(twice)) / np.outer(v, v)
        out = np.empty((groups + 1, groups + 1))
        known = np.append(self.square / v, NOISE_COUNT * self.noise**2 / s2)
        out[:-1, :-1] = np.diag((moment.up[:-1] - self.square) / v + traces) - product_of_members
        out[-1, :-1] = out[:-1, -1] = product_of_members.sum(axis=1) - traces
        out[-1, -1] = moment.up[-1] / s2 - known[-1] - out[-1, :-1].sum()
        return 0.5 * (out + np.diag(known))


def _newton(slope: FloatArray, mackay: FloatArray, curvature: FloatArray) -> FloatArray:
    """Newton's step, upwards along every direction: curvature is at least a share of that of MacKay's step."""
    size = np.sqrt(slope / np.where(mackay == 0.0, 1.0, mackay))
    size = np.where(size > 0.0, size, 1.0)
    bend, directions = np.linalg.eigh(curvature / np.outer(size, size))
    along = (slope / size) @ directions / np.maximum(np.abs(bend), LEAST_CURVATURE)
    return np.asarray(np.clip(directions @ along / size, -LONGEST_STEP, LONGEST_STEP))


def _kept_from_zero(group: IntArray, groups: int, prior: CoefficientPrior | None) -> tuple[FloatArray, FloatArray]:
    """Squares and counts that are added to those of each group: towards the scatter of what is known, else zero."""
    has_prior = np.zeros(groups, dtype=bool)
    if prior is not None:
        has_prior[group[prior.informed]] = True
    return np.where(has_prior, KNOWN_COUNT, PRIOR_C2), np.where(has_prior, KNOWN_COUNT, PRIOR_GAMMA)


def _about(sums: NormalEquations, nuisance: int, prior: CoefficientPrior) -> NormalEquations:
    """The sums of coefficients that are counted from their means."""
    m = np.concatenate([np.zeros(nuisance), prior.mean])
    Hm = sums.H @ m
    return NormalEquations(sums.H, sums.g - Hm, sums.yy - 2.0 * float(m @ sums.g) + float(m @ Hm), sums.equations)


@cache
def _linear_algebra() -> tuple[Any, Any]:
    """Scipy's BLAS and LAPACK, without the package around them: that takes a seventh of a second to load."""
    import scipy

    modules = []
    for name in ("_fblas", "_flapack"):
        spec = PathFinder.find_spec(name, [str(Path(folder, "linalg")) for folder in scipy.__path__])
        if spec is None or spec.loader is None:  # scipy keeps them elsewhere
            from scipy.linalg import blas, lapack

            return blas, lapack
        modules.append(module_from_spec(spec))
        spec.loader.exec_module(modules[-1])
    return modules[0], modules[1]


def _cholesky(A: FloatArray) -> FloatArray:
    """Lower Cholesky factor, which takes the place of a matrix that is stored by columns.

    Raises
    ------
    IdentificationError
        If the matrix is not positive definite.
    """
    if not len(A):
        return A
    L, failed = _linear_algebra()[1].dpotrf(A, lower=1, clean=1, overwrite_a=1)
    if failed or not np.isfinite(L[-1, -1]):
        raise IdentificationError("the data do not determine base and targets: measure more poses")
    return np.asarray(L)


def _inverse(L: FloatArray) -> FloatArray:
    """Inverse of a lower triangular matrix, in its precision, by quarters: products are faster than LAPACK.

    The quarters are copied, by columns as BLAS has them: it would copy parts of a matrix with each product.
    """
    (blas, lapack), half = _linear_algebra(), len(L) // 2
    single = L.dtype == np.float32
    if not len(L):
        return L
    if half < 32:
        return np.asarray((lapack.strtri if single else lapack.dtrtri)(L, lower=1)[0])
    multiply = blas.strmm if single else blas.dtrmm
    first, last = _inverse(L[:half, :half].copy(order="F")), _inverse(L[half:, half:].copy(order="F"))
    below = multiply(1.0, first, L[half:, :half].copy(order="F"), side=1, lower=1, overwrite_b=1)
    out = np.zeros_like(L)
    out[:half, :half], out[half:, half:] = first, last
    out[half:, :half] = multiply(-1.0, last, below, lower=1, overwrite_b=1)
    return out
