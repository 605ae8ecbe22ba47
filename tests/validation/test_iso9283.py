"""ISO 9283 against values worked out by hand and against the thesis's test poses."""

import numpy as np
import pytest
from support import arm

from irbcal.errors import MeasurementError, RobotError
from irbcal.modeling import frames
from irbcal.validation import iso9283

THESIS = np.array(
    [
        [0, -14, 14, 0, 0, 0],
        [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
        [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
        [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
        [41.374, -24.789, 47.145, 66.643, -46.052, -58.108],
    ]
)
"""Table A I-1 with its columns and signs restored, degrees."""


def test_five_poses_of_the_thesis():
    found = iso9283.five_poses(arm())
    assert np.abs(np.degrees(found.q) - THESIS).max() < 0.0015, "printed to 0.001 degrees"
    offset = (found.T_base_tip[:, :3, 3] - found.T_base_tip[0, :3, 3]) * 1e3
    signs = np.array([[0, 0, 0], [1, 1, 1], [1, -1, 1], [-1, -1, -1], [-1, 1, -1]])
    assert np.abs(offset - 271.93 * signs).max() < 0.005


def test_five_poses_of_other_cubes_and_robots():
    irb120 = arm("irb120")
    found = iso9283.five_poses(irb120)
    assert np.abs(irb120.forward(found.q) - found.T_base_tip).max() < 1e-9
    assert ((found.q >= irb120.lower) & (found.q <= irb120.upper)).all()
    for plane, (i, j, sign) in {"x=z": (0, 2, 1), "x=-z": (0, 2, -1), "y=z": (1, 2, 1), "y=-z": (1, 2, -1)}.items():
        p = iso9283.five_poses(irb120, [0.35, 0, 0.4], 0.2, plane=plane, fraction=0.1).T_base_tip[:, :3, 3]
        p = p - [0.35, 0, 0.4]
        assert np.abs(p[:, i] - sign * p[:, j]).max() < 1e-15, "all five lie on the plane"
        assert np.abs(p[1:3] + p[3:]).max() < 1e-15, "P2 and P4, P3 and P5 on the same diagonals"
        assert np.abs(np.linalg.norm(p[1:], axis=1) - 0.4 * 0.2 * np.sqrt(3)).max() < 1e-15
    with pytest.raises(RobotError, match="does not reach P2"):
        iso9283.five_poses(irb120, [0.6, 0, 0.3], 0.6)
    with pytest.raises(RobotError, match="inclined planes"):
        iso9283.five_poses(irb120, plane="z=0")


def test_pose_accuracy_and_repeatability_by_hand():
    xyz = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]]) + np.array([10, 20, 30])
    total, axes = iso9283.pose_accuracy(xyz, np.array([10, 17, 26]))
    assert total == pytest.approx(5.0)
    assert axes == pytest.approx([0, 3, 4])
    repeatability, distance = iso9283.position_repeatability(xyz)
    assert distance == pytest.approx([1, 1, 2, 2])
    assert repeatability == pytest.approx(1.5 + 3 * np.sqrt(4 * 0.25 / 3))


def test_angles_by_hand_and_over_the_half_turn():
    angles = np.radians([179.0, -179.0, 178.0, -178.0])
    assert np.degrees(iso9283.angle_accuracy(angles, np.radians(170))) == pytest.approx(10.0)
    assert np.degrees(iso9283.angle_repeatability(angles)) == pytest.approx(3 * np.sqrt((1 + 1 + 4 + 4) / 3))


def test_small_angles_have_no_singular_attitude():
    """The thesis's poses point along +x, where x-y-z angles are at their gimbal lock."""
    commanded = frames.rot_y(np.pi / 2)
    turns = np.radians([[0.1, 0, 0], [0, -0.2, 0], [0, 0, 0.3]])
    R = np.array([frames.rotation_from_vector(v) @ commanded for v in turns])
    assert np.abs(iso9283.small_angles(R, commanded) - turns).max() < 1e-15


def test_variation_and_distance_by_hand():
    assert iso9283.multidirectional_variation(np.array([[0, 0, 0], [3, 4, 0], [1, 0, 0.0]])) == pytest.approx(5.0)
    one, two = np.zeros((3, 3)), np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0]])
    accuracy, repeatability = iso9283.distance_accuracy(one, two, np.zeros(3), np.array([0, 1.5, 0]))
    assert accuracy == pytest.approx(0.5)
    assert repeatability == pytest.approx(3.0)
    assert iso9283.distance_accuracy(one, two)[0] is None


def series(distance):
    return np.column_stack([distance, 0 * distance, 0 * distance])


