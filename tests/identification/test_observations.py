"""Tests."""

from dataclasses import replace

import feature_cases as cases
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from irbcal.identification import observation_kind
from irbcal.identification import observation_kind as kind
from irbcal.identification.feature_problem import FeatureProblem, start
from irbcal.identification.observation_kind import DIMENSIONS, Observed
from irbcal.identification.observations import KINDS
from irbcal.measurement.features import Feature
from irbcal.measurement.imaging import CAMERA_KINDS, FITTED, POINTS, TARGETS, Imaging
from irbcal.modeling import frames
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY

STEP = 1e-6


def some(kind, seed=0):
    """Rows that miss their feature by centimetres, and its unknowns."""
    rng = np.random.default_rng(seed)
    turns = np.array([frames.rotation_from_vector(w) for w in rng.standard_normal((4, 3))])
    seen = Observed(
        Feature("f", kind),
        rng.standard_normal((4, 3)),
        turns,
        rng.uniform(0.1, 0.4, 4),
        rng.standard_normal((4, 3)),
        np.array([frames.rotation_from_vector(w) for w in rng.standard_normal((4, 3))]),
    )
    own = cases.unknowns(kind, rng)
    if kind not in CAMERA_KINDS:
        return seen, own
    if kind in POINTS:
        y = np.column_stack([rng.uniform(-0.4, 0.4, (4, 2)), rng.uniform(0.8, 2.0, 4)])
        seen = before_it(seen, own, y)
        corners = np.full((4, 1, 5), 0.2)
        corners[:, 0, 2:4] = cases.in_image(cases.LENS_OF, y) + rng.uniform(-20.0, 20.0, (4, 2))
        return replace(
            seen, feature=Feature("f", kind, imaging=Imaging(np.array(cases.LENS_OF), FITTED)), corners=corners
        ), own
    # images are reduced to as many residuals as they tell: their derivatives are exact where corners fit
    before = [own["centre"] + rng.uniform(-0.1, 0.1, 3) - own["attitude"][:, 2] * 0.9 for _ in range(4)]
    facing = [own["attitude"] @ frames.rotation_from_vector(0.2 * rng.standard_normal(3)) for _ in range(4)]
    if kind == "image":  # the board before the camera
        before = [2.0 * own["centre"] - p for p in before]
    R = np.array(facing) @ own["axes"].T
    corners = np.full((4, len(cases.corners()), 5), 0.2)
    corners[:, :, :2] = cases.corners()[:, :2]
    corners[:, :, 2:4] = cases.in_image(cases.LENS_OF, cases.before_camera(kind, np.array(before), R, own))
    corners[1, 20:] = np.nan
    corners[2, ::2, 4] = 0.3
    feature = Feature("f", kind, imaging=Imaging(np.array(cases.LENS_OF), FITTED))
    return replace(seen, feature=feature, p=np.array(before), R=R, corners=corners), own


def before_it(seen, own, y):
    """Rows whose point is at places in camera axes."""
    if "attitude" in own:
        return replace(seen, p=own["centre"] + y @ own["attitude"].T)
    return replace(seen, p=own["centre"] - np.einsum("mij,mj->mi", seen.R @ own["axes"], y))


def moved(seen, p=0.0, turn=None):
    R = seen.R if turn is None else frames.rotation_from_vector(turn) @ seen.R
    return replace(seen, p=seen.p + p, R=R)


def slope(function, size):
    return np.stack([(function(h) - function(-h)) / (2 * STEP) for h in STEP * np.eye(size)], axis=-1)


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_are_those_of_central_differences(name):
    kind, (seen, own) = KINDS[name], some(name)
    found = kind.residuals(seen, own)
    size = kind.size + (len(kind.priors(seen.feature)) if name in TARGETS else 0)
    assert found.r.shape == (4, size)
    np.testing.assert_allclose(found.point, slope(lambda h: -kind.residuals(moved(seen, h), own).r, 3), atol=1e-8)
    turn = np.zeros((4, size, 3)) if found.turn is None else found.turn
    np.testing.assert_allclose(turn, slope(lambda h: -kind.residuals(moved(seen, turn=h), own).r, 3), atol=1e-8)
    for key, item in kind.unknowns.items():

        def after(h, key=key, item=item):
            return -kind.residuals(seen, own | {key: observation_kind.moved(item.shape, own[key], h)}).r

        np.testing.assert_allclose(found.by_unknown[key], slope(after, DIMENSIONS[item.shape]), atol=1e-8, err_msg=key)


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if "value" in kind.needs])
def test_residuals_grow_with_what_is_measured(name):
    kind, (seen, own) = KINDS[name], some(name)
    more = kind.residuals(replace(seen, value=seen.value + STEP), own).r - kind.residuals(seen, own).r
    assert (more[:, -1] / kind.lever > 0.01 * STEP).all()


