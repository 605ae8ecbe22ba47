"""Damped Newton steps (Levenberg-Marquardt) from joints to poses of a calibrated robot, for batches.

The Jacobian is the geometric one of the calibrated arm times that of the joint map; what frame terms change with the
joints is left out of it, which costs a step or two. Poses are held as columns x, y, z
and origin in arrays of shape (4, 3, n), joints as (joints, n).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.inverse.poses import pose_columns
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.chain import Walk
from irbcal.modeling.terms.situation import Motion

WEAK = 1e-5
"""Damping that leaves the directions of a singularity as they are, whose singular values have squares far below it."""

SMALLEST = 1e-20
"""Damping that there is always: below what rounding leaves of squares of singular values."""

ROUNDING = 1e-4
"""Radians (metres) beyond a limit up to which a solution is looked for at the limit: where two solutions meet, that
moves the tip by less than the tolerance."""

LONGEST_STEP = 0.5
"""Radians (or metres) that a step may move a joint."""


class CalibratedChain:
    """Forward kinematics and Jacobian of a calibrated robot for columns.

    Parameters
    ----------
    robot : Robot
    reach : float
        Metres: the length by which position errors are divided to weigh them against radians.
    """

    def __init__(self, robot: Robot, reach: float) -> None:
        self.robot, self.reach, self.kernel = robot, reach, robot.kernel

    def tip(self, q: FloatArray) -> FloatArray:
        """Columns (4, 3, n) of ``T_base_tip`` for commanded joints (joints, n)."""
        return pose_columns(self.robot.forward(q.T))

    def merit(self, position: FloatArray, rotation: FloatArray) -> FloatArray:
        """Position error (m) and rotation error (rad) of `errors` as one number, the first over `reach`."""
        return position / self.reach + rotation

    def linearised(self, H: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What a step needs.

        Parameters
        ----------
        H : ndarray, shape (4, 3, n)
            Target columns.
        q : ndarray, shape (joints, n)
            Commanded joints, radians (metres for prismatic joints).

        Returns
        -------
        J : ndarray, shape (n, 6, joints)
            Derivative of position (over the reach) and rotation by the commanded joints, base frame.
        e : ndarray, shape (n, 6)
            What position (over the reach) and rotation lack.
        cost : ndarray, shape (n,)
            Square of e.
        errors : ndarray, shape (2, n)
            Metres and radians, as `errors`.
        """
        arm, n = self.robot.arm, q.shape[1]
        chain: dhm.ChainFrames | Walk
        if self.robot.frame_terms is None:
            theta = self.robot.joint_map.effective_unchecked(q.T).T + arm.table.offsets[:, None]
            chain = dhm.chain_frames(arm.table, theta, arm.T_base_0, arm.T_last_tip)
        else:
            chain = self.robot.walk(Motion(q.T))
        tip, (zx, zy, zz) = chain.tip, chain.z.swapaxes(0, 1)
        lx, ly, lz = (tip[3] - chain.o).swapaxes(0, 1) / self.reach
        J, e = np.empty((n, 6, len(q))), np.empty((n, 6))
        for i, row in enumerate((zy * lz - zz * ly, zz * lx - zx * lz, zx * ly - zy * lx, zx, zy, zz)):
            J[:, i] = row.T
        slides = arm.table.prismatic
        if slides.any():
            J[:, :3, slides] = chain.z[slides].transpose(2, 1, 0) / self.reach
            J[:, 3:, slides] = 0.0
        if not self.robot.joint_map.is_identity:
            J = J @ self.robot.joint_map.jacobian_unchecked(q.T)
        e[:, :3] = (H[3] - tip[3]).T / self.reach
        e[:, 3:] = rotation_vector(tip, H).T
        return J, e, (e * e).sum(axis=1), np.array(errors(tip, H))


