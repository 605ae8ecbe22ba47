"""Warm-up: every joint's frame drifts to its place as the arm warms; at use it is as at the end of the measurement.

The drift counts from where the measurement ended, not from an arm that is warm for ever: the last poses were seen, and
a drift that is not over by then would have to be extrapolated (on an IRB 120, 400 poses, all terms, that gave a
held-out error of 0.049 mm in place of 0.039, where a long time constant happened to be chosen).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import AXES, Family, OfNoJoint, Term
from irbcal.units import MM

SIZES = {"r": 1e-4, "t": 0.03 * MM}
SHARES = (0.0625, 0.125, 0.25, 0.5)
"""Time constants that are compared, as shares of the time that the measurement took. None is longer than half of it:
evidence alone may prefer more (0.8 on an IRB 120, by one nat), but a drift that is not over by the end is extrapolated
to the warm arm, which took the held-out error there from 0.07 to 0.083 mm."""


class Decay(OfNoJoint):
    """``exp(-t / tau) - exp(-end / tau)``, zero for a motion without time.

    Parameters ``tau`` and ``end`` are in the unit of the motion's time; without ``end`` the second part is zero.
    """

    name = "decay"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """What is left of the drift, shape (terms, n)."""
        elapsed = situation.motion.elapsed
        if elapsed is None:
            return np.zeros((len(terms), len(situation.motion)))
        times = np.array([[float(str(t.parameters.get(key, np.inf))) for key in ("tau", "end")] for t in terms])
        distinct, which = np.unique(times, axis=0, return_inverse=True)
        tau, end = distinct[:, :1], distinct[:, 1:]
        return (np.exp(-elapsed / tau) - np.exp(-end / tau))[which.ravel()]


class WarmUp(Family):
    """All six motions of all joints, one variance for all.

    Parameters
    ----------
    tau : float
        Time constant, in the unit of the motion's time: poses or minutes.
    end : float, optional
        When the measurement ended; never unless given.
    """

    name = "warm_up"
    bases = (Decay(),)

    def __init__(self, tau: float = 100.0, end: float | None = None) -> None:
        self.tau, self.end = tau, end

    def terms(self, arm: Arm) -> list[Term]:
        """Six terms a joint."""
        units, parameters = {"r": "rad", "t": "m"}, {"tau": self.tau}
        if self.end is not None:
            parameters["end"] = self.end
        return [
            Term(j, axis, "decay", SIZES[axis[0]], self.name, self.name, units[axis[0]], parameters)
            for j in range(len(arm.joint_names))
            for axis in AXES
        ]


FAMILY = WarmUp()
