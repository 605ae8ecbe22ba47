"""Criteria of poses of ISO 9283:1998: accuracy, repeatability, variation, distance and drift.

The formulas are those of public descriptions of the standard (such as Nubiola 2011, annex I and section 7.7.3.4); the
standard itself was not at hand. Every S is a standard deviation with n - 1. The standard's angles a, b, c about x, y
and z are taken of the small rotation from commanded to attained orientation (its rotation vector in the measuring
frame): they then have no singular attitude, and to first order are the differences of the angles.

Lengths are in metres, angles in radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.modeling import frames

AXES, ANGLES = "xyz", "abc"
"""Endings of names: along the axes of the base link, and about them."""


def pose_accuracy(xyz: FloatArray, commanded: ArrayLike) -> tuple[float, FloatArray]:
    """Position accuracy AP: distance of the barycentre of the attained positions from the commanded one.

    ``AP = |mean(x_j) - x_c|``, and ``AP_x = mean(x_j) - x_cx`` along each axis.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Attained, metres.
    commanded : ndarray, shape (3,)

    Returns
    -------
    AP : float
    AP_axes : ndarray, shape (3,)
    """
    axes = xyz.mean(axis=0) - np.asarray(commanded, dtype=float)
    return float(np.linalg.norm(axes)), axes


def position_repeatability(xyz: FloatArray) -> tuple[float, FloatArray]:
    """Position repeatability RP: radius of the sphere about the barycentre (ISO 9283, 7.2.2).

    With mean and largest distance it makes up Tables A I-2 and A I-3 of Nubiola 2011.
    ``l_j = |x_j - mean(x)|``, ``RP = mean(l) + 3 S_l``.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Attained, metres; n at least 2.

    Returns
    -------
    RP : float
    l : ndarray, shape (n,)
        Distances from the barycentre.
    """
    distance = np.linalg.norm(xyz - xyz.mean(axis=0), axis=1)
    return float(distance.mean() + 3 * distance.std(ddof=1)), distance


def angle_accuracy(angles: FloatArray, commanded: ArrayLike = 0.0) -> FloatArray:
    """Orientation accuracy AP_a, AP_b, AP_c: mean angle minus commanded angle, wrapped.

    Parameters
    ----------
    angles : ndarray, shape (n, ...)
        Attained, radians; n at least 1.
    commanded : array_like, shape (...)

    Returns
    -------
    ndarray, shape (...)
        Radians, within half a turn of zero.
    """
    return frames.wrapped(frames.wrapped(angles - np.asarray(commanded)).mean(axis=0))


def angle_repeatability(angles: FloatArray) -> FloatArray:
    """Orientation repeatability RP_a, RP_b, RP_c: ``3 S`` of each angle (Nubiola 2011, eq. I.1), shape (...), radians.

    Parameters
    ----------
    angles : ndarray, shape (n, ...)
        Radians; n at least 2. They are unwrapped about the first one.
    """
    return 3 * frames.wrapped(angles - angles[0]).std(axis=0, ddof=1)


def small_angles(R: FloatArray, R_commanded: FloatArray) -> FloatArray:
    """Angles a, b, c about x, y, z of the rotation from commanded to attained orientation.

    Parameters
    ----------
    R : ndarray, shape (n, 3, 3)
    R_commanded : ndarray, shape (3, 3) or (n, 3, 3)

    Returns
    -------
    ndarray, shape (n, 3)
        Radians.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R @ np.swapaxes(R_commanded, -1, -2)).as_rotvec()


def mean_rotation(R: FloatArray) -> FloatArray:
    """Mean orientation in the sense of the chord, shape (3, 3), of rotations (n, 3, 3)."""
    return frames.nearest_rotation(R.mean(axis=0))


def multidirectional_variation(means: FloatArray) -> float:
    """Multi-directional pose accuracy variation vAP: largest distance between the means of the directions of approach.

    Parameters
    ----------
    means : ndarray, shape (directions, 3)
        Barycentres, metres (or mean angles, radians: then take each column by itself).
    """
    return float(np.linalg.norm(means[:, None] - means, axis=2).max())


