"""Torque: the joints give way under the torques that the robot itself reports."""

from __future__ import annotations

from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.term import Family, Input, Proportional, Term, revolute
from irbcal.units import ColumnKind

SIZE = 5e-5
"""Compliance of a joint, rad/(N m)."""


TORQUES = Input(
    "torques",
    ("tau{}_nm",),
    ColumnKind("a torque in N m", -1e6, 1e6),
    "torques",
    "It takes the torques that the robot reports. Where none are given they count as zero, which no arm's are: "
    "predictions without them miss what the joints give way.",
    on_request=True,
)


class MeasuredTorque(Proportional):
    """The joint's own torque as the robot reports it, N m; zero where the motion does not tell it."""

    name = "torque"
    inputs = (TORQUES,)


class Torque(Family):
    """One compliance a joint, one variance for all."""

    name = "torque"
    bases = (MeasuredTorque(),)

    def terms(self, arm: Arm) -> list[Term]:
        """One term a revolute joint."""
        return [Term(j, "rz", "torque", SIZE, self.name, self.name, "rad/(N m)") for j in revolute(arm)]


FAMILY = Torque()
