"""Commanded poses as measurements: programmed joints out of the poses that a controller was sent to.

A controller that is sent to a pose computes the joints by its (nominal) inverse. Commanded poses ``G`` and joint
readings ``q`` belong together by two constant transforms, of the tool and of the frame in which the controller
counts: ``G = T_w_b N(q) T_f_t`` but for what the readings differ by from the programmed joints. With both transforms
the nominal inverse nearest to the readings gives the programmed joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, Locked
from irbcal.errors import MeasurementError
from irbcal.measurement.table import GOAL_ANGLES, GOAL_POSITIONS, GOAL_QUATERNION, MeasurementSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import chain
from irbcal.units import DEG, MM

LARGEST_MISFIT = 5.0 * MM
"""Median distance of commanded poses from the readings' above which they do not belong together."""
LARGEST_CHANGE = 1.0 * DEG, 10.0 * MM
"""Of a joint, from reading to command: what is farther away is another solution, or another pose."""
MOST_STEPS, SOLVED, LARGEST_STEP = 12, 1e-9, 0.05
DAMPING = 1e-10
SINGULAR_VALUE_HALF_WAY = 0.03
"""Singular value of the Jacobian (metres and radians) along whose direction half of the way from reading to command is
taken: near a singularity a pose hardly tells the joints."""
SHARES = (0.0, 0.5, 1.0)
"""Shares of the way from readings to commands whose evidence is computed; a parabola gives the best one."""
LEAST, LEAST_GAIN = 0.05, 3.0
"""A smaller share of the commands is none, and one that raises the log evidence by less than that is not taken."""


@dataclass(frozen=True, eq=False)
class Commands(Locked):
    """What commanded poses say of the joints."""

    T_world_base: FloatArray
    T_flange_tool: FloatArray
    """Shape (4, 4). Constant transforms of the controller, metres."""
    misfit: float
    """Median distance of commanded from read poses, metres."""
    difference: FloatArray
    """Shape (n, joints). Programmed minus read joints, radians (metres); zero where they are not known."""
    solved: BoolArray
    """Shape (n,)."""


def goals(measurements: MeasurementSet) -> FloatArray | None:
    """Commanded poses (n, 4, 4), metres, NaN where a pose has none; None where the file has none.

    Raises
    ------
    MeasurementError
        If columns are missing, or a quaternion is none.
    """
    present = [name for name in measurements.cells.columns if name.startswith("goal_")]
    if not present:
        return None
    turns = next((names for names in (GOAL_QUATERNION, *GOAL_ANGLES) if names[0] in present), GOAL_ANGLES[0])
    columns = next((names for names in GOAL_POSITIONS if names[0] in present), GOAL_POSITIONS[0])
    missing = [name for name in (*columns, *turns) if name not in present]
    if missing:
        raise MeasurementError(
            f"a commanded pose has {', '.join(columns)} and {', '.join(turns)}: {missing[0]} is missing",
            file=measurements.source,
            row=1,
        )
    first = measurements.table.groupby("pose_index", sort=True)[["row", *columns, *turns]].first()
    unit = MM if columns is GOAL_POSITIONS[0] else 1.0
    xyz, turn = first[list(columns)].to_numpy(dtype=float) * unit, first[list(turns)].to_numpy(dtype=float)
    if turns is GOAL_QUATERNION:
        length = np.linalg.norm(turn, axis=1)
        bad = np.flatnonzero(np.abs(np.nan_to_num(length, nan=1.0) - 1.0) > 1e-3)
        if len(bad):
            raise MeasurementError(
                f"expected a unit quaternion, found one of length {length[bad[0]]:.4g}",
                file=measurements.source,
                row=int(first["row"].iloc[bad[0]]),
                column=turns[0],
            )
        R = frames.matrix_from_quaternion(turn / length[:, None])
    else:
        angles = np.nan_to_num(turn) * (DEG if turns[0].endswith("_deg") else 1.0)
        R = np.array([frames.matrix_from_rpy(each) for each in angles]).reshape(-1, 3, 3)
    out = np.tile(np.eye(4), (len(xyz), 1, 1))
    out[:, :3, :3], out[:, :3, 3] = R, xyz
    out[~(np.isfinite(xyz).all(axis=1) & np.isfinite(turn).all(axis=1))] = np.nan
    return out


