"""What weight does: each against its formula, a table of the thesis, or Pinocchio."""

import numpy as np
import pytest

from irbcal.modeling import frames
from irbcal.simulation.weight_effects import Bending
from irbcal.units import MM


def test_three_kilograms_bend_the_stretched_arm_as_table_4_3_says(cell):
    """Nubiola 2011, Table 4.3: 0.29 mm from 3 kg, 2.13 mm in all with 1.8 kg."""
    joints = np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    bare = cell.only("compliance").replace(table=cell.arm.table)
    at_rest = cell.arm.forward(joints)[0, :3, 3]
    sag = [
        np.linalg.norm(bare.with_payload(load).measure(joints).T_base_tip[0, :3, 3] - at_rest) for load in (1.8, 4.8)
    ]
    assert sag[0] == pytest.approx(2.134 * MM, rel=0.15)
    assert sag[1] - sag[0] == pytest.approx(0.292 * MM, rel=0.15)


def test_a_frame_tilts_by_its_compliance_times_the_torque(cell):
    """The stretched arm's weight about the horizontal axis y of joint 1's frame: masses times distances by hand."""
    joints = np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    soft = Bending(x_rad_per_Nm=(0.0,) * 6, y_rad_per_Nm=(1e-7, 0.0, 0.0, 0.0, 0.0, 0.0))
    bare = cell.only().replace(table=cell.arm.table)
    straight, bent = bare.measure(joints).T_base_tip[0], bare.with_effect(soft).measure(joints).T_base_tip[0]
    R = bent[:3, :3] @ straight[:3, :3].T
    turn = [R[2, 1], R[0, 2], R[1, 0]]  # a small one
    loaded = cell.loaded()
    centres = np.array([frames.apply(T, c) for T, c in zip(link_frames(cell.arm, joints), loaded.centre, strict=True)])
    torque = 9.81 * (loaded.mass * centres[:, 0]).sum()  # joint 1 stands on the base's z axis; x points forward
    assert torque > 300.0
    np.testing.assert_allclose(turn, [0.0, 1e-7 * torque, 0.0], atol=2e-3 * 1e-7 * torque)
    assert bent[2, 3] < straight[2, 3] - 0.03 * MM  # the arm sinks


def test_bending_grows_with_the_payload_and_fits_other_arms():
    small = Bending().for_arm(np.zeros(6, dtype=bool), 0.5)
    assert small.x_rad_per_Nm[1] == pytest.approx(16 * Bending().x_rad_per_Nm[1])
    railed = Bending().for_arm(np.array([True] + [False] * 6), 1.0)
    assert railed.y_rad_per_Nm[:2] == (0.0, Bending().y_rad_per_Nm[0])


def link_frames(arm, joints):
    """DHM frame of each link in the base link at one pose: the step of the table by 4x4 matrices."""
    T, out = arm.T_base_0, []
    for j in range(6):
        row = arm.table
        angle = row.theta[j] + joints[0, j]
        T = T @ frames.transform(frames.rot_x(row.alpha[j])) @ frames.transform(translation=[row.a[j], 0.0, 0.0])
        T = T @ frames.transform(frames.rot_z(angle)) @ frames.transform(translation=[0.0, 0.0, row.d[j]])
        out.append(T)
    return out