def solve(
    chain: CalibratedChain,
    H: FloatArray,
    q: FloatArray,
    tolerance: tuple[float, float],
    straighten: int = 0,
    patience: int = 10,
    limits: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Levenberg-Marquardt from given joints.

    Next to a singularity the joints that leave the pose nearly unchanged lie on a curve along which
    straight steps only crawl: ``straighten`` times, the step is corrected across it, so that it follows the curve.

    Parameters
    ----------
    chain : CalibratedChain
    H : ndarray, shape (4, 3, n)
        Target columns.
    q : ndarray, shape (joints, n)
        Commanded joints to start from, radians (metres for prismatic joints).
    tolerance : tuple of float
        Errors of position and rotation, metres and radians, that are good enough.
    straighten : int
        Corrections of a step.
    patience : int
        Steps are given up when so many of them have not halved the error.
    limits : pair of ndarray, shape (joints,), optional
        Lower and upper limits within which the joints stay; the start is within them.

    Returns
    -------
    q : ndarray, shape (joints, n)
    position, rotation : ndarray, shape (n,)
        Errors left, metres and radians.
    evaluations : ndarray of int, shape (n,)
    """
    n = q.shape[1]
    if chain.kernel is not None:
        T, q_rows, result = np.zeros((n, 4, 4)), q.T.copy(), np.empty((n, 3))
        T[:, :3] = H.transpose(2, 1, 0)
        bounds = None if limits is None else np.array(limits, dtype=float)
        if chain.kernel.newton(T, q_rows, chain.reach, *tolerance, straighten, patience, bounds, result):
            return np.ascontiguousarray(q_rows.T), result[:, 0].copy(), result[:, 1].copy(), result[:, 2].astype(int)
    out_q, out_errors, evaluations = q.copy(), np.empty((2, n)), np.ones(n, dtype=int)
    index = np.arange(n)
    damping, bound, waited = np.full(n, 1e-6), np.full(n, np.inf), np.zeros(n, dtype=int)
    J, e, cost, errors = chain.linearised(H, q)
    out_errors[:] = errors
    for _ in range(6 * patience):
        halved = cost <= 0.25 * bound  # cost is the square of the error
        bound, waited = np.where(halved, cost, bound), np.where(halved, 0, waited + 1)
        go = ~((errors[0] <= tolerance[0]) & (errors[1] <= tolerance[1])) & (waited <= patience) & np.isfinite(cost)
        if not go.any():
            break
        if not go.all():
            J, e = J[go], e[go]
            running: list[NDArray[Any]] = [v[..., go] for v in (index, q, H, cost, errors, damping, bound, waited)]
            index, q, H, cost, errors, damping, bound, waited = running
        trial, J_new, e_new, weight = q, J, e, damping * np.minimum(np.sqrt(cost), 1.0) + SMALLEST
        for k in range(1 + straighten):
            free = J_new if limits is None else _free(J_new, e_new, trial, *limits)
            trial = trial + _step(free, e_new, WEAK if k else weight)
            if limits is not None:
                trial = np.clip(trial, limits[0][:, None], limits[1][:, None])
            J_new, e_new, cost_new, left_new = chain.linearised(H, trial)
        evaluations[index] += 1 + straighten
        better = cost_new < cost
        damping = np.where(better, np.maximum(damping * 0.2, 1e-8), np.minimum(damping * 8.0 + 1e-6, 1e8))
        q, errors = np.where(better, trial, q), np.where(better, left_new, errors)
        cost = np.where(better, cost_new, cost)
        J, e = np.where(better[:, None, None], J_new, J), np.where(better[:, None], e_new, e)
        out_q[:, index], out_errors[:, index] = q, errors
    return out_q, out_errors[0], out_errors[1], evaluations


def _step(J: FloatArray, e: FloatArray, damping: FloatArray | float) -> FloatArray:
    """Damped least-squares step (k, n) for J (n, 6, k) and e (n, 6), at most `LONGEST_STEP` for a joint.

    By an orthogonal basis: products of slopes would lose what two singularities at once leave of them.
    """
    n, rows, k = J.shape
    A, b = np.zeros((n, rows + k, k)), np.zeros((n, rows + k, 1))
    A[:, :rows], b[:, :rows, 0] = J, e
    A[:, range(rows, rows + k), range(k)] = np.sqrt(np.reshape(damping, (-1, 1)))
    Q, R = np.linalg.qr(A)
    step = np.linalg.solve(R, Q.swapaxes(1, 2) @ b)[:, :, 0].T
    return step * (LONGEST_STEP / np.maximum(np.abs(step).max(axis=0), LONGEST_STEP))


def _free(J: FloatArray, e: FloatArray, q: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """J (n, 6, k) without the columns of joints at a limit that less error would lead beyond it."""
    slope = (J * e[:, :, None]).sum(axis=1)
    stuck = ((lower >= q.T) & (slope < 0)) | ((upper <= q.T) & (slope > 0))
    return np.where(stuck[:, None], 0.0, J)


def into_limits(
    chain: CalibratedChain, nominal: Arm, H: FloatArray, q: FloatArray, near: FloatArray | None
) -> tuple[BoolArray, FloatArray, FloatArray, IntArray]:
    """Solutions beyond a limit, brought back by whole turns and by what the tolerance leaves open.

    Joint gains tell one turn from another, and a joint at its limit is known to all digits only where the pose is
    reached to all digits: both by more steps.

    Parameters
    ----------
    chain : CalibratedChain
    nominal : Arm
        Whose limits hold.
    H : ndarray, shape (4, 3, n)
        Target columns.
    q : ndarray, shape (joints, n)
    near : ndarray, shape (joints, n), optional
        As for `closed_form.into_limits`.

    Returns
    -------
    fits : ndarray of bool, shape (n,)
        Whether there are such joints.
    q : ndarray, shape (joints, m)
        Of the m that fit; within the limits.
    errors : ndarray, shape (2, m)
        Metres and radians, as `errors`.
    evaluations : ndarray of int, shape (m,)
    """
    turned, fits = closed_form.into_limits(nominal, q.T, None if near is None else near.T, ROUNDING)
    H = H[:, :, fits]
    q, _, _, evaluations = solve(chain, H, turned[fits].T.copy(), (0.0, 0.0), patience=3)
    np.clip(q, nominal.lower[:, None], nominal.upper[:, None], out=q)
    return fits, q, np.array(errors(chain.tip(q), H)), evaluations


# ------------------------------------------------------------------ poses as columns (4, 3, n)


def errors(tip: FloatArray, H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance of the origins and angle of the relative rotation of columns (4, 3, n), metres and radians.

    The two parts of Nubiola 2011, eq. 6.41 (`CalibratedChain.merit` adds them up). The distance is taken between the
    origins, not from the transformation error of eq. 6.42, whose translation depends on where the base is; and the
    angle from the chord between the axes, since an inverse cosine would lose half the digits of small angles.
    """
    squares = (tip - H) ** 2
    chord = np.sqrt(0.125 * squares[:3].sum(axis=(0, 1)))  # sine of half the angle
    return np.sqrt(squares[3].sum(axis=0)), 2.0 * np.arcsin(np.minimum(chord, 1.0))


def rotation_vector(tip: FloatArray, H: FloatArray) -> FloatArray:
    """Rotation vector (3, n) in the base frame that turns the tip's axes into those of H, radians."""
    # the cross products of the axes add up to 2 sin(angle) times the axis
    v = 0.5 * np.add.reduce([np.cross(tip[k], H[k], axis=0) for k in range(3)])
    sine = np.sqrt((v * v).sum(axis=0))
    cosine = 0.5 * ((tip[:3] * H[:3]).sum(axis=(0, 1)) - 1.0)
    return v * np.where(sine > 1e-12, np.arctan2(sine, cosine) / np.maximum(sine, 1e-300), 1.0)


def moved(H: FloatArray, turn: FloatArray, shift: FloatArray) -> FloatArray:
    """Columns (4, 3, n) turned by rotation vectors (3, n) about their origin and shifted by metres (3, n)."""
    angle = np.sqrt((turn * turn).sum(axis=0))
    axis = turn / np.maximum(angle, 1e-300)
    out = np.empty_like(H)
    for k in range(3):
        v = H[k]
        out[k] = v + np.sin(angle) * np.cross(axis, v, axis=0)
        out[k] += (1.0 - np.cos(angle)) * (axis * (axis * v).sum(axis=0) - v)
    out[3] = H[3] + shift
    return out
