"""Gear: single high harmonics of a joint, as gears make them (a harmonic drive: twice a whole number of cycles a turn).

The family has no terms of its own accord: a scan over all frequencies finds them, `irbcal.identification.gear_scan`.
"""

from __future__ import annotations

from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.term import Family, Term

SIZE = 5e-5
LOWEST, HIGHEST = 5, 420
"""Cycles per turn that a scan covers."""


def gear_terms(joint: int, cycles: int) -> list[Term]:
    """Cosine and sine of one frequency of a joint (from 0), with a variance of their own."""
    return pair(joint, cycles, "rz", SIZE, f"gear_{joint + 1}_{cycles}", "gear")


class Gear(Family):
    """Found frequencies."""

    name = "gear"

    def terms(self, arm: Arm) -> list[Term]:
        """None: they are found by a scan."""
        return []


FAMILY = Gear()
