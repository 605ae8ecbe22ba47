r"""Closed-form inverse kinematics of ortho-parallel arms with a spherical wrist (Nubiola 2011, section 6.1).

An arm qualifies when axes 2 and 3 are parallel and perpendicular to axis 1, no distance separates the arm's
plane from axis 1 (``d2 + d3 = 0``), and axes 4, 5 and 6 meet in one point at right angles in turn. Lengths
``a2, a3, a4, d1, d4, d6`` and offsets ``theta`` are free, so the models ``nominal``, ``11`` and ``16`` are
inverted exactly, with ``a4 = 0`` (C = 0 in eq. 6.14) or not. Any signs of the right angles ``alpha`` will do.

Every pose has up to eight branches (`irbcal.modeling.inverse.branches`). ``q`` are here the angles of the thesis, in
which the stretched arm of Figure 5.3 stands upright at zero.

Elbow and upper arm are found from the triangle of upper arm ``a3``, forearm ``L = hypot(a4, d4)`` and reach
``rho``, with ``delta`` the angle from upper arm to forearm: the same line and circle as in Figure 6.1, free of
divisions by C, so that sections 6.1.2 and 6.1.3 are one. All work is on arrays of one quantity for a block of poses.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal import kernel
from irbcal.arrays import LINE, FloatArray, IntArray, Locked, aligned, handed_on, row_arithmetic
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.inverse.branches import Branches, branch_number
from irbcal.modeling.inverse.poses import check_poses, has_last_row, is_rotation, pose_columns

if TYPE_CHECKING:
    from irbcal.modeling.arm import Arm
from collections.abc import Sequence

ROUNDING = 1e-15
"""Elements up to this of the linear map are from the cosines of right angles."""


@dataclass(frozen=True, eq=False, repr=False)
class WristFrame(Locked):
    """The map from the tip to the wrist.

    Attributes
    ----------
    left, right : ndarray, shape (4, 4)
        The wrist is ``left @ T_base_tip @ right``.
    linear : ndarray, shape (12, 12)
        The same of its columns, without the constant.
    constant : ndarray, shape (3,)
        Metres, added to the wrist centre.
    """

    left: FloatArray
    right: FloatArray
    linear: FloatArray
    constant: FloatArray

    @staticmethod
    def of(left: FloatArray, right: FloatArray) -> WristFrame:
        """The map of poses T to ``left @ T @ right``, all (4, 4)."""
        linear = np.kron(right.T, left[:3, :3])
        linear[np.abs(linear) <= ROUNDING] = 0.0
        return WristFrame(left, right, np.asarray(linear, dtype=float), left[:3, 3])

    def place(self, columns: FloatArray, out: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns n, o, a of the hand (9, n) and wrist centre (3, n).

        Parameters
        ----------
        columns : ndarray, shape (12, n)
            Of the tip in the base.
        out : ndarray, shape (12, n)
            Room for them.

        Returns
        -------
        rotation : ndarray, shape (9, n)
            The columns themselves where the hand has the axes of the tip.
        centre : ndarray, shape (3, n)
            Metres.
        """
        if self._products is None:
            # in pieces too small for threads of the BLAS, which would wait where other work goes on
            for start in range(0, columns.shape[1], 1024):
                piece = slice(start, start + 1024)
                np.matmul(self.linear, columns[:, piece], out=out[:, piece])
            rotation = out[:9]
        else:
            first, rotation = (9, columns[:9]) if self._same_axes else (0, out[:9])
            spare = np.empty(columns.shape[1])
            for row, ((k, factor), *more) in zip(out[first:], self._products[first:], strict=True):
                np.multiply(columns[k], factor, out=row)
                for k, factor in more:
                    np.add(row, np.multiply(columns[k], factor, out=spare), out=row)
        centre = out[9:]
        return rotation, np.add(centre, self.constant[:, None], out=centre)

    @cached_property
    def _products(self) -> list[list[tuple[int, float]]] | None:
        """Places and factors of each element's sum; None where there are so many that a product of matrices is less.

        Few they are where the axes of tip, flange and base are parallel.
        """
        if np.count_nonzero(self.linear) > 2 * len(self.linear):
            return None
        return [[(int(k), float(row[k])) for k in np.flatnonzero(row)] for row in self.linear]

    @cached_property
    def _same_axes(self) -> bool:
        return bool(np.array_equal(self.linear[:9], np.eye(9, 12)))


