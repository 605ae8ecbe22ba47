"""The joint map against hand calculation, central differences and the printed stiffness equations."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, central_differences

from irbcal.modeling.jointmap import JointMap, Stiffness

MAP = JointMap(
    gain=[1e-3, -2e-3, 5e-4, 0, 1e-4, -3e-4],
    stiffness=[2e-3, 1e-3],
    fourier=[-3.73e-4, -7.5e-4, -9.56e-4, -2.44e-4],
)


def test_effective_angles_by_hand():
    q = np.radians([[10, 90, -90, 40, 50, 60]])
    found = MAP.effective(q)[0]
    r = np.radians
    c60, s60, c120, s120 = 0.5, np.sqrt(3) / 2, -0.5, np.sqrt(3) / 2
    expected = [
        r(10) * 1.001,
        r(90) * 0.998 + 2e-3 * 1 + 1e-3 * 1,  # sin 90 = 1, cos(90 - 90) = 1
        r(-90) * 1.0005 + 1e-3,
        r(40),
        r(50) * 1.0001,
        r(60) * 0.9997 - 3.73e-4 * c60 - 7.5e-4 * s60 - 9.56e-4 * c120 - 2.44e-4 * s120,
    ]
    assert np.abs(found - expected).max() < 1e-15


def test_stiffness_is_that_of_eqs_5_9_to_5_15():
    """delta theta = k T with T2 = F1 d1 + F2 d2', T3 = F2 d2 and m = F2 / F1, worked through directly."""
    k, F1, m = 3e-6, 250.0, 1.3
    L_1, L_G1, L_G2 = 0.7, 0.31, 0.42
    q2, q3 = 0.6, -0.9
    d1 = L_G1 * np.sin(q2)
    d2 = L_G2 * np.sin(q2 + q3 + np.pi / 2)
    d2_prime = L_1 * np.sin(q2) + d2
    F2 = m * F1
    A = k * F1 * (L_G1 + m * L_1)
    B = m * k * F1 * L_G2
    q = np.array([[0, q2, q3, 0, 0, 0.0]])
    change = JointMap(stiffness=[A, B]).effective(q)[0] - q[0]
    assert abs(change[1] - k * (F1 * d1 + F2 * d2_prime)) < 1e-15
    assert abs(change[2] - k * F2 * d2) < 1e-15


def test_deflection_of_the_stretched_arm_is_delta_L():
    """With q2 = 90 and q3 = -90 degrees the arm's end sinks by about delta_L (eqs. 5.16 to 5.18)."""
    stiffness = Stiffness.guess(0.7, 0.6)
    A, B = stiffness.coefficients
    sag = 0.7 * (A + B) + 0.6 * (A + B + B)  # upper arm turns by dtheta2, forearm by dtheta2 + dtheta3
    assert abs(sag - 1.5e-3) < 1e-8


@given(st.floats(-0.01, 0.01).filter(lambda v: abs(v) > 1e-6), st.floats(-0.01, 0.01))
def test_physical_stiffness_comes_back_from_its_coefficients(A, B):
    found = Stiffness.guess(0.7, 0.6).with_coefficients(A, B)
    if found is not None:
        assert np.abs(np.array(found.coefficients) - (A, B)).max() < 1e-12
        assert found.m == 1.0
        assert found.L_G1 == 0.35


def test_forearm_term_alone_has_no_physical_reading():
    guess = Stiffness.guess(0.7, 0.6)
    assert guess.with_coefficients(0.0, 1e-3) is None
    assert guess.with_coefficients(0.0, 0.0).delta_L == 0.0


def test_jacobian_agrees_with_central_differences():
    for q in np.random.default_rng(0).uniform(-6, 6, (20, 6)):
        numeric = central_differences(lambda x: MAP.effective(x[None])[0], q, 1e-3)
        assert np.abs(MAP.jacobian(q[None])[0] - numeric).max() < 1e-11


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_inverse_gives_the_command_back(seed):
    rng = np.random.default_rng(seed)
    joint_map = JointMap(
        0.01 * rng.normal(size=6), 0.01 * rng.normal(size=2), (0.0, np.pi / 2), 0.01 * rng.normal(size=4)
    )
    q = rng.uniform(-7, 7, (100, 6))
    theta = joint_map.effective(q)
    assert np.abs(joint_map.effective(joint_map.commanded(theta)) - theta).max() < 2e-15 * 4
    assert np.abs(joint_map.commanded(theta) - q).max() < 1e-13


def test_identity_and_empty_batch():
    q = np.random.default_rng(1).normal(size=(4, 6))
    assert np.array_equal(JointMap().effective(q), q)
    assert np.array_equal(JointMap().commanded(q), q)
    assert MAP.commanded(np.zeros((0, 6))).shape == (0, 6)


def test_a_map_that_folds_back_is_refused():
    with pytest.raises(ValueError, match="cannot be inverted"):
        JointMap(gain=[0, 0, 0, 0, 0, -1.0]).commanded(np.ones((2, 6)))


def test_map_does_not_change_its_input():
    q = np.ones((3, 6))
    MAP.effective(q)
    assert json.dumps(q.tolist()) == json.dumps(np.ones((3, 6)).tolist())


@pytest.mark.parametrize(("name", "lengths"), [("irb1600", (0.7, 0.6)), ("irb120", (0.27, np.hypot(0, 0.302)))])
def test_arm_lengths_and_directions_of_the_shipped_robots(name, lengths):
    phases, stiffness = arm(name).stiffness_geometry()
    assert np.abs(phases - [0, np.pi / 2]).max() < 1e-12
    assert abs(stiffness.L_1 - lengths[0]) < 1e-12
    assert abs(stiffness.L_2 - lengths[1]) < 1e-12
    assert stiffness.m == 1.0
