"""A calibration, just made or loaded: the same by both ways, in its folder and in memory."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import irbcal
from irbcal.calibration import reached
from irbcal.errors import CalibrationError, OptionError
from irbcal.io import robots
from irbcal.measurement.cleaning import Exclusion

EXCLUDED = Exclusion(pose="1", target="smr1", reason="lost")


@pytest.fixture(scope="module")
def made():
    return irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", "26")


def test_what_was_made_is_what_is_loaded(made, tmp_path):
    made.save(tmp_path)
    loaded = irbcal.load(tmp_path)
    q = made.arm().random_joints(20, 1)
    assert np.abs(loaded.robot_calibrated().poses(q) - made.robot_calibrated().poses(q)).max() < 1e-14
    assert np.abs(made.validated.fit.robot.poses(q) - made.robot_calibrated().poses(q)).max() < 1e-12
    assert loaded.urdf == made.urdf == (tmp_path / "calibrated.urdf").read_bytes()
    assert loaded.folder == tmp_path
    assert made.folder is None


def test_a_loaded_calibration_is_saved_again_as_it_was(made, tmp_path):
    made.save(tmp_path / "one")
    irbcal.load(tmp_path / "one").save(tmp_path / "two")
    for name in ("calibrated.urdf", "calibration.json", "joint_origins.yaml", "report.html"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_links_are_added_on_request(made, tmp_path):
    made.save(tmp_path / "links", world_link=True, target_links=True)
    assert b'"target_smr1"' in (tmp_path / "links" / "calibrated.urdf").read_bytes()
    made.save(tmp_path / "plain")
    assert b'"target_smr1"' not in (tmp_path / "plain" / "calibrated.urdf").read_bytes()
    irbcal.load(tmp_path / "plain").save(tmp_path / "loaded", world_link=True, target_links=True)
    assert (tmp_path / "loaded" / "calibrated.urdf").read_bytes() == (
        tmp_path / "links" / "calibrated.urdf"
    ).read_bytes()


def test_the_urdf_says_first_that_it_was_changed_and_from_what(made):
    head = made.urdf.decode().split("<robot", 1)[0]
    first = head.split("-->")[0]
    assert "CALIBRATED by irbcal" in first
    assert "SIMULATED" in first
    assert "demo_identification.csv" in first
    assert made.record.created in first
    assert head.index("CALIBRATED") < head.index("nominal")


def test_a_urdf_calibrated_twice_says_so_once(made, tmp_path):
    alone = tmp_path / "my_robot.urdf"
    alone.write_bytes(made.urdf)
    again = irbcal.calibrate(robots.demo_file("demo_identification.csv"), alone, "11")
    assert again.urdf.count(b"CALIBRATED by irbcal") == 1
    assert b"model 11" in again.urdf


def test_no_path_of_this_computer_is_written(made, tmp_path):
    made.save(tmp_path)
    for name in ("calibration.json", "report.html", "calibrated.urdf", "joint_origins.yaml"):
        text = (tmp_path / name).read_text()
        assert str(robots.demo_file("")) not in text
        assert str(tmp_path) not in text


def test_the_report_is_written_again_with_figures_and_data(made, tmp_path):
    made.save(tmp_path / "cal")
    (tmp_path / "cal" / "report.html").write_text("")
    written = irbcal.report(tmp_path / "cal", figures=tmp_path / "f", format="svg", data=tmp_path / "d")
    assert (tmp_path / "cal" / "report.html").stat().st_size > 100_000
    assert {path.suffix for path in (tmp_path / "f").iterdir()} == {".svg"}
    assert set(written[tmp_path / "d"]) == {path.name for path in (tmp_path / "d").iterdir()}


def test_what_a_calibration_does_not_have_is_said(made):
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        made.colour  # noqa: B018
    assert made.record.model == "26"
    assert made.record.used_points(True)[0].poses == made.record.poses_heldout


def test_the_report_of_a_loaded_calibration(made, tmp_path):
    made.save(tmp_path)
    loaded = irbcal.load(tmp_path)
    assert irbcal.report(loaded) == {tmp_path: ("report.html", "calibration.json")}
    assert irbcal.verify(tmp_path)
    with pytest.raises(CalibrationError, match="save it first") as refused:
        irbcal.report(made)
    assert refused.value.parameter == "calibration"


def test_a_calibration_is_replaced_on_request_only(made, tmp_path):
    made.save(tmp_path)
    other = replace(made, record=made.record.model_copy(update={"created": "2020-01-01T00:00:00+00:00"}))
    for save in (other.save, partial(irbcal.save, other)):
        with pytest.raises(CalibrationError, match="overwrite=True"):
            save(tmp_path, target_links=True)
        assert irbcal.load(tmp_path).record.created == made.record.created
    other.save(tmp_path, overwrite=True)
    assert irbcal.load(tmp_path).record.created == other.record.created


def test_only_figures_have_a_format(made, tmp_path):
    made.save(tmp_path)
    with pytest.raises(OptionError, match="format: only figures have one") as refused:
        irbcal.report(tmp_path, format="svg")
    assert refused.value.parameter == "format"


def test_a_folder_without_a_name_is_refused(made):
    with pytest.raises(CalibrationError, match="expected the name of a folder") as refused:
        made.save("")
    assert refused.value.parameter == "out"


def test_what_was_left_out_is_said_in_words(made):
    for poses, words in ((3, "Left out: 26 points (3 poses left out whole)"), (0, "Left out: 26 points")):
        record = made.record.model_copy(update={"excluded": [EXCLUDED] * 26, "poses_excluded": poses})
        assert words in irbcal.Calibration(record, made.urdf).proof()


def test_figures_show_themselves_only(made):
    shown = [name for name in dir(made.plot) if not name.startswith("_")]
    assert "record" not in shown
    assert "errors_by_pose" in shown
    assert len(repr(made.plot)) < 300


def test_a_changed_record_has_another_robot(calibration_34):
    """What was computed from a record is not that of its copy with another placement."""
    record = calibration_34.record
    robot = record.robot_calibrated()
    assert record.robot_calibrated() is robot
    changed = record.model_copy(update={"placement": record.placement_nominal}).robot_calibrated()
    assert np.abs(changed.T_world_base - robot.T_world_base).max() > 1e-6
    np.testing.assert_allclose(changed.T_world_base, record.robot_nominal().T_world_base, rtol=0, atol=1e-12)


def record(held):
    objective = SimpleNamespace(name="max", value_mm=0.5, lower_bound_mm=0.4)
    parameters = [SimpleNamespace(name=name, state="held") for name in held]
    return SimpleNamespace(objective=objective, parameters=parameters, method="least-squares")


def test_a_certificate_names_what_is_held():
    assert reached(record([])).endswith("certified: not below 0.400 mm with this model")
    assert reached(record(["delta_d3"])).endswith("not below 0.400 mm with this model and with delta_d3 held")
