"""Torques of an evenly heavy arm by hand and by Pinocchio, and their derivatives."""

import numpy as np
import pinocchio as pin
from support import arm
from term_cases import TWO_LINKS, assert_derivatives, some_joints, two_links, values_of

from irbcal.io import robots, urdf
from irbcal.io.urdf_check import ArmInModel
from irbcal.modeling.terms.own_weight import FAMILY
from irbcal.modeling.terms.situation import Motion, Situation


def test_torques_of_two_links_by_hand():
    """Links of 0.4 and 0.3 m: about joint 1 a mass at 0.4 m and one at the tip, 1.1 m when stretched; about joint 2 one."""
    model = two_links()
    q = model.random_joints(12, 6)
    both = q.sum(axis=1)
    expected = [(2 * 0.4 * np.cos(q[:, 0]) + 0.3 * np.cos(both)) / 1.1, np.cos(both)]
    np.testing.assert_allclose(values_of(FAMILY.terms(model), model, Motion(q)), expected, rtol=0, atol=1e-12)


def test_it_is_pinocchio_s_gravity_of_equal_masses_at_joints_and_tip():
    nominal, q = arm("irb120"), arm("irb120").random_joints(30, 4)
    light = pin.buildModelFromUrdf(str(robots.robot_file("irb120")))
    inside = ArmInModel(light, nominal)
    for k in range(1, light.njoints):
        light.inertias[k] = pin.Inertia.Zero()
    heavy, data = light.copy(), light.createData()
    pin.forwardKinematics(light, data, inside.configurations(np.zeros((1, 6)), pin.neutral(light))[0])
    situation = Situation(nominal, Motion(np.zeros((1, 6))))
    points = [*situation.origins[..., 0], situation.tip[3, :, 0]]
    for joint, p in zip([*inside.joint_ids, inside.joint_ids[-1]], points, strict=True):
        mass = pin.Inertia(1.0, data.oMi[int(joint)].actInv(p), np.zeros((3, 3)))
        heavy.appendBodyToJoint(int(joint), mass, pin.SE3.Identity())
    rows = [heavy.joints[int(k)].idx_v for k in inside.joint_ids]
    torque = np.array(
        [
            -pin.computeGeneralizedGravity(heavy, heavy.createData(), c)[rows]
            for c in inside.configurations(q, pin.neutral(light))
        ]
    ).T
    terms = FAMILY.terms(nominal)
    values = values_of(terms, nominal, Motion(q))
    assert [term.joint for term in terms] == [0, 1, 2, 3, 4]  # the tip is on axis 6
    for term, value in zip(terms[1:], values[1:], strict=True):
        ratio = float(torque[term.joint] @ value / (value @ value))
        assert ratio > 0.5
        assert np.abs(torque[term.joint] - ratio * value).max() < 1e-9
    assert np.abs(values[0]).max() < 1e-12  # gravity does nothing about an upright axis


def test_derivatives():
    model = arm("irb120")
    assert np.abs(assert_derivatives(FAMILY.terms(model), model, some_joints(1)[0])).max() > 0.3


def test_there_is_none_where_a_joint_slides_beyond():
    text = TWO_LINKS.replace('name="j2" type="revolute"', 'name="j2" type="prismatic"')
    assert not FAMILY.terms(urdf.from_bytes(text.encode(), "slide", "base_link", "tool0").arm)
