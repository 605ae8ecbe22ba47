"""One joint axis from the circles that reflectors draw while that joint alone moves (Nubiola 2011, section 3.1.1).

All reflectors turn about one line. It has four parameters; each reflector adds its own radius and its own height
along the line. The squared distance of a point from its circle is the sum of a radial and an axial part, and the
sum over all points is minimised by Gauss-Newton steps with analytic derivatives (Gander, Golub and Strebel 1994).

Six such axes, brought to zero joints, are what the robot's geometry is made of
(`irbcal.identification.axis_calibration`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray, group_means
from irbcal.errors import IdentificationError
from irbcal.measurement.motions import STILL
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.units import DEG, MM
from irbcal.wording import counted

MIN_ARC = 20.0 * DEG
"""Shortest arc from which an axis is taken. On three points over an arc of 20 degrees the error of the centre is some
80 times that of a point; it grows with the inverse square of the arc."""

MAX_POSITION_STD = 5.0 * MM
"""Standard deviation of an axis' position above which the axis is refused."""

MOVED = 0.2 * MM
"""A target that stays within this distance of its mean place lies on the axis and says nothing about it."""

MAX_DISAGREEMENT = 5.0 * DEG
"""Root mean square difference between the turn of the points and that of the joint that is still believed."""

SAME_ANGLE = 0.1 * DEG
"""Joint angles closer than this, whole turns aside, are one angle."""

MAX_ITERATIONS = 100
TRIPLE_POINTS = 300


@dataclass(frozen=True, eq=False)
class AxisFit(Locked):
    """A joint axis fitted to circles, in the measuring frame."""

    name: str
    """Of the group, for messages."""
    direction: FloatArray
    """Shape (3,). Unit vector; the joint's positive sense by the right-hand rule."""
    point: FloatArray
    """Shape (3,). The axis' point nearest to the centroid of the points used, metres."""
    targets: IntArray
    """Shape (T,). Targets used; those on the axis are left out."""
    radii: FloatArray
    heights: FloatArray
    """Shape (T,). Radius of each target's circle and height of its plane above ``point``, metres."""
    used: BoolArray
    """Shape (m,). Which of the given points were used."""
    radial: FloatArray
    axial: FloatArray
    """Shape (used,). Residuals of the points used, metres: outwards and along the axis."""
    basis: FloatArray
    """Shape (2, 3). Unit vectors normal to the axis in which the covariance is given."""
    covariance: FloatArray
    """Shape (4, 4). Of the tilt towards each vector of ``basis`` (rad) and the shift of ``point`` along each (m); from
    the residuals with ``2 m - 4 - 2 T`` degrees of freedom. NaN where there are none left.
    """
    arc: float
    """Arc covered, radians: a full turn less the largest gap, of the target that covers most."""

    @property
    def rms(self) -> float:
        """Root mean square distance of the points used from their circles, metres."""
        return float(np.sqrt(np.mean(self.radial**2 + self.axial**2)))

    @property
    def direction_std(self) -> float:
        """Standard deviation of the direction where it is largest, radians; NaN if unknown."""
        return _largest_std(self.covariance[:2, :2])

    @property
    def position_std(self) -> float:
        """Standard deviation of the position at ``point`` where it is largest, metres; NaN if unknown."""
        return _largest_std(self.covariance[2:, 2:])


def _largest_std(covariance: FloatArray) -> float:
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0))) if np.isfinite(covariance).all() else np.nan


def circle_through(points: ArrayLike) -> tuple[FloatArray, FloatArray, float]:
    """Circle through three points (Nubiola 2011, eqs. 3.1, 3.2, 3.3 and 3.4).

    Parameters
    ----------
    points : array_like, shape (3, 3)
        One point a row, metres.

    Returns
    -------
    normal, center : ndarray, shape (3,)
        Unit normal of the plane by eq. 3.1 and centre, metres.
    radius : float
        Metres.

    Raises
    ------
    IdentificationError
        If the points lie on one line.
    """
    p_1, p_2, p_3 = np.asarray(points, dtype=float)
    first, second = p_1 - p_2, p_3 - p_2
    normal = frames.cross(first, second)
    length = np.linalg.norm(normal)
    if length <= 1e-12 * np.linalg.norm(first) * np.linalg.norm(second) or length == 0.0:
        raise IdentificationError("three points on one line do not give a circle")
    normal = normal / length
    # the three planes of eqs. 3.2 to 3.4, seen from p_2; unit normals keep short arcs well scaled
    sides = np.linalg.norm([first, second], axis=1)
    planes = np.array([normal, first / sides[0], second / sides[1]])
    arm = np.linalg.solve(planes, [0.0, sides[0] / 2, sides[1] / 2])
    return normal, p_2 + arm, float(np.linalg.norm(arm))


