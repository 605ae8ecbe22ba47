"""Kinematics with frame terms against products of matrices, its columns against central differences."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from support import arm, central_differences
from term_cases import motion_at, rail, random_map, some_joints

from irbcal.modeling import frames
from irbcal.modeling.terms import chain


def by_products(model, effective, xi):
    """Tip pose at joints (joints,) with frames moved by xi (joints, 6), by products of matrices."""
    T = np.array(model.T_base_0)
    for i in range(len(effective)):
        row = model.table
        slides = row.prismatic[i]
        T = T @ frames.transform(frames.rot_x(row.alpha[i])) @ frames.transform(None, [row.a[i], 0, 0])
        T = T @ frames.transform(frames.rot_y(row.beta[i]), [0, row.b[i], 0])
        T = T @ frames.transform(None, xi[i, 3:]) @ frames.transform(Rotation.from_rotvec(xi[i, :3]).as_matrix())
        T = T @ frames.transform(frames.rot_z(row.theta[i] + (0.0 if slides else effective[i])), None)
        T = T @ frames.transform(None, [0, 0, row.d[i] + (effective[i] if slides else 0.0)])
    return T @ model.T_last_tip


def test_forward_kinematics_is_the_product_of_transforms():
    model = arm("irb120")
    found = random_map(model)
    motion = motion_at(some_joints(5))
    effective, xi = found.split(motion)
    assert np.abs(xi).max() > 1e-5
    expected = np.array([by_products(model, effective[n], xi[n]) for n in range(5)])
    np.testing.assert_allclose(found.forward(model, motion), expected, rtol=0, atol=1e-14)


def test_large_motions_of_the_frames_and_a_prismatic_joint(tmp_path):
    model = rail(tmp_path)
    rng = np.random.default_rng(3)
    q, xi = rng.uniform(-1, 1, (4, 7)), 0.5 * rng.standard_normal((4, 7, 6))
    expected = np.array([by_products(model, q[n], xi[n]) for n in range(4)])
    np.testing.assert_allclose(chain.poses(chain.walk(model, q, xi)), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(chain.poses(chain.walk(model, q)), model.forward(q), rtol=0, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 9.9e-3, 1.01e-2, 0.3, 3.0])
def test_exponential_and_its_left_jacobian(size):
    vector = size * np.array([[0.6], [-0.48], [0.64]])
    R, left = chain._exponential(vector)
    np.testing.assert_allclose(R[..., 0], Rotation.from_rotvec(vector[:, 0]).as_matrix(), rtol=0, atol=1e-14)
    # the integral of Exp(s v) from 0 to 1 is a corner of a matrix exponential
    K = np.cross(np.eye(3), vector[:, 0])
    block = expm(np.block([[K, np.eye(3)], [np.zeros((3, 6))]]))
    np.testing.assert_allclose(left[..., 0], block[:3, 3:], rtol=0, atol=1e-11)


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.2])
def test_columns_are_derivatives_by_the_motions_of_the_frames(size):
    model = arm("irb120")
    q, pose = some_joints(2), np.array([0, 1, 1])
    rng = np.random.default_rng(5)
    xi, local = size * rng.standard_normal((2, 6, 6)), rng.uniform(-0.2, 0.2, (3, 3))

    def tips(step):
        return chain.poses(chain.walk(model, q, xi + step.reshape(6, 6)))[pose]

    def points(step):
        T = tips(step)
        return (np.einsum("mij,mj->mi", T[:, :3, :3], local) + T[:, :3, 3]).T

    start = tips(np.zeros(36))[:, :3, :3]

    def turns(step):
        return Rotation.from_matrix(tips(step)[:, :3, :3] @ start.transpose(0, 2, 1)).as_rotvec().T

    path = chain.walk(model, q, xi).select(pose)
    p = points(np.zeros(36))
    columns = np.stack([chain.derivative(path, k, p) for k in range(6)], axis=1).reshape(36, -1)
    numeric = central_differences(lambda s: points(s).ravel(), np.zeros(36), 1e-3).T
    assert np.abs(columns - numeric).max() < 1e-9
    spun = np.stack([chain.derivative(path, k) for k in range(6)], axis=1).reshape(36, -1)
    numeric = central_differences(lambda s: turns(s).ravel(), np.zeros(36), 1e-3).T
    assert np.abs(spun - numeric).max() < 1e-9


def test_turns_are_not_moved_by_translations():
    path = chain.walk(arm("irb120"), some_joints(2))
    assert not any(chain.derivative(path, k).any() for k in (3, 4, 5))
