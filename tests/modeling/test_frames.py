"""Rigid transforms against their definitions, scipy and Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support import assert_same_poses, random_rotation

from irbcal.modeling import frames

ANGLE = st.floats(-np.pi, np.pi)
METRES = st.floats(-50.0, 50.0)
TRANSFORM = st.tuples(METRES, METRES, METRES, ANGLE, ANGLE, ANGLE).map(frames.from_xyz_angles)
NUMBER = st.floats(-1.0, 1.0).map(lambda x: 0.0 if abs(x) < 1e-3 else x)  # zeros and signs, no underflow
QUATERNION = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER).filter(any)


@given(TRANSFORM, TRANSFORM, TRANSFORM)
def test_transforms_are_a_group(T_a_b, T_b_c, T_c_d):
    one = np.eye(4)
    assert_same_poses((T_a_b @ T_b_c) @ T_c_d, T_a_b @ (T_b_c @ T_c_d), 1e-13, 4e-15)
    assert_same_poses(T_a_b @ one, T_a_b, 0.0, 0.0)
    assert_same_poses(one @ T_a_b, T_a_b, 0.0, 0.0)
    for product in (T_a_b @ frames.inverse(T_a_b), frames.inverse(T_a_b) @ T_a_b):
        assert_same_poses(product, one, 1e-13, 4e-15)
    assert_same_poses(frames.inverse(T_a_b @ T_b_c), frames.inverse(T_b_c) @ frames.inverse(T_a_b), 1e-13, 4e-15)
    closed = T_a_b @ T_b_c  # a rigid transform again
    assert np.abs(closed[:3, :3].T @ closed[:3, :3] - np.eye(3)).max() < 4e-15
    assert np.linalg.det(closed[:3, :3]) > 0
    assert closed[3].tolist() == [0.0, 0.0, 0.0, 1.0]


@given(TRANSFORM, TRANSFORM, st.lists(st.tuples(METRES, METRES, METRES), min_size=1, max_size=5))
def test_subscripts_cancel_for_points_too(T_a_b, T_b_c, points):
    points = np.array(points)
    one_by_one = frames.apply(T_a_b, frames.apply(T_b_c, points))
    np.testing.assert_allclose(frames.apply(T_a_b @ T_b_c, points), one_by_one, rtol=0, atol=2e-13)


@given(QUATERNION)
@example((0.0, 0.0, 0.0, -1.0))
@example((0.0, -1.0, 1.0, 0.0))
@example((-1.0, 0.0, 0.0, 0.0))
def test_quaternions_are_those_of_scipy_with_the_scalar_first(q):
    w, x, y, z = q
    expected = Rotation.from_quat([x, y, z, w])
    R = frames.matrix_from_quaternion(q)
    np.testing.assert_allclose(R, expected.as_matrix(), rtol=0, atol=1e-15)
    back = frames.quaternion_from_matrix(R)
    np.testing.assert_allclose(back, np.roll(expected.as_quat(canonical=True), 1), rtol=0, atol=4e-16)
    assert abs(np.linalg.norm(back) - 1.0) < 4e-16
    assert next(value for value in back if value) > 0
    assert not np.signbit(back[back == 0.0]).any()


@given(ANGLE, ANGLE, ANGLE)
def test_a_rotation_comes_back_from_its_quaternion(alpha, beta, gamma):
    R = frames.from_xyz_angles([0.0, 0.0, 0.0, alpha, beta, gamma])[:3, :3]
    again = frames.matrix_from_quaternion(frames.quaternion_from_matrix(R))
    assert frames.rotation_distance(again, R) < 4e-15


def test_quaternions_come_in_batches_and_nan_stays_nan():
    rng = np.random.default_rng(5)
    R = np.array([[random_rotation(rng) for _ in range(3)] for _ in range(4)])
    q = frames.quaternion_from_matrix(R)
    assert q.shape == (4, 3, 4)
    assert q[2, 1].tolist() == frames.quaternion_from_matrix(R[2, 1]).tolist()
    assert frames.matrix_from_quaternion(q).shape == (4, 3, 3, 3)
    holed_R, holed_q = R[0].copy(), q[0].copy()
    holed_R[1, 2, 0], holed_q[1, 3] = np.nan, np.inf
    for found, whole in (
        (frames.quaternion_from_matrix(holed_R), q[0]),
        (frames.matrix_from_quaternion(holed_q), frames.matrix_from_quaternion(q[0])),
    ):
        assert np.isnan(found[1]).all()
        assert found[[0, 2]].tolist() == whole[[0, 2]].tolist()
    assert frames.quaternion_from_matrix(np.empty((0, 3, 3))).shape == (0, 4)
    assert frames.matrix_from_quaternion(np.empty((0, 4))).shape == (0, 3, 3)


def test_a_quaternion_of_length_zero_is_refused():
    with pytest.raises(ValueError, match="length zero"):
        frames.matrix_from_quaternion([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])


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


@pytest.mark.parametrize("outside", [False, True])
def test_derivative_of_angles(outside):
    """Turned by a little, the angles change as their derivative says."""
    R = frames.from_xyz_angles([0, 0, 0, 0.4, -1.1, 2.9])[:3, :3]
    v = np.array([2e-5, -1e-5, 3e-5])
    turn = frames.rotation_from_vector(v)
    after = turn @ R if outside else R @ turn
    change = (frames.to_xyz_angles(frames.transform(after)) - frames.to_xyz_angles(frames.transform(R)))[3:]
    np.testing.assert_allclose(frames.angles_derivative(R, outside) @ v, change, rtol=0, atol=1e-8)


def test_one_rotation_vector_is_one_of_many():
    vectors = np.vstack(
        [np.zeros(3), np.random.default_rng(4).standard_normal((20, 3)) * 10.0 ** -np.arange(20)[:, None]]
    )
    one_by_one = [frames.rotation_from_one(vector) for vector in vectors]
    np.testing.assert_allclose(one_by_one, frames.rotation_from_vector(vectors), rtol=0, atol=1e-15)


@pytest.mark.parametrize(("a", "b"), [((3,), (3,)), ((3,), (5, 3)), ((4, 1, 3), (5, 3))])
def test_vector_products_are_those_of_numpy(a, b):
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal(a), rng.standard_normal(b)
    np.testing.assert_array_equal(frames.cross(a, b), np.cross(a, b))


def test_rotation_vectors_against_scipy():
    rng = np.random.default_rng(9)
    vectors = rng.standard_normal((200, 3))
    vectors *= (rng.uniform(0.0, np.pi, 200) / np.linalg.norm(vectors, axis=1))[:, None]
    vectors[:3] = [[0.0, 0.0, 0.0], [1e-9, -2e-9, 3e-9], [0.0, np.pi - 1e-9, 0.0]]
    R = frames.rotation_from_vector(vectors)
    assert np.abs(R - Rotation.from_rotvec(vectors).as_matrix()).max() < 1e-14
    assert np.abs(frames.vector_from_rotation(R) - vectors).max() < 1e-14
    assert np.array_equal(frames.rotation_from_vector(vectors[5]), R[5])


def test_hand_and_eye():
    """Rotations A and F from products of theirs with random turns; turns about one axis leave them open."""
    rng = np.random.default_rng(12)
    A, F, *R = (random_rotation(rng) for _ in range(7))
    found = frames.hand_eye(np.array(R), F.T @ R @ A)
    np.testing.assert_allclose(found[0], A, atol=1e-12)
    np.testing.assert_allclose(found[1], F, atol=1e-12)
    about = np.array([frames.rotation_from_vector([0, 0, a]) for a in np.linspace(0, 2, 5)])
    assert frames.hand_eye(about, F.T @ about @ A) is None
