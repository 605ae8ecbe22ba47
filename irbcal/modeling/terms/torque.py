"""Torque: the joints give way under the torques that the robot itself reports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, revolute

SIZE = 5e-5
"""Compliance of a joint, rad/(N m)."""


class MeasuredTorque(Basis):
    """The joint's own torque as the robot reports it, N m; zero where the motion does not tell it."""

    name = "torque"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Torque, shape (terms, n), N m."""
        torques = situation.motion.torques
        if torques is None:
            return np.zeros((len(terms), len(situation.motion)))
        return torques.T[[term.joint for term in terms]]

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Zeros, shape (terms, n, joints): what a torque would be elsewhere is not known."""
        return np.zeros((len(terms), *situation.motion.q.shape))


class Torque(Family):
    """One compliance a joint, one variance for all."""

    name = "torque"
    bases = (MeasuredTorque(),)

    def terms(self, arm: Arm) -> list[Term]:
        """One term a revolute joint."""
        return [Term(j, "rz", "torque", SIZE, self.name, self.name, "rad/(N m)") for j in revolute(arm)]


FAMILY = Torque()
