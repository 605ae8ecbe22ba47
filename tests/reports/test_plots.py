"""Figures of a report show what was measured."""

import re

import numpy as np
import pytest
from report_cases import drawings


def by_hand(calibration, heldout, name):
    """Mean distance of each pose's points, mm, by name of the pose, point by point."""
    points, _ = calibration.used_points(heldout)
    robot = calibration.robot_calibrated() if name == "calibrated" else calibration.robot_nominal()
    out = {}
    for k, (target, place) in enumerate(zip(points.names(), points.xyz, strict=True)):
        pose = points.pose[k]
        off = np.linalg.norm(place - robot.points(points.q[pose][None], target)[0])
        out.setdefault(str(points.pose_ids[pose]), []).append(1e3 * off)
    return {pose: np.mean(values) for pose, values in out.items()}


def marks(svg, model):
    """Title, x and y of the circles of one model."""
    found = svg.xpath(f".//g[contains(@style, 'var(--{model})')]/circle")
    return [(c.findtext("title"), float(c.get("cx")), float(c.get("cy"))) for c in found]


@pytest.mark.parametrize(("heldout", "name"), [(True, "nominal"), (True, "calibrated"), (False, "calibrated")])
def test_errors_by_pose_are_drawn_where_they_belong(calibration, page, heldout, name):
    (svg,) = drawings(page, f"Position error of each {'held-out' if heldout else 'fitted'} pose")
    expected = by_hand(calibration, heldout, name)
    found = marks(svg, name)
    assert len(found) == len(expected)
    said = [re.fullmatch(rf"pose (\d+): {name} (\d+\.\d{{3}}) mm", title).groups() for title, _, _ in found]
    assert {pose: float(error) for pose, error in said} == {pose: round(e, 3) for pose, e in expected.items()}
    error = np.array([expected[pose] for pose, _ in said])
    x, y = np.array([place for _, *place in found]).T
    slope, offset = np.polyfit(error, y, 1)
    assert slope < 0
    assert np.abs(offset + slope * error - y).max() < 0.06  # rounded to a tenth
    assert np.ptp(np.diff(x)) < 0.21


def test_histogram_counts_every_point(calibration, page):
    (svg,) = drawings(page, "Histogram of the position errors of the held-out points")
    counts = [
        re.findall(r"(nominal|calibrated) (\d+)", title) for title in svg.xpath(".//g[@class='hover']//title/text()")
    ]
    for name in ("nominal", "calibrated"):
        total = sum(int(count) for row in counts for model, count in row if model == name)
        assert total == calibration.heldout.all.n


def test_arrows_point_from_predicted_to_measured(calibration, evidence):
    """Vectors along the base link's axes: the measured place lies there from the predicted one."""
    (heldout, _) = evidence.sets
    robot = calibration.robot_nominal()
    vector, points = heldout.models["nominal"].vector, heldout.points
    for k in range(0, len(points), 17):
        predicted = robot.points(points.joints()[k : k + 1], points.names()[k])[0]
        at_world = robot.T_world_base[:3, :3] @ vector[k]
        assert np.abs(predicted + at_world - points.xyz[k]).max() < 1e-12
    assert np.abs(np.linalg.norm(vector, axis=1) - heldout.models["nominal"].distance).max() < 1e-8
