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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.inverse.branches import Branches, branch_number

if TYPE_CHECKING:
    from irbcal.modeling.arm import Arm

BLOCK = 8192
"""Poses per block: the working set of a block stays in the processor's cache."""

EXACT = 1e-9
"""Largest deviation (m or rad) from an ortho-parallel table that counts as rounding."""

REACH_TOLERANCE = 1e-12
"""Metres by which rounding may put a stretched arm's wrist centre out of reach."""

ROTATION_TOLERANCE = 1e-6
"""Deviation from a rotation matrix above which a pose counts as no pose."""

TAU = 2.0 * np.pi
_CANONICAL = np.array([0.0, -1.0, 0.0, -1.0, 1.0, -1.0]) * (np.pi / 2)
_ON_SINGULARITY = 1e-12  # sine of q5 below which q4 is not defined by the pose


Triangle: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Square of the reach, cosine and sine of the angle from upper arm to forearm."""


@dataclass(frozen=True, eq=False, repr=False)
class OrthoParallel:
    """What the closed form needs to know of an arm.

    Attributes
    ----------
    name : str
    a2, a3, d4, a4 : float
        Lengths, metres, with the signs they have when all ``alpha`` are those of Table 5.1 and ``a3 > 0``.
    signs, shifts : ndarray, shape (6,)
        ``joint = signs * q + shifts`` with q the angles of Nubiola 2011, section 6.1, radians.
    linear : ndarray, shape (12, 12)
    constant : ndarray, shape (12,)
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
    linear: FloatArray
    constant: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    def __repr__(self) -> str:
        return f"<OrthoParallel of {self.name}>"

    @staticmethod
    def of(arm: Arm, tolerance: float = EXACT) -> OrthoParallel:
        """The closed form of an arm, with the map from the tip to the wrist centre (Nubiola 2011, eqs. 6.2 and 6.3).

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
        before = frames.transform(frames.rot_x(table.alpha[0])) @ frames.transform(None, [table.a[0], 0.0, 0.0])
        before = arm.T_base_0 @ before @ frames.transform(frames.rot_y(table.beta[0]))
        after = frames.transform(frames.rot_x(np.pi) if mirrored[5] else None) @ arm.T_last_tip
        left = frames.transform(None, [0.0, 0.0, -d[0]]) @ frames.inverse(before)
        right = frames.inverse(after) @ frames.transform(None, [0.0, 0.0, -d[5]])
        linear = np.kron(right.T, left[:3, :3])
        constant = np.concatenate([np.zeros(9), left[:3, 3]])
        return OrthoParallel(arm.name, a2, a3, d4, a4, signs, shifts, np.asarray(linear, dtype=float), constant)

    @property
    def forearm(self) -> float:
        """Distance of axis 3 from the wrist centre, metres."""
        return float(np.hypot(self.a4, self.d4))

    @property
    def reach(self) -> float:
        """Distance of axis 2 from the wrist centre of the stretched arm, metres."""
        return self.a3 + self.forearm

    # ------------------------------------------------------------------ the eight branches

    def branches(self, T_base_tip: ArrayLike) -> Branches:
        """All branches of a batch of poses.

        Parameters
        ----------
        T_base_tip : array_like, shape (n, 4, 4)
            Tip link in the base link. Poses with NaN, and matrices that are not rigid transforms, have no
            solution.

        Returns
        -------
        Branches
        """
        T = check_poses(T_base_tip)
        n = len(T)
        joints, valid = np.empty((n, 8, 6)), np.empty((n, 8), dtype=bool)
        shoulder, margins = np.empty(n), np.empty((n, 2))
        # columns of the linear map in the order of the elements of T, whose last row is constant
        blocks = np.zeros((12, 4, 4))
        blocks[:, :3] = self.linear.reshape(12, 4, 3).swapaxes(1, 2)
        linear = blocks.reshape(12, 16)
        out = np.empty((8, 6, min(n, BLOCK)))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for start in range(0, n, BLOCK):
                block = slice(start, min(start + BLOCK, n))
                X = _map(linear, T[block].reshape(-1, 16).T)
                here = out[:, :, : X.shape[1]]
                shoulder[block], margins[block], valid[block] = self._eight(X, here)
                joints[block] = here.transpose(2, 0, 1)
        for array in (joints, valid, shoulder, margins):  # nobody else has them: locked without a copy
            array.setflags(write=False)
        return Branches(joints, valid, shoulder, margins, self)

    def _eight(self, X: FloatArray, out: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """All branches of a block into ``out`` (8, 6, n); X (12, n) from the linear map without the constant."""
        X[9:] += self.constant[9:, None]
        X[9, ~is_rotation(X)] = np.nan
        r, _, _, front = _shoulder(X)
        q1 = self._joint(0, np.arctan2(X[10], X[9]))
        q1_back = _half_turn(q1)
        each = []
        for back, sign in enumerate((1.0, -1.0)):
            k1 = sign * r - self.a2
            margin, triangle = self._triangle(k1, X[11])
            each.append(margin)
            plane = front if back == 0 else [-v for v in front]
            inside = margin >= -REACH_TOLERANCE
            for down, side in enumerate((1.0, -1.0)):
                rows = out[4 * back + 2 * down], out[4 * back + 2 * down + 1]
                q2, q3, c23, s23 = self._upper(k1, X[11], triangle, side)
                angles = (q1_back if back else q1), q2, q3, *self._wrist(X, plane, c23, s23)
                for joint, angle in enumerate(angles):
                    rows[0][joint] = angle if joint == 0 else self._joint(joint, angle)
                rows[1][:3] = rows[0][:3]
                rows[1][3] = _half_turn(rows[0][3])
                rows[1][4] = self._joint(4, -angles[4])
                rows[1][5] = _half_turn(rows[0][5])
            if not inside.all():
                out[4 * back : 4 * back + 4, :, ~inside] = np.nan
        margins = np.array(each).T
        return r, margins, np.repeat(margins >= -REACH_TOLERANCE, 4, axis=1)

    # ------------------------------------------------------------------ one branch for each pose

    def branch(self, columns: FloatArray, branch: IntArray, pull: float | None = None) -> tuple[FloatArray, FloatArray]:
        """Joints of one branch for each pose, for iterations.

        Parameters
        ----------
        columns : ndarray, shape (12, n)
            Columns x, y, z and origin of ``T_base_tip``.
        branch : ndarray of int, shape (n,)
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
            X = _map(self.linear, columns)
            X[9:] += self.constant[9:, None]
            shoulder, elbow, wrist = (np.where((branch >> bit) & 1, -1.0, 1.0) for bit in (2, 1, 0))
            r, c1, s1, plane = _shoulder(X)
            k1, k2 = shoulder * r - self.a2, X[11]
            plane = [shoulder * v for v in plane]
            if pull is None:
                margin, triangle = self._triangle(k1, k2)
            else:
                rho = np.sqrt(k1 * k1 + k2 * k2)
                margin = np.minimum(self.reach - rho, rho - abs(self.a3 - self.forearm))
                wanted = np.clip(rho, abs(self.a3 - self.forearm) + pull, self.reach - pull)
                k1, k2 = np.where(rho > 0, k1 * (wanted / rho), wanted), np.where(rho > 0, k2 * (wanted / rho), 0.0)
                triangle = self._triangle(k1, k2)[1]
            q2, q3, c23, s23 = self._upper(k1, k2, triangle, elbow)
            q4, q5, q6 = self._wrist(X, plane, c23, s23)
            q1 = np.arctan2(shoulder * s1, shoulder * c1)
            flip = wrist < 0
            q4, q6 = (np.where(flip, _half_turn(q), q) for q in (q4, q6))
            joints = np.empty((6, len(r)))
            for joint, angle in enumerate((q1, q2, q3, q4, wrist * q5, q6)):
                joints[joint] = self._joint(joint, angle)
        return joints, margin

    # ------------------------------------------------------------------ the steps

    def _joint(self, joint: int, q: FloatArray) -> FloatArray:
        """Joint angle from the thesis's angle, within a half turn of zero."""
        if self.signs[joint] < 0:
            q = -q
        if self.shifts[joint]:
            q = q + self.shifts[joint]
            q -= TAU * np.rint(q * (1.0 / TAU))
        return q

    def _triangle(self, k1: FloatArray, k2: FloatArray) -> tuple[FloatArray, Triangle]:
        """Margin of reach, and cosine and sine of the angle from upper arm to forearm.

        The law of cosines is Nubiola 2011, eq. 6.10, from eqs. 6.8 and 6.9: with A, B and C of eqs. 6.12, 6.13 and 6.14
        the line of eq. 6.11 meets the unit circle (Figure 6.1, eqs. 6.18, 6.19 and 6.20; with C = 0 eqs. 6.15, 6.16
        and 6.17), and the two points are the two signs of the sine found here.
        """
        a3, L = self.a3, self.forearm
        rho2 = k1 * k1 + k2 * k2
        rho = np.sqrt(rho2)
        inner, outer = abs(a3 - L), a3 + L
        low, high = rho - inner, outer - rho
        margin = np.minimum(low, high)
        low *= rho + inner  # 2 a3 L (1 + cos delta), to rounding even at the limits
        high *= rho + outer  # 2 a3 L (1 - cos delta)
        cosine = (low - high) * (0.25 / (a3 * L))
        product = low * high
        # poses beyond the tolerance get the square root of a negative number: NaN
        product[(product < 0) & (margin >= -REACH_TOLERANCE)] = 0.0
        return margin, (rho2, cosine, np.sqrt(product) * (0.5 / (a3 * L)))

    def _upper(
        self, k1: FloatArray, k2: FloatArray, triangle: Triangle, side: FloatArray | float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Angles q2 and q3, and cosine and sine of q2 + q3; side +1 up, -1 down.

        q3 is that of Nubiola 2011, eqs. 6.21 and 6.22. With k1 and k2 of eqs. 6.25 and 6.26, two linear
        equations (eqs. 6.23 and 6.24, together eq. 6.27) give q2 by eq. 6.28.
        """
        rho2, cosine, sine = triangle
        sine = side * sine
        L, cos_b, sin_b = self.forearm, self.d4 / self.forearm, self.a4 / self.forearm
        E1, E2 = self.a3 + L * cosine, L * sine  # the wrist centre seen along the upper arm
        s2, c2 = k1 * E1 - k2 * E2, k2 * E1 + k1 * E2
        q2 = np.arctan2(s2, c2)
        scale = self.a3 / rho2
        u, v = (k1 - scale * s2) * (1.0 / L), (scale * c2 - k2) * (1.0 / L)  # along the forearm
        if sin_b:
            q3 = np.arctan2(sin_b * sine - cos_b * cosine, cos_b * sine + sin_b * cosine)
            return q2, q3, cos_b * u - sin_b * v, cos_b * v + sin_b * u
        return q2, np.arctan2(-cos_b * cosine, cos_b * sine), cos_b * u, cos_b * v

    @staticmethod
    def _wrist(
        X: FloatArray, plane: Sequence[FloatArray], c23: FloatArray, s23: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Angles q4, q5, q6 with sin q5 >= 0, from the rotation of the wrist (Nubiola 2011, section 6.1.4, eq. 6.29).

        q5 and q4 are those of eqs. 6.30, 6.31 and 6.33; the other branch (eq. 6.32) turns all three. q6 comes from the
        rotation with the angle q4 found undone, which is eqs. 6.36, 6.37 and 6.38 at any q5 and not at the singularity
        (section 6.1.5, eq. 6.35) alone, in place of eq. 6.34: errors of q4 next to it are made good by q6.
        """
        n_r, o_r, a_r, n_t, o_t, a_t = plane
        x = -s23 * a_r - c23 * X[8]  # cos q4 sin q5
        c5 = c23 * a_r - s23 * X[8]
        s5 = np.sqrt(x * x + a_t * a_t)
        y = a_t
        singular = s5 < _ON_SINGULARITY
        if singular.any():  # q4 = 0 is as good as any
            x, y = np.where(singular, 1.0, x), np.where(singular, 0.0, y)
        r11, r12 = s23 * n_r + c23 * X[2], s23 * o_r + c23 * X[5]
        return np.arctan2(y, x), np.arctan2(s5, c5), np.arctan2(y * r11 + x * n_t, y * r12 + x * o_t)

    # ------------------------------------------------------------------ about joints

    def angles(self, joints: ArrayLike) -> FloatArray:
        """The thesis's angles q (n, ..., 6) of joint angles, radians; not reduced to a turn."""
        return (np.asarray(joints, dtype=float) - self.shifts) * self.signs

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
        q = self.angles(joints)
        q3 = q[..., 2]
        elbow = self.d4 * np.cos(q3) + self.a4 * np.sin(q3)  # forearm times sine of its angle from the upper arm
        return branch_number(self.radius(joints) < 0, elbow < 0, np.sin(q[..., 4]) < 0)

    def radius(self, joints: ArrayLike) -> FloatArray:
        """Distance of the wrist centre from axis 1, metres, negative behind it, for joints (..., 6).

        The bracket of Nubiola 2011, eq. 6.4.
        """
        q = self.angles(joints)
        q2, q23 = q[..., 1], q[..., 1] + q[..., 2]
        return self.a2 + self.a3 * np.sin(q2) + self.d4 * np.cos(q23) + self.a4 * np.sin(q23)

    def wrist_angle(self, joints: ArrayLike) -> FloatArray:
        """Angle between axes 4 and 6 as lines, radians, for joints (..., 6)."""
        q5 = self.angles(joints)[..., 4]
        return np.abs(q5 - np.pi * np.rint(q5 / np.pi))


def _refuse(
    arm: Arm, column: str, deviation: FloatArray, values: FloatArray, rows: Iterable[int], tolerance: float
) -> None:
    """Refuse the first entry of a column (counted from 0) whose deviation is beyond the tolerance or NaN."""
    right = dict.fromkeys((1, 3, 4, 5), "+-90 degrees") | {2: "0 or 180 degrees"}
    wanted = right if column == "alpha" else {}
    for i in rows:
        if not abs(deviation[i]) <= tolerance:
            angle = column in ("alpha", "beta")
            found = f"{np.degrees(values[i]):.9g} degrees" if angle else f"{1e3 * values[i]:.9g} mm"
            raise RobotError(
                f"the closed-form inverse of {arm.name} needs {column}{i + 1} = {wanted.get(i, '0')}, found {found}"
            )


def check_poses(T: ArrayLike) -> FloatArray:
    """Refuse pose arrays that are not (n, 4, 4)."""
    T = np.asarray(T, dtype=float)
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise RobotError(f"poses need shape (n, 4, 4), found {T.shape}", parameter="T_base_tip")
    return T


def is_rotation(X: FloatArray) -> BoolArray:
    """Whether the columns n, o, a in the rows 0 to 8 of X (12, n) form a rotation: a mask (n,).

    A matrix whose squares add up to 3 and whose determinant is 1 is one.
    """
    nx, ny, nz, ox, oy, oz, ax, ay, az = X[:9]
    squares = nx * nx
    for row in X[1:9]:
        squares += row * row
    determinant = ax * (ny * oz - nz * oy) + ay * (nz * ox - nx * oz) + az * (nx * oy - ny * ox)
    return (np.abs(squares - 3.0) <= ROTATION_TOLERANCE) & (np.abs(determinant - 1.0) <= ROTATION_TOLERANCE)


def _map(linear: FloatArray, columns: FloatArray) -> FloatArray:
    """The product of a small matrix and columns (k, n), in pieces too small for threads that would wait on others."""
    out = np.empty((len(linear), columns.shape[1]))
    for start in range(0, columns.shape[1], 1024):
        out[:, start : start + 1024] = linear @ columns[:, start : start + 1024]
    return out


def _shoulder(X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, list[FloatArray]]:
    """Radius of the wrist centre, cosine and sine of q1, and n, o, a along the radius and across it, for the front.

    q1 is that of Nubiola 2011, section 6.1.1, eqs. 6.5 and 6.6; behind (eq. 6.7) all signs are the other ones.
    """
    px, py = X[9], X[10]
    r = np.sqrt(px * px + py * py)
    scale = 1.0 / r
    c1, s1 = px * scale, py * scale
    on_axis = r == 0.0
    if on_axis.any():
        c1[on_axis], s1[on_axis] = 1.0, 0.0
    radial = [c1 * X[3 * k] + s1 * X[3 * k + 1] for k in range(3)]
    across = [c1 * X[3 * k + 1] - s1 * X[3 * k] for k in range(3)]
    return r, c1, s1, radial + across


def _half_turn(angle: FloatArray) -> FloatArray:
    """Angle turned by 180 degrees towards zero."""
    return angle - np.copysign(np.pi, angle)
