"""Another payload: against gravity on Pinocchio's bodies."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from support import arm

from irbcal.errors import RobotError
from irbcal.io import robots
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.stiffness import Stiffness
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.planners.calibrated_model import CalibratedModel


def gravity(model, configurations):
    """Moments of gravity about joints 2 and 3 by Pinocchio, (n, 2): what the joints give way to."""
    data = model.createData()
    return -np.array([pin.computeGeneralizedGravity(model, data, configuration) for configuration in configurations])[
        :, 1:3
    ]


def test_stiffness_terms_are_gravity_on_two_links():
    """A chain of two point masses at the thesis's levers, the forearm horizontal at zero (Figure 5.3)."""
    upper_kg, fore_kg, payload_kg = 20.0, 26.0, 3.0
    L_1, L_G1, L_G2, L_P, compliance = 0.7, 0.31, 0.42, 0.74, 3e-6
    model = pin.Model()
    shoulder = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "shoulder")
    elbow = model.addJoint(shoulder, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0, 0, L_1])), "elbow")

    def mass(kg, place):
        return pin.Inertia(kg, np.array(place, dtype=float), np.zeros((3, 3)))

    model.appendBodyToJoint(shoulder, mass(upper_kg, [0, 0, L_G1]), pin.SE3.Identity())
    model.appendBodyToJoint(elbow, mass(fore_kg, [L_G2, 0, 0]), pin.SE3.Identity())
    loaded_model = model.copy()
    loaded_model.appendBodyToJoint(elbow, mass(payload_kg, [L_P, 0, 0]), pin.SE3.Identity())
    k = compliance * 9.81
    stiffness = Stiffness(1.0, L_G1, 0.1, fore_kg / upper_kg, L_1, 0.6).with_coefficients(
        k * (upper_kg * L_G1 + fore_kg * L_1), k * fore_kg * L_G2
    )
    q = np.zeros((40, 6))
    q[:, 1:3] = np.random.default_rng(8).uniform(-3, 3, (40, 2))
    for pinocchio, now in ((model, stiffness), (loaded_model, stiffness.with_payload(payload_kg, L_P, upper_kg))):
        data = pinocchio.createData()
        torque = -np.array([pin.computeGeneralizedGravity(pinocchio, data, row) for row in q[:, 1:3]])
        change = ThesisMap(stiffness=now.coefficients).effective(q) - q
        assert np.abs(change[:, 1:3] - compliance * torque).max() < 1e-15


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
@pytest.mark.parametrize(
    ("place", "wrist"), [(None, None), ((0.0, 0.0, 0.06), (0, 0, 0)), ((0.05, -0.02, 0.1), (0.4, 1.2, -0.7))]
)
def test_payload_moves_the_joints_as_gravity_on_the_urdfs_masses_does(name, place, wrist):
    """Pinocchio weighs the URDF's bodies with and without the payload; the joints give way in proportion."""
    nominal = arm(name)
    content = robots.robot_file(name).read_bytes()
    compliance = 2e-6
    bare = CalibratedModel(content, nominal)
    phases = nominal.stiffness_geometry()[0]
    theta = np.zeros((60, 6))
    theta[:, 1:3] = np.random.default_rng(9).uniform(-3, 3, (60, 2))
    theta[:, 3:] = 0.0 if wrist is None else wrist
    torque = gravity(bare.model, theta)
    angles = theta[:, 1], theta[:, 1] + theta[:, 2] + phases[1]
    waves = np.array([np.sin(angles[0]), np.cos(angles[0]), np.sin(angles[1]), np.cos(angles[1])]).T
    A, _, B, _ = compliance * np.linalg.lstsq(waves, torque[:, 0], rcond=None)[0]
    model = replace(bare, joint_map=ThesisMap(stiffness=[A, B], phases=phases).joint_map(nominal))
    heavier = model.model.copy()
    tip = heavier.frames[heavier.getFrameId("tool0")]
    point = tip.placement * np.array([0.0, 0, 0] if place is None else place)
    heavier.appendBodyToJoint(tip.parentJoint, pin.Inertia(3.0, point, np.zeros((3, 3))), pin.SE3.Identity())
    expected = compliance * (gravity(heavier, theta) - torque)
    loaded = model.with_payload(3.0, place, wrist)
    change = loaded.joint_map.effective(theta) - model.joint_map.effective(theta)
    assert np.abs(change[:, 1:3] - expected).max() < 1e-4 * np.abs(expected).max()
    assert not change[:, [0, 3, 4, 5]].any()
    lighter = loaded.with_payload(-3.0, place, wrist)
    assert loaded.model.nq == 6
    assert np.isfinite(ThesisMap.of(lighter.joint_map).stiffness).all()


def test_payload_needs_masses_and_stiffness():
    nominal = arm()
    content = robots.robot_file("irb1600").read_bytes()
    with pytest.raises(RobotError, match="A > 0"):
        CalibratedModel(content, nominal).with_payload(1.0)
    weightless = content.replace(b"<inertial>", b"<nothing>").replace(b"</inertial>", b"</nothing>")
    model = CalibratedModel(weightless, nominal, ThesisMap(stiffness=[8e-4, 2e-4]).joint_map(nominal))
    with pytest.raises(RobotError, match="gives no masses"):
        model.with_payload(1.0)
    A, B = ThesisMap.of(model.with_payload(2.0, masses=(25.0, 30.0)).joint_map).stiffness
    # by hand: k g = A / (25 0.35 + 30 0.7), the tool's origin 0.665 m along the forearm
    k_g = 8e-4 / (25 * 0.35 + 30 * 0.7)
    assert abs(A - (8e-4 + k_g * 2 * 0.7)) < 1e-15
    assert abs(B - (2e-4 + k_g * 2 * 0.665)) < 1e-15


def test_a_sum_of_terms_changes_its_load():
    nominal = arm()
    place = np.array([0.0, 0.05, 0.1])
    terms = Payload(place).terms(nominal)
    joint_map = JointMap(TermMap(nominal, tuple(terms), np.linspace(1e-6, 6e-6, 6)), None, 2.0)
    model = CalibratedModel(robots.robot_file("irb1600").read_bytes(), nominal, joint_map)
    q, more = nominal.random_joints(30, 1), np.array([0.2, 0.0, -0.1])
    added = TermMap(nominal, tuple(Payload(more).terms(nominal)), np.linspace(1e-6, 6e-6, 6))
    whole = joint_map.effective(q) + added.effective(Motion(q, payload_kg=np.full(30, 3.0))) - q
    loaded = model.with_payload(3.0, more)
    assert np.abs(loaded.joint_map.effective(q) - whole).max() < 1e-14
    assert np.abs(loaded.command_from_model(loaded.model_from_command(q)) - q).max() < 1e-12
    back = loaded.with_payload(-3.0, more).joint_map
    assert np.abs(back.effective(q) - joint_map.effective(q)).max() < 1e-14
    same_place = model.with_payload(3.0).joint_map
    assert np.array_equal(same_place.effective(q), joint_map.carrying(5.0).effective(q))
    assert not (model.with_payload(-2.0).joint_map.effective(q) - q).any()
    with pytest.raises(RobotError, match="measured with 2 kg"):
        model.with_payload(-2.5)
