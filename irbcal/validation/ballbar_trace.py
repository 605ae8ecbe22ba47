"""Traces of a ballbar: radial errors over the path angle, computed or read, and their figures (Nubiola 2011, annex VI).

Errors are taken about the centre that fits the circle best, as the ball is never exactly where the programme has the
centre; the deviation of the mean radius stays. Angles count along the path from its start. Lengths are in metres,
angles in radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.errors import MeasurementError
from irbcal.measurement.columns import InputTable, TableLike, distinct
from irbcal.units import DEG, MM
from irbcal.validation.ballbar_circle import TiltedCircle

FEWEST_READINGS = 8
SMALLEST_ARC = 180 * DEG
"""Part of the circle below which centre and radius cannot be told apart well enough."""

ANOTHER_CIRCLE = 0.05
"""Share of the bar by which readings may miss it before they are taken to be those of another circle."""

ROUNDS = 5
"""Gauss-Newton steps of the fit of the centre; the shift is a thousandth of the radius."""

MEASURED = "measured"
"""Name of the only run of a file without a column ``run``."""


@dataclass(frozen=True, eq=False)
class Trace(Locked):
    """Radial errors over the path angle.

    Attributes
    ----------
    angle : ndarray, shape (n,)
        Radians from the start of the path, ascending.
    error : ndarray, shape (n,)
        Distance from the ball minus the nominal length of the bar, metres.
    shift : ndarray, shape (2,)
        Of the fitted centre towards the start and towards a quarter turn later, metres; zero where it was not fitted.
    """

    angle: FloatArray
    error: FloatArray
    shift: FloatArray

    def at(self, angle: ArrayLike) -> FloatArray:
        """Error at other angles, by linear interpolation around the circle, metres."""
        return np.interp(np.asarray(angle) % (2 * np.pi), self.angle % (2 * np.pi), self.error, period=2 * np.pi)


def trace_of_points(path: TiltedCircle, points: FloatArray) -> Trace:
    """Radial errors of places of the tool near a circular path, about the best place of the ball.

    The ball is fixed: the shift of the true circle as a whole, also along the normal, is taken off. A tilt of the
    circle stays.

    Parameters
    ----------
    path : TiltedCircle
    points : ndarray, shape (n, 3)
        In the base link, metres.
    """
    offset = path.T_start[:3, 3] - path.center
    u = offset / np.linalg.norm(offset)
    v = np.cross(path.normal, u)
    relative = points - path.center
    angle = np.arctan2(relative @ v, relative @ u) % (2 * np.pi)
    relative = points - path.ball - path.normal * (relative @ path.normal).mean()
    ball = np.zeros(3)
    for _ in range(ROUNDS):
        to_ball = relative - ball
        distance = np.linalg.norm(to_ball, axis=1)
        A = np.column_stack([np.ones(len(to_ball)), to_ball @ u / distance, to_ball @ v / distance])
        step = np.linalg.lstsq(A, distance - path.bar, rcond=None)[0]
        ball = ball + step[1] * u + step[2] * v
    order = np.argsort(angle, kind="stable")
    error = np.linalg.norm(relative - ball, axis=1) - path.bar
    return Trace(angle[order], error[order], np.array([ball @ u, ball @ v]))


def centred(angle: ArrayLike, error: ArrayLike) -> Trace:
    """A trace with the best centre taken off: ``error = mean + a cos(angle) + b sin(angle) + rest``.

    Parameters
    ----------
    angle : ndarray, shape (n,)
        Radians.
    error : ndarray, shape (n,)
        Metres.

    Returns
    -------
    Trace
        Mean and rest; ``shift`` is (a, b).

    Raises
    ------
    MeasurementError
        If the readings cover too little of the circle.
    """
    at, error = np.asarray(angle, dtype=float), np.asarray(error, dtype=float)
    turn = np.sort(at % (2 * np.pi))
    gap = np.diff(np.append(turn, turn[0] + 2 * np.pi)).max() if len(turn) else 2 * np.pi
    if len(at) < FEWEST_READINGS or 2 * np.pi - gap < SMALLEST_ARC:
        raise MeasurementError(
            f"the centre needs {FEWEST_READINGS} readings or more over at least half a circle, found {len(at)} over "
            f"{(2 * np.pi - gap) / DEG:.0f} degrees"
        )
    A = np.column_stack([np.ones_like(at), np.cos(at), np.sin(at)])
    fit = np.linalg.lstsq(A, error, rcond=None)[0]
    order = np.argsort(at, kind="stable")
    return Trace(at[order], (error - A[:, 1:] @ fit[1:])[order], fit[1:])


def read(source: TableLike, bar: float) -> dict[str, Trace]:
    """A measured ballbar file: columns ``angle_deg`` and ``radius_mm`` (or ``error_mm``), optional ``run``.

    Angles count along the path from its start, in the sense of the motion, for either direction of travel.

    Parameters
    ----------
    source : str, Path or DataFrame
    bar : float
        Nominal length of the ballbar, metres.

    Returns
    -------
    dict of str to Trace
        Of each run, centred.

    Raises
    ------
    MeasurementError
        If the file does not keep the format, the radius is another one or too little of the circle was measured.
    """
    table = InputTable.read(source, ["angle_deg"])
    column = table.either("radius_mm", "error_mm")
    table = table[np.isfinite(table.numbers(column, lost=True))]
    angle, error = table.si("angle_deg"), table.si(column) - (bar if column == "radius_mm" else 0.0)
    if len(error) and np.median(np.abs(error)) > ANOTHER_CIRCLE * bar:
        sentence = f"the readings lie {np.median(error) / MM:+.3f} mm from the bar's {bar / MM:g} mm: another circle"
        raise table.fault(sentence, column=column)
    runs = table.texts("run", MEASURED)
    out = {}
    for name in distinct(runs) or [MEASURED]:
        rows = runs == name
        try:
            out[name] = centred(angle[rows], error[rows])
        except MeasurementError as refused:
            raise table.fault(f"run {name}: {refused}") from None
    return out


def summary(trace: Trace) -> dict[str, Any]:
    """Figures of a trace, mm: ``mean``, ``rms``, ``max_abs`` and circularity (largest minus smallest error)."""
    e = trace.error / MM
    return {
        "n": len(e),
        "mean_mm": float(e.mean()),
        "rms_mm": float(np.sqrt(np.mean(e**2))),
        "max_abs_mm": float(np.abs(e).max()),
        "circularity_mm": float(np.ptp(e)),
        "shift_mm": (trace.shift / MM).tolist(),
    }


def explained(measured: Trace, predicted: Trace) -> tuple[float, float]:
    """How much of a measured trace a prediction explains: rms before and after it is subtracted, metres.

    Both without their mean: the length of the ballbar is known less well than its changes.
    """
    error = measured.error - measured.error.mean()
    residual = measured.error - predicted.at(measured.angle)
    return float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean((residual - residual.mean()) ** 2)))
