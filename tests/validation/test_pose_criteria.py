"""Criteria of poses against values worked out by hand."""

import numpy as np
import pytest

from irbcal.modeling import frames
from irbcal.validation import pose_criteria


def test_pose_accuracy_and_repeatability_by_hand():
    xyz = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]]) + np.array([10, 20, 30])
    total, axes = pose_criteria.pose_accuracy(xyz, np.array([10, 17, 26]))
    assert total == pytest.approx(5.0)
    assert axes == pytest.approx([0, 3, 4])
    repeatability, distance = pose_criteria.position_repeatability(xyz)
    assert distance == pytest.approx([1, 1, 2, 2])
    assert repeatability == pytest.approx(1.5 + 3 * np.sqrt(4 * 0.25 / 3))


def test_angles_by_hand_and_over_the_half_turn():
    angles = np.radians([179.0, -179.0, 178.0, -178.0])
    assert np.degrees(pose_criteria.angle_accuracy(angles, np.radians(170))) == pytest.approx(10.0)
    assert np.degrees(pose_criteria.angle_repeatability(angles)) == pytest.approx(3 * np.sqrt((1 + 1 + 4 + 4) / 3))


def test_small_angles_have_no_singular_attitude():
    """The thesis's poses point along +x, where x-y-z angles are at their gimbal lock."""
    commanded = frames.rot_y(np.pi / 2)
    turns = np.radians([[0.1, 0, 0], [0, -0.2, 0], [0, 0, 0.3]])
    R = np.array([frames.rotation_from_vector(v) @ commanded for v in turns])
    assert np.abs(pose_criteria.small_angles(R, commanded) - turns).max() < 1e-15


def test_variation_and_distance_by_hand():
    assert pose_criteria.multidirectional_variation(np.array([[0, 0, 0], [3, 4, 0], [1, 0, 0.0]])) == pytest.approx(5.0)
    one, two = np.zeros((3, 3)), np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0]])
    accuracy, repeatability = pose_criteria.distance_accuracy(one, two, np.zeros(3), np.array([0, 1.5, 0]))
    assert accuracy == pytest.approx(0.5)
    assert repeatability == pytest.approx(3.0)
    assert pose_criteria.distance_accuracy(one, two)[0] is None


def test_drift_by_hand():
    square = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    found = pose_criteria.drift([square, 2 * square + [0, 0, 3], 3 * square + [0, 0, 4]], np.zeros(3))
    assert pytest.approx([1, 2, 3]) == found.RP
    assert pytest.approx([0, 3, 4]) == found.AP
    assert found.shift == pytest.approx([0, 3, 4])
    assert (found.dAP, found.dRP) == (pytest.approx(4), pytest.approx(2))
    alone = pose_criteria.drift([square, square])
    assert (alone.AP, alone.dAP) == (None, None)
