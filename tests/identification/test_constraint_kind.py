import numpy as np
import pytest

from irbcal.identification import observation_kind as kind
from irbcal.modeling import frames


def test_unknowns_step_and_stay_what_they_are():
    Q = frames.rotation_from_vector(np.array([0.3, -0.2, 0.9]))
    np.testing.assert_allclose(kind.moved("place", np.ones(3), np.array([1.0, 2.0, 3.0])), [2, 3, 4])
    turned = kind.moved("turn", Q, np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(turned, frames.rot_x(0.1)[:3, :3] @ Q, atol=1e-15)
    axis = kind.moved("axis", Q, np.array([0.1, 0.2]))
    np.testing.assert_allclose(axis.T @ axis, np.eye(3), atol=1e-14)
    assert axis[:, 2] @ Q[:, 2] == pytest.approx(np.cos(np.hypot(0.1, 0.2)))
    line = kind.moved("line", np.column_stack([Q, np.zeros(3)]), np.array([0.0, 0.0, 0.5, 0.0]))
    np.testing.assert_allclose(line[:, 3], 0.5 * Q[:, 0])


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
    np.testing.assert_allclose(np.abs(null @ x), np.linalg.norm(null) * np.linalg.norm(x))
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
        ends = [kind.vectors((frames.rotation_from_vector(h * np.eye(3)[k]) @ E)[None])[0] for h in (1e-6, -1e-6)]
        np.testing.assert_allclose(left[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)
