"""Six measured joint axes, from moves of one joint at a time (Nubiola 2011, section 3.1.1).

Each joint is moved by itself; the circles that the reflectors draw give its axis (`irbcal.identification.circles`).
Brought to zero joints, the six axes are what the robot's geometry is made of (`irbcal.identification.link_geometry`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, NameArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import circles
from irbcal.measurement.last_moves import STILL
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.units import DEG

GROUPS = tuple(f"axis{k}" for k in range(1, 7))
"""Groups of poses in which one joint moves, each in its own."""


@dataclass(frozen=True, eq=False)
class OneAxis:
    """One measured joint axis, in the measuring frame.

    Attributes
    ----------
    fit : AxisFit
    home : ndarray, shape (joints,)
        Joints at which the others stood, radians; the moving joint's own entry does not matter.
    moves : PointSet
        The poses of its group and their points.
    """

    fit: circles.AxisFit
    home: FloatArray
    moves: PointSet

    def __post_init__(self) -> None:
        lock(self)


@dataclass(frozen=True, eq=False)
class MeasuredAxes:
    """Six measured joint axes, in the measuring frame ("world").

    Attributes
    ----------
    fits : tuple of AxisFit
        As measured, each at its own home pose.
    homes : ndarray, shape (6, 6)
        Home pose of each group, a row each, radians; the moving joint's own entry does not matter.
    points, directions : ndarray, shape (6, 3)
        A point on each axis (m) and its unit direction with all joints at zero.
    moves : PointSet
        The poses of the six groups and their points.
    """

    fits: tuple[circles.AxisFit, ...]
    homes: FloatArray
    points: FloatArray
    directions: FloatArray
    moves: PointSet

    def __post_init__(self) -> None:
        lock(self)

    def as_measured(self) -> tuple[FloatArray, FloatArray]:
        """Points and directions (6, 3), each axis at its own home pose."""
        return np.array([fit.point for fit in self.fits]), np.array([fit.direction for fit in self.fits])


def measure_axes(points: PointSet) -> MeasuredAxes:
    """Find the six axes from the groups ``axis1`` ... ``axis6`` (Nubiola 2011, section 3.1.1, Figure 3.1).

    Other groups are not looked at.

    Axis k depends on joints 1 to k-1 only: it is brought to zero joints by turning it back about the axes before it
    by the group's home angles, joint 1 outermost. Home poses may differ from group to group.

    Parameters
    ----------
    points : PointSet

    Returns
    -------
    MeasuredAxes

    Raises
    ------
    IdentificationError
        If a group is missing, if other joints move within a group or if a group does not give an axis.
    """
    with_points, groups = _groups(points)
    found = sorted({group for group in groups[with_points] if group})
    if not set(GROUPS) <= set(found):
        raise IdentificationError(
            "the method circles needs one-joint moves in the groups axis1 ... axis6; found "
            + (", ".join(found) or "no groups")
        )
    found_axes = [one_axis(points, k) for k in range(6)]
    fits, homes = [axis.fit for axis in found_axes], np.array([axis.home for axis in found_axes])
    p, z = np.array([fit.point for fit in fits]), np.array([fit.direction for fit in fits])
    moves = points.select(with_points & np.isin(groups, GROUPS))
    return MeasuredAxes(tuple(fits), homes, *at_zero_joints(p, z, homes), moves)


def one_axis(points: PointSet, k: int) -> OneAxis:
    """Find one axis from the group ``axis1``, ``axis2`` … of its joint.

    Parameters
    ----------
    points : PointSet
    k : int
        Joint, counted from 0.

    Returns
    -------
    OneAxis

    Raises
    ------
    IdentificationError
        If the group is missing, if other joints move within it or if it does not give an axis.
    """
    name = f"axis{k + 1}"
    with_points, groups = _groups(points)
    mine = with_points & (groups == name)
    if not mine.any():
        others = ", ".join(sorted({group for group in groups[with_points] if group})) or "no groups"
        raise IdentificationError(f"there are no moves of joint {k + 1} in a group {name}; found {others}")
    moves = points.select(mine)
    home = _home(moves.q, k)
    return OneAxis(circles.fit_axis(moves.xyz, moves.target, moves.joints()[:, k], name), home, moves)


def _groups(points: PointSet) -> tuple[BoolArray, NameArray]:
    """Which poses have points, and the group of each pose."""
    with_points = np.zeros(points.poses, dtype=bool)
    with_points[points.pose] = True
    return with_points, np.array([str(group) for group in points.groups], dtype=object)


def _home(q: FloatArray, k: int) -> FloatArray:
    """The pose of the joints that stand still while joint ``k`` moves."""
    off = q - q[0]
    off -= 2 * np.pi * np.round(off / (2 * np.pi))
    off[:, k] = 0.0
    range_of = np.ptp(off, axis=0)
    worst = int(np.argmax(range_of))
    if range_of[worst] > STILL:
        raise IdentificationError(
            f"group axis{k + 1}: joint {worst + 1} moves by {range_of[worst] / DEG:.3g} degrees, "
            f"but only joint {k + 1} may move there"
        )
    return q[0] + off.mean(axis=0)


def at_zero_joints(points: ArrayLike, directions: ArrayLike, homes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axes with all joints at zero, from axes measured at their own home poses.

    Parameters
    ----------
    points, directions : ndarray, shape (6, 3)
        A point on each axis (m) and its unit direction, any frame.
    homes : ndarray, shape (6, 6)
        Joints at which each axis was measured, radians; of row k only joints before k matter.

    Returns
    -------
    points, directions : ndarray, shape (6, 3)
    """
    p, z = np.array(points, dtype=float), np.array(directions, dtype=float)
    for j in range(5):  # axis j is in place by now: all axes after it turn back about it
        R = np.array([frames.rotation_from_vector(-angle * z[j]) for angle in homes[j + 1 :, j]])
        p[j + 1 :] = p[j] + np.einsum("kab,kb->ka", R, p[j + 1 :] - p[j])
        z[j + 1 :] = np.einsum("kab,kb->ka", R, z[j + 1 :])
    return p, z
