"""The way from the tip to the wrist against products of matrices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from irbcal.modeling import frames
from irbcal.modeling.inverse import orthoparallel
from irbcal.modeling.inverse.orthoparallel import WristFrame
from irbcal.modeling.inverse.poses import pose_columns


def poses(n, seed):
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(n, random_state=seed).as_matrix()
    T[:, :3, 3] = rng.uniform(-2.0, 2.0, (n, 3))
    return T


QUARTERS = frames.transform(frames.rot_y(np.pi / 2) @ frames.rot_z(np.pi / 2), [0.1, 0.0, 0.2])


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (np.eye(4), frames.transform(None, [0.0, 0.0, -0.065])),
        (frames.transform(None, [0.0, 0.1, -0.4865]), QUARTERS),
        (QUARTERS, np.eye(4)),
        tuple(poses(2, 3)),
    ],
    ids=["same axes", "quarter turns behind", "quarter turns before", "any"],
)
@pytest.mark.parametrize("n", [1, 7, 2500])
def test_it_is_the_product(left, right, n):
    T = poses(n, 1)
    asked = left @ T @ right
    R, p = WristFrame.from_transforms(left, right).wrist_of(pose_columns(T).reshape(12, -1))
    assert np.abs(R.reshape(3, 3, n).T - asked[:, :3, :3]).max() < 4e-16 * 4
    assert np.abs(p.T - asked[:, :3, 3]).max() < 3e-15


def test_between_takes_the_lengths_of_joints_1_and_6_away():
    before, after = poses(2, 5)
    tip = before @ frames.transform(None, [0.0, 0.0, 0.3]) @ frames.transform(None, [0.0, 0.0, 0.08]) @ after
    R, p = orthoparallel.between(before, after, 0.3, 0.08).wrist_of(pose_columns(tip[None]).reshape(12, -1))
    assert np.abs(R[:, 0] - np.eye(3).ravel()).max() < 1e-15
    assert np.abs(p).max() < 1e-15
