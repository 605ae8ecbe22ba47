"""What to expect of a robot of a type, from calibrated robots of it: the mean and the scatter of each term.

Each robot's terms are drawn from ``N(mean, diag(variance))``; what its measurements show of them is a normal
likelihood. Mean and variances are those that make all robots' measurements most probable (empirical Bayes, with
MacKay's fixed point for the variances as in `irbcal.identification.evidence_maximisation`). Correlations are not
looked for: with some tens of robots there is nothing to tell them from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from irbcal import literals
from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError
from irbcal.fleet import STORE
from irbcal.fleet.comparison import FEWEST_OF_TYPE
from irbcal.fleet.store import Estimate, Store, Stored, opened
from irbcal.identification.evidence_maximisation import PRIOR_C2, PRIOR_GAMMA
from irbcal.identification.type_prior import WIDE, TypePrior, TypeTerm
from irbcal.io import prior_file
from irbcal.option_values import Progress
from irbcal.safe_files import write_together
from irbcal.summary import Paragraph, Result, Table

MEAN = 4.0
"""Standard deviation of a type's mean about zero before anything is seen of it, natural sizes."""
ITERATIONS, TOLERANCE = 500, 0.01
"""Of the fixed point: most iterations, and the largest relative change of a variance after which it has converged."""
LONGEST_STEP = 16.0
"""Steps of the fixed point that are taken at once, at most."""
MOST_OF_TYPE, FIRST = 400, 64
"""Robots that a prior is made from, drawn at random where there are more: they show a scatter to 4 % of itself and a
mean to 5 % of the scatter. And those that its search begins with."""
LEAST_SHARE = 0.5
"""Share of the robots that must have a term for it to be taken."""


@dataclass(frozen=True, eq=False, repr=False)
class FleetPrior(Result):
    """A prior that was written."""

    prior: TypePrior
    out: Path

    def report(self) -> Sequence[Paragraph]:
        """From how many robots; the terms whose mean is farthest from nominal."""
        p = self.prior
        kind = "SIMULATED: " if p.simulated else ""
        rows = [(term.name, term.mean / term.natural, term.std / term.natural) for term in p.terms]
        far = tuple(sorted(rows, key=lambda row: -abs(row[1]))[:10])
        out = literals.shell(str(self.out))
        return [
            f"{kind}{len(p.terms)} terms of type {p.type} from {len(p.robots)} robots, written to {self.out}",
            Table("Terms farthest from nominal, in natural sizes", ("term", "mean", "scatter"), far, 3),
            f"irbcal calibrate MEASUREMENTS --robot ROBOT --prior {out} --out FOLDER takes it.",
        ]

    CONTENT = "out type=prior.type robots=prior.robots"


def fleet_prior(
    type: str,
    out: str | Path,
    store: str | Path = STORE,
    *,
    without: str | None = None,
    progress: Progress | None = None,
) -> FleetPrior:
    """Write what to expect of a robot of a type, from the last calibration of each.

    Parameters
    ----------
    type : str
        Name of the nominal robot, as `irbcal.fleet_list` has it.
    out : str or Path
        File, JSON: for `irbcal.calibrate`.
    store : str or Path
        See `irbcal.fleet_add`.
    without : str, optional
        Id of a robot that is left out: one that is calibrated again with the same measurements.
    progress : callable, optional
        Called with a short text at each step.

    Raises
    ------
    CalibrationError
        If the store has too few robots of the type, or they began from different nominal robots.
    """
    with opened(store) as database:
        latest = database.numbers(type=type, last=1)
        if not latest:
            raise CalibrationError(f"the store has no calibrations of type {type}", file=str(store))
        robots = _of_type(database, latest, without)
    if len(robots) < FEWEST_OF_TYPE:
        raise CalibrationError(
            f"expected {FEWEST_OF_TYPE} or more calibrated robots of type {type} with their points, found "
            f"{len(robots)}: a prior from so few is worth nothing",
            file=str(store),
        )
    if progress is not None:
        progress(f"comparing {len(robots)} robots")
    prior, path = type_prior(robots), Path(out)
    write_together(path.parent, {path.name: prior_file.content(prior)})
    return FleetPrior(prior, path)


def _of_type(database: Store, latest: Sequence[int], without: str | None) -> list[Stored]:
    """Calibrations with terms, in their order: all, or as many as are needed."""
    drawn = np.random.default_rng(0).permutation(len(latest))
    chosen: dict[int, Stored] = {}
    for begin in range(0, len(drawn), MOST_OF_TYPE):
        some = np.sort(drawn[begin : begin + MOST_OF_TYPE]).tolist()
        calibrations = database.of_numbers([latest[k] for k in some], ("terms",))
        for k, stored in zip(some, calibrations, strict=True):
            if stored.terms is not None and stored.robot["id"] != without and len(chosen) < MOST_OF_TYPE:
                chosen[k] = stored
        if len(chosen) == MOST_OF_TYPE:
            break
    return [chosen[k] for k in sorted(chosen)]


