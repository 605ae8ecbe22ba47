r"""The joint map of the thesis in its own numbers: gains, arm stiffness, joint 6's Fourier series.

Effective angles (Nubiola 2011, sections 5.2 and 5.3, Table 5.7; q in radians)::

    theta_i = q_i + k_i q_i                                      joint gains, every joint
    theta_2 += A sin(q_2 + phi_2) + B sin(q_2 + q_3 + phi_3)     arm stiffness
    theta_3 += B sin(q_2 + q_3 + phi_3)
    theta_6 += a_1 cos q_6 + b_1 sin q_6 + a_2 cos 2 q_6 + b_2 sin 2 q_6    joint-6 Fourier series

The gains are those of eq. 3.31. The Fourier series is eq. 5.8 with omega = 1, and without a_0, which is an offset of
theta_6 (Table 5.2). The stiffness is that of eqs. 5.14 and 5.15 with the levers of eqs. 5.9, 5.10 and 5.11 in the
torques of eqs. 5.12 and 5.13.

``phi_2`` and ``phi_3`` are the directions of upper arm and forearm from the vertical at zero joints; for
the ABB arms ``phi_2 = 0`` and ``phi_3 = 90`` degrees, which gives ``sin q_2`` and ``cos(q_2 + q_3)`` as printed.

The four stiffness parameters of the thesis act through ``A`` and ``B`` alone
(``A = kF1 (L_G1 + m L_1)``, ``B = m kF1 L_G2``): `irbcal.modeling.stiffness.Stiffness` converts between them.
Robots have the same as a sum of terms, `ThesisMap.joint_map`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.terms.gain import FAMILY as GAIN
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.thesis import fourier_of, stiffness_of


@dataclass(frozen=True, eq=False, repr=False)
class ThesisMap:
    """Gains, stiffness and Fourier series; the last two are for arms with six revolute joints."""

    gain: FloatArray = field(default_factory=lambda: np.zeros(6))
    """Shape (n,). Relative gain errors k_i (Nubiola 2011, eq. 3.31), dimensionless, of all n joints; six unless given.
    """
    stiffness: FloatArray = field(default_factory=lambda: np.zeros(2))
    """Shape (2,). A and B, radians (eqs. 5.14 and 5.15; see `irbcal.modeling.stiffness.Stiffness.coefficients`)."""
    phases: FloatArray = field(default_factory=lambda: np.array([0.0, np.pi / 2]))
    """Shape (2,). phi_2 and phi_3, radians."""
    fourier: FloatArray = field(default_factory=lambda: np.zeros(4))
    """Shape (4,). a_1, b_1, a_2, b_2 of joint 6, radians (eq. 5.8, Table 5.2)."""

    def __post_init__(self) -> None:
        for array in fields(self):
            object.__setattr__(self, array.name, np.asarray(getattr(self, array.name), dtype=float))
        lock(self)

    @staticmethod
    def from_joint_map(joint_map: JointMap) -> ThesisMap | None:
        """The numbers of a joint map; None where it has terms that the thesis has not."""
        terms = joint_map.terms
        gain, stiffness, fourier = np.zeros(len(terms.arm.joint_names)), np.zeros(2), np.zeros(4)
        phases = np.array([0.0, np.pi / 2])
        for term, coefficient in zip(terms.terms, terms.coefficients.tolist(), strict=True):
            if term.basis == "q":
                gain[term.joint] += coefficient
            elif term.family != "thesis":
                return None
            elif term.basis == "gravity":
                which = len(term.also)
                stiffness[which], phases[which] = coefficient, joint_map.phase(term)
            else:
                fourier[2 * int(str(term.parameters["cycles_per_turn"])) - 2 + (term.basis == "sin")] = coefficient
        return ThesisMap(gain, stiffness, phases, fourier)

    def joint_map(self, nominal: Arm) -> JointMap:
        """The same as a sum of terms of a nominal arm.

        Raises
        ------
        RobotError
            If there is a stiffness, and the arm bends otherwise (`irbcal.modeling.arm.Arm.stiffness_geometry`).
        """
        terms: list[Term] = []
        values: list[float] = []
        for new_terms, numbers in (
            (GAIN.terms(nominal) if self.gain.any() else [], self.gain),
            (stiffness_of(nominal, self.phases) if self.stiffness.any() else [], self.stiffness),
            (fourier_of() if self.fourier.any() else [], self.fourier),
        ):
            terms += new_terms
            values += numbers[: len(new_terms)].tolist()
        return JointMap(TermMap(nominal, tuple(terms), np.array(values)))

    def effective(self, q: ArrayLike) -> FloatArray:
        """Effective joints: the formula of this module (Nubiola 2011, eqs. 3.31, 5.8, 5.14 and 5.15).

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints)
        """
        q = np.asarray(q, dtype=float)
        theta = q * (1.0 + self.gain) if self.gain.any() else q.copy()
        if self.stiffness.any():
            upper, fore = stiffness_terms(q, self.phases)
            theta[:, 1] += self.stiffness[0] * upper + self.stiffness[1] * fore
            theta[:, 2] += self.stiffness[1] * fore
        if self.fourier.any():
            theta[:, 5] += self.fourier @ fourier_terms(q)
        return theta

    def with_payload(
        self, guess: Stiffness, delta_kg: float, upper_arm_kg: float, along: float, across: float = 0.0
    ) -> ThesisMap:
        """The joint map with more (or less) mass on the tool, by `irbcal.modeling.stiffness.Stiffness.with_payload`.

        Parameters
        ----------
        guess : Stiffness
            Its L_G1, m, L_1 and L_2 are used; compliance and L_G2 follow from this map's A and B.
        delta_kg, upper_arm_kg : float
            See `Stiffness.with_payload`.
        along, across : float
            Place of the added mass from axis 3, metres: along the forearm (phi_3) and square to it (phi_3 + 90
            degrees). ``across`` turns the phase phi_3.

        Raises
        ------
        RobotError
            If A is not positive (it is then unknown how far the arm gives way), or as `Stiffness.with_payload`.
        """
        stiffness_model = guess.with_coefficients(*self.stiffness)
        if not self.stiffness[0] > 0.0 or stiffness_model is None:
            raise RobotError(
                "the effect of a payload is unknown: it follows from the upper arm giving way under gravity, "
                f"A > 0, but this joint map has A = {self.stiffness[0]:.3g} rad"
            )
        A, B = stiffness_model.with_payload(delta_kg, along, upper_arm_kg).coefficients
        # B sin(x) + C cos(x) = R sin(x + turn)
        C = stiffness_model.k_F1 * delta_kg / upper_arm_kg * across
        turn = np.arctan2(C, abs(B)) * np.copysign(1.0, B)
        stiffness = np.array([A, np.copysign(np.hypot(B, C), B)])
        return replace(self, stiffness=stiffness, phases=self.phases + np.array([0.0, turn]))


def stiffness_terms(q: FloatArray, phases: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The two sine terms that A and B multiply, each of shape (n,); q (n, joints) in radians.

    They are the sines of the levers in Nubiola 2011, eqs. 5.9, 5.10 and 5.11.
    """
    return cos_sin(q[:, 1] + phases[0])[1], cos_sin(q[:, 1] + q[:, 2] + phases[1])[1]


def fourier_terms(q: FloatArray) -> FloatArray:
    """The terms cos q6, sin q6, cos 2 q6, sin 2 q6 (Nubiola 2011, eq. 5.8) as an array (4, n); q (n, 6) in radians."""
    c, s = cos_sin(q[:, 5])
    return np.array([c, s, (c - s) * (c + s), 2.0 * s * c])
