"""The camera's model against OpenCV, central differences, and boards at known places."""

import feature_cases as cases
import numpy as np
import pytest

from irbcal.measurement import pinhole
from irbcal.modeling import frames

LENS = np.array(cases.LENS_OF)
RNG = np.random.default_rng(4)
Y = np.column_stack([RNG.uniform(-0.3, 0.3, (6, 2)), RNG.uniform(0.6, 1.2, 6)])


def test_a_point_is_where_opencv_has_it():
    cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless (pip install irbcal[camera])")
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = cases.LENS_OF
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    there, _ = cv2.projectPoints(Y, np.zeros(3), np.zeros(3), K, np.array([k1, k2, p1, p2, k3]))
    np.testing.assert_allclose(pinhole.project(LENS, Y)[0], there[:, 0], atol=1e-9)


def test_derivatives_are_those_of_central_differences():
    uv, by_point, by_lens = pinhole.project(LENS, Y)
    np.testing.assert_allclose(uv, cases.in_image(LENS, Y), atol=1e-9)
    for k, h in enumerate(1e-6 * np.eye(3)):
        slope = (pinhole.project(LENS, Y + h)[0] - pinhole.project(LENS, Y - h)[0]) / 2e-6
        np.testing.assert_allclose(by_point[..., k], slope, atol=1e-4)
    for k, h in enumerate(1e-6 * np.eye(9)):
        slope = (pinhole.project(LENS + h, Y)[0] - pinhole.project(LENS - h, Y)[0]) / 2e-6
        np.testing.assert_allclose(by_lens[..., k], slope, atol=1e-5)


def test_distortion_is_undone():
    np.testing.assert_allclose(pinhole.undistorted(LENS, cases.in_image(LENS, Y)), Y[:, :2] / Y[:, 2:], atol=1e-12)


def test_boards_stand_where_their_corners_say():
    T = np.array(
        [
            frames.transform(frames.rotation_from_vector(0.4 * RNG.standard_normal(3)), [0.01 * k, 0, 0.8])
            for k in range(4)
        ]
    )
    xy = cases.corners()
    uv = cases.in_image(LENS, xy @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3])
    seen = np.concatenate([np.broadcast_to(xy[:, :2], uv.shape), uv, np.ones((*uv.shape[:2], 1))], axis=2)
    seen[2, 10:] = np.nan
    np.testing.assert_allclose(pinhole.boards(LENS, seen), T, atol=1e-8)
