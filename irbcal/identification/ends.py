"""Base and tool each from two joint axes alone (Nubiola 2011, sections 3.2 and 3.4).

The two ends of the arm need no moves of the joints between: axes 1 and 2 give the base, the last two the frame on which
the tool is mounted. Nothing is iterated; of the nominal arm only its first row, its last row and senses are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import IdentificationError
from irbcal.identification.axes import OneAxis, one_axis
from irbcal.identification.axis_calibration import LARGEST_ANGLE, LARGEST_LENGTH
from irbcal.identification.link_geometry import STEP
from irbcal.measurement.last_moves import STILL
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.extraction import NEARLY_PARALLEL
from irbcal.summary import Speaks, Table, Told
from irbcal.units import DEG, MM


@dataclass(frozen=True, eq=False, repr=False)
class BaseOfAxes(Speaks):
    """The base frame from axes 1 and 2.

    Attributes
    ----------
    T_world_base : ndarray, shape (4, 4)
        From the base link to the measuring frame, metres.
    std : ndarray, shape (6,)
        Of the place (m) and of the turn about the axes of the measuring frame (rad); NaN where the circles leave none.
    angle, distance : float
        Of axis 2 from axis 1, beyond the nominal one, radians and metres: what the base cannot take.
    """

    T_world_base: FloatArray
    std: FloatArray
    angle: float
    distance: float

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """Place and turn of the base link in the measuring frame."""
        values = frames.to_xyz_angles(self.T_world_base) / ([MM] * 3 + [DEG] * 3)
        std = self.std / ([MM] * 3 + [DEG] * 3)
        names = ("x mm", "y mm", "z mm", "alpha deg", "beta deg", "gamma deg")
        rows = tuple((n, float(v), known(float(s))) for n, v, s in zip(names, values, std, strict=True))
        return [
            f"axis 2 from axis 1, beyond the nominal arm: angle {self.angle / DEG:+.4f} degrees, distance "
            f"{self.distance / MM:+.3f} mm",
            Table("Base link in the measuring frame, from axes 1 and 2", ("", "value", "±"), rows, 4),
        ]


@dataclass(frozen=True, eq=False, repr=False)
class ToolOfAxes(Speaks):
    """Places of the targets on the tool from the last two axes.

    Attributes
    ----------
    targets, std : dict of str to ndarray, shape (3,)
        In the tip link, metres; the standard deviations hold those of the axes and the scatter of the points.
    angle, distance : float
        Of the last axis from the one before, beyond the nominal one, radians and metres.
    """

    targets: Mapping[str, FloatArray]
    std: Mapping[str, FloatArray]
    angle: float
    distance: float

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """Places of the targets."""
        rows = tuple(
            (name, *(float(v / MM) for v in place), *(known(float(s / MM)) for s in self.std[name]))
            for name, place in self.targets.items()
        )
        columns = ("target", "x mm", "y mm", "z mm", "± x", "± y", "± z")
        return [
            f"the last axis from the one before, beyond the nominal arm: angle {self.angle / DEG:+.4f} degrees, "
            f"distance {self.distance / MM:+.3f} mm; the nominal length and turn of the last row are taken",
            Table("Targets in the tip link, from the last two axes", columns, rows),
        ]


def known(value: float) -> float | None:
    """A number, or None for what is not known."""
    return value if np.isfinite(value) else None


def base_of_axes(arm: Arm, points: PointSet) -> BaseOfAxes:
    """The base from axes 1 and 2 alone (Nubiola 2011, section 3.2, Figure 3.3).

    Frame 1 lies on axis 1 where the common normal to axis 2 meets it, its x axis along that normal; the base lies the
    nominal first row before it (eq. 3.10).

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
        With the groups ``axis1`` and ``axis2``.

    Returns
    -------
    BaseOfAxes

    Raises
    ------
    IdentificationError
        If a group is missing or gives no axis, if the axes are nearly parallel or those of another arm.
    """
    _check_turning(arm, (0, 1))
    first, second = one_axis(points, 0), one_axis(points, 1)
    before = arm.T_base_0 @ arm.table.step(0)

    def place(p: FloatArray, z: FloatArray) -> FloatArray:
        R = frames.rotation_from_vector(-second.home[0] * z[0])  # axis 2 back to joint 1 at zero
        p_2, z_2 = p[0] + R @ (p[1] - p[0]), R @ z[1]
        return _on_normal(p[0], z[0], p_2, z_2, arm.table.alpha[1], first=True) @ frames.inverse(before)

    def values(p: FloatArray, z: FloatArray) -> FloatArray:
        T = place(p, z)
        turn = T[:3, :3] @ found[:3, :3].T
        return np.concatenate([T[:3, 3], [turn[2, 1], turn[0, 2], turn[1, 0]]])  # tiny angles only

    p, z = _both(first, second)
    found = place(p, z)
    angle, distance = _beyond(arm, 1, p, z, frames.rotation_from_vector(-second.home[0] * z[0]))
    return BaseOfAxes(found, _std((first, second), values), angle, distance)


def tool_of_axes(arm: Arm, points: PointSet) -> ToolOfAxes:
    """The targets in the tip link from the last two axes alone (Nubiola 2011, section 3.4.2, Figures 3.6 and 3.7).

    The x axis lies along the common normal (eqs. 3.20 and 3.21), turn and length of the last row are the nominal ones;
    targets are the mean of their places in that frame over all poses of both groups (eqs. 3.22, 3.23 and 3.24).

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
        With groups for the last two joints, ``axis5`` and ``axis6`` of six, moved with all joints before at one place.

    Returns
    -------
    ToolOfAxes

    Raises
    ------
    IdentificationError
        As `base_of_axes`; also if other joints stand elsewhere in the two groups.
    """
    n = len(arm.joint_names)
    _check_turning(arm, (n - 2, n - 1))
    before, last = one_axis(points, n - 2), one_axis(points, n - 1)
    off = before.home[: n - 2] - last.home[: n - 2]
    off = np.abs(off - 2 * np.pi * np.round(off / (2 * np.pi)))
    if off.max(initial=0.0) > STILL:
        k = int(np.argmax(off))
        raise IdentificationError(
            f"groups axis{n - 1} and axis{n}: joint {k + 1} stands {off[k] / DEG:.3g} degrees apart: for the tool both "
            "axes are moved from one pose"
        )
    names, both = points.target_names, (before.moves, last.moves)
    theta, d = arm.table.theta[n - 1], arm.table.d[n - 1]
    after = frames.transform(None, [0.0, 0.0, d]) @ arm.T_last_tip

    def places(p: FloatArray, z: FloatArray) -> list[FloatArray]:
        """In the tip link, all points of both groups."""
        N = _on_normal(p[0], z[0], p[1], z[1], arm.table.alpha[n - 1], first=False)
        out = []
        for moves in both:
            seen = np.empty((len(moves), 3))
            for pose in range(moves.poses):
                mine = moves.pose == pose
                turn = moves.q[pose, n - 2] - last.home[n - 2]
                R = frames.rotation_from_vector(-turn * z[0])
                back = p[0] + (moves.xyz[mine] - p[0]) @ R.T
                tip = N @ frames.transform(frames.rot_z(theta + moves.q[pose, n - 1])) @ after
                seen[mine] = frames.apply(frames.inverse(tip), back)
            out.append(seen)
        return out

    target = np.concatenate([moves.target for moves in both])
    used = np.unique(target)

    def means(p: FloatArray, z: FloatArray) -> FloatArray:
        all_places = np.concatenate(places(p, z))
        return np.concatenate([all_places[target == t].mean(axis=0) for t in used])

    p, z = _both(before, last)
    seen = np.concatenate(places(p, z))
    of_axes = _std((before, last), means).reshape(-1, 3)
    targets, std = {}, {}
    for k, t in enumerate(used):
        mine = seen[target == t]
        scatter = mine.std(axis=0, ddof=1) / np.sqrt(len(mine)) if len(mine) > 1 else np.full(3, np.nan)
        targets[names[t]], std[names[t]] = mine.mean(axis=0), np.hypot(of_axes[k], scatter)
    angle, distance = _beyond(arm, n - 1, p, z, np.eye(3))
    return ToolOfAxes(targets, std, angle, distance)


def _check_turning(arm: Arm, joints: Sequence[int]) -> None:
    for k in joints:
        if len(arm.joint_names) < 2 or arm.table.prismatic[k]:
            raise IdentificationError(f"joint {k + 1} of {arm.name} does not turn: it draws no circles")


def _both(first: OneAxis, second: OneAxis) -> tuple[FloatArray, FloatArray]:
    """Points (2, 3) on both axes and their directions (2, 3), as measured."""
    return np.array([first.fit.point, second.fit.point]), np.array([first.fit.direction, second.fit.direction])


def _on_normal(
    p_1: FloatArray, z_1: FloatArray, p_2: FloatArray, z_2: FloatArray, alpha: float, first: bool
) -> FloatArray:
    """Frame on the first axis or on the second, its x axis along their common normal, in the sense of a row's alpha."""
    cross = np.cross(z_1, z_2)
    sine = float(np.linalg.norm(cross))
    if sine < NEARLY_PARALLEL:
        raise IdentificationError(
            f"the axes are {np.arcsin(sine) / DEG:.2g} degrees from parallel: they do not give a frame"
        )
    x = cross / sine * (1.0 if np.sin(alpha) > 0 else -1.0)
    w = p_2 - p_1
    # feet of the common normal: p_1 + s z_1 and p_2 + t z_2
    s, t = (np.dot(np.cross(w, other), cross) / sine**2 for other in (z_2, z_1))
    z, origin = (z_1, p_1 + s * z_1) if first else (z_2, p_2 + t * z_2)
    return frames.transform(np.column_stack([x, np.cross(z, x), z]), origin)


