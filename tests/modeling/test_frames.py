"""Rigid transforms against their definitions, scipy and Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support import assert_same_poses, random_rotation

from irbcal.modeling import frames

ANGLE = st.floats(-np.pi, np.pi)


@given(ANGLE, ANGLE, ANGLE)
def test_six_parameters_are_the_product_of_eq_3_5(alpha, beta, gamma):
    T = frames.from_xyz_angles([1.0, -2.0, 3.0, alpha, beta, gamma])
    expected = Rotation.from_euler("XYZ", [alpha, beta, gamma]).as_matrix()
    assert np.abs(T[:3, :3] - expected).max() < 1e-15 * 4
    assert T[:3, 3].tolist() == [1.0, -2.0, 3.0]


@given(ANGLE, st.sampled_from([np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, 1.0, 0.0, -1.5]), ANGLE)
def test_six_parameters_come_back(alpha, beta, gamma):
    T = frames.from_xyz_angles([0.1, 0.2, 0.3, alpha, beta, gamma])
    again = frames.from_xyz_angles(frames.to_xyz_angles(T))
    assert_same_poses(again, T, 1e-15, 2e-15)


def test_six_parameters_have_a_positive_cosine_of_beta():
    values = frames.to_xyz_angles(frames.from_xyz_angles([0, 0, 0, 0.3, 2.5, -0.4]))
    assert abs(values[4]) <= np.pi / 2


@given(ANGLE, st.sampled_from([np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, np.pi / 2 - 1e-5, 0.3]), ANGLE)
def test_rpy_gives_the_rotation_back_through_the_gimbal_lock(roll, pitch, yaw):
    R = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    rpy = frames.rpy_from_matrix(R)
    assert frames.rotation_distance(pin.rpy.rpyToMatrix(rpy), R) < 4e-15
    assert frames.rotation_distance(frames.matrix_from_rpy(rpy), R) < 4e-15


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_rotation_vector_agrees_with_the_exponential_map(vector):
    vector = np.array(vector)
    assert np.abs(frames.rotation_from_vector(vector) - pin.exp3(vector)).max() < 5e-15


@pytest.mark.parametrize(
    ("angle", "tolerance"), [(0.0, 1e-15), (1e-12, 1e-15), (1e-6, 1e-15), (0.5, 1e-14), (3.0, 1e-13), (np.pi, 1e-7)]
)
def test_rotation_distance_is_the_angle(angle, tolerance):
    R = random_rotation(np.random.default_rng(1))
    assert abs(frames.rotation_distance(R, R @ frames.rot_y(angle)) - angle) < tolerance


def test_inverse_and_composition():
    rng = np.random.default_rng(2)
    T = np.array([frames.transform(random_rotation(rng), rng.normal(size=3)) for _ in range(50)])
    assert_same_poses(frames.inverse(T) @ T, np.broadcast_to(np.eye(4), T.shape), 2e-15, 2e-15)


def test_rigid_fit_finds_the_motion_and_never_a_mirror_image():
    rng = np.random.default_rng(3)
    T = np.array([frames.transform(random_rotation(rng), rng.normal(size=3)) for _ in range(200)])
    points = rng.normal(size=(200, 3, 3))  # three points: a plane, where mirror images are tempting
    moved = np.einsum("nij,nkj->nki", T[:, :3, :3], points) + T[:, None, :3, 3]
    found = frames.rigid_fit(points, moved)
    assert np.linalg.det(found[:, :3, :3]).min() > 0
    assert_same_poses(found, T, 1e-12, 1e-12)
