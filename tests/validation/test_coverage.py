"""Coverage of intervals: counted by hand, in words, and by evaluate."""

from dataclasses import replace

import numpy as np
import pytest
from support import measured

import irbcal
from irbcal.io import robots
from irbcal.validation.accuracy import coverage, coverage_in_words


@pytest.fixture(scope="module")
def points(record):
    robot = record.robot_calibrated()
    low, high = robot.certainty.ranges
    q = low + (high - low) * np.random.default_rng(1).uniform(0.02, 0.98, (40, 6))
    return measured(robot, q, 2e-5, np.random.default_rng(3))


def test_coordinates_are_counted(record, points):
    robot = record.robot_calibrated()
    found = coverage(robot, points)
    assert found["expected"] == 0.95
    inside = 0
    for k, name in enumerate(points.target_names):
        mine = points.target == k
        seen = robot.predict(points.q[points.pose[mine]], target=name)
        each = np.abs(points.xyz[mine] - seen.position) < seen.interval
        assert found["parts"][name]["inside"] == pytest.approx(each.mean())
        inside += each.sum()
    assert found["parts"]["all"] == {**found["parts"]["all"], "n": 360, "inside": inside / 360}
    assert "outside" not in found["parts"]


def test_poses_outside_are_counted_apart(record, points):
    robot = record.robot_calibrated()
    q = points.q.copy()
    q[:4, 1] = robot.certainty.ranges[1, 1] + 0.05
    xyz = points.predicted(robot)
    moved = replace(points, q=q, xyz=xyz)  # far from where these joints lead
    parts = coverage(robot, moved)["parts"]
    assert (parts["outside"]["n"], parts["within"]["n"]) == (36, 324)
    assert parts["outside"]["inside"] < 0.5
    assert parts["within"]["inside"] == 1.0
    assert coverage_in_words(coverage(robot, moved)).endswith("% outside.")


def test_without_certainty_there_is_none(record, points):
    assert coverage(record.robot_nominal(), points) is None


def test_evaluate_says_whether_intervals_hold(record):
    found = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"))
    share = found.coverage["parts"]["all"]["inside"]
    assert 0.88 < share <= 1.0
    assert f"{share:.1%} of " in found.summary()
    assert found.to_dict()["coverage"]["expected"] == 0.95
    table = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"), intervals=True).summary()
    assert "Coordinates within the predicted 95 % intervals" in table
    assert irbcal.evaluate(record, robots.demo_file("demo_verification.csv"), refit_base=True).coverage is None
