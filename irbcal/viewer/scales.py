"""Round numbers for errors that are drawn: how much they are magnified, and where the colours end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.units import MM

NICE = (1.0, 2.0, 5.0)


def nice(value: float, up: bool = False) -> float:
    """The largest of 1, 2, 5, 10, 20 ... not above a value (the smallest not below it with ``up``)."""
    decade = 10.0 ** np.floor(np.log10(value))
    steps = decade * np.array([*NICE, 10.0])
    return float(steps[steps >= value * (1 - 1e-9)][0] if up else steps[steps <= value * (1 + 1e-9)][-1])


def default_magnification(errors: Sequence[FloatArray] | None, size: float) -> float:
    """A round factor that makes the vectors of the worse model about a fourteenth of the robot on average."""
    mean = 0.0 if errors is None else max(error.mean() for error in errors)
    return nice(0.07 * size / mean) if mean > 1e-9 else 100.0


def scale_top(errors: Sequence[FloatArray] | None) -> float:
    """Upper end of the colours, metres: a round number above (nearly) all errors of both models."""
    if errors is None:
        return 1 * MM
    together = np.concatenate(errors)
    largest, usual = together.max(), np.quantile(together, 0.99)
    top = largest if largest < 3 * usual else usual
    if top < 1e-9:
        return 1 * MM
    step = nice(top / 2)
    return float(np.ceil(top / step * (1 - 1e-9)) * step)
