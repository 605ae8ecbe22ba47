"""Coming to rest: position stabilisation time and overshoot of an approach (ISO 9283:1998; Nubiola 2011, annex V).

The formulas are those of public descriptions of the standard; the standard itself was not at hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.errors import MeasurementError

REST = 10.0
"""Seconds after which the thesis's robot was at rest (annex V)."""

READINGS = 100
"""Readings whose mean is the final position (annex V)."""


@dataclass(frozen=True, eq=False)
class Stabilisation(Locked):
    """How one approach came to rest (Nubiola 2011, Figure A V-1).

    Attributes
    ----------
    first_entry, settled : float
        When the limit band was entered first, and when it was entered and not left again, seconds; NaN if never.
    overshoot : float
        Largest distance after the first entry if that is beyond the band, else zero, metres; NaN without an entry.
    largest : float
        Largest distance after the first entry, metres.
    instant : ndarray, shape (n,)
        Of the readings, seconds.
    distance : ndarray, shape (n,)
        From the final position, metres.
    """

    first_entry: float
    settled: float
    overshoot: float
    largest: float
    instant: FloatArray
    distance: FloatArray

    @property
    def time(self) -> float:
        """Stabilisation time PSt, seconds; NaN if the robot never settled."""
        return self.settled - self.first_entry


def final_position(time: FloatArray, xyz: FloatArray, earliest: float = REST, count: int = READINGS) -> FloatArray:
    """Where a robot came to rest: mean of the first ``count`` readings from a time on (annex V: 100 after 10 s).

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds.
    xyz : ndarray, shape (n, 3)
        Metres.
    earliest : float
        Seconds.
    count : int

    Returns
    -------
    ndarray, shape (3,)
        Metres.

    Raises
    ------
    MeasurementError
        If no reading is that late.
    """
    late = np.flatnonzero(time >= earliest)
    if not len(late):
        raise MeasurementError(
            f"the readings end at {time.max():g} s: the final position is the mean of those after {earliest:g} s"
        )
    return xyz[late[:count]].mean(axis=0)


def stabilisation(time: FloatArray, xyz: FloatArray, final: FloatArray, band: float) -> Stabilisation:
    """Position stabilisation time PSt and overshoot of one approach (annex V).

    From the instant of the first entry into the limit band about the final position until the instant from which it is
    not left again; entries lie between two readings, on the straight line of the distance. A series that begins inside
    the band has entered it with its first reading.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds, ascending.
    xyz : ndarray, shape (n, 3)
        Metres.
    final : ndarray, shape (3,)
        Metres.
    band : float
        Radius of the limit band, metres.
    """
    distance = np.linalg.norm(xyz - final, axis=1)
    inside = distance <= band
    if not inside.any():
        return Stabilisation(np.nan, np.nan, np.nan, np.nan, time, distance)

    def entry(k: int) -> float:
        if k == 0:
            return float(time[0])
        share = (distance[k - 1] - band) / (distance[k - 1] - distance[k])
        return float(time[k - 1] + share * (time[k] - time[k - 1]))

    first = int(np.argmax(inside))
    outside = np.flatnonzero(~inside)
    last = int(outside[-1]) + 1 if len(outside) else 0
    largest = float(distance[first:].max())
    settled = entry(last) if last < len(time) else np.nan
    return Stabilisation(entry(first), settled, largest if largest > band else 0.0, largest, time, distance)