def _beyond(arm: Arm, row: int, p: FloatArray, z: FloatArray, R: FloatArray) -> tuple[float, float]:
    """Angle and distance of the second axis, turned back by R, from the first, minus the nominal ones; checked."""
    table = arm.table
    p_2, z_2 = p[0] + R @ (p[1] - p[0]), R @ z[1]
    x = _on_normal(p[0], z[0], p_2, z_2, table.alpha[row], first=True)[:3, 0]
    angle = np.arctan2(np.cross(z[0], z_2) @ x, z[0] @ z_2) - table.alpha[row]
    angle = float(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))
    distance = float((p_2 - p[0]) @ x - table.a[row])
    if abs(angle) > LARGEST_ANGLE or abs(distance) > LARGEST_LENGTH:
        raise IdentificationError(
            f"the measured axes {row} and {row + 1} are not those of {arm.name}: their angle differs by "
            f"{angle / DEG:.0f} degrees, their distance by {distance / MM:.0f} mm; check the robot file, the order and "
            "the sense of the joints"
        )
    return angle, distance


def _std(axes: tuple[OneAxis, OneAxis], values: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """Standard deviations of values of both axes: covariances of the circles through central differences."""
    p, z = _both(*axes)
    variance = np.zeros(len(values(p, z)))
    for k, axis in enumerate(axes):
        J = []
        for m in range(4):
            ends = []
            for sign in (1.0, -1.0):
                moved = [p.copy(), z.copy()]
                array = moved[1] if m < 2 else moved[0]
                array[k] += sign * STEP * axis.fit.basis[m % 2]
                if m < 2:
                    array[k] /= np.linalg.norm(array[k])
                ends.append(values(*moved))
            J.append((ends[0] - ends[1]) / (2 * STEP))
        variance += np.einsum("mi,mn,ni->i", np.array(J), axis.fit.covariance, np.array(J))
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.nan))
