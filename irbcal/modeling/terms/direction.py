"""Direction: a joint stops at another place when it comes from the other side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, by_own_joint, own_axis, own_unit
from irbcal.units import DEG, MM

SIZES = {"rad": 1e-4, "m": 0.03 * MM}
WIDTHS = {"rad": 0.5 * DEG, "m": 0.5 * MM}
"""Move of a joint that takes up about three quarters of the play."""


class Direction(Basis):
    """``tanh(D_j / width)`` of the joint's own last move (parameter ``width_rad`` or ``width_m``)."""

    name, bounded_history = "direction", True

    def _tanh(self, terms: Sequence[Term], situation: Situation) -> tuple[FloatArray, FloatArray]:
        keys = [t.parameters.get("width_rad", t.parameters.get("width_m")) for t in terms]
        width = np.array([float(str(key)) for key in keys])[:, None]
        return width, np.tanh(situation.motion.moves.T[[t.joint for t in terms]] / width)

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """The side that the joint came from, -1 to 1, shape (terms, n)."""
        return self._tanh(terms, situation)[1]

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the own joint, the stop before held, shape (terms, n, joints)."""
        width, side = self._tanh(terms, situation)
        return by_own_joint(terms, situation, (1.0 - side**2) / width)

    def slope_rates(self, terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
        """Derivative of the slopes along joint speeds (n, joints), shape (terms, n, joints)."""
        width, side = self._tanh(terms, situation)
        rate = -2.0 * side * (1.0 - side**2) / width**2
        return by_own_joint(terms, situation, rate * dq.T[[t.joint for t in terms]])


class DirectionFamily(Family):
    """One term a joint, each with a variance of its own."""

    name, of_moves, of_type = "direction", True, True
    bases = (Direction(),)

    def terms(self, arm: Arm) -> list[Term]:
        """One term a joint."""
        out = []
        for j in range(len(arm.joint_names)):
            unit = own_unit(arm, j)
            parameters = {f"width_{unit}": WIDTHS[unit]}
            group = f"{self.name}_{j + 1}"
            out.append(Term(j, own_axis(arm, j), "direction", SIZES[unit], group, self.name, unit, parameters))
        return out


FAMILY = DirectionFamily()
