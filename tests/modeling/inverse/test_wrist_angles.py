"""The angles of a wrist, against rotations made of such angles."""

import numpy as np
from scipy.spatial.transform import Rotation

from irbcal.modeling.inverse import orthoparallel

MANY = 3_000


def hand(q1, q23, wrist):
    """Columns n, o, a (9, n) of the hand in the base, and those along and across the arm's plane (6, n)."""
    zero = np.zeros(MANY)
    radial = np.array([np.cos(q1), np.sin(q1), zero])
    across = np.array([-np.sin(q1), np.cos(q1), zero])
    up = np.array([zero, zero, np.ones(MANY)])
    # x, y, z of the frame that the forearm carries, z along it (Nubiola 2011, Figure 5.3)
    forearm = np.cos(q23) * radial - np.sin(q23) * up
    x = -np.sin(q23) * radial - np.cos(q23) * up
    axes = np.stack([x, across, forearm]).transpose(2, 1, 0) @ Rotation.from_euler("ZYZ", wrist).as_matrix()
    R = axes.transpose(2, 1, 0).reshape(9, MANY)
    plane = [(axes * direction.T[:, :, None]).sum(axis=1).T for direction in (radial, across)]
    return R, np.concatenate(plane)


def found(R, plane, q23):
    return np.array(orthoparallel.of_rotation(R, plane[:3], plane[3:], np.cos(q23), np.sin(q23))).T


def test_angles_come_back():
    rng = np.random.default_rng(0)
    q1, q23, q4, q6 = rng.uniform(-3.1, 3.1, (4, MANY))
    q5 = rng.uniform(0.05, 3.09, MANY)
    wrist = np.column_stack([q4, q5, q6])
    assert np.abs(found(*hand(q1, q23, wrist), q23) - wrist).max() < 1e-13


def test_where_the_pose_leaves_the_first_open_it_points_ahead_and_the_last_makes_it_good():
    rng = np.random.default_rng(1)
    q1, q23, q4, q6 = rng.uniform(-3.1, 3.1, (4, MANY))
    for q5 in (0.0, 1e-14, 1e-9, np.pi - 1e-9, np.pi):
        wrist = np.column_stack([q4, np.full(MANY, q5), q6])
        R, plane = hand(q1, q23, wrist)
        q = found(R, plane, q23)
        if np.sin(q5) < 1e-13:
            assert (q[:, 0] == 0.0).all()
        again = hand(q1, q23, q)[0]
        assert np.abs(again - R).max() < 3e-15 + 2.0 * (np.sin(q5) if np.sin(q5) < 1e-13 else 0.0)
