"""The door to the ballbar: options, what was run, and what it tells."""

import pickle

import numpy as np
import pandas as pd
import pytest
from circles import small
from support import arm, random_robot, random_rotation

from irbcal.correction.paths import Circle, _Cutter
from irbcal.errors import MeasurementError, OptionError, RobotError
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.validation import ballbar_check
from irbcal.validation.ballbar_check import ballbar, by_joints, circle, predict, tool_frame, trace_of_points

TOOL = (0.0, 0.065, 0.149)
JOINTS = np.radians([10.0, 0, 0, 0, 90, 0])


@pytest.fixture(scope="module")
def found(record):
    return ballbar(record, tool=TOOL, joints=JOINTS)


def test_prediction_is_that_of_the_calibrated_robot(record, found):
    nominal = record.arm(calibrated=False)
    path = circle(nominal, JOINTS, 0.15, tool_frame(TOOL))
    expected = predict(path, record.robot_calibrated(), nominal, JOINTS, 6, tool_frame(TOOL))
    assert np.array_equal(found.prediction.uncorrected.error, expected.uncorrected.error)
    assert np.array_equal(found.prediction.corrected.error, expected.corrected.error)


def test_what_it_tells(found):
    data = found.to_dict()
    assert data["simulated"]
    assert data["fake_targets"]["circularity_mm"] < 0.1 * data["nominal_targets"]["circularity_mm"]
    assert data["reversals"][0]["joint"] == found.prediction.reversals[0].joint
    assert data["reversals"][0]["path_angle_deg"] == pytest.approx(360 * found.prediction.reversals[0].s, rel=1e-12)
    text = found.summary()
    assert "Calibration from SIMULATED data: radial errors of the circle, ballbar 150 mm" in text
    assert "Joints that turn back" in text
    said = repr(found)
    assert said.startswith(
        "<BallbarCheck: Calibration from SIMULATED data: circularity with a bar of 150 mm: nominal targets, predicted 0."
    )
    assert len(said) < 2000
    assert found.to_frame()["trace"].unique().tolist() == list(found.traces())
    assert pickle.loads(pickle.dumps(found)).to_dict() == data
    with pytest.raises(ValueError, match="read-only"):
        found.prediction.q[0] = 0.0


def test_simulated_readings_are_named(record, found, tmp_path):
    rows = [f"{a},0.01,yes\n" for a in np.arange(0, 360, 4.0)]
    (tmp_path / "m.csv").write_text("angle_deg,error_mm,simulated\n" + "".join(rows))
    told = ballbar(record, tmp_path / "m.csv", tool=TOOL, joints=JOINTS)
    assert told.mark == "Calibration from SIMULATED data, SIMULATED readings"
    assert told.plot().mark == f"{told.mark}. "
    assert not found.simulated_readings


@pytest.mark.parametrize(("now", "before"), [("yes", "no"), ("no", "yes"), ("no", "no")])
def test_a_simulated_baseline_is_named_as_well(record, now, before):
    table = pd.DataFrame({"angle_deg": np.arange(0, 360, 4.0), "error_mm": 0.01})
    new, old = (table.assign(simulated=answer) for answer in (now, before))
    check = ballbar(record, new, tool=TOOL, joints=JOINTS, arcs=0, baseline=old)
    assert check.simulated_readings == ("yes" in (now, before))


def test_measured_runs_are_compared_with_what_was_run(record, found, tmp_path):
    angle = np.arange(0, 360, 4.0)
    error = 1e3 * found.prediction.corrected.at(np.radians(angle))
    rows = [f"{a},{150 + e:.9f},{run}\n" for run in ("cw", "ccw") for a, e in zip(angle, error, strict=True)]
    (tmp_path / "m.csv").write_text("angle_deg,radius_mm,run\n" + "".join(rows))
    fake = ballbar(record, tmp_path / "m.csv", tool=TOOL, joints=JOINTS, run="fake")
    assert [run["unexplained_rms_mm"] < 2e-5 for run in fake.to_dict()["measured"].values()] == [True, True]
    nominal = ballbar(record, tmp_path / "m.csv", tool=TOOL, joints=JOINTS, arcs=0)
    assert nominal.prediction.corrected is None
    assert nominal.to_dict()["fake_targets"] is None
    unexplained = [found.to_dict()["measured"]["cw"]["unexplained_rms_mm"] for found in (nominal, fake)]
    assert unexplained[0] > 100 * unexplained[1], "the nominal path is another one"
    assert list(nominal.traces()) == ["nominal targets, predicted", "measured, run cw", "measured, run ccw"]
    assert "Run cw: the readings vary by" in nominal.summary()
    assert "path of calibrated targets" in fake.summary()
    svg = tmp_path / "b.svg"
    fake.plot(magnify=200).save(svg)
    assert "errors × 200" in svg.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "parameter"),
    [({"run": "real"}, "run"), ({"run": "fake", "arcs": 0}, "arcs"), ({"arcs": 513}, "arcs"), ({"arcs": -1}, "arcs")],
)
def test_wrong_options(options, parameter, record):
    with pytest.raises(OptionError) as refused:
        ballbar(record, **options)
    assert refused.value.parameter == parameter


