"""Terms against hand calculation and central differences; kinematics with frame terms against products of matrices."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import arm, central_differences

from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import bases, chain, families
from irbcal.modeling.terms.bending import FAMILY as BENDING
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.payload import STANDARD_GRAVITY, Payload
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import AXES, Term
from irbcal.modeling.terms.term_map import TermMap, basis_slope_rates, basis_slopes, basis_values
from irbcal.modeling.terms.warm_up import WarmUp

PREVIOUS = np.array([0.3, -0.2, 0.4, 1.0, -0.5, 0.2])


def motion_at(q):
    q = np.atleast_2d(q)
    n = len(q)
    return Motion(q, q - PREVIOUS, 3.0 + np.arange(n), np.full(n, 2.5))


def every_term(model):
    terms = [t for family in families().values() for t in family.terms(model) if family.name != "harmonics"]
    terms += [t for t in families()["harmonics"].terms(model) if t.parameters["cycles_per_turn"] in (1, 2, 7)]
    return [*terms, *gear_terms(3, 242), *WarmUp(20.0).terms(model), *Payload((0.1, -0.05, 0.2)).terms(model)]


def some_joints(n=4, seed=3):
    return arm("irb120").random_joints(n, seed)


def test_families_are_found_and_have_as_many_terms_as_counted_by_hand():
    model = arm("irb120")
    assert {"geometry", "gain", "gravity", "bending", "harmonics", "direction", "move"} <= set(families())
    assert {"warm_up", "wobble", "gear", "payload", "thesis"} <= set(families())
    counts = {name: len(family.terms(model)) for name, family in families().items()}
    # gravity: none about the vertical axis 1; each link adds two to each axis below it, parallel axes share them
    assert counts["gravity"] == 2 + 4 + 6 + 8 + 10
    assert counts["geometry"] == 30
    assert counts["harmonics"] == 6 * 2 * 45
    assert counts["wobble"] == 6 * 5 * 4
    assert counts["warm_up"] == 36
    assert counts["bending"] == 73
    assert counts["thesis"] == 6
    assert counts["gear"] == 0


def test_names_of_terms_are_unique():
    terms = [t for t in every_term(arm("irb120")) if t.family not in ("thesis", "gear")]
    terms = [t for t in terms if not (t.basis == "decay" and t.parameters["tau"] == 20.0)]
    terms = [t for t in terms if t.parameters.get("place") != (0.1, -0.05, 0.2)]
    assert len({t.name for t in terms}) == len(terms)


def test_every_basis_agrees_with_central_differences():
    model = arm("irb120")
    terms = every_term(model)
    assert {t.basis for t in terms} == set(bases())
    q = some_joints(1)[0]
    slopes = basis_slopes(terms, Situation(model, motion_at(q)))[:, 0]
    numeric = central_differences(lambda x: basis_values(terms, Situation(model, motion_at(x)))[:, 0], q, 1e-5)
    scale = np.maximum(np.abs(numeric).max(axis=1), 1.0)
    assert (np.abs(slopes - numeric).max(axis=1) / scale).max() < 1e-6
    moved = {t.basis for t, row in zip(terms, numeric, strict=True) if np.abs(row).max() > 1e-6}
    assert moved >= set(bases()) - {"constant", "decay", "direction"}  # these moves are far beyond the play
    near = Motion(PREVIOUS + 1e-3, np.full((1, 6), 1e-3))
    play = families()["direction"].terms(model)
    inside = basis_slopes(play, Situation(model, near))[:, 0]
    width = np.radians(0.5)
    np.testing.assert_allclose(np.diag(inside), (1 - np.tanh(1e-3 / width) ** 2) / width, rtol=1e-12)


def test_slope_rates_agree_with_central_differences():
    model = arm("irb120")
    terms = every_term(model)
    q, dq = some_joints(1, 8)[0], np.array([0.4, -0.8, 0.3, 1.1, -0.6, 0.9])
    rates = basis_slope_rates(terms, Situation(model, motion_at(q)), dq[None])[:, 0]
    numeric = central_differences(
        lambda s: basis_slopes(terms, Situation(model, motion_at(q + s[0] * dq)))[:, 0].ravel(), np.zeros(1), 1e-5
    ).reshape(rates.shape)
    scale = np.maximum(np.abs(numeric).max(axis=1), 1.0)
    assert (np.abs(rates - numeric).max(axis=1) / scale).max() < 1e-6
    assert np.abs(numeric).max() > 0.1


def test_gravity_of_a_mass_by_hand():
    # a mass along the upper arm of the IRB 120 weighs on axis 2 (along y) with the sine of joint 2
    model = arm("irb120")
    q = np.zeros((3, 6))
    q[:, 1] = [0.0, 0.5, -1.1]
    term = families()["thesis"].terms(model)[0]
    values = basis_values([term], Situation(model, Motion(q)))[0]
    np.testing.assert_allclose(values, np.sin(q[:, 1]), atol=1e-12)
    # torque of a mass m at p about an axis z through o is z . ((p - o) x m g): here of 3 kg at the tool
    load = Payload().terms(model)[1]
    tip = model.forward(q)[:, :3, 3]
    torque = basis_values([load], Situation(model, Motion(q, payload_kg=np.full(3, 3.0))))[0]
    np.testing.assert_allclose(torque, 3.0 * STANDARD_GRAVITY * tip[:, 0], atol=1e-9)  # axis 2 stands above the origin


def test_gravity_terms_are_the_torques_of_masses_on_links():
    # any mass anywhere on link 5 loads axis 3 with a sum of gravity terms of joint 3 and a constant
    model = arm("irb120")
    q = model.random_joints(60, 4)
    here = Situation(model, Motion(q))
    place = np.array([0.03, -0.2, 0.11])
    p = np.einsum("a,acn->cn", place, here.after[4]) + here.origins[4]
    torque = np.einsum("cn,cn->n", here.before[2, 2], np.cross((p - here.origins[2]).T, [0.0, 0.0, -1.0]).T)
    terms = [t for t in families()["gravity"].terms(model) if t.joint == 2]
    basis = np.vstack([basis_values(terms, here), np.ones(len(q))])
    left = torque - basis.T @ np.linalg.lstsq(basis.T, torque, rcond=None)[0]
    assert np.abs(left).max() < 1e-12 < np.abs(torque).max()


@pytest.mark.parametrize("name", ["irb120", "irb1600"])
def test_thesis_terms_are_the_joint_map_of_the_thesis(name):
    model = arm(name)
    phases, _ = model.stiffness_geometry()
    q = model.random_joints(20, 5)
    coefficients = 1e-3 * np.array([1.0, -0.7, 0.4, 0.3, -0.2, 0.6])
    A, B, a_1, b_1, a_2, b_2 = coefficients
    expected = JointMap(stiffness=[A, B], phases=phases, fourier=[a_1, b_1, a_2, b_2])
    found = TermMap(model, tuple(families()["thesis"].terms(model)), coefficients)
    np.testing.assert_allclose(found.effective(Motion(q)), expected.effective(q), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.jacobian(Motion(q)), expected.jacobian(q), rtol=0, atol=1e-15)


def random_map(model, seed=1, families_left_out=("geometry",)):
    terms = tuple(t for t in every_term(model) if t.family not in families_left_out)
    rng = np.random.default_rng(seed)
    return TermMap(model, terms, 0.3 * np.array([t.size for t in terms]) * rng.standard_normal(len(terms)))


def test_forward_kinematics_is_the_product_of_transforms():
    model = arm("irb120")
    found = random_map(model)
    motion = motion_at(some_joints(5))
    effective, xi = found.split(motion)
    assert np.abs(xi).max() > 1e-5
    expected = np.empty((5, 4, 4))
    for n in range(5):
        T = np.array(model.T_base_0)
        for i in range(6):
            row = model.table
            T = T @ frames.transform(frames.rot_x(row.alpha[i])) @ frames.transform(None, [row.a[i], 0, 0])
            T = T @ frames.transform(frames.rot_y(row.beta[i]), [0, row.b[i], 0])
            T = (
                T
                @ frames.transform(None, xi[n, i, 3:])
                @ frames.transform(Rotation.from_rotvec(xi[n, i, :3]).as_matrix())
            )
            T = T @ frames.transform(frames.rot_z(row.theta[i] + effective[n, i]), None)
            T = T @ frames.transform(None, [0, 0, row.d[i]])
        expected[n] = T @ model.T_last_tip
    np.testing.assert_allclose(found.forward(model, motion), expected, rtol=0, atol=1e-14)


def test_jacobian_of_points_by_coefficients():
    model = arm("irb120")
    found = random_map(model)
    motion = motion_at(some_joints(3))
    pose, local = np.array([0, 0, 1, 2]), np.array([[0.1, 0.02, 0.05], [0, 0.1, 0.1], [0.1, 0.02, 0.05], [-0.1, 0, 0]])

    def points(c):
        T = TermMap(model, found.terms, c).forward(model, motion)[pose]
        return np.einsum("mij,mj->im", T[:, :3, :3], local) + T[:, :3, 3].T

    path = chain.walk(model, *found.split(motion))
    J = found.point_jacobian(path, points(found.coefficients), pose, motion)
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
    back = found.commanded(theta, np.tile(PREVIOUS, (50, 1)))
    assert np.abs(back - joints).max() < 1e-12
    assert np.abs(theta - joints).max() > 1e-5


def test_warm_up_is_zero_at_use():
    model = arm("irb120")
    terms = tuple(WarmUp(20.0).terms(model))
    found = TermMap(model, terms, np.ones(len(terms)))
    assert not found.motions(Motion(some_joints(2))).any()
    first = found.motions(Motion(some_joints(2), elapsed=np.array([0.0, 20.0])))
    np.testing.assert_allclose(first[1], first[0] / np.e)


def test_maps_are_written_and_read():
    model = arm("irb120")
    found = random_map(model)
    motion = motion_at(some_joints(3))
    entry = json.loads(json.dumps(found.to_json(np.array([[-1.0] * 6, [1.0] * 6]), motion)))
    assert entry["schema"] == "irbcal-joint-map-2"
    assert entry["inputs"] == ["q", "previous_q", "payload_kg"]
    again = TermMap.from_json(model, entry)
    assert again.terms == found.terms
    np.testing.assert_array_equal(again.motions(motion), found.motions(motion))
    vector = entry["test_vectors"][1]
    q, before = np.array([vector["q"]]), np.array([vector["previous_q"]])
    cold = TermMap(model, found.terms, np.where([t.basis == "decay" for t in found.terms], 0.0, found.coefficients))
    at = Motion(q, q - before, payload_kg=np.array([vector["payload_kg"]]))
    assert np.abs(cold.effective(at) - vector["effective"]).max() < 1e-12


def test_what_is_not_a_term_is_refused():
    model = arm("irb120")
    with pytest.raises(RobotError, match="schema"):
        TermMap.from_json(model, {"schema": "irbcal-joint-map-1", "terms": []})
    with pytest.raises(RobotError, match="not a term"):
        Term.from_json({"joint": 1, "axis": "rz", "basis": "cos"})
    with pytest.raises(RobotError, match="axis"):
        Term(0, "rw", "cos", 1.0, "", "")
    with pytest.raises(RobotError, match="unknown basis"):
        TermMap(model, (Term(0, "rz", "magic", 1.0, "", ""),), np.ones(1)).effective(Motion(np.zeros((1, 6))))
    with pytest.raises(RobotError, match="finite"):
        Motion(np.zeros((2, 6)), np.full((2, 6), np.nan))


def test_joint_map_and_frame_terms_are_told_apart():
    model = arm("irb120")
    found = random_map(model)
    assert found.has_frame_terms
    assert not found.part(frame_terms=False).has_frame_terms
    assert {t.axis for t in found.part(frame_terms=False).terms} == {"rz"}
    assert {t.axis for t in found.part(frame_terms=True).terms} == set(AXES) - {"rz"}
    assert {t.axis for t in BENDING.terms(model)} == {"rx", "ry"}
