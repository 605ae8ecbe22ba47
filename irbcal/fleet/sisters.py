"""Robots of one type beside each other: which stand out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.fleet.store import Stored
from irbcal.fleet.words import amount, called

FEWEST = 5
"""Sisters that are needed to say what is usual."""
STANDS_OUT = 5.0
"""Standard deviations (of sisters and of the identification) from the middle of the sisters."""
MOST = 3
"""Parameters of a robot that are told of."""


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
