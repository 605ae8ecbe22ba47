"""How points of the tip link follow the parameters of the calibrated robot, in touches as in programs."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.certainty import Certainty, bounded_history
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.units import MM


def robot_derivatives(
    certainty: Certainty, path: chain.Walk, p: FloatArray, motion: Motion
) -> tuple[FloatArray, FloatArray]:
    """How points of the tip link depend on the parameters of the calibrated robot.

    Parameters
    ----------
    certainty : Certainty
    path : Walk
        The calibrated arm at the motion.
    p : ndarray, shape (3, n)
        In the base link, metres.
    motion : Motion

    Returns
    -------
    J : ndarray, shape (parameters, 3, n)
        In the base link, SI units; zero of terms of the last move, which is not known.
    variance : ndarray, shape (n,)
        Of a coordinate: what the calibrated robot leaves over at poses that it was not fitted to, less the noise of the
        measurements, which moves no part, and terms of the last move, m^2.
    """
    J = certainty.jacobian(path, p, motion, np.zeros(len(motion), dtype=bool), None)
    history = np.flatnonzero(bounded_history(certainty.terms)) + len(J) - len(certainty.terms)
    size = np.diagonal(certainty.covariance)[history] + certainty.coefficients[history - len(J)] ** 2
    left_over = certainty.determined_left_out(None) ** 2 / 3.0 - (certainty.limits.measurement_noise_mm * MM) ** 2
    variance = size @ np.sum(J[history] ** 2, axis=1) / 3.0 + max(left_over, 0.0)
    J[history] = 0.0
    return J, variance


def point_derivatives(
    robot: Robot, certainty: Certainty, q: FloatArray, place: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points of the tip link in the base link, and how they depend on the robot's parameters.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    certainty : Certainty
        Of its parameters.
    q : ndarray, shape (n, joints)
        Commanded, radians (metres).
    place : ndarray, shape (n, 3)
        In the tip link, metres.

    Returns
    -------
    points : ndarray, shape (n, 3)
    jacobian : ndarray, shape (n, 3, parameters)
    variance : ndarray, shape (n,)
        Both as of `robot_derivatives`.
    """
    motion = robot.joint_map.motion(q)
    path = robot.walk(motion)
    points = path.tip[3] + np.einsum("acn,na->cn", path.tip[:3], place)
    J, variance = robot_derivatives(certainty, path, points, motion)
    return points.T, J.transpose(2, 1, 0), variance
