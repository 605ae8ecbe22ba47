r"""Closed-form inverse kinematics of ortho-parallel arms with a spherical wrist (Nubiola 2011, section 6.1).

An arm qualifies when axes 2 and 3 are parallel and perpendicular to axis 1, no distance separates the arm's
plane from axis 1 (``d2 + d3 = 0``), and axes 4, 5 and 6 meet in one point at right angles in turn. Lengths
``a2, a3, a4, d1, d4, d6`` and offsets ``theta`` are free, so the models ``nominal``, ``11`` and ``16`` are
inverted exactly, with ``a4 = 0`` (C = 0 in eq. 6.14) or not. Any signs of the right angles ``alpha`` will do.

Every pose has up to eight branches (`irbcal.modeling.inverse.branches`). ``q`` are here the angles of the thesis, in
which the stretched arm of Figure 5.3 stands upright at zero.

Elbow and upper arm are found from the triangle of upper arm ``a3``, forearm ``L = hypot(a4, d4)`` and reach
``rho``, with ``delta`` the angle from upper arm to forearm: the same line and circle as in Figure 6.1, free of
divisions by C, so that sections 6.1.2 and 6.1.3 are one. The compiled kernel (`irbcal.kernel`) does the same where it
was built.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal import kernel
from irbcal.arrays import FloatArray, IntArray, Locked, handed_on
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.inverse.branches import Branches, branch_number, branch_signs
from irbcal.modeling.inverse.poses import check_poses, pose_columns, usable

if TYPE_CHECKING:
    from irbcal.modeling.arm import Arm

ROUNDING = 1e-15
"""Elements up to this of the linear map are from the cosines of right angles."""


@dataclass(frozen=True, eq=False, repr=False)
class WristFrame(Locked):
    """The map from the tip to the wrist."""

    T_left: FloatArray
    T_right: FloatArray
    """Shape (4, 4). The wrist is ``left @ T_base_tip @ right``."""
    linear: FloatArray
    """Shape (12, 12). The same of its columns, without the constant."""
    constant: FloatArray
    """Shape (3,). Metres, added to the wrist centre."""

    @staticmethod
    def from_transforms(left: FloatArray, right: FloatArray) -> WristFrame:
        """The map of poses T to ``left @ T @ right``, all (4, 4)."""
        linear = np.kron(right.T, left[:3, :3])
        linear[np.abs(linear) <= ROUNDING] = 0.0
        return WristFrame(left, right, np.asarray(linear, dtype=float), left[:3, 3])

    def wrist_of(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns n, o, a of the hand (9, n) and wrist centre (3, n), metres, from those of the tip (12, n)."""
        placed = self.linear @ columns
        return placed[:9], placed[9:] + self.constant[:, None]


def between(T_1: FloatArray, T_6: FloatArray, d1: float, d6: float) -> WristFrame:
    """The map for an arm: ``T_1`` joint 1 and ``T_6`` joint 6 (4, 4), and the distances along their axes (m)."""
    to_wrist = frames.transform(None, [0.0, 0.0, -d1]) @ frames.inverse(T_1)
    return WristFrame.from_transforms(to_wrist, frames.inverse(T_6) @ frames.transform(None, [0.0, 0.0, -d6]))


ON_SINGULARITY = 1e-12
"""Sine of q5 below which q4 is not defined by the pose."""


EXACT = 1e-9
"""Largest deviation (m or rad) from an ortho-parallel table that counts as rounding."""

REACH_TOLERANCE = 1e-12
"""Metres by which rounding may put a stretched arm's wrist centre out of reach."""

TAU = 2.0 * np.pi
_CANONICAL = np.array([0.0, -1.0, 0.0, -1.0, 1.0, -1.0]) * (np.pi / 2)


