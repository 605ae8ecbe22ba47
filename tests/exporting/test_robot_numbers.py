"""The numbers of a calibrated robot: what they sum up, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from jinja2 import UndefinedError
from markupsafe import Markup
from support import arm

from irbcal.errors import CalibrationError
from irbcal.exporting import ros
from irbcal.exporting.robot_numbers import LANGUAGES, Chain, RobotNumbers, vectors_of
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.templates import environment


def of(*terms, robot="irb120"):
    nominal = arm(robot)
    joint_map = JointMap(TermMap(nominal, terms, np.full(len(terms), 1e-4)))
    return RobotNumbers.from_robot(Robot(nominal, joint_map))


def test_chain_is_the_arms(sources):
    robot = sources["panda"].robot
    chain = Chain.from_arm(robot.arm)
    q = robot.arm.random_joints(1, 4)[0]
    T = np.eye(4)
    for R, p, angle in zip(chain.rotations, chain.origins, q, strict=True):
        step, turn = np.eye(4), np.eye(4)
        step[:3, :3], step[:3, 3] = R, p
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        T = T @ step @ turn
    assert np.abs(T[:3, :3] @ chain.tip_place + T[:3, 3] - robot.arm.forward(q[None])[0, :3, 3]).max() < 1e-15


def test_low_orders_are_series_and_single_high_ones_are_waves():
    low = [t for k in (1, 2, 5) for t in pair(2, k, "rz", 1.0, "", "")]
    found = of(*low, *pair(4, 202, "rz", 1.0, "", ""))
    assert found.cosine.shape == (5, 6)
    assert found.cosine[:, 2].tolist() == found.sine[:, 2].tolist() == [1e-4, 1e-4, 0.0, 0.0, 1e-4]
    assert [(w.joint, w.cycles) for w in found.waves] == [(4, 202.0)]
    assert of(*pair(0, 60, "rz", 1.0, "", "")).cosine.shape == (0, 6)  # far from any other


def test_warm_arms_have_no_drift_and_unknown_terms_are_refused(creep):
    drift = [t for t in families()["warm_up"].terms(arm("irb120")) if t.axis == "rz"]
    assert not of(*drift).offset.any()
    with pytest.raises(CalibrationError, match="exports do not know"):
        of(*(t for t in creep.terms(arm("irb120")) if t.axis == "rz"))
    with pytest.raises(CalibrationError, match="exports do not know"):
        of(Term(1, "rz", "q", 1.0, "", "", "1", {}, (2,)))


def test_identifiers():
    nominal = arm("irb120")
    for name, word in (("IRB 120-3/0.58", "irb_120_3_0_58"), ("7 axes", "robot_7_axes"), ("机", "robot")):
        assert RobotNumbers.from_robot(Robot(replace(nominal, name=name))).identifier == word


def test_vectors_have_known_and_unknown_stops_and_several_loads(sources):
    robot, numbers = sources["ur10"].robot, sources["ur10"].numbers
    vectors = vectors_of(robot, numbers)
    unknown = np.isnan(vectors.inputs["previous"]).all(axis=1)
    assert 0 < unknown.sum() < len(vectors)
    assert len(set(vectors.inputs["payload_kg"])) == 5
    assert np.array_equal(robot.forward(vectors.q, **vectors.inputs)[:, :3], vectors.tip)


def test_nothing_is_told_where_nothing_is_left_out(described):
    assert ros.files(described["ur10"]).notes == ()


@pytest.mark.parametrize("language", LANGUAGES)
def test_values_are_literals_unless_they_are_code(language):
    made = environment("irbcal.exporting", literal=LANGUAGES[language])
    shown = made.from_string("{{ text }} {{ number }} {{ code }}").render(text='x"\n', number=1.5, code=Markup("a = 1"))
    assert shown.splitlines() == [shown]
    assert shown in ("'x\"\\n' 1.5 a = 1", '"x\\042\\012" 1.5 a = 1')
    with pytest.raises(UndefinedError):
        made.from_string("{{ missing }}").render()
