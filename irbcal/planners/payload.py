"""Another payload on a calibrated arm: from the masses in a URDF to the joint map (Nubiola 2011, section 5.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import AnyJointMap, JointMap, Stiffness

if TYPE_CHECKING:
    import pinocchio as pin

    from irbcal.files.urdf_check import ArmInModel


def with_payload(
    joint_map: AnyJointMap,
    arm: Arm,
    model: pin.Model,
    arm_in_model: ArmInModel,
    rest: FloatArray,
    delta_kg: float,
    place: ArrayLike | None = None,
    wrist: ArrayLike | None = None,
    masses: tuple[float, float] | None = None,
) -> JointMap:
    """The joint map with more (or less) mass on the tool than when the robot was measured.

    Parameters
    ----------
    joint_map : JointMap
        Of one of the thesis's levels.
    arm : Arm
        The calibrated arm.
    model : pinocchio.Model
        With the bodies of the URDF.
    arm_in_model : ArmInModel
    rest : ndarray, shape (nq,)
        Configuration of the joints outside the arm.
    delta_kg, place, wrist, masses
        See `irbcal.planners.calibrated_model.CalibratedModel.with_payload`.

    Returns
    -------
    JointMap

    Raises
    ------
    RobotError
        If the arm has not six revolute joints, the joint map is not the thesis's or has no stiffness, or the URDF
        no masses.
    """
    import pinocchio as pin

    joint_map = _of_the_thesis(joint_map)
    if not arm.six_revolute:
        raise RobotError(f"the arm-stiffness model is for six revolute joints, {arm.name} has others")
    theta = np.zeros(6)
    if wrist is not None:
        theta[3:] = wrist
    data = model.createData()
    pin.framesForwardKinematics(model, data, arm_in_model.configurations(theta[None], rest)[0])
    pin.centerOfMass(model, data)
    second, third, fifth = (arm_in_model.joint_ids[k] for k in (1, 2, 4))
    base = data.oMf[arm_in_model.base]
    axis = dhm.chain_frames(arm.table, arm.table.offsets[:, None], arm.T_base_0).z[1, :, 0]
    up = np.array([0.0, 0.0, 1.0])
    along_upper, along_fore, across_fore = (
        np.cos(angle) * up + np.sin(angle) * np.cross(axis, up)
        for angle in (*joint_map.phases, joint_map.phases[1] + np.pi / 2)
    )

    def from_joint(joint: int, point: FloatArray) -> FloatArray:
        return base.rotation.T @ (point - data.oMi[joint].translation)

    L_1 = float(along_upper @ from_joint(second, data.oMi[third].translation))
    L_2 = float(along_fore @ from_joint(third, data.oMi[fifth].translation))
    if masses is None:
        whole, fore = data.mass[second], data.mass[third]
        upper = whole - fore
        if not (upper > 0.0 and fore > 0.0):
            raise RobotError(
                f"the URDF of {arm.name} gives no masses of upper arm and forearm: give `masses`", parameter="masses"
            )
        moment = whole * (data.oMi[second] * data.com[second]) - fore * (data.oMi[third] * data.com[third])
        L_G1 = float(along_upper @ from_joint(second, moment / upper))
    else:
        (upper, fore), L_G1 = masses, L_1 / 2
    tip = data.oMf[arm_in_model.tip]
    payload = from_joint(third, tip * np.array([0.0, 0.0, 0.0] if place is None else place, dtype=float))
    guess = replace(Stiffness.guess(L_1, L_2), L_G1=L_G1, m=fore / upper)
    lever = float(along_fore @ payload), float(across_fore @ payload)
    return joint_map.with_payload(guess, delta_kg, upper, *lever)


def _of_the_thesis(joint_map: AnyJointMap) -> JointMap:
    if not isinstance(joint_map, JointMap):
        raise RobotError(
            "the effect of another payload follows from the stiffness of the thesis's levels, which this joint map of "
            "terms has not: calibrate with model 34 or 34b, or with the payload that the robot will carry",
            parameter="delta_kg",
        )
    return joint_map
