"""What the tests of the error model's terms need: motions with a history, all terms of an arm, derivatives checked."""

import numpy as np
from support import TARGETS, arm, central_differences, on_a_rail

from irbcal.io import urdf
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term_map import TermMap, basis_slope_rates, basis_slopes, basis_values
from irbcal.modeling.terms.warm_up import WarmUp

PREVIOUS = np.array([0.3, -0.2, 0.4, 1.0, -0.5, 0.2])
SPEEDS = np.array([0.4, -0.8, 0.3, 1.1, -0.6, 0.9])

TWO_LINKS = """<robot name="two"><link name="base_link"/><link name="one"/><link name="two"/><link name="tool0"/>
<joint name="j1" type="revolute"><parent link="base_link"/><child link="one"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="t" type="fixed"><parent link="two"/><child link="tool0"/><origin xyz="0.3 0 0"/></joint></robot>"""
"""Two links of 0.4 and 0.3 m in a vertical plane, stretched along x at zero; both joints turn about y: downwards."""


def two_links():
    """The arm of `TWO_LINKS`, whose levers are known by hand."""
    return urdf.from_bytes(TWO_LINKS.encode(), "two", "base_link", "tool0").arm


def rail(folder):
    """An IRB 120 on a linear axis, which is its first joint."""
    return urdf.read(on_a_rail(folder / "rail.urdf"), "rail_base", "tool0").arm


def some_joints(n=4, seed=3):
    return arm("irb120").random_joints(n, seed)


def motion_at(q, previous=PREVIOUS):
    """Stops with history, time and payload."""
    q = np.atleast_2d(q)
    n = len(q)
    torques = 40.0 * np.sin(np.arange(1.0, q.shape[1] + 1.0)) * np.ones(q.shape)
    return Motion(q, q - previous, 3.0 + np.arange(n), {"payload_kg": np.full(n, 2.5), "torques": torques})


def every_term(model):
    """All terms of all families; of the harmonics a few."""
    terms = [t for family in families().values() for t in family.terms(model) if family.name != "harmonics"]
    terms += [t for t in families()["harmonics"].terms(model) if t.parameters["cycles_per_turn"] in (1, 2, 7)]
    return [*terms, *gear_terms(3, 242), *WarmUp(20.0).terms(model), *Payload((0.1, -0.05, 0.2)).terms(model)]


def random_map(model, seed=1, families_left_out=("geometry",)):
    """A map with all terms, their coefficients about a third of the natural size."""
    terms = tuple(t for t in every_term(model) if t.family not in families_left_out)
    rng = np.random.default_rng(seed)
    return TermMap(model, terms, 0.3 * np.array([t.size for t in terms]) * rng.standard_normal(len(terms)))


def values_of(terms, model, motion):
    """Functions of terms at a motion, shape (terms, n)."""
    return basis_values(terms, Situation(model, motion))


def assert_derivatives(terms, model, q, dq=SPEEDS, motion=motion_at, step=1e-5):
    """Slopes and their rates at joints (joints,) against central differences; gives the slopes (terms, joints)."""
    here = Situation(model, motion(q))
    slopes = basis_slopes(terms, here)[:, 0]
    numeric = central_differences(lambda x: values_of(terms, model, motion(x))[:, 0], q, step)
    scale = np.maximum(np.abs(numeric).max(axis=1, keepdims=True), 1.0)
    assert (np.abs(slopes - numeric) / scale).max() < 1e-6
    rates = basis_slope_rates(terms, here, dq[None])[:, 0]
    numeric = central_differences(
        lambda s: basis_slopes(terms, Situation(model, motion(q + s[0] * dq)))[:, 0].ravel(), np.zeros(1), step
    ).reshape(rates.shape)
    scale = np.maximum(np.abs(numeric).max(axis=1, keepdims=True), 1.0)
    assert (np.abs(rates - numeric) / scale).max() < 1e-6
    return slopes


def framed_robot(name, rng, scale=1.0):
    """A robot with a joint map and frame terms of natural sizes, and the targets of the thesis."""
    model = arm(name)
    terms = [t for family in ("gravity", "gain", "bending", "wobble") for t in families()[family].terms(model)]
    values = scale * np.array([t.size for t in terms]) * rng.standard_normal(len(terms))
    both = TermMap(model, tuple(terms), values, np.abs(values))
    q = model.random_joints(50, 1)
    joint_map = JointMap(both.select(False), np.array([q.min(axis=0), q.max(axis=0)]))
    return Robot(model, joint_map, frame_terms=both.select(True), targets=TARGETS)
