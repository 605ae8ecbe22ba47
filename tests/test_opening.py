"""Nothing is written that cannot be opened: calibrations of the samples; ``scripts/open_again`` has the whole matrix."""

import json

import pandas as pd
import pytest
from opening_cases import OWN_ROBOT, Case, faults

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.examples import measurements

CHOSEN = [
    Case("moves.csv", 0.0, (*OWN_ROBOT, "--method", "circles")),
    Case("measured.csv", 0.02, (*OWN_ROBOT, "--model", "34")),
    Case("touched.csv", 0.0, (*OWN_ROBOT, "--features", "balls.csv")),
]


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples")
    for sample in [*measurements.tracker_files(), *measurements.touched_files()]:
        (folder / sample.path).write_bytes(sample.content)
    return folder


@pytest.mark.parametrize("case", CHOSEN, ids=lambda case: " ".join((case.sample, *case.options[2:])))
def test_what_was_written_is_opened_by_every_command(case, samples, tmp_path, monkeypatch):
    monkeypatch.chdir(samples)
    assert faults(case, tmp_path / "out") == []


def test_figures_of_open_directions_are_null(samples, tmp_path):
    """A fifth of one-joint moves is all that shows an axis: without it nothing tells where points are."""
    found = irbcal.calibrate(samples / "moves.csv", samples / "my_robot.urdf", method="circles")
    irbcal.save(found, tmp_path / "out")
    known = json.loads((tmp_path / "out" / "calibration.json").read_text())["certainty"]
    assert set(known["leave_fifths_out_mm"].values()) == {None}
    assert all(0.05 < value < 0.3 for value in known["leave_one_out_mm"].values())
    robot = irbcal.load(tmp_path / "out").robot_calibrated()
    assert robot.predict([[0.0] * 6], target="smr1").interval.max() < 1e-3
    with pytest.raises(RobotError, match="without a fifth of its poses"):
        robot.predict([[0.0] * 6], target="smr1", in_order=True)


def test_a_target_of_one_pose_has_no_left_out_error(samples, tmp_path):
    """Its place follows from that pose alone; the other targets are known as well as without it."""
    rows = pd.read_csv(samples / "measured.csv", comment="#")
    lone = rows[(rows["pose"] == 8) & (rows["target"] == "smr2")].assign(
        target="lone", y_mm=lambda row: row["y_mm"] + 40
    )
    found = irbcal.calibrate(pd.concat([rows, lone]).sort_values("pose"), samples / "my_robot.urdf", "16")
    known = found.record.certainty.leave_one_out_mm
    assert known["lone"] is known[""] is None
    assert all(0.1 < known[name] < 2.0 for name in ("smr1", "smr2", "smr3"))


def test_the_longest_names_of_a_table_can_be_opened(samples, tmp_path):
    """Names of parameters are made of them."""
    rows = pd.read_csv(samples / "measured.csv", comment="#")
    rows["target"] = rows["target"].replace("smr1", "a" * 200)
    rows["session"] = rows["pose"].map(lambda pose: "bc"[pose % 2] * 200)
    found = irbcal.calibrate(rows, samples / "my_robot.urdf", "16")
    irbcal.save(found, tmp_path / "out")
    assert irbcal.verify(tmp_path / "out")
    with pytest.raises(CalibrationError, match=r"not written.*expected a name of at most 200 characters"):
        irbcal.save(found, tmp_path / "links", target_links=True)
    assert not (tmp_path / "links").exists()


def test_what_could_not_be_opened_is_not_written(samples, tmp_path):
    found = irbcal.calibrate(samples / "measured.csv", samples / "my_robot.urdf", model="nominal")
    out = tmp_path / "out"
    irbcal.save(found, out)
    before = {path.name: path.read_bytes() for path in out.glob("*")}
    assert "calibration.json" in before
    found.record.robot.dhm_calibrated[2] = found.record.robot.dhm_calibrated[2].model_copy(update={"d_mm": 6e11})
    with pytest.raises(CalibrationError, match=r"robot\.dhm_calibrated\.2\.d_mm: expected a number within"):
        irbcal.save(found, out, overwrite=True)
    assert {path.name: path.read_bytes() for path in out.glob("*")} == before
