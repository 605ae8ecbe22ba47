"""Harmonics: cosine and sine of whole multiples of a joint's angle, from encoders, gears and bearings that run out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, by_own_joint, revolute
from irbcal.modeling.terms.waves import Expansion

SIZE = 2e-4
LOW = 2
"""Orders of the short series."""
HIGHEST, LONGEST = 45, 120
"""Orders of the long series, and of what is tried beyond it."""
BANDS = tuple(range(5, LONGEST + 1, 5))
"""Last order of each band of the long series: a variance for each joint and band. Bands of three to five orders gave
log evidences within four nats of one another on an IRB 120; bands of five predict held-out poses of a UR10 best."""


class Harmonic(Basis):
    """Cosine or sine of a multiple of the joint's own angle (parameter ``cycles_per_turn``)."""

    def __init__(self, name: str, quarter: float) -> None:
        self.name, self._shift = name, quarter * np.pi / 2  # sin x = cos(x - 90 degrees)

    def _phase(self, terms: Sequence[Term], situation: Situation) -> tuple[FloatArray, FloatArray]:
        cycles = np.array([float(str(t.parameters["cycles_per_turn"])) for t in terms])[:, None]
        return cycles, cycles * situation.motion.q.T[[t.joint for t in terms]] - self._shift

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """The wave, shape (terms, n)."""
        return cos_sin(self._phase(terms, situation)[1])[0]

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the own joint, shape (terms, n, joints)."""
        cycles, phase = self._phase(terms, situation)
        return by_own_joint(terms, situation, -cycles * cos_sin(phase)[1])

    def slope_rates(self, terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
        """Derivative of the slopes along joint speeds (n, joints), shape (terms, n, joints)."""
        cycles, phase = self._phase(terms, situation)
        return by_own_joint(terms, situation, -(cycles**2) * cos_sin(phase)[0] * dq.T[[t.joint for t in terms]])

    def expansion(self, term: Term, arm: Arm, gravity: Sequence[float]) -> Expansion | None:
        """One wave of the joint."""
        cycles = float(str(term.parameters["cycles_per_turn"]))
        turns = tuple(cycles if j == term.joint else 0.0 for j in range(len(arm.joint_names)))
        return {turns: complex(np.exp(-1j * self._shift))}


def pair(joint: int, cycles: int, axis: str, size: float, group: str, family: str, unit: str = "rad") -> list[Term]:
    """Cosine and sine of one frequency, cycles per turn."""
    parameters = {"cycles_per_turn": cycles}
    return [Term(joint, axis, basis, size, group, family, unit, parameters) for basis in ("cos", "sin")]


def order(term: Term) -> int:
    """Cycles per turn of a harmonic term."""
    return int(str(term.parameters["cycles_per_turn"]))


def bands(highest: int) -> list[int]:
    """Last orders of the bands of a series up to an order."""
    return [*(edge for edge in BANDS if edge < highest), highest]


def band_group(term: Term, highest: int) -> str:
    """Group of a harmonic in a series up to an order: one a joint and band."""
    edges = [0, *bands(highest)]
    lower, upper = next((a + 1, b) for a, b in pairwise(edges) if order(term) <= b)
    return f"harmonics_{term.joint + 1}_{lower}_{upper}"


class Harmonics(Family):
    """The long series of every revolute joint; dictionaries take as much of it as they need."""

    name, of_type = "harmonics", True
    bases = (Harmonic("cos", 0.0), Harmonic("sin", 1.0))

    def terms(self, arm: Arm, lowest: int = 1, highest: int = HIGHEST) -> list[Term]:
        """Some orders of each joint; the group is that of the short series, see `band_group` for others."""
        return [
            term
            for j in revolute(arm)
            for k in range(lowest, highest + 1)
            for term in pair(j, k, "rz", SIZE, f"{self.name}_{j + 1}", self.name)
        ]


FAMILY = Harmonics()
