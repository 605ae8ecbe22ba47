"""One joint moved from one home pose: its circles, the errors along them, what a payload adds and stiffness predicts.

Nubiola 2011, sections 4.1, 4.3.1 and 5.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray, rms
from irbcal.errors import IdentificationError
from irbcal.identification import axes
from irbcal.measurement.column_names import declared, joint_units
from irbcal.measurement.motions import STILL
from irbcal.measurement.points import PointSet
from irbcal.modeling.frames import wrapped
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.thesis_map import with_stiffness
from irbcal.summary import Content, Paragraph, Result, Table, TableValue
from irbcal.units import DEG, MM

OFF_CIRCLE, OFF_CIRCLE_FACTOR = 0.2 * MM, 12.0
"""A point farther from its circle than both this and this many robust standard deviations is left out."""


@dataclass(frozen=True, eq=False, repr=False)
class Series(Result):
    """One joint moved from one home pose, as Nubiola 2011, Table 4.1, Table 4.2 and Table 4.4 describe theirs."""

    name: str
    """Of the group."""
    joint: int
    """Counted from 1."""
    q: FloatArray
    """Shape (n, joints). Joints of its poses in the order of the file, radians."""
    direction: FloatArray
    """Shape (n,). +1 where the joint came from below, -1 from above, 0 where it is not known."""
    fit: axes.AxisFit
    points: PointSet
    """Points on the circles."""
    radial: FloatArray
    tangential: FloatArray
    axial: FloatArray
    """Shape (m,). Errors of each point in the frame of Nubiola 2011, Figure 4.2, metres: outwards, in the joint's
    positive sense, along the axis. The tangential error is zero where ``zero`` says.
    """
    radius: FloatArray
    """Shape (m,). Of each point's circle, metres."""
    angle: FloatArray
    """Shape (n,). Angular error of each pose (measured minus commanded turn), radians."""
    zero: float
    """Joint angle at which the angular error is set to zero (mean of both directions): the one nearest to 0, radians.
    """
    follow: FloatArray
    """Shape (n, 4). Change of ``angle`` with the axis' tilts and shifts, in the order of ``fit.covariance``."""
    excluded: tuple[tuple[str, str, float], ...]
    """(pose, target, distance in metres) of points far from their circles."""
    columns: tuple[str, ...]
    """Of the joints in files: ``q1_deg``, or ``q1_mm`` where joint 1 slides."""
    payload_kg: float = float("nan")
    """Mass carried; NaN where it is not told."""

    CONTENT = (
        "group=name poses=q.__len__ payload_kg from_both_sides home range_deg=ends radius_mm *sizes "
        "angle_peak_to_peak_deg=peak_to_peak zero_deg"
    )

    @property
    def turn(self) -> FloatArray:
        """The moving joint's angle at each pose, radians."""
        return self.q[:, self.joint - 1]

    @property
    def lever(self) -> float:
        """Root mean square radius, metres."""
        return rms(self.radius)

    @property
    def from_both_sides(self) -> bool:
        """Whether the joint came from below and from above."""
        return {-1.0, 1.0} <= set(self.direction.tolist())

    @property
    def home(self) -> dict[str, float]:
        """Where the other joints stood, by their columns and in the units of these; NaN for the moving one."""
        values = self.q[0] / joint_units(self.columns)
        values[self.joint - 1] = np.nan
        return dict(zip(self.columns, values.tolist(), strict=True))

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest `turn`, radians."""
        return self.turn.min(), self.turn.max()

    @property
    def radius_mm(self) -> dict[str, float]:
        """Of each target's circle."""
        names = self.points.target_names
        return {names[t]: r / MM for t, r in zip(self.fit.targets, self.fit.radii, strict=True)}

    @property
    def peak_to_peak(self) -> float:
        """Of the angular error, radians."""
        return float(np.ptp(self.angle))

    def sizes(self) -> dict[str, dict[str, float]]:
        """Root mean square and largest size of the ``radial``, ``tangential`` and ``axial`` errors, mm."""
        return {name: error_size(getattr(self, name)) for name in ("radial", "tangential", "axial")}

    def report(self) -> Sequence[Paragraph]:
        """The sizes of its errors in one sentence."""
        sizes = ", ".join(f"{name} {size['rms_mm']:.3f}" for name, size in self.sizes().items())
        return (
            f"joint {self.joint} moved alone (group {self.name}): {len(self.q)} poses from "
            f"{self.turn.min() / DEG:.0f} to {self.turn.max() / DEG:.0f} degrees, rms errors in mm: {sizes}",
        )


