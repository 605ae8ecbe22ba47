"""Only regular files are read, and nothing that a file's name holds acts on the terminal."""

import io
import os
import socket

import pytest

from irbcal.errors import LONGEST_MESSAGE, CalibrationError, MeasurementError, OptionError, RobotError
from irbcal.io import calibration_folder
from irbcal.overwriting import FOLDER_FILES, refuse_overwriting, refuse_replacing
from irbcal.safe_files import read_bytes


def test_a_file_is_read_whole(tmp_path):
    (tmp_path / "a").write_bytes(b"\x00\xff" * 1000)
    (tmp_path / "link").symlink_to(tmp_path / "a")
    assert read_bytes(tmp_path / "link", MeasurementError) == b"\x00\xff" * 1000
    with pytest.raises(MeasurementError, match="at most 1 KiB, found more"):
        read_bytes(tmp_path / "a", MeasurementError, limit_bytes=1024)


def test_no_more_is_reserved_than_there_is(tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_bytes(b"12345")
    asked = []

    class Stream(io.BytesIO):
        def read(self, size=-1):
            asked.append(size)
            return super().read(size)

    monkeypatch.setattr("builtins.open", lambda handle, mode: Stream(os.read(handle, 100)))
    assert read_bytes(tmp_path / "a.csv", MeasurementError) == b"12345"
    assert asked == [6]
    status = os.stat(tmp_path / "a.csv")
    monkeypatch.setattr(os, "fstat", lambda handle: os.stat_result((*status[:6], 0, *status[7:])))  # as /proc says
    assert read_bytes(tmp_path / "a.csv", MeasurementError) == b"12345"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_pipes_devices_and_sockets_are_refused_without_waiting(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    monkeypatch.chdir(tmp_path)
    for path, words in (
        ("pipe", "expected a file, found a pipe"),
        ("/dev/zero", "expected a file, found a device"),
        ("folder", "expected a file, found a folder"),
        ("none", "there is no such file"),
        ("circle", "cannot read this file: Too many levels"),
        ("x" * 300, "the name is too long for a file"),
        ("a\x00b", "cannot read this file: embedded null byte"),
    ):
        with pytest.raises(RobotError, match=words):
            read_bytes(path, RobotError)
    with socket.socket(socket.AF_UNIX) as line:
        line.bind("socket")
        with pytest.raises(RobotError, match=r"socket: cannot read this file"):
            read_bytes("socket", RobotError)


def test_messages_are_one_printable_line():
    text = str(MeasurementError("found \x1b[31m\u2028" + "x" * 10_000, file="a\nb.csv"))
    assert text.startswith("a\\nb.csv: found \\x1b[31m\\u2028x")
    assert text.isprintable()
    assert len(text) <= LONGEST_MESSAGE


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


def test_a_plan_goes_into_the_folder_of_its_calibration(tmp_path):
    for name in FOLDER_FILES:
        (tmp_path / name).write_text("x")
    refuse_overwriting({"out": tmp_path}, tmp_path, command="plan")
    with pytest.raises(CalibrationError, match=READ):
        refuse_overwriting({"out": tmp_path}, tmp_path / "plan.csv", command="plan")
    with pytest.raises(CalibrationError, match=READ):
        refuse_overwriting({"out": tmp_path}, tmp_path, command="calibrate")


def test_tables_in_memory_and_names_are_no_files(tmp_path):
    refuse_overwriting({"out": tmp_path / "a", "changes": None}, 3, None, {"a": 1}, "irb1600", "x" * 5000, "a\0b")


def test_all_files_of_a_calibration_are_known():
    assert set(calibration_folder.FILE_NAMES) <= set(FOLDER_FILES)


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
