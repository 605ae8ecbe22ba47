"""What a double click starts: the app, in irbcal-project of the home folder, from wherever the checkout lies."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture
def checkout(tmp_path):
    """The starters in a folder with a difficult name; what sets up and runs prints what it would run."""
    folder = tmp_path / "a maker's folder" / "scripts"
    folder.mkdir(parents=True)
    for path in (*SCRIPTS.glob("app*"), SCRIPTS / "_python.sh"):
        shutil.copy(path, folder)
    (folder / "_setup.py").write_text(
        "def run(*words):\n    print('|'.join(words))\ndef fail(words):\n    raise SystemExit(words)\n"
    )
    return folder


def launched(desktop):
    """The command of a desktop file, as desktops read it: escapes of its strings, then of its quotes, then %k."""
    line = re.search(r"^Exec=(.*)$", desktop.read_text(), re.MULTILINE)[1]
    plain = re.sub(r"\\(.)", r"\1", line)
    start, code, end = re.fullmatch(r'(\S+ -c) "((?:[^"\\]|\\.)*)" (%k)', plain).groups()
    return [*start.split(), re.sub(r"\\(.)", r"\1", code), str(desktop) if end == "%k" else end]


@pytest.mark.skipif(os.name == "nt", reason="shells of Linux and macOS")
@pytest.mark.parametrize("name", ["app", "app.command", "app.desktop"])
def test_a_double_click_starts_the_app(checkout, tmp_path, name):
    path = checkout / name
    assert os.access(path, os.X_OK)
    command = launched(path) if path.suffix == ".desktop" else [str(path)]
    environment = os.environ | {"HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd="/", env=environment)
    assert done.stdout.strip() == f"app|-m|irbcal|app|{tmp_path / 'irbcal-project'}"


def test_windows_runs_the_same_and_keeps_its_window_where_it_failed():
    lines = (SCRIPTS / "app.cmd").read_bytes().decode("ascii").split("\r\n")
    assert '%PYTHON_HERE% "%~dp0app.py" %*' in lines
    assert lines[-2:] == ["if errorlevel 1 pause", ""]
    assert not any("\n" in line for line in lines)
