"""Path criteria against values worked out by hand."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.modeling import frames
from irbcal.validation import path_check


def test_path_errors_by_hand():
    """Straight path along x; three cycles beside it, sampled elsewhere and beyond the ends."""
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.13, 1.2, 37)
    paths = [np.column_stack([x, np.full(37, y), np.full(37, 0.004)]) for y in (0.002, 0.003, 0.004)]
    found = path_check.path_errors(paths, commanded)
    assert len(found.planes) == 11
    assert pytest.approx(0.005, abs=1e-12) == found.AT
    away = np.array([0.001, 0.0, 0.001])
    assert pytest.approx(away.mean() + 3 * away.std(ddof=1), abs=1e-12) == found.RT
    with pytest.raises(MeasurementError, match="two cycles"):
        path_check.path_errors(paths[:1], commanded)
    with pytest.raises(MeasurementError, match="crossed by every cycle"):
        path_check.path_errors([paths[0], paths[1] + [5, 0, 0]], commanded)


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
    found = path_check.path_errors(paths, commanded, rotations, R)
    assert pytest.approx(0.002, abs=1e-5) == found.AT, "chords of the commanded path tilt its end planes a little"
    assert pytest.approx(0.001, abs=1e-6) == found.RT
    assert np.abs(found.mean_angles - [0, 0, 0.015]).max() < 1e-12
    assert np.abs(found.angle_repeatability[:, 2] - 3 * 0.01 / np.sqrt(2)).max() < 1e-12


def test_accuracy_is_that_of_the_worst_plane():
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.1, 1.1, 121)
    bump = 0.01 * np.exp(-(((x - 0.5) / 0.05) ** 2))
    paths = [np.column_stack([x, bump, 0 * x]), np.column_stack([x, 3 * bump, 0 * x])]
    found = path_check.path_errors(paths, commanded)
    assert pytest.approx(0.02, abs=1e-12) == found.AT
    assert pytest.approx(0.01, abs=1e-12) == found.RT
    assert np.linalg.norm(found.mean, axis=1).min() < 1e-9


def test_only_planes_that_all_cycles_cross_count():
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    paths = [np.array([[-0.1, 0, 0], [0.75, 0, 0]]), np.array([[0.25, 0, 0], [1.1, 0, 0]])]
    R = np.tile(np.eye(3), (11, 1, 1))
    found = path_check.path_errors(paths, commanded, [R[:2], R[:2]], R)
    assert found.planes.tolist() == [3, 4, 5, 6, 7]
    assert found.mean_angles.shape == (5, 3)
    assert np.abs(found.mean_angles).max() == 0.0


def test_a_commanded_path_moves_on_everywhere():
    still = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]])
    with pytest.raises(MeasurementError, match="do not move on"):
        path_check.path_errors([still, still], still)
    with pytest.raises(ValueError, match="read-only"):
        path_check.path_errors([still, still], still[[0, 1, 4]]).mean[0] = 0.0


def test_blocks_of_planes_change_nothing(monkeypatch):
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.1, 1.1, 37)
    paths = [np.column_stack([x, y + 0.01 * np.sin(9 * x), 0 * x]) for y in (0.0, 0.002, 0.003)]
    whole = path_check.path_errors(paths, commanded)
    monkeypatch.setattr(path_check, "BLOCK", 100)
    parts = path_check.path_errors(paths, commanded)
    assert np.array_equal(parts.mean, whole.mean)
    assert np.array_equal(parts.repeatability, whole.repeatability)


def test_of_two_cuts_the_near_one_counts():
    """Out and back in few, long segments: the way out passes the commanded points at 1 mm, the way back at 8 mm."""
    commanded = np.array([[0.2, 0, 0], [0.5, 0, 0], [0.7, 0, 0]])
    out_and_back = np.array([[0.0, 1e-3, 0], [1.0, 1e-3, 0], [1.0, 8e-3, 0], [0.0, 8e-3, 0]])
    for path in (out_and_back, out_and_back[::-1]):
        found = path_check.path_errors([path, path], commanded)
        assert np.abs(found.mean - [0, 1e-3, 0]).max() < 1e-15
    # a slanted segment: where it cuts the plane tells which is nearer, not where it begins
    slanted = np.array([[0.0, -0.04, 0], [1.0, 0.06, 0], [1.0, 0.015, 0], [0.0, 0.015, 0]])
    found = path_check.path_errors([slanted, slanted], commanded)
    assert found.mean[:, 1] == pytest.approx([0.015, 0.01, 0.015])


def test_samples_on_the_planes_cut_them():
    commanded = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    up = np.array([0, 2.0, 0])
    path = commanded + up
    found = path_check.path_errors([path, path + up], commanded)
    assert found.planes.tolist() == [0, 1, 2, 3, 4]
    assert np.abs(found.mean - [0, 3.0, 0]).max() < 1e-15
