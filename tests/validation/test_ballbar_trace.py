"""Traces of a ballbar: closed forms and files."""

import numpy as np
import pandas as pd
import pytest
from circles import small
from support import arm, random_robot

from irbcal.errors import MeasurementError
from irbcal.validation import ballbar_check
from irbcal.validation.ballbar_check import predict


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
    assert ballbar_check.trace_statistics(trace)["circularity_mm"] == pytest.approx(0.4, abs=1e-3)


def ballbar_file(path, angle, radius, header="angle_deg,radius_mm"):
    np.savetxt(path, np.column_stack([angle, radius]), "%.6f", ",", header=header, comments="")
    return path


def test_measured_file_with_an_eccentric_ball(tmp_path):
    angle = np.arange(0, 360, 3.0)
    a = np.radians(angle)
    radius = 150.02 + 0.3 * np.cos(a) - 0.1 * np.sin(a) + 0.05 * np.cos(2 * a)
    trace = ballbar_check.read_traces(ballbar_file(tmp_path / "b.csv", angle, radius), 0.15)["measured"]
    assert trace.shift == pytest.approx([3e-4, -1e-4], abs=1e-8)
    assert np.abs(trace.error - (2e-5 + 5e-5 * np.cos(2 * a))).max() < 1e-8
    same = ballbar_check.read_traces(ballbar_file(tmp_path / "e.csv", angle, radius - 150, "angle_deg,error_mm"), 0.15)[
        "measured"
    ]
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
    trace = ballbar_check.read_traces(ballbar_file(tmp_path / "m.csv", angle, radius), 0.15)["measured"]
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
    found = ballbar_check.trace_statistics(trace)
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
    found = ballbar_check.read_traces(tmp_path / "runs.csv", 0.15)
    assert list(found) == ["cw", "ccw"]
    assert [trace.error.mean() for trace in found.values()] == pytest.approx([1e-4, 3e-4], abs=1e-12)
