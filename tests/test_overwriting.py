"""What is written is never what was read, whatever its name."""

import os

import pytest

from irbcal.errors import CalibrationError, OptionError
from irbcal.io import calibration_folder
from irbcal.safe_files import FOLDER_FILES, refuse_overwriting, refuse_replacing

READ = "this is the file to read from: name another one to write"


@pytest.fixture
def job(tmp_path):
    file = tmp_path / "job.mod"
    file.write_text("MODULE m\nENDMODULE\n")
    return file


@pytest.mark.parametrize("way", ["same", "relative", "symlink", "hard link", "symlinked folder"])
def test_by_whatever_name(tmp_path, job, way, monkeypatch):
    out = tmp_path / "out.mod"
    if way == "same":
        out = job
    elif way == "relative":
        monkeypatch.chdir(tmp_path)
        out = "./job.mod"
    elif way == "symlink":
        out.symlink_to(job)
    elif way == "hard link":
        os.link(job, out)
    else:
        (tmp_path / "there").symlink_to(tmp_path, target_is_directory=True)
        out = tmp_path / "there" / "job.mod"
    with pytest.raises(CalibrationError, match=READ):
        refuse_overwriting({"out": out}, None, [job])


def test_outputs_must_differ(tmp_path):
    (tmp_path / "there").symlink_to(tmp_path, target_is_directory=True)
    with pytest.raises(OptionError, match="changes: expected another file than that of out"):
        refuse_overwriting({"out": tmp_path / "a", "changes": tmp_path / "there" / "a"})


def test_files_of_a_calibration_folder_are_inputs(tmp_path):
    for name in FOLDER_FILES:
        (tmp_path / name).write_text("x")
    with pytest.raises(CalibrationError, match=r"calibration\.json"):
        refuse_overwriting({"out": tmp_path / "calibration.json"}, tmp_path)
    refuse_overwriting({"out": tmp_path / "job_calibrated.mod"}, tmp_path)


def test_a_folder_to_write_holds_what_is_read(tmp_path):
    (tmp_path / "calibrated.urdf").write_text("x")
    with pytest.raises(CalibrationError, match="calibrated.urdf: " + READ):
        refuse_overwriting({"out": tmp_path}, str(tmp_path / "calibrated.urdf"))
    (tmp_path / "m.csv").write_text("x")
    refuse_overwriting({"out": tmp_path}, tmp_path / "m.csv")


def test_tables_in_memory_and_names_are_no_files(tmp_path):
    refuse_overwriting({"out": tmp_path / "a", "changes": None}, 3, None, {"a": 1}, "irb1600", "x" * 5000, "a\0b")


def test_all_files_of_a_calibration_are_known():
    assert set(calibration_folder.NAMES) <= set(FOLDER_FILES)


def test_an_earlier_calibration_is_replaced_on_request_only(tmp_path):
    refuse_replacing(tmp_path / "none")
    refuse_replacing(tmp_path)
    (tmp_path / calibration_folder.JSON_NAME).write_text("{}")
    with pytest.raises(CalibrationError, match="already: name another folder, or replace it with --force"):
        refuse_replacing(tmp_path)
    refuse_replacing(tmp_path, force=True)
    link = tmp_path / "broken"
    link.mkdir()
    (link / calibration_folder.JSON_NAME).symlink_to("nowhere")
    with pytest.raises(CalibrationError, match="--force"):
        refuse_replacing(link)
