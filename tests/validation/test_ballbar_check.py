"""The door to the ballbar: options, what was run, and what it tells."""

import pickle

import numpy as np
import pytest

from irbcal.errors import OptionError, RobotError
from irbcal.validation.ballbar_check import ballbar, circle, predict, tool_frame

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
    assert found.expected is found.prediction.uncorrected


def test_what_it_tells(found):
    data = found.to_dict()
    assert data["simulated"]
    assert data["fake_targets"]["circularity_mm"] < 0.1 * data["nominal_targets"]["circularity_mm"]
    assert data["reversals"][0]["joint"] == found.prediction.reversals[0].joint
    assert data["reversals"][0]["path_angle_deg"] == 360 * found.prediction.reversals[0].s
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


def test_measured_runs_are_compared_with_what_was_run(record, found, tmp_path):
    angle = np.arange(0, 360, 4.0)
    error = 1e3 * found.prediction.corrected.at(np.radians(angle))
    rows = [f"{a},{150 + e:.9f},{run}\n" for run in ("cw", "ccw") for a, e in zip(angle, error, strict=True)]
    (tmp_path / "m.csv").write_text("angle_deg,radius_mm,run\n" + "".join(rows))
    fake = ballbar(record, tmp_path / "m.csv", tool=TOOL, joints=JOINTS, run="fake")
    assert fake.expected is fake.prediction.corrected
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