@dataclass(frozen=True, eq=False, repr=False)
class OrthoParallel(Locked):
    """What the closed form needs to know of an arm."""

    name: str
    a2: float
    a3: float
    d4: float
    a4: float
    """Lengths, metres, with the signs they have when all ``alpha`` are those of Table 5.1 and ``a3 > 0``."""
    signs: FloatArray
    shifts: FloatArray
    """Shape (6,). ``joint = signs * q + shifts`` with q the angles of Nubiola 2011, section 6.1, radians."""
    wrist: WristFrame
    """The columns n, o, a of eq. 6.1 and the wrist centre (the origin of frame 4) less ``d1``, all in frame 0, from the
    columns x, y, z and origin of ``T_base_tip``.
    """

    def __repr__(self) -> str:
        return f"<OrthoParallel of {self.name}>"

    @staticmethod
    @lru_cache(maxsize=64)
    def from_arm(arm: Arm, tolerance: float = EXACT) -> OrthoParallel:
        """The closed form of an arm, with the map from the tip to the wrist centre (Nubiola 2011, eqs. 6.2 and 6.3).

        It is made once for each arm: arms cannot be changed.

        Parameters
        ----------
        arm : Arm
        tolerance : float
            Deviation from an ortho-parallel table to pass over, metres or radians. Larger values than
            rounding give the inverse of the nearest ortho-parallel arm: a start for iterations only.

        Raises
        ------
        RobotError
            If the arm has not six revolute joints, or an entry of the table does not fit; the message says which.
        """
        if not arm.six_revolute:
            raise RobotError(
                f"the closed-form inverse is for arms with six revolute joints, {arm.name} has {arm.joints_listed}"
            )
        table = arm.table
        angles = np.round((table.alpha - _CANONICAL) / np.pi)
        _refuse(arm, "alpha", table.alpha - _CANONICAL - np.pi * angles, table.alpha, range(1, 6), tolerance)
        _refuse(arm, "beta", table.beta, table.beta, range(1, 6), tolerance)
        _refuse(arm, "b", table.b, table.b, range(6), tolerance)
        # Rot(x, 180) before a joint mirrors its angle and its d: pushed along the chain it ends in the tip
        mirrored = np.cumsum(np.r_[0.0, angles[1:]]) % 2 == 1
        signs = np.where(mirrored, -1.0, 1.0)
        d = signs * table.d
        _refuse(arm, "a", table.a, table.a, (4, 5), tolerance)
        _refuse(arm, "d", d, table.d, (4,), tolerance)
        if not abs(d[1] + d[2]) <= tolerance:
            entries = f"d2 + d3 = 0, but d2 = {1e3 * table.d[1]:.9g} mm and d3 = {1e3 * table.d[2]:.9g} mm"
            raise RobotError(f"the closed-form inverse of {arm.name} needs {entries}")
        a2, a3, a4, d4 = table.a[1], table.a[2], table.a[3], d[3]
        for name, length in (("a3", abs(a3)), ("a4 or d4", np.hypot(a4, d4))):
            if not length > 1e-6:
                raise RobotError(f"the closed-form inverse of {arm.name} needs {name} different from zero")
        # joint = sign (q + zero) - offset; a3 < 0 is an upper arm turned by 180 degrees
        zeros = np.array([0.0, -np.pi / 2, 0.0, 0.0, 0.0, np.pi])
        if a3 < 0:
            zeros += np.array([0.0, np.pi, -np.pi, 0.0, 0.0, 0.0])
            a3 = -a3
        shifts = signs * zeros - table.theta
        shifts -= TAU * np.rint(shifts / TAU)
        T_1 = frames.transform(frames.rot_x(table.alpha[0])) @ frames.transform(None, [table.a[0], 0.0, 0.0])
        T_1 = arm.T_base_0 @ T_1 @ frames.transform(frames.rot_y(table.beta[0]))
        T_6 = frames.transform(frames.rot_x(np.pi) if mirrored[5] else None) @ arm.T_last_tip
        return OrthoParallel(arm.name, a2, a3, d4, a4, signs, shifts, between(T_1, T_6, d[0], d[5]))

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths and bend."""
        return self.a2, self.a3, self.d4, self.a4, self._bend

    @cached_property
    def numbers(self) -> FloatArray:
        """What the compiled kernel takes: lengths, bend, signs, shifts, and the frames before and behind the tip's."""
        frames_apart = self.wrist.T_left[:3].ravel(), self.wrist.T_right[:3].ravel()
        return np.concatenate([self.lengths, self.signs, self.shifts, *frames_apart])

    @cached_property
    def _kernel(self) -> Any:
        chain = np.tile(np.eye(3, 4), (7, 1, 1))  # branches need no other
        return kernel.of_robot({"slides": np.zeros(6), "chain": chain, "closed_form": self.numbers})

    @cached_property
    def forearm(self) -> float:
        """Distance of axis 3 from the wrist centre, metres."""
        return float(np.hypot(self.a4, self.d4))

    @property
    def reach(self) -> float:
        """Distance of axis 2 from the wrist centre of the stretched arm, metres."""
        return self.a3 + self.forearm

    @cached_property
    def _bend(self) -> float:
        """Joint 3 with the forearm along the upper arm, within a half turn of zero, radians.

        To it the angle between the two is added, or taken away (Nubiola 2011, eqs. 6.21 and 6.22).
        """
        bend = self.signs[2] * (np.arctan2(self.a4, self.d4) - 0.5 * np.pi) + self.shifts[2]
        return float(bend - TAU * np.rint(bend / TAU))

    # ------------------------------------------------------------------ the eight branches

    def branches(self, T_base_tip: ArrayLike) -> Branches:
        """All branches of a batch of poses.

        Parameters
        ----------
        T_base_tip : array_like, shape (n, 4, 4)
            Tip link in the base link. Poses with NaN, and matrices that are not rigid transforms, have no
            solution.
        """
        T = np.ascontiguousarray(T_base_tip, dtype=float)
        n = len(T)
        if self._kernel is not None:
            out, valid = np.empty((51, n)), np.empty((8, n), dtype=bool)
            if self._kernel.branches(T, out, valid):
                out.setflags(False)  # type: ignore[call-arg]  # write: named it takes four times as long
                valid.setflags(False)  # type: ignore[call-arg]
                joints = out[:48].reshape(8, 6, n).transpose(2, 0, 1)
                return Branches.of_new(joints=joints, valid=valid.T, margins=out[48:].T, arm=self)
        T = check_poses(T)
        columns = pose_columns(T).reshape(12, n)
        columns[:, ~usable(T, columns.reshape(4, 3, n))] = np.nan
        joints, margins = np.empty((8, 6, n)), np.empty((3, n))
        for k in range(8):
            joints[k], margins[1 + k // 4] = self.branch(columns, branch_signs(np.full(n, k)))
        margins[0] = np.hypot(*self.wrist.wrist_of(columns)[1][:2])
        reached = np.repeat(margins[1:] >= -REACH_TOLERANCE, 4, axis=0)
        return Branches(handed_on(joints).transpose(2, 0, 1), handed_on(reached).T, handed_on(margins).T, self)

    # ------------------------------------------------------------------ one branch for each pose

    def branch(
        self, columns: FloatArray, signs: FloatArray, pull: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Joints of one branch for each pose, for iterations.

        Parameters
        ----------
        columns : ndarray, shape (12, n)
            Columns x, y, z and origin of ``T_base_tip``.
        signs : ndarray, shape (3, n)
            The branch as `branch_signs` has it.
        pull : float, optional
            Move a wrist centre to at least this distance (m) inside the reach: there is then always a solution.

        Returns
        -------
        joints : ndarray, shape (6, n)
            Radians, each within a half turn of zero; NaN where there is no solution.
        margin : ndarray, shape (n,)
            As ``reach_margin`` of `Branches`, of the pose as given.
        """
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            R, p = self.wrist.wrist_of(columns)
            front, up, straight = signs
            q1, along, across, radius = _shoulder(R, p, front)
            k1, k2 = front * radius - self.a2, p[2]
            margin = None
            if pull is not None:
                rho = np.hypot(k1, k2)
                margin = np.minimum(self.reach - rho, rho - abs(self.a3 - self.forearm))
                limited = np.clip(rho, abs(self.a3 - self.forearm) + pull, self.reach - pull)
                k1 = np.where(rho > 0, k1 * (limited / rho), limited)
                k2 = np.where(rho > 0, k2 * (limited / rho), 0.0)
            margin_here, q2, delta, c23, s23 = self._triangle(k1, k2, up)
            q4, q5, q6 = of_rotation(R, along, across, c23, s23)
            half_turn = (
                0.5 * np.pi * (1.0 - straight)
            )  # half a turn or nothing: the other branch of the wrist, eq. 6.32
            angles = (q1, q2, None, q4 - np.copysign(half_turn, q4), straight * q5, q6 - np.copysign(half_turn, q6))
            joints = np.array(
                [
                    self._bend + self.signs[2] * delta if q is None else self.signs[j] * q + self.shifts[j]
                    for j, q in enumerate(angles)
                ]
            )
            joints -= TAU * np.rint(joints / TAU)
            joints[:, ~(margin_here >= -REACH_TOLERANCE)] = np.nan
        return joints, margin_here if margin is None else margin

    def _triangle(
        self, k1: FloatArray, k2: FloatArray, up: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Margin of reach, q2, the angle from upper arm to forearm, cosine and sine of q2 + q3, each (n,).

        The law of cosines is Nubiola 2011, eq. 6.10, from eqs. 6.8 and 6.9: with A, B and C of eqs. 6.12, 6.13 and 6.14
        the line of eq. 6.11 meets the unit circle (Figure 6.1, eqs. 6.18, 6.19 and 6.20; with C = 0 eqs. 6.15, 6.16
        and 6.17), and the two points are the two signs ``up`` of the sine found here. With k1 and k2 of eqs. 6.25 and
        6.26, two linear equations (eqs. 6.23 and 6.24, together eq. 6.27) give q2 by eq. 6.28.
        """
        inner, outer = abs(self.a3 - self.forearm), self.a3 + self.forearm
        rho = np.hypot(k1, k2)
        low, high = (rho - inner) * (rho + inner), (outer - rho) * (outer + rho)  # to rounding even at the limits
        margin = np.minimum(rho - inner, outer - rho)
        along = 0.25 / self.a3 * (low - high)
        across = up * (0.5 / self.a3) * np.sqrt(np.maximum(low * high, 0.0))
        delta = np.arctan2(across, along)
        along = along + self.a3
        s2, c2 = k1 * along - k2 * across, k2 * along + k1 * across
        scale = self.a3 / (rho * rho)
        u, v = k1 - s2 * scale, c2 * scale - k2  # along the forearm
        cosine, sine = self.d4 / self.forearm**2, self.a4 / self.forearm**2
        return margin, np.arctan2(s2, c2), delta, u * cosine - v * sine, v * cosine + u * sine

    # ------------------------------------------------------------------ about joints

    def angle(self, joints: ArrayLike, joint: int) -> FloatArray:
        """The thesis's angle q (...) of a joint, counted from 0, for joints (..., 6), radians; not within a turn."""
        return np.asarray((np.asarray(joints, dtype=float)[..., joint] - self.shifts[joint]) * self.signs[joint])

    def configuration(self, joints: ArrayLike) -> IntArray:
        """Branch that joint angles lie in.

        Parameters
        ----------
        joints : array_like, shape (..., 6)
            Radians.

        Returns
        -------
        ndarray of int, shape (...)
            0 to 7; joints exactly at a singularity count as front, up, no-flip.
        """
        joints = np.asarray(joints, dtype=float)
        bent = self.signs[2] * (joints[..., 2] - self._bend)  # angle of the forearm from the upper arm
        down, flip = (q - TAU * np.rint(q * (1.0 / TAU)) < 0 for q in (bent, self.angle(joints, 4)))
        return branch_number(self.radius(joints) < 0, down, flip)

    def radius(self, joints: ArrayLike) -> FloatArray:
        """Distance of the wrist centre from axis 1, metres, negative behind it, for joints (..., 6).

        The bracket of Nubiola 2011, eq. 6.4.
        """
        q2, q3 = self.angle(joints, 1), self.angle(joints, 2)
        (_, c23), (s2, s23) = cos_sin(np.stack([q2, q2 + q3]))
        radius = self.a2 + self.a3 * s2 + self.d4 * c23
        return np.asarray(radius + self.a4 * s23 if self.a4 else radius)

    def wrist_angle(self, joints: ArrayLike) -> FloatArray:
        """Angle between axes 4 and 6 as lines, radians, for joints (..., 6)."""
        q5 = self.angle(joints, 4)
        return np.abs(q5 - np.pi * np.rint(q5 / np.pi))


def _refuse(
    arm: Arm, column: str, deviation: FloatArray, values: FloatArray, rows: Iterable[int], tolerance: float
) -> None:
    """Refuse the first entry of a column (counted from 0) whose deviation is beyond the tolerance or NaN."""
    right = dict.fromkeys((1, 3, 4, 5), "+-90 degrees") | {2: "0 or 180 degrees"}
    expected = right if column == "alpha" else {}
    for i in rows:
        if not abs(deviation[i]) <= tolerance:
            angle = column in ("alpha", "beta")
            value = f"{np.degrees(values[i]):.9g} degrees" if angle else f"{1e3 * values[i]:.9g} mm"
            raise RobotError(
                f"the closed-form inverse of {arm.name} needs {column}{i + 1} = {expected.get(i, '0')}, found {value}"
            )


def _shoulder(R: FloatArray, p: FloatArray, front: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Angle q1, n, o and a along and across the arm's plane (3, n), and distance of the wrist centre from axis 1.

    q1 is that of Nubiola 2011, section 6.1.1, eqs. 6.5 and 6.6; behind axis 1 (eq. 6.7) all signs are the other ones.
    """
    radius = np.hypot(p[0], p[1])
    on_axis = radius == 0.0
    c1, s1 = front * np.where(on_axis, 1.0, p[0] / radius), front * np.where(on_axis, 0.0, p[1] / radius)
    x, y = R[::3], R[1::3]
    return np.arctan2(s1, c1), x * c1 + y * s1, y * c1 - x * s1, radius


def of_rotation(
    R: FloatArray, along: FloatArray, across: FloatArray, c23: FloatArray, s23: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angles q4, q5, q6 with sin q5 >= 0 of the rotation of the wrist (Nubiola 2011, section 6.1.4, eq. 6.29).

    q5 and q4 are those of eqs. 6.30, 6.31 and 6.33; the other branch (eq. 6.32) turns all three. q6 comes from the
    rotation with the angle q4 found undone, which is eqs. 6.36, 6.37 and 6.38 at any q5 and not at the singularity
    (section 6.1.5, eq. 6.35) alone, in place of eq. 6.34: errors of q4 next to it are made good by q6.

    Parameters
    ----------
    R : ndarray, shape (9, n)
        Columns n, o, a of the hand.
    along, across : ndarray, shape (3, n)
        n, o, a along the arm's plane, horizontally, and across it.
    c23, s23 : ndarray, shape (n,)
        Cosine and sine of q2 + q3.
    """
    c5 = c23 * along[2] - s23 * R[8]
    x, y = -R[8] * c23 - s23 * along[2], across[2]  # cos q4 sin q5, sin q4 sin q5
    s5 = np.sqrt(x * x + y * y)
    singular = s5 < ON_SINGULARITY
    x, y = np.where(singular, 1.0, x), np.where(singular, 0.0, y)
    first, second = ((along[k] * s23 + R[3 * k + 2] * c23) * y + across[k] * x for k in range(2))
    return np.arctan2(y, x), np.arctan2(s5, c5), np.arctan2(first, second)
