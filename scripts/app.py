"""Runs ``irbcal app``, after setting everything up on the first run; the project is irbcal-project in the home folder.

``python scripts/app.py`` on any system; arguments are passed on in place of that folder. Double click: app.cmd on
Windows, app.command on macOS, app.desktop on Linux.
"""

import sys
from pathlib import Path

from _setup import fail, run

if sys.version_info < (3, 11):
    fail(f"The app needs Python 3.11 or newer, found {sys.version.split()[0]}: set PYTHON to one.")
run("app", "-m", "irbcal", "app", *(sys.argv[1:] or [str(Path.home() / "irbcal-project")]))
