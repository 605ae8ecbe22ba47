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
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.thesis_map import ThesisMap

if TYPE_CHECKING:
    import pinocchio as pin

    from irbcal.io.urdf_check import ArmInModel


def with_payload(
    joint_map: JointMap,
    arm: Arm,
    model: pin.Model,
    arm_in_model: ArmInModel,
    q_rest: FloatArray,
    delta_kg: float,
    centre: ArrayLike | None = None,
    wrist: ArrayLike | None = None,
    masses: tuple[float, float] | None = None,
) -> JointMap:
    """The joint map with more (or less) mass on the tool than when the robot was measured.

    A sum of terms knows how each joint gives way, where several loads were measured: its load is changed, and neither
    masses nor a posture of the wrist matter.

    Parameters
    ----------
    joint_map : JointMap
    arm : Arm
        The calibrated arm.
    model : pinocchio.Model
        With the bodies of the URDF.
    arm_in_model : ArmInModel
    q_rest : ndarray, shape (nq,)
        Configuration of the joints outside the arm.
    delta_kg, place, wrist, masses
        See `irbcal.planners.calibrated_model.CalibratedModel.with_payload`.

    Raises
    ------
    RobotError
        If a sum of terms was identified with one load only; or for a level of the thesis if the arm has not six
        revolute joints, the joint map has no stiffness, or the URDF no masses.
    """
    thesis = ThesisMap.of(joint_map)
    if thesis is None:
        return _with_more(joint_map, delta_kg, centre)
    state = model, arm_in_model, q_rest
    return _of_the_thesis(thesis, arm, *state, delta_kg, centre, wrist, masses).joint_map(joint_map.terms.arm)


def _of_the_thesis(
    joint_map: ThesisMap,
    arm: Arm,
    model: pin.Model,
    arm_in_model: ArmInModel,
    q_rest: FloatArray,
    delta_kg: float,
    centre: ArrayLike | None,
    wrist: ArrayLike | None,
    masses: tuple[float, float] | None,
) -> ThesisMap:
    """From the stiffness of a level of the thesis and masses."""
    import pinocchio as pin

    if not arm.six_revolute:
        raise RobotError(f"the arm-stiffness model is for six revolute joints, {arm.name} has others")
    theta = np.zeros(6)
    if wrist is not None:
        theta[3:] = wrist
    data = model.createData()
    pin.framesForwardKinematics(model, data, arm_in_model.configurations(theta[None], q_rest)[0])
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
        total, fore = data.mass[second], data.mass[third]
        upper = total - fore
        if not (upper > 0.0 and fore > 0.0):
            raise RobotError(
                f"the URDF of {arm.name} gives no masses of upper arm and forearm: give `masses`", parameter="masses"
            )
        moment = total * (data.oMi[second] * data.com[second]) - fore * (data.oMi[third] * data.com[third])
        L_G1 = float(along_upper @ from_joint(second, moment / upper))
    else:
        (upper, fore), L_G1 = masses, L_1 / 2
    tip = data.oMf[arm_in_model.tip]
    payload = from_joint(third, tip * np.array([0.0, 0.0, 0.0] if centre is None else centre, dtype=float))
    guess = replace(Stiffness.guess(L_1, L_2), L_G1=L_G1, m=fore / upper)
    lever = float(along_fore @ payload), float(across_fore @ payload)
    return joint_map.with_payload(guess, delta_kg, upper, *lever)


def _with_more(joint_map: JointMap, delta_kg: float, centre: ArrayLike | None) -> JointMap:
    """A sum of terms with some mass added to what it carries."""
    load_before, place_before = joint_map.payload_kg or 0.0, joint_map.payload_place
    load = load_before + float(delta_kg)
    if load < 0.0:
        raise RobotError(
            f"a payload {-delta_kg:g} kg smaller is impossible: the robot was measured with {load_before:g} kg",
            parameter="delta_kg",
        )
    if centre is None or load == 0.0 or place_before is None:
        return joint_map.carrying(load)
    return joint_map.carrying(load, (load_before * place_before + delta_kg * np.asarray(centre, dtype=float)) / load)
