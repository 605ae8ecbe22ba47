"""Calibrations of all kinds of joint maps and arms agree with themselves as they are written."""

import pytest
from support import outcome_of

import irbcal
from irbcal.files import document, robots
from irbcal.files.consistency import contradictions


@pytest.mark.parametrize("model", ["nominal", "34b", "placement", "auto"])
def test_a_fresh_calibration_agrees_with_itself(model, tmp_path):
    made = irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", model)
    assert contradictions(made.record, made.urdf) == []


def test_another_calibrations_urdf_is_seen(tmp_path):
    file = robots.demo_file("demo_identification.csv")
    one, other = (document.build(outcome_of(file, "irb1600", model)) for model in ("34", "26"))
    assert "not the geometry of calibrated.urdf" in contradictions(one[0], other[1])[0]