def test_joints_of_another_arm(record):
    with pytest.raises(RobotError, match="need shape"):
        ballbar(record, joints=[0.0, 0.0])
    with pytest.raises(RobotError, match="along its normal"):
        ballbar(record, start=(0, 0, 2))


@pytest.mark.parametrize(
    ("options", "parameter", "words"),
    [
        ({"bar": 150}, "bar", "metres expected, at most 100, found 150: this looks like millimetres"),
        ({"bar": "150"}, "bar", "expected a number, found '150'"),
        ({"height": 180}, "height", "looks like millimetres"),
        ({"tool": (0, 65, 149)}, "tool", "looks like millimetres"),
        ({"tool": (0, 0.065)}, "tool", "expected x, y, z in metres"),
        ({"arcs": "6"}, "arcs", "expected a whole number"),
    ],
)
def test_sizes_are_numbers_in_metres(record, options, parameter, words):
    with pytest.raises(OptionError, match=words) as refused:
        ballbar(record, **options)
    assert refused.value.parameter == parameter


def test_the_bar_reaches_from_the_ball_to_every_place():
    path, _, _ = small(arm(), height=0.05, tilt=0.1)
    places = path.poses(np.linspace(0, 1, 9))[:, :3, 3]
    assert np.abs(np.linalg.norm(places - path.ball, axis=1) - 0.15).max() < 1e-15
    assert path.ball == pytest.approx(path.center - [0, 0, 0.05])
    assert path.bar == pytest.approx(0.15)


def test_the_tool_leans_inwards():
    """Its z axis points down here: the tip of that axis leans towards the centre by the tilt."""
    tilt = np.radians(8.0)
    upright, leaning = (small(arm(), tilt=t)[0] for t in (0.0, tilt))
    s = np.linspace(0, 1, 5)[:-1]
    before, after = upright.poses(s), leaning.poses(s)
    inwards = (upright.center - before[:, :3, 3]) / 0.15
    assert np.abs(np.einsum("ij,ij->i", before[:, :3, 2], after[:, :3, 2]) - np.cos(tilt)).max() < 1e-12
    assert np.abs(np.einsum("ij,ij->i", inwards, after[:, :3, 2]) - np.sin(tilt)).max() < 1e-12
    assert np.array_equal(before[:, :3, 3], after[:, :3, 3])


def test_no_circles():
    nominal = arm()
    with pytest.raises(RobotError, match="along its normal"):
        small(nominal, start=[0, 0, 1])
    with pytest.raises(RobotError, match="longer than"):
        small(nominal, height=0.2)
    with pytest.raises(RobotError, match="needs a normal"):
        small(nominal, normal=[0, 0, 0])


def test_tools():
    from scipy.spatial.transform import Rotation

    R = random_rotation(np.random.default_rng(0))
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    T = tool_frame([0.1, 0.2, 0.3, w, x, y, z])
    assert np.abs(T[:3, :3] - R).max() < 1e-14
    assert T[:3, 3].tolist() == [0.1, 0.2, 0.3]
    assert np.array_equal(tool_frame([0.1, 0.2, 0.3])[:3, :3], np.eye(3))
    with pytest.raises(RobotError, match="unit quaternion, found one of length 2"):
        tool_frame([0, 0, 0, 2, 0, 0, 0])


def test_trace_of_an_ellipse():
    """Half axes R + e and R - e: the radial error is e cos 2 angle, whatever the shift of the ball."""
    nominal = arm()
    path, _, _ = small(nominal)
    turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    e = 2e-4
    points = path.center + np.array([3e-4, -2e-4, 5e-4])
    points = points + np.column_stack([(0.15 + e) * np.cos(turn), (0.15 - e) * np.sin(turn), 0 * turn])
    trace = ballbar_check.trace_of_points(path, points)
    assert trace.shift == pytest.approx([3e-4, -2e-4], abs=1e-9)
    true = np.arctan2(points[:, 1] - path.center[1] + 2e-4, points[:, 0] - path.center[0] - 3e-4)
    order = np.argsort(np.arctan2(*(points - path.center)[:, 1::-1].T) % (2 * np.pi), kind="stable")
    assert np.abs(trace.error - e * np.cos(2 * true[order])).max() < 1e-6
    assert trace.statistics()["circularity_mm"] == pytest.approx(0.4, abs=1e-3)


