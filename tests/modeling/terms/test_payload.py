"""Torque of a payload by hand and by Pinocchio, and its derivatives."""

import numpy as np
import pinocchio as pin
import pytest
from support import arm, example_robot
from term_cases import TWO_LINKS, assert_derivatives, rail, some_joints, two_links, values_of

from irbcal.io import robots, urdf
from irbcal.io.urdf_check import ArmInModel
from irbcal.modeling.terms.payload import STANDARD_GRAVITY, Payload, as_levers
from irbcal.modeling.terms.situation import Motion


def test_torques_of_two_links_by_hand():
    # 2 kg, 0.1 m beyond the tip: about joint 1 with the whole reach, about joint 2 with 0.4 m
    model = two_links()
    place = np.array([0.1, 0.0, 0.0])
    q = model.random_joints(12, 6)
    torque = values_of(Payload(place).terms(model), model, Motion(q, inputs={"payload_kg": np.full(12, 2.0)}))
    both = q.sum(axis=1)
    reach = 0.4 * np.cos(both)
    weight = 2.0 * STANDARD_GRAVITY
    expected = [weight * (0.4 * np.cos(q[:, 0]) + reach), weight * reach]
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12)


def test_no_mass_no_torque_and_twice_the_mass_twice_the_torque():
    model = arm("irb120")
    terms, q = Payload((0.1, 0.0, 0.2)).terms(model), some_joints(3)
    assert not values_of(terms, model, Motion(q)).any()
    once, twice = (values_of(terms, model, Motion(q, inputs={"payload_kg": np.full(3, m)})) for m in (1.5, 3.0))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-14)
    assert {t.unit for t in terms} == {"rad/(N m)"}


def test_derivatives(tmp_path):
    model = arm("irb120")
    assert np.abs(assert_derivatives(Payload((0.1, -0.05, 0.2)).terms(model), model, some_joints(1)[0])).max() > 1.0
    model = rail(tmp_path)
    q = np.r_[0.7, some_joints(1)[0]]

    def motion(x):
        return Motion(x, inputs={"payload_kg": np.full(len(np.atleast_2d(x)), 4.0)})

    slopes = assert_derivatives(Payload((0.1, -0.05, 0.2)).terms(model), model, q, 0.3 * np.ones(7), motion)
    assert np.abs(slopes[:, 0]).max() < 1e-12  # the rail carries axes and mass alike


@pytest.mark.parametrize("name", ["irb120", "panda"])
def test_it_is_what_a_point_mass_adds_to_pinocchio_s_gravity(name):
    if name == "panda":
        file = example_robot("panda_description/urdf/panda.urdf")
        nominal = urdf.read(file, None, "panda_link8").arm
    else:
        file, nominal = robots.robot_file(name), arm(name)
    bare, place, kg = pin.buildModelFromUrdf(str(file)), np.array([0.07, -0.04, 0.12]), 3.7
    frame = bare.frames[bare.getFrameId(nominal.tip_link)]
    loaded = bare.copy()
    mass = pin.Inertia(kg, place, np.zeros((3, 3)))
    loaded.appendBodyToJoint(frame.parentJoint, mass, frame.placement)
    q = nominal.random_joints(30, 4)
    inside = ArmInModel(bare, nominal)
    rows = [bare.joints[k].idx_v for k in inside.joint_ids]
    torque = np.array(
        [
            (pin.computeGeneralizedGravity(bare, bare.createData(), c) - pin.computeGeneralizedGravity(loaded, data, c))
            for data in [loaded.createData()]
            for c in inside.configurations(q, pin.neutral(bare))
        ]
    )[:, rows]
    motion = Motion(q, inputs={"payload_kg": np.full(30, kg)})
    terms = Payload(place).terms(nominal)
    found = values_of(terms, nominal, motion)
    assert np.abs(torque).max() > 10.0
    assert np.abs(found.T - torque).max() < 1e-9
    # the place may come with the motion, and the same torque is that of gravity on the links
    elsewhere = Motion(q, inputs={"payload_kg": np.full(30, kg), "payload_centre": np.tile(place, (30, 1))})
    assert np.abs(values_of(Payload().terms(nominal), nominal, elsewhere) - found).max() < 1e-12
    for term, row in zip(terms, found, strict=True):
        assert np.abs(kg * values_of(as_levers(term, nominal), nominal, motion).sum(axis=0) - row).max() < 1e-12


def test_there_are_no_levers_where_a_joint_slides_beyond(tmp_path):
    model = rail(tmp_path)
    assert all(as_levers(term, model) for term in Payload().terms(model))
    text = TWO_LINKS.replace('name="j2" type="revolute"', 'name="j2" type="prismatic"')
    slide = urdf.from_bytes(text.encode(), "slide", "base_link", "tool0").arm
    (term,) = Payload().terms(slide)
    assert as_levers(term, slide) is None
