"""Sums of terms: what they make of joints, derivatives, inverse, JSON."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, central_differences
from term_cases import (
    PREVIOUS,
    SPEEDS,
    assert_derivatives,
    every_term,
    motion_at,
    rail,
    random_map,
    some_joints,
    values_of,
)

from irbcal.errors import RobotError
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import bases, chain, families, term_map
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import AXES, Term
from irbcal.modeling.terms.term_map import TermMap, basis_slopes
from irbcal.modeling.terms.wobble import FAMILY as WOBBLE


def test_every_basis_agrees_with_central_differences():
    model = arm("irb120")
    terms = every_term(model)
    assert {t.basis for t in terms} == set(bases())
    slopes = assert_derivatives(terms, model, some_joints(1)[0])
    moved = {t.basis for t, row in zip(terms, slopes, strict=True) if np.abs(row).max() > 1e-6}
    assert moved >= set(bases()) - {"constant", "decay", "direction", "torque"}  # these moves are far beyond the play
    near = Motion(PREVIOUS + 1e-3, np.full((1, 6), 1e-3))
    play = families()["direction"].terms(model)
    inside = basis_slopes(play, Situation(model, near))[:, 0]
    width = np.radians(0.5)
    np.testing.assert_allclose(np.diag(inside), (1 - np.tanh(1e-3 / width) ** 2) / width, rtol=1e-12)


def test_jacobian_of_points_by_coefficients():
    model = arm("irb120")
    found = random_map(model)
    motion = motion_at(some_joints(3))
    pose, local = np.array([0, 0, 1, 2]), np.array([[0.1, 0.02, 0.05], [0, 0.1, 0.1], [0.1, 0.02, 0.05], [-0.1, 0, 0]])

    def points(c):
        T = TermMap(model, found.terms, c).forward(model, motion)[pose]
        return np.einsum("mij,mj->im", T[:, :3, :3], local) + T[:, :3, 3].T

    motion_of_points = motion.select(pose)
    path = chain.walk(model, motion_of_points.q)
    found = replace(found, coefficients=np.zeros(len(found.terms)))
    J = found.model.columns(path, lambda: found.model.values(motion_of_points), points(found.coefficients))
    rng = np.random.default_rng(2)
    for _ in range(6):  # in random directions of all coefficients together
        step = np.array([t.size for t in found.terms]) * rng.standard_normal(len(found.terms))
        numeric = central_differences(
            lambda s, step=step: points(found.coefficients + s[0] * step).ravel(), [0.0], 1e-2
        )
        expected = numeric.reshape(3, -1)
        assert np.abs(np.einsum("kcm,k->cm", J, step) - expected).max() < 1e-8 * np.abs(expected).max()


def test_jacobian_by_joints_and_inverse():
    model = arm("irb120")
    found = random_map(model, families_left_out=("geometry", "gear", "warm_up", "payload"))
    q = some_joints(1)[0]
    numeric = central_differences(lambda x: found.effective(motion_at(x))[0], q, 1e-4)
    np.testing.assert_allclose(found.jacobian(motion_at(q))[0], numeric, atol=1e-8)
    joints = some_joints(50, 6)
    theta = found.effective(Motion(joints, joints - PREVIOUS))
    back = JointMap(found.select(False)).commanded(theta, np.tile(PREVIOUS, (50, 1)))
    assert np.abs(back - joints).max() < 1e-12
    assert np.abs(theta - joints).max() > 1e-5


def test_rates_of_the_jacobian():
    model = arm("irb120")
    found = random_map(model, families_left_out=("geometry", "gear"))
    q = some_joints(1, 9)[0]
    numeric = central_differences(
        lambda s: found.jacobian(motion_at(q + s[0] * SPEEDS)).ravel(), np.zeros(1), 1e-4
    ).reshape(6, 6)
    rates = found.jacobian_derivative(motion_at(q), SPEEDS[None])[0]
    np.testing.assert_allclose(rates, numeric, rtol=0, atol=1e-8)
    assert np.abs(rates).max() > 1e-4


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.floats(0.0, 1.5), st.booleans())
def test_commanded_is_the_inverse_of_effective(seed, scale, history):
    model = arm("irb120")
    rng = np.random.default_rng(seed)
    terms = tuple(t for name in ("gain", "gravity", "direction", "move") for t in families()[name].terms(model))
    found = TermMap(model, terms, scale * np.array([t.size for t in terms]) * rng.standard_normal(len(terms)))
    q, previous = model.random_joints(3, seed), model.random_joints(3, seed + 1) if history else None
    theta = found.effective(Motion(q, q - previous if history else None))
    assert np.abs(JointMap(found).commanded(theta, previous) - q).max() < 1e-11


def test_blocks_of_poses_give_the_same(monkeypatch):
    model = arm("irb120")
    found, motion = random_map(model), motion_at(some_joints(7))
    whole = found.forward(model, motion), found.jacobian(motion), found.jacobian_derivative(motion, motion.q)
    monkeypatch.setattr(term_map, "BLOCK", 3)
    parts = found.forward(model, motion), found.jacobian(motion), found.jacobian_derivative(motion, motion.q)
    for a, b in zip(whole, parts, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)


def test_a_prismatic_joint_of_a_map(tmp_path):
    model = rail(tmp_path)
    terms = tuple(t for name in ("gain", "direction", "move") for t in families()[name].terms(model))
    found = TermMap(model, terms, np.array([t.size for t in terms]))
    assert not found.has_frame_terms
    q = np.c_[[0.5, 1.5], some_joints(2)]
    motion = Motion(q, 0.1 * np.ones((2, 7)))
    shift = found.effective(motion) - q
    values = values_of([t for t in terms if t.joint == 0], model, motion)
    sizes = np.array([t.size for t in terms if t.joint == 0])
    np.testing.assert_allclose(shift[:, 0], sizes @ values, rtol=0, atol=1e-15)


def test_maps_are_written_and_read():
    model = arm("irb120")
    found = random_map(model)
    motion = motion_at(some_joints(3))
    again = TermMap.of_entries(model, json.loads(json.dumps(found.entries())))
    assert again.terms == found.terms
    for one, other in zip(again.split(motion), found.split(motion), strict=True):
        np.testing.assert_array_equal(one, other)


def test_maps_are_locked_and_pickled():
    found = random_map(arm("irb120"))
    with pytest.raises(ValueError, match="read-only"):
        found.coefficients[0] = 1.0
    motion = motion_at(some_joints(2))
    again = pickle.loads(pickle.dumps(found))
    for one, other in zip(again.split(motion), found.split(motion), strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_not_a_term_is_refused():
    model = arm("irb120")
    with pytest.raises(RobotError, match="not a term"):
        Term.from_json({"joint": 1, "axis": "rz", "basis": "cos"})
    with pytest.raises(RobotError, match="axis"):
        Term(0, "rw", "cos", 1.0, "", "")
    with pytest.raises(RobotError, match="unknown basis"):
        TermMap(model, (Term(0, "rz", "magic", 1.0, "", ""),), np.ones(1)).effective(Motion(np.zeros((1, 6))))
    with pytest.raises(RobotError, match="as many coefficients"):
        TermMap(model, tuple(WOBBLE.terms(model)), np.ones(3))


def test_joint_map_and_frame_terms_are_told_apart():
    model = arm("irb120")
    found = random_map(model)
    assert found.has_frame_terms
    assert not found.select(frame_terms=False).has_frame_terms
    assert {t.axis for t in found.select(frame_terms=False).terms} == {"rz"}
    assert {t.axis for t in found.select(frame_terms=True).terms} == set(AXES) - {"rz"}
    motion = motion_at(some_joints(2))
    effective, none = found.select(frame_terms=False).split(motion)
    commanded, xi = found.select(frame_terms=True).split(motion)
    assert none is None
    np.testing.assert_array_equal(commanded, motion.q)
    np.testing.assert_allclose(effective, found.split(motion)[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(xi, found.split(motion)[1], rtol=0, atol=1e-15)
