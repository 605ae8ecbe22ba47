"""``irbcal ballbar`` with a simulated measured file."""

import numpy as np
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal import page_style
from irbcal.cli.main import app
from irbcal.validation.ballbar_check import circle, predict, tool_frame

OPTIONS = ["--bar", 150, "--tool", "0,65,149", "--joints", "10,0,0,0,90,0"]


def test_prediction_measurement_and_plot(program, demo_calibration, tmp_path):
    calibration = irbcal.load(demo_calibration)
    nominal, q = calibration.arm(calibrated=False), np.radians([10.0, 0, 0, 0, 90, 0])
    cup = tool_frame([0, 0.065, 0.149])
    path = circle(nominal, q, 0.15, cup)
    trace = predict(path, calibration.robot_calibrated(), nominal, q, 0, cup).uncorrected
    angle = np.arange(0, 360, 4.0)
    radius = 150 + 1e3 * trace.at(np.radians(angle)) + 0.02 * np.cos(2 * np.radians(angle))
    np.savetxt(
        tmp_path / "m.csv", np.column_stack([angle, radius]), "%.6f", ",", header="angle_deg,radius_mm", comments=""
    )
    options = [demo_calibration, tmp_path / "m.csv", *OPTIONS]
    found = program("ballbar", *options, "--json", "--plot", tmp_path / "b.svg")
    assert found["simulated"]
    assert found["nominal_targets"]["circularity_mm"] > 5 * found["fake_targets"]["circularity_mm"]
    measured = found["measured"]["measured"]
    assert measured["unexplained_rms_mm"] == pytest.approx(0.02 / np.sqrt(2), rel=0.01)
    assert measured["variation_rms_mm"] > measured["unexplained_rms_mm"]
    figure = (tmp_path / "b.svg").read_text(encoding="utf-8")
    for text in ("nominal targets, predicted", "fake targets (6 arcs), predicted", "measured", "J2 max", "bar 150 mm"):
        assert text in figure
    assert page_style.NOMINAL in figure
    assert page_style.CALIBRATED in figure
    text = program("ballbar", *options)
    assert "Joints that turn back" in text
    assert "unexplained" in text


def test_wrong_calls(demo_calibration):
    for wrong in (["--tool", "1,2"], ["--joints", "1,2,3"], ["--arcs", "0", "--run", "fake"]):
        assert CliRunner().invoke(app, ["ballbar", str(demo_calibration), *wrong]).exit_code == 2
