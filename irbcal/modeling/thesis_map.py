r"""The joint map of the thesis: gains, arm stiffness, joint 6's Fourier series.

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
Robots have the same as a sum of terms (`irbcal.modeling.terms.thesis`), of which these are the numbers.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.thesis import stiffness_of


def is_of_the_thesis(joint_map: JointMap) -> bool:
    """Whether a joint map has no other terms than gains and those of the thesis."""
    return all(term.basis == "q" or term.family == "thesis" for term in joint_map.terms.terms)


def stiffness_and_phases(joint_map: JointMap) -> tuple[FloatArray, FloatArray]:
    """``A`` and ``B``, zero where a joint map has none, and ``phi_2`` and ``phi_3``; shape (2,) each, radians."""
    stiffness, phases = np.zeros(2), np.array([0.0, np.pi / 2])
    for term, coefficient in zip(joint_map.terms.terms, joint_map.terms.coefficients, strict=True):
        if term.basis == "gravity":
            which = len(term.also)
            stiffness[which], phases[which] = coefficient, joint_map.phase(term)
    return stiffness, phases


def with_stiffness(joint_map: JointMap, stiffness: FloatArray, phases: FloatArray) -> JointMap:
    """A joint map with another arm stiffness in place of its own, see `stiffness_and_phases`.

    Raises
    ------
    RobotError
        If the arm bends otherwise (`irbcal.modeling.arm.Arm.stiffness_geometry`).
    """
    terms = joint_map.terms
    rows = [k for k, term in enumerate(terms.terms) if term.basis != "gravity"]
    kept = [terms.terms[k] for k in rows]
    return JointMap(
        TermMap(terms.arm, (*kept, *stiffness_of(terms.arm, phases)), np.append(terms.coefficients[rows], stiffness))
    )


def with_mass(
    joint_map: JointMap, guess: Stiffness, delta_kg: float, upper_arm_kg: float, along: float, across: float = 0.0
) -> JointMap:
    """The joint map with more (or less) mass on the tool, by `irbcal.modeling.stiffness.Stiffness.with_payload`.

    Parameters
    ----------
    joint_map : JointMap
        One that `is_of_the_thesis`.
    guess : Stiffness
        Its L_G1, m, L_1 and L_2 are used; compliance and L_G2 follow from the map's A and B.
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
    stiffness, phases = stiffness_and_phases(joint_map)
    stiffness_model = guess.with_coefficients(*stiffness)
    if not stiffness[0] > 0.0 or stiffness_model is None:
        raise RobotError(
            "the effect of a payload is unknown: it follows from the upper arm giving way under gravity, "
            f"A > 0, but this joint map has A = {stiffness[0]:.3g} rad"
        )
    A, B = stiffness_model.with_payload(delta_kg, along, upper_arm_kg).coefficients
    # B sin(x) + C cos(x) = R sin(x + turn)
    C = stiffness_model.k_F1 * delta_kg / upper_arm_kg * across
    turn = np.arctan2(C, abs(B)) * np.copysign(1.0, B)
    loaded = np.array([A, np.copysign(np.hypot(B, C), B)])
    return with_stiffness(joint_map, loaded, phases + np.array([0.0, turn]))