def test_stabilisation_by_hand():
    time = np.arange(8.0)
    distance = np.array([10.0, 4.0, 0.0, 3.0, 2.0, 0.5, 0.2, 0.1])
    found = iso9283.stabilisation(time, series(distance), np.zeros(3), 1.0)
    assert found.first_entry == pytest.approx(1.75), "on the way from 4 to 0"
    assert found.settled == pytest.approx(4 + 1 / 1.5), "on the way from 2 to 0.5"
    assert found.time == pytest.approx(4 + 1 / 1.5 - 1.75)
    assert found.overshoot == found.largest == 3.0
    calm = iso9283.stabilisation(time, series(distance[::-1] * 0 + 0.5), np.zeros(3), 1.0)
    assert (calm.first_entry, calm.settled, calm.overshoot) == (0.0, 0.0, 0.0)
    restless = iso9283.stabilisation(time, series(np.array([5.0, 0, 0, 0, 0, 0, 0, 5.0])), np.zeros(3), 1.0)
    assert np.isnan(restless.settled)
    never = iso9283.stabilisation(time, series(distance + 5), np.zeros(3), 1.0)
    assert np.isnan(never.first_entry)


def test_stabilisation_of_a_damped_oscillation():
    """Its envelope leaves the band for the last time where the closed form says."""
    time = np.arange(0, 12, 0.001)
    decay, frequency = 1.2, 2 * np.pi * 3
    signed = 2e-3 * np.exp(-decay * time) * np.cos(frequency * time)
    xyz = series(signed) + np.array([1.0, 2.0, 3.0])
    final = iso9283.final_position(time, xyz, 10.0)
    assert np.abs(final - [1.0, 2.0, 3.0]).max() < 2e-8
    found = iso9283.stabilisation(time, xyz, final, 1e-4)
    # last half swing whose peak is above the band; then the crossing on its far side
    from scipy.optimize import brentq

    peaks = np.flatnonzero(np.abs(signed) > 1e-4)
    exact = brentq(lambda t: 2e-3 * np.exp(-decay * t) * abs(np.cos(frequency * t)) - 1e-4, *time[peaks[-1] + [0, 1]])
    assert found.settled == pytest.approx(exact, abs=2e-5)
    assert found.overshoot == pytest.approx(2e-3 * np.exp(-decay / 6), rel=0.02), "first swing to the other side"


def test_final_position_needs_late_readings():
    with pytest.raises(MeasurementError, match="end at 5 s"):
        iso9283.final_position(np.array([0.0, 5.0]), np.zeros((2, 3)), 10.0)


def test_drift_by_hand():
    square = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    found = iso9283.drift([square, 2 * square + [0, 0, 3], 3 * square + [0, 0, 4]], np.zeros(3))
    assert found["RP"] == pytest.approx([1, 2, 3])
    assert found["AP"] == pytest.approx([0, 3, 4])
    assert found["shift"] == pytest.approx([0, 3, 4])
    assert (found["dAP"], found["dRP"]) == (pytest.approx(4), pytest.approx(2))
    assert "AP" not in iso9283.drift([square, square])


def test_path_errors_by_hand():
    """Straight path along x; three cycles beside it, sampled elsewhere and beyond the ends."""
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.13, 1.2, 37)
    paths = [np.column_stack([x, np.full(37, y), np.full(37, 0.004)]) for y in (0.002, 0.003, 0.004)]
    found = iso9283.path_errors(paths, commanded)
    assert len(found.planes) == 11
    assert pytest.approx(0.005, abs=1e-12) == found.AT
    away = np.array([0.001, 0.0, 0.001])
    assert pytest.approx(away.mean() + 3 * away.std(ddof=1), abs=1e-12) == found.RT
    with pytest.raises(MeasurementError, match="two cycles"):
        iso9283.path_errors(paths[:1], commanded)
    with pytest.raises(MeasurementError, match="crossed by every cycle"):
        iso9283.path_errors([paths[0], paths[1] + [5, 0, 0]], commanded)


def test_path_errors_of_a_circle_with_orientation():
    """Each plane cuts a circle twice: the near cut counts. Radius and one angle are off by known amounts."""
    turn = np.linspace(0, 1.9 * np.pi, 200)
    commanded = 0.3 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    fine = np.linspace(-0.05, 1.95 * np.pi, 3001)
    R = np.tile(np.eye(3), (200, 1, 1))
    paths, rotations = [], []
    for radius, angle in ((0.301, 0.01), (0.303, 0.02)):
        paths.append(radius * np.column_stack([np.cos(fine), np.sin(fine), 0 * fine]))
        rotations.append(np.tile(frames.rot_z(angle), (3001, 1, 1)))
    found = iso9283.path_errors(paths, commanded, rotations, R)
    assert pytest.approx(0.002, abs=1e-5) == found.AT, "chords of the commanded path tilt its end planes a little"
    assert pytest.approx(0.001, abs=1e-6) == found.RT
    assert np.abs(found.mean_angles - [0, 0, 0.015]).max() < 1e-12
    assert np.abs(found.angle_repeatability[:, 2] - 3 * 0.01 / np.sqrt(2)).max() < 1e-12
