"""Runs ``irbcal demo``, after setting everything up on the first run; arguments are passed on.

python scripts/demo.py on any system; scripts/demo looks for a Python first.
"""

import sys

from _setup import run

run("demo", "-m", "irbcal", "demo", *sys.argv[1:])
