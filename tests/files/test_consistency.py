"""Calibrations of all kinds of joint maps and arms agree with themselves as they are written."""

import json

import pytest
from support import outcome_of

import irbcal
from irbcal.errors import CalibrationError
from irbcal.files import document, robots, seal
from irbcal.files.consistency import contradictions


@pytest.mark.parametrize("model", ["nominal", "34b", "placement", "auto"])
def test_a_fresh_calibration_agrees_with_itself(model, tmp_path):
    made = irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", model)
    assert contradictions(made.record, made.urdf) == []


def test_another_calibrations_urdf_is_seen(tmp_path):
    file = robots.demo_file("demo_identification.csv")
    one, other = (document.build(outcome_of(file, "irb1600", model)) for model in ("34", "26"))
    assert "not the geometry of calibrated.urdf" in "; ".join(contradictions(one[0], other[1]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["robot"]["lower"].pop(), "robot.lower has 5 entries for 6 joints"),
        (lambda d: d["robot"]["upper"].__setitem__(2, -300.0), "robot.lower of joint_3 is above robot.upper"),
        (lambda d: d["robot"]["base_to_frame0"].pop(), "base_to_frame0: List should have at least 4 items"),
        (lambda d: d["placement"]["base"].update(qw=0.0, qx=0.0, qy=0.0, qz=0.0), "no unit quaternion"),
        (lambda d: d["placement"]["targets"]["smr1"].pop(), "smr1: List should have at least 3 items"),
        (lambda d: d["robot"]["dhm_calibrated"][1].update(a_mm=800.0), "not the geometry of calibrated.urdf"),
        (lambda d: d["robot"]["lower"].__setitem__(1, 1e3), "robot.lower of .* is above robot.upper"),
        (lambda d: d["covariance"].update(size=3), "covariance"),
    ],
)
def test_a_renewed_seal_helps_no_contradiction(folder, tmp_path, change, words):
    """Whoever edits the file can renew its seal, too."""
    document = json.loads((folder / "calibration.json").read_bytes())
    change(document)
    (tmp_path / "calibration.json").write_text(json.dumps(seal.sealed(document)))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(tmp_path)


@pytest.fixture(scope="module")
def terms(tmp_path_factory):
    """A calibration of terms: frame terms, last moves, gravity."""
    folder = tmp_path_factory.mktemp("terms") / "cal"
    run = irbcal.simulate("irb120", random=60, seed=1, robot_seed=1, cell="realistic").measurements()
    irbcal.save(irbcal.calibrate(run, "irb120", "auto", terms="all"), folder)
    return folder


def _gravity(document):
    return next(term for term in document["joint_map"]["terms"] if term["basis"] == "gravity")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: None, None),
        (lambda d: _gravity(d).pop("link"), "joint_map"),
        (lambda d: _gravity(d).update(size={}), "calibration.json: joint_map"),
        (lambda d: d["joint_map"]["terms"][0].update(coefficient_rad=0.1), "joint_map misses its own test vectors"),
        (lambda d: d["frame_terms"]["terms"][0].update(coefficient_rad=0.1), "frame_terms miss their own test vectors"),
        (lambda d: d["frame_terms"]["test_vectors"][0]["T_base_tip"].pop(), "frame_terms"),
        (lambda d: d["frame_terms"]["test_vectors"][0]["T_base_tip"][1].pop(), "frame_terms cannot be used"),
    ],
)
def test_terms_are_held_against_their_test_vectors(terms, tmp_path, change, words):
    document = json.loads((terms / "calibration.json").read_bytes())
    change(document)
    (tmp_path / "calibration.json").write_text(json.dumps(seal.sealed(document)))
    (tmp_path / "calibrated.urdf").write_bytes((terms / "calibrated.urdf").read_bytes())
    if words is None:
        irbcal.load(tmp_path)
        return
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(tmp_path)
