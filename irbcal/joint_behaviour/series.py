"""One joint moved from one home pose: its circles, and the errors along them (Nubiola 2011, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification import axes
from irbcal.measurement.last_moves import STILL
from irbcal.measurement.points import PointSet
from irbcal.summary import Speaks, Told
from irbcal.units import DEG, MM

OFF_CIRCLE, OFF_CIRCLE_FACTOR = 0.2 * MM, 12.0
"""A point farther from its circle than both this and this many robust standard deviations is left out."""


@dataclass(frozen=True, eq=False, repr=False)
class Series(Speaks):
    """One joint moved from one home pose.

    Attributes
    ----------
    name : str
        Of the group.
    joint : int
        Counted from 1.
    q : ndarray, shape (n, joints)
        Joints of its poses in the order of the file, radians.
    direction : ndarray, shape (n,)
        +1 where the joint came from below, -1 from above, 0 where it is not known.
    fit : AxisFit
    points : PointSet
        Points on the circles.
    radial, tangential, axial : ndarray, shape (m,)
        Errors of each point in the frame of Nubiola 2011, Figure 4.2, metres: outwards, in the joint's positive sense,
        along the axis. The tangential error is zero where ``zero`` says.
    radius : ndarray, shape (m,)
        Of each point's circle, metres.
    angle : ndarray, shape (n,)
        Angular error of each pose (measured minus commanded turn), radians.
    zero : float
        Joint angle at which the angular error is set to zero (mean of both directions): the one nearest to 0, radians.
    follow : ndarray, shape (n, 4)
        Change of ``angle`` with the axis' tilts and shifts, in the order of ``fit.covariance``.
    excluded : tuple of tuple
        (pose, target, distance in metres) of points far from their circles.
    payload_kg : float
        Mass carried; NaN where it is not told.
    """

    name: str
    joint: int
    q: FloatArray
    direction: FloatArray
    fit: axes.AxisFit
    points: PointSet
    radial: FloatArray
    tangential: FloatArray
    axial: FloatArray
    radius: FloatArray
    angle: FloatArray
    zero: float
    follow: FloatArray
    excluded: tuple[tuple[str, str, float], ...]
    payload_kg: float = float("nan")

    def __post_init__(self) -> None:
        lock(self)

    @property
    def turn(self) -> FloatArray:
        """The moving joint's angle at each pose, radians."""
        return self.q[:, self.joint - 1]

    @property
    def lever(self) -> float:
        """Root mean square radius, metres."""
        return float(np.sqrt(np.mean(self.radius**2)))

    @property
    def from_both_sides(self) -> bool:
        """Whether the joint came from below and from above."""
        return {-1.0, 1.0} <= set(self.direction.tolist())

    def told(self) -> Sequence[Told]:
        """The sizes of its errors in one sentence."""
        sizes = ", ".join(
            f"{name} {np.sqrt(np.mean(values**2)) / MM:.3f}"
            for name, values in (("radial", self.radial), ("tangential", self.tangential), ("axial", self.axial))
        )
        return (
            f"joint {self.joint} moved alone (group {self.name}): {len(self.q)} poses from "
            f"{self.turn.min() / DEG:.0f} to {self.turn.max() / DEG:.0f} degrees, rms errors in mm: {sizes}",
        )


def one_series(points: PointSet, step: FloatArray, joint: int, name: str) -> Series:
    """Circles of one joint from one home pose, and the errors along them (Nubiola 2011, section 4.1, Figure 4.2).

    The thesis's errors are x (radial), y (tangential), z (axial) and the angle's; where the joint stands at 0, its
    angular and its tangential error are zero.

    Parameters
    ----------
    points : PointSet
        Poses in which only this joint moves.
    step : ndarray, shape (n,)
        Its last move before each pose, radians; NaN where unknown.
    joint : int
        Counted from 1.
    name : str

    Returns
    -------
    Series

    Raises
    ------
    IdentificationError
        As `irbcal.identification.axes.fit_axis`.
    """
    points, fit, excluded = _fit_without_outliers(points, joint, name)
    used = np.zeros(points.poses, dtype=bool)
    used[points.pose] = True
    points, step = points.select(used), step[used]
    turn, pose = points.q[:, joint - 1], points.pose
    slot = np.searchsorted(fit.targets, points.target)
    arms = points.xyz - fit.point
    height, plane = arms @ fit.direction, arms @ fit.basis.T
    radius = fit.radii[slot]
    phi = np.arctan2(plane[:, 1], plane[:, 0])
    error = phi - turn[pose]
    for k in range(len(fit.targets)):  # each target stands at an angle of its own on the tool
        mine = slot == k
        start = np.angle(np.sum(np.exp(1j * error[mine])))
        error[mine] = _wrapped(error[mine] - start)
    angle, error = _common_angle(error, pose, slot, radius**2)
    zero = turn[np.argmin(np.abs(turn))]
    at_zero = angle[np.abs(turn - zero) < axes.SAME_ANGLE].mean()
    tangent = np.column_stack([-np.sin(phi), np.cos(phi)])
    follow = -np.column_stack([height[:, None] * tangent, tangent]) / radius[:, None]
    follow = np.column_stack([_pose_mean(column, pose, radius**2) for column in follow.T])
    return Series(
        name,
        joint,
        points.q,
        np.sign(np.nan_to_num(step)),
        fit,
        points,
        fit.radial,
        radius * (error - at_zero),
        fit.axial,
        radius,
        angle - at_zero,
        float(zero),
        follow,
        excluded,
        float("nan") if points.payload_kg is None else float(points.payload_kg[0]),
    )


