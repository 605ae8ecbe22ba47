"""What weight does to the virtual robot: its joints give way, and its frames tilt.

Sizes of the shipped setting come from the thesis where it has them, see `irbcal.simulation.robot_effects`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.arm import Arm
from irbcal.simulation.effect import Amounts, Effect, Motion, fitted
from irbcal.simulation.in_terms import lever_amounts
from irbcal.simulation.masses import Bodies


@dataclass(frozen=True)
class Compliance(Effect):
    """Every joint gives way under gravity: link masses of the URDF and payload (Nubiola 2011, section 4.3.1).

    It takes the place of the joint map's two numbers: joints 2 and 3 have compliances of their own, the payload hangs
    at the end of the wrist, and joints 4 to 6 give way as well. Compliances of joints 2 and 3 follow from Nubiola
    2011, Table 4.3:
    3 kg on the stretched arm make 0.3 mm, and the arm's own weight then makes about 2 mm. Those of the wrist are
    guesses: below 0.1 mm at the tool.

    Parameters
    ----------
    rad_per_Nm : tuple of float
        Compliance of joints 1 to n (prismatic joints: metres per newton).
    """

    name: ClassVar[str] = "compliance"
    summary: ClassVar[str] = "every joint gives way under the links' and the payload's weight (section 4.3)"
    rad_per_Nm: tuple[float, ...] = (1.0e-6, 3.6e-6, 3.0e-6, 5.0e-5, 5.0e-5, 5.0e-5)

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        return -np.array(self.rad_per_Nm) * motion.torque - motion.stiffness

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        # torques grow as the fourth power of the size, deflections in degrees stay
        return replace(self, rad_per_Nm=fitted(np.array(self.rad_per_Nm) / size**4, prismatic, 1e-8))

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return lever_amounts(arm, bodies, "gravity", {"rz": np.array(self.rad_per_Nm)})


@dataclass(frozen=True)
class Bending(Effect):
    """Links and bearings bend: a joint's frame tilts about the two axes that the joint does not turn about.

    Beyond Nubiola 2011, whose section 4.3 lets joints give way about their own axes only. Sizes: up to 0.1 mrad on an
    arm of the IRB 1600's weight, as evidence shows it on a measured IRB 120. Off in the shipped cells.

    Parameters
    ----------
    x_rad_per_Nm, y_rad_per_Nm : tuple of float
        Compliance of joints 1 to n about x and y of their frames (before they turn); prismatic joints have none.
    """

    name: ClassVar[str] = "bending"
    summary: ClassVar[str] = "frames tilt under weight, beside the joints of section 4.3; off if not asked for"
    x_rad_per_Nm: tuple[float, ...] = (1.0e-7, 2.0e-7, 4.0e-7, 6.0e-6, 6.0e-6, 6.0e-6)
    y_rad_per_Nm: tuple[float, ...] = (2.0e-7, 1.0e-7, 3.0e-7, 8.0e-6, 4.0e-6, 6.0e-6)

    def frames(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.frames`."""
        out = np.zeros((*motion.q.shape, 6))
        out[..., :2] = -np.stack([self.x_rad_per_Nm, self.y_rad_per_Nm], axis=1) * motion.tilting
        return out

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        about = {"rx": np.array(self.x_rad_per_Nm), "ry": np.array(self.y_rad_per_Nm)}
        return lever_amounts(arm, bodies, "bending", about)

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        x, y = (fitted(np.array(values) / size**4, prismatic, 0.0) for values in (self.x_rad_per_Nm, self.y_rad_per_Nm))
        return replace(self, x_rad_per_Nm=x, y_rad_per_Nm=y)
