"""Geometry: constant motions of the joints' frames, which are the errors of the DHM table and go into the URDF."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import AXES, Family, OfNoJoint, Term
from irbcal.modeling.terms.waves import Expansion
from irbcal.units import MM

DHM_COLUMNS = {"rx": "alpha", "ry": "beta", "rz": "theta", "tx": "a", "ty": "b", "tz": "d"}
"""Axis -> column of the DHM table."""

SIZES = {"r": 1e-3, "t": 0.5 * MM}
"""Natural sizes of rotations (rad) and translations (m)."""


class Constant(OfNoJoint):
    """One, whatever the motion."""

    name = "constant"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Ones, shape (terms, n)."""
        return np.ones((len(terms), len(situation.motion)))

    def expansion(self, term: Term, arm: Arm, gravity: Sequence[float]) -> Expansion | None:
        """A wave without turns."""
        return {(0.0,) * len(arm.joint_names): 1.0 + 0.0j}


class Geometry(Family):
    """All six numbers that place a joint, of joints 2 to n: joint 1's are the base's."""

    name, of_type = "geometry", True
    bases = (Constant(),)

    def terms(self, arm: Arm) -> list[Term]:
        """Six terms a joint, by joint and then in the order of `AXES`."""
        units = {"r": "rad", "t": "m"}
        return [
            Term(j, axis, "constant", SIZES[axis[0]], self.name, self.name, units[axis[0]])
            for j in range(1, len(arm.joint_names))
            for axis in AXES
        ]


FAMILY = Geometry()
