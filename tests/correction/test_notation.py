"""Numbers of programs: what is written, and what comes back."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support import arm

from irbcal.correction import notation
from irbcal.correction.languages import fanuc, inform, kawasaki, krl, urscript, val3
from irbcal.correction.notation import number_text, numbers_from_poses, poses_from_numbers

KUKA, FANUC, YASKAWA, KAWASAKI, STAUBLI, UNIVERSAL_ROBOTS = (
    language.LANGUAGE.maker.orientation for language in (krl, fanuc, inform, kawasaki, val3, urscript)
)


@given(st.floats(-1e9, 1e9), st.sampled_from([6, 9]))
def test_number_text(value, decimals):
    text = number_text(value, decimals)
    assert re.fullmatch(r"-?(0|[1-9]\d*)(\.\d*[1-9])?", text)
    assert text != "-0"
    assert abs(float(text) - value) <= 0.5 * 10.0**-decimals + 1e-15 * abs(value)


def test_poses_come_through():
    T = arm().forward(arm().random_joints(200, 1))
    numbers = numbers_from_poses(T)
    assert (numbers[:, 3] >= 0).all()
    assert np.abs(np.linalg.norm(numbers[:, 3:], axis=1) - 1).max() < 1e-12
    assert np.abs(poses_from_numbers(numbers) - T).max() < 1e-12
    near = -numbers[:, 3:] + 0.01
    assert np.abs(numbers_from_poses(T, near)[:, 3:] + numbers[:, 3:]).max() < 1e-12, "the sign is that of the old one"


def test_what_is_no_pose_is_refused():
    sheared = np.eye(4) + 1e-4 * np.eye(4, k=1)
    for wrong in (2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan), sheared):
        with pytest.raises(ValueError, match="rigid"):
            numbers_from_poses(wrong)


SCIPY = [(KUKA, "ZYX", 1), (FANUC, "xyz", 1), (YASKAWA, "xyz", 1), (KAWASAKI, "ZYZ", 1), (STAUBLI, "XYZ", 1)]
CHECKED = [  # (10, 20, 30) degrees, of UR the vector (0.1, -0.2, 0.3): first rows of R
    (KUKA, [0.925417, 0.018028, 0.378522, 0.163176, 0.882564, -0.440970]),
    (FANUC, [0.813798, -0.440970, 0.378522, 0.469846, 0.882564, 0.018028]),
    (YASKAWA, [0.813798, -0.440970, 0.378522, 0.469846, 0.882564, 0.018028]),
    (KAWASAKI, [0.714610, -0.613092, 0.336824, 0.633718, 0.771281, 0.059391]),
    (STAUBLI, [0.813798, -0.469846, 0.342020, 0.543838, 0.823173, -0.163176]),
    (UNIVERSAL_ROBOTS, [0.935755, -0.302933, -0.180540, 0.283165, 0.950581, -0.127335]),
]


@pytest.mark.parametrize(("how", "rows"), CHECKED)
def test_checked_numbers(how, rows):
    values = [0.1, -0.2, 0.3] if how is UNIVERSAL_ROBOTS else np.radians([10.0, 20.0, 30.0])
    np.testing.assert_allclose(how.matrix(values)[0].ravel()[:6], rows, rtol=0, atol=6e-7)


@pytest.mark.parametrize(("how", "name", "_"), SCIPY)
def test_angles_are_those_of_scipy(how, name, _):
    values = np.random.default_rng(1).uniform(-np.pi, np.pi, (500, 3))
    np.testing.assert_allclose(how.matrix(values), Rotation.from_euler(name, values).as_matrix(), rtol=0, atol=1e-14)


def test_vectors_are_those_of_scipy():
    values = np.random.default_rng(1).uniform(-4, 4, (500, 3))
    R = Rotation.from_rotvec(values).as_matrix()
    np.testing.assert_allclose(UNIVERSAL_ROBOTS.matrix(values), R, rtol=0, atol=1e-14)
    np.testing.assert_allclose(UNIVERSAL_ROBOTS.values(R, values), values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(UNIVERSAL_ROBOTS.matrix(np.zeros(3)), np.eye(3)[None], rtol=0, atol=0)
    assert (UNIVERSAL_ROBOTS.values(np.eye(3), np.zeros(3)) == 0).all()


@pytest.mark.parametrize("how", [how for how, _ in CHECKED])
def test_a_small_turn_is_a_small_change_of_the_numbers(how):
    """Also next to half a turn; away from the singular middle angle."""
    rng = np.random.default_rng(2)
    old = rng.uniform(-1, 1, (2000, 3)) * [np.pi, 1.4, np.pi]
    if how is KAWASAKI:
        old[:, 1] += np.where(old[:, 1] < 0, -0.1, 0.1)
    if how is STAUBLI or how is KUKA or how is FANUC:
        old[::2, 1] = np.pi - old[::2, 1]  # the other of the two solutions
    R = how.matrix(old)
    small = 1e-4 * rng.uniform(-1, 1, (2000, 3))
    new = how.values(R @ Rotation.from_rotvec(small).as_matrix(), old)
    np.testing.assert_allclose(how.matrix(new), R @ Rotation.from_rotvec(small).as_matrix(), rtol=0, atol=1e-12)
    change = np.abs(new - old)
    change = np.minimum(change, np.abs(change - 2 * np.pi)) if how is not UNIVERSAL_ROBOTS else change
    assert change.max() < 2e-2
    assert np.abs(how.values(R, old) - old)[np.abs(old).max(axis=1) < 3.1].max() < 1e-9


@pytest.mark.parametrize(("how", "name", "_"), SCIPY)
@pytest.mark.parametrize("half", [1, -1])
def test_singular_middle_angles_keep_the_split(how, name, _, half):
    middle = (0.0 if half > 0 else np.pi) if how is KAWASAKI else half * np.pi / 2
    old = np.array([[0.3, middle, -0.7], [2.9, middle, 2.0]])
    R = Rotation.from_euler(name, old).as_matrix()
    np.testing.assert_allclose(how.values(R, old), old, rtol=0, atol=1e-7)
    turned = Rotation.from_rotvec([0, 0, 1e-3]).as_matrix() @ R
    new = how.values(turned, old)
    np.testing.assert_allclose(how.matrix(new), turned, rtol=0, atol=1e-7)


def test_angles_beyond_half_a_turn_stay_there():
    old = np.radians([[270.0, 10.0, -200.0]])
    np.testing.assert_allclose(KAWASAKI.values(KAWASAKI.matrix(old), old), old, rtol=0, atol=1e-12)
    edge = np.radians([[-180.0, 10.0, 20.0]])
    np.testing.assert_allclose(KUKA.values(KUKA.matrix(edge), edge), edge, rtol=0, atol=1e-12)


def test_every_maker_has_its_own():
    assert {how.names for how, _ in CHECKED} >= {("A", "B", "C"), ("W", "P", "R"), ("O", "A", "T")}
    assert notation.GIMBAL_LOCK < 1e-6
