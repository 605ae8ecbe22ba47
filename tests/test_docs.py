"""The pages of docs/ build into a site without a warning."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


BUILD = """
import gc, sys
gc.disable()  # searching trees of documents for garbage takes a fifth of the time
from sphinx.application import Sphinx
settings = {"nb_execution_mode": "off"}  # tests/test_pages.py runs the cells
app = Sphinx("docs", "docs", sys.argv[1], f"{sys.argv[1]}/read", "html", settings, None, warningiserror=True)
app.builder.search = False
whole = app.builder.handle_page
app.builder.handle_page = lambda name, *words, **more: name in sys.argv and whole(name, *words, **more)
app.build()
sys.exit(app.statuscode)
"""
WRITTEN = ("index", "predictions", "_generated/commands")
"""Pages that are written; of the others the frame is left out, which takes most of the time."""


def test_the_site_builds_without_warnings(tmp_path):
    pytest.importorskip("myst_nb", reason="the packages of the extra docs are not here")
    command = (sys.executable, "-c", BUILD, str(tmp_path), *WRITTEN)
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path})
    assert done.returncode == 0, done.stderr
    front = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "tutorial.html" in front
    commands = (tmp_path / "_generated" / "commands.html").read_text(encoding="utf-8")
    assert "--holdout" in commands
    outside = re.findall(r'(?:src|href)="(https?://[^"]+\.(?:js|css|woff2?))"', front)
    assert outside == [], "the site needs no network"
    assert "<msqrt>" in (tmp_path / "predictions.html").read_text(encoding="utf-8"), "formulas are MathML"
