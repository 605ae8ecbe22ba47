"""Predicted circles: the tables of annex VI, simulated robots, fake targets and backlash."""

import numpy as np
import pytest
from circles import small
from support import arm, random_robot

from irbcal.correction.paths import Circle, subdivide
from irbcal.errors import RobotError
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.validation import ballbar_check
from irbcal.validation.ballbar_check import circle, predict

CENTER_JOINTS = np.radians([-3.984, 5.733483, 4.519, -0.017, 79.885, -273.988])
"""Joints that annex VI gives for the middle of its tests."""


def thesis_circle(nominal, radius, height, tilt):
    """The flange's circle of annex VI.

    The flange goes round a point 65 mm (the cup's distance) in front of the given one. Radius and height are those that
    forward kinematics gives for the table's own joints 2, 3 and 5 at the nearest and farthest point: the ballbar stood
    inclined, so the radius is not the test's.
    """
    T = nominal.forward(CENTER_JOINTS[None])[0]
    T[0, 3] += 0.065
    T[2, 3] = height
    q, _ = closed_form.nearest(nominal, closed_form.branches(nominal, T[None]), CENTER_JOINTS)
    return circle(nominal, q[0], radius, None, [0, 0, -1], [0, -1, 0], tilt=np.radians(tilt)), q[0]


@pytest.mark.parametrize(
    ("radius", "height", "tilt", "table"),
    [
        (
            0.2346,
            1.0106,
            0.0,
            [
                (18.7, -19.2, 1, "min"),
                (19.3, -0.1, 4, "min"),
                (44.7, 79.6, 5, "min"),
                (93.3, -8.2, 2, "min"),
                (93.3, 18.1, 3, "max"),
                (93.3, 80.3, 5, "max"),
                (141.3, 79.6, 5, "min"),
                (167.3, 11.8, 1, "max"),
                (167.3, 0.0, 4, "max"),
                (273.3, 31.0, 2, "max"),
                (273.3, -29.9, 3, "min"),
                (273.3, 89.1, 5, "max"),
            ],
        ),
        (
            0.3449,
            1.0155,
            4.0,
            [
                (26.5, -27.2, 1, "min"),
                (28.0, 4.0, 4, "max"),
                (55.0, 78.6, 5, "min"),
                (93.0, -18.3, 2, "min"),
                (93.0, 25.0, 3, "max"),
                (93.0, 79.4, 5, "max"),
                (131.5, 78.6, 5, "min"),
                (158.5, -4.0, 4, "min"),
                (159.5, 19.8, 1, "max"),
                (273.0, 43.4, 2, "max"),
                (273.0, -51.5, 3, "min"),
                (273.0, 102.2, 5, "max"),
            ],
        ),
        (
            0.1462,
            1.0243,
            22.5,
            [
                (13.2, -15.0, 1, "min"),
                (17.2, 22.7, 4, "max"),
                (92.6, -3.0, 2, "min"),
                (92.6, 12.7, 3, "max"),
                (92.6, 58.0, 5, "min"),
                (166.8, -22.8, 4, "min"),
                (170.7, 7.6, 1, "max"),
                (272.6, 25.2, 2, "max"),
                (272.6, -21.8, 3, "min"),
                (272.6, 109.3, 5, "max"),
            ],
        ),
    ],
)
def test_joint_reversals_of_annex_vi(radius, height, tilt, table):
    """Tables A VI-1 to A VI-3, printed to about 0.7 and 0.1 degrees."""
    nominal = arm()
    path, q = thesis_circle(nominal, radius, height, tilt)
    found = [r for r in predict(path, Robot(nominal), nominal, q, arcs=0).reversals if r.joint != 6]
    assert len(found) == len(table)
    for angle, value, joint, kind in table:
        match = min((r for r in found if (r.joint, r.kind) == (joint, kind)), key=lambda r: abs(360 * r.s - angle))
        assert 360 * match.s == pytest.approx(angle, abs=2.0)
        assert np.degrees(match.angle) == pytest.approx(value, abs=0.25)


def test_nominal_robot_runs_a_true_circle():
    nominal = arm()
    path, q, tool = small(nominal, height=0.05, tilt=0.1)
    found = predict(path, Robot(nominal), nominal, q, 5, tool)
    for trace in (found.uncorrected, found.corrected):
        assert np.abs(trace.error).max() < 1e-11
        assert np.abs(trace.shift).max() < 1e-11
    assert path.bar == pytest.approx(0.15)
    assert np.linalg.norm(path.poses([0.3])[0, :3, 3] - path.ball) == pytest.approx(0.15, abs=1e-15)


def test_fake_targets_bring_the_circle_back_as_the_path_correction_says():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, q, tool = small(nominal)
    found = predict(path, robot, nominal, q, 8, tool)
    assert np.abs(found.corrected.error).max() < 0.1 * np.abs(found.uncorrected.error).max()
    half = Circle(path.T_start, path.poses([0.5])[0], path.center, path.normal, np.pi)
    cut = subdivide(half, robot, nominal, q, length=path.length / 8, T_tip_tcp=tool)
    first = found.corrected.angle < np.pi
    assert np.abs(found.corrected.error[first]).max() < 1.2 * cut.deviation
    with pytest.raises(RobotError, match="two arcs"):
        predict(path, robot, nominal, q, 1, tool)


def test_backlash_shows_where_the_reversals_are_marked():
    """Joint 2 with 0.01 degrees of play: the trace jumps where that joint turns back, and there alone."""
    nominal = arm()
    path, q_center, tool = small(nominal)
    found = predict(path, Robot(nominal), nominal, q_center, 0, tool)
    q = found.q.copy()
    q[:, 1] += np.radians(0.005) * np.sign(np.gradient(found.q[:, 1]))
    trace = ballbar_check.trace_of_points(path, (nominal.forward(q) @ tool)[:, :3, 3])
    jump = np.abs(np.diff(trace.error))
    places = np.degrees(trace.angle[:-1][jump > 10 * np.median(jump)])
    marked = np.array([360 * r.s for r in found.reversals if r.joint == 2])
    assert len(marked) == 2
    apart = np.abs((places[:, None] - marked + 180) % 360 - 180)
    assert apart.min(axis=1).max() < 1.5, "no jump elsewhere"
    assert apart.min(axis=0).max() < 1.5, "a jump at each"


def test_circles_out_of_reach_are_refused():
    nominal = arm()
    path = circle(nominal, np.radians([0, 0, 0, 0, 90, 0]), 1.2)
    with pytest.raises(RobotError, match="does not reach"):
        predict(path, Robot(nominal), nominal, np.zeros(6), 0)


def test_it_is_printed_short():
    nominal = arm()
    q = np.radians([0, 0, 0, 0, 90.0, 0])
    assert 10 < len(repr(predict(circle(nominal, q, 0.15), Robot(nominal), nominal, q))) < 200
