"""What checks say of their tables."""

from __future__ import annotations

from irbcal.arrays import NameArray

AXES, ANGLES = "xyz", "abc"
"""Endings of names: along the axes of the base link, and about them."""


def in_order(labels: NameArray) -> list[str]:
    """Different names in the order of their first rows."""
    return [str(name) for name in dict.fromkeys(labels)]


def start_of(simulated: bool) -> str:
    """How the first sentence on simulated data begins."""
    return "SIMULATED data: " if simulated else ""
