"""Builds the documentation into docs/_build, after setting everything up on the first run; needs no network then.

Arguments are passed on to sphinx-build. scripts/docs looks for a Python first.
"""

import os
import sys

from _setup import ROOT, run

os.chdir(ROOT)
print("Building docs/_build/index.html", flush=True)
run("test", "-m", "sphinx", "-q", "-b", "html", "-W", "--keep-going", "docs", "docs/_build", *sys.argv[1:])
