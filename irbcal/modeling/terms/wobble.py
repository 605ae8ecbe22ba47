"""Wobble: a joint's axis is not fixed in its bearing, it tilts and shifts as the joint turns."""

from __future__ import annotations

from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.term import Family, Term, revolute
from irbcal.units import MM

SIZES = {"r": 5e-5, "t": 0.02 * MM}
ORDERS = (1, 2)


class Wobble(Family):
    """Tilts about x and y and shifts along x, y, z, orders 1 and 2 of the joint's angle."""

    name, moves_frames = "wobble", True

    def terms(self, arm: Arm) -> list[Term]:
        """Twenty terms a revolute joint; a variance for each joint, order, and for tilts and shifts.

        Of the divisions that were tried on an IRB 120 (by joint, by tilts and shifts, by axis, by order), this one
        gives the log evidence that the method was developed with.
        """
        units = {"r": "rad", "t": "m"}
        return [
            term
            for j in revolute(arm)
            for axis in ("rx", "ry", "tx", "ty", "tz")
            for k in ORDERS
            for term in pair(j, k, axis, SIZES[axis[0]], _group(self.name, j, axis, k), self.name, units[axis[0]])
        ]


def _group(family: str, joint: int, axis: str, order: int) -> str:
    return f"{family}_{joint + 1}_{'tilt' if axis[0] == 'r' else 'shift'}_{order}"


FAMILY = Wobble()