def commands(arm: Arm, q: FloatArray, goal: FloatArray, previous_commands: Commands | None = None) -> Commands | None:
    """Programmed joints from commanded poses.

    Parameters
    ----------
    arm : Arm
        With which the controller computes: the nominal one.
    q : ndarray, shape (n, joints)
        Readings, radians (metres).
    goal : ndarray, shape (n, 4, 4)
        NaN where there is none.
    previous_commands : Commands, optional
        Whose constant transforms are taken.

    Returns
    -------
    Commands or None
        None where turns of the flange are too alike to show the transforms.
    """
    has: BoolArray = np.asarray(np.isfinite(goal).all(axis=(1, 2)))
    T = arm.forward(q)
    if previous_commands is None:
        rotations = frames.hand_eye(T[has, :3, :3], goal[has, :3, :3]) if has.any() else None
        if rotations is None:
            return None
        A, F = rotations  # R A = F G
        columns = np.concatenate([T[has, :3, :3], -np.tile(np.eye(3), (int(has.sum()), 1, 1))], axis=2).reshape(-1, 6)
        rest = (goal[has, :3, 3] @ F.T - T[has, :3, 3]).ravel()
        x = np.linalg.lstsq(columns, rest, rcond=None)[0]
        T_tool, T_base = frames.transform(A, x[:3]), frames.transform(F, x[3:])
    else:
        T_tool, T_base = previous_commands.T_flange_tool, frames.inverse(previous_commands.T_world_base)
    goal_poses = np.where(has[:, None, None], T_base @ np.nan_to_num(goal) @ frames.inverse(T_tool), T)
    apart = np.asarray(goal_poses - T)[has, :3, 3]
    misfit = float(np.median(np.linalg.norm(apart, axis=1))) if has.any() else np.inf
    joints, error, J = q.copy(), np.zeros((len(q), 6)), np.zeros((len(q), 6, q.shape[1]))
    for _ in range(MOST_STEPS):
        path = chain.walk(arm, joints)
        at = chain.poses(path)
        turn = frames.vector_from_rotation(goal_poses[:, :3, :3] @ at[:, :3, :3].transpose(0, 2, 1))
        error = np.concatenate([goal_poses[:, :3, 3] - at[:, :3, 3], turn], axis=1)
        J = np.concatenate([chain.by_joints(path, arm, at[:, :3, 3].T), chain.by_joints(path, arm)], axis=1).T
        if np.abs(error).max(initial=0.0) < SOLVED:
            break
        H = J.transpose(0, 2, 1) @ J + DAMPING * np.eye(q.shape[1])
        step = np.linalg.solve(H, J.transpose(0, 2, 1) @ error[..., None])[..., 0]
        joints = joints + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
    largest = np.where(arm.table.prismatic, LARGEST_CHANGE[1], LARGEST_CHANGE[0])
    value, V = np.linalg.eigh(J.transpose(0, 2, 1) @ J)
    shown = (V * (value / (value + SINGULAR_VALUE_HALF_WAY**2))[:, None]) @ V.transpose(0, 2, 1)
    difference = np.einsum("nij,nj->ni", shown, joints - q)
    solved = has & (np.abs(error).max(axis=1) < 1e3 * SOLVED) & (np.abs(difference) < largest).all(axis=1)
    return Commands(frames.inverse(T_base), T_tool, misfit, np.where(solved[:, None], difference, 0.0), solved)


def best_share(evidence: FloatArray) -> float:
    """The share in 0 to 1 of highest evidence, by a parabola through those of `SHARES`."""
    a, b, _ = np.polyfit(SHARES, evidence, 2)
    best = -b / (2.0 * a) if a < 0.0 else SHARES[int(np.argmax(evidence))]
    return float(np.clip(best, 0.0, 1.0))
