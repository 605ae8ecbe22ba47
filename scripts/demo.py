"""Runs ``irbcal demo``, after setting everything up on the first run; arguments are passed on.

python scripts/demo.py on any system; scripts/demo looks for a Python first.
"""

import sys

from _setup import VENV, WINDOWS, run

# by its file where that is a script: the lines that the demonstration ends with then work in any shell
program = ("-m", "irbcal") if WINDOWS else (str(VENV / "bin" / "irbcal"),)
run("demo", *program, "demo", *sys.argv[1:])
