r"""The joint map: from commanded to effective joint angles, the part of a calibration that URDF cannot carry.

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
(``A = kF1 (L_G1 + m L_1)``, ``B = m kF1 L_G2``): `Stiffness` converts between the two descriptions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.cos_sin import cos_sin
from irbcal.units import MM

FORMULA = "irbcal-joint-map-1"
"""Name of the formula above in files; it changes when the formula does."""


@dataclass(frozen=True)
class Stiffness:
    """The four stiffness parameters of Nubiola 2011, section 5.3 and Figure 5.3, lengths in metres.

    Parameters
    ----------
    delta_L : float
        Deflection of the stretched arm's end under gravity (Figure 5.4).
    L_G1, L_G2 : float
        Distance of the centres of mass of upper arm and forearm from axes 2 and 3.
    m : float
        Mass ratio F2 / F1 (the thesis prints its inverse; eqs. 5.14 and 5.15 need this one).
    L_1, L_2 : float
        Lengths of upper arm and forearm.
    """

    delta_L: float
    L_G1: float
    L_G2: float
    m: float
    L_1: float
    L_2: float

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
        those of `stiffness_terms`; what is left of the torques over F1 is the brackets here.
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

        Returns
        -------
        Stiffness

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


class AnyJointMap(Protocol):
    """From commanded to effective joints: the thesis's `JointMap`, or a sum of terms.

    A sum of terms is an `irbcal.modeling.terms.term_joint_map.TermJointMap`. ``previous`` is the stop before, as
    commanded: maps that have no use for it ignore it, the others take the last move as unknown where it is not given.
    Likewise the load, see `TermJointMap.effective`.
    """

    @property
    def is_identity(self) -> bool:
        """Whether effective and commanded joints are the same."""
        ...

    @property
    def has_history(self) -> bool:
        """Whether effective joints depend on the stop before."""
        ...

    @property
    def history_std(self) -> FloatArray:
        """By how much each joint's stop is uncertain where the stop before is not known, shape (joints,)."""
        ...

    @property
    def in_words(self) -> str:
        """What the map does, in a few words."""
        ...

    def effective(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_place: ArrayLike | None = None,
        torques: ArrayLike | None = None,
    ) -> FloatArray:
        """Effective joints, shape (n, joints)."""
        ...

    def jacobian(self, q: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Derivative of the effective by the commanded joints, shape (n, joints, joints)."""
        ...

    def jacobian_derivative(self, q: ArrayLike, dq: ArrayLike) -> FloatArray:
        """Time derivative of `jacobian` at joint speeds ``dq``, shape (n, joints, joints)."""
        ...

    def commanded(self, theta: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Commanded joints that give effective ones, shape (n, joints)."""
        ...

    def effective_limits(self, lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """A box of effective joints whose commands all respect joint limits."""
        ...

    def carrying(self, payload_kg: float, place: ArrayLike | None = None) -> AnyJointMap:
        """The map with another payload (kg, its centre in the tip link in metres)."""
        ...

    def load(self, n: int, *given: ArrayLike | None) -> Mapping[str, FloatArray | None]:
        """What a motion of n stops says of the load, what is not told being as usual."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class JointMap:
    """Commanded to effective joints; stiffness and Fourier series are for arms with six revolute joints.

    Parameters
    ----------
    gain : array_like, shape (n,)
        Relative gain errors k_i (Nubiola 2011, eq. 3.31), dimensionless, of all n joints; six unless given.
    stiffness : array_like, shape (2,)
        A and B, radians (eqs. 5.14 and 5.15; see `Stiffness.coefficients`).
    phases : array_like, shape (2,)
        phi_2 and phi_3, radians.
    fourier : array_like, shape (4,)
        a_1, b_1, a_2, b_2 of joint 6, radians (eq. 5.8, Table 5.2).
    """

    gain: FloatArray = field(default_factory=lambda: np.zeros(6))
    stiffness: FloatArray = field(default_factory=lambda: np.zeros(2))
    phases: FloatArray = field(default_factory=lambda: np.array([0.0, np.pi / 2]))
    fourier: FloatArray = field(default_factory=lambda: np.zeros(4))

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, np.asarray(getattr(self, item.name), dtype=float))
        lock(self)

    def __repr__(self) -> str:
        return f"<JointMap: {self.in_words}>"

    @property
    def is_identity(self) -> bool:
        """Whether effective and commanded angles are the same."""
        return not (self.gain.any() or self.stiffness.any() or self.fourier.any())

    @property
    def has_history(self) -> bool:
        """Whether effective angles depend on the stop before: no."""
        return False

    @property
    def history_std(self) -> FloatArray:
        """Zeros: nothing depends on the stop before, shape (joints,)."""
        return np.zeros(len(self.gain))

    @property
    def in_words(self) -> str:
        """What the map does, in a few words and milliradians."""
        if self.is_identity:
            return "no joint map (commanded joints are the effective ones)"

        def numbers(values: FloatArray) -> str:
            shown = " ".join(f"{1e3 * value:.3g}" for value in values[:20])
            return shown if len(values) <= 20 else f"{shown} …"

        parts = [
            f"{name} {numbers(values)}{unit}"
            for name, values, unit in (
                ("gains", self.gain, " per mille"),
                ("stiffness A, B", self.stiffness, " mrad"),
                ("joint-6 Fourier series", self.fourier, " mrad"),
            )
            if values.any()
        ]
        return f"joint map with {', '.join(parts)}"

    def effective(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_place: ArrayLike | None = None,
        torques: ArrayLike | None = None,
    ) -> FloatArray:
        """Effective joints: the formula of this module (Nubiola 2011, eqs. 3.31, 5.8, 5.14 and 5.15).

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        previous : ndarray, optional
            The stop before, see `AnyJointMap`: this map does not depend on it, here and below.
        payload_kg, payload_place, torques : array_like, optional
            Likewise; for another payload see `with_payload`.

        Returns
        -------
        ndarray, shape (n, joints)
        """
        q = np.asarray(q, dtype=float)
        if self.is_identity:
            return q
        theta = q * (1.0 + self.gain) if self.gain.any() else q.copy()
        if self.stiffness.any():
            upper, fore = stiffness_terms(q, self.phases)
            theta[:, 1] += self.stiffness[0] * upper + self.stiffness[1] * fore
            theta[:, 2] += self.stiffness[1] * fore
        if self.fourier.any():
            theta[:, 5] += self.fourier @ fourier_terms(q)
        return theta

    def jacobian(self, q: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Derivative of the effective by the commanded angles.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints, joints)
            ``d theta_i / d q_j``.
        """
        q = np.asarray(q, dtype=float)
        joints = q.shape[1]
        out = np.zeros((len(q), joints, joints))
        out[:, range(joints), range(joints)] = 1.0
        if self.gain.any():
            out[:, range(joints), range(joints)] += self.gain
        if self.stiffness.any():
            A, B = self.stiffness
            upper = A * cos_sin(q[:, 1] + self.phases[0])[0]
            fore = B * cos_sin(q[:, 1] + q[:, 2] + self.phases[1])[0]
            out[:, 1, 1] += upper + fore
            out[:, 1, 2] += fore
            out[:, 2, 1] += fore
            out[:, 2, 2] += fore
        if self.fourier.any():
            a_1, b_1, a_2, b_2 = self.fourier
            c, s, c2, s2 = fourier_terms(q)
            out[:, 5, 5] += b_1 * c - a_1 * s + 2.0 * (b_2 * c2 - a_2 * s2)
        return out

    def jacobian_derivative(self, q: ArrayLike, dq: ArrayLike) -> FloatArray:
        """Time derivative of `jacobian` along a motion.

        Parameters
        ----------
        q, dq : ndarray, shape (n, joints)
            Commanded joints and their speeds, radians and radians per second (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints, joints)
            ``d/dt (d theta_i / d q_j)``, the second derivatives of `effective` times ``dq``.
        """
        q, dq = np.asarray(q, dtype=float), np.asarray(dq, dtype=float)
        joints = q.shape[1]
        out = np.zeros((len(q), joints, joints))
        if self.stiffness.any():
            A, B = self.stiffness
            upper, fore = stiffness_terms(q, self.phases)
            upper, fore = -A * upper * dq[:, 1], -B * fore * (dq[:, 1] + dq[:, 2])
            out[:, 1:3, 1:3] = fore[:, None, None]
            out[:, 1, 1] += upper
        if self.fourier.any():
            a_1, b_1, a_2, b_2 = self.fourier
            c, s, c2, s2 = fourier_terms(q)
            out[:, 5, 5] = -(a_1 * c + b_1 * s + 4.0 * (a_2 * c2 + b_2 * s2)) * dq[:, 5]
        return out

    def effective_limits(self, lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """A box of effective joints whose commands all respect joint limits.

        Each effective joint grows with its own command, and depends on one other joint at most, through the forearm's
        stiffness term, which is at most B: the box of joints 2 and 3 is drawn in by that much.

        Parameters
        ----------
        lower, upper : array_like, shape (joints,)
            Limits of the commanded joints, radians (metres for prismatic joints); may be infinite.

        Returns
        -------
        lower, upper : ndarray, shape (joints,)
            Limits of the effective joints.
        """
        limits = []
        for bounds, inwards in ((lower, 1.0), (upper, -1.0)):
            bounds = np.array(bounds, dtype=float)
            finite = np.isfinite(bounds)
            at = np.where(finite, bounds, 0.0)
            alone = replace(self, stiffness=self.stiffness * [1.0, 0.0])
            box = np.array(alone.effective(at[None])[0])
            if self.stiffness.any():
                box[1:3] += inwards * abs(self.stiffness[1])
            limits.append(np.where(finite, box, bounds))
        return limits[0], limits[1]

    def with_payload(
        self, guess: Stiffness, delta_kg: float, upper_arm_kg: float, along: float, across: float = 0.0
    ) -> JointMap:
        """The joint map with more (or less) mass on the tool, by `Stiffness.with_payload`.

        Parameters
        ----------
        guess : Stiffness
            Its L_G1, m, L_1 and L_2 are used; compliance and L_G2 follow from this map's A and B.
        delta_kg, upper_arm_kg : float
            See `Stiffness.with_payload`.
        along, across : float
            Place of the added mass from axis 3, metres: along the forearm (phi_3) and square to it (phi_3 + 90
            degrees). ``across`` turns the phase phi_3.

        Returns
        -------
        JointMap

        Raises
        ------
        RobotError
            If A is not positive (it is then unknown how far the arm gives way), or as `Stiffness.with_payload`.
        """
        held = guess.with_coefficients(*self.stiffness)
        if not self.stiffness[0] > 0.0 or held is None:
            raise RobotError(
                "the effect of a payload is unknown: it follows from the upper arm giving way under gravity, "
                f"A > 0, but this joint map has A = {self.stiffness[0]:.3g} rad"
            )
        A, B = held.with_payload(delta_kg, along, upper_arm_kg).coefficients
        # B sin(x) + C cos(x) = R sin(x + turn)
        C = held.k_F1 * delta_kg / upper_arm_kg * across
        turn = np.arctan2(C, abs(B)) * np.copysign(1.0, B)
        stiffness = np.array([A, np.copysign(np.hypot(B, C), B)])
        return replace(self, stiffness=stiffness, phases=self.phases + np.array([0.0, turn]))

    def load(self, n: int, *given: ArrayLike | None) -> Mapping[str, FloatArray | None]:
        """Nothing: this map does not depend on the load."""
        return {}

    def carrying(self, payload_kg: float, place: ArrayLike | None = None) -> JointMap:
        """Refused by a RobotError: unlike a sum of terms, a level of the thesis does not know what a payload does."""
        raise RobotError(
            "a level of the thesis does not tell how the joints give way under another payload: calibrate with model "
            "auto from poses measured with two loads or more (column payload_kg)",
            parameter="payload_kg",
        )

    def commanded(self, theta: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Commanded angles that give these effective angles: the inverse of `effective`.

        Newton's iteration with the exact Jacobian; the map is within a few milliradians of the identity,
        so it converges to rounding in three or four steps.

        Parameters
        ----------
        theta : ndarray, shape (n, joints)
            Effective joints, radians (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints)

        Raises
        ------
        ValueError
            If the map is so far from the identity that the iteration does not converge.
        """
        theta = np.asarray(theta, dtype=float)
        q = theta.copy()
        if self.is_identity or not len(theta):
            return q
        for _ in range(20):
            miss = theta - self.effective(q)
            worst = np.abs(miss).max()
            try:
                q += np.linalg.solve(self.jacobian(q), miss[..., None])[..., 0]
            except np.linalg.LinAlgError:
                break
            if worst < 1e-9:  # quadratic: this last step took the error to rounding
                return q
        raise ValueError(f"the joint map cannot be inverted: {worst:.3g} rad left after Newton's steps")


def stiffness_terms(q: FloatArray, phases: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The two sine terms that A and B multiply, each of shape (n,); q (n, joints) in radians.

    They are the sines of the levers in Nubiola 2011, eqs. 5.9, 5.10 and 5.11.
    """
    return cos_sin(q[:, 1] + phases[0])[1], cos_sin(q[:, 1] + q[:, 2] + phases[1])[1]


def fourier_terms(q: FloatArray) -> FloatArray:
    """The terms cos q6, sin q6, cos 2 q6, sin 2 q6 (Nubiola 2011, eq. 5.8) as an array (4, n); q (n, 6) in radians."""
    c, s = cos_sin(q[:, 5])
    return np.array([c, s, (c - s) * (c + s), 2.0 * s * c])
