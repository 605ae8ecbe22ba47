"""A sum of terms as a joint map: against the sum itself, central differences, limits, and a plain rewriting."""

import pickle

import numpy as np
import pytest
from support import arm, assert_derivative
from term_cases import TWO_LINKS

from irbcal.errors import RobotError
from irbcal.io import urdf
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.warm_up import WarmUp

FAMILIES = ("gravity", "own_weight", "gain", "thesis", "harmonics", "direction", "move")


def random_map(model, names=FAMILIES, highest=7, seed=0, ranges=None):
    terms = [t for name in names for t in families()[name].terms(model)]
    terms = [t for t in terms if t.parameters.get("cycles_per_turn", 0) <= highest]
    sizes = np.array([t.size for t in terms])
    values = 0.3 * sizes * np.random.default_rng(seed).standard_normal(len(terms))
    return JointMap(TermMap(model, tuple(terms), values), ranges)


@pytest.fixture(scope="module")
def model():
    return arm("irb120")


def test_it_is_the_sum_of_its_terms(model):
    joint_map = random_map(model)
    q, previous = model.random_joints(50, 1), model.random_joints(50, 2)
    terms = joint_map.terms
    assert np.abs(joint_map.effective(q) - terms.effective(Motion(q))).max() < 1e-14
    motion = Motion(q, q - previous)
    assert np.abs(joint_map.effective(q, previous) - terms.effective(motion)).max() < 1e-14
    assert np.abs(joint_map.jacobian(q, previous) - terms.jacobian(motion)).max() < 1e-14
    assert np.abs(joint_map.effective(q, previous) - joint_map.effective(q)).max() > 1e-5
    unknown = np.where(np.arange(50)[:, None] < 25, np.nan, previous)
    mixed = joint_map.effective(q, unknown)
    assert np.array_equal(mixed[:25], joint_map.effective(q)[:25])
    assert np.array_equal(mixed[25:], joint_map.effective(q, previous)[25:])


def test_derivatives(model):
    joint_map = random_map(model)
    q, dq = model.random_joints(5, 3), model.random_joints(5, 4)
    for row, speed in zip(q, dq, strict=True):
        J = joint_map.jacobian(row[None])[0]
        assert_derivative(lambda x: joint_map.effective(x[None])[0], row, J, 1e-9)
        rate = joint_map.jacobian_derivative(row[None], speed[None])[0]
        ahead, behind = (joint_map.jacobian((row + h * speed)[None])[0] for h in (1e-5, -1e-5))
        assert np.abs((ahead - behind) / 2e-5 - rate).max() < 1e-7


def test_it_is_inverted_with_and_without_the_stop_before(model):
    joint_map = random_map(model)
    q, previous = model.random_joints(200, 5), model.random_joints(200, 6)
    assert np.abs(joint_map.commanded(joint_map.effective(q)) - q).max() < 1e-13
    assert np.abs(joint_map.commanded(joint_map.effective(q, previous), previous) - q).max() < 1e-13
    far = JointMap(TermMap(model, random_map(model, ("gain",)).terms.terms, np.full(6, -1.5)))
    with pytest.raises(RobotError, match="cannot be inverted"):
        far.commanded(q)


def test_commands_of_the_box_of_limits_respect_the_limits(model):
    joint_map = random_map(model, highest=45)
    lower, upper = joint_map.effective_limits(model.lower, model.upper)
    theta = np.random.default_rng(1).uniform(lower, upper, (3000, 6))
    theta[:64] = np.where(np.random.default_rng(2).random((64, 6)) < 0.5, lower, upper)
    q = joint_map.commanded(theta)
    assert (q >= model.lower - 1e-12).all()
    assert (q <= model.upper + 1e-12).all()
    assert np.abs([lower - model.lower, upper - model.upper]).max() < 0.01
    endless = joint_map.effective_limits(np.full(6, -np.inf), np.full(6, np.inf))
    assert np.isneginf(endless[0]).all()
    assert np.isposinf(endless[1]).all()


