"""How points of the tip link follow the parameters of the calibrated robot, in touches as in programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.certainty import HISTORY, Certainty
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
        Of a coordinate: what the calibrated robot leaves over at poses that it was not fitted to, and terms of the last
        move, m^2.
    """
    J = certainty.jacobian(path, p, motion, np.zeros(len(motion), dtype=bool), None)
    history = np.flatnonzero([term.basis in HISTORY for term in certainty.terms]) + len(J) - len(certainty.terms)
    size = np.diagonal(certainty.covariance)[history] + certainty.coefficients[history - len(J)] ** 2
    variance = (size @ np.sum(J[history] ** 2, axis=1) + certainty.determined_left_out(None) ** 2) / 3.0
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
    load: dict[str, Any] = {**robot.joint_map.load(len(q))}
    motion = replace(Motion(q), **load)
    path = robot.walk(motion)
    points = path.tip[3] + np.einsum("acn,na->cn", path.tip[:3], place)
    J, variance = robot_derivatives(certainty, path, points, motion)
    return points.T, J.transpose(2, 1, 0), variance


def own_ends(certainty: Certainty) -> float:
    """Size of what reflectors of unknown place leave open of base and tip link, metres; zero where none is unknown.

    Errors of the last link move flange and reflectors alike, those of the first the base. Measurements do not show
    them, so they count as large as those of the links between.
    """
    shifts = [
        coefficient
        for term, coefficient in zip(certainty.terms, certainty.coefficients, strict=True)
        if term.family == "geometry" and term.axis[0] == "t"
    ]
    return float(np.sqrt(3.0 * np.mean(np.square(shifts)))) if certainty.free_targets and shifts else 0.0


def own_ends_in_words(certainty: Certainty) -> str:
    """The same as a sentence: what it means and how to mend it; empty where nothing is left open."""
    if not certainty.free_targets:
        return ""
    return (
        "base and flange of a calibration by unknown reflectors are its own, about "
        f"{own_ends(certainty) / MM:.2f} mm beside the true ones, if as large as the errors of the links: frames by "
        "irbcal cell have that in them and are right with this calibration only; frames that were measured otherwise "
        "(CAD, tracker) are off by as much: calibrate with reflectors at known places of the flange (--targets)"
    )