def best_triple(points: FloatArray) -> tuple[FloatArray, float]:
    """The two points farthest apart and the one that spans the largest triangle with them.

    Of more than `TRIPLE_POINTS` points an even selection is looked at.

    Parameters
    ----------
    points : ndarray, shape (m, 3)

    Returns
    -------
    triple : ndarray, shape (3, 3)
    area : float
        Of the triangle, m^2.
    """
    points = points[np.unique(np.linspace(0, len(points) - 1, TRIPLE_POINTS).astype(int))]
    gaps = np.linalg.norm(points[:, None] - points[None, :], axis=2)
    i, j = divmod(int(np.argmax(gaps)), len(points))
    areas = 0.5 * np.linalg.norm(frames.cross(points[i] - points, points[j] - points), axis=1)
    k = int(np.argmax(areas))
    return points[[i, k, j]], float(areas[k])


def fit_axis(xyz: ArrayLike, target: ArrayLike, angle: ArrayLike, name: str = "axis") -> AxisFit:
    """The common axis of the circles that targets draw while one joint moves (Nubiola 2011, section 3.1.1, Figure 3.1).

    Parameters
    ----------
    xyz : ndarray, shape (m, 3)
        Measured points, metres, any frame.
    target : ndarray of int, shape (m,)
        Which target each point belongs to.
    angle : ndarray, shape (m,)
        The joint's angle at each point, radians; whole turns do not matter. Used for the sense of the axis and for
        the arc only, not for the fit.
    name : str
        For messages: the group.

    Raises
    ------
    IdentificationError
        If no target was seen at three different angles or moves at all, if the arc is shorter than `MIN_ARC` or leaves
        the axis' position uncertain by more than `MAX_POSITION_STD`, if the points do not lie on circles or do not
        turn as the joint does.
    """
    positions, angles = np.asarray(xyz, dtype=float), np.asarray(angle, dtype=float)
    names, index = np.unique(np.asarray(target), return_inverse=True)
    turns = [distinct_angles(angles[index == k]) for k in range(len(names))]
    count = max(map(len, turns), default=0)
    if count < 3:
        raise IdentificationError(
            f"group {name}: found {counted(count, 'different joint angle')}, at least 3 are needed to find the axis"
        )
    arc = max(map(arc_of, turns))
    if arc < MIN_ARC:
        raise IdentificationError(
            f"group {name}: an arc of {arc / DEG:.1f} degrees is too short to find the axis: "
            f"at least {MIN_ARC / DEG:.0f} degrees are needed"
        )
    off_center = np.linalg.norm(positions - group_means(positions, index)[index], axis=1)
    moves = np.array([off_center[index == k].max() > MOVED and len(turns[k]) > 1 for k in range(len(names))])
    used = moves[index]
    if not any(len(turn) > 2 and moved for turn, moved in zip(turns, moves, strict=True)):
        raise IdentificationError(
            f"group {name}: no target moves by more than {MOVED / MM:g} mm: all of them lie on the axis"
        )
    positions, angles = positions[used], angles[used]
    targets, index = np.unique(index[used], return_inverse=True)
    direction, point = _fit(positions, index, name)
    direction, disagreement = _sense(direction, point, positions, index, angles)
    if disagreement > MAX_DISAGREEMENT:
        raise IdentificationError(
            f"group {name}: the points turn otherwise than the joint does, by {disagreement / DEG:.0f} degrees: "
            "check the joint's unit and column"
        )
    basis, radii, heights, r, J = _equations(direction, point, positions, index)
    m = len(positions)
    freedom = 2 * m - 4 - 2 * len(targets)
    # three points on one circle leave no residual to judge by
    covariance = np.linalg.inv(J.T @ J) * (r @ r / freedom) if freedom > 0 else np.full((4, 4), np.nan)
    fit = AxisFit(
        name, direction, point, names[targets], radii, heights, used, r[:m], r[m:], basis, covariance, float(arc)
    )
    _check(fit)
    return fit


