"""The only conversion factors of the project: millimetres, degrees, hours outside; metres, radians, seconds inside."""

from collections.abc import Mapping
from math import pi
from typing import NamedTuple

MM: float = 1e-3
"""One millimetre in metres."""

DEG: float = pi / 180.0
"""One degree in radians."""

HOUR: float = 3600.0
"""One hour in seconds."""

LARGEST_PAYLOAD_KG: float = 5e3
"""A larger mass is no payload of a robot: the largest arms carry 2,300 kg."""

UNIT_OUTSIDE: Mapping[str, tuple[str, float]] = {"m": ("mm", MM), "rad": ("deg", DEG), "1": ("1", 1.0)}
"""SI unit -> (unit at the surface, factor: value in SI = factor * value at the surface)."""


def joint_unit(slides: bool) -> tuple[str, float]:
    """Unit of a joint at the surface, and what one is in SI units: a millimetre where it slides, else a degree."""
    return UNIT_OUTSIDE["m" if slides else "rad"]


class ColumnKind(NamedTuple):
    """What a column of numbers holds."""

    expected: str
    """For messages."""
    low: float
    high: float
    """The smallest and the largest number that make sense."""
    unit: float = 1.0
    """What one is in SI units."""

    @property
    def noun(self) -> str:
        """What is expected, without bounds."""
        return self.expected.partition(" within ±")[0]
