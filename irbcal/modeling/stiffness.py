"""The four stiffness parameters of the thesis, and the two numbers through which they act."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.errors import RobotError
from irbcal.units import MM


@dataclass(frozen=True)
class Stiffness:
    """The four stiffness parameters of Nubiola 2011, section 5.3 and Figure 5.3, lengths in metres."""

    delta_L: float
    """Deflection of the stretched arm's end under gravity (Figure 5.4)."""
    L_G1: float
    L_G2: float
    """Distance of the centres of mass of upper arm and forearm from axes 2 and 3."""
    m: float
    """Mass ratio F2 / F1 (the thesis prints its inverse; eqs. 5.14 and 5.15 need this one)."""
    L_1: float
    L_2: float
    """Lengths of upper arm and forearm."""

    @staticmethod
    def guess(L_1: float, L_2: float) -> Stiffness:
        """Physical guess for arm lengths in metres (Nubiola 2011, eqs. 5.19, 5.20, 5.21 and 5.22)."""
        return Stiffness(1.5 * MM, L_1 / 2, L_2 / 2, 1.0, L_1, L_2)

    def _lever(self) -> float:
        """Turn of the stretched arm, seen from axis 2, over k F1 (Nubiola 2011, eq. 5.17), metres."""
        return self.L_G1 + self.m * (self.L_1 + self.L_G2) + self.m * self.L_2 / (self.L_1 + self.L_2) * self.L_G2

    @property
    def k_F1(self) -> float:
        """Compliance times weight of the upper arm, rad/m (Nubiola 2011, eq. 5.18, from eqs. 5.16 and 5.17)."""
        return float(np.arcsin(self.delta_L / (self.L_1 + self.L_2))) / self._lever()

    @property
    def coefficients(self) -> tuple[float, float]:
        """The two observable numbers (A, B) in radians: factors of the sines in what the joints bend by.

        Nubiola 2011, eqs. 5.14 and 5.15, with the torques of eqs. 5.12 and 5.13 put in. The sines of the levers are
        those of `irbcal.modeling.terms.thesis.stiffness_of`; what is left of the torques over F1 is the brackets here.
        """
        return (self.k_F1 * (self.L_G1 + self.m * self.L_1), self.m * self.k_F1 * self.L_G2)

    def with_coefficients(self, A: float, B: float) -> Stiffness | None:
        """The parameters that give (A, B) with L_G1 and m held at their present values.

        Returns
        -------
        Stiffness or None
            None where no such parameters exist: a forearm term without an upper-arm term (A = 0).
        """
        k_F1 = A / (self.L_G1 + self.m * self.L_1)
        if k_F1 == 0.0:
            return replace(self, delta_L=0.0) if B == 0.0 else None
        changed = replace(self, L_G2=B / (self.m * k_F1))
        angle = k_F1 * changed._lever()
        if not abs(angle) < np.pi / 2:
            return None
        return replace(changed, delta_L=float((self.L_1 + self.L_2) * np.sin(angle)))

    def with_payload(self, delta_kg: float, L_P: float, upper_arm_kg: float) -> Stiffness:
        """The parameters with more (or less) mass on the forearm; compliance and upper arm stay as they are.

        With ``p = delta_kg / upper_arm_kg`` the forearm's share grows to ``m' = m + p`` and its centre of mass moves
        to ``m' L_G2' = m L_G2 + p L_P``, so that ``A' = A + kF1 p L_1`` and ``B' = B + kF1 p L_P``, see `coefficients`.

        Parameters
        ----------
        delta_kg : float
            Mass added to what the robot carried when it was measured; negative if it carries less.
        L_P : float
            Distance of that mass from axis 3, along the forearm, metres.
        upper_arm_kg : float
            Mass of the upper arm: what axis 2 carries and axis 3 does not.

        Raises
        ------
        RobotError
            If the upper arm has no mass, or more is taken off than the forearm weighs.

        Notes
        -----
        The split of A into compliance and masses rests on L_G1, m and the upper arm's mass, which positions cannot
        show: the extrapolation is a physical guess, not a measurement.
        """
        if not upper_arm_kg > 0.0:
            raise RobotError(
                f"the upper arm's mass must be positive, found {upper_arm_kg:g} kg", parameter="upper_arm_kg"
            )
        share = delta_kg / upper_arm_kg
        m = self.m + share
        if not m > 0.0:
            raise RobotError(
                f"a payload {-delta_kg:g} kg smaller is impossible: the forearm weighs {self.m * upper_arm_kg:g} kg",
                parameter="delta_kg",
            )
        changed = replace(self, m=m, L_G2=(self.m * self.L_G2 + share * L_P) / m)
        angle = self.k_F1 * changed._lever()
        return replace(changed, delta_L=float((self.L_1 + self.L_2) * np.sin(angle)))