def distinct_angles(angle: FloatArray) -> FloatArray:
    """Joint angles without repetitions, whole turns aside, sorted in [0, 2 pi); radians."""
    angle = np.sort(np.mod(angle, 2 * np.pi))
    if len(angle) == 0:
        return angle
    gaps = angle - np.append(angle[-1] - 2.0 * np.pi, angle[:-1])
    distinct = angle[gaps > SAME_ANGLE]
    return distinct if len(distinct) else angle[:1]


def arc_of(angles: FloatArray) -> float:
    """Smallest arc that holds sorted angles in [0, 2 pi), radians."""
    return 2 * np.pi - np.diff(angles, append=angles[0] + 2 * np.pi).max()


def _check(axis: AxisFit) -> None:
    std = axis.position_std
    if not std > MAX_POSITION_STD:
        return
    needed = axis.arc * np.sqrt(std / MAX_POSITION_STD)
    said = f"group {axis.name}: on an arc of {axis.arc / DEG:.1f} degrees the axis is known to {std / MM:.1f} mm only"
    if needed < np.radians(300.0):
        raise IdentificationError(f"{said}: about {needed / DEG:.0f} degrees are needed")
    raise IdentificationError(f"{said}: the points lie {axis.rms / MM:.1f} mm off their circles")


def _moved(
    direction: FloatArray, point: FloatArray, basis: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The axis after tilts (rad) and shifts (m) along the basis."""
    turned = direction + step[:2] @ basis
    return turned / np.linalg.norm(turned), point + step[2:] @ basis


def _equations(
    direction: FloatArray, point: FloatArray, xyz: FloatArray, index: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Basis, radii, heights, residuals (2 m,) and their derivatives (2 m, 4); radii and heights are eliminated."""
    basis = frames.with_third(direction)[:, :2].T
    arms = xyz - point
    height = arms @ direction
    outward = arms - height[:, None] * direction
    radius = np.linalg.norm(outward, axis=1)
    plane = outward @ basis.T
    normal = plane / np.maximum(radius, 1e-300)[:, None]
    # tilting the axis by e moves a point at height h inwards by h n.e and up by e.outward; shifting it, inwards by n.e
    J_radial = np.column_stack([-height[:, None] * normal, -normal])
    J_axial = np.column_stack([plane, np.zeros_like(plane)])
    radii, heights = group_means(radius, index), group_means(height, index)
    r = np.concatenate([radius - radii[index], height - heights[index]])
    J = np.concatenate([J - group_means(J, index)[index] for J in (J_radial, J_axial)])
    return basis, radii, heights, r, J


def _fit(xyz: FloatArray, index: IntArray, name: str) -> tuple[FloatArray, FloatArray]:
    """Direction and point of the axis: from one target's best triple, then that target, then all of them."""
    triples = [best_triple(xyz[index == k]) for k in range(index.max() + 1)]
    best = int(np.argmax([area for _, area in triples]))
    direction, point, _ = circle_through(triples[best][0])
    one_target = index == best
    direction, point = _gauss_newton(direction, point, xyz[one_target], np.zeros(one_target.sum(), dtype=int), name)
    return _gauss_newton(direction, point, xyz, index, name)


def _gauss_newton(
    direction: FloatArray, point: FloatArray, xyz: FloatArray, index: IntArray, name: str
) -> tuple[FloatArray, FloatArray]:
    """The axis that fits circles best, from a first guess (Gander, Golub and Strebel 1994)."""
    center = xyz.mean(axis=0)
    for _ in range(MAX_ITERATIONS):
        point = point + direction * (direction @ (center - point))
        basis, _, _, r, J = _equations(direction, point, xyz, index)
        step = np.asarray(np.linalg.lstsq(J, -r, rcond=1e-13)[0], dtype=float)
        size, shrink = np.abs(step).max(), 1.0
        if size < 1e-11:
            return direction, point
        while True:
            trial = _moved(direction, point, basis, shrink * step)
            residual = _equations(*trial, xyz, index)[3]
            # what a short step gains is lost in rounding
            if residual @ residual <= r @ r or size < 1e-7:
                break
            shrink *= 0.5
            if shrink < 1e-6:
                return direction, point
        direction, point = trial
    raise IdentificationError(f"group {name}: no circles fit the points: check the targets' names and the joints")


def _sense(
    direction: FloatArray, point: FloatArray, xyz: FloatArray, index: IntArray, angle: FloatArray
) -> tuple[FloatArray, float]:
    """The direction with the joint's positive sense, and the rms difference of both turns, radians.

    Points count by their radius: near the axis their direction is lost in noise.
    """
    basis = frames.with_third(direction)[:, :2].T
    plane = (xyz - point) @ basis.T
    turn, weight = np.arctan2(plane[:, 1], plane[:, 0]), np.linalg.norm(plane, axis=1)
    spread = []
    for sign in (1.0, -1.0):
        phasor = np.exp(1j * (sign * turn - angle))
        sums = np.zeros(index.max() + 1, dtype=complex)
        np.add.at(sums, index, weight * phasor)
        off = np.angle(phasor * np.conj(sums)[index])
        spread.append(np.sqrt(np.sum(weight * off**2) / np.sum(weight)))
    return (direction, spread[0]) if spread[0] <= spread[1] else (-direction, spread[1])


GROUPS = tuple(f"axis{k}" for k in range(1, 7))
"""Groups of poses in which one joint moves, each in its own."""


@dataclass(frozen=True, eq=False)
class OneAxis(Locked):
    """One measured joint axis, in the measuring frame."""

    fit: AxisFit
    home: FloatArray
    """Shape (joints,). Joints at which the others stood, radians; the moving joint's own entry does not matter."""
    moves: PointSet
    """The poses of its group and their points."""


@dataclass(frozen=True, eq=False)
class MeasuredAxes(Locked):
    """Six measured joint axes, in the measuring frame ("world")."""

    fits: tuple[AxisFit, ...]
    """As measured, each at its own home pose."""
    homes: FloatArray
    """Shape (6, 6). Home pose of each group, a row each, radians; the moving joint's own entry does not matter."""
    points: FloatArray
    directions: FloatArray
    """Shape (6, 3). A point on each axis (m) and its unit direction with all joints at zero."""
    moves: PointSet
    """The poses of the six groups and their points."""

    def as_measured(self) -> tuple[FloatArray, FloatArray]:
        """Points and directions (6, 3), each axis at its own home pose."""
        return np.array([fit.point for fit in self.fits]), np.array([fit.direction for fit in self.fits])


def measure_axes(points: PointSet) -> MeasuredAxes:
    """Find the six axes from the groups ``axis1`` ... ``axis6`` (Nubiola 2011, section 3.1.1, Figure 3.1).

    Other groups are not looked at.

    Axis k depends on joints 1 to k-1 only: it is brought to zero joints by turning it back about the axes before it
    by the group's home angles, joint 1 outermost. Home poses may differ from group to group.

    Raises
    ------
    IdentificationError
        If a group is missing, if other joints move within a group or if a group does not give an axis.
    """
    with_points, groups = _groups(points)
    axis_groups = sorted({group for group in groups[with_points] if group})
    if not set(GROUPS) <= set(axis_groups):
        raise IdentificationError(
            "the method circles needs one-joint moves in the groups axis1 ... axis6; found "
            + (", ".join(axis_groups) or "no groups")
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

    Raises
    ------
    IdentificationError
        If the group is missing, if other joints move within it or if it does not give an axis.
    """
    name = f"axis{k + 1}"
    with_points, groups = _groups(points)
    moved_alone = with_points & (groups == name)
    if not moved_alone.any():
        listed = ", ".join(sorted({group for group in groups[with_points] if group})) or "no groups"
        raise IdentificationError(f"there are no moves of joint {k + 1} in a group {name}; found {listed}")
    moves = points.select(moved_alone)
    home = _home(moves.q, k)
    return OneAxis(fit_axis(moves.xyz, moves.target, moves.joints()[:, k], name), home, moves)


def _groups(points: PointSet) -> tuple[BoolArray, NameArray]:
    """Which poses have points, and the group of each pose."""
    with_points = np.zeros(points.poses, dtype=bool)
    with_points[points.pose] = True
    return with_points, np.array([str(group) for group in points.groups], dtype=object)


def _home(q: FloatArray, k: int) -> FloatArray:
    """The pose of the joints that stand still while joint ``k`` moves."""
    off = q - q[0]
    off = frames.wrapped(off)
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
        R = frames.rotation_from_vector(-homes[j + 1 :, j, None] * z[j])
        p[j + 1 :] = p[j] + np.einsum("kab,kb->ka", R, p[j + 1 :] - p[j])
        z[j + 1 :] = np.einsum("kab,kb->ka", R, z[j + 1 :])
    return p, z
