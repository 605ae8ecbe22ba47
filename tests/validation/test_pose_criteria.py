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


def test_wrapped_angles_lie_within_half_a_turn():
    found = np.degrees(frames.wrapped(np.radians([0.0, 190.0, -190.0, 725.0, 179.0])))
    assert found == pytest.approx([0, -170, 170, 5, 179])


def test_angles_are_unwrapped_about_the_first_cycle_axis_by_axis():
    angles = np.radians([[179.0, 10.0], [-179.0, 12.0], [-177.0, 17.0]])
    assert np.degrees(pose_criteria.angle_repeatability(angles)) == pytest.approx(
        [6.0, 3 * np.std([10, 12, 17], ddof=1)]
    )


def test_mean_rotation_is_the_mean_angle_about_one_axis():
    R = np.array([frames.rot_z(np.radians(angle)) for angle in (1.0, 2.0, 6.0)])
    mean = pose_criteria.mean_rotation(R)
    assert frames.rotation_distance(mean[None], frames.rot_z(np.radians(3.0))[None])[0] < 2e-5
    assert np.abs(mean @ mean.T - np.eye(3)).max() < 1e-14


def test_distance_of_places_away_from_zero():
    one = np.array([[10.0, 1, 0], [20, 2, 0], [30, 3, 0]])
    two = one + np.array([[3.0, 4, 0], [6, 8, 0], [0, 0, 15]])
    accuracy, repeatability = pose_criteria.distance_accuracy(one, two, np.array([1.0, 1, 1]), np.array([1.0, 4, 5]))
    assert accuracy == pytest.approx(10 - 5)
    assert repeatability == pytest.approx(3 * 5.0)


def test_variation_and_distance_by_hand():
    assert pose_criteria.multidirectional_variation(np.array([[0, 0, 0], [3, 4, 0], [1, 0, 0.0]])) == pytest.approx(5.0)
    one, two = np.zeros((3, 3)), np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0]])
    accuracy, repeatability = pose_criteria.distance_accuracy(one, two, np.zeros(3), np.array([0, 1.5, 0]))
    assert accuracy == pytest.approx(0.5)
    assert repeatability == pytest.approx(3.0)
    assert pose_criteria.distance_accuracy(one, two)[0] is None


def test_drift_from_a_first_set_that_is_off_already():
    square = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    found = pose_criteria.drift([3 * square + np.array([1, 2, 2]), square + np.array([1, 2, 8])], np.array([1.0, 2, 0]))
    assert pytest.approx([2, 8]) == found.AP
    assert found.shift == pytest.approx([0, 6])
    assert (found.dAP, found.dRP) == (pytest.approx(6), pytest.approx(-2))
    with pytest.raises(ValueError, match="read-only"):
        found.RP[0] = 0.0


def test_drift_by_hand():
    square = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    found = pose_criteria.drift([square, 2 * square + [0, 0, 3], 3 * square + [0, 0, 4]], np.zeros(3))
    assert pytest.approx([1, 2, 3]) == found.RP
    assert pytest.approx([0, 3, 4]) == found.AP
    assert found.shift == pytest.approx([0, 3, 4])
    assert (found.dAP, found.dRP) == (pytest.approx(4), pytest.approx(2))
    alone = pose_criteria.drift([square, square])
    assert (alone.AP, alone.dAP) == (None, None)
