"""Only regular files are read, and nothing that a file's name holds acts on the terminal."""

import io
import os
import socket

import pytest

from irbcal.errors import LONGEST_MESSAGE, MeasurementError, RobotError
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
