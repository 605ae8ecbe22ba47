"""Gravity torques against Pinocchio."""

import numpy as np
import pytest
from cell_support import OTHERS, robot_file

from irbcal.io import urdf
from irbcal.simulation import masses
from irbcal.simulation.gravity import torques_and_origins


@pytest.mark.parametrize("name", ["irb1600", "irb120", "ur10", "panda", "rail"])
def test_gravity_torques_are_those_of_pinocchio(name, tmp_path):
    import pinocchio as pin

    path = robot_file(name, tmp_path)
    found = urdf.read(path, *OTHERS.get(name, (None, None)))
    kilograms, centre = 2.5, np.array([0.02, -0.03, 0.075])
    model = pin.buildModelFromUrdf(str(path))
    tip = model.frames[model.getFrameId(found.arm.tip_link)]
    load = pin.Inertia(kilograms, centre, np.zeros((3, 3)))
    model.appendBodyToJoint(tip.parentJoint, load, tip.placement)
    data = model.createData()
    joints = found.arm.random_joints(50, seed=1)
    columns = [model.joints[model.getJointId(joint)].idx_v for joint in found.arm.joint_names]
    expected = []
    for row in joints:
        full = pin.neutral(model)
        full[[model.joints[model.getJointId(joint)].idx_q for joint in found.arm.joint_names]] = row
        expected.append(pin.computeGeneralizedGravity(model, data, full)[columns])
    bodies = masses.bodies(found).with_payload(kilograms, centre, found.arm.T_last_tip)
    torque, origins = torques_and_origins(found.arm, bodies, joints)
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    if name != "rail":
        np.testing.assert_allclose(origins[:, 0], 0.0)
