"""What an outlier is, in points of a tracker and in rows at features alike, and how many may be left out.

Before identification a measurement is an outlier by its distance from a robot that wrong ones cannot bend
(`irbcal.identification.outliers`); after model ``auto`` by how far all others put it elsewhere
(`irbcal.identification.leave_one_out.outliers`), which shows smaller ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.identification.choices import Level
from irbcal.units import MM

QUANTILE = 0.3
"""The distance that this share stays below is that of the middle good point even if 40 % are wrong."""


@dataclass(frozen=True)
class OutlierRule:
    """From where on a measurement is an outlier."""

    distance: float = 12.0
    """Multiple of the distance from a robot that `QUANTILE` of the measurements stay below."""
    nominal_floor: float = 5 * MM
    offsets_floor: float = 2 * MM
    floor: float = 1 * MM
    """Distance below which none is an outlier: from the nominal robot, one with joint offsets, any other; metres."""
    contradiction: float = 6.0
    """Multiple of the median left-out residual. Of an IRB 120, a UR10 and SIMULATED robots, 46 to 400 poses, good
    points reach 3.9 (two of 300 on a grid more than 5); points that are 3 mm off stand at 4.5 to 30."""
    contradiction_of_few: float = 9.0
    """The same for measurements of one or two numbers, whose median is a smaller part of their standard deviation."""
    share: float = 0.1
    """Largest share of the measurements that is left out by a fit: of more outliers none is."""

    def distance_limit(self, distance: FloatArray, level: Level | None = None) -> float:
        """Distance from a robot of a level beyond which a measurement is an outlier, metres, from those of all."""
        floor = {"nominal": self.nominal_floor, "offsets": self.offsets_floor}.get(level or "", self.floor)
        return max(floor, self.distance * float(np.quantile(distance, QUANTILE)))

    def contradiction_factor(self, numbers: IntArray) -> FloatArray:
        """Multiple of the median left-out residual for measurements of so many numbers each."""
        return np.where(numbers < 3, self.contradiction_of_few, self.contradiction)

    def too_many(self, outliers: int, measurements: int) -> bool:
        """Whether so many are more than what is left out."""
        return outliers > self.share * measurements


RULE = OutlierRule()
"""That of `irbcal.calibrate`."""
