"""Gravity torques of an arm and its payload for batches of poses.

A torque is the derivative of the potential energy by its joint (what Pinocchio calls the generalised gravity): with the
mass M beyond joint j and the height of its centre P, ``g_j = 9.81 M (z_j x (P - o_j)) . up`` for a revolute joint and
``9.81 M z_j . up`` for a prismatic one. All poses are walked at once, in blocks, along the chain's frames.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.simulation.masses import Bodies

GRAVITY = 9.81
"""Metres per second squared, along -z of the base link."""


def torques_and_origins(arm: Arm, bodies: Bodies, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gravity torques, and where the joints are.

    Parameters
    ----------
    arm : Arm
    bodies : Bodies
    theta : ndarray, shape (n, joints)
        Effective joints, radians (metres for prismatic joints).

    Returns
    -------
    torque : ndarray, shape (n, joints)
        Derivative of the potential energy by each joint, newton metres (newtons for prismatic joints).
    origins : ndarray, shape (n, joints + 1, 3)
        Origins of the base link and of the DHM frames in the base link, metres.
    """
    n, joints = theta.shape
    torque, origins = np.empty((n, joints)), np.zeros((n, joints + 1, 3))
    for start in range(0, n, dhm.BLOCK):
        block = slice(start, min(start + dhm.BLOCK, n))
        angles = np.ascontiguousarray(theta[block].T) + arm.table.offsets[:, None]
        chain = dhm.chain_frames(arm.table, angles, arm.T_base_0)
        torque[block] = _torques(arm.table.prismatic, bodies, chain)
        origins[block, 1:] = chain.o.transpose(2, 0, 1)
    return torque, origins


def frame_torques(arm: Arm, bodies: Bodies, theta: FloatArray) -> FloatArray:
    """Gravity torques about the two axes of each joint's frame that it does not turn about, before it turns.

    Parameters
    ----------
    arm : Arm
    bodies : Bodies
    theta : ndarray, shape (n, joints)

    Returns
    -------
    ndarray, shape (n, joints, 2)
        Derivative of the potential energy by turns about x and y, newton metres.
    """
    out = np.empty((*theta.shape, 2))
    for start in range(0, len(theta), dhm.BLOCK):
        block = slice(start, min(start + dhm.BLOCK, len(theta)))
        chain = dhm.chain_frames(arm.table, arm.table.offsets[:, None] + theta[block].T, arm.T_base_0)
        travel = arm.table.d[:, None] + np.where(arm.table.prismatic[:, None], theta[block].T, 0.0)
        for j, mass, moment in _carried(bodies, chain):
            y, z = chain.y_tilt[j], chain.z[j]
            x = np.cross(y, z, axis=0)
            lever = moment - mass * (chain.o[j, :2] - travel[j] * z[:2])
            for k, axis in enumerate((x, y)):
                out[block, j, k] = GRAVITY * (axis[0] * lever[1] - axis[1] * lever[0])
    return out


def _torques(prismatic: BoolArray, bodies: Bodies, chain: dhm.ChainFrames) -> FloatArray:
    """Torques of one block, shape (n, joints)."""
    joints, _, n = chain.z.shape
    torque = np.empty((n, joints))
    for j, mass, moment in _carried(bodies, chain):
        z, o = chain.z[j], chain.o[j]
        if prismatic[j]:
            torque[:, j] = GRAVITY * mass * z[2]
        else:
            torque[:, j] = GRAVITY * (z[0] * (moment[1] - mass * o[1]) - z[1] * (moment[0] - mass * o[0]))
    return torque


def _carried(bodies: Bodies, chain: dhm.ChainFrames) -> Iterator[tuple[int, float, FloatArray]]:
    """Each joint from the last to the first, the mass it carries and that mass's first moment (2, n): x and y."""
    joints, _, n = chain.z.shape
    mass, moment = 0.0, np.zeros((2, n))  # up is z: heights only change with x and y of the lever
    for j in range(joints - 1, -1, -1):
        x = chain.x_before[j + 1] if j + 1 < joints else chain.tip[0]
        z, o, c = chain.z[j], chain.o[j], bodies.centre[j]
        y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2]]
        mass += bodies.mass[j]
        for k in range(2):
            moment[k] += bodies.mass[j] * (o[k] + c[0] * x[k] + c[1] * y[k] + c[2] * z[k])
        yield j, mass, moment