def distance_accuracy(
    xyz_1: FloatArray, xyz_2: FloatArray, commanded_1: ArrayLike | None = None, commanded_2: ArrayLike | None = None
) -> tuple[float | None, float]:
    """Distance accuracy AD and repeatability RD between two poses.

    ``D_j = |x_1j - x_2j|``, ``AD = mean(D) - D_c``, ``RD = 3 S_D``.

    Parameters
    ----------
    xyz_1, xyz_2 : ndarray, shape (n, 3)
        Attained in the same cycles, metres.
    commanded_1, commanded_2 : ndarray, shape (3,), optional

    Returns
    -------
    AD : float or None
        None without commanded positions.
    RD : float
    """
    distance = np.linalg.norm(xyz_1 - xyz_2, axis=1)
    accuracy = None
    if commanded_1 is not None and commanded_2 is not None:
        accuracy = float(distance.mean() - np.linalg.norm(np.asarray(commanded_1) - np.asarray(commanded_2)))
    return accuracy, float(3 * distance.std(ddof=1))


def distance_along_axes(
    xyz_1: FloatArray, xyz_2: FloatArray, commanded_1: ArrayLike | None = None, commanded_2: ArrayLike | None = None
) -> tuple[FloatArray | None, FloatArray]:
    """Distance accuracy and repeatability between two poses along each axis.

    ``D_xj = |x_1j - x_2j|``, ``AD_x = mean(D_x) - |x_c1 - x_c2|``, ``RD_x = 3 S``; so for y and z. With the angles of
    the turn from one pose to the other (`small_angles`) in place of ``xyz_1``, and zero in place of ``xyz_2``, these
    are ``AD_a``, ``RD_a`` and so on.

    Parameters
    ----------
    xyz_1, xyz_2 : ndarray, shape (n, 3)
        Attained in the same cycles, metres.
    commanded_1, commanded_2 : ndarray, shape (3,), optional

    Returns
    -------
    AD : ndarray, shape (3,), or None
        None without commanded positions.
    RD : ndarray, shape (3,)
    """
    apart = np.abs(xyz_1 - xyz_2)
    accuracy = None
    if commanded_1 is not None and commanded_2 is not None:
        accuracy = apart.mean(axis=0) - np.abs(np.asarray(commanded_1) - np.asarray(commanded_2))
    return accuracy, 3 * apart.std(axis=0, ddof=1)


@dataclass(frozen=True, eq=False)
class PoseDrift(Locked):
    """Drift of pose accuracy and repeatability over sets of cycles."""

    RP: FloatArray
    """Shape (sets,). Repeatability of each set, metres."""
    shift: FloatArray
    """Shape (sets,). Distance of each set's barycentre from that of the first set, metres."""
    AP: FloatArray | None
    """Shape (sets,). Accuracy of each set, metres; None without a commanded position."""

    @property
    def dRP(self) -> float:
        """Drift of pose repeatability: the last set's RP minus the first set's, metres."""
        return float(self.RP[-1] - self.RP[0])

    @property
    def dAP(self) -> float | None:
        """Drift of pose accuracy: the last set's AP minus the first set's, metres."""
        return None if self.AP is None else float(self.AP[-1] - self.AP[0])


def drift(sets: Sequence[FloatArray], commanded: ArrayLike | None = None) -> PoseDrift:
    """Drift of pose accuracy dAP and repeatability dRP over sets of cycles.

    As the differences of the sets' AP and RP say nothing about the direction, the way of the barycentre is given, too.

    Parameters
    ----------
    sets : sequence of ndarray, shape (n, 3)
        Attained positions of each set, in order of time, metres.
    commanded : ndarray, shape (3,), optional
    """
    means = np.array([xyz.mean(axis=0) for xyz in sets])
    return PoseDrift(
        np.array([position_repeatability(xyz)[0] for xyz in sets]),
        np.linalg.norm(means - means[0], axis=1),
        None if commanded is None else np.linalg.norm(means - np.asarray(commanded, dtype=float), axis=1),
    )
