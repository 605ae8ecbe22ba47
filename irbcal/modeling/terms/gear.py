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
RATIOS = 30, 320
"""Ratios that harmonic drives are built with."""


def gear_terms(joint: int, cycles: int) -> list[Term]:
    """Cosine and sine of one frequency of a joint (from 0), with a variance of their own."""
    return pair(joint, cycles, "rz", SIZE, f"gear_{joint + 1}_{cycles}", "gear")


def in_words(joint: int, cycles: int, amplitude_deg: float) -> str:
    """A found wave in words, and the harmonic drive that makes such a one: two teeth a turn of its wave generator.

    Parameters
    ----------
    joint : int
        From 1.
    cycles : int
        Per turn.
    amplitude_deg : float
        Degrees.
    """
    text = f"joint {joint}: {cycles} cycles per turn, {amplitude_deg:.4f} degrees"
    ratio, odd = divmod(cycles, 2)
    if odd or not RATIOS[0] <= ratio <= RATIOS[1]:
        return text
    return f"{text}: twice {ratio}, a harmonic drive of ratio {ratio}"


class Gear(Family):
    """Found frequencies."""

    name = "gear"

    def terms(self, arm: Arm) -> list[Term]:
        """None: they are found by a scan."""
        return []


FAMILY = Gear()
