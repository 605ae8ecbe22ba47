"""A line along the arm at home, for drawings."""

import numpy as np
import pytest

from irbcal.io import robots, urdf
from irbcal.modeling import commanded_joints


@pytest.mark.parametrize("name", ["irb1600", "panda", "ur10"])
def test_the_line_meets_each_joint_axis_and_ends_at_the_tip(name):
    pin = pytest.importorskip("pinocchio")
    arm = urdf.read(name).arm
    model = pin.buildModelFromUrdf(str(robots.robot_file(name)))
    q, data, line = commanded_joints.home_joints(arm), model.createData(), commanded_joints.line_at_home(arm)
    configuration = pin.neutral(model)
    for joint, value in zip(arm.joint_names, q, strict=True):
        configuration[model.joints[model.getJointId(joint)].idx_q] = value
    pin.computeJointJacobians(model, data, configuration)
    pin.updateFramePlacements(model, data)
    base = data.oMf[model.getFrameId(arm.base_link)]
    assert line[0].tolist() == [0.0, 0.0, 0.0]
    assert np.abs(line[-1] - base.actInv(data.oMf[model.getFrameId(arm.tip_link)]).translation).max() < 1e-9
    for j, joint in enumerate(arm.joint_names):
        before, foot, origin = (base.act(point) for point in line[2 * j : 2 * j + 3])
        k = model.getJointId(joint)
        axis = data.J[3:, model.joints[k].idx_v]
        assert np.linalg.norm(np.cross(axis, origin - data.oMi[k].translation)) < 1e-9
        assert j == 0 or abs(axis @ (foot - before)) < 1e-9  # the common normal first, then along the axis
