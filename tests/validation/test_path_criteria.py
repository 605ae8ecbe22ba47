"""Path criteria against values worked out by hand."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.modeling import frames
from irbcal.validation import path_criteria


def test_path_errors_by_hand():
    """Straight path along x; three cycles beside it, sampled elsewhere and beyond the ends."""
    commanded = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    x = np.linspace(-0.13, 1.2, 37)
    paths = [np.column_stack([x, np.full(37, y), np.full(37, 0.004)]) for y in (0.002, 0.003, 0.004)]
    found = path_criteria.path_errors(paths, commanded)
    assert len(found.planes) == 11
    assert pytest.approx(0.005, abs=1e-12) == found.AT
    away = np.array([0.001, 0.0, 0.001])
    assert pytest.approx(away.mean() + 3 * away.std(ddof=1), abs=1e-12) == found.RT
    with pytest.raises(MeasurementError, match="two cycles"):
        path_criteria.path_errors(paths[:1], commanded)
    with pytest.raises(MeasurementError, match="crossed by every cycle"):
        path_criteria.path_errors([paths[0], paths[1] + [5, 0, 0]], commanded)


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
    found = path_criteria.path_errors(paths, commanded, rotations, R)
    assert pytest.approx(0.002, abs=1e-5) == found.AT, "chords of the commanded path tilt its end planes a little"
    assert pytest.approx(0.001, abs=1e-6) == found.RT
    assert np.abs(found.mean_angles - [0, 0, 0.015]).max() < 1e-12
    assert np.abs(found.angle_repeatability[:, 2] - 3 * 0.01 / np.sqrt(2)).max() < 1e-12
