"""Motions and the attitude of the links in them."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import arm, central_differences
from term_cases import motion_at, some_joints

from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.terms.situation import Motion, Situation


def test_attitudes_are_those_of_products_of_matrices():
    model = arm("irb120")
    q = some_joints(3)
    here = Situation(model, Motion(q))
    for n in range(3):
        T = np.array(model.T_base_0)
        for i in range(6):
            row = model.table
            T = T @ frames.transform(frames.rot_x(row.alpha[i])) @ frames.transform(None, [row.a[i], 0, 0])
            T = T @ frames.transform(frames.rot_y(row.beta[i]), [0, row.b[i], 0])
            np.testing.assert_allclose(here.axes_before_joint[i, :, :, n].T, T[:3, :3], rtol=0, atol=1e-14)
            T = T @ frames.transform(frames.rot_z(row.theta[i] + q[n, i]), None)
            T = T @ frames.transform(None, [0, 0, row.d[i]])
            np.testing.assert_allclose(here.axes_after_joint[i, :, :, n].T, T[:3, :3], rtol=0, atol=1e-14)
            np.testing.assert_allclose(here.origins[i, :, n], T[:3, 3], rtol=0, atol=1e-14)
        T = model.forward(q[n : n + 1])[0]
        np.testing.assert_allclose(here.tip[:, :, n], [*T[:3, :3].T, T[:3, 3]], rtol=0, atol=1e-14)


def test_spin_is_how_fast_the_frames_turn():
    model, dq = arm("irb120"), np.array([0.4, -0.8, 0.3, 1.1, -0.6, 0.9])
    q = some_joints(1)[0]
    here = Situation(model, Motion(q))
    spin = here.spin(dq[None])
    numeric = central_differences(
        lambda s: Situation(model, Motion(q + s[0] * dq)).axes_before_joint[..., 0].ravel(), np.zeros(1), 1e-4
    ).reshape(6, 3, 3)
    found = np.cross(spin[:6, None, :, 0], here.axes_before_joint[..., 0])
    np.testing.assert_allclose(found, numeric, rtol=0, atol=1e-10)
    assert not spin[0].any()
    np.testing.assert_allclose(spin[-1] - spin[-2], here.turning[-1] * dq[-1], atol=1e-15)


@given(st.lists(st.sampled_from("ab"), min_size=1, max_size=12), st.integers(0, 1000))
def test_moves_in_order_lead_from_stop_to_stop(groups, seed):
    groups = np.array(groups, dtype=object)
    q = np.random.default_rng(seed).normal(size=(len(groups), 3))
    motion = Motion.in_order(q, groups=groups)
    for n in range(len(q)):
        known = n > 0 and groups[n] == groups[n - 1]
        np.testing.assert_array_equal(motion.moves[n], q[n] - q[n - 1] if known else 0.0)
    np.testing.assert_array_equal(motion.elapsed, np.arange(len(q)))


def test_a_shifted_situation_keeps_the_stop_before():
    motion = motion_at(some_joints(2))
    here = Situation(arm("irb120"), motion).shifted(np.full((2, 6), 0.1))
    np.testing.assert_allclose(here.motion.q - here.motion.moves, motion.q - motion.moves, rtol=0, atol=1e-15)
    np.testing.assert_allclose(here.motion.q, motion.q + 0.1, rtol=0, atol=1e-15)


def test_parts_of_a_motion_keep_their_history():
    motion = motion_at(some_joints(5))
    part = motion.select(np.array([True, False, True, False, False]))
    assert len(part) == 2
    for name in ("q", "move", "elapsed"):
        np.testing.assert_array_equal(getattr(part, name), getattr(motion, name)[[0, 2]])
    assert list(part.inputs) == ["payload_kg", "torques"]
    for name, values in part.inputs.items():
        np.testing.assert_array_equal(values, motion.inputs[name][[0, 2]])
    assert Motion(motion.q).select(slice(0, 2)).move is None


def test_motions_are_locked_and_pickled():
    motion = motion_at(some_joints(2))
    with pytest.raises(ValueError, match="read-only"):
        motion.q[0] = 1.0
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(again.moves, motion.moves)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"move": np.full((2, 6), np.nan)}, "move needs finite"),
        ({"move": np.zeros((1, 6))}, "move"),
        ({"elapsed": np.zeros(3)}, "elapsed"),
        ({"inputs": {"payload_kg": np.array([1.0, np.inf])}}, "payload_kg"),
    ],
)
def test_what_does_not_fit_is_refused(options, what):
    with pytest.raises(RobotError, match=what):
        Motion(np.zeros((2, 6)), **options)