def test_identity_words_pickle_and_lock(model):
    empty = JointMap(TermMap(model, (), np.zeros(0)))
    q = model.random_joints(3, 8)
    assert empty.is_identity
    assert np.array_equal(empty.effective(q), q)
    assert np.array_equal(empty.commanded(q), q)
    assert "no joint map" in empty.in_words
    joint_map = random_map(model)
    assert len(repr(Robot(model, joint_map))) < 400
    assert f"{len(joint_map.terms.terms)} terms (gravity, own weight, gain, thesis" in repr(joint_map)
    again = pickle.loads(pickle.dumps(joint_map))
    assert np.array_equal(again.effective(q), joint_map.effective(q))
    with pytest.raises(ValueError, match="read-only"):
        joint_map.terms.coefficients[0] = 1.0
    assert joint_map.effective(np.zeros((0, 6))).shape == (0, 6)
    assert joint_map.jacobian(np.zeros((0, 6))).shape == (0, 6, 6)


def test_frame_terms_are_refused(model):
    terms = tuple(WarmUp(10.0).terms(model))
    with pytest.raises(RobotError, match="other axes"):
        JointMap(TermMap(model, terms, np.zeros(len(terms))))


def test_outside_the_ranges(model):
    joint_map = random_map(model, ranges=np.array([np.full(6, -1.0), np.full(6, 1.0)]))
    beyond = joint_map.outside([[0.0, 1.5, -1.25, 1.0, -1.0, 0.2]])
    assert np.abs(beyond - [[0.0, 0.5, -0.25, 0.0, 0.0, 0.0]]).max() < 1e-15
    assert not random_map(model).outside(model.random_joints(5, 1)).any()


def rewritten(parts, q):
    """The static parts in plain numbers, as another language would have it."""
    out = q * (1 + np.array(parts["gain"]))
    for wave in parts["waves"]:
        angle = np.dot(wave["turns"], q)
        out[wave["joint"]] += wave["cosine"] * np.cos(angle) + wave["sine"] * np.sin(angle)
    return out


def test_static_parts_say_it_all(model):
    joint_map = random_map(model)
    q = model.random_joints(20, 9)
    found = np.array([rewritten(joint_map.static_parts(), row) for row in q])
    assert np.abs(found - joint_map.effective(q)).max() < 1e-13


def loaded_map(model, payload_kg=3.0, place=(0.05, -0.02, 0.1)):
    terms = [*families()["gravity"].terms(model), *families()["torque"].terms(model), *Payload(place).terms(model)]
    values = 0.3 * np.array([t.size for t in terms]) * np.random.default_rng(2).standard_normal(len(terms))
    return JointMap(TermMap(model, tuple(terms), values), None, payload_kg)


def test_it_carries_what_it_carried_when_it_was_measured_unless_told_otherwise(model):
    joint_map, q = loaded_map(model), model.random_joints(40, 5)
    loads = np.linspace(0.0, 9.0, 40)

    def of(kg, **rest):
        return joint_map.terms.effective(Motion(q, inputs={"payload_kg": kg * np.ones(40), **rest}))

    assert np.abs(joint_map.effective(q) - of(3.0)).max() < 1e-14
    assert np.abs(joint_map.effective(q, payload_kg=loads) - of(loads)).max() < 1e-14
    assert np.abs(joint_map.carrying(7.0).effective(q) - of(7.0)).max() < 1e-14
    assert np.abs(of(7.0) - of(3.0)).max() > 1e-4
    gaps = np.where(loads > 4.0, np.nan, loads)
    assert np.abs(joint_map.effective(q, payload_kg=gaps) - of(np.where(loads > 4.0, 3.0, loads))).max() < 1e-14
    place, torques = np.array([0.2, 0.0, -0.1]), np.random.default_rng(3).normal(0.0, 40.0, q.shape)
    there = of(5.0, payload_centre=np.tile(place, (40, 1)))
    assert np.abs(joint_map.carrying(5.0, place).effective(q) - there).max() < 1e-14
    assert np.abs(joint_map.effective(q, payload_kg=5.0, payload_centre=place) - there).max() < 1e-14
    felt = of(3.0, torques=torques)
    assert np.abs(joint_map.effective(q, torques=torques) - felt).max() < 1e-14
    assert np.abs(felt - of(3.0)).max() > 1e-4
    robot = Robot(model, joint_map)
    assert np.abs(robot.carrying(7.0).poses(q) - robot.forward(q, payload_kg=7.0)).max() < 1e-14
    assert "carrying 7 kg" in joint_map.carrying(7.0).in_words


