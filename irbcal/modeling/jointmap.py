r"""The joint map: from commanded to effective joint angles, the part of a calibration that URDF cannot carry.

Effective angles (Nubiola 2011, eqs. 3.31, 5.8 and 5.9 to 5.15; q in radians)::

    theta_i = q_i + k_i q_i                                      joint gains, every joint
    theta_2 += A sin(q_2 + phi_2) + B sin(q_2 + q_3 + phi_3)     arm stiffness
    theta_3 += B sin(q_2 + q_3 + phi_3)
    theta_6 += a_1 cos q_6 + b_1 sin q_6 + a_2 cos 2 q_6 + b_2 sin 2 q_6    joint-6 Fourier series

``phi_2`` and ``phi_3`` are the directions of upper arm and forearm from the vertical at zero joints; for
the ABB arms ``phi_2 = 0`` and ``phi_3 = 90`` degrees, which gives ``sin q_2`` and ``cos(q_2 + q_3)`` as printed.

The four stiffness parameters of the thesis act through ``A`` and ``B`` alone
(``A = kF1 (L_G1 + m L_1)``, ``B = m kF1 L_G2``): `Stiffness` converts between the two descriptions.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from irbcal.units import MM

FORMULA = "irbcal-joint-map-1"
"""Name of the formula above in files; it changes when the formula does."""


@dataclass(frozen=True)
class Stiffness:
    """The stiffness parameters of the thesis (section 5.3), lengths in metres.

    Parameters
    ----------
    delta_L : float
        Deflection of the stretched arm's end under gravity.
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
    def guess(L_1, L_2):
        """Physical guess of Nubiola 2011, eqs. 5.19 to 5.22, for arm lengths in metres."""
        return Stiffness(1.5 * MM, L_1 / 2, L_2 / 2, 1.0, L_1, L_2)

    def _lever(self):
        return self.L_G1 + self.m * (self.L_1 + self.L_G2) + self.m * self.L_2 / (self.L_1 + self.L_2) * self.L_G2

    @property
    def k_F1(self):
        """Compliance times weight, rad/m (eq. 5.18)."""
        return np.arcsin(self.delta_L / (self.L_1 + self.L_2)) / self._lever()

    @property
    def coefficients(self):
        """The two observable numbers (A, B) in radians."""
        return (self.k_F1 * (self.L_G1 + self.m * self.L_1), self.m * self.k_F1 * self.L_G2)

    def with_coefficients(self, A, B):
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
        return replace(changed, delta_L=(self.L_1 + self.L_2) * np.sin(angle))


@dataclass(frozen=True, eq=False)
class JointMap:
    """Commanded to effective joint angles for a six-axis arm.

    Parameters
    ----------
    gain : array_like, shape (6,)
        Relative gain errors k_i (eq. 3.31), dimensionless.
    stiffness : array_like, shape (2,)
        A and B, radians.
    phases : array_like, shape (2,)
        phi_2 and phi_3, radians.
    fourier : array_like, shape (4,)
        a_1, b_1, a_2, b_2 of joint 6, radians.
    """

    gain: np.ndarray = field(default_factory=lambda: np.zeros(6))
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(2))
    phases: np.ndarray = field(default_factory=lambda: np.array([0.0, np.pi / 2]))
    fourier: np.ndarray = field(default_factory=lambda: np.zeros(4))

    def __post_init__(self):
        for item in fields(self):
            value = np.array(getattr(self, item.name), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, item.name, value)

    @property
    def is_identity(self):
        """Whether effective and commanded angles are the same."""
        return not (self.gain.any() or self.stiffness.any() or self.fourier.any())

    def effective(self, q):
        """Effective joint angles.

        Parameters
        ----------
        q : ndarray, shape (n, 6)
            Commanded joint angles, radians.

        Returns
        -------
        ndarray, shape (n, 6)
        """
        q = np.asarray(q, dtype=float)
        if self.is_identity:
            return q
        theta = q * (1.0 + self.gain)
        upper, fore = stiffness_terms(q, self.phases)
        theta[:, 1] += self.stiffness[0] * upper + self.stiffness[1] * fore
        theta[:, 2] += self.stiffness[1] * fore
        theta[:, 5] += self.fourier @ fourier_terms(q)
        return theta

    def jacobian(self, q):
        """Derivative of the effective by the commanded angles.

        Parameters
        ----------
        q : ndarray, shape (n, 6)
            Radians.

        Returns
        -------
        ndarray, shape (n, 6, 6)
            ``d theta_i / d q_j``.
        """
        q = np.asarray(q, dtype=float)
        out = np.zeros((len(q), 6, 6))
        out[:, range(6), range(6)] = 1.0 + self.gain
        A, B = self.stiffness
        upper = A * np.cos(q[:, 1] + self.phases[0])
        fore = B * np.cos(q[:, 1] + q[:, 2] + self.phases[1])
        out[:, 1, 1] += upper + fore
        out[:, 1, 2] += fore
        out[:, 2, 1] += fore
        out[:, 2, 2] += fore
        a_1, b_1, a_2, b_2 = self.fourier
        c, s, c2, s2 = fourier_terms(q)
        out[:, 5, 5] += b_1 * c - a_1 * s + 2.0 * (b_2 * c2 - a_2 * s2)
        return out

    def commanded(self, theta):
        """Commanded angles that give these effective angles: the inverse of `effective`.

        Newton's iteration with the exact Jacobian; the map is within a few milliradians of the identity,
        so it converges to rounding in three or four steps.

        Parameters
        ----------
        theta : ndarray, shape (n, 6)
            Effective joint angles, radians.

        Returns
        -------
        ndarray, shape (n, 6)

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


def stiffness_terms(q, phases):
    """The two sine terms that A and B multiply, each of shape (n,); q (n, 6) in radians."""
    return np.sin(q[:, 1] + phases[0]), np.sin(q[:, 1] + q[:, 2] + phases[1])


def fourier_terms(q):
    """The terms cos q6, sin q6, cos 2 q6, sin 2 q6 as an array (4, n); q (n, 6) in radians."""
    q6 = q[:, 5]
    return np.array([np.cos(q6), np.sin(q6), np.cos(2 * q6), np.sin(2 * q6)])
