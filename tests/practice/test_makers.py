"""Programs of all makers: joints and poses of one stop are the same place, by scipy and Pinocchio."""

import re

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from irbcal.practice import makers

EULER = {"kuka": "ZYX", "fanuc": "xyz", "yaskawa": "xyz", "staubli": "XYZ", "kawasaki": "ZYZ"}


def pinocchio_pose(data, q):
    model = pin.buildModelFromXML(data.decode())
    q = np.array(q)
    state = model.createData()
    pin.forwardKinematics(model, state, q)
    pin.updateFramePlacements(model, state)
    base, tip = (state.oMf[model.getFrameId(name)] for name in ("base", "tool0"))
    return (base.inverse() * tip).homogeneous


@pytest.mark.parametrize("arm", [arm for arm in makers.ARMS if arm.joints], ids=lambda arm: arm.folder)
def test_poses_are_where_the_joints_are(arm):
    from irbcal.io import urdf

    data = makers.urdf_of(arm)
    found = makers.stops(arm, data, urdf.from_bytes(data, arm.folder))

    def place(six):
        return np.block(
            [
                [
                    Rotation.from_euler(EULER[arm.folder], six[3:], degrees=True).as_matrix(),
                    np.array(six[:3], ndmin=2).T,
                ],
                [np.zeros((1, 3)), np.ones((1, 1))],
            ]
        )

    for program, numbers in zip(arm.stops, found["poses"], strict=True):
        q = np.radians(program)
        if arm.folder == "fanuc":
            q[2] += q[1]  # the pendant's joint 3 is measured against the ground
        flange = pinocchio_pose(data, q)
        flange[:3, 3] *= 1e3
        tool = place(arm.frame) @ place(numbers) @ np.linalg.inv(place(arm.tool))
        assert np.allclose(tool[:3, 3], flange[:3, 3], atol=1e-6)
        assert np.allclose(tool[:3, :3], flange[:3, :3], atol=1e-9)


def test_programs_are_marked_and_have_all_stops(written):
    programs = [name for name in written.about if re.search(r"\.(mod|src|ls|JBI|pgx|script|as)$", name)]
    assert len(programs) == 9
    for name in programs:
        if "CalibData" not in name:
            assert "SIMULATED" in (written.folder / name).read_text(), name
