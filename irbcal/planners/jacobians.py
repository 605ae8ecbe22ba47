"""Jacobians of effective joints and their time derivatives, in Pinocchio's reference frames, for batches.

Of what is fixed to the tip they come from the axes along the DHM chain, without a loop over poses; of any other link
from Pinocchio, pose by pose. All are (n, 6, joints), linear above angular velocity; "world" is Pinocchio's universe.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm

if TYPE_CHECKING:
    import pinocchio as pin

    from irbcal.io.urdf_check import ArmInModel

WORLD, LOCAL, LOCAL_WORLD_ALIGNED = "WORLD", "LOCAL", "LOCAL_WORLD_ALIGNED"
"""Pinocchio's reference frames by name."""

JacobianAndRate: TypeAlias = tuple[FloatArray, FloatArray | None]
"""A Jacobian and its time derivative; no derivative without speeds."""


def along_chain(arm: Arm, T_universe_base: FloatArray, theta: FloatArray, dtheta: FloatArray | None) -> JacobianAndRate:
    """World Jacobians of an arm's last link from the axes along its DHM chain.

    Parameters
    ----------
    arm : Arm
    T_universe_base : ndarray, shape (4, 4)
    theta : ndarray, shape (n, joints)
        Effective joints, radians (metres for prismatic joints).
    dtheta : ndarray, shape (n, joints), optional
        Their speeds.

    Returns
    -------
    J : ndarray, shape (n, 6, joints)
    dJ : ndarray, shape (n, 6, joints), or None
    """
    table = arm.table
    chain = dhm.chain_frames(table, theta.T + table.offsets[:, None], T_universe_base @ arm.T_base_0)
    z, o = (np.moveaxis(axes, -1, 0) for axes in (chain.z, chain.o))
    slides = table.prismatic[:, None]
    J = np.concatenate([np.where(slides, z, np.cross(o, z)), np.where(slides, 0.0, z)], axis=2)
    if dtheta is None:
        return np.swapaxes(J, 1, 2), None
    # each axis moves with the link before it: with the sum of the twists of the joints before
    twists = np.cumsum(J * dtheta[..., None], axis=1)
    v, w = np.split(np.concatenate([np.zeros_like(twists[:, :1]), twists[:, :-1]], axis=1), 2, axis=2)
    linear = np.cross(w, J[..., :3]) + np.cross(v, J[..., 3:])
    dJ = np.concatenate([linear, np.cross(w, J[..., 3:])], axis=2)
    return np.swapaxes(J, 1, 2), np.swapaxes(dJ, 1, 2)


def by_pinocchio(
    model: pin.Model,
    arm_in_model: ArmInModel,
    frame: int,
    theta: FloatArray,
    dtheta: FloatArray | None,
    q_rest: FloatArray,
) -> JacobianAndRate:
    """World Jacobians of any link by Pinocchio, pose by pose.

    Parameters
    ----------
    model : pinocchio.Model
    arm_in_model : ArmInModel
    frame : int
        Pinocchio's number of a frame of the link.
    theta, dtheta
        See `along_chain`.
    q_rest : ndarray, shape (nq,)
        Configuration of the joints outside the arm.

    Returns
    -------
    J, dJ
        See `along_chain`.
    """
    import pinocchio as pin

    data = model.createData()
    speeds = np.zeros((len(theta), model.nv))
    if dtheta is not None:
        speeds[:, arm_in_model.columns] = dtheta
    J, dJ = np.empty((2, len(theta), 6, len(arm_in_model.joint_ids)))
    for k, configuration in enumerate(arm_in_model.configurations(theta, q_rest)):
        pin.computeJointJacobiansTimeVariation(model, data, configuration, speeds[k])
        J[k], dJ[k] = data.J[:, arm_in_model.columns], data.dJ[:, arm_in_model.columns]
    carries = set(model.supports[model.frames[frame].parentJoint])
    moves = np.array([joint in carries for joint in arm_in_model.joint_ids])
    return J * moves, None if dtheta is None else dJ * moves


def referred(world: JacobianAndRate, dtheta: FloatArray | None, T: FloatArray, reference: str) -> JacobianAndRate:
    """World Jacobians referred to another of Pinocchio's reference frames.

    Parameters
    ----------
    world : tuple
        Jacobians and their time derivatives.
    dtheta : ndarray, shape (n, joints), optional
    T : ndarray, shape (n, 4, 4)
        Place of the frame in the universe.
    reference : str
        ``WORLD``, ``LOCAL`` or ``LOCAL_WORLD_ALIGNED``.
    """
    if reference == WORLD:
        return world
    J, dJ = world
    p, R = T[:, :3, 3, None], T[:, :3, :3]
    linear, angular = J[:, :3], J[:, 3:]
    moved = np.concatenate([linear + np.cross(angular, p, axis=1), angular], axis=1)
    turned = None
    if dJ is not None and dtheta is not None:
        v, w = np.split(np.einsum("nij,nj->ni", moved, dtheta)[..., None], 2, axis=1)
        d_angular = dJ[:, 3:]
        d_linear = dJ[:, :3] + np.cross(d_angular, p, axis=1) + np.cross(angular, v, axis=1)
        turned = np.concatenate([d_linear, d_angular], axis=1)
        if reference == LOCAL:
            turned = _by_blocks(R, turned - np.concatenate([np.cross(w, block, axis=1) for block in _halves(moved)], 1))
    return (_by_blocks(R, moved) if reference == LOCAL else moved), turned


def _halves(J: FloatArray) -> tuple[FloatArray, FloatArray]:
    return J[:, :3], J[:, 3:]


def _by_blocks(R: FloatArray, J: FloatArray) -> FloatArray:
    """Linear and angular part along the axes R."""
    return np.concatenate([np.swapaxes(R, 1, 2) @ block for block in _halves(J)], axis=1)