def one_series(points: PointSet, step: FloatArray, joint: int, name: str, columns: Sequence[str]) -> Series:
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
    columns : sequence of str
        Of the joints in files.

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
        of_target = slot == k
        start = np.angle(np.sum(np.exp(1j * error[of_target])))
        error[of_target] = wrapped(error[of_target] - start)
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
        tuple(columns),
        float(points.inputs["payload_kg"][0]) if "payload_kg" in points.inputs else float("nan"),
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
    q: FloatArray,
    mine: BoolArray | NameArray,
    joint: int,
    name: str,
    columns: Sequence[str],
    payload_kg: FloatArray | None = None,
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
    columns : sequence of str
        Of the joints in files.
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
    homes: list[FloatArray] = []
    which = np.empty(len(rows), dtype=int)
    for k, pose in enumerate(q[rows]):
        off = [np.abs(_others_apart(pose - home, joint, columns)).max() for home in homes]
        if off and min(off) <= STILL:
            which[k] = int(np.argmin(off))
        else:
            which[k] = len(homes)
            homes.append(pose)
    if np.bincount(which).min() < 3:
        spread = np.ptp(_others_apart(q[rows] - q[rows[0]], joint, columns), axis=0)
        moving = int(np.argmax(spread))
        number = moving + 1 if moving + 1 < joint else moving + 2
        if spread[moving] > STILL:
            column = columns[number - 1]
            amount = f"{spread[moving] / declared(column).unit:.3g} {'mm' if column.endswith('_mm') else 'degrees'}"
            raise IdentificationError(
                f"group {name}: joint {number} moves by {amount}, but only joint {joint} may move there (each "
                "other home pose needs three poses or more)"
            )
    masks = []
    load = np.zeros(len(rows)) if payload_kg is None else np.nan_to_num(payload_kg[rows], nan=-1.0)
    for k in range(len(homes)):
        for kg in dict.fromkeys(load[which == k]):
            mask = np.zeros(len(q), dtype=bool)
            mask[rows[(which == k) & (load == kg)]] = True
            masks.append(mask)
    return masks


def _others_apart(difference: FloatArray, joint: int, columns: Sequence[str]) -> FloatArray:
    """Differences of the joints (..., joints) beside one that moves; those of joints that turn without whole turns."""
    slides = [column.endswith("_mm") for column in columns]
    return np.delete(np.where(slides, difference, wrapped(difference)), joint - 1, axis=-1)


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
    nominal = robot.joint_map.terms.arm
    stiff = JointMap.identity(nominal)
    bent = robot.replace(joint_map=with_stiffness(stiff, np.asarray(stiffness), nominal.stiffness_geometry()[0]))
    modelled = replace(points, xyz=points.predicted(bent))
    return one_series(modelled, np.full(points.poses, np.nan), series.joint, series.name, series.columns).angle


@dataclass(frozen=True, eq=False)
class PayloadEffect(Content):
    """One joint moved from one home pose with two payloads (Nubiola 2011, Table 4.3)."""

    joint: int
    """Counted from 1."""
    home: dict[str, float]
    """Where the other joints stood, by their columns and in the units of these; NaN for this one."""
    target: str
    """The farthest one from the axis that was seen with both."""
    light_kg: float
    heavy_kg: float
    light: float
    heavy: float
    """Largest distance of the target's points from their circle and their angle, each payload's own, metres."""
    shift: float
    """Largest distance between the target's places with the two payloads at one joint angle, reached from the same
    side, in the measuring frame, metres; NaN without such angles.
    """

    CONTENT = (
        "joint target light_kg heavy_kg home light_max_mm=light heavy_max_mm=heavy difference_mm shift_max_mm=shift"
    )

    @property
    def difference(self) -> float:
        """By how much the heavy payload's distance is larger, metres."""
        return self.heavy - self.light


