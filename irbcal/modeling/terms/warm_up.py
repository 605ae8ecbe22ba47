"""Warm-up: every joint's frame drifts to its place as the arm warms; nothing is left of it at use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import AXES, Basis, Family, Term
from irbcal.units import MM

SIZES = {"r": 1e-4, "t": 0.03 * MM}
SHARES = (0.0625, 0.125, 0.25, 0.5)
"""Time constants that are compared, as shares of the time that the measurement took. None is longer than half of it:
evidence alone may prefer more (0.8 on an IRB 120, by one nat), but a drift that is not over by the end is extrapolated
to the warm arm, which took the held-out error there from 0.07 to 0.083 mm."""


class Decay(Basis):
    """``exp(-t / tau)`` (parameter ``tau``, in the unit of the motion's time); zero for a motion without time."""

    name = "decay"

    def values(self, terms: Sequence[Term], here: Situation) -> FloatArray:
        """What is left of the drift, 1 to 0, shape (terms, n)."""
        elapsed = here.motion.elapsed
        if elapsed is None:
            return np.zeros((len(terms), len(here.motion)))
        tau = np.array([float(str(t.parameters["tau"])) for t in terms])
        distinct, which = np.unique(tau, return_inverse=True)
        return np.exp(-elapsed / distinct[:, None])[which]

    def slopes(self, terms: Sequence[Term], here: Situation) -> FloatArray:
        """Zeros: time is not a joint, shape (terms, n, joints)."""
        return np.zeros((len(terms), *here.motion.q.shape))


class WarmUp(Family):
    """All six motions of all joints, one variance for all.

    Parameters
    ----------
    tau : float
        Time constant, in the unit of the motion's time: poses or minutes.
    """

    name = "warm_up"
    bases = (Decay(),)

    def __init__(self, tau: float = 100.0) -> None:
        self.tau = tau

    def terms(self, arm: Arm) -> list[Term]:
        """Six terms a joint."""
        units, parameters = {"r": "rad", "t": "m"}, {"tau": self.tau}
        return [
            Term(j, axis, "decay", SIZES[axis[0]], self.name, self.name, units[axis[0]], parameters)
            for j in range(len(arm.joint_names))
            for axis in AXES
        ]


FAMILY = WarmUp()
