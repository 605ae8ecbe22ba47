"""The pages of docs/ build into a site without a warning; notebooks' cells run."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("[!i]*.md"))


def test_the_site_builds_without_warnings(tmp_path):
    pytest.importorskip("myst_nb", reason="the packages of the extra docs are not here")
    settings = ("-D", "nb_execution_mode=off")  # the cells are run below
    command = (
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-b",
        "html",
        "-W",
        "--keep-going",
        *settings,
        "docs",
        str(tmp_path),
    )
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path})
    assert done.returncode == 0, done.stderr
    front = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "tutorial.html" in front
    commands = (tmp_path / "_generated" / "commands.html").read_text(encoding="utf-8")
    assert "--holdout" in commands
    outside = re.findall(r'(?:src|href)="(https?://[^"]+\.(?:js|css|woff2?))"', front)
    assert outside == [], "the site needs no network"


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_cells_run(notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = re.findall(
        r"^```\{code-cell\}[^\n]*\n(.*?)^```", notebook.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    assert len(cells) >= 3
    names = {}
    for cell in cells:
        exec(compile(cell, str(notebook), "exec"), names)
