"""Output that cannot be shown or was closed, packages that are not installed, Ctrl-C at the start."""

import os
import subprocess
import sys

import pytest

BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == {package!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocked())
sys.argv[0] = "irbcal"
from irbcal.__main__ import start
start()
"""


def run(*words, **options):
    options = {"capture_output": True, "text": True} | options
    return subprocess.run([sys.executable, *words], timeout=120, check=False, **options)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_what_an_encoding_has_not_is_escaped(encoding):
    shown = "3\\N{GREEK SMALL LETTER SIGMA} \\N{BOX DRAWINGS LIGHT HORIZONTAL}"
    code = f"from irbcal.cli.streams import forgive; forgive(); print('{shown}')"
    done = run("-c", code, env=os.environ | {"PYTHONIOENCODING": encoding})
    assert (done.stdout, done.stderr, done.returncode) == ("3\\u03c3 \\u2500\n", "", 0)


def test_a_closed_output_that_is_written_to_is_an_error():
    done = run("-m", "irbcal", "robots", preexec_fn=lambda: os.close(1))
    assert done.returncode == 1
    assert done.stderr.startswith("irbcal: standard output is closed")
    assert done.stderr.count("\n") == 1


def test_files_are_written_where_output_is_closed(tmp_path):
    """What is written to a file does not end in the stream that was closed, nor the other way round."""
    words = ("-m", "irbcal", "simulate", "--random", "4", "--robot", "irb1600", "--out", "m.csv")
    done = run(*words, cwd=tmp_path, preexec_fn=lambda: os.close(1))
    assert done.returncode == 1
    assert "simulated" in (tmp_path / "m.csv").read_text()
    assert "Written" not in (tmp_path / "m.csv").read_text()


def test_a_stream_without_standard_input_is_refused(folder):
    done = run("-m", "irbcal", "stream", folder, preexec_fn=lambda: os.close(0))
    assert (done.stdout, done.stderr, done.returncode) == ("", "irbcal: there is no standard input\n", 1)


@pytest.mark.parametrize("command", ["view", "plan"])
def test_a_package_that_is_not_installed_is_named(command, tmp_path):
    words = {
        "view": ["view", "irb1600", "--html", "view.html"],
        "plan": ["plan", "--robot", "irb1600", "--out", "plan", "--cube", "6", "--all-range", "6"],
    }[command]
    done = run("-c", BLOCKED.format(package="meshcat"), *words, cwd=tmp_path)
    assert done.stderr.endswith("pip install meshcat\n")
    assert done.stderr.count("\n") == 1
    if command == "plan":
        assert done.returncode == 0
        assert (tmp_path / "plan" / "plan.csv").is_file()
        assert not (tmp_path / "plan" / "plan.html").exists()
    else:
        assert done.returncode == 1
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("first", "quiet"), [("irbcal", True), ("/usr/bin/irbcal", True), ("mine.py", False)])
def test_ctrl_c_is_quiet_from_the_package_on_for_the_program_only(first, quiet):
    """The first thing that the package does; importing it in another program changes nothing."""
    code = (
        f"import sys; sys.argv[0] = {first!r}; import irbcal, signal; print(signal.getsignal(signal.SIGINT).__class__)"
    )
    assert ("Handlers" in run("-c", code).stdout) is quiet


def test_ctrl_c_where_python_cannot_raise_it_ends_the_program():
    code = "import sys; from irbcal import __main__; sys.unraisablehook = __main__._stopped_or_shown\n"
    code += "class Odd:\n    def __del__(self):\n        raise KeyboardInterrupt\nOdd()\nprint('goes on')"
    done = run("-c", code)
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 130)
