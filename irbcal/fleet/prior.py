"""What to expect of a robot of a type, from its calibrated sisters: the mean and the scatter of each term.

Each sister's terms are drawn from ``N(mean, diag(variance))``; what its measurements show of them is a normal
likelihood. Mean and variances are those that make all sisters' measurements most probable (empirical Bayes, with
MacKay's fixed point for the variances as in `irbcal.identification.evidence_maximisation`). Correlations are not
looked for: with some tens of sisters there is nothing to tell them from.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError
from irbcal.fleet.batch import STORE
from irbcal.fleet.comparison import FEWEST_SISTERS
from irbcal.fleet.store import Estimate, Stored, opened
from irbcal.identification.evidence_maximisation import PRIOR_C2, PRIOR_GAMMA
from irbcal.identification.term_sets import WIDE, TypePrior
from irbcal.io import prior_file
from irbcal.safe_files import write_together
from irbcal.summary import Paragraph, Result, Table

MEAN = 4.0
"""Standard deviation of a type's mean about zero before anything is seen of it, natural sizes."""
ITERATIONS, TOLERANCE = 500, 0.01
"""Of the fixed point: most iterations, and the largest relative change of a variance after which it has converged."""
LEAST_SHARE = 0.5
"""Share of the sisters that must have a term for it to be taken."""


@dataclass(frozen=True, eq=False, repr=False)
class FleetPrior(Result):
    """A prior that was written."""

    prior: TypePrior
    out: Path

    def report(self) -> Sequence[Paragraph]:
        """From how many robots; the terms whose mean is farthest from nominal."""
        p = self.prior
        kind = "SIMULATED: " if p.simulated else ""
        far = np.argsort(-np.abs(p.mean) / p.natural)[:10]
        rows = tuple((p.names[k], p.mean[k] / p.natural[k], p.std[k] / p.natural[k]) for k in far)
        return [
            f"{kind}{len(p.names)} terms of type {p.type} from {len(p.sisters)} robots, written to {self.out}",
            Table("Terms farthest from nominal, in natural sizes", ("term", "mean", "scatter"), rows, 3),
            f"irbcal calibrate MEASUREMENTS --robot ROBOT --prior {shlex.quote(str(self.out))} --out FOLDER takes it.",
        ]

    CONTENT = "out type=prior.type sisters=prior.sisters"


def fleet_prior(
    type: str,
    out: str | Path,
    store: str | Path = STORE,
    *,
    without: str | None = None,
    progress: Callable[[str], Any] | None = None,
) -> FleetPrior:
    """Write what to expect of a robot of a type, from the last calibration of each sister.

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
        If the store has too few sisters, or they began from different nominal robots.
    """
    with opened(store) as database:
        latest = list(database.calibrations(type=type, last=1, parts=("terms",)))
    if not latest:
        raise CalibrationError(f"the store has no calibrations of type {type}", file=str(store))
    sisters = [stored for stored in latest if stored.terms is not None and stored.robot["id"] != without]
    if len(sisters) < FEWEST_SISTERS:
        raise CalibrationError(
            f"expected {FEWEST_SISTERS} or more calibrated robots of type {type} with their points, found "
            f"{len(sisters)}: a prior from so few is worth nothing",
            file=str(store),
        )
    if progress is not None:
        progress(f"comparing {len(sisters)} sisters")
    prior, path = type_prior(sisters), Path(out)
    write_together(path.parent, {path.name: prior_file.content(prior)})
    return FleetPrior(prior, path)


def type_prior(sisters: Sequence[Stored]) -> TypePrior:
    """What to expect of a robot, from calibrations of its sisters, one of each.

    Raises
    ------
    CalibrationError
        If they began from different nominal robots, or their numbers cannot be.
    """
    nominal = {stored.calibration["nominal_urdf_sha256"]: stored.robot["id"] for stored in sisters}
    if len(nominal) > 1:
        first, second, *_ = nominal.values()
        raise CalibrationError(
            f"{first} and {second} were calibrated from different files of the nominal robot: their terms cannot be "
            "compared"
        )
    estimates = [stored.terms for stored in sisters if stored.terms is not None]
    counts: dict[str, int] = {}
    for estimate in estimates:
        for name in estimate.names:
            counts[name] = counts.get(name, 0) + 1
    names = [name for name, count in counts.items() if count >= LEAST_SHARE * len(estimates)]
    sizes = {
        name: (estimate.natural[k], estimate.units[k]) for estimate in estimates for name, k in estimate.place.items()
    }
    natural = np.array([sizes[name][0] for name in names])
    with np.errstate(all="ignore"):  # what becomes of it is looked at
        mean, std = population([_likelihood(estimate, names) for estimate in estimates])
    if not (np.isfinite(mean).all() and np.isfinite(std).all()):
        raise CalibrationError("what the store says of these robots' terms gives no mean and scatter: is it damaged?")
    return TypePrior(
        sisters[0].robot["type"],
        next(iter(nominal)),
        tuple(stored.robot["id"] for stored in sisters),
        any(stored.calibration["simulated"] for stored in sisters),
        tuple(names),
        tuple(sizes[name][1] for name in names),
        natural * mean,
        natural * std,
        natural,
    )


def _likelihood(estimate: Estimate, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Information matrix and vector of the terms in natural sizes, without their wide prior; zero for those unseen."""
    rows = [estimate.place[name] for name in names if name in estimate.place]
    present = [k for k, name in enumerate(names) if name in estimate.place]
    size = estimate.natural[rows]
    precision = np.linalg.inv(estimate.covariance[np.ix_(rows, rows)] / np.outer(size, size))
    information, vector = np.zeros((len(names), len(names))), np.zeros(len(names))
    vector[present] = precision @ (estimate.values[rows] / size)
    information[np.ix_(present, present)] = 0.5 * (precision + precision.T) - WIDE**-2.0 * np.eye(len(rows))
    return information, vector


def population(likelihoods: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Mean of terms among sisters, and the standard deviation that a new sister has about it.

    Parameters
    ----------
    likelihoods : sequence of (ndarray, ndarray)
        Information matrix (k, k) and vector (k,) of each sister.

    Returns
    -------
    mean, std : ndarray, shape (k,)
        ``std`` has the scatter of the sisters, and what is not known of their mean were the other terms known. The
        prior has no correlations, and of all such this one is nearest to what is known (in the sense of Kullback and
        Leibler, from the prior to it): of terms that look alike, only whose sum sisters show, the sum stays known,
        and each by itself may be farther off than ``std``. Marginal deviations would be right for each, and would
        forget the sum, which is what makes the robot's errors.
    """
    n, k = len(likelihoods), len(likelihoods[0][1])
    T, mean = np.full(k, 0.1), np.zeros(k)
    eye = np.eye(k)
    for _ in range(ITERATIONS):
        P, r = eye / MEAN**2, np.zeros(k)
        inverse = []
        for L, b in likelihoods:
            M = np.linalg.inv(eye + L * T)
            inverse.append(M)
            P += M @ L
            r += M @ b
        mean = np.asarray(np.linalg.solve(P, r))
        squares, gammas = np.zeros(k), np.zeros(k)
        for (L, b), M in zip(likelihoods, inverse, strict=True):
            squares += (T * (M @ (b - L @ mean))) ** 2
            gammas += 1.0 - np.diagonal(M)
        T_before, T = T, (squares + PRIOR_C2) / (gammas + PRIOR_GAMMA)
        if np.abs(np.log(T / T_before)).max() < TOLERANCE:
            break
    std: FloatArray = np.sqrt(T * (1.0 + 1.0 / n) + 1.0 / np.diagonal(P))
    return mean, std
