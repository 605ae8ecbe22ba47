"""The end-effector of the virtual cell: nine reflectors on the flange (Nubiola 2011, section 3.4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.units import MM

TABLE_3_1 = {
    # target: CAD, real (Nubiola 2011, Table 3.1), in tool0, mm
    "smr1": ((-87.300, 87.300, 109.480), (-87.370, 87.202, 110.020)),
    "smr2": ((84.300, 84.300, 109.480), (84.419, 84.260, 109.928)),
    "smr3": ((85.800, -85.800, 109.480), (85.990, -85.788, 109.959)),
    "smr4": ((-86.300, -86.300, 109.480), (-86.207, -86.339, 110.039)),
    "smr5": ((-59.500, 59.500, 56.800), (-59.465, 59.477, 57.489)),
    "smr6": ((63.500, 63.500, 56.800), (63.460, 63.527, 57.407)),
    "smr7": ((62.000, -62.000, 56.800), (62.071, -61.982, 57.408)),
    "smr8": ((-63.000, -63.000, 56.800), (-62.918, -63.055, 57.454)),
    "smr9": ((0.000, 0.000, 109.480), (0.049, -0.032, 109.974)),
}
"""The nine targets of Nubiola 2011, Table 3.1 (Nubiola 2011, section 3.4.4): 1 to 4 and 9 on the front (1.5 inch),
5 to 8 on the back (0.5 inch)."""

PAYLOAD_KG = 3.0
"""The tool with its nine reflectors (Nubiola 2011, section 3.4.1: 1.8 kg and 1.2 kg)."""

PAYLOAD_CENTRE = (0.0, 0.0, 75.0 * MM)
"""Centre of mass in tool0, given for tool, reflectors and eight discs (Nubiola 2011, section 3.4.1); used for every
payload."""


@dataclass(frozen=True, eq=False)
class EndEffector(Locked):
    """A rigid tool with reflectors.

    Parameters
    ----------
    names : tuple of str
    cad, real : ndarray, shape (k, 3)
        Places in the tip link as drawn and as they are, metres.
    direction : ndarray, shape (k, 3)
        Unit vectors in the tip link: where each reflector looks.
    payload_kg : float
    payload_centre : ndarray, shape (3,)
        Centre of mass in the tip link, metres.
    """

    names: tuple[str, ...]
    cad: FloatArray
    real: FloatArray
    direction: FloatArray
    payload_kg: float
    payload_centre: FloatArray

    def only(self, names: Sequence[str]) -> EndEffector:
        """The same tool measured at these targets."""
        rows = [self.names.index(name) for name in names]
        return replace(
            self, names=tuple(names), cad=self.cad[rows], real=self.real[rows], direction=self.direction[rows]
        )


def thesis_tool(look: ArrayLike, scale: float = 1.0, payload_kg: float = PAYLOAD_KG) -> EndEffector:
    """The end-effector of Nubiola 2011, section 3.4.1, with the targets of Nubiola 2011, Table 3.1.

    Parameters
    ----------
    look : array_like, shape (3,)
        Where the front reflectors look, in the tip link; those on the back look the other way along the tool's axis.
        The nests let a reflector be turned, and the thesis does so by hand (Nubiola 2011, section
        7.1).
    scale : float
        Size against the thesis's tool: smaller arms carry a smaller one.
    payload_kg : float
    """
    front = np.asarray(look, dtype=float) / np.linalg.norm(look)
    rear = front * [1.0, 1.0, -1.0]
    cad, real = (scale * MM * np.array([pair[k] for pair in TABLE_3_1.values()]) for k in (0, 1))
    direction = np.array([rear if name in ("smr5", "smr6", "smr7", "smr8") else front for name in TABLE_3_1])
    return EndEffector(
        tuple(TABLE_3_1), cad, real, direction, payload_kg, scale * np.asarray(PAYLOAD_CENTRE, dtype=float)
    )
