"""Robots of one type beside each other: which stand out, and what to expect of the next one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import CalibrationError
from irbcal.fleet.store import Estimate, Store, Stored, opened
from irbcal.fleet.words import amount, called

FEWEST = 5
"""Sisters that are needed to say what is usual."""
STANDS_OUT = 5.0
"""Standard deviations (of sisters and of the identification) from the middle of the sisters."""
MOST = 3
"""Parameters of a robot that are told of."""
ROUNDS = 60
"""Of the iteration to the mean and scatter of a type."""
LEAST = 1e-3
"""Smallest scatter of a type, in what was expected before."""


@dataclass(frozen=True)
class StandsOut:
    """A robot unlike its sisters.

    Attributes
    ----------
    robot : str
    deviations : float
        The largest.
    words : str
    """

    robot: str
    deviations: float
    words: str


def latest(calibrations: Sequence[Stored]) -> list[Stored]:
    """The last calibration of each robot, robots by their ids."""
    return list({one.robot["id"]: one for one in calibrations}.values())


def standing_out(sisters: Sequence[Stored]) -> list[StandsOut]:
    """Robots of one type that stand out of it, the farthest first; none of fewer than `FEWEST` sisters.

    Parameters
    ----------
    sisters : sequence of Stored
        One calibration of each robot.
    """
    if len(sisters) < FEWEST:
        return []
    found: dict[str, list[tuple[float, str]]] = {}
    levels = [(one, one.level) for one in sisters if one.level is not None]
    for name in sorted({name for _, level in levels for name in level.names}):
        having = [(one, level, level.place[name]) for one, level in levels if name in level.place]
        if len(having) < FEWEST:
            continue
        values = np.array([level.values[k] for _, level, k in having])
        stds = np.sqrt([max(level.covariance[k, k], 0.0) for _, level, k in having])
        middle, spread = _middle(values)
        away = values - middle
        total = np.sqrt(spread**2 + stds**2)
        far = np.divide(np.abs(away), total, out=np.zeros_like(total), where=total > 0.0)
        for (one, level, k), value, std, z in zip(having, away, total, far, strict=True):
            if z > STANDS_OUT:
                words = f"{called(name)[0]} is {amount(value, std, level.units[k])} from the middle of its sisters"
                found.setdefault(one.robot["id"], []).append((float(z), words))
    for one, z, words in _errors(sisters):
        found.setdefault(one.robot["id"], []).append((z, words))
    out = []
    for robot, reasons in found.items():
        reasons.sort(reverse=True)
        more = f"; and {len(reasons) - MOST} more" if len(reasons) > MOST else ""
        out.append(StandsOut(robot, reasons[0][0], "; ".join(words for _, words in reasons[:MOST]) + more))
    return sorted(out, key=lambda item: -item.deviations)


def _errors(sisters: Sequence[Stored]) -> list[tuple[Stored, float, str]]:
    """Robots whose calibrated error is far larger than their sisters'."""
    known = [one for one in sisters if one.calibration["heldout_mean_mm"]]
    if len(known) < FEWEST:
        return []
    errors = np.array([one.calibration["heldout_mean_mm"] for one in known])
    middle, spread = _middle(np.log(errors))
    far = (np.log(errors) - middle) / max(spread, 0.05)
    usual = float(np.exp(middle))
    return [
        (one, float(z), f"its held-out mean error is {error:.3f} mm, that of its sisters {usual:.3f} mm")
        for one, error, z in zip(known, errors, far, strict=True)
        if z > STANDS_OUT
    ]


def _middle(values: FloatArray) -> tuple[float, float]:
    """Median, and standard deviation from the median of distances from it."""
    middle = float(np.median(values))
    return middle, 1.4826 * float(np.median(np.abs(values - middle)))