def test_loads_and_joints_of_another_shape_are_refused(model):
    joint_map, q = loaded_map(model), model.random_joints(4, 1)
    with pytest.raises(RobotError, match=r"payload_kg: expected numbers of shape \(4,\), found shape \(3,\)"):
        joint_map.motion(q, payload_kg=[1.0, 2.0, 3.0])
    robot = Robot(model, joint_map)
    for previous in ("smr1", q[:2]):
        for place in (robot.forward, joint_map.motion):  # by the kernel, and by numpy
            with pytest.raises(RobotError) as refused:
                place(q, previous)
            assert refused.value.parameter == "previous"
    with pytest.raises(RobotError) as refused:
        robot.forward(q, payload_kg="heavy")
    assert refused.value.parameter == "payload_kg"
    with pytest.raises(RobotError, match=r"expected joints of shape \(n, joints\), found shape \(6,\)"):
        joint_map.motion(q[0], payload_kg=2.0)


def test_derivatives_inverse_and_limits_are_those_of_the_load(model):
    joint_map = loaded_map(model).carrying(12.0, [0.1, 0.1, 0.2])
    q, dq = model.random_joints(4, 3), model.random_joints(4, 4)
    for row, speed in zip(q, dq, strict=True):
        assert_derivative(lambda x: joint_map.effective(x[None])[0], row, joint_map.jacobian(row[None])[0], 1e-9)
        rate = joint_map.jacobian_derivative(row[None], speed[None])[0]
        ahead, behind = (joint_map.jacobian((row + h * speed)[None])[0] for h in (1e-5, -1e-5))
        assert np.abs((ahead - behind) / 2e-5 - rate).max() < 1e-7
    assert np.abs(joint_map.effective(joint_map.commanded(q)) - q).max() < 1e-12
    low, high = joint_map.effective_limits(model.lower, model.upper)
    corners = np.random.default_rng(1).uniform(low, high, (200, 6))
    command = joint_map.commanded(corners)
    assert (command > model.lower - 1e-12).all()
    assert (command < model.upper + 1e-12).all()


def test_a_joint_that_slides_beyond_has_its_load_too():
    text = TWO_LINKS.replace('name="j2" type="revolute"', 'name="j2" type="prismatic"')
    slide = urdf.from_bytes(text.encode(), "slide", "base_link", "tool0").arm
    joint_map = loaded_map(slide)
    q = slide.random_joints(30, 1)
    whole = joint_map.terms.effective(Motion(q, inputs={"payload_kg": np.full(30, 3.0)}))
    assert np.abs(joint_map.effective(q) - whole).max() < 1e-14
    low = joint_map.effective_limits(slide.lower, slide.upper)[0]
    assert np.abs(low - slide.lower)[0] >= np.abs(joint_map.effective(q) - q)[:, 0].max()
    with pytest.raises(RobotError, match="other languages"):
        joint_map.static_parts()


def test_what_another_load_does_is_not_made_up(model):
    one = JointMap(random_map(model).terms, None, 3.0)
    assert one.carrying(3.0) is one
    with pytest.raises(RobotError, match=r"with 3 kg only, .* 5 kg: measure some poses with another load"):
        one.carrying(5.0)
    with pytest.raises(RobotError, match="a load that was not given"):
        random_map(model).carrying(5.0)
    with pytest.raises(RobotError, match="expected a mass"):
        loaded_map(model).carrying(-1.0)
    with pytest.raises(RobotError, match="three numbers"):
        loaded_map(model).carrying(1.0, [0.0, 0.1])
