"""What Windows lacks and has otherwise, as far as another system can show: no fork, no POSIX modules, cp1252, drives."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path, PureWindowsPath

import pytest

import irbcal
from irbcal import literals, safe_files
from irbcal.io import robots

AS_ON_WINDOWS = """
import importlib.util, multiprocessing.context, os, subprocess, sys, tempfile, warnings

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name in {"fcntl", "resource", "termios", "pwd", "grp", "tty", "pinocchio"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

class Msvcrt:
    LK_LOCK, LK_UNLCK, locking = 1, 0, staticmethod(lambda handle, mode, length: None)

find_spec = importlib.util.find_spec
if __name__ == "__main__":
    importlib.util.find_spec = lambda name, package=None: None if name == "pinocchio" else find_spec(name, package)
    sys.modules.pop("fcntl", None)
    sys.meta_path.insert(0, Absent())
    sys.modules["msvcrt"] = Msvcrt
    for name in ("fork", "forkpty", "getuid", "geteuid", "mkfifo", "setsid", "killpg"):
        if hasattr(os, name):
            delattr(os, name)
    multiprocessing.set_start_method("spawn", force=True)
    # whatever is read or written in the encoding of the system is an error: it would be cp1252
    warnings.filterwarnings("error", category=EncodingWarning, module=r"irbcal\\.")
    from irbcal import __main__ as program
    codes = []
    leave, program.leave = program.leave, codes.append
    for line in sys.argv[1].splitlines():
        sys.argv = ["irbcal", *line.split("|")]
        program.start()
    leave(max(codes))
"""


def windows(*lines, folder):
    """Command lines one after the other in a process: what they print."""
    script = folder / "as_on_windows.py"
    script.write_text(AS_ON_WINDOWS, encoding="utf-8")
    environment = os.environ | {"PYTHONIOENCODING": "cp1252", "PYTHONWARNDEFAULTENCODING": "1"}
    command = [sys.executable, script, "\n".join("|".join(map(str, words)) for words in lines)]
    done = subprocess.run(command, capture_output=True, check=False, timeout=300, cwd=folder, env=environment)
    text = done.stdout.decode("cp1252"), done.stderr.decode("cp1252")
    assert done.returncode == 0, text
    return text[0]


def test_the_main_job_and_what_follows_run_without_what_windows_lacks(tmp_path):
    data, proof = (robots.demo_file(f"demo_{name}.csv") for name in ("identification", "verification"))
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "job.mod").write_text(
        "MODULE Job\n PROC main()\n  MoveAbsJ [[10,20,15,30,40,50],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n ENDPROC\n"
        "ENDMODULE\n",
        encoding="utf-8",
    )
    rows = [f"r{k},{data},irb1600,model=placement" for k in (1, 2)]
    (tmp_path / "jobs.csv").write_text("\n".join(["id,measurements,robot,options", *rows]) + "\n", encoding="utf-8")
    told = windows(
        ("calibrate", data, "--robot", "irb1600", "--model", "34", "--out", "c"),
        ("evaluate", "c", proof, "--report", "page.html"),
        ("export", "c", "--as", "ros", "--out", "ros"),
        ("view", "c", "--html", "v.html"),
        ("report", "c", "--figures", "figures", "--format", "svg"),
        ("filter", "c", "p/job.mod", "--out", "corrected.mod"),
        ("fleet", "calibrate", "jobs.csv", "--out", "f", "--jobs", "2"),  # by processes that do not fork
        folder=tmp_path,
    )
    assert "calibration.json" in told
    assert (tmp_path / "corrected.mod").is_file()
    assert sorted(path.parent.name for path in (tmp_path / "f").glob("*/calibration.json")) == ["r1", "r2"]


def test_the_list_of_names_is_read_in_any_encoding():
    """The package lazy_loader opens it in that of the system."""
    assert Path(irbcal.__file__).with_suffix(".pyi").read_bytes().isascii()


def test_a_rename_waits_for_readers(tmp_path, monkeypatch):
    """On Windows no file is replaced while another program reads it."""
    (tmp_path / "a").write_text("old")
    (tmp_path / "b").write_text("new")
    replace, tries = os.replace, []

    def busy(source, target):
        tries.append(target)
        if len(tries) < 3:
            raise PermissionError(13, "in use")
        replace(source, target)

    monkeypatch.setattr(os, "replace", busy)
    with pytest.raises(PermissionError):
        safe_files._rename(tmp_path / "b", tmp_path / "a")
    monkeypatch.setattr(safe_files, "fcntl", None)
    safe_files._rename(tmp_path / "b", tmp_path / "a")
    assert (tmp_path / "a").read_text() == "new"
    assert len(tries) == 3


def test_writers_take_turns_by_a_file(tmp_path, monkeypatch):
    """Locks of msvcrt, played by those of POSIX: ten seconds of waiting end with an error there, and it is tried again."""
    fcntl, lost = safe_files.fcntl, []

    class Msvcrt:
        LK_LOCK, LK_UNLCK = 1, 0

        @staticmethod
        def locking(handle, mode, length):
            if mode and not lost:
                lost.append(handle)
                raise OSError(36, "deadlock avoided")
            fcntl.flock(handle, fcntl.LOCK_EX if mode else fcntl.LOCK_UN)

    monkeypatch.setitem(sys.modules, "msvcrt", Msvcrt)
    monkeypatch.setattr(safe_files, "fcntl", None)
    inside, most = [], []

    def writer():
        with safe_files._locked(tmp_path):
            inside.append(1)
            most.append(len(inside))
            time.sleep(0.02)
            inside.pop()

    threads = [threading.Thread(target=writer) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 5
    assert lost


def test_files_on_two_drives(monkeypatch):
    def elsewhere(path, start):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", elsewhere)
    assert safe_files._relative(Path("/d/a"), Path("/c")) == "/d/a"


@pytest.mark.parametrize(
    ("uri", "path"),
    [
        ("file:///C:/ws/meshes/a.stl", "C:/ws/meshes/a.stl"),
        ("file:///d:\\a.stl", "d:\\a.stl"),
        ("file:///home/a.stl", "/home/a.stl"),
    ],
)
def test_addresses_of_files(uri, path):
    assert safe_files.path_of_uri(uri) == path
    assert PureWindowsPath(path).drive.lower() in ("c:", "d:", "")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("irbcal", r"C:\cells\a"), r"irbcal C:\cells\a"),
        (("irbcal", r"C:\my cells\a"), 'irbcal "C:\\my cells\\a"'),
        (("a&b", "50%"), '"a&b" "50%"'),
    ],
)
def test_lines_to_type(words, line):
    assert literals.shell(*words, windows=True) == line