def between(T_1: FloatArray, T_6: FloatArray, d1: float, d6: float) -> WristFrame:
    """The map for an arm: ``T_1`` joint 1 and ``T_6`` joint 6 (4, 4), and the distances along their axes (m)."""
    to_wrist = frames.transform(None, [0.0, 0.0, -d1]) @ frames.inverse(T_1)
    return WristFrame.of(to_wrist, frames.inverse(T_6) @ frames.transform(None, [0.0, 0.0, -d6]))


ON_SINGULARITY = 1e-12
"""Sine of q5 below which q4 is not defined by the pose."""


def of_rotation(
    R: FloatArray,
    plane: FloatArray,
    c23: FloatArray,
    s23: FloatArray,
    q: tuple[Sequence[FloatArray], FloatArray, FloatArray],
    room: FloatArray,
    ahead: ArrayLike = 1.0,
) -> None:
    """Angles q4, q5, q6 with sin q5 >= 0.

    They are of the rotation of the wrist (Nubiola 2011, section 6.1.4, eq. 6.29). q5 and q4 are those of eqs. 6.30,
    6.31 and 6.33; the other branch (eq. 6.32) turns all three. q6 comes from the
    rotation with the angle q4 found undone, which is eqs. 6.36, 6.37 and 6.38 at any q5 and not at the singularity
    (section 6.1.5, eq. 6.35) alone, in place of eq. 6.34: errors of q4 next to it are made good by q6.

    Parameters
    ----------
    R : ndarray, shape (9, n)
        Columns n, o, a of the hand.
    plane : ndarray, shape (6, n)
        n, o, a along the arm's plane, horizontally, and across it.
    c23, s23 : ndarray, shape (..., n)
        Cosine and sine of q2 + q3, of each branch.
    q : tuple
        Takes the angles, radians: those of q4 one by one (as many as the first axis of ``c23``, a sequence of arrays),
        q5 and q6 (arrays like ``c23``).
    room : ndarray, shape (6, ..., n)
        To work in.
    ahead : array_like
        Cosine of the q4 that is taken where the pose leaves it open.
    """
    x, s5, turned, product = room[0], room[1], room[2:4], room[4:6]
    a_r, a_t = plane[2], plane[5]
    c5 = np.multiply(c23, a_r, out=product[0])
    np.subtract(c5, np.multiply(s23, R[8], out=x), out=c5)
    np.multiply(c23, -R[8], out=x)
    np.subtract(x, np.multiply(s23, a_r, out=s5), out=x)  # cos q4 sin q5
    np.multiply(x, x, out=s5)
    np.add(s5, a_t * a_t, out=s5)
    np.sqrt(s5, out=s5)
    y, sines = a_t, [a_t] * len(x)
    singular = s5 < ON_SINGULARITY
    if singular.any():
        x[singular] = np.broadcast_to(ahead, x.shape)[singular]
        y = np.where(singular, 0.0, a_t)
        sines = list(y)
    for values in zip(sines, x, q[0], strict=True):
        np.arctan2(*values)
    np.arctan2(s5, c5, out=q[1])
    along, across, up = (v.reshape(2, *(1,) * (c23.ndim - 1), -1) for v in (plane[:2], plane[3:5], R[2:6:3]))
    np.multiply(along, s23, out=turned)
    np.add(turned, np.multiply(up, c23, out=product), out=turned)
    np.multiply(turned, y, out=turned)
    np.add(turned, np.multiply(across, x, out=product), out=turned)
    np.arctan2(turned[0], turned[1], out=q[2])


BLOCK = 5000
"""Poses per block: more, and rows no longer stay in the cache; fewer, and the calls of numpy outweigh their work."""

