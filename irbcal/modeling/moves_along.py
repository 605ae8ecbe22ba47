r"""Last moves along a trajectory: to which side each joint leans while it moves.

At a stop the last move is the way from the stop before. Along a path the arm does not stop, and a joint leans to the
side that it came from lately. The side ``z`` of a term of direction with width ``w`` is taken up on the joint's own
way; the move ``D``, for the terms of its length and share, on that of the joint that goes farthest in its strides
``s_i`` (`STRIDE`)::

    dz/dt = (dq/dt - |dq/dt| z) / w          dD/dt = dq/dt - N D,   N = max_i |dq_i/dt| / s_i

In a steady motion ``z`` settles at the sign of the joint's speed, as for a stop that is far from the one before, and
``D`` at ``dq/dt / N``, the direction of motion with the length of a stride. While the arm rests they stay, so that the
end of a path is a stop. Where a joint turns back, ``z`` passes to the other side within the width, without a jump of
command or speed. Both follow the path, whatever the time that it takes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import RobotError
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.trajectory import ReversalOffset, Trajectory
from irbcal.units import DEG

STRIDE = {True: 0.05, False: 5 * DEG}
"""Length of the move that stands for what came before a point of a path, metres (prismatic joints) or radians."""
FEWEST_STEPS = 2
"""Steps between two points, and more where the way between them is long."""
LONGEST = 0.1 * DEG / STRIDE[False]
"""Share of a stride that a step is long, at most."""
POWER, LEAST = 16, 0.5 * DEG
"""The longest move of all joints, for their shares of it, is this norm of all of them and of a least one: smooth."""

_Signal = tuple[FloatArray, FloatArray, FloatArray]
"""A function of time and its first two derivatives."""


def strides(prismatic: BoolArray) -> FloatArray:
    """`STRIDE` of each joint, shape (joints,)."""
    return np.array([STRIDE[bool(slides)] for slides in prismatic])


def lean_along(joint_map: JointMap, trajectory: Trajectory, previous: ArrayLike | None = None) -> ReversalOffset | None:
    """What the last moves along a trajectory add to the effective joints.

    Parameters
    ----------
    joint_map : JointMap
    trajectory : Trajectory
        Commands or configurations: the joints' directions are the same.
    previous : array_like, shape (joints,), optional
        The stop before its first point. Not known unless given: a trajectory that starts from rest has no move there,
        one that starts in motion the steady one.

    Returns
    -------
    ReversalOffset or None
        None for maps that do not depend on last moves.

    Raises
    ------
    RobotError
        If ``previous`` has another shape.
    """
    if not joint_map.has_history:
        return None
    d = trajectory.with_derivatives()
    assert d.dq is not None
    stride = strides(trajectory.slides)
    first = d.dq[0] / (np.abs(d.dq[0] / stride).max() or 1.0)
    if previous is not None:
        q_before = np.asarray(previous, dtype=float)
        if q_before.shape != stride.shape:
            raise RobotError(
                f"previous: expected {len(stride)} joints, found shape {q_before.shape}", parameter="previous"
            )
        first = trajectory.q[0] - q_before if np.isfinite(q_before).all() else first
    way = np.abs(np.diff(trajectory.q, axis=0) / stride).max(initial=0.0)
    steps = FEWEST_STEPS + int(np.ceil(way / LONGEST))
    fine = trajectory.pieces(trajectory.times_between(steps)) if len(trajectory) > 1 else trajectory.q
    move = _faded(np.diff(fine, axis=0), stride, first)[::steps]
    lean: list[FloatArray] = [np.zeros(trajectory.q.shape) for _ in range(3)]
    longest = _move(d, move, stride)
    share = _share(longest)
    for term, coefficient in zip(joint_map.history.terms, joint_map.history.coefficients, strict=True):
        j = term.joint
        if term.basis == "direction":
            width = float(str(term.parameters.get("width_rad", term.parameters.get("width_m"))))
            signal = _side(d, j, fine[:, j], steps, width, first[j])
        else:
            all_joints = share if term.basis == "share_of_move" else longest
            signal = all_joints[0][:, j], all_joints[1][:, j], all_joints[2][:, j]
        for joint in (j, *term.also):
            for total, added in zip(lean, signal, strict=True):
                total[:, joint] += coefficient * added
    return ReversalOffset(*lean)


def _side(d: Trajectory, j: int, fine: FloatArray, steps: int, width: float, first: float) -> _Signal:
    """The side that joint ``j`` leans to, from its values at all steps ``fine``, each of shape (n,)."""
    assert d.dq is not None
    assert d.ddq is not None
    v, a = d.dq[:, j], d.ddq[:, j]
    step = np.diff(fine)
    z = _relaxed(np.sign(step), np.abs(step) / width, np.tanh(first / width))[::steps]
    rate = (v - np.abs(v) * z) / width
    second = (a - np.sign(v) * a * z - np.abs(v) * rate) / width
    return z, rate, second


def _faded(step: FloatArray, stride: FloatArray, first: FloatArray) -> FloatArray:
    """Moves (m + 1, joints) along steps (m, joints)."""
    size = np.abs(step / stride).max(axis=1, initial=0.0)
    towards = step / np.where(size > 0.0, size, 1.0)[:, None]
    return np.column_stack([_relaxed(t, size, f) for t, f in zip(towards.T, first, strict=True)])


def _relaxed(towards: FloatArray, decay: FloatArray, first: float) -> FloatArray:
    """``z <- towards + (z - towards) exp(-way)``, step by step: (m + 1,) from (m,)."""
    fade, out = np.exp(-decay).tolist(), [float(first)]
    for aim, keep in zip(towards.tolist(), fade, strict=True):
        out.append(aim + (out[-1] - aim) * keep)
    return np.array(out)


def _move(d: Trajectory, move: FloatArray, stride: FloatArray) -> _Signal:
    """The move with its derivatives, each of shape (n, joints)."""
    assert d.dq is not None
    assert d.ddq is not None
    speed, rows = np.abs(d.dq / stride), np.arange(len(move))
    fastest = speed.argmax(axis=1)
    N, dN = speed[rows, fastest][:, None], (np.sign(d.dq) * d.ddq / stride)[rows, fastest][:, None]
    rate = d.dq - N * move
    return move, rate, d.ddq - dN * move - N * rate


def _share(move: _Signal) -> _Signal:
    """Each joint's share of the longest move."""
    D, D_1, D_2 = move
    largest = np.maximum(np.abs(D).max(axis=1, keepdims=True), LEAST)
    R = largest * (((D / largest) ** POWER).sum(axis=1, keepdims=True) + (LEAST / largest) ** POWER) ** (1.0 / POWER)
    u = D / R
    R_1 = (u ** (POWER - 1) * D_1).sum(axis=1, keepdims=True)
    R_2 = (POWER - 1) / R * ((u ** (POWER - 2) * D_1**2).sum(axis=1, keepdims=True) - R_1**2)
    R_2 = R_2 + (u ** (POWER - 1) * D_2).sum(axis=1, keepdims=True)
    return u, (D_1 - u * R_1) / R, (D_2 - 2.0 * R_1 * (D_1 - u * R_1) / R - u * R_2) / R