@pytest.mark.parametrize("name", KINDS)
def test_truth_without_noise_is_found_without_a_guess(name):
    """The oracle is the arm that the rows were made with; kinds that tell no lengths get one with errors of angles."""
    metric, nominal = KINDS[name].metric, cases.arm()
    truth = cases.true_arm(nominal, 1, lengths=metric)
    terms = [term for term in GEOMETRY.terms(nominal) if metric or term.axis[0] == "r"]
    problem = FeatureProblem(nominal, cases.seen(name, truth, 20 if name in TARGETS else 60), terms)
    state = start(problem)
    assert problem.distances(state).max() > 0.5e-3  # of the nominal robot
    for _ in range(8):
        blocks = list(problem.dense(state))
        J, y = np.concatenate([b.J for b in blocks], axis=1), np.concatenate([b.y for b in blocks])
        state = problem.moved(state, np.linalg.lstsq(J.T, y, rcond=1e-10)[0])
    assert problem.distances(state).max() < 1e-9
    q = nominal.random_joints(100, 5) * 0.8
    if KINDS[name].pointed:
        assert cases.apart(truth, problem.arm_at(state), q, state.values["tool", "ball"]).max() < 1e-9
        assert cases.apart(truth, nominal, q).max() > 1e-3
        return
    axis = cases.unknowns(name, np.random.default_rng(0))
    true = np.einsum("mij,j,i->m", cases.tip(truth, q)[1], axis["axis"][:, 2], axis["up"][:, 2])
    R = cases.tip(problem.arm_at(state), q)[1]
    found = np.einsum("mij,j,i->m", R, state.values["axis", "ball"][:, 2], state.values["up", "angle 0"][:, 2])
    np.testing.assert_allclose(np.arcsin(found), np.arcsin(true), atol=1e-9)


@pytest.mark.parametrize("name", ["point", "sphere", "radius", "plane", "line", "gauge"])
def test_the_tool_is_told_in_closed_form(name):
    """Tips from places on the feature, each with a turn of its own: p = place - R t."""
    rng = np.random.default_rng(3)
    t, centre, n = np.array([0.03, -0.02, 0.15]), np.array([0.8, 0.2, 0.5]), np.array([2.0, -1.0, 2.0]) / 3.0
    R = np.array([frames.rotation_from_vector(w) for w in rng.standard_normal((60, 3))])
    away, value = rng.uniform(-0.2, 0.2, (60, 3)), rng.uniform(0.1, 0.4, 60)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    place = {
        "point": np.tile(centre, (60, 1)),
        "sphere": centre + 0.025 * away / length,
        "radius": centre + value[:, None] * away / length,
        "plane": centre + away - np.outer(away @ n, n),
        "line": centre + np.outer(away[:, 0], n),
        "gauge": centre + away - np.outer(away @ n - value, n),
    }[name]
    tips = place - np.einsum("mij,j->mi", R, t)
    closed = KINDS[name].tool(Observed(Feature("f", name), tips, R, value, place, R))
    np.testing.assert_allclose(closed[0], t, atol=1e-10)


def test_unknowns_step_and_stay_what_they_are():
    Q = frames.rotation_from_vector(np.array([0.3, -0.2, 0.9]))
    np.testing.assert_allclose(
        kind.moved("place", np.ones(3), np.array([1.0, 2.0, 3.0])), [2, 3, 4], rtol=0, atol=1e-12
    )
    turned = kind.moved("turn", Q, np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(turned, frames.rot_x(0.1)[:3, :3] @ Q, atol=1e-15)
    axis = kind.moved("axis", Q, np.array([0.1, 0.2]))
    np.testing.assert_allclose(axis.T @ axis, np.eye(3), atol=1e-14)
    assert axis[:, 2] @ Q[:, 2] == pytest.approx(np.cos(np.hypot(0.1, 0.2)))
    line = kind.moved("line", np.column_stack([Q, np.zeros(3)]), np.array([0.0, 0.0, 0.5, 0.0]))
    np.testing.assert_allclose(line[:, 3], 0.5 * Q[:, 0], rtol=0, atol=1e-12)


def test_a_ball_and_a_null_vector_are_found():
    rng = np.random.default_rng(0)
    n = rng.standard_normal((20, 3))
    centre = np.array([0.8, -0.2, 0.4])
    found, rest = kind.ball(centre + 0.05 * n / np.linalg.norm(n, axis=1)[:, None])
    np.testing.assert_allclose(found, centre, atol=1e-12)
    assert np.sqrt(found @ found - rest) == pytest.approx(0.05)
    x = np.array([1.0, -2.0, 0.5])
    A = rng.standard_normal((10, 3))
    A -= np.outer(A @ x, x) / (x @ x)
    null = kind.null(A)
    np.testing.assert_allclose(np.abs(null @ x), np.linalg.norm(null) * np.linalg.norm(x), rtol=1e-9)
    assert kind.null(A[:, :2] @ np.ones((2, 3))) is None


def test_what_is_not_told_is_not_eliminated():
    rng = np.random.default_rng(0)
    R = np.array([frames.rotation_from_vector(w) for w in rng.standard_normal((8, 3))])
    t, c = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    found, _ = kind.eliminated(R, [-kind.ones(8)], R @ t - c)
    np.testing.assert_allclose(found, t, atol=1e-12)
    assert kind.eliminated(np.tile(R[:1], (8, 1, 1)), [-kind.ones(8)], R @ t) is None


def test_the_inverse_left_jacobian_is_that_of_central_differences():
    e = np.array([0.4, -0.7, 0.2])
    E = frames.rotation_from_vector(e)
    left = kind.left_inverse(e[None])[0]
    for k in range(3):
        ends = [
            Rotation.from_matrix(frames.rotation_from_vector(h * np.eye(3)[k]) @ E).as_rotvec() for h in (1e-6, -1e-6)
        ]
        np.testing.assert_allclose(left[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)