ROOM = 43
"""Rows of numbers that the steps of all branches work in."""

EXACT = 1e-9
"""Largest deviation (m or rad) from an ortho-parallel table that counts as rounding."""

FRONT_AND_BACK = np.array([[[1.0]], [[-1.0]]])
"""Cosine of q4 where the pose leaves it open."""

REACH_TOLERANCE = 1e-12
"""Metres by which rounding may put a stretched arm's wrist centre out of reach."""

TAU = 2.0 * np.pi
_CANONICAL = np.array([0.0, -1.0, 0.0, -1.0, 1.0, -1.0]) * (np.pi / 2)


class Triangle(NamedTuple):
    """Square of the reach, wrist centre along and across the upper arm, angle from that to the forearm; elbow up."""

    rho2: FloatArray
    along: FloatArray
    across: FloatArray
    delta: FloatArray

    def other_side(self, side: FloatArray) -> None:
        """The elbow down where ``side`` is -1, in place."""
        for value in (self.across, self.delta):
            np.multiply(value, side, out=value)


@dataclass(frozen=True, eq=False, repr=False)
class OrthoParallel(Locked):
    """What the closed form needs to know of an arm.

    Attributes
    ----------
    name : str
    a2, a3, d4, a4 : float
        Lengths, metres, with the signs they have when all ``alpha`` are those of Table 5.1 and ``a3 > 0``.
    signs, shifts : ndarray, shape (6,)
        ``joint = signs * q + shifts`` with q the angles of Nubiola 2011, section 6.1, radians.
    wrist : WristFrame
        The columns n, o, a of eq. 6.1 and the wrist centre (the origin of frame 4) less ``d1``, all in frame 0, from
        the columns x, y, z and origin of ``T_base_tip``.
    """

    name: str
    a2: float
    a3: float
    d4: float
    a4: float
    signs: FloatArray
    shifts: FloatArray
    wrist: WristFrame

    def __repr__(self) -> str:
        return f"<OrthoParallel of {self.name}>"

    @staticmethod
    @lru_cache(maxsize=64)
    def of(arm: Arm, tolerance: float = EXACT) -> OrthoParallel:
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
            raise RobotError(f"the closed-form inverse is for arms with six revolute joints, {arm.name} has others")
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

    @cached_property
    def numbers(self) -> FloatArray:
        """What the compiled kernel takes: lengths, bend, signs, shifts, and the frames before and behind the tip's."""
        lengths = [self.a2, self.a3, self.d4, self.a4, self._bend]
        return np.concatenate(
            [lengths, self.signs, self.shifts, self.wrist.left[:3].ravel(), self.wrist.right[:3].ravel()]
        )

    @cached_property
    def _kernel(self) -> Any:
        chain = np.tile(np.eye(3, 4), (7, 1, 1))  # branches need no other
        return kernel.made({"slides": np.zeros(6), "chain": chain, "closed_form": self.numbers})

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
        T = check_poses(T_base_tip)
        n = len(T)
        if self._kernel is not None:
            q, found = np.empty((8, 6, n)), np.empty((3, n))
            if self._kernel.branches(np.ascontiguousarray(T), q, found):
                reached = np.repeat(found[1:] >= -REACH_TOLERANCE, 4, axis=0)
                radius, reach = handed_on(found[0]), handed_on(found[1:])
                return Branches(handed_on(q).transpose(2, 0, 1), handed_on(reached).T, radius, reach.T, self)
        joints = aligned(2, 2, 2, 6, -(-n // LINE) * LINE)[..., :n]
        shoulder, margins, valid = np.empty(n), np.empty((2, n)), np.empty((2, 4, n), dtype=bool)
        room = aligned(24 + ROOM, -(-min(n, BLOCK) // LINE) * LINE)
        with row_arithmetic("ignore"):
            for start in range(0, n, BLOCK):
                block = slice(start, min(start + BLOCK, n))
                rows = room[:, : block.stop - start]
                columns = pose_columns(T[block], rows[:12].reshape(4, 3, -1)).reshape(12, -1)
                R, p = self.wrist.place(columns, rows[12:24])
                np.copyto(p[0], np.nan, where=~(has_last_row(T[block], rows[24:]) & is_rotation(R, rows[24:])))
                shoulder[block], margins[:, block] = self._eight(R, p, joints[..., block], rows[24:])
            np.greater_equal(margins[:, None], -REACH_TOLERANCE, out=valid)
        joints_found, reached = handed_on(joints).reshape(8, 6, n), handed_on(valid).reshape(8, n)
        return Branches(joints_found.transpose(2, 0, 1), reached.T, handed_on(shoulder), handed_on(margins).T, self)

    def _eight(self, R: FloatArray, p: FloatArray, out: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """All branches of a block into ``out`` (2, 2, 2, 6, n): back, down, flip, joint.

        R (9, n) and p (3, n) are of `WristFrame.place`, the `ROOM` ``rows`` room to work in. Returns the distance of
        the wrist centre from axis 1 (n,) and the margins of reach (2, n), metres.
        """
        n = R.shape[1]
        plane, r, (k1, nothing), rows = rows[:6], rows[6], rows[7:11].reshape(2, 2, 1, n), rows[11:]
        _shoulder(R, p, r, plane, rows)
        np.subtract(r, self.a2, out=k1[0, 0])
        np.subtract(-self.a2, r, out=k1[1, 0])
        margins, triangle = self._triangle(k1, p[2], rows[:14].reshape(7, 2, 1, n))
        _nothing(margins, nothing)
        joints = out.transpose(3, 0, 1, 2, 4)
        left, right = joints[:, :, :, 0], joints[:, :, :, 1]
        q1 = rows[14:16].reshape(2, 1, n)
        self._joint(0, np.arctan2(p[1], p[0], out=q1[0, 0]))
        _half_turn(q1[0, 0], q1[1, 0], rows[16])
        np.add(q1, nothing, out=left[0, :, :1])
        joints[0] = left[0, :, :1, None]
        np.add(triangle.delta, nothing, out=triangle.delta)
        for side, down in ((left[2, :, :1], self.signs[2] < 0), (left[2, :, 1:], self.signs[2] > 0)):
            (np.subtract if down else np.add)(self._bend, triangle.delta, out=side)
            if (self._bend < 0) if down else (self._bend > 0):
                _within_a_half_turn(side, rows[14:16].reshape(2, 1, n))
        c23, s23 = self._upper(k1, p[2], triangle, left[1], rows[14:])
        # behind axis 1 the plane points the other way: the same as the forearm mirrored, and half a turn of joint 4
        np.multiply(c23[1], -1.0, out=c23[1])
        q4 = left[3, 0], right[3, 1]
        of_rotation(R, plane, c23, s23, (q4, *left[4:]), rows[:24].reshape(6, 2, 2, n), FRONT_AND_BACK)
        for first, second, side in zip(q4, (right[3, 0], left[3, 1]), nothing, strict=True):
            np.add(first, side, out=first)
            self._joint(3, first)
            _half_turn(first, second, rows[:2])
        np.subtract(nothing, left[4], out=right[4])
        self._joint(4, right[4])
        for joint in (1, 4, 5):
            np.add(left[joint], nothing, out=left[joint])
            self._joint(joint, left[joint])
        right[1:3] = left[1:3]
        _half_turn(left[5], right[5], rows[:4].reshape(2, 2, n))
        return r, margins[:, 0]

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
        joints, rows = aligned(6, columns.shape[1]), aligned(12 + 6 + 14, columns.shape[1])
        plane, room = rows[12:18], rows[18:]
        with row_arithmetic("ignore"):
            R, p = self.wrist.place(columns, rows[:12])
            shoulder, elbow, wrist = signs
            r = room[7]
            c1, s1 = _shoulder(R, p, r, plane, room)
            np.arctan2(np.multiply(s1, shoulder, out=s1), np.multiply(c1, shoulder, out=c1), out=joints[0])
            k1, k2 = shoulder * r, p[2]
            k1 -= self.a2
            np.multiply(plane, shoulder, out=plane)
            margin = None
            if pull is not None:
                rho = np.sqrt(k1 * k1 + k2 * k2)
                margin = np.minimum(self.reach - rho, rho - abs(self.a3 - self.forearm))
                rho_limited = np.clip(rho, abs(self.a3 - self.forearm) + pull, self.reach - pull)
                k1, k2 = (
                    np.where(rho > 0, k1 * (rho_limited / rho), rho_limited),
                    np.where(rho > 0, k2 * (rho_limited / rho), 0.0),
                )
            margin_here, triangle = self._triangle(k1, k2, room[:7])
            triangle.other_side(elbow)
            np.add(self._bend, np.multiply(triangle.delta, self.signs[2], out=triangle.delta), out=joints[2])
            c23, s23 = self._upper(k1, k2, triangle, joints[1:2], room[7:14])
            of_rotation(R, plane, c23, s23, (joints[3:4], *joints[4:, None]), room[6:12, None])
            offset = np.multiply(
                np.subtract(1.0, wrist, out=room[0]), 0.5 * np.pi, out=room[0]
            )  # half a turn or nothing
            for joint in (3, 5):
                np.subtract(joints[joint], np.copysign(offset, joints[joint], out=room[1]), out=joints[joint])
            np.multiply(joints[4], wrist, out=joints[4])
            np.add(joints, _nothing(margin_here, room[0]), out=joints)
            for joint in (0, 1, 3, 4, 5):
                self._joint(joint, joints[joint])
            _within_a_half_turn(joints[2], room[0])
        return joints, margin_here if margin is None else margin

    # ------------------------------------------------------------------ the steps

    def _joint(self, joint: int, q: FloatArray) -> None:
        """Joint angle from the thesis's angle, within a half turn of zero, in place."""
        if self.signs[joint] < 0:
            np.multiply(q, -1.0, out=q)
        if self.shifts[joint]:
            np.add(q, self.shifts[joint], out=q)
            _within_a_half_turn(q)

    def _triangle(self, k1: FloatArray, k2: FloatArray, room: FloatArray) -> tuple[FloatArray, Triangle]:
        """Margin of reach, and the triangle of upper arm, forearm and reach, in 7 rows of room.

        The law of cosines is Nubiola 2011, eq. 6.10, from eqs. 6.8 and 6.9: with A, B and C of eqs. 6.12, 6.13 and 6.14
        the line of eq. 6.11 meets the unit circle (Figure 6.1, eqs. 6.18, 6.19 and 6.20; with C = 0 eqs. 6.15, 6.16
        and 6.17), and the two points are the two signs of the sine found here.
        """
        a3, L = self.a3, self.forearm
        inner, outer = abs(a3 - L), a3 + L
        rho2, rho, low, high, along, across, delta = room
        np.multiply(k1, k1, out=rho2)
        np.add(rho2, np.multiply(k2, k2, out=rho), out=rho2)
        np.sqrt(rho2, out=rho)
        np.subtract(rho, inner, out=low)
        np.subtract(outer, rho, out=high)
        margin = np.minimum(low, high)
        np.multiply(
            low, np.add(rho, inner, out=delta), out=low
        )  # 2 a3 L (1 + cos delta), to rounding even at the limits
        np.multiply(high, np.add(rho, outer, out=delta), out=high)  # 2 a3 L (1 - cos delta)
        np.multiply(np.subtract(low, high, out=along), 0.25 / a3, out=along)
        np.multiply(low, high, out=across)
        np.maximum(across, 0.0, out=across)
        np.multiply(np.sqrt(across, out=across), 0.5 / a3, out=across)
        np.arctan2(across, along, out=delta)
        np.add(along, a3, out=along)
        return margin, Triangle(rho2, along, across, delta)

    def _upper(
        self, k1: FloatArray, k2: FloatArray, triangle: Triangle, q2: FloatArray, room: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Angle q2, and cosine and sine of q2 + q3, for the elbow as it is and, where asked for, to the other side.

        With k1 and k2 of Nubiola 2011, eqs. 6.25 and 6.26, two linear equations (eqs. 6.23 and 6.24, together eq. 6.27)
        give q2 by eq. 6.28, into ``q2`` (..., 1 or 2, n). Room is for five arrays like the triangle's and, behind, the
        results.
        """
        rho2, along, across, _ = triangle
        used = 5 * (rho2.size // rho2.shape[-1])
        first, second, third, fourth, scale = room[:used].reshape(5, *rho2.shape)
        s2, c2 = u, v = room[used:].reshape(2, *q2.shape)
        np.multiply(k1, along, out=first)
        np.multiply(k2, across, out=second)
        np.multiply(k2, along, out=third)
        np.multiply(k1, across, out=fourth)
        np.subtract(first, second, out=s2[..., :1, :])
        np.add(third, fourth, out=c2[..., :1, :])
        if q2.shape[-2] > 1:
            np.add(first, second, out=s2[..., 1:, :])
            np.subtract(third, fourth, out=c2[..., 1:, :])
        np.arctan2(s2, c2, out=q2)
        # along the forearm
        cosine, sine = self.d4 / self.forearm**2, self.a4 / self.forearm**2
        factor = 1.0 if sine else cosine
        np.divide(self.a3 * factor, rho2, out=scale)
        np.subtract(np.multiply(k1, factor, out=first), np.multiply(s2, scale, out=u), out=u)
        np.subtract(np.multiply(c2, scale, out=v), np.multiply(k2, factor, out=second), out=v)
        if sine:
            u, v = u * cosine - v * sine, v * cosine + u * sine
        return u, v

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


def _shoulder(
    R: FloatArray, p: FloatArray, r: FloatArray, plane: FloatArray, room: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angle q1, as its cosine and sine, for the wrist in front of axis 1; distance of its centre; n, o, a in the plane.

    q1 is that of Nubiola 2011, section 6.1.1, eqs. 6.5 and 6.6; behind (eq. 6.7) all signs are the other ones. The
    distance goes into ``r``, n, o, a along and across the arm's plane into ``plane``. The first 5 rows of the room are
    used, of which the results are the first 2.
    """
    c1, s1 = room[:2]
    np.multiply(p[0], p[0], out=r)
    np.add(r, np.multiply(p[1], p[1], out=c1), out=r)
    np.sqrt(r, out=r)
    np.divide(1.0, r, out=c1)
    np.multiply(p[1], c1, out=s1)
    np.multiply(p[0], c1, out=c1)
    on_axis = r == 0.0
    if on_axis.any():
        c1[on_axis], s1[on_axis] = 1.0, 0.0
    x, y, radial, across, spare = R[::3], R[1::3], plane[:3], plane[3:], room[2:5]
    np.multiply(x, c1, out=radial)
    np.add(radial, np.multiply(y, s1, out=spare), out=radial)
    np.multiply(y, c1, out=across)
    np.subtract(across, np.multiply(x, s1, out=spare), out=across)
    return c1, s1


def _nothing(margin: FloatArray, out: FloatArray) -> FloatArray:
    """Zero, or NaN where poses are out of reach: added at the end, for arcs of NaN take twice as long."""
    np.add(margin, REACH_TOLERANCE, out=out)
    np.sqrt(np.minimum(out, 0.0, out=out), out=out)
    return np.multiply(out, 0.0, out=out)


def _half_turn(angle: FloatArray, out: FloatArray, spare: FloatArray | None = None) -> None:
    """Angle turned by 180 degrees towards zero."""
    np.subtract(angle, np.copysign(np.pi, angle, out=spare), out=out)


def _within_a_half_turn(angle: FloatArray, spare: FloatArray | None = None) -> None:
    """Take whole turns from an angle, in place."""
    turns = np.multiply(angle, 1.0 / TAU, out=spare)
    np.rint(turns, out=turns)
    np.subtract(angle, np.multiply(turns, TAU, out=turns), out=angle)
