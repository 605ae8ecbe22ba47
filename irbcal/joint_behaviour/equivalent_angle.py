"""Arm stiffness as one angle of joint 2, as moves of that joint alone show it (Nubiola 2011, section 5.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.joint_behaviour.series import Series, one_series
from irbcal.modeling.robot import Robot
from irbcal.modeling.thesis_map import ThesisMap


def equivalent_error(
    q2: ArrayLike, q3: float, stiffness: ArrayLike, phases: ArrayLike, lengths: ArrayLike
) -> FloatArray:
    """Angle of joint 2 that moves the wrist as both joints' bending does, zero at q2 = 0.

    Nubiola 2011, section 5.3: the curves of Figure 5.5 with `irbcal.modeling.stiffness.Stiffness.guess`, those of
    Figure 5.6 with other parameters. With both links in line it is eq. 5.17, and its sine the deflection of eq. 5.16
    over the arm's length.

    Parameters
    ----------
    q2 : ndarray, shape (n,)
        Radians.
    q3 : float
        Radians.
    stiffness : array_like, shape (2,)
        A and B, radians.
    phases : array_like, shape (2,)
        Of upper arm and forearm, see `irbcal.modeling.thesis_map`.
    lengths : array_like, shape (2,)
        Of upper arm and forearm, metres.

    Returns
    -------
    ndarray, shape (n,)
        Radians.
    """
    (A, B), (L_1, L_2), (phi_2, phi_3) = (np.asarray(pair, dtype=float) for pair in (stiffness, lengths, phases))
    bend = q3 + phi_3 - phi_2
    across = L_2**2 + L_1 * L_2 * np.cos(bend)
    share = across / (L_1**2 + L_2**2 + 2 * L_1 * L_2 * np.cos(bend))

    def at(angle: FloatArray) -> FloatArray:
        upper, fore = A * np.sin(angle + phi_2), B * np.sin(angle + q3 + phi_3)
        return upper + fore * (1 + share)

    return at(np.asarray(q2, dtype=float)) - at(np.zeros(()))


def predicted_series(series: Series, robot: Robot, stiffness: ArrayLike) -> FloatArray:
    """The angular errors that stiffness alone would show in a series of one-joint moves.

    The same points are computed with and without it and evaluated like measured ones, so that what the circles take of
    the bending is taken here, too. What Nubiola 2011, section 5.3, compares with the measured curves of Figure 4.10.

    Parameters
    ----------
    series : Series
    robot : Robot
    stiffness : array_like, shape (2,)

    Returns
    -------
    ndarray, shape (n,)
        Radians, zero where the measured ones are.
    """
    points = series.points
    phases = (ThesisMap.of(robot.joint_map) or ThesisMap()).phases
    thesis = ThesisMap(np.zeros(points.q.shape[1]), np.asarray(stiffness, dtype=float), phases)
    bent = robot.replace(joint_map=thesis.joint_map(robot.joint_map.terms.arm))
    modelled = replace(points, xyz=points.predicted(bent))
    return one_series(modelled, np.full(points.poses, np.nan), series.joint, series.name).angle
