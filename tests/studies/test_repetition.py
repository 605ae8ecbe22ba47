"""One calibration of a study: which measurements it is made from, and the course of a search."""

import numpy as np
import pytest

from irbcal.studies.repetition import COURSE_UNUSED, choice, identify
from irbcal.studies.settings import AREAS, AXES, COURSE, NOMINAL, Repetition


def test_measurements_are_axis_points_and_a_choice_of_both_areas(stage):
    points = choice(stage.axes[18], stage.identification, (31, 31), 5)
    assert points.poses == 80
    again = choice(stage.axes[18], stage.identification, (31, 31), 5)
    np.testing.assert_array_equal(points.q, again.q)
    for part, pool in zip((points.q[18:49], points.q[49:]), (stage.identification[a].q for a in AREAS), strict=True):
        assert all((np.abs(pool - q).max(axis=1) == 0).any() for q in part)
    assert np.abs(points.q[:18]).max() == pytest.approx(np.radians(30), abs=1e-12)


def test_each_kind_of_repetition_gives_the_models_that_it_names(stage):
    ((method, robot, largest),), course = identify(stage, NOMINAL)
    assert (method, course) == ("", None)
    assert robot.arm is stage.cell.arm
    assert 1e-4 < largest < 5e-3
    ((method, robot, _),), _ = identify(stage, AXES[18])
    assert method == "axes"
    assert sorted(robot.targets) == sorted(stage.first.targets)
    (found,), _ = identify(stage, Repetition("34", 80))
    assert found[0] == "least-squares"
    assert {term.family for term in found[1].joint_map.terms.terms} == {"thesis"}


def test_the_watched_search_leaves_points_aside(stage, monkeypatch):
    seen = {}

    def fitted(arm, points, level, targets, watched=None, **options):
        seen.update(points=points, watched=watched, level=level, options=options)
        raise KeyboardInterrupt  # two thousand iterations are not needed to see what goes in

    monkeypatch.setattr("irbcal.studies.repetition.fitted", fitted)
    with pytest.raises(KeyboardInterrupt):
        identify(stage, COURSE)
    assert (seen["level"], seen["options"]) == ("34", {"method": "nelder-mead"})
    assert {area: points.poses for area, points in seen["watched"].items()} == dict.fromkeys(AREAS, COURSE_UNUSED)
    for points in seen["watched"].values():
        assert np.abs(points.xyz[:, None] - seen["points"].xyz[None]).max(axis=2).min() > 1e-6