def type_prior(robots: Sequence[Stored]) -> TypePrior:
    """What to expect of a robot, from calibrations of others of its type, one of each.

    Raises
    ------
    CalibrationError
        If they began from different nominal robots, or their numbers cannot be.
    """
    nominal = {stored.calibration["nominal_urdf_sha256"]: stored.robot["id"] for stored in robots}
    if len(nominal) > 1:
        first, second, *_ = nominal.values()
        raise CalibrationError(
            f"{first} and {second} were calibrated from different files of the nominal robot: their terms cannot be "
            "compared"
        )
    estimates = [stored.terms for stored in robots if stored.terms is not None]
    counts: dict[str, int] = {}
    for estimate in estimates:
        for name in estimate.names:
            counts[name] = counts.get(name, 0) + 1
    names = [name for name, count in counts.items() if count >= LEAST_SHARE * len(estimates)]
    sizes = {
        name: (estimate.natural[k], estimate.units[k])
        for estimate in estimates
        for name, k in estimate.column_of.items()
    }
    natural = np.array([sizes[name][0] for name in names])
    with np.errstate(all="ignore"):  # what becomes of it is looked at
        mean, std = population([_likelihood(estimate, names) for estimate in estimates])
    rows = zip(names, (natural * mean).tolist(), (natural * std).tolist(), strict=True)
    try:
        return TypePrior(
            type=robots[0].robot["type"],
            nominal_urdf_sha256=next(iter(nominal)),
            simulated=any(stored.calibration["simulated"] for stored in robots),
            robots=tuple(stored.robot["id"] for stored in robots),
            terms=tuple(
                TypeTerm(name=name, unit=sizes[name][1], mean=expected, std=scatter, natural=sizes[name][0])
                for name, expected, scatter in rows
            ),
        )
    except ValidationError:
        raise CalibrationError(
            "what the store says of these robots' terms gives no mean and scatter: is it damaged?"
        ) from None


def _likelihood(estimate: Estimate, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Information matrix and vector of the terms in natural sizes, without their wide prior; zero for those unseen."""
    rows = [estimate.column_of[name] for name in names if name in estimate.column_of]
    present = [k for k, name in enumerate(names) if name in estimate.column_of]
    size = estimate.natural[rows]
    precision = np.linalg.inv(estimate.covariance[np.ix_(rows, rows)] / np.outer(size, size))
    information, vector = np.zeros((len(names), len(names))), np.zeros(len(names))
    vector[present] = precision @ (estimate.values[rows] / size)
    information[np.ix_(present, present)] = 0.5 * (precision + precision.T) - WIDE**-2.0 * np.eye(len(rows))
    return information, vector


def population(likelihoods: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Mean of terms in a type, and the standard deviation that a new robot has about it.

    Parameters
    ----------
    likelihoods : sequence of (ndarray, ndarray)
        Information matrix (k, k) and vector (k,) of each robot.

    Returns
    -------
    mean, std : ndarray, shape (k,)
        ``std`` has the scatter of the robots, and what is not known of their mean were the other terms known. The
        prior has no correlations, and of all such this one is nearest to what is known (in the sense of Kullback and
        Leibler, from the prior to it): of terms that look alike, only whose sum they show, the sum stays known,
        and each by itself may be farther off than ``std``. Marginal deviations would be right for each, and would
        forget the sum, which is what makes the robot's errors.
    """
    L, b = (np.array(part) for part in zip(*likelihoods, strict=True))
    T = np.full(b.shape[1], 0.1)
    if len(L) > 2 * FIRST:
        T, *_ = _converged(L[:FIRST], b[:FIRST], T)
    T, mean, P = _converged(L, b, T)
    std: FloatArray = np.sqrt(T * (1.0 + 1.0 / len(L)) + 1.0 / np.diagonal(P))
    return mean, std


def _converged(L: FloatArray, b: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Variances of the fixed point, the mean there and its information matrix.

    Between two steps the logarithms of the variances go on along both, as far as these say (Varadhan and Roland 2008,
    "Simple and globally convergent methods for accelerating the convergence of any EM algorithm", scheme 3): a third of
    the steps is enough.
    """
    x, done = np.log(T), 0
    while True:
        path = [x]
        for _ in range(2):
            T, mean, P = _step(L, b, np.exp(path[-1]))
            path.append(np.log(T))
            done += 1
            if not np.abs(path[-1] - path[-2]).max() >= TOLERANCE or done >= ITERATIONS:
                return T, mean, P
        first = path[1] - path[0]
        bend = path[2] - path[1] - first
        length = np.clip(np.linalg.norm(first) / max(float(np.linalg.norm(bend)), 1e-300), 1.0, LONGEST_STEP)
        x = np.clip(path[0] + 2.0 * length * first + length**2 * bend, -30.0, 10.0)


def _step(L: FloatArray, b: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Variances after a step, the mean and its information matrix before it.

    With ``B = I + T^1/2 L T^1/2`` of each robot, the information matrix of its share of the mean is
    ``L (I + T L)^-1 = T^-1/2 (I - B^-1) T^-1/2``.
    """
    (n, k), s, eye = b.shape, np.sqrt(T), np.eye(len(T))
    inverse_sum, vectors, diagonal = np.zeros((k, k)), np.zeros((n, k)), np.zeros(k)
    chunks = [slice(start, start + FIRST) for start in range(0, n, FIRST)]
    inverses = []
    for chunk in chunks:
        inverse = np.linalg.inv(eye + s[:, None] * L[chunk] * s)
        inverse_sum += inverse.sum(axis=0)
        vectors[chunk] = np.einsum("nij,nj->ni", inverse, s * b[chunk])
        diagonal += np.diagonal(inverse, axis1=1, axis2=2).sum(axis=0)
        inverses.append(inverse)
    P = eye / MEAN**2 + (n * eye - inverse_sum) / np.outer(s, s)
    mean = np.asarray(np.linalg.solve(P, vectors.sum(axis=0) / s))
    squares = np.zeros(k)
    for chunk, inverse in zip(chunks, inverses, strict=True):
        residuals = s * (b[chunk] - L[chunk] @ mean)
        squares += np.square(s * np.einsum("nij,nj->ni", inverse, residuals)).sum(axis=0)
    return (squares + PRIOR_C2) / (n - diagonal + PRIOR_GAMMA), mean, P