@dataclass(frozen=True, eq=False)
class TypePrior:
    """What is known of a robot's parameters from its calibrated sisters.

    Attributes
    ----------
    type : str
    sisters : int
    names : tuple of str
    mean, std : ndarray, shape (k,)
        SI units.
    """

    type: str
    sisters: int
    names: tuple[str, ...]
    mean: FloatArray
    std: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    def of(self) -> dict[str, tuple[float, float]]:
        """Name -> mean and standard deviation."""
        return {n: (float(m), float(s)) for n, m, s in zip(self.names, self.mean, self.std, strict=True)}


def prior_of(sisters: Sequence[Stored]) -> TypePrior:
    """Mean and scatter of a type's parameters by empirical Bayes.

    What each calibration's data alone say (its posterior without its own prior) is the observation; mean and scatter
    of the type are iterated (EM) to what makes the observations most probable.

    Parameters
    ----------
    sisters : sequence of Stored
        One calibration by model ``auto`` of each robot.

    Raises
    ------
    CalibrationError
        If there are fewer than `FEWEST`.
    """
    sisters = [one for one in sisters if np.isfinite(one.fit.prior).all()]
    if len(sisters) < FEWEST:
        raise CalibrationError(
            f"{len(sisters)} sisters calibrated by model auto are too few to say what is usual: {FEWEST} are needed"
        )
    count: dict[str, int] = {}
    for one in sisters:
        for name in one.fit.names:
            count[name] = count.get(name, 0) + 1
    names = tuple(name for name, n in count.items() if 2 * n >= len(sisters))
    place = {name: k for k, name in enumerate(names)}
    data = [_data_of(one.fit, place) for one in sisters]
    first = np.array(
        [np.mean([one.fit.prior[one.fit.place[name]] for one in sisters if name in one.fit.place]) for name in names]
    )
    mean, variance = np.zeros(len(names)), first**2
    for _ in range(ROUNDS):
        means, squares = np.zeros(len(names)), np.zeros(len(names))
        posterior = []
        for rows, precision, right in data:
            inverse = np.linalg.inv(precision + np.diag(1.0 / variance[rows]))
            c, v = mean.copy(), variance.copy()
            c[rows] = inverse @ (right + mean[rows] / variance[rows])
            v[rows] = np.diagonal(inverse)
            means += c
            posterior.append((c, v))
        means /= len(data)
        for c, v in posterior:
            squares += (c - means) ** 2 + v
        mean, variance = means, np.maximum(squares / len(data), (LEAST * first) ** 2)
    return TypePrior(sisters[0].robot["type"], len(sisters), names, mean, np.sqrt(variance))


def _data_of(one: Estimate, place: dict[str, int]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the data alone say of the parameters of a type: their places, precision and precision times value."""
    mine = np.array([k for k, name in enumerate(one.names) if name in place], dtype=int)
    rows = np.array([place[one.names[k]] for k in mine], dtype=int)
    size = one.prior[mine]
    C = one.covariance[np.ix_(mine, mine)] / np.outer(size, size)
    whole = np.linalg.inv(C + 1e-9 * np.eye(len(mine)))
    values, vectors = np.linalg.eigh(whole - np.eye(len(mine)))
    precision = (vectors * np.maximum(values, 0.0)) @ vectors.T
    right = whole @ (one.values[mine] / size)
    return rows, precision / np.outer(size, size), right / size


def prior_from(store: str | Path, type: str, without: str | None = None) -> TypePrior:
    """The prior of a type from a store.

    Parameters
    ----------
    store : str or Path
    type : str
        Name of the nominal robot.
    without : str, optional
        Id of the robot that it is for: its own earlier calibrations say nothing of its sisters.

    Raises
    ------
    CalibrationError
        If the store has too few robots of the type.
    """
    with opened(store) as held:
        return prior_of(_sisters(held, type, without))


def _sisters(store: Store, type: str, without: str | None) -> list[Stored]:
    found = [one for one in store.calibrations(type=type) if one.calibration["model"] == "auto"]
    return [one for one in latest(found) if one.robot["id"] != without]