def payload_effects(series: Sequence[Series]) -> tuple[PayloadEffect, ...]:
    """Pairs of series of one joint at one home pose with different payloads, compared (Nubiola 2011, Table 4.3).

    As there, each payload's errors are those from its own circle, all directions together, zero where the joint is
    zero; what the payload does at that angle, and to the circle itself, is not in them. The shift of the points has it.
    """
    out = []
    for first, second in combinations([s for s in series if np.isfinite(s.payload_kg)], 2):
        if first.joint != second.joint or first.payload_kg == second.payload_kg:
            continue
        off = _others_apart(first.q[0] - second.q[0], first.joint, first.columns)
        if np.abs(off).max(initial=0.0) > STILL:
            continue
        light, heavy = sorted((first, second), key=lambda s: s.payload_kg)
        names = [s.points.target_names for s in (light, heavy)]
        radii = dict(zip((names[0][t] for t in light.fit.targets), light.fit.radii, strict=True))
        common = [name for name in radii if name in {names[1][t] for t in heavy.fit.targets}]
        if not common:
            continue
        target = max(common, key=lambda name: float(radii[name]))
        loads, sizes = (light.payload_kg, heavy.payload_kg), (_largest(light, target), _largest(heavy, target))
        shift = _shift(light, heavy, target)
        out.append(PayloadEffect(first.joint, light.home, target, loads[0], loads[1], sizes[0], sizes[1], shift))
    return tuple(out)


def _largest(s: Series, target: str) -> float:
    rows = s.points.names() == target
    return float(np.sqrt(s.radial[rows] ** 2 + s.tangential[rows] ** 2 + s.axial[rows] ** 2).max())


def _shift(light: Series, heavy: Series, target: str) -> float:
    """Largest distance between places at the same angle, reached from the same side."""
    shifts = []
    rows_light, rows_heavy = (np.flatnonzero(s.points.names() == target) for s in (light, heavy))
    poses, poses_heavy = light.points.pose[rows_light], heavy.points.pose[rows_heavy]
    for row, pose in zip(rows_light, poses, strict=True):
        alike = np.abs(heavy.turn[poses_heavy] - light.turn[pose]) < axes.SAME_ANGLE
        alike &= (heavy.direction[poses_heavy] == light.direction[pose]) & (light.direction[pose] != 0)
        if alike.any():
            shifts.append(
                float(np.linalg.norm(heavy.points.xyz[rows_heavy[alike]].mean(axis=0) - light.points.xyz[row]))
            )
    return max(shifts, default=float("nan"))


def payload_table(effects: Sequence[PayloadEffect], mark: str = "") -> Table:
    """The effects as Nubiola 2011, Table 4.3, has them."""
    rows: list[tuple[TableValue, ...]] = []
    for e in effects:
        home = ", ".join("–" if np.isnan(v) else f"{v:.5g}{' mm' * name.endswith('_mm')}" for name, v in e.home.items())
        shift = None if np.isnan(e.shift) else e.shift / MM
        loads = f"{e.light_kg:g}, {e.heavy_kg:g}"
        rows.append((str(e.joint), home, e.target, loads, e.light / MM, e.heavy / MM, (e.heavy - e.light) / MM, shift))
    title = f"{mark}Largest errors with two payloads, from each one's circle, and largest shift of the target, mm"

    columns = ("joint", "home, deg", "target", "kg", "lighter", "heavier", "difference", "shift")
    return Table(title, columns, tuple(rows))


def error_size(values: ArrayLike) -> dict[str, float]:
    """Root mean square and largest size of errors in metres, in mm."""
    values = np.asarray(values, dtype=float) / MM
    return {"rms_mm": rms(values), "max_mm": float(np.abs(values).max())}
