"""Ballbar: closed forms, simulated robots and the tables of annex VI."""

import numpy as np
import pytest
from support import arm, random_robot

from irbcal.correction.path import Circle
from irbcal.correction.subdivision import subdivide
from irbcal.errors import MeasurementError, RobotError
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.validation import ballbar

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
    return ballbar.circle(nominal, q[0], radius, None, [0, 0, -1], [0, -1, 0], tilt=np.radians(tilt)), q[0]


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
    found = [r for r in ballbar.predict(path, Robot(nominal), nominal, q, arcs=0).reversals if r.joint != 6]
    assert len(found) == len(table)
    for angle, value, joint, kind in table:
        match = min((r for r in found if (r.joint, r.kind) == (joint, kind)), key=lambda r: abs(360 * r.s - angle))
        assert 360 * match.s == pytest.approx(angle, abs=2.0)
        assert np.degrees(match.angle) == pytest.approx(value, abs=0.25)


def small(nominal, **more):
    q = np.radians([10.0, 0, 0, 0, 90, 0])
    tool = ballbar.tool([0, 0.065, 0.149])
    return ballbar.circle(nominal, q, 0.15, tool, **more), q, tool


def test_nominal_robot_runs_a_true_circle():
    nominal = arm()
    path, q, tool = small(nominal, height=0.05, tilt=0.1)
    found = ballbar.predict(path, Robot(nominal), nominal, q, 5, tool)
    for trace in (found.uncorrected, found.corrected):
        assert np.abs(trace.error).max() < 1e-11
        assert np.abs(trace.shift).max() < 1e-11
    assert path.bar == pytest.approx(0.15)
    assert np.linalg.norm(path.poses([0.3])[0, :3, 3] - path.ball) == pytest.approx(0.15, abs=1e-15)


def test_fake_targets_bring_the_circle_back_as_the_path_correction_says():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, q, tool = small(nominal)
    found = ballbar.predict(path, robot, nominal, q, 8, tool)
    assert np.abs(found.corrected.error).max() < 0.1 * np.abs(found.uncorrected.error).max()
    half = Circle(path.T_start, path.poses([0.5])[0], path.center, path.normal, np.pi)
    cut = subdivide(half, robot, nominal, q, length=path.length / 8, T_tip_tcp=tool)
    first = found.corrected.angle < np.pi
    assert np.abs(found.corrected.error[first]).max() < 1.2 * cut.deviation
    with pytest.raises(RobotError, match="two arcs"):
        ballbar.predict(path, robot, nominal, q, 1, tool)


def test_trace_of_an_ellipse():
    """Half axes R + e and R - e: the radial error is e cos 2 angle, whatever the shift of the ball."""
    nominal = arm()
    path, _, _ = small(nominal)
    turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    e = 2e-4
    points = path.center + np.array([3e-4, -2e-4, 5e-4])
    points = points + np.column_stack([(0.15 + e) * np.cos(turn), (0.15 - e) * np.sin(turn), 0 * turn])
    trace = ballbar.trace_of_points(path, points)
    assert trace.shift == pytest.approx([3e-4, -2e-4], abs=1e-9)
    true = np.arctan2(points[:, 1] - path.center[1] + 2e-4, points[:, 0] - path.center[0] - 3e-4)
    order = np.argsort(np.arctan2(*(points - path.center)[:, 1::-1].T) % (2 * np.pi), kind="stable")
    assert np.abs(trace.error - e * np.cos(2 * true[order])).max() < 1e-6
    assert ballbar.summary(trace)["circularity_mm"] == pytest.approx(0.4, abs=1e-3)


def ballbar_file(path, angle, radius, header="angle_deg,radius_mm"):
    np.savetxt(path, np.column_stack([angle, radius]), "%.6f", ",", header=header, comments="")
    return path


def test_measured_file_with_an_eccentric_ball(tmp_path):
    angle = np.arange(0, 360, 3.0)
    a = np.radians(angle)
    radius = 150.02 + 0.3 * np.cos(a) - 0.1 * np.sin(a) + 0.05 * np.cos(2 * a)
    trace = ballbar.read(ballbar_file(tmp_path / "b.csv", angle, radius), 0.15)["measured"]
    assert trace.shift == pytest.approx([3e-4, -1e-4], abs=1e-8)
    assert np.abs(trace.error - (2e-5 + 5e-5 * np.cos(2 * a))).max() < 1e-8
    same = ballbar.read(ballbar_file(tmp_path / "e.csv", angle, radius - 150, "angle_deg,error_mm"), 0.15)["measured"]
    assert np.abs(same.error - trace.error).max() < 1e-9


def test_prediction_explains_what_the_calibrated_robot_does(tmp_path):
    """Readings of a robot that is truly the calibrated one, with 5 um noise and an eccentric ball."""
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, q, tool = small(nominal)
    found = ballbar.predict(path, robot, nominal, q, 0, tool)
    angle = np.arange(0, 360, 2.0)
    a = np.radians(angle)
    noise = 5e-3 * np.random.default_rng(0).standard_normal(180)
    radius = 150 + found.uncorrected.at(a) * 1e3 + 0.2 * np.cos(a) + noise
    trace = ballbar.read(ballbar_file(tmp_path / "m.csv", angle, radius), 0.15)["measured"]
    before, after = ballbar.explained(trace, found.uncorrected)
    assert after < 6e-6 < before


def test_backlash_shows_where_the_reversals_are_marked():
    """Joint 2 with 0.01 degrees of play: the trace jumps where that joint turns back, and there alone."""
    nominal = arm()
    path, q_center, tool = small(nominal)
    found = ballbar.predict(path, Robot(nominal), nominal, q_center, 0, tool)
    q = found.q.copy()
    q[:, 1] += np.radians(0.005) * np.sign(np.gradient(found.q[:, 1]))
    trace = ballbar.trace_of_points(path, (nominal.forward(q) @ tool)[:, :3, 3])
    jump = np.abs(np.diff(trace.error))
    places = np.degrees(trace.angle[:-1][jump > 10 * np.median(jump)])
    marked = np.array([360 * r.s for r in found.reversals if r.joint == 2])
    assert len(marked) == 2
    apart = np.abs((places[:, None] - marked + 180) % 360 - 180)
    assert apart.min(axis=1).max() < 1.5, "no jump elsewhere"
    assert apart.min(axis=0).max() < 1.5, "a jump at each"


def test_refusals(tmp_path):
    angle = np.arange(0, 120, 3.0)
    with pytest.raises(MeasurementError, match=r"run measured: the centre needs .* over 117 degrees"):
        ballbar.read(ballbar_file(tmp_path / "short.csv", angle, 150 + 0 * angle), 0.15)
    with pytest.raises(MeasurementError, match="another circle"):
        ballbar.read(ballbar_file(tmp_path / "far.csv", 3 * angle, 300 + 0 * angle), 0.15)
    with pytest.raises(MeasurementError, match="found neither"):
        ballbar.read(ballbar_file(tmp_path / "no.csv", angle, angle, "angle_deg,r"), 0.15)
    nominal = arm()
    with pytest.raises(RobotError, match="along its normal"):
        small(nominal, start=[0, 0, 1])
    with pytest.raises(RobotError, match="longer than"):
        small(nominal, height=0.2)
    path = ballbar.circle(nominal, np.radians([0, 0, 0, 0, 90, 0]), 1.2)
    with pytest.raises(RobotError, match="does not reach"):
        ballbar.predict(path, Robot(nominal), nominal, np.zeros(6), 0)