def ballbar_file(path, angle, radius, header="angle_deg,radius_mm"):
    np.savetxt(path, np.column_stack([angle, radius]), "%.6f", ",", header=header, comments="")
    return path


def test_measured_file_with_an_eccentric_ball(tmp_path):
    angle = np.arange(0, 360, 3.0)
    a = np.radians(angle)
    radius = 150.02 + 0.3 * np.cos(a) - 0.1 * np.sin(a) + 0.05 * np.cos(2 * a)
    trace = ballbar_check.read_traces(ballbar_file(tmp_path / "b.csv", angle, radius), 0.15)[0]["measured"]
    assert trace.shift == pytest.approx([3e-4, -1e-4], abs=1e-8)
    assert np.abs(trace.error - (2e-5 + 5e-5 * np.cos(2 * a))).max() < 1e-8
    of_errors = ballbar_file(tmp_path / "e.csv", angle, radius - 150, "angle_deg,error_mm")
    same = ballbar_check.read_traces(of_errors, 0.15)[0]["measured"]
    assert np.abs(same.error - trace.error).max() < 1e-9


def test_prediction_explains_what_the_calibrated_robot_does(tmp_path):
    """Readings of a robot that is truly the calibrated one, with 5 um noise and an eccentric ball."""
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, q, tool = small(nominal)
    found = predict(path, robot, nominal, q, 0, tool)
    angle = np.arange(0, 360, 2.0)
    a = np.radians(angle)
    noise = 5e-3 * np.random.default_rng(0).standard_normal(180)
    radius = 150 + found.uncorrected.at(a) * 1e3 + 0.2 * np.cos(a) + noise
    trace = ballbar_check.read_traces(ballbar_file(tmp_path / "m.csv", angle, radius), 0.15)[0]["measured"]
    before, after = ballbar_check.explained(trace, found.uncorrected)
    assert after < 6e-6 < before


def test_refusals(tmp_path):
    angle = np.arange(0, 120, 3.0)
    with pytest.raises(MeasurementError, match=r"run measured: the centre needs .* over 117 degrees"):
        ballbar_check.read_traces(ballbar_file(tmp_path / "short.csv", angle, 150 + 0 * angle), 0.15)
    with pytest.raises(MeasurementError, match="another circle") as refused:
        ballbar_check.read_traces(ballbar_file(tmp_path / "far.csv", 3 * angle, 300 + 0 * angle), 0.15)
    assert (refused.value.file, refused.value.column) == (str(tmp_path / "far.csv"), "radius_mm")
    with pytest.raises(MeasurementError, match="expected a column radius_mm or error_mm, found angle_deg, r"):
        ballbar_check.read_traces(ballbar_file(tmp_path / "no.csv", angle, angle, "angle_deg,r"), 0.15)


def test_half_a_circle_is_enough_and_less_is_not():
    angle = np.radians(np.linspace(0, 180, 40))
    error = 2e-5 + 3e-4 * np.cos(angle)
    trace = ballbar_check.centred(angle, error)
    assert trace.shift == pytest.approx([3e-4, 0.0], abs=1e-12)
    assert np.abs(trace.error - 2e-5).max() < 1e-12
    with pytest.raises(MeasurementError, match="found 7 over 309 degrees"):
        ballbar_check.centred(np.radians(np.arange(7) * 360 / 7), np.zeros(7))
    with pytest.raises(MeasurementError, match="179 degrees"):
        ballbar_check.centred(angle * 179 / 180, error)


def test_figures_of_a_trace_by_hand():
    trace = ballbar_check.Trace(np.arange(4.0), np.array([1e-3, -3e-3, 0.0, 0.0]), np.array([1e-3, 2e-3]))
    expected = {"n": 4, "mean_mm": -0.5, "rms_mm": np.sqrt(2.5), "max_abs_mm": 3.0, "circularity_mm": 4.0}
    found = trace.statistics()
    assert found.pop("shift_mm") == pytest.approx([1.0, 2.0])
    assert found == pytest.approx(expected)
    assert trace.at(2 * np.pi + 0.5) == pytest.approx(-1e-3), "around the circle"
    with pytest.raises(ValueError, match="read-only"):
        trace.error[0] = 0.0


def test_explained_takes_the_mean_off_both():
    angle = np.radians(np.arange(0, 360, 5.0))
    measured = ballbar_check.Trace(angle, 5e-5 + 1e-4 * np.cos(2 * angle), np.zeros(2))
    predicted = ballbar_check.Trace(angle, -7e-5 + 1e-4 * np.cos(2 * angle), np.zeros(2))
    before, after = ballbar_check.explained(measured, predicted)
    assert before == pytest.approx(1e-4 / np.sqrt(2), rel=1e-9)
    assert after < 1e-12


