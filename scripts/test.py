"""Runs all tests with pytest on all cores, after setting everything up on the first run.

Arguments are passed on in place of that (``python scripts/test.py tests/view -k legend``); paths in them start at the
project's root. scripts/test looks for a Python first.
"""

import os
import sys
from pathlib import Path

from _setup import ROOT, run

os.chdir(ROOT)
arguments = sys.argv[1:]
if not arguments:
    # a file's tests stay together: they share what they set up; tests/conftest.py has the long files first;
    # every core has its test, BLAS need not look for more
    arguments = ["-n", "auto", "--dist", "loadfile", "--no-loadscope-reorder"]
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    os.environ.pop(
        "PYTHONDONTWRITEBYTECODE", None
    )  # many tests start the program, which would be compiled anew each time
    # mypy takes a minute for what it has never seen: another checkout need not check the same files again
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    os.environ.setdefault("MYPY_CACHE_DIR", str(cache / "irbcal" / "mypy"))
run("test", "-m", "pytest", *arguments)