def _fit_without_outliers(
    points: PointSet, joint: int, name: str
) -> tuple[PointSet, axes.AxisFit, tuple[tuple[str, str, float], ...]]:
    """Points on circles and their axis; the farthest point goes first, as long as it is far."""
    excluded: list[tuple[str, str, float]] = []
    while True:
        fit = axes.fit_axis(points.xyz, points.target, points.joints()[:, joint - 1], name)
        points = points.take(fit.used)
        off = np.hypot(fit.radial, fit.axial)
        limit = max(OFF_CIRCLE, OFF_CIRCLE_FACTOR * 1.4826 * np.median(off))
        worst = int(np.argmax(off))
        if off[worst] <= limit or len(points) < 8:
            return points, fit, tuple(excluded)
        excluded.append((str(points.pose_ids[points.pose[worst]]), points.names()[worst], float(off[worst])))
        points = points.take(np.arange(len(points)) != worst)


def _pose_mean(values: FloatArray, pose: IntArray, weight: FloatArray) -> FloatArray:
    return np.bincount(pose, weight * values) / np.bincount(pose, weight)


def _common_angle(
    error: FloatArray, pose: IntArray, slot: IntArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angle of each pose that all targets share, and the points' errors about the targets' own zero angles."""
    offset = np.zeros(slot.max() + 1)
    for _ in range(100):  # exact at once where every target is seen in every pose
        angle = _pose_mean(error - offset[slot], pose, weight)
        change = np.bincount(slot, weight * (error - offset[slot] - angle[pose])) / np.bincount(slot, weight)
        offset += change
        if np.abs(change).max() < 1e-15:
            break
    return angle, error - offset[slot]


def home_poses(
    q: FloatArray, mine: BoolArray | NameArray, joint: int, name: str, payload_kg: FloatArray | None = None
) -> list[BoolArray]:
    """Masks of the poses of a group that share the other joints, such as the tests of Nubiola 2011, Table 4.2.

    Poses with different payloads are apart, such as those of Table 4.3.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
        Radians.
    mine : ndarray of bool, shape (n,)
        Poses of the group.
    joint : int
        The one that moves, counted from 1.
    name : str
        Of the group.
    payload_kg : ndarray, shape (n,), optional
        Mass carried at each pose; NaN where it is not told.

    Returns
    -------
    list of ndarray of bool, shape (n,)

    Raises
    ------
    IdentificationError
        If other joints move all the time.
    """
    rows = np.flatnonzero(mine)
    rest = np.delete(q[rows], joint - 1, axis=1)
    homes: list[FloatArray] = []
    which = np.empty(len(rows), dtype=int)
    for k, pose in enumerate(rest):
        off = [np.abs(_wrapped(pose - home)).max() for home in homes]
        if off and min(off) <= STILL:
            which[k] = int(np.argmin(off))
        else:
            which[k] = len(homes)
            homes.append(pose)
    if np.bincount(which).min() < 3:
        spread = np.ptp(_wrapped(rest - rest[0]), axis=0)
        moving = int(np.argmax(spread))
        number = moving + 1 if moving + 1 < joint else moving + 2
        if spread[moving] > STILL:
            raise IdentificationError(
                f"group {name}: joint {number} moves by {spread[moving] / DEG:.3g} degrees, but only joint {joint} may "
                "move there (each other home pose needs three poses or more)"
            )
    masks = []
    load = np.zeros(len(rows)) if payload_kg is None else np.nan_to_num(payload_kg[rows], nan=-1.0)
    for k in range(len(homes)):
        for kg in dict.fromkeys(load[which == k]):
            mask = np.zeros(len(q), dtype=bool)
            mask[rows[(which == k) & (load == kg)]] = True
            masks.append(mask)
    return masks


def _wrapped(angle: FloatArray) -> FloatArray:
    """Angle in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)
