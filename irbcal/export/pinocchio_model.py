"""Pinocchio as the independent witness of forward kinematics."""

import numpy as np

from irbcal.errors import CalibrationError
from irbcal.modeling.arm import relative_difference

CHECK_POSES = 10_000
LIMIT = 1e-9
"""Largest disagreement (metres, radians) with which a written URDF is accepted."""


def poses(urdf_bytes, arm, q):
    """Tip poses in the base link as Pinocchio computes them from a URDF.

    Parameters
    ----------
    urdf_bytes : bytes
        Content of the URDF.
    arm : Arm
        Names of the joints, base and tip.
    q : ndarray, shape (n, 6)
        Model joint angles (effective, not commanded), radians.

    Returns
    -------
    ndarray, shape (n, 4, 4)
    """
    import pinocchio as pin

    model = pin.buildModelFromXML(urdf_bytes.decode("utf-8"))
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in arm.joint_names]
    base, tip = model.getFrameId(arm.base_link), model.getFrameId(arm.tip_link)
    configurations = np.tile(pin.neutral(model), (len(q), 1))
    for joint, angle in zip(joints, np.asarray(q).T, strict=True):
        if joint.nq == 1:
            configurations[:, joint.idx_q] = angle
        else:  # continuous joints are (cos, sin) in Pinocchio
            configurations[:, joint.idx_q] = np.cos(angle)
            configurations[:, joint.idx_q + 1] = np.sin(angle)
    out = np.empty((len(q), 4, 4))
    for k, configuration in enumerate(configurations):
        pin.framesForwardKinematics(model, data, configuration)
        out[k] = data.oMf[base].actInv(data.oMf[tip]).homogeneous
    return out


def check(urdf_bytes, arm, seed=0, n=CHECK_POSES):
    """Compare an arm's forward kinematics with Pinocchio's on a URDF, at random poses inside the limits.

    Returns
    -------
    dict
        ``position_m``, ``rotation_rad``: largest differences; ``poses``: how many were compared.

    Raises
    ------
    CalibrationError
        If a difference is above 1e-9 m or 1e-9 rad: the URDF does not describe the calibrated arm.
    """
    q = arm.random_joints(n, seed)
    try:
        by_pinocchio = poses(urdf_bytes, arm, q)
    except (ValueError, RuntimeError) as error:
        raise CalibrationError(f"Pinocchio cannot read this robot's URDF: {' '.join(str(error).split())}") from None
    position, rotation = relative_difference(by_pinocchio, arm.forward(q))
    if not max(position, rotation) <= LIMIT:
        raise CalibrationError(
            f"Pinocchio disagrees with the calibrated robot by {position:.2g} m and {rotation:.2g} rad "
            f"(at most {LIMIT:g} is accepted): the URDF was not written"
        )
    return {"position_m": float(position), "rotation_rad": float(rotation), "poses": n}