def to_effective(joint_map: JointMap, commands: Trajectory) -> Trajectory:
    """Effective joints of a trajectory of commands, speeds and accelerations by the chain rule.

    Parameters
    ----------
    joint_map : JointMap
    commands : Trajectory
        With what its last moves add, where the map depends on them.

    Returns
    -------
    Trajectory
        With what of speeds and accelerations the commands have, and the same last moves.
    """
    q, dq, ddq = commands.q, commands.dq, commands.ddq
    lean = commands.lean or ReversalOffset(*np.zeros((3, *q.shape)))
    theta = joint_map.effective_unchecked(q) + lean.lean
    dtheta = ddtheta = None
    if dq is not None:
        M = joint_map.jacobian(q)
        dtheta = np.einsum("nij,nj->ni", M, dq) + lean.rate
        if ddq is not None:
            dM = joint_map.jacobian_derivative(q, dq)
            ddtheta = np.einsum("nij,nj->ni", M, ddq) + np.einsum("nij,nj->ni", dM, dq) + lean.second
    return replace(commands, q=theta, dq=dtheta, ddq=ddtheta)


def to_commands(joint_map: JointMap, effective: Trajectory) -> Trajectory:
    """Commands of a trajectory of effective joints: the inverse of `to_effective`."""
    lean = effective.lean or ReversalOffset(*np.zeros((3, *effective.q.shape)))
    q = joint_map.commanded_unchecked(effective.q - lean.lean)
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    if effective.dq is not None:
        M = joint_map.jacobian(q)
        speed = np.linalg.solve(M, (effective.dq - lean.rate)[..., None])[..., 0]
        dq = np.asarray(speed, dtype=float)
        if effective.ddq is not None:
            bent = np.einsum("nij,nj->ni", joint_map.jacobian_derivative(q, dq), dq)
            ddq = np.linalg.solve(M, (effective.ddq - lean.second - bent)[..., None])[..., 0]
    return replace(effective, q=q, dq=dq, ddq=ddq)