def test_runs_of_a_frame(tmp_path):
    angle = np.tile(np.arange(0, 360, 10.0), 2)
    table = pd.DataFrame(
        {"angle_deg": angle, "error_mm": np.repeat([0.1, 0.3], 36), "run": np.repeat([" cw", "ccw"], 36)}
    )
    table.to_csv(tmp_path / "runs.csv", index=False)
    found, simulated = ballbar_check.read_traces(tmp_path / "runs.csv", 0.15)
    assert not simulated
    assert list(found) == ["cw", "ccw"]
    assert [trace.error.mean() for trace in found.values()] == pytest.approx([1e-4, 3e-4], abs=1e-12)


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
    cutter = _Cutter(half, tool, robot, nominal, q)
    fake = cutter.corrected(np.concatenate([[0.0], cutter.between(4), [1.0]]))
    first = found.corrected.angle < np.pi
    assert np.abs(found.corrected.error[first]).max() < 1.2 * cutter.deviation([*fake.T_fake], fake.q[0])
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


TOOL_BALLBAR_JOINTS, BAR = (0.0, 0.065, 0.149), 0.15
TILT = np.radians(0.02)


def readings(record, offset):
    """What a ballbar shows of the calibrated robot with offsets of its joints: the oracle walks the circle with both."""
    nominal = record.arm(calibrated=False)
    path = circle(nominal, JOINTS, BAR, tool_frame(TOOL_BALLBAR_JOINTS))
    robot = record.robot_calibrated()
    q = predict(path, robot, nominal, JOINTS, 0, tool_frame(TOOL_BALLBAR_JOINTS)).q
    points = (robot.poses(q + offset) @ tool_frame(TOOL_BALLBAR_JOINTS))[:, :3, 3]
    noise = 1e-6 * np.random.default_rng(0).standard_normal(len(q))
    trace = trace_of_points(path, points)
    return pd.DataFrame({"angle_deg": np.degrees(trace.angle), "error_mm": (trace.error + noise) * 1e3}), path, robot, q


def test_derivatives_are_those_of_central_differences(record):
    _, path, robot, q = readings(record, 0.0)
    angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    J = by_joints(path, robot, q, tool_frame(TOOL_BALLBAR_JOINTS), angle)
    for j in (1, 2, 4):
        ends = []
        for h in (1e-4, -1e-4):
            step = np.zeros(6)
            step[j] = h
            trace = trace_of_points(path, (robot.poses(q + step) @ tool_frame(TOOL_BALLBAR_JOINTS))[:, :3, 3])
            ends.append(trace.at(angle))
        slope = (ends[0] - ends[1]) / 2e-4
        assert np.abs((slope - slope.mean()) - (J[:, j] - J[:, j].mean())).max() < 0.05 * np.abs(J[:, j]).max()


def test_a_joint_that_lost_its_zero_is_found(record, tmp_path):
    offset = np.zeros(6)
    offset[2] = TILT
    old, new = (readings(record, step)[0] for step in (np.zeros(6), offset))
    found = ballbar(record, new, tool=TOOL_BALLBAR_JOINTS, joints=JOINTS, arcs=0, baseline=old)
    change = found.runs["measured"].since
    assert change.rms_before > 5e-6
    assert change.rms_after < 0.3 * change.rms_before
    values = np.array([item.value for item in change.offsets])
    std = np.array([item.std for item in change.offsets])
    assert (np.abs(values - offset) < 3 * std).all()
    before, after = change.rms_before * 1e3, change.rms_after * 1e3
    words = (
        f"Change since the baseline: {before:.4f} mm rms without offsets of joints, {after:.4f} mm rms with those that"
    )
    assert words in found.summary()
    assert "offsets beyond chance: " in found.summary()
    assert found.to_dict()["measured"]["measured"]["since_baseline"]["rms_mm"] == pytest.approx(change.rms_before * 1e3)
    same = ballbar(record, old, tool=TOOL_BALLBAR_JOINTS, joints=JOINTS, arcs=0, baseline=old).runs["measured"].since
    assert same.rms_before < 1e-12
    assert not any(item.clear for item in same.offsets)


def test_a_baseline_needs_readings_of_the_same_runs(record):
    old = readings(record, 0.0)[0]
    with pytest.raises(OptionError, match="name its file, too"):
        ballbar(record, tool=TOOL_BALLBAR_JOINTS, joints=JOINTS, baseline=old)
    with pytest.raises(OptionError, match="the baseline has other runs"):
        ballbar(record, old, tool=TOOL_BALLBAR_JOINTS, joints=JOINTS, baseline=old.assign(run="a"))
