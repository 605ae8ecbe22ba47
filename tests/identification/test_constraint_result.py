import feature_cases as cases
import numpy as np
import pytest

from irbcal.identification.feature_fit import as_points, identify_features, shape_only


@pytest.fixture(scope="module")
def fit():
    return identify_features(cases.arm(), cases.seen("point", cases.true_arm(cases.arm(), 7), 30))


def test_a_base_that_nothing_shows_is_held_and_not_counted(fit):
    rows = {row.name: row for row in fit.parameters()}
    assert all(rows[f"base_{name}"].state == "held" for name in ("x", "y", "z", "rx", "ry", "rz"))
    assert rows["target_ball_x"].state == "identified"
    assert fit.parameter_count == len(rows) - 6
    assert fit.scale_measured is False
    np.testing.assert_array_equal(fit.robot.T_world_base, np.eye(4))


def test_rms_is_that_of_the_rows(fit):
    found = fit
    assert fit.rms == pytest.approx(np.sqrt(np.mean(found.problem.residuals(found.state) ** 2)))
    assert fit.rms < 0.01e-3


def test_less_is_open_after_the_rows_than_before(fit):
    before, after = fit.left_open()
    assert 1e-3 < before < 10e-3
    assert after < 0.5 * before


def test_rows_are_points_without_places():
    seen = cases.seen("plane", cases.arm(), 5)
    points = as_points(seen)
    assert points.poses == len(points) == 15
    assert not points.xyz.any()
    assert list(dict.fromkeys(points.groups)) == ["plane 0", "plane 1", "plane 2"]
    assert shape_only(seen)
    assert not shape_only(cases.seen("point", cases.arm(), 5))
